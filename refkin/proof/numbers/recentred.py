"""A mechanism with every body's frame moved to a joint of the body.

Where a frame lies far from its joints (1e8 sizes, say), turning the body is almost the same as shifting it, and phi_q
is nearly singular without any reason in the mechanism. With frames near joints what is singular is so on its own
account. Nothing is rounded by the move: frames go to a place near the joint whose coordinates are whole sizes, so that
the differences of points from it need no digits that the points do not have.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from refkin.analysis import sigma_min
from refkin.joints import GROUND, Constraint
from refkin.model import Mechanism
from refkin.motion import SINGULAR
from refkin.system import System, compile_system

FAR = 4.0
"""Distance of a frame from a joint of its body, in sizes, up to which it stays where it is."""


@dataclass(frozen=True)
class Recentred:
    """A system in its own unit, `inner` with its frames moved, and by how much: (bodies, dimension), scaled."""

    system: System
    inner: System
    shifts: Any

    @property
    def furthest(self) -> float:
        """How far a frame was moved at most, in sizes."""
        return float(np.max(np.abs(self.shifts), initial=0.0))

    def inward(self, q: Any) -> Any:
        """Return coordinates (n,) of the system, numbers or balls, as those of `inner`."""
        return self._moved(q, 1.0)

    def outward(self, q: Any) -> Any:
        """Return coordinates (n,) of `inner`, numbers or balls, as those of the system."""
        return self._moved(q, -1.0)

    def inward_rate(self, q: Any, rate: Any) -> Any:
        """Return the change (n,) of the coordinates of `inner`, at its q, that goes with one of the system's."""
        return self._moved(q, 1.0, rate)

    def outward_rate(self, q: Any, rate: Any) -> Any:
        """Return the change (n,) of the system's coordinates that goes with one of those of `inner`, at its q."""
        return self._moved(q, -1.0, rate)

    def is_regular(self, q: Any, t: float) -> bool:
        """Whether sigma_min of `inner` at coordinates (n,) of the system is above `SINGULAR`."""
        inward = self.inward(q)
        return sigma_min(self.inner.held_at(inward).phi_q(inward, t)) > SINGULAR

    def _moved(self, q: Any, sign: float, rate: Any = None) -> Any:
        """Return coordinates, or their rates, where each body's origin is the point that its shift leads to."""
        kind, levels = self.system.kind, [np.array(level) for level in (q, rate) if level is not None]
        for k, shift in enumerate(sign * self.shifts):
            at = slice(kind.width * k, kind.width * (k + 1))
            motion = kind.values(*q[at]).point_motion(tuple(shift.tolist()), None if rate is None else rate[at], None)
            for level, moved in zip(levels, motion, strict=False):
                level[at][: kind.dimension] = moved
        return levels[-1]


def recentred(system: System) -> Recentred:
    """Return a system, compiled in its mechanism's own unit, and in it frames far from their joints moved to one."""
    mechanism, size = system.mechanism, system.unit.size
    shifts = np.zeros((len(mechanism.bodies), system.kind.dimension))
    for k, body in enumerate(mechanism.bodies):
        points = [u for c in mechanism.constraints for b, u in c.points() if b == body.name]
        if points and min(math.hypot(*u) for u in points) > FAR * size:
            shifts[k] = [size * round(x / size) if abs(x) > FAR * size else 0.0 for x in points[0]]
    if not shifts.any():
        return Recentred(system, system, shifts)
    by_name = {body.name: shift for body, shift in zip(mechanism.bodies, shifts, strict=True)}
    joints = tuple(_moved(c, by_name) for c in mechanism.joints)
    drivers = tuple(_moved(c, by_name) for c in mechanism.drivers)
    inner = compile_system(Mechanism(mechanism.bodies, joints, drivers), unit=system.unit)
    return Recentred(system, inner, shifts / size)


def _moved(constraint: Any, shifts: dict[str, Any]) -> Any:
    """Return a constraint with its points given in the moved frames."""
    c: Constraint = constraint
    moved = {}
    for key, body in (("point_i", "body_i"), ("point_j", "body_j"), ("point", "body")):
        on = getattr(c, body, GROUND)
        if hasattr(c, key) and on != GROUND:
            moved[key] = tuple(float(u - s) for u, s in zip(getattr(c, key), shifts[on], strict=True))
    return replace(c, **moved) if moved else c  # type: ignore[arg-type]
