"""The drivers of space: angle and displacement, which name the joint that they drive, and distance.

Which bodies, points and axes those are only the joint knows: `among` the joints of a mechanism a driver becomes one
that has them, and formulas. So a joint's numbers stand once in a scene.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from refkin.errors import Fault
from refkin.joints.base import Blocks, Constraint, Rows, Unit
from refkin.joints.drivers import Driver
from refkin.joints.elements import GROUND, Triple
from refkin.joints.spatial import SpatialConstraint, names_of
from refkin.joints.spatial_bodies import SPACE
from refkin.joints.spatial_elements import ShiftAlongAxis, SpatialPointDistance, TurnAboutAxis
from refkin.joints.spatial_terms import Angle, Guide, Sine, Span


@dataclass(frozen=True, kw_only=True)
class JointDriver(Driver):
    """A driver of the joint of a name."""

    kind = SPACE
    joint: str
    drives: ClassVar[tuple[str, ...]]

    @property
    def bodies(self) -> tuple[str, str]:
        return GROUND, ""

    def among(self, joints: Sequence[Constraint]) -> Constraint:
        """Return the driver with what the joint that it names has; itself if there is no such joint."""
        for joint in joints:
            if joint.name == self.joint and joint.type in self.drives and joint.kind is SPACE:
                return self._of(joint)
        return self

    def _of(self, joint: Any) -> Constraint:
        raise NotImplementedError

    def _own(self, joint: Any, cls: type[Constraint]) -> dict[str, Any]:
        """Return the fields of a class that the joint, or this driver, has."""
        kept = {key: getattr(joint, key) for key in names_of(cls) if hasattr(joint, key)}
        mine = {key: getattr(self, key) for key in ("name", "law", "rate_law", "initial", "form") if hasattr(self, key)}
        return {**kept, **mine, "type": self.type, "joint": self.joint}

    def faults(self, path: str) -> Iterator[Fault]:
        yield from super().faults(path)
        if type(self).bodies is JointDriver.bodies:
            yield Fault(f"{path}.joint", self.joint, f"a joint of the scene that is {' or '.join(self.drives)}")


@dataclass(frozen=True, kw_only=True)
class SpatialAngleDriver(JointDriver):
    """The angle of a joint, from zero i to zero j about its axis, right-handed, follows f(t) [rad].

    In the form `half` 2 sin((theta - f) / 2) = 0; `dot` is sin(theta - f) = 0, which half a turn solves as well. On a
    screw, whose turns are counted, theta - f = 0.
    """

    form: Literal["half", "dot"] = "half"
    type: Literal["angle"] = "angle"
    drives = ("revolute", "cylindrical", "screw")

    def _of(self, joint: Any) -> Constraint:
        cls = CountedAngle if joint.parameters else TurnDriver
        return cls(**self._own(joint, cls))


@dataclass(frozen=True, kw_only=True)
class DisplacementDriver(JointDriver):
    """What leads from point i to point j of a joint has the length f(t) [m] along its axis: h_i . d - f = 0."""

    type: Literal["displacement"] = "displacement"
    drives = ("cylindrical", "prismatic", "screw")

    def _of(self, joint: Any) -> Constraint:
        return ShiftDriver(**self._own(joint, ShiftDriver))


@dataclass(frozen=True, kw_only=True)
class _Bound(SpatialConstraint, Driver):  # type: ignore[override]
    """A driver with the bodies of its joint."""

    joint: str
    body_i: str
    body_j: str
    type: str

    @property
    def bodies(self) -> tuple[str, str]:
        return self.body_i, self.body_j

    def points(self) -> Iterator[tuple[str, Any]]:
        yield from ()  # they are the joint's


@dataclass(frozen=True, kw_only=True)
class TurnDriver(_Bound):
    """The angle driver of a revolute or cylindrical joint."""

    axis_i: Triple
    axis_j: Triple
    zero_i: Triple | None
    zero_j: Triple | None
    form: str
    formulas = ({"half": Angle(), "dot": Sine()},)
    consists_of = (TurnAboutAxis,)

    def faults(self, path: str) -> Iterator[Fault]:
        yield from Driver.faults(self, path)
        for key in ("zero_i", "zero_j"):
            if getattr(self, key) is None:
                yield Fault(f"{path}.joint", self.joint, f"a joint with `{key}`, from which the angle is counted")


@dataclass(frozen=True, kw_only=True)
class CountedAngle(TurnDriver):
    """The angle driver of a screw: theta - f = 0, theta / 2 the screw's own coordinate."""

    rows = 1

    @property
    def shares(self) -> str:
        return self.joint

    def constants(self, unit: Unit) -> tuple[float, ...]:
        return ()

    def residual(self, g: Any, f: Any, *at: Any) -> Rows:  # type: ignore[override]
        return (2 * at[2].value - f[0][0],)

    def jacobian(self, g: Any, f: Any, *at: Any) -> Blocks:  # type: ignore[override]
        return ((0,) * 7,), ((0,) * 7,), ((2,),)

    def nu(self, g: Any, f: Any, *at: Any) -> Rows:
        return (f[0][1],)

    def gamma(self, g: Any, f: Any, *at: Any) -> Rows:  # type: ignore[override]
        return (f[0][2],)


@dataclass(frozen=True, kw_only=True)
class ShiftDriver(_Bound):
    """The displacement driver of a cylindrical, prismatic or screw joint."""

    point_i: Triple
    axis_i: Triple
    point_j: Triple
    formulas = (Guide("hi", law=True),)
    consists_of = (ShiftAlongAxis,)

    def law_scale(self, unit: Unit) -> tuple[tuple[float, ...], float]:
        return (0.0,), unit.size


@dataclass(frozen=True, kw_only=True)
class SpatialDistanceDriver(SpatialConstraint, Driver):  # type: ignore[override]
    """The distance of two points follows f(t) [m], as a hydraulic cylinder does: (d . d - f^2) / 2 = 0."""

    body_i: str
    point_i: Triple
    body_j: str
    point_j: Triple
    type: Literal["distance"] = "distance"
    formulas = (Span(law=True),)
    consists_of = (SpatialPointDistance,)

    def law_scale(self, unit: Unit) -> tuple[tuple[float, ...], float]:
        return (0.0,), unit.size


SPATIAL_DRIVER_TYPES: tuple[type[Driver], ...] = (SpatialAngleDriver, DisplacementDriver, SpatialDistanceDriver)
