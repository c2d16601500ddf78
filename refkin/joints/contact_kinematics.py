"""How a follower touches a cam: the formulas of `contact.Cam`, one class for each kind of contact.

Body i carries the profile, body j the follower. A polar profile is the curve u(s) = d(s) (cos s, sin s) around
point_i, in the frame of body i; the contact parameter s, an angle, is a coordinate of its own. Its tangent is
t = u'(s) (Shabana, Computational Dynamics, section 3.9). With A = A(phi_i), d = r_j - r_i the gap of the two points of
the joint and w = d - A u(s) what is missing from the profile to the follower's point:

============ ================================================ ===================================
follower     rows                                             geometry `g` after the two points
============ ================================================ ===================================
point        w = 0 (J11)
flat         n . w = 0, n . A t = 0 (J12)                     n, the unit normal of the face
roller       w . A t / rho = 0, (w . w - rho^2) / (2 rho) = 0 rho, 1 / rho (J13)
flat on disc n . d - radius = 0 (J10)                         n, radius
============ ================================================ ===================================

A point or roller on a disc keeps a distance from its centre: those are the formulas of `planar.Distance`.
"""

from __future__ import annotations

from typing import Any

from refkin.joints.base import Blocks, Rows, Triple, along, arms, drift, gap_rate
from refkin.vec import BodyValues, ParameterValue, Vec


