"""How a rod turns and a block slides on it: the Coriolis example of the notes on Shabana, for a pin that is given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from refkin.vec import BodyValues, Vec


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
