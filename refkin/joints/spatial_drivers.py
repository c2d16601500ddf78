"""The drivers of space: angle and displacement, which name the joint that they drive, and distance.

Which bodies, points and axes those are only the joint knows: `among` the joints of a mechanism a driver becomes one
that has them, and formulas. So a joint's numbers stand once in a scene.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from refkin.errors import Fault
from refkin.joints.base import Constraint
from refkin.joints.drivers import Driver
from refkin.joints.elements import GROUND, Triple, names_of
from refkin.joints.spatial import SPATIAL_JOINT_TYPES
from refkin.joints.spatial_base import BetweenSpatialPoints, SpatialConstraint
from refkin.joints.spatial_bodies import SPACE
from refkin.joints.spatial_elements import ShiftAlongAxis, SpatialPointDistance, TurnAboutAxis
from refkin.joints.spatial_terms import Guide, Sine, Span
from refkin.joints.spatial_turns import Angle, TurnCount


@dataclass(frozen=True, kw_only=True)
class DriverOfBodies(SpatialConstraint, Driver):  # type: ignore[override]
    """What a driver of a joint becomes, with the bodies of its joint."""

    joint: str
    body_i: str
    body_j: str
    type: str

    def points(self) -> Iterator[tuple[str, Any]]:
        yield from ()  # they are the joint's


@dataclass(frozen=True, kw_only=True)
class TurnDriver(DriverOfBodies):
    """The angle driver of a revolute or cylindrical joint; of a screw in the form `counted`, by its own coordinate."""

    axis_i: Triple
    axis_j: Triple
    zero_i: Triple | None
    zero_j: Triple | None
    form: str
    law_is_angle = True
    formulas = ({"half": Angle(), "dot": Sine(), "counted": TurnCount()},)
    consists_of = (TurnAboutAxis,)
    angle = 0.0  # the law's, as below the length

    @property
    def shares(self) -> tuple[str, ...]:
        return (self.joint,) if self.form == "counted" else ()

    def faults(self, path: str) -> Iterator[Fault]:
        yield from Driver.faults(self, path)
        for key in ("zero_i", "zero_j"):
            if getattr(self, key) is None:
                yield Fault(f"{path}.joint", self.joint, f"a joint with `{key}`, from which the angle is counted")


@dataclass(frozen=True, kw_only=True)
class ShiftDriver(DriverOfBodies):
    """The displacement driver of a cylindrical, prismatic or screw joint."""

    point_i: Triple
    axis_i: Triple
    point_j: Triple
    formulas = (Guide("hi", law=True),)
    consists_of = (ShiftAlongAxis,)


@dataclass(frozen=True, kw_only=True)
class JointDriver(Driver):
    """A driver of a joint that `moves` so; it `becomes` one of bodies, points and axes among the joints."""

    kind = SPACE
    joint: str
    becomes: ClassVar[type[DriverOfBodies]]

    @property
    def bodies(self) -> tuple[str, str]:
        return GROUND, ""

    def among(self, joints: Sequence[Constraint]) -> Constraint:
        """Return the driver with what the joint that it names has; itself if there is no such joint."""
        for joint in joints:
            if joint.name == self.joint and self.type in getattr(joint, "moves", ()):
                of_joint = vars(joint) | vars(self) | ({"form": "counted"} if joint.parameters else {})
                return self.becomes(**{key: of_joint[key] for key in names_of(self.becomes)})
        return self

    def faults(self, path: str) -> Iterator[Fault]:
        yield from super().faults(path)
        types: Any = SPATIAL_JOINT_TYPES
        able = " or ".join(joint.type for joint in types if self.type in joint.moves)
        yield Fault(f"{path}.joint", self.joint, f"a joint of the scene that is {able}")


@dataclass(frozen=True, kw_only=True)
class SpatialAngleDriver(JointDriver):
    """The angle of a joint, from zero i to zero j about its axis, right-handed, follows f(t) [rad].

    In the form `half` 2 sin((theta - f) / 2) = 0; `dot` is sin(theta - f) = 0, which half a turn solves as well. On a
    screw, whose turns are counted, theta - f = 0.
    """

    form: Literal["half", "dot"] = "half"
    type: Literal["angle"] = "angle"
    law_is_angle = True
    becomes = TurnDriver


@dataclass(frozen=True, kw_only=True)
class DisplacementDriver(JointDriver):
    """What leads from point i to point j of a joint has the length f(t) [m] along its axis: h_i . d - f = 0."""

    type: Literal["displacement"] = "displacement"
    becomes = ShiftDriver


@dataclass(frozen=True, kw_only=True)
class SpatialDistanceDriver(BetweenSpatialPoints, Driver):  # type: ignore[override]
    """The distance of two points follows |f(t)| [m], as a hydraulic cylinder does: (d . d - f^2) / 2 = 0."""

    type: Literal["distance"] = "distance"
    formulas = (Span(law=True),)
    consists_of = (SpatialPointDistance,)
    length = 0.0


SPATIAL_DRIVER_TYPES: tuple[type[Driver], ...] = (SpatialAngleDriver, DisplacementDriver, SpatialDistanceDriver)
