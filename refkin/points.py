"""Motion of a point of a body: r_P = r + A u, v_P = v + omega (A u)', a_P = a + alpha (A u)' - omega^2 A u.

(A u)' is A u turned by a quarter turn; the last two terms are the tangential and the normal acceleration.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from refkin.joints import Pair
from refkin.motion import PointMotion
from refkin.vec import BodyValues, Vec


def point_motion(position: Pair, q: Any, qd: Any = None, qdd: Any = None) -> PointMotion:
    """Return the motion of a point of one body.

    Parameters
    ----------
    position : pair of float
        The point in the body's own frame [m].
    q, qd, qdd : (3, T) array
        The body's coordinates (x, y, phi) and their rates; rates that are None are not reported.
    """
    arm = BodyValues(*q).turned(Vec(*position))
    across = arm.perp()
    r = np.array([q[0] + arm.x, q[1] + arm.y])
    v = None if qd is None else np.array([qd[0] + qd[2] * across.x, qd[1] + qd[2] * across.y])
    a = None
    if qdd is not None:
        centre = qd[2] ** 2
        a = np.array([qdd[0] + qdd[2] * across.x - centre * arm.x, qdd[1] + qdd[2] * across.y - centre * arm.y])
    return PointMotion(r=r, v=v, a=a)
