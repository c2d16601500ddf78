"""Cams: a follower touches a profile (Shabana, Computational Dynamics, section 3.9); see `contact_kinematics`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np

from refkin.errors import Fault
from refkin.joints.base import Blocks, Constraint, Rows, Unit
from refkin.joints.contact_kinematics import FaceOnCurve, FaceOnDisc, PointOnCurve, RollerOnCurve
from refkin.joints.elements import Contact, Element, GuidedPoint, Pair, PointDistance
from refkin.joints.planar import BetweenPoints, Distance, direction, ends_of
from refkin.motion_laws import STRICT, AnyLaw, ByKind, Table
from refkin.vec import Scalar

SCAN = 721
"""How many points of a profile are looked at: those of a closed one are half a degree apart."""
SCANS = 3
"""How often, each time between the neighbours of the best point: a roller may be smaller than half a degree is long,
and a second root, on the other side of the profile, is as near as that."""


@dataclass(frozen=True, kw_only=True)
class Disc:
    """A circular profile around point_i [m]; off the body's pivot it is an eccentric."""

    radius: float
    kind: Literal["disc"] = "disc"
    __pydantic_config__ = STRICT

    def faults(self, path: str) -> Iterator[Fault]:
        """Yield whether the radius is none."""
        if not self.radius > 0:
            yield Fault(f"{path}.radius", self.radius, "a radius above 0")


@dataclass(frozen=True, kw_only=True)
class Polar:
    """A profile d(s) [m] around point_i, by the angle s [rad] from the x-axis of body i.

    A law that repeats itself every turn is a closed profile, whose contact parameter may be found in any turn. Any
    other is open, as on a sector cam or a spiral, and a table that is not periodic ends where its arguments do.
    """

    law: AnyLaw
    kind: Literal["polar"] = "polar"
    __pydantic_config__ = STRICT

    @property
    def closed(self) -> bool:
        """Whether the profile repeats itself every turn."""
        law = self.law
        if isinstance(law, Table):
            return law.periodic
        if law.kind == "sinusoid":
            return law.angular_frequency == round(law.angular_frequency) or law.amplitude == 0.0
        return not any(law.coefficients[1:])

    @property
    def span(self) -> tuple[float, float]:
        """The parameters among which a contact is looked for: a turn, an open table's own, or two turns of a spiral."""
        low, high = self.law.domain()
        reach = math.pi if self.closed else 2 * math.pi
        return max(low, -reach), min(high, reach)

    def faults(self, path: str) -> Iterator[Fault]:
        """Yield the law's faults, and whether a periodic table repeats itself at other than whole parts of a turn."""
        of_law = list(self.law.faults(f"{path}.law"))
        yield from of_law
        if isinstance(self.law, Table) and self.law.periodic and not of_law:
            first, last = self.law.argument[0], self.law.argument[-1]
            parts = float(np.rint(math.tau / (last - first)))
            # The arguments and their difference are rounded; one beyond all numbers is no part of a turn either.
            if not abs((last - first) * parts - math.tau) <= parts * 2.0**-50 * max(math.tau, abs(first), abs(last)):
                yield Fault(f"{path}.law.argument", last - first, f"a period of {math.tau!r} or of a whole part of it")


AnyProfile = Annotated[Disc | Polar, ByKind()]


