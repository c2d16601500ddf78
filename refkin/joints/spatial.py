"""The spatial joints.

To add a joint, write a dataclass like these (its fields are its keys in a scene file), say by which `formulas` it is
solved and which elements it `consists_of`, and name it in `SPATIAL_JOINT_TYPES`; see docs/howto/code.md. Its rows come
in one of three forms where these differ:

========= ========================================================================================================
`half`    of full rank and without false roots: half angles (`spatial_turns`)
`dot`     of full rank, by dot products, as exudyn has its rows; zero as well where an axis is reversed
`printed` cross products, as Shabana prints them (Computational Dynamics, 7): more rows than are independent
========= ========================================================================================================
A joint without the form `dot` has other rows than exudyn: these are not compared, and it is said.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from refkin.errors import Fault
from refkin.joints.base import Constraint, Unit
from refkin.joints.elements import Triple
from refkin.joints.spatial_base import BetweenSpatialPoints, Counted, Formed, OfAxes, OfFrames, OfLines, OwnTurn
from refkin.joints.spatial_elements import (
    AxesParallel,
    AxesPerpendicular,
    PointInPlane,
    PointOnAxis,
    PointsMeet,
    ScrewMotion,
    SpatialPointDistance,
    TurnAboutAxis,
)
from refkin.joints.spatial_rolling import SpatialGear as SpatialGear
from refkin.joints.spatial_terms import Across, Crossed, Guide, Meet, Span, SpatialRows, Thread
from refkin.joints.spatial_turns import Angle, Turn

PARALLEL: Formed = {"half": Turn("12"), "dot": Across("fi gi", "hj"), "printed": Crossed()}
ON_AXIS: Formed = dict.fromkeys(("half", "dot"), Guide("fi gi")) | {"printed": Crossed(gap=True)}
UNTURNED: Formed = {"half": Turn("3"), "dot": Across("fi", "gj"), "printed": Across("fi", "gj")}


@dataclass(frozen=True, kw_only=True)
class Spherical(BetweenSpatialPoints):
    """A ball joint: two points coincide, d = 0."""

    type: Literal["spherical"] = "spherical"
    formulas = (Meet(),)
    consists_of = (PointsMeet,)


@dataclass(frozen=True, kw_only=True)
class SpatialRevolute(OfLines):
    """A hinge: two points coincide, and their axes have one direction.

    As printed: h_i x h_j = 0, h_i x s = 0 and s . s = c, s from one point of the axis to another, `spacing` [m] from
    point j (by default the unit of length). With a spacing of 0 the gradient 2 s vanishes: a singular formulation.
    """

    spacing: float | None = None
    type: Literal["revolute"] = "revolute"
    consists_of = (PointsMeet, AxesParallel)
    moves = ("angle",)

    @property
    def terms(self) -> tuple[SpatialRows, ...]:
        if self.form == "printed":
            return Crossed(), Crossed(gap=True, shifted=True), Span(shifted=True)
        return Meet(), PARALLEL[self.form]

    def scaled_spacing(self, unit: Unit) -> float:
        """Return the spacing in units of length, 1 by default."""
        return 1.0 if self.spacing is None else self.spacing / unit.size

    def faults(self, path: str) -> Iterator[Fault]:
        yield from super().faults(path)
        if self.spacing is not None and (self.form != "printed" or self.spacing < 0):
            yield Fault(f"{path}.spacing", self.spacing, "a distance of at least 0, and only in the form 'printed'")


@dataclass(frozen=True, kw_only=True)
class Cylindrical(OfLines):
    """Two axes are in line: body j turns about them and slides along them."""

    type: Literal["cylindrical"] = "cylindrical"
    formulas = (PARALLEL, ON_AXIS)
    consists_of = (AxesParallel, PointOnAxis)
    moves = ("angle", "displacement")


@dataclass(frozen=True, kw_only=True)
class CountedRevolute(Counted, SpatialRevolute):
    """A hinge of which a gear counts the turns."""


@dataclass(frozen=True, kw_only=True)
class CountedCylindrical(Counted, Cylindrical):
    """A cylindrical joint of which a gear counts the turns."""


SpatialRevolute.counted, Cylindrical.counted = CountedRevolute, CountedCylindrical


@dataclass(frozen=True, kw_only=True)
class SpatialPrismatic(OfLines):
    """A slide: a cylindrical joint that does not turn, its zeros in one direction."""

    needs_zeros = "a prismatic joint"
    type: Literal["prismatic"] = "prismatic"
    formulas = (PARALLEL, ON_AXIS, UNTURNED)
    angle = 0.0
    consists_of = (AxesParallel, PointOnAxis, TurnAboutAxis)
    moves = ("displacement",)


@dataclass(frozen=True, kw_only=True)
class SpatialFixed(OfLines):
    """Two bodies move as one: their points, axes and zeros are the same."""

    needs_zeros = "a fixed joint"
    type: Literal["fixed"] = "fixed"
    formulas = (Meet(), PARALLEL, UNTURNED)
    angle = 0.0
    consists_of = (PointsMeet, AxesParallel, TurnAboutAxis)


@dataclass(frozen=True, kw_only=True)
class Screw(OwnTurn, OfLines):
    """A cylindrical joint: h_i . d is `shift` [m] plus `pitch` [m/rad] times the angle from zero i to zero j.

    The angle counts turns, at first in the turn where estimates lie.
    """

    needs_zeros = "a screw joint"
    pitch: float
    shift: float = 0.0
    type: Literal["screw"] = "screw"
    formulas = (PARALLEL, ON_AXIS, Thread(), Angle(counted=True))
    consists_of = (AxesParallel, PointOnAxis, ScrewMotion)
    moves = ("angle", "displacement")

    def reach(self) -> float:
        return max(abs(self.pitch), abs(self.shift))

    def initial_contact(self, rows: Callable[[Any], Any]) -> Any:
        """Return theta / 2 where the row of the thread, which is linear in it, is 0."""
        before = self.terms[: list(map(type, self.terms)).index(Thread)]
        at_0, at_1 = rows(np.array([0.0, 1.0]))[sum(term.rows for term in before)]
        return at_0 / (at_0 - at_1)

    def faults(self, path: str) -> Iterator[Fault]:
        yield from super().faults(path)
        if self.pitch == 0.0:
            yield Fault(f"{path}.pitch", self.pitch, "a pitch other than 0 (a revolute joint does not shift)")


@dataclass(frozen=True, kw_only=True)
class Universal(OfAxes):
    """Hooke's joint: two points coincide, and the pin along axis i is perpendicular to that along axis j."""

    point_i: Triple
    point_j: Triple
    type: Literal["universal"] = "universal"
    formulas = (Meet(), Across("hi", "hj"))
    consists_of = (PointsMeet, AxesPerpendicular)


