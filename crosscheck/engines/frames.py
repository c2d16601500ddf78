"""How an engine's constraint rows correspond to ours: order, factor, and a form where a factor is not enough.

Each adapter declares one `RowMap` per row beside its model. If an engine's row is y = factor * F(x) of our row x, then

    y_q = factor F'(x) x_q,    its drift term  gamma_y = factor (F'(x) gamma - F''(x) x'^2),    x' = phi_q qd + phi_t.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from refkin.joints import GuidedPoint, Pair

Form = Callable[[Any, int], Any]
"""A scalar function with two derivatives: x and an order -> the derivative of that order."""


@dataclass(frozen=True)
class Linear:
    """y = x."""

    def __call__(self, x: Any, order: int) -> Any:
        return (x, 1.0 + 0.0 * x, 0.0 * x)[order]


@dataclass(frozen=True)
class SineRow:
    """y = sin x: an engine that holds two axes parallel by a product of unit vectors.

    `rounding` is what such a product errs by, whatever x is: its two terms are of order 1, each rounded once or twice.
    """

    rounding: float = 2.0**-52

    def __call__(self, x: Any, order: int) -> Any:
        return (np.sin(x), np.cos(x), -np.sin(x))[order]


@dataclass(frozen=True)
class Length:
    """y = |d| - L where ours is x = (d . d - L^2) / (2 L): y = sqrt(L^2 + 2 L x) - L."""

    length: float

    def __call__(self, x: Any, order: int) -> Any:
        distance = np.sqrt(self.length * (self.length + 2.0 * x))
        return (distance - self.length, self.length / distance, -(self.length**2) / distance**3)[order]


@dataclass(frozen=True, kw_only=True)
class RowMap:
    """Row `row` of the joint or driver `constraint` is row `engine_row` of the engine, as factor * form.

    `either` says that the sign is that of Euler parameters, of which p and -p are one pose: it is the sign with which
    the residual is ours, at all levels.
    """

    constraint: str
    row: int
    engine_row: int
    factor: float = 1.0
    form: Form = Linear()
    either: bool = False


def direction(axis: Pair) -> Pair:
    """Return an axis scaled to length 1."""
    length = math.hypot(*axis)
    return axis[0] / length, axis[1] / length


def through_its_point(e: GuidedPoint) -> GuidedPoint:
    """Return a guided point with its line through point i: an `offset` moves point i to the left of the axis."""
    if not e.offset:
        return e
    x, y = direction(e.axis_i)
    return replace(e, point_i=(e.point_i[0] - y * e.offset, e.point_i[1] + x * e.offset), offset=0.0)


def wrap(angle: Any) -> Any:
    """Return the angle modulo 2 pi, nearest zero [rad]."""
    return np.arctan2(np.sin(angle), np.cos(angle))
