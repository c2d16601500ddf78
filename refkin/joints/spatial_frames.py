"""The frames of a joint of space, and what its terms take of them as constants.

On each of its bodies a joint has a frame: h along `axis`, f along the part of `zero` across it, and g = h x f, all of
length 1.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from refkin.joints.base import Unit
from refkin.joints.elements import Triple
from refkin.joints.spatial_vectors import Vec3
from refkin.vec import Scalar

CLEAR = 0.7
"""A number of at least this part of the largest will do to divide by; the first is taken, so rounding breaks no tie."""


def root(square: Scalar) -> Scalar:
    """Return the square root of a float, a row, or a number that brings its own."""
    if hasattr(square, "sqrt"):
        return square.sqrt()
    return np.sqrt(square) if isinstance(square, np.ndarray) else math.sqrt(square)


def about(x: Scalar) -> float:
    """Return a float near a number of any arithmetic; of a row the smallest."""
    mid: Any = getattr(x, "mid", x)  # of balls a method
    return float(x if callable(mid) else np.min(mid))


def unit_vector(v: Triple) -> Vec3:
    """Return a vector scaled to length 1."""
    x, y, z = v
    plain = all(isinstance(u, int | float) for u in v)
    length: Any = math.hypot(*v) if plain else root(x * x + y * y + z * z)
    return Vec3(x / length, y / length, z / length)


def frame(axis: Triple, zero: Triple | None) -> tuple[Vec3, Vec3, Vec3]:
    """Return (f, g, h); without a zero f lies across the axis somewhere, which no row but an angle's asks for."""
    h = unit_vector(axis)
    if zero is None:
        sizes = [abs(about(x)) for x in axis]
        k = next(k for k in range(3) if sizes[k] <= min(sizes) / CLEAR)
        zero = tuple(float(n == k) for n in range(3))  # type: ignore[assignment]
    z = Vec3(*zero)  # type: ignore[misc]
    f = unit_vector((z - h * h.dot(z)).parts)
    return f, h.cross(f), h


def parameters_of(f: Vec3, g: Vec3, h: Vec3) -> tuple[Scalar, ...]:
    """Return the Euler parameters c of a frame: 4 c c^T is the matrix below, of which the longest row is taken.

    Parameters
    ----------
    f, g, h : Vec3
        The frame's axes: unit vectors, each at a right angle to the others.
    """
    (a, d, k), (b, e, m), (c, n, i) = f.parts, g.parts, h.parts
    rows = (
        (1 + a + e + i, m - n, c - k, d - b),
        (m - n, 1 + a - e - i, d + b, c + k),
        (c - k, d + b, 1 - a + e - i, m + n),
        (d - b, c + k, m + n, 1 - a - e + i),
    )
    sizes = [about(row[k]) for k, row in enumerate(rows)]
    place = next(k for k in range(4) if sizes[k] >= CLEAR * max(sizes))
    length = 2 * root(rows[place][place])
    return tuple(x / length for x in rows[place])


def across(axis: Triple, zero: Triple) -> bool:
    """Return whether a zero has a part across its axis that is more than rounding; numbers that are not finite pass."""
    sizes = [max(map(abs, v)) for v in (axis, zero)]
    if not all(map(math.isfinite, sizes)) or 0.0 in sizes:
        return 0.0 not in sizes
    a, b = (Vec3(*(x / size for x in v)) for v, size in zip((axis, zero), sizes, strict=True))
    return bool(max(map(abs, a.cross(b).parts)) > 2.0**-40)


def axes(c: Any, names: str) -> tuple[Scalar, ...]:
    """Return the vectors of a joint's frames with names such as "fi hj": the frame's letter and the body's."""
    numbers: list[Scalar] = []
    for name in names.split():
        letter, body = name[0], name[1]
        vectors = frame(getattr(c, f"axis_{body}"), getattr(c, f"zero_{body}", None))
        numbers += vectors["fgh".index(letter)].parts
    return tuple(numbers)


def turns(c: Any) -> tuple[Scalar, ...]:
    """Return the Euler parameters of a joint's two frames."""
    return (*parameters_of(*frame(c.axis_i, c.zero_i)), *parameters_of(*frame(c.axis_j, c.zero_j)))


def points(c: Any, unit: Unit, shift: Scalar | None = None) -> tuple[Scalar, ...]:
    """Return a joint's two points, scaled; or, for the second, one that far from it along the axis there.

    Parameters
    ----------
    c : SpatialJoint
        Its points are given in the bodies' frames [m].
    unit : Unit
        What lengths are divided by.
    shift : float, optional
        How far the second point is from where it is given, scaled.
    """
    at_i, at_j = unit.point(c.body_i, c.point_i), unit.point(c.body_j, c.point_j)
    if shift is not None:
        at_j = tuple(x + shift * y for x, y in zip(at_j, axes(c, "hj"), strict=True))
    return (*at_i, *at_j)
