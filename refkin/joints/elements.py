"""What joints and drivers consist of: a few elements, plain numbers of the scene, for whoever does not solve formulas.

A joint says twice what it is: in formulas, which refkin solves, and in elements, from which everybody else builds. Its
rows are those of its elements, one element after another:

================ ===================================================== =============================================
element          row, in metres and rad                                of
================ ===================================================== =============================================
PointsCoincide   d = 0, or d = (f1, f2)(t) in the ground frame         revolute, fixed
GuidedPoint      n . d = offset                                        point_on_line, prismatic, flat face on a disc
PointCoordinate  r_j[axis] = f(t)                                      x and y driver
PointDistance    (d . d - L^2) / (2 L) = 0, or (d . d - f^2) / 2 = 0   distance and its driver, point on a disc
RelativeAngle    phi_j - phi_i = angle, or f(t)                        fixed, prismatic, angle driver
RollingWheels    sum of R (phi - phi_c - zero) = 0, of both wheels     gear
RollingOnLine    a . d - s0 - R (phi_j - phi_i - phi0) = 0             rack_and_pinion
Contact          those of `contact_kinematics`                          cam of general profile
================ ===================================================== =============================================

d = r_j - r_i leads from the point of body i to that of body j; a is the unit vector along `axis_i`, which turns with
body i, and n is a turned by a quarter turn counter-clockwise. The joints of space add elements of their own
(`spatial_elements`), no second scheme. Elements hold no formula: a reader states them anew.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from inspect import get_annotations
from typing import Any, ClassVar

from refkin.motion_laws import Law

GROUND = "ground"
"""The name of the fixed frame at the origin."""

BODIES = ("body_i", "body_j", "carrier")
"""The fields that name bodies, in the order in which formulas take them."""
Pair = tuple[float, float]
Triple = tuple[float, float, float]

OF_FRAMES = {"zero_i", "zero_j", "form"}
"""What an element takes only of a joint that has it: where no angle is counted there are no zeros, of one form none."""


@dataclass(frozen=True, kw_only=True)
class Element:
    """One thing that a joint or driver says of two bodies.

    Attributes
    ----------
    laws : tuple of Law
        The functions of time in it; without them it holds its bodies by constants alone.
    name : str
        The joint's or driver's.
    row : int
        Which row of the joint is the element's first.
    """

    kind: ClassVar[str]
    rows: ClassVar[int] = 1
    squared: ClassVar[bool] = False
    """Whether its row holds the square of its law, which turns back where the law is zero, too."""
    spins_about: ClassVar[tuple[str, ...]] = ()
    """The points and axes, by their fields, that a line of a body has to lie on and along for the rows not to change as
    the body spins about it; of body i those in _i, of body j those in _j. Without any, every spin changes a row."""
    laws: tuple[Law, ...] = ()
    name: str = ""
    row: int = 0

    @property
    def key(self) -> str:
        """What an engine's capability table calls it."""
        carrier = getattr(self, "carrier", GROUND)
        return self.kind + " by a law" * bool(self.laws) + " on a carrier" * (carrier != GROUND)

    @property
    def bodies(self) -> tuple[str, ...]:
        """The names of the bodies i and j, and of a carrier."""
        return tuple(getattr(self, key) for key in BODIES if hasattr(self, key))

    @property
    def ends(self) -> tuple[tuple[str, Any], ...]:
        """Body and point of each point that it is about: none, that of j, or those of i and j."""
        return ()

    @classmethod
    def expect_fields(cls, joint: type) -> None:
        """Raise TypeError if a class of joints has nothing called as a field of the element: a default is no answer.

        It is asked before it is a dataclass, so that its fields are among its annotations.
        """
        named = {key for part in joint.__mro__ for key in get_annotations(part)}
        for key in sorted(names_of(cls) - names_of(Element) - OF_FRAMES):
            if key not in named and not hasattr(joint, key):
                what = f"the joint has no field or property `{key}`, which its element {cls.__name__} takes"
                raise TypeError(f"{joint.__name__}: {what}")

    @classmethod
    def of(cls, joint: Any) -> Element:
        """Return the element of a joint, which takes what the joint has by the names of the element's fields."""
        keys = names_of(cls) - {"name", "row"}
        return cls(**{key: getattr(joint, key) for key in keys if hasattr(joint, key)})


@dataclass(frozen=True, kw_only=True)
class OfPoints(Element):
    """What is said of a point of body i and a point of body j, each in its frame [m], a `Pair` or a `Triple`."""

    body_i: str
    point_i: Any
    body_j: str
    point_j: Any

    @property
    def ends(self) -> tuple[tuple[str, Any], tuple[str, Any]]:
        return (self.body_i, self.point_i), (self.body_j, self.point_j)


@dataclass(frozen=True, kw_only=True)
class PointsCoincide(OfPoints):
    """Two points are one; or `laws` f1, f2 [m] give what leads from point i to point j in the ground frame."""

    kind = "points coincide"
    rows = 2


@dataclass(frozen=True, kw_only=True)
class GuidedPoint(OfPoints):
    """A point of body j stays on a line of body i: parallel to `axis_i`, `offset` [m] to the left of point i."""

    kind = "point on line"
    axis_i: Pair
    offset: float = 0.0


@dataclass(frozen=True, kw_only=True)
class PointDistance(OfPoints):
    """Two points keep a distance [m]: `length`, or that of the law."""

    kind = "distance"
    squared = True
    length: float = 0.0


@dataclass(frozen=True, kw_only=True)
class PointCoordinate(Element):
    """The coordinate `axis` (0: x, 1: y) of a point of body j in the ground frame follows the law [m]."""

    kind = "coordinate"
    body_j: str
    point_j: Pair
    axis: int
    body_i: ClassVar[str] = GROUND

    @property
    def ends(self) -> tuple[tuple[str, Pair]]:
        return ((self.body_j, self.point_j),)


@dataclass(frozen=True, kw_only=True)
class RelativeAngle(Element):
    """Body j is turned against body i by an angle [rad], turns included: `angle`, or that of the law."""

    kind = "angle"
    body_i: str
    body_j: str
    angle: float = 0.0


@dataclass(frozen=True, kw_only=True)
class RollingWheels(Element):
    """Two wheels roll on each other, centres at rest on a carrier, against which angles [rad] count; radii [m]."""

    kind = "rolling wheels"
    body_i: str
    radius_i: float
    zero_i: float
    body_j: str
    radius_j: float
    zero_j: float
    carrier: str = GROUND


@dataclass(frozen=True, kw_only=True)
class RollingOnLine(OfPoints):
    """A wheel on body j with its centre at point j rolls without slip along a line of body i: a rack and its pinion."""

    kind = "rolling on a line"
    axis_i: Pair
    radius: float
    phi0: float
    s0: float


@dataclass(frozen=True, kw_only=True)
class Contact(OfPoints):
    """Body j touches the profile d(s) [m] around point i, s [rad] from the x-axis of body i.

    With a face through point j of normal `normal_j`, with a roller of `roller_radius` [m] around it, else with the
    point itself.
    """

    kind = "contact"
    rows = 2
    profile: Any
    normal_j: Pair | None = None
    roller_radius: float | None = None


def names_of(cls: Any) -> set[str]:
    """Return the names of the fields of a dataclass."""
    return {field.name for field in fields(cls)}


def elements_of(constraints: Iterable[Any]) -> Iterator[Element]:
    """Yield the elements of joints and drivers in the order of their rows, each with its joint's name and its row."""
    for constraint in constraints:
        yield from constraint.placed_elements