@dataclass(frozen=True, kw_only=True)
class Parallel(OfFrames):
    """Two axes have one direction."""

    type: Literal["parallel"] = "parallel"
    formulas = (PARALLEL,)
    consists_of = (AxesParallel,)


@dataclass(frozen=True, kw_only=True)
class Perpendicular(OfAxes):
    """Two axes are perpendicular: h_i . h_j = 0."""

    type: Literal["perpendicular"] = "perpendicular"
    formulas = (Across("hi", "hj"),)
    consists_of = (AxesPerpendicular,)


@dataclass(frozen=True, kw_only=True)
class OfAxisPoint(BetweenSpatialPoints):
    """What an axis of body i through a point of it says of a point of body j."""

    axis_i: Triple


@dataclass(frozen=True, kw_only=True)
class SpatialPointOnLine(OfAxisPoint):
    """A point of body j stays on the line along `axis_i`."""

    type: Literal["point_on_line"] = "point_on_line"
    formulas = (ON_AXIS,)
    consists_of = (PointOnAxis,)


@dataclass(frozen=True, kw_only=True)
class PointOnPlane(OfAxisPoint):
    """A point of body j stays in the plane across `axis_i`: h_i . d = 0."""

    type: Literal["point_on_plane"] = "point_on_plane"
    formulas = (Guide("hi"),)
    consists_of = (PointInPlane,)


@dataclass(frozen=True, kw_only=True)
class SpatialDistance(BetweenSpatialPoints):
    """Two points keep a distance, as the ends of a massless link do: (d . d - length^2) / (2 length) = 0."""

    length: float
    type: Literal["distance"] = "distance"
    formulas = (Span(),)
    consists_of = (SpatialPointDistance,)

    def reach(self) -> float:
        return self.length

    def faults(self, path: str) -> Iterator[Fault]:
        if not self.length > 0:
            yield Fault(f"{path}.length", self.length, "a length above 0 (a spherical joint keeps two points together)")


SPATIAL_JOINT_TYPES: tuple[type[Constraint], ...] = (
    Spherical,
    SpatialRevolute,
    SpatialPrismatic,
    Cylindrical,
    Universal,
    Screw,
    SpatialFixed,
    SpatialDistance,
    Parallel,
    Perpendicular,
    PointOnPlane,
    SpatialPointOnLine,
    SpatialGear,
)
