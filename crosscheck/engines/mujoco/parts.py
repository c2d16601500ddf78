"""What a MuJoCo model is read by: where each row of an element is, and where its law goes."""

from __future__ import annotations

from dataclasses import dataclass

from crosscheck.engines.frames import Form, Linear
from refkin.joints import Element, PointDistance

LINEAR = Linear()


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where MuJoCo holds row `row` of an element: in a row of the equalities, or with a guide, or as a constant.

    Attributes
    ----------
    equality, guide : int or None
        Row among those of all equalities; index of the guide. If both are None the row is `constant`.
    unit : int
        The power of the length in the row's unit: 0 for an angle, 1 for a length.
    form : Form
        What the row is of ours, both in metres and radians (`crosscheck.engines.frames`).
    """

    element: Element
    row: int = 0
    equality: int | None = None
    guide: int | None = None
    constant: float = 0.0
    unit: int = 1
    form: Form = LINEAR


@dataclass(frozen=True)
class Guide:
    """A line along the x axis of site `line` on a body, the site `point`, and the first row of a `connect` of both."""

    body: str
    line: str
    point: str
    connect: int


@dataclass(frozen=True)
class Driven:
    """Where the value of an element's law goes: `eq_data` of an equality, or coordinate `axis` of a ground site.

    `source` is the index of the element's row; (law - shift) / size is the law in the model's unit.
    """

    element: Element
    source: int
    equality: int
    site: str = ""
    axis: int = 0
    shift: float = 0.0
    size: float = 1.0

    def value(self, t: float, order: int) -> float:
        """Return the law's value or derivative in the model's unit."""
        law = float(self.element.laws[0](t, order))
        return (law - (0.0 if order else self.shift)) / self.size

    @property
    def squared(self) -> bool:
        """Whether the row is one of (d . d - f^2) / 2, which MuJoCo has as |d| - f."""
        return isinstance(self.element, PointDistance)