class FaceOnDisc:
    """A flat face on a disc."""

    rows = 1

    @staticmethod
    def residual(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        _, _, d = arms(g, i, j)
        return (j.turned(Vec(g[4], g[5])).dot(d) - g[6],)

    @staticmethod
    def jacobian(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Blocks:
        a_i, a_j, d = arms(g, i, j)
        block_i, block_j = _face_gradient(j.turned(Vec(g[4], g[5])), d, a_i, a_j)
        return (block_i,), (block_j,)

    @staticmethod
    def gamma(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        a_i, a_j, d = arms(g, i, j)
        n = j.turned(Vec(g[4], g[5]))
        return (_face_gamma(n, d, gap_rate(a_i, a_j, i, j), drift(a_i, a_j, i, j), j.omega),)


class PointOnCurve:
    """A point, such as a knife edge, on a polar profile."""

    rows = 2

    @staticmethod
    def residual(g: Any, f: Any, i: BodyValues, j: BodyValues, s: ParameterValue) -> Rows:
        w = Clearance(g, f, i, j, s).w
        return w.x, w.y

    @staticmethod
    def jacobian(g: Any, f: Any, i: BodyValues, j: BodyValues, s: ParameterValue) -> Blocks:
        gap = Clearance(g, f, i, j, s)
        arm, a_j, t = gap.arm, gap.a_j, gap.curve[1]
        return ((-1, 0, arm.y), (0, -1, -arm.x)), ((1, 0, -a_j.y), (0, 1, a_j.x)), ((-t.x,), (-t.y,))

    @staticmethod
    def gamma(g: Any, f: Any, i: BodyValues, j: BodyValues, s: ParameterValue) -> Rows:
        bias = Clearance(g, f, i, j, s).drift()
        return -bias.x, -bias.y


class FaceOnCurve:
    """A flat face on a polar profile: the contact point lies in the face, and the face along the tangent."""

    rows = 2

    @staticmethod
    def residual(g: Any, f: Any, i: BodyValues, j: BodyValues, s: ParameterValue) -> Rows:
        gap = Clearance(g, f, i, j, s)
        n = j.turned(Vec(g[4], g[5]))
        return n.dot(gap.w), n.dot(gap.curve[1])

    @staticmethod
    def jacobian(g: Any, f: Any, i: BodyValues, j: BodyValues, s: ParameterValue) -> Blocks:
        """Return the gradients of n . w and n . A t, by body i, body j and s."""
        gap = Clearance(g, f, i, j, s)
        n = j.turned(Vec(g[4], g[5]))
        t, bend = gap.curve[1], gap.curve[2]
        block_i, block_j = _face_gradient(n, gap.w, gap.arm, gap.a_j)
        turn_i, turn_j = (0, 0, n.dot(t.perp())), (0, 0, n.perp().dot(t))
        return (block_i, turn_i), (block_j, turn_j), ((-n.dot(t),), (n.dot(bend),))

    @staticmethod
    def gamma(g: Any, f: Any, i: BodyValues, j: BodyValues, s: ParameterValue) -> Rows:
        gap = Clearance(g, f, i, j, s)
        n, t = j.turned(Vec(g[4], g[5])), gap.curve[1]
        first = _face_gamma(n, gap.w, gap.rate(), gap.drift(), j.omega)
        return first, _face_gamma(n, t, gap.curve_rate(1), gap.curve_drift(1), j.omega)


class RollerOnCurve:
    """A roller on a polar profile: its centre lies rho away from the contact point, along the normal there."""

    rows = 2

    @staticmethod
    def residual(g: Any, f: Any, i: BodyValues, j: BodyValues, s: ParameterValue) -> Rows:
        gap = Clearance(g, f, i, j, s)
        w = gap.w
        return w.dot(gap.curve[1]) * g[5], (w.dot(w) - g[4] * g[4]) * g[5] * 0.5

    @staticmethod
    def jacobian(g: Any, f: Any, i: BodyValues, j: BodyValues, s: ParameterValue) -> Blocks:
        """Return the gradients of w . A t / rho and (w . w - rho^2) / (2 rho), by body i, body j and s."""
        gap = Clearance(g, f, i, j, s)
        t, w = gap.curve[1] * g[5], gap.w * g[5]
        (x, y, phi), along_j = along(t, gap.arm, gap.a_j)
        across_i, across_j = along(w, gap.arm, gap.a_j)
        along_s = w.dot(gap.curve[2]) - t.dot(gap.curve[1])
        along_i = (x, y, phi + w.dot(gap.curve[1].perp()))
        return (along_i, across_i), (along_j, across_j), ((along_s,), (-w.dot(gap.curve[1]),))

    @staticmethod
    def gamma(g: Any, f: Any, i: BodyValues, j: BodyValues, s: ParameterValue) -> Rows:
        gap = Clearance(g, f, i, j, s)
        w, rate, bias = gap.w, gap.rate(), gap.drift()
        turning = bias.dot(gap.curve[1]) + rate.dot(gap.curve_rate(1)) * 2 + w.dot(gap.curve_drift(1))
        return turning * -g[5], (rate.dot(rate) + w.dot(bias)) * -g[5]


class Clearance:
    """The profile around its contact point, and what is missing from there to the follower's point, in ground axes.

    Attributes
    ----------
    curve : list of Vec
        A u and its derivatives A u', A u'', ... by s, as far as the derivatives of d are given.
    arm, a_j : Vec
        From the bodies' origins to the contact point and to the follower's point.
    w : Vec
        d - A u.
    """

    def __init__(self, g: Any, f: Any, i: BodyValues, j: BodyValues, s: ParameterValue) -> None:
        self.i, self.j, self.s = i, j, s
        self.curve = curve(f[0], i.turned(Vec(s.c, s.s)))
        self.a_i, self.a_j, d = arms(g, i, j)
        self.arm, self.w = self.a_i + self.curve[0], d - self.curve[0]

    def rate(self) -> Vec:
        """Return w'."""
        rate: Vec = gap_rate(self.a_i, self.a_j, self.i, self.j) - self.curve_rate(0)
        return rate

    def drift(self) -> Vec:
        """Return the part of w'' that holds no acceleration."""
        return drift(self.a_i, self.a_j, self.i, self.j) - self.curve_drift(0)

    def curve_rate(self, k: int) -> Vec:
        """Return (A u^(k))' = omega (A u^(k)).perp() + s' A u^(k+1): transport, and motion along the profile."""
        rate: Vec = self.curve[k].perp() * self.i.omega + self.curve[k + 1] * self.s.rate
        return rate

    def curve_drift(self, k: int) -> Vec:
        """Return the part of (A u^(k))'' that holds no acceleration: normal, Coriolis and relative."""
        omega, rate = self.i.omega, self.s.rate
        coriolis = self.curve[k + 1].perp() * (omega * rate * 2)
        bias: Vec = coriolis + self.curve[k + 2] * (rate * rate) - self.curve[k] * (omega * omega)
        return bias


def curve(d: Any, e: Vec) -> list[Vec]:
    """Return d e and its derivatives by the angle of the unit vector e, from d and its derivatives, three at most."""
    n = e.perp()
    derivatives = [e * d[0], e * d[1] + n * d[0], e * (d[2] - d[0]) + n * (2 * d[1])]
    if len(d) > 3:
        derivatives.append(e * (d[3] - 3 * d[1]) + n * (3 * d[2] - d[0]))
    return derivatives


def _face_gradient(n: Vec, w: Vec, a_i: Vec, a_j: Vec) -> tuple[Triple, Triple]:
    """Return the gradient of n . w for body i and for body j, which carries n."""
    block_i, (x, y, phi) = along(n, a_i, a_j)
    return block_i, (x, y, phi + n.perp().dot(w))


def _face_gamma(n: Vec, w: Vec, rate: Vec, bias: Vec, omega: Any) -> Any:
    """Return minus the part of (n . w)'' that holds no acceleration, n turning with omega."""
    return n.dot(w) * (omega * omega) - n.perp().dot(rate) * (2 * omega) - n.dot(bias)
