"""Contact parameters at a pose that is only an estimate: where a follower is likely to touch its cam."""

from __future__ import annotations

from typing import Any

import numpy as np

from refkin.joints import Cam, Polar
from refkin.system import System

SCAN = 721
"""How many points of a profile are looked at: those of a closed one are half a degree apart."""
SCANS = 3
"""How often, each time between the neighbours of the best point: a roller may be smaller than half a degree is long,
and a second root, on the other side of the profile, is as near as that."""
AT_END = 1e-6
"""Distance [rad] from the end of a profile that a sweep, which halves its steps, certainly comes below."""


def touched(system: System, q: Any, t: float) -> Any:
    """Return coordinates (n,) with each contact parameter set to its estimate, or to where the joint misses least.

    What it misses are its own rows: for a point the distance from the profile; for a roller and a face the tangent
    counts as well.
    """
    q = np.array(q, float)
    for p in system.placed:
        cam = p.constraint
        if not isinstance(cam, Cam) or not cam.parameters:
            continue
        at = system.parameter(cam.name)
        if cam.contact_estimate is not None:
            q[at] = cam.contact_estimate
            continue
        low, high = span = cam.span
        for _ in range(SCANS):
            scanned = np.linspace(low, high, SCAN)
            poses = np.repeat(q[:, None], SCAN, axis=1)
            poses[at] = scanned
            rows = system.phi(poses, t)[p.row : p.row + cam.rows]
            q[at] = scanned[np.argmin(np.sum(rows**2, axis=0))]
            low, high = np.clip(q[at] + np.array([-1, 1]) * (scanned[1] - scanned[0]), *span)
    return q


def end_of_profile(system: System, q: Any) -> str:
    """Return the joint whose contact is at an end of its open profile, "" if there is none."""
    for joint in system.mechanism.joints:
        if isinstance(joint, Cam) and isinstance(joint.profile, Polar):
            (s,) = q[system.parameter(joint.name)]
            if min(abs(s - end) for end in joint.profile.law.domain()) < AT_END:
                return joint.name
    return ""
