"""Motion of a point, fixed in a body or moving in it: Shabana, Computational Dynamics, 3.2 to 3.4.

The body has origin R and angle phi, omega = phi' and alpha = phi''. The point is at u in the body's own frame, with
rates u' and u'' there: r = R + A u. Its velocity v and acceleration a are sums of parts, where omega x w is w turned by
a quarter turn counter-clockwise, times omega:

================ ==========================
`v_origin`       R'
`v_turning`      omega x (A u)
`v_relative`     A u'
`a_origin`       R''
`a_normal`       omega x (omega x (A u))
`a_tangential`   alpha x (A u)
`a_coriolis`     2 omega x (A u')
`a_relative`     A u''
================ ==========================

A point fixed in the body has no relative and no Coriolis part.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.joints import Pair
from refkin.motion import PointMotion
from refkin.vec import BodyValues, Vec


@dataclass(frozen=True, kw_only=True)
class PointParts:
    """A point's position [m] and the parts of its velocity [m/s] and acceleration [m/s^2], each (2,) or (2, T).

    Parts that were not called for are None.
    """

    r: Any
    v_origin: Any = None
    v_turning: Any = None
    v_relative: Any = None
    a_origin: Any = None
    a_normal: Any = None
    a_tangential: Any = None
    a_coriolis: Any = None
    a_relative: Any = None

    @property
    def v(self) -> Any:
        """Velocity: the sum of its parts."""
        return self.v_origin + self.v_turning + self.v_relative

    @property
    def a(self) -> Any:
        """Acceleration: the sum of its parts."""
        return self.a_origin + self.a_tangential + self.a_normal + self.a_coriolis + self.a_relative


def point_parts(
    u: Any, q: Any, qd: Any = None, qdd: Any = None, ud: Any = (0.0, 0.0), udd: Any = (0.0, 0.0)
) -> PointParts:
    """Return the motion of a point that moves in a body, by parts; those of rates that are None are not computed.

    Parameters
    ----------
    u, ud, udd : pair of float or of (T,) array
        Place [m], velocity and acceleration of the point in the body's own frame; at rest there by default.
    q, qd, qdd : (3,) or (3, T) array
        The body's coordinates (x [m], y [m], phi [rad]) and their rates; qdd only with qd.
    """
    body = BodyValues(*q)
    arm = body.turned(Vec(*u))
    rows = {"r": body.r + arm}
    if qd is not None:
        omega, relative = qd[2], body.turned(Vec(*ud))
        rows["v_origin"] = Vec(qd[0], qd[1])
        rows["v_turning"] = arm.perp() * omega
        rows["v_relative"] = relative
        if qdd is not None:
            rows["a_origin"] = Vec(qdd[0], qdd[1])
            rows["a_normal"] = arm * -(omega * omega)
            rows["a_tangential"] = arm.perp() * qdd[2]
            rows["a_coriolis"] = relative.perp() * (2 * omega)
            rows["a_relative"] = body.turned(Vec(*udd))
    zero = 0.0 * (q[0] + arm.x)
    return PointParts(**{name: np.array([row.x + zero, row.y + zero]) for name, row in rows.items()})


def point_motion(position: Pair, q: Any, qd: Any = None, qdd: Any = None) -> PointMotion:
    """Return the motion of a point of one body.

    Parameters
    ----------
    position : pair of float
        The point in the body's own frame [m].
    q, qd, qdd : (3, T) array
        The body's coordinates (x, y, phi) and their rates; qdd only with qd. What is None has no part in it.
    """
    parts = point_parts(position, q, qd, qdd)
    return PointMotion(r=parts.r, v=None if qd is None else parts.v, a=None if qdd is None else parts.a)


@dataclass(frozen=True, kw_only=True)
class RodAndBlock:
    """Rates of a rod's angle [rad/s, rad/s^2] and of the place of a block on it [m/s, m/s^2]."""

    omega: Any
    alpha: Any
    slide_rate: Any
    slide_acceleration: Any


def rod_and_block(angle: Any, slide: Any, v: Any, a: Any) -> RodAndBlock:
    """Return how a rod turns and a block slides on it, from the motion of the block's pin (Shabana, 3.6).

    The rod turns about a fixed point, the block is s = `slide` from it. With e along the rod and n across it, the parts
    add up to v = omega s n + s' e and a = (alpha s + 2 omega s') n + (s'' - omega^2 s) e.

    Parameters
    ----------
    angle, slide : float or (T,) array
        Of the rod [rad], of the block on it [m].
    v, a : (2,) or (2, T) array
        Velocity and acceleration of the pin.
    """
    rod = BodyValues(0.0, 0.0, angle)
    along, across = Vec(rod.c, rod.s), Vec(-rod.s, rod.c)
    v, a = Vec(*v), Vec(*a)
    omega, slide_rate = v.dot(across) / slide, v.dot(along)
    return RodAndBlock(
        omega=omega,
        alpha=(a.dot(across) - 2 * omega * slide_rate) / slide,
        slide_rate=slide_rate,
        slide_acceleration=a.dot(along) + omega * omega * slide,
    )
