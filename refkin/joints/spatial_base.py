"""What the joints and drivers of space are made of: bodies, points, axes and zeros, forms, turns that are counted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Any, ClassVar, Literal

import numpy as np

from refkin.errors import Fault
from refkin.joints.base import Blocks, Constraint, Rows, Unit
from refkin.joints.elements import Element, Triple, names_of
from refkin.joints.spatial_bodies import SPACE
from refkin.joints.spatial_frames import across
from refkin.joints.spatial_terms import SpatialRows, blocks_of
from refkin.joints.spatial_turns import Angle
from refkin.vec import Scalar

Form = Literal["half", "dot", "printed"]
Formed = dict[str, SpatialRows]
"""Terms that say the same by other rows in each form."""


@dataclass(frozen=True, kw_only=True)
class SpatialConstraint(Constraint):
    """A constraint between bodies of space, which says twice what it is: by its formulas, and by its elements.

    Its rows are those of `formulas`, one after another, in its own form. An element of `consists_of` takes what the
    constraint has by the names of the element's fields. What a driver may move is in `moves`: "angle", "displacement".
    """

    kind = SPACE
    formulas: ClassVar[tuple[SpatialRows | Formed, ...]] = ()
    consists_of: ClassVar[tuple[type[Element], ...]] = ()
    moves: ClassVar[tuple[str, ...]] = ()
    counted: ClassVar[Any] = None
    """What it becomes where a gear counts its turns."""

    def __init_subclass__(cls) -> None:
        for element in cls.consists_of:
            element.expect_fields(cls)

    @property
    def terms(self) -> tuple[SpatialRows, ...]:
        """What the rows consist of, in the constraint's form."""
        form = getattr(self, "form", "half")
        return tuple(term[form] if isinstance(term, dict) else term for term in self.formulas)

    @property
    def rows(self) -> int:
        return sum(term.rows for term, _ in self._placed)

    @property
    def independent(self) -> int:
        return sum(e.rows for e in self.placed_elements) or self.rows

    @cached_property
    def _placed(self) -> list[tuple[SpatialRows, slice]]:
        """The terms, and where each one's numbers stand in the geometry."""
        ends = accumulate((term.size for term in self.terms), initial=0)
        return [(term, slice(*own)) for term, own in zip(self.terms, pairwise(ends), strict=True)]

    def among(self, joints: Sequence[Constraint]) -> Constraint:
        """Return the joint, its turns counted if a gear among the joints names it."""
        if self.counted is None or not any(self.name in joint.shares for joint in joints):
            return self
        counted: Constraint = self.counted(**{key: getattr(self, key) for key in names_of(self)})
        return counted

    def constants(self, unit: Unit) -> tuple[float, ...]:
        return tuple(number for term in self.terms for number in term.constants(self, unit))

    def elements(self) -> Iterator[Element]:
        yield from (element.of(self) for element in self.consists_of)

    def residual(self, g: Any, f: Any, *at: Any) -> Rows:  # type: ignore[override]
        return tuple(row for term, own in self._placed for row in term.residual(g[own], f, *at))

    def jacobian(self, g: Any, f: Any, *at: Any) -> Blocks:  # type: ignore[override]
        return blocks_of([row for term, own in self._placed for row in term.jacobian(g[own], f, *at)])

    def nu(self, g: Any, f: Any, *at: Any) -> Rows:
        return tuple(row for term, own in self._placed for row in term.nu(g[own], f, *at))

    def gamma(self, g: Any, f: Any, *at: Any) -> Rows:  # type: ignore[override]
        return tuple(row for term, own in self._placed for row in term.gamma(g[own], f, *at))

    def faults(self, path: str) -> Iterator[Fault]:
        """Yield the axes that are zero, and the zeros that are zero or along their axis."""
        yield from super().faults(path)
        for body in "ij":
            axis, zero = (getattr(self, f"{key}_{body}", None) for key in ("axis", "zero"))
            if axis is not None and not any(axis):
                yield Fault(f"{path}.axis_{body}", list(axis), "a vector that is not zero")
            elif axis is not None and zero is not None and not across(axis, zero):
                yield Fault(f"{path}.zero_{body}", list(zero), "a vector that is not zero and not along the axis")


class OwnTurn:
    """What a joint has that counts turns: half its angle theta is a coordinate of its own."""

    @property
    def parameters(self) -> int:
        return 1

    def profile_values(self, s: Scalar, unit: Unit, order: int) -> tuple[Scalar, ...]:
        return ()


class Counted(OwnTurn):
    """What a joint has that does so because a gear names it: one row more, that of its angle."""

    needs_zeros = "a gear that counts its turns"

    @property
    def terms(self) -> tuple[SpatialRows, ...]:
        return (*super().terms, Angle(counted=True))  # type: ignore[misc]

    @property
    def independent(self) -> int:
        return super().independent + 1  # type: ignore[misc, no-any-return]

    def initial_contact(self, rows: Callable[[Any], Any]) -> Any:
        """Return theta / 2 where the row of the angle is 0, in the turn about 0: an estimate says nothing of turns."""
        sine, cosine = rows(np.array([0.0, -0.5 * np.pi]))[-1]
        half = np.arctan2(sine, cosine)
        return half - np.pi * np.round(half / np.pi)


@dataclass(frozen=True, kw_only=True)
class BetweenSpatialPoints(SpatialConstraint):
    """What is said of a point of body i and a point of body j, each in the frame of its body [m]."""

    body_i: str
    point_i: Triple
    body_j: str
    point_j: Triple


@dataclass(frozen=True, kw_only=True)
class OfAxes(SpatialConstraint):
    """What is said of an axis of body i and one of body j, both directed [any length]."""

    body_i: str
    axis_i: Triple
    body_j: str
    axis_j: Triple


@dataclass(frozen=True, kw_only=True)
class OfFrames(OfAxes):
    """Axes with a direction across each, `zero`, of which the part across the axis counts; and the form of the rows."""

    zero_i: Triple | None = None
    zero_j: Triple | None = None
    form: Form = "half"
    needs_zeros: ClassVar[str] = ""
    """Who needs the zeros, in words; nobody by default."""

    def faults(self, path: str) -> Iterator[Fault]:
        yield from super().faults(path)
        for key in ("zero_i", "zero_j"):
            if self.needs_zeros and getattr(self, key) is None:
                yield Fault(f"{path}.{key}", None, f"`{key}`, a vector across the axis: {self.needs_zeros} needs it")


@dataclass(frozen=True, kw_only=True)
class OfLines(OfFrames):
    """Axes through points."""

    point_i: Triple
    point_j: Triple


def looked_up(m: Any) -> tuple[Constraint, ...]:
    """Return joints, then drivers, of which those that name a joint have it looked up; drivers find joints so, too."""
    joints = tuple(joint.among(m.joints) for joint in m.joints)
    return (*joints, *(driver.among(joints) for driver in m.drivers))
