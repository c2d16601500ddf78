"""The scenes of the nightly's price list: one four-bar each far from trouble, and where digits are dear.

They are the same every night, so that prices can be compared over nights.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from refkin.model import Scene
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import FourBar
from refkin.scenes.linkages.base import Branch

SAMPLES = 73
SPEED = 2.0
"""Of the crank [rad/s]."""
SLACK, SPAN = 1e-4, 0.15
"""Distance of the lengths from a change point [m]; how far the crank turns to either side of the pose [rad]."""
SHORT_OF = 1e-6
"""How far before the dead centre the crank stops [rad]."""
AWAY = 2.0**20
"""How far from the origin of the ground a linkage lies [m], in x and in y."""
REGULAR = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)


@cache
def classes() -> dict[str, Scene]:
    """Return class -> its scene."""
    far = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0, origin=(AWAY, AWAY))
    flat = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + SLACK)
    limited = FourBar(ground=4.0, crank=2.0, coupler=1.5, rocker=2.5)
    limit = max(limited.input_range()[0])
    return {
        "regular": _turning(REGULAR, "regular"),
        # a crank that turns through the pose at which all links nearly lie in one line
        "near a change point": _swept(flat, math.pi - SPAN, math.pi + SPAN, "near a change point"),
        # one that turns towards the limit at which coupler and rocker lie in one line, up to just before it
        "near a dead centre": _swept(limited, limit - 4 * SPAN, limit - SHORT_OF, "near a dead centre"),
        "far from the origin": _turning(far, "far from the origin"),
    }


def _turning(linkage: FourBar, name: str) -> Scene:
    return linkage.scene(speed=SPEED, turns=1, samples=SAMPLES, branch=Branch.OPEN, name=name)


def _swept(linkage: FourBar, start: float, stop: float, name: str) -> Scene:
    times = np.linspace(0.0, (stop - start) / SPEED, SAMPLES).tolist()
    law = Polynomial(coefficients=(start, SPEED))
    return linkage.scene(law=law, times=times, branch=Branch.OPEN, name=name)
