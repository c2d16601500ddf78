"""Certificates in float64, for a whole batch of poses: exactly one solution is here, and it is no further than this.

Newton and Kantorovich's theorem in the form of Rump and of the radii polynomials, with a preconditioner R, about the
inverse of J = phi_q(q). T(x) = x - R phi(x) has the roots of phi as its fixed points if R is regular, and its
derivative is I - R phi_q(x). In the norm |v| = max_k |v_k| / w_k, w the first-order errors of the coordinates, let

    eta >= |R phi(q)|     Z0 >= |I - R J|     Z2 r >= |R (phi_q(x) - J)| for all |x - q| <= r <= r_box (C1).

If eta + Z0 r + Z2 r^2 / 2 <= r <= r_box (C2), then T maps the ball of radius r into itself, so phi has a root in it
(Brouwer); if Z0 + Z2 r < 1, only one, for two would be closer to each other than they are. R and J are regular because
Z0 < 1. Such an r exists if h = Z2 eta / (1 - Z0)^2 < 1/2: Kantorovich's h = beta K eta, with beta K in one number.

Z2 comes from the spread of phi_q over the box, computed by the joints' own formulas (`bounded`): a constant for
revolute rows, K0 + K1 r for rows that are bilinear; hence the box, and r is checked against it. Every bound includes
the rounding of phi, of J, of the geometry and of the laws' values, and that of R J and of all products here (an inner
product of n terms in any order is off by n U/(1 - n U) times the product of the absolute values). The truth is that of
`exact`: the scene as it is written.

Velocity solves phi_q(q*) x = nu at the root q*, acceleration phi_q(q*) x = gamma. With s = phi_q(q*) qd - nu enclosed,
qd - qd* = R s + (I - R phi_q(q*)) (qd - qd*), so |qd - qd*| <= |R s| / (1 - Z0 - Z2 r); acceleration likewise. The root
is known better than q: within Z0 r + Z2 r^2 / 2 of q - R phi(q). So the equations of velocity are enclosed around that
point, those of acceleration around the velocity so improved; and phi and s, which are small by cancellation, are
computed in extended precision. The bounds are then near the errors themselves, not near what rounding might have done.

S. M. Rump, Verification methods, Acta Numerica 19 (2010), sections 10 and 13.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.proof.numbers.bounded import UP, Bounds, Extended, U, box, off_by, product
from refkin.proof.numbers.preconditioned import Nearly, Preconditioned, independent_rows, one_after_another
from refkin.system import System

BOX = 2.5
"""Radius of the box in which Z2 is computed, in units of eta: r <= 2 eta / (1 - Z0), so it holds r if Z0 <= 1/5."""
REACH = 8.0
"""The ball in which the uniqueness radius is sought, in units of 1/|R|."""
BLOCK = 2**16
"""Matrix entries worked on at a time: what a cache holds."""


@dataclass(frozen=True)
class Certificate:
    """What is proved of a batch of poses; NaN where there is no proof. All in the system's scaled coordinates.

    Attributes
    ----------
    ok : (B,) bool
        Whether exactly one solution lies within `radii` of q.
    radii : (n, B) array
        Bounds of |q - q*| per coordinate.
    velocity, acceleration : (n, B) array or None
        Bounds of |qd - qd*| and |qdd - qdd*|, if qd and qdd were given.
    rows : (n,) or (n, B) array of int
        The constraint rows the proof is about: all of them, or a maximal independent set of redundant ones.
    root : Nearly
        The solution itself: one Newton step from q, and how near it lies.
    rates : tuple of Nearly
        Likewise the velocities and accelerations there, if qd and qdd were given.
    """

    ok: Any
    radii: Any
    velocity: Any
    acceleration: Any
    rows: Any
    root: Nearly
    rates: tuple[Nearly, ...] = ()

    @property
    def position(self) -> Any:
        """Largest of `radii` per pose, (B,)."""
        return np.max(self.radii, axis=0)


def certify(system: System, q: Any, t: Any, qd: Any = None, qdd: Any = None, rows: Any = None) -> Certificate:
    """Certify the poses q (n, B) at the times t (B,), and the rates that are given, by float64 alone.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit, so that no bound depends on the unit of length.
    q, qd, qdd : (n, B) array
        Answers of any origin in the system's coordinates; qdd only with qd.
    t : (B,) array
        Times [s].
    rows : (n,) or (n, B) array of int, optional
        The rows to certify where there are more than n, of all poses or of each; by default a maximal independent set
        at the first pose.
    """
    q, t = np.asarray(q, float), np.broadcast_to(np.asarray(t, float), np.shape(q)[1:])
    rows = independent_rows(system, q, t) if rows is None else np.asarray(rows)
    step = max(1, BLOCK // system.n**2)
    parts = []
    for start in range(0, max(q.shape[1], 1), step):
        at = np.s_[start : start + step]
        rates = [None if x is None else np.asarray(x, float)[:, at] for x in (qd, qdd)]
        with np.errstate(all="ignore"):  # a pose that leaves the numbers' range has no proof, which NaN says
            parts.append(_certify(system, rows if rows.ndim == 1 else rows[:, at], q[:, at], t[at], *rates))
    return _one_after_another(parts)


def _certify(system: System, rows: Any, q: Any, t: Any, qd: Any, qdd: Any) -> Certificate:
    pose = Preconditioned(system, rows, q, t, 0 if qd is None else 1 if qdd is None else 2)
    phi = pose.rows_of(pose.sharp.phi(box(q, 0.0, Extended), pose.times))
    ball = _Ball(pose, phi)
    radii = np.where(ball.ok, ball.radii, np.nan)
    rates = _rates(ball, qd, qdd)
    velocity, acceleration = [*(rate.error for rate in rates), None, None][:2]
    return Certificate(ball.ok, radii, velocity, acceleration, rows, ball.root, rates)


class _Ball:
    """The smallest ball of the weighted norm that is proved to hold exactly one root; `ok` where there is one."""

    def __init__(self, pose: Preconditioned, phi: Bounds) -> None:
        self.pose = pose
        shift, error = pose.carried(phi)
        step = np.abs(shift) + error
        # No weight is far below the others: it would only magnify what rounding leaves of the zeros of R J.
        self.w = w = step + np.maximum(U, 2.0**-20 * np.max(step, axis=0))
        slope = pose.slope_over(BOX * w)
        first = pose.defect_on(slope, w)
        second = pose.spread_on(slope.spread, w) / BOX
        eta, z0, z2 = (np.max(v / w, axis=0) for v in (step, first, second))
        rest = 1 - z0
        r = 2 * eta / (rest + np.sqrt(rest**2 - 2 * z2 * eta)) * (1 + 2.0**-20)
        into_itself = UP * (eta + z0 * r + z2 * r * r / 2) <= r
        self.theta = UP * (z0 + z2 * r)
        self.ok = into_itself & (r >= 0) & (UP * r <= BOX) & (self.theta < 1)  # below 0 beyond Z0 = 1
        self.defect_at_root = UP * (first + second * r)  # |I - R phi_q(q*)| w
        remainder = UP * (error + first * r + second * r * r / 2)
        self.radii = UP * np.minimum(r * w, np.abs(shift) + remainder)
        self.root = Nearly(pose.q, -shift, np.where(self.ok, remainder, np.nan))

    def solved(self, rate: Any, residual: Bounds) -> Nearly:
        """Return x* with phi_q(q*) x* = b, from x (`rate`) and bounds of phi_q(q*) x - b."""
        shift, error = self.pose.carried(residual)
        largest = np.max((np.abs(shift) + error) / self.w, axis=0) / (1 - self.theta)
        return Nearly(rate, -shift, UP * (error + UP * largest * self.defect_at_root))


def _rates(ball: _Ball, qd: Any, qdd: Any) -> tuple[Nearly, ...]:
    """Return velocity and acceleration, as far as they are asked for."""
    if qd is None:
        return ()
    pose, at = ball.pose, ball.root.box()
    slope, nu = (pose.rows_of(f(at, pose.times), np.longdouble) for f in (pose.sharp.phi_q, pose.sharp.nu))
    velocity = ball.solved(qd, off_by(slope, qd, nu))
    if qdd is None:
        return (velocity,)
    gamma = pose.rows_of(pose.sharp.gamma(at, velocity.box(), pose.times), np.longdouble)
    return velocity, ball.solved(qdd, off_by(slope, qdd, gamma))


def unique_within(system: System, rows: Any, q: Any, t: Any, position: Any) -> Any:
    """Return how close to each pose q (n, B) no other solution has all its coordinates, (B,); NaN where none is proved.

    With the root x at most p from q, any other root y at most u: |x - y| <= (Z0 + Z2 (p + u)/2) |x - y|, the mean of
    |. - q| on the segment being at most (p + u)/2. So u >= 2 (1 - Z0)/Z2 - p, as far as Z2 holds.

    Parameters
    ----------
    system : System
    rows : (n,) or (n, B) array of int
        The rows that are solved.
    q : (n, B) array
        Poses, in the system's coordinates.
    t : (B,) array
        Times [s].
    position : (B,) array
        The proved radius of each pose.
    """
    pose, ones = Preconditioned(system, rows, q, t, 0), np.ones_like(q)
    reach = np.minimum(1.0, REACH / (UP * np.max(product(pose.size, ones), axis=0)))
    slope = pose.slope_over(reach * ones)
    rest = 1 - np.max(pose.defect_on(slope, ones), axis=0)
    z2 = np.max(pose.spread_on(slope.spread, ones), axis=0) / reach
    free = np.minimum(reach, 2 * rest / (UP * z2) - UP * position) * (2 - UP)
    return np.where((position <= reach) & (free > 0.0), free, np.nan)


def _one_after_another(parts: list[Certificate]) -> Certificate:
    """Return the certificates of consecutive blocks of samples as one."""
    root, *rates = (one_after_another(each) for each in zip(*((p.root, *p.rates) for p in parts), strict=True))
    columns = zip(*((p.ok, p.radii, p.velocity, p.acceleration) for p in parts), strict=True)
    every = (None if column[0] is None else np.concatenate(column, axis=-1) for column in columns)
    ok, radii, velocity, acceleration = every
    rows = parts[0].rows if parts[0].rows.ndim == 1 else np.concatenate([p.rows for p in parts], axis=1)
    return Certificate(ok, radii, velocity, acceleration, rows, root, tuple(rates))
