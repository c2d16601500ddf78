"""The four-bar by trigonometry: two circles meet, and the loop equation is differentiated twice.

On rows of `numpy.longdouble` this is the truth that every answer is held against; on rows of doubles it is the limit
of what NumPy can do for a four-bar. Crank pivot A0 at 0, rocker pivot B0 on the x axis, OPEN: B lies to the left of
the line from A to B0. With the unit vectors u, p, r along crank a, coupler b, rocker c, and i u = u turned by a right
angle:

    a u + b p = g + c r,   a w i u + b wb i p = c wc i r,   and once more for the accelerations.

Each of the last two is solved by its products with r and with p.
"""

from __future__ import annotations

from typing import Any

import numpy as np

ORDER = ("ground", "crank", "coupler", "rocker")
"""The lengths, in this order wherever a work has rows of them."""


def four_bar(lengths: Any, phi: Any, omega: Any = 1.0, alpha: Any = 0.0) -> tuple[Any, Any, Any]:
    """Return coordinates, velocities, accelerations, each (9, ...): x, y, phi of the middles of crank, coupler, rocker.

    Parameters
    ----------
    lengths : (4, ...) array
        As `ORDER` [m]; spread against `phi`.
    phi, omega, alpha : array or float
        Angle of the crank and its derivatives [rad, rad/s, rad/s^2].
    """
    ground, a, b, c = lengths
    u = np.cos(phi), np.sin(phi)
    tip = a * u[0], a * u[1]
    dx, dy = ground - tip[0], -tip[1]
    # Where the circles meet, as parts of the vector between their centres, along and across it.
    square = dx * dx + dy * dy
    along = ((b - c) * (b + c) + square) / (2 * square)
    across = np.sqrt(np.maximum(b * b / square - along * along, 0.0))
    arm = along * dx - across * dy, along * dy + across * dx
    p = arm[0] / b, arm[1] / b
    r = (tip[0] + arm[0] - ground) / c, (tip[1] + arm[1]) / c
    angles = phi, np.arctan2(p[1], p[0]), np.arctan2(r[1], r[0])
    cross = _cross(r, p)
    wb = -a * omega * _cross(r, u) / (b * cross)
    wc = -a * omega * _cross(p, u) / (c * cross)
    pull = a * omega * omega
    bend = _dot(r, p)
    ab = (c * wc * wc - a * alpha * _cross(r, u) - pull * _dot(r, u) - b * wb * wb * bend) / (b * cross)
    ac = (c * wc * wc * bend - a * alpha * _cross(p, u) - pull * _dot(p, u) - b * wb * wb) / (c * cross)
    links = ((a, u, (0.0, 0.0)), (b, p, tip), (c, r, (ground, 0.0)))
    return _levels(links, angles, (omega, wb, wc), (alpha, ab, ac))


def _levels(links: Any, angles: Any, rates: Any, bends: Any) -> tuple[Any, Any, Any]:
    """Return the levels of the middles of links, whose first points move as ends of the links before them."""
    shape = np.broadcast_shapes(*(np.shape(x) for x in angles), np.shape(links[0][0]))
    out = [np.empty((9, *shape), np.result_type(*angles, links[0][0])) for _ in range(3)]
    velocity: tuple[Any, Any] = (0.0, 0.0)
    acceleration: tuple[Any, Any] = (0.0, 0.0)
    for k, ((length, e, foot), w, bend) in enumerate(zip(links, rates, bends, strict=True)):
        if k == 2:  # the rocker hangs on the ground
            velocity = acceleration = (0.0, 0.0)
        half = length / 2
        turned = (-w * e[1], w * e[0])
        bent = (-bend * e[1] - w * w * e[0], bend * e[0] - w * w * e[1])
        for axis in (0, 1):
            out[0][3 * k + axis] = foot[axis] + half * e[axis]
            out[1][3 * k + axis] = velocity[axis] + half * turned[axis]
            out[2][3 * k + axis] = acceleration[axis] + half * bent[axis]
        for level, value in zip(out, (angles[k], w, bend), strict=True):
            level[3 * k + 2] = value
        velocity = length * turned[0], length * turned[1]
        acceleration = length * bent[0], length * bent[1]
    return out[0], out[1], out[2]


def _cross(a: Any, b: Any) -> Any:
    return a[0] * b[1] - a[1] * b[0]


def _dot(a: Any, b: Any) -> Any:
    return a[0] * b[0] + a[1] * b[1]