@dataclass(frozen=True, kw_only=True)
class Cam(BetweenPoints):
    """A follower on a cam: body i carries the profile around point_i, body j touches it, at one place that is followed.

    The follower is a point (point_j), a roller around point_j (`roller_radius`), or a flat face through point_j with
    the normal `normal_j`, in the frame of body j, which points from the cam to the follower. A disc takes one row,

    ====== =========================================
    flat   normal_j . d - radius = 0
    point  |d| - radius = 0
    roller |d| - radius - roller_radius = 0
    ====== =========================================

    a polar profile two and one more coordinate, the contact parameter s, with u(s) = d(s) (cos s, sin s) and the
    contact tangent t = du/ds of the source; `contact_kinematics` has the rows. `contact_estimate` is s at the first
    time, if it matters which of several contacts is meant: by default the nearest to the estimated pose. Whether
    another part of a hollow profile stands through the follower is not looked at.
    """

    profile: AnyProfile
    follower: Literal["flat", "point", "roller"]
    normal_j: Pair | None = None
    roller_radius: float | None = None
    contact_estimate: float | None = None
    type: Literal["cam"] = "cam"

    def elements(self) -> Iterator[Element]:
        """Yield the contact; of a disc the distance or the guided point that says the same."""
        if isinstance(self.profile, Polar):
            yield Contact(
                **ends_of(self), profile=self.profile.law, normal_j=self.normal_j, roller_radius=self.roller_radius
            )
        elif self.normal_j is None:
            yield PointDistance(**ends_of(self), length=self.profile.radius + (self.roller_radius or 0.0))
        else:  # the centre of the disc lies a radius behind the face: the cam's point is guided by the follower
            (x, y), radius = self.normal_j, self.profile.radius
            cam, face = (self.body_i, self.point_i), (self.body_j, self.point_j)
            yield GuidedPoint(
                body_i=face[0], point_i=face[1], axis_i=(-y, x), body_j=cam[0], point_j=cam[1], offset=radius
            )

    @property
    def contact(self) -> Any:
        """The class that states the formulas for this profile and follower."""
        if self.profile.kind == "disc":
            return FaceOnDisc if self.follower == "flat" else Distance
        return {"flat": FaceOnCurve, "point": PointOnCurve, "roller": RollerOnCurve}[self.follower]

    @property
    def rows(self) -> int:
        return self.contact.rows  # type: ignore[no-any-return]

    @property
    def parameters(self) -> int:
        return 1 if self.profile.kind == "polar" else 0

    @property
    def span(self) -> tuple[float, float]:
        """Where the contact parameter is looked for; nowhere on a disc, which has none."""
        return self.profile.span if isinstance(self.profile, Polar) else (0.0, 0.0)

    def reach(self) -> float:
        if isinstance(self.profile, Disc):
            return self.profile.radius
        low, high = self.profile.law.domain()
        distance: float = abs(self.profile.law(min(max(0.0, low), high)))
        return distance

    def constants(self, unit: Unit) -> tuple[float, ...]:
        """Return the two points, then what the follower's formulas take, as `contact_kinematics` has it in a table."""
        points = super().constants(unit)
        if self.normal_j is not None:
            disc = (self.profile.radius / unit.size,) if self.profile.kind == "disc" else ()
            return (*points, *direction(self.normal_j), *disc)
        around = 0.0 if self.roller_radius is None else self.roller_radius
        distance = (around + self.profile.radius if self.profile.kind == "disc" else around) / unit.size
        return points if self.contact is PointOnCurve else (*points, distance, 1 / distance)

    def initial_contact(self, rows: Callable[[Any], Any]) -> Any:
        """Return the contact parameter's estimate, or where its `rows` (2, B) at parameters (B,) are smallest."""
        if self.contact_estimate is not None:
            return self.contact_estimate
        low, high = self.span
        for _ in range(SCANS):
            scanned = np.linspace(low, high, SCAN)
            s = scanned[np.argmin(np.sum(rows(scanned) ** 2, axis=0))]
            low, high = np.clip(s + np.array([-1, 1]) * (scanned[1] - scanned[0]), *self.span)
        return s

    def profile_values(self, s: Scalar, unit: Unit, order: int) -> tuple[Scalar, ...]:
        """Return d(s), scaled, and its derivatives up to `order`."""
        return tuple(self.profile.law(s, k) / unit.size for k in range(order + 1))  # type: ignore[union-attr]

    def faults(self, path: str) -> Iterator[Fault]:
        """Yield the faults of the profile, and what the follower lacks, or has and does not need."""
        yield from self.profile.faults(f"{path}.profile")
        if self.follower == "flat" and self.normal_j is None:
            yield Fault(f"{path}.normal_j", None, "the normal of the face, as the follower is flat")
        elif self.follower == "flat" and math.hypot(*self.normal_j) == 0.0:  # type: ignore[misc]
            yield Fault(f"{path}.normal_j", list(self.normal_j), "a vector that is not zero")  # type: ignore[arg-type]
        elif self.follower != "flat" and self.normal_j is not None:
            yield Fault(f"{path}.normal_j", list(self.normal_j), f"no normal, as the follower is a {self.follower}")
        if self.follower == "roller" and not (self.roller_radius is not None and self.roller_radius > 0):
            yield Fault(f"{path}.roller_radius", self.roller_radius, "a radius above 0, as the follower is a roller")
        elif self.follower != "roller" and self.roller_radius is not None:
            yield Fault(f"{path}.roller_radius", self.roller_radius, f"no roller, as the follower is {self.follower}")
        if self.profile.kind == "disc" and self.contact_estimate is not None:
            yield Fault(f"{path}.contact_estimate", self.contact_estimate, "no such key, as the profile is a disc")

    def residual(self, g: Any, f: Any, *at: Any) -> Rows:  # type: ignore[override]
        return self.contact.residual(g, f, *at)  # type: ignore[no-any-return]

    def jacobian(self, g: Any, f: Any, *at: Any) -> Blocks:  # type: ignore[override]
        return self.contact.jacobian(g, f, *at)  # type: ignore[no-any-return]

    def nu(self, g: Any, f: Any, *at: Any) -> Rows:
        return (0,) * self.rows

    def gamma(self, g: Any, f: Any, *at: Any) -> Rows:  # type: ignore[override]
        return self.contact.gamma(g, f, *at)  # type: ignore[no-any-return]


def polar_cams(constraints: Iterable[Constraint]) -> list[Any]:
    """Return the cams of polar profile: those that bring a contact parameter, with a `span` and a `profile`."""
    return [c for c in constraints if isinstance(c, Cam) and c.parameters]
