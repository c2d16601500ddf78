"""What a body of space brings along: seven coordinates, a row for its unit length, one for a passive spin."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

from refkin.joints.base import Blocks, Constraint, Kind, Rows, Unit
from refkin.joints.elements import GROUND, Triple
from refkin.joints.spatial_frames import root, unit_vector
from refkin.joints.spatial_passive import passive_spins
from refkin.joints.spatial_vectors import Quaternion, SpatialValues, Vec3


def own_rows(bodies: Sequence[Any], constraints: Sequence[Constraint]) -> Iterator[Constraint]:
    """Yield the rows that bodies of space bring: that of each one's unit length, and one for each passive spin."""
    for body in bodies:
        yield UnitLength(name=body.name, body=body.name)
    estimates = {body.name: body.estimate for body in bodies}
    for spin in passive_spins(bodies, constraints):
        (body, (through, line)), *others = spin.items()
        reference: Any = (estimates[body] or SPACE.still)[3:]
        held: Any = {"body": body, "through": through, "line": line, "reference": reference, "others": tuple(others)}
        yield PassiveSpin(name=" and ".join(spin), **held)


def with_unit_length(estimate: Any) -> Any:
    """Return the coordinates of a body with its Euler parameters, if it has any, scaled to length 1."""
    row = isinstance(estimate, tuple) and len(estimate) == SPACE.width
    if not row or not all(isinstance(x, Real) for x in estimate):
        return estimate
    length = math.hypot(*estimate[3:])
    if length == 0.0 or not math.isfinite(length) or abs(length - 1) <= 2.0**-50:
        return tuple(estimate)
    return (*estimate[:3], *(x / length for x in estimate[3:]))


SPACE = Kind(
    name="spatial",
    coordinates=("x", "y", "z", "e0", "e1", "e2", "e3"),
    freedoms=6,
    dimension=3,
    turns=(0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 2.0),
    still=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
    values=SpatialValues,
    own_rows=own_rows,
)


@dataclass(frozen=True, kw_only=True)
class UnitLength(Constraint):
    """The Euler parameters of a body have length 1: (p . p - 1) / 2 = 0."""

    kind = SPACE
    rows = 1
    body: str
    type: str = "unit_length"

    @property
    def bodies(self) -> tuple[str, str]:
        return GROUND, self.body

    def residual(self, g: Any, f: Any, *at: Any) -> Rows:  # type: ignore[override]
        return ((at[1].p.dot(at[1].p) - 1) * 0.5,)

    def jacobian(self, g: Any, f: Any, *at: Any) -> Blocks:  # type: ignore[override]
        return ((0,) * 7,), ((0, 0, 0, *at[1].p.parts),)

    def gamma(self, g: Any, f: Any, *at: Any) -> Rows:  # type: ignore[override]
        return (-at[1].pd.dot(at[1].pd),)


@dataclass(frozen=True, kw_only=True)
class PassiveSpin(UnitLength):
    """A body that nothing keeps from spinning about a line in it is held as far turned as at a pose: 2 s . p = 0.

    Of bodies that spin as one the first is held; `others` has the rest, with the line in each.

    s = p0 (0, u), p0 the pose, u the line. Where the line has any direction but that opposite to its own at p0, p and
    -p alone solve it; at p0 itself the rates are those without spin, omega . u = alpha . u = 0. p0 is the estimate
    (`reference`), or what `System.held_at` is given.
    """

    through: Triple
    line: Triple
    reference: tuple[float, float, float, float]
    others: tuple[tuple[str, tuple[Triple, Triple]], ...] = ()
    type: str = "passive_spin"

    @property
    def passive(self) -> str:
        line, through = (", ".join(f"{x + 0.0:.6g}" for x in v) for v in (unit_vector(self.line).parts, self.through))
        spins, of = ("spin as one", self.body) if self.others else ("spins", "its own")
        return f"passive degree of freedom: {self.name} {spins} about ({line}) through ({through}) of {of}"

    def gauge(self, g: Any, q: Any) -> tuple[Any, ...]:
        """Return 2 s of a body that is at q, which begins with its coordinates: (7 or more,) or (7 or more, B)."""
        p = Quaternion.of(*(q[3:7] if q.ndim > 1 else q[3:7].tolist()))
        return (p.times(Quaternion(0, Vec3(*g[4:7]))) * 2).parts

    def constants(self, unit: Unit) -> tuple[float, ...]:
        """Return 2 s at the reference pose (4), the direction of the line (3), and the scaled point it goes through."""
        p0, u = Quaternion.of(*self.reference), unit_vector(self.line)
        held = p0.times(Quaternion(0, u)) * (2 / root(p0.dot(p0)))
        return (*held.parts, *u.parts, *unit.point(self.body, self.through))

    def residual(self, g: Any, f: Any, *at: Any) -> Rows:  # type: ignore[override]
        return (Quaternion.of(*(f or g[:4])).dot(at[1].p),)

    def jacobian(self, g: Any, f: Any, *at: Any) -> Blocks:  # type: ignore[override]
        return ((0,) * 7,), ((0, 0, 0, *(f or g[:4])),)

    def gamma(self, g: Any, f: Any, *at: Any) -> Rows:  # type: ignore[override]
        return (0,)
