"""Where the coordinates that joints bring of their own begin: contact parameters, and angles that count turns."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from refkin.joints.spatial_base import Counted


def initial_contacts(system: Any, q: Any, t: float) -> Any:
    """Return coordinates with each own coordinate of a joint set to its estimate, or to where the joint misses least.

    What it misses are its own rows: for a point the distance from the profile; for a roller and a face the tangent
    counts as well. Turns that gears count are those that laws have, as an estimate says nothing of them.

    Parameters
    ----------
    system : refkin.system.System
    q : (n,) array
        A pose at time t [s], or an estimate of one; its own coordinates of joints are not looked at.
    t : float
        When [s].
    """
    q = np.array(q, float)

    def rows(p: Any, column: int, s: Any) -> Any:
        poses = np.repeat(q[:, None], len(s), axis=1)
        poses[column] = s
        return system.phi(poses, t)[p.row : p.row + p.constraint.rows]

    own = [p for p in system.placed if p.constraint.parameters]
    for p in own:
        q[p.starts[2]] = p.constraint.initial_contact(partial(rows, p, p.starts[2]))
    settled = {p.starts[2] for p in own if not isinstance(p.constraint, Counted)}
    waiting = sorted((p for p in system.placed if p.constraint.shares), key=lambda p: len(p.constraint.shares))
    while waiting:  # drivers first, then gears from wheel to wheel
        columns = [{*p.starts[len(p.constraint.bodies) :]} - settled for p in waiting]
        k = min(range(len(waiting)), key=lambda k: len(columns[k]))
        for column in sorted(columns[k])[-1:]:
            now, further = rows(waiting[k], column, q[column] + np.array([0.0, np.pi]))[0]
            q[column] += np.pi * np.round(now / (now - further))
        settled |= columns[k]
        del waiting[k]
    return q
