"""A mechanism with every body's frame moved to a joint of the body.

Where a frame lies far from its joints (1e8 sizes, say), turning the body is almost the same as shifting it, and phi_q
is nearly singular without any reason in the mechanism. With frames near joints what is singular is so on its own
account. Nothing is rounded by the move: frames go to a place near the joint whose coordinates are whole sizes, so that
the differences of points from it need no digits that the points do not have.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from refkin.joints import GROUND, Constraint
from refkin.joints.spatial_vectors import Quaternion, SpatialValues
from refkin.model import Mechanism
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
        """Return coordinates (n,) of the system as those of `inner`."""
        return self._moved(q, 1.0)

    def outward(self, q: Any) -> Any:
        """Return coordinates (n,) of `inner` as those of the system."""
        return self._moved(q, -1.0)

    def outward_balls(self, q: Any) -> tuple[Any, ...]:
        """Return balls (n,) that enclose the coordinates of `inner` as those of the system."""
        out = list(q)
        for at, shift in self._bodies():
            for k, x in enumerate(_turned(q[at], shift.tolist()), at.start):
                out[k] = q[k] - x
        return tuple(out)

    def _bodies(self) -> Iterator[tuple[slice, Any]]:
        width = self.system.kind.width
        for k, shift in enumerate(self.shifts):
            yield slice(width * k, width * (k + 1)), shift

    def inward_rate(self, q: Any, rate: Any) -> Any:
        """Return the change (n,) of the coordinates of `inner`, at its q, that goes with one of the system's."""
        return self._swept(q, rate, 1.0)

    def outward_rate(self, q: Any, rate: Any) -> Any:
        """Return the change (n,) of the system's coordinates that goes with one of those of `inner`, at its q."""
        return self._swept(q, rate, -1.0)

    def _swept(self, q: Any, rate: Any, sign: float) -> Any:
        rate = np.array(rate, float)
        for at, shift in self._bodies():
            own = rate[at]
            if len(shift) == 2:
                x, y = _turned(q[at], shift)
                swept: Any = (-y * (sign * own[2]), x * (sign * own[2]))
            else:
                arm = SpatialValues(*q[at]).arm(*shift)
                swept = (arm.along(Quaternion.of(*own[3:])) * sign).parts
            rate[at.start : at.start + len(shift)] += swept
        return rate

    def _moved(self, q: Any, sign: float) -> Any:
        q = np.array(q, float)
        for at, shift in self._bodies():
            q[at.start : at.start + len(shift)] += [sign * x for x in _turned(q[at], shift)]
        return q


def _turned(q: Any, u: Any) -> Any:
    if len(u) == 3:
        return SpatialValues(*q).arm(*u).at.parts
    c, s = (q[2].cos(), q[2].sin()) if hasattr(q[2], "cos") else (np.cos(q[2]), np.sin(q[2]))
    return c * u[0] - s * u[1], s * u[0] + c * u[1]


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
