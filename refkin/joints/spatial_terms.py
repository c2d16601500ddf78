"""The terms that spatial joints are made of: gaps, vectors across each other, lengths (half angles: `spatial_turns`).

f, g and h are the vectors of a joint's frame on a body (`spatial_frames`), d leads from the point of body i to that of
body j:

========== ================================= =========================================================================
term       rows                              gamma, with ' at constant rates and ^ for a vector's drift
========== ================================= =========================================================================
`Meet`     d                                 -d^
`Across`   a . b, a on body i, b on body j   -(a^ . b + 2 a' . b' + a . b^)
`Guide`    n . d, n on body i                -(n^ . d + 2 n' . d' + n . d^)
`Crossed`  a x b;  h x d                     as for the dot products of its components
`Sine`     sin(theta - f)                    as for `Across`; theta the angle of a turn about h
`Thread`   h . d - 2 p s - shift             as for `Guide`; p the pitch, s half the angle, a coordinate
`Span`     (d . d - L^2) / 2, over L         -(d' . d' + d . d^), over L
========== ================================= =========================================================================
"""

from __future__ import annotations

from typing import Any

from refkin.joints.base import Blocks, Rows, Unit
from refkin.joints.spatial_frames import axes, points
from refkin.joints.spatial_vectors import Arm, SpatialValues, Vec3
from refkin.vec import Scalar, cosine_and_sine

AXES = (Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1))
AT_REST = (0, 0, 0)


class Separation:
    """What leads from one point to another, and how it moves."""

    def __init__(self, g: Any, i: SpatialValues, j: SpatialValues) -> None:
        self.i, self.j, self.from_, self.to = i, j, i.arm(*g[:3]), j.arm(*g[3:6])
        self.d = j.r + self.to.at - i.r - self.from_.at

    def slopes(self, n: Vec3) -> tuple[tuple[Scalar, ...], tuple[Scalar, ...]]:
        """Return the gradient of n . d with n held fixed, for body i and for body j."""
        i, j = (-n), n
        return (*i.parts, *self.from_.slope(i)), (*j.parts, *self.to.slope(j))

    @property
    def rate(self) -> Vec3:
        return self.j.v + self.to.rate - self.i.v - self.from_.rate

    @property
    def drift(self) -> Vec3:
        return self.to.drift - self.from_.drift


Row = tuple[tuple[Scalar, ...], ...]
"""One row of a Jacobian: a block for each body, and one for a coordinate of the joint's own."""


