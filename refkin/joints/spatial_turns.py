"""The terms of spatial joints that are half angles: turns about an axis, and what counts and couples them.

f, g and h are the vectors of a joint's frame on a body (`spatial_frames`). With (e0, e) the Euler parameters that lead
from the frame on body i to that on body j, conj(p_i c_i) (p_j c_j), c the parameters of a frame in its body:

========== ================================= =========================================================================
term       rows                              gamma, with ' at constant rates
========== ================================= =========================================================================
`Turn`     2 e_k                             -4 (conj(p_i' c_i) (p_j' c_j))_k
`Angle`    2 (e3 cos s - e0 sin s)           s half an angle: a law's, or a coordinate; 2 sin((theta - 2 s) / 2)
`InGear`   2 R_i s_i + 2 R_j s_j + ...      0: linear in half angles s, coordinates, as is `TurnCount`, 2 s - f
========== ================================= =========================================================================

Half angles: e1 = e2 = 0 only where the axes h are one and the same, while f_i . h_j = g_i . h_j = 0 also where one is
reversed; e3 cos s = e0 sin s only at the angle itself, while sin(theta - f) = 0 half a turn off as well. The dot rows
are the half-angle rows turned: f_i . h_j = e3 x1 + e0 x2 and g_i . h_j = e3 x2 - e0 x1 with x = 2 (e1, e2), for any p.
"""

from __future__ import annotations

from typing import Any

from refkin.joints.base import Rows, Unit
from refkin.joints.spatial_frames import about, turns
from refkin.joints.spatial_terms import AT_REST, Row, SpatialRows
from refkin.joints.spatial_vectors import Quaternion, SpatialValues
from refkin.vec import Scalar, cosine_and_sine


def relative(g: Any, i: SpatialValues, j: SpatialValues) -> Quaternion:
    """Return the Euler parameters that lead from the frame on body i to that on body j.

    Parameters
    ----------
    g : sequence of float
        A joint's scaled geometry: the Euler parameters of its frame on either body among it.
    i, j : SpatialValues
        The two bodies' poses.
    """
    a, b = _frames(g, i.p, j.p)
    return a.times(b)


def _frames(g: Any, p_i: Quaternion, p_j: Quaternion) -> tuple[Quaternion, Quaternion]:
    """Return conj(p_i c_i) and p_j c_j, of Euler parameters or of their rates."""
    return _turned(p_i, g[:4]).conj(), _turned(p_j, g[4:8])


def _turned(p: Quaternion, c: Any) -> Quaternion:
    return p.times(Quaternion.of(*c))


def _of_rates(g: Any, i: SpatialValues, j: SpatialValues) -> tuple[Quaternion, Quaternion]:
    """Return the rate of the relative parameters, and half of what of their second rate holds no acceleration."""
    (a, b), (ad, bd) = _frames(g, i.p, j.p), _frames(g, i.pd, j.pd)
    return ad.times(b) + a.times(bd), ad.times(bd)


