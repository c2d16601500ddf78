"""What spatial joints consist of, as `elements` has it for the plane: the scene's own numbers, no formula.

===================== ============================================ ===================================================
element               it says                                      of
===================== ============================================ ===================================================
PointsMeet            d = 0                                        spherical, revolute, universal, fixed
AxesParallel          axis i and axis j have one direction         all but spherical, universal, distance
AxesPerpendicular     axis i and axis j are perpendicular          universal, perpendicular
PointOnAxis           point j is on axis i, which point i is on    cylindrical, prismatic, screw, point_on_line
PointInPlane          point j is in the plane across axis i        point_on_plane
TurnAboutAxis         zero j is turned against zero i, about the   prismatic, fixed: by 0; angle driver: by a law
                      axis, right-handed
ShiftAlongAxis        d along axis i is that of a law              displacement driver
ScrewMotion           d along axis i is shift + pitch times the    screw
                      angle of `TurnAboutAxis`, turns counted
SpatialPointDistance  d has a length                               distance and its driver
GearedTurns           the angles of two joints are in proportion   gear
===================== ============================================ ===================================================

d leads from the point of body i to that of body j. Axes are directed and have any length but 0; of a zero, where there
is one, the part across its axis counts. The rows of a joint in the forms `half` and `dot` are those of its elements,
one after another; in the form `printed` it has more rows.
"""

from __future__ import annotations

from dataclasses import dataclass

from refkin.joints.elements import Element, OfPoints, Triple


@dataclass(frozen=True, kw_only=True)
class _OfAxes(Element):
    """What is said of an axis of body i and one of body j, with the zeros that turns about them are counted from."""

    body_i: str
    axis_i: Triple
    body_j: str
    axis_j: Triple
    zero_i: Triple | None = None
    zero_j: Triple | None = None
    form: str = "half"


@dataclass(frozen=True, kw_only=True)
class PointsMeet(OfPoints):
    """Two points are one."""

    kind = "points of space coincide"
    rows = 3
    spins_about = ("point_i", "point_j")


@dataclass(frozen=True, kw_only=True)
class AxesParallel(_OfAxes):
    """Two axes have one direction, not opposite ones."""

    kind = "axes parallel"
    rows = 2
    spins_about = ("axis_i", "axis_j")


@dataclass(frozen=True, kw_only=True)
class AxesPerpendicular(_OfAxes):
    """Two axes are perpendicular."""

    kind = "axes perpendicular"
    spins_about = ("axis_i", "axis_j")


@dataclass(frozen=True, kw_only=True)
class PointOnAxis(OfPoints):
    """A point of body j stays on the axis of body i through its point."""

    kind = "point on axis"
    rows = 2
    spins_about = ("point_i", "axis_i", "point_j")
    axis_i: Triple
    zero_i: Triple | None = None
    form: str = "half"


@dataclass(frozen=True, kw_only=True)
class PointInPlane(OfPoints):
    """A point of body j stays in the plane of body i through its point and across its axis."""

    kind = "point in plane"
    spins_about = ("axis_i", "point_j")
    axis_i: Triple


@dataclass(frozen=True, kw_only=True)
class TurnAboutAxis(_OfAxes):
    """Body j is turned about the axis against body i by an angle [rad]: `angle`, or that of the law.

    Of axes that nothing keeps parallel it is the twist, 2 atan2(e3, e0), (e0, e) the Euler parameters that lead from
    frame to frame: with points that meet, a constant-velocity joint. In the form `dot` it is another: f_i . g_j = 0.
    """

    kind = "turn about axis"
    angle: float = 0.0


@dataclass(frozen=True, kw_only=True)
class ShiftAlongAxis(OfPoints):
    """Point j is a law's value [m] further along axis i than point i."""

    kind = "shift along axis"
    spins_about = ("axis_i", "point_j")
    axis_i: Triple


@dataclass(frozen=True, kw_only=True)
class ScrewMotion(OfPoints):
    """Point j is `shift` [m] plus `pitch` [m/rad] times the turn about the axis further along axis i than point i.

    The turn is that of `TurnAboutAxis`, also where nothing keeps the axes parallel; its turns are counted.
    """

    kind = "screw"
    rows = 2
    axis_i: Triple
    zero_i: Triple
    axis_j: Triple
    zero_j: Triple
    pitch: float
    shift: float = 0.0


@dataclass(frozen=True, kw_only=True)
class SpatialPointDistance(OfPoints):
    """Two points of space keep a distance [m]: `length`, or that of the law."""

    kind = "distance of space"
    squared = True
    spins_about = ("point_i", "point_j")
    length: float = 0.0


@dataclass(frozen=True, kw_only=True)
class GearedTurns(Element):
    """The sum of R (theta - phi0) of two joints is 0, theta the angle of a joint, turns counted; radii [m].

    Bodies i and j are the wheels, each tied to the carrier by its joint, whose numbers stand there.
    """

    kind = "turns in gear"
    body_i: str
    joint_i: str
    radius_i: float
    phi0_i: float
    body_j: str
    joint_j: str
    radius_j: float
    phi0_j: float
    carrier: str

    @property
    def key(self) -> str:
        return self.kind