class SpatialRows:
    """Some rows of a constraint; `size` numbers of its geometry are theirs."""

    rows = 1
    size = 0

    def constants(self, c: Any, unit: Unit) -> tuple[Scalar, ...]:
        """Return these numbers of a constraint."""
        return ()

    residual: Any
    jacobian: Any
    gamma: Any

    def nu(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        return (0,) * self.rows


class Meet(SpatialRows):
    """The points coincide."""

    rows, size = 3, 6

    def constants(self, c: Any, unit: Unit) -> tuple[Scalar, ...]:
        return points(c, unit)

    def residual(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        d: Vec3 = Separation(g, i, j).d
        return d.parts

    def jacobian(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> list[Row]:
        of_i, of_j = i.arm(*g[:3]).slopes(), j.arm(*g[3:6]).slopes()
        return [((*(-n).parts, *(-x for x in a)), (*n.parts, *b)) for n, a, b in zip(AXES, of_i, of_j, strict=True)]

    def gamma(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        drift: Vec3 = i.drift(Vec3(*g[:3])) - j.drift(Vec3(*g[3:6]))
        return drift.parts


class Across(SpatialRows):
    """Vectors of body i are perpendicular to one of body j: names such as "fi gi" and "hj"."""

    def __init__(self, on_i: str, on_j: str) -> None:
        self.names, self.rows = f"{on_i} {on_j}", len(on_i.split())
        self.size = 3 * self.rows + 3

    def constants(self, c: Any, unit: Unit) -> tuple[Scalar, ...]:
        return axes(c, self.names)

    def _arms(self, g: Any, i: Any, j: Any) -> tuple[list[Arm], Arm]:
        return [i.arm(*g[3 * k : 3 * k + 3]) for k in range(self.rows)], j.arm(*g[3 * self.rows :])

    def residual(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        ours, b = self._arms(g, i, j)
        return tuple(a.at.dot(b.at) for a in ours)

    def jacobian(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> list[Row]:
        ours, b = self._arms(g, i, j)
        return [((*AT_REST, *a.slope(b.at)), (*AT_REST, *b.slope(a.at))) for a in ours]

    def gamma(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        ours, b = self._arms(g, i, j)
        return tuple(-_second(a, b.at, b.rate, b.drift) for a in ours)


def _second(a: Arm, b: Vec3, rate: Vec3, drift: Vec3) -> Scalar:
    """Return the part of (a . b)'' that holds no acceleration."""
    return a.drift.dot(b) + 2 * a.rate.dot(rate) + a.at.dot(drift)


class Guide(SpatialRows):
    """The other point stays in planes through this one: their normals are vectors of body i, "fi gi" or "hi".

    With a law it moves out of the plane by it.
    """

    def __init__(self, normals: str, law: bool = False) -> None:
        self.normals, self.rows, self.law = normals, len(normals.split()), law
        self.size = 6 + 3 * self.rows

    def constants(self, c: Any, unit: Unit) -> tuple[Scalar, ...]:
        return (*points(c, unit), *axes(c, self.normals))

    def _arms(self, g: Any, i: Any) -> list[Arm]:
        return [i.arm(*g[k : k + 3]) for k in range(6, self.size, 3)]

    def residual(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        d = Separation(g, i, j).d
        heights = tuple(n.at.dot(d) for n in self._arms(g, i))
        return (heights[0] - f[0][0],) if self.law else heights

    def jacobian(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> list[Row]:
        gap = Separation(g, i, j)
        return [_guided(n, n.at, gap) for n in self._arms(g, i)]

    def nu(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        return (f[0][1],) if self.law else (0,) * self.rows

    def gamma(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        gap = Separation(g, i, j)
        rows = tuple(-_second(n, gap.d, gap.rate, gap.drift) for n in self._arms(g, i))
        return (rows[0] + f[0][2],) if self.law else rows


def _guided(n: Arm, direction: Vec3, gap: Separation, towards: Vec3 | None = None) -> Row:
    """Return the gradient of a product of a vector of body i and d: by d along `direction`, by the vector `towards`."""
    block_i, block_j = gap.slopes(direction)
    by_n = n.slope(gap.d if towards is None else towards)
    return (*block_i[:3], *(x + y for x, y in zip(block_i[3:], by_n, strict=True))), block_j


class Crossed(SpatialRows):
    """h_i x h_j = 0, or h_i x d = 0: three rows of which two are independent.

    `shifted`, d leads to a point at the joint's `spacing` from point j, along the axis there.
    """

    rows = 3

    def __init__(self, gap: bool = False, shifted: bool = False) -> None:
        self.gap, self.shifted, self.size = gap, shifted, 9 if gap else 6

    def constants(self, c: Any, unit: Unit) -> tuple[Scalar, ...]:
        if not self.gap:
            return axes(c, "hi hj")
        return (*points(c, unit, c.scaled_spacing(unit) if self.shifted else None), *axes(c, "hi"))

    def residual(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        other = Separation(g, i, j).d if self.gap else j.arm(*g[3:]).at
        crossed: Vec3 = i.arm(*g[-3:] if self.gap else g[:3]).at.cross(other)
        return crossed.parts

    def jacobian(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> list[Row]:
        if self.gap:
            gap, h = Separation(g, i, j), i.arm(*g[6:])
            return [_guided(h, e.cross(h.at), gap, gap.d.cross(e)) for e in AXES]
        a, b = i.arm(*g[:3]), j.arm(*g[3:])
        return [((*AT_REST, *a.slope(b.at.cross(e))), (*AT_REST, *b.slope(e.cross(a.at)))) for e in AXES]

    def gamma(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        other = Separation(g, i, j) if self.gap else j.arm(*g[3:])
        h, at = i.arm(*g[-3:] if self.gap else g[:3]), other.d if isinstance(other, Separation) else other.at
        bias: Vec3 = h.drift.cross(at) + h.rate.cross(other.rate) * 2 + h.at.cross(other.drift)
        return (-bias).parts


class Sine(SpatialRows):
    """sin(theta - f) of a law f: g_i . f_j cos f - f_i . f_j sin f."""

    size = 9

    def constants(self, c: Any, unit: Unit) -> tuple[Scalar, ...]:
        return axes(c, "fi gi fj")

    def _arms(self, g: Any, i: Any, j: Any) -> tuple[Arm, Arm, Arm]:
        return i.arm(*g[:3]), i.arm(*g[3:6]), j.arm(*g[6:])

    def residual(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        (along, left, b), (c, s) = self._arms(g, i, j), cosine_and_sine(f[0][0])
        return (left.at.dot(b.at) * c - along.at.dot(b.at) * s,)

    def jacobian(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> list[Row]:
        (along, left, b), (c, s) = self._arms(g, i, j), cosine_and_sine(f[0][0])
        of_i = (x * c - y * s for x, y in zip(left.slope(b.at), along.slope(b.at), strict=True))
        return [((*AT_REST, *of_i), (*AT_REST, *b.slope(left.at * c - along.at * s)))]

    def nu(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        (along, left, b), (c, s) = self._arms(g, i, j), cosine_and_sine(f[0][0])
        return ((left.at.dot(b.at) * s + along.at.dot(b.at) * c) * f[0][1],)

    def gamma(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        """Return it with x = f_i . f_j = cos(theta), y = g_i . f_j = sin(theta) and their rates and drifts."""
        (along, left, b), (c, s) = self._arms(g, i, j), cosine_and_sine(f[0][0])
        values = [(a.at.dot(b.at), a.rate.dot(b.at) + a.at.dot(b.rate)) for a in (along, left)]
        (x, x_rate), (y, y_rate) = values
        bias = _second(left, b.at, b.rate, b.drift) * c - _second(along, b.at, b.rate, b.drift) * s
        turning = 2 * (y_rate * s + x_rate * c) * f[0][1] + (y * c - x * s) * (f[0][1] * f[0][1])
        return (turning + (y * s + x * c) * f[0][2] - bias,)


class Thread(SpatialRows):
    """h_i . d - 2 pitch s - shift = 0, s half the angle."""

    size = 11
    guide = Guide("hi")

    def constants(self, c: Any, unit: Unit) -> tuple[Scalar, ...]:
        return (*self.guide.constants(c, unit), c.pitch / unit.size, c.shift / unit.size)

    def residual(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        (height,) = self.guide.residual(g[:9], f, i, j)
        return (height - own[0].value * (2 * g[9]) - g[10],)

    def jacobian(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> list[Row]:
        return [(*self.guide.jacobian(g[:9], f, i, j)[0], (-2 * g[9],))]

    def gamma(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        return self.guide.gamma(g[:9], f, i, j)


class Span(SpatialRows):
    """The points keep a distance L: (d . d - L^2) / (2 L), L the joint's; or (d . d - L^2) / 2 with L a law's.

    `shifted`, (d . d - L^2) / 2 with L the joint's `spacing`, and d to the point that far from point j along the axis.
    """

    def __init__(self, law: bool = False, shifted: bool = False) -> None:
        self.law, self.shifted, self.size = law, shifted, 6 if law else 8

    def constants(self, c: Any, unit: Unit) -> tuple[Scalar, ...]:
        if self.law:
            return points(c, unit)
        if self.shifted:
            return (*points(c, unit, spacing := c.scaled_spacing(unit)), spacing, 1.0)
        length = c.length / unit.size
        return (*points(c, unit), length, 1 / length)

    def residual(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        d, length = Separation(g, i, j).d, f[0][0] if self.law else g[6]
        off = (d.dot(d) - length * length) * 0.5
        return (off if self.law else off * g[7],)

    def jacobian(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> list[Row]:
        gap = Separation(g, i, j)
        return [gap.slopes(gap.d if self.law else gap.d * g[7])]

    def nu(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        return (f[0][0] * f[0][1],) if self.law else (0,)

    def gamma(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        gap = Separation(g, i, j)
        bias = gap.rate.dot(gap.rate) + gap.d.dot(gap.drift)
        return (f[0][1] * f[0][1] + f[0][0] * f[0][2] - bias if self.law else bias * -g[7],)


def blocks_of(rows: list[Row]) -> Blocks:
    """Return rows of blocks as blocks of rows; a coordinate of the joint's own is missing from rows that lack it."""
    width = max(map(len, rows))
    return tuple(tuple(row[k] if k < len(row) else (0,) for row in rows) for k in range(width))
