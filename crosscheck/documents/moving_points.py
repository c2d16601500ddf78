"""Motion of a point that moves in a body, part by part (Shabana, Computational Dynamics, 3.2 to 3.4 and 3.6).

The body has origin R, angle phi, omega = phi' and alpha = phi''. The point is at u in the body's own frame, with rates
u' and u'' there: r = R + A u. Velocity and acceleration are sums of parts; omega x w is w turned by a quarter turn
counter-clockwise, times omega. A point fixed in the body has no relative and no Coriolis part.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from refkin.vec import BodyValues, Vec


@dataclass(frozen=True, kw_only=True)
class PointParts:
    """Position [m], parts of velocity [m/s] and acceleration [m/s^2], (2,) or (2, T); None what was not called for."""

    r: Any
    v_origin: Any = None  # R'
    v_turning: Any = None  # omega x (A u)
    v_relative: Any = None  # A u'
    a_origin: Any = None  # R''
    a_normal: Any = None  # omega x (omega x (A u))
    a_tangential: Any = None  # alpha x (A u)
    a_coriolis: Any = None  # 2 omega x (A u')
    a_relative: Any = None  # A u''

    @property
    def v(self) -> Any:
        return self.v_origin + self.v_turning + self.v_relative

    @property
    def a(self) -> Any:
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
        rows |= {"v_origin": Vec(qd[0], qd[1]), "v_turning": arm.perp() * omega, "v_relative": relative}
        if qdd is not None:
            rows["a_origin"] = Vec(qdd[0], qdd[1])
            rows["a_normal"] = arm * -(omega * omega)
            rows["a_tangential"] = arm.perp() * qdd[2]
            rows["a_coriolis"] = relative.perp() * (2 * omega)
            rows["a_relative"] = body.turned(Vec(*udd))
    zero = 0.0 * (q[0] + arm.x)
    return PointParts(**{name: np.array([row.x + zero, row.y + zero]) for name, row in rows.items()})


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