class Turn(SpatialRows):
    """Parts of the relative Euler parameters are zero: "12" keeps the axes in one direction, "3" the turn about it."""

    size = 8

    def __init__(self, parts: str) -> None:
        self.places = [int(part) - 1 for part in parts]
        self.rows = len(parts)

    def constants(self, c: Any, unit: Unit) -> tuple[Scalar, ...]:
        return turns(c)

    def residual(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        a, b = _frames(g, i.p, j.p)
        return tuple(2 * a.part(b, k) for k in self.places)

    def jacobian(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> list[Row]:
        return _turn_slopes(g, i, j, [lambda x, sign, k=k: x.times_axis(k) for k in self.places])

    def gamma(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        a, b = _frames(g, i.pd, j.pd)
        return tuple(-4 * a.part(b, k) for k in self.places)


def _turn_slopes(g: Any, i: SpatialValues, j: SpatialValues, directions: Any) -> list[Row]:
    """Return the gradients of 2 <w, e> of the relative parameters e = conj(a) b, a = p_i c_i, b = p_j c_j.

    <w, e> is <a w conj(c_j), p_j> and <b conj(w) conj(c_i), p_i>. Each of the directions gives x w of (x, 1), and
    -x conj(w) of (x, -1).
    """
    a, b = _turned(i.p, g[:4]), _turned(j.p, g[4:8])
    c_i, c_j = Quaternion.of(*g[:4]).conj(), Quaternion.of(*g[4:8]).conj()
    rows: list[Row] = []
    for product in directions:
        of_i, of_j = product(b, -1).times(c_i), product(a, 1).times(c_j)
        rows.append(((*AT_REST, *(-2 * x for x in of_i.parts)), (*AT_REST, *(2 * x for x in of_j.parts))))
    return rows


class Angle(SpatialRows):
    """The turn about the axis is a law's, by half its value; or twice a coordinate of the joint's own (`counted`)."""

    size = 8

    def __init__(self, counted: bool = False) -> None:
        self.counted = counted

    def constants(self, c: Any, unit: Unit) -> tuple[Scalar, ...]:
        return turns(c)

    def _half(self, f: Any, own: Any) -> tuple[Scalar, Scalar]:
        """Return cosine and sine of half the angle."""
        return (own[0].c, own[0].s) if self.counted else cosine_and_sine(f[0][0] * 0.5)

    def residual(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        e, (c, s) = relative(g, i, j), self._half(f, own)
        return (2 * (e.v.z * c - e.a * s),)

    def jacobian(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> list[Row]:
        """Return the gradient of 2 (e3 cos s - e0 sin s), 2 <w, e> with w = k cos s - sin s; and its slope by s."""
        c, s = self._half(f, own)

        def product(x: Quaternion, sign: int) -> Quaternion:
            towards: Quaternion = x.times_axis(2) * c + x * (-sign * s)
            return towards

        rows = _turn_slopes(g, i, j, [product])
        if not self.counted:
            return rows
        e = relative(g, i, j)
        return [(*rows[0], (-2 * (e.v.z * s + e.a * c),))]

    def nu(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        if self.counted:
            return (0,)
        e, (c, s) = relative(g, i, j), self._half(f, own)
        return ((e.v.z * s + e.a * c) * f[0][1],)

    def gamma(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        e, (c, s), (rate, bias) = relative(g, i, j), self._half(f, own), _of_rates(g, i, j)
        half = own[0].rate if self.counted else f[0][1] * 0.5
        turning = 2 * (rate.v.z * s + rate.a * c) * half + (e.v.z * c - e.a * s) * (half * half)
        right = 2 * turning - 4 * (bias.v.z * c - bias.a * s)
        return (right,) if self.counted else (right + (e.v.z * s + e.a * c) * f[0][2],)


class TurnCount(SpatialRows):
    """The turn about the axis, turns counted, is a law's: 2 s - f = 0, s half the angle, a coordinate."""

    def residual(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        return (2 * own[0].value - f[0][0],)

    def jacobian(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> list[Row]:
        return [((0,) * 7, (0,) * 7, (2,))]

    def nu(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        return (f[0][1],)

    def gamma(self, g: Any, f: Any, i: Any, j: Any, *own: Any) -> Rows:
        return (f[0][2],)


class InGear(SpatialRows):
    """Two turns are in proportion: R_i (2 s_i - phi0_i) + R_j (2 s_j - phi0_j) = 0 over the larger R."""

    size = 4

    def constants(self, c: Any, unit: Unit) -> tuple[Scalar, ...]:
        largest = max(abs(about(c.radius_i)), abs(about(c.radius_j)))  # only their ratio counts
        return c.radius_i / largest, c.radius_j / largest, c.phi0_i, c.phi0_j

    def residual(self, g: Any, f: Any, i: Any, j: Any, carrier: Any, *own: Any) -> Rows:
        return (g[0] * (2 * own[0].value - g[2]) + g[1] * (2 * own[1].value - g[3]),)

    def jacobian(self, g: Any, f: Any, *at: Any) -> list[Row]:
        return [(*((0,) * 7,) * 3, (2 * g[0],), (2 * g[1],))]

    def gamma(self, g: Any, f: Any, *at: Any) -> Rows:
        return (0,)
