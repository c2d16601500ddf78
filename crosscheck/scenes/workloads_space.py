"""What is computed in space: RSSRs over a turn of the crank, the coupler a body that spins as it likes.

The crank turns at 1 rad/s. The closed form estimates the first pose: finding it is not what is measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from refkin.model import Scene
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import RSSR
from refkin.scenes.linkages.closures import DoesNotAssemble

EXAMPLE = RSSR(1.0, 3.0, 2.0, (2.5, -0.5, 0.75), (0.25, 1.0, 0.125))
START, SPEED = 0.4, 1.0
LENGTHS, SHIFT, TILT = (0.7, 1.2), 0.25, 0.2
"""Lengths are those of the example times a number between these; its pivot is moved [m] and its axis tilted."""
SLACK = 0.02
"""By which part the coupler can be longer or shorter where `CHECKED` poses of a turn are looked at."""
SEED = 20261122
CHECKED = 36


@dataclass(frozen=True)
class SpatialLoops:
    """Some RSSRs at some times [s]."""

    name: str
    linkages: tuple[RSSR, ...]
    t: tuple[float, ...]

    @property
    def mechanisms(self) -> int:
        """M."""
        return len(self.linkages)

    @property
    def configurations(self) -> int:
        """M T."""
        return self.mechanisms * len(self.t)

    def scene(self, mechanism: int = 0) -> Scene:
        """Return the scene of one mechanism, without evidence."""
        law = Polynomial(coefficients=(START, SPEED))
        return self.linkages[mechanism].scene(law=law, times=list(self.t), evidence=(), name=self.name)

    def first(self, mechanisms: int) -> SpatialLoops:
        """Return the workload with the first mechanisms alone: for methods that are too slow for all."""
        return replace(self, linkages=self.linkages[:mechanisms])


def one_rssr(name: str, times: int) -> SpatialLoops:
    """Return one RSSR at so many times over a turn."""
    return SpatialLoops(name, (EXAMPLE,), tuple(np.linspace(0.0, math.tau, times).tolist()))


def many_rssrs(name: str, mechanisms: int, times: int) -> SpatialLoops:
    """Return random RSSRs whose crank turns fully, at so many times over a turn.

    Parameters
    ----------
    name : str
    mechanisms, times : int
        How many.
    """
    drawn = _turning_fully()
    return SpatialLoops(
        name, tuple(next(drawn) for _ in range(mechanisms)), tuple((np.arange(times) * (math.tau / times)).tolist())
    )


def _turning_fully() -> Iterator[RSSR]:
    draw = np.random.default_rng(SEED)
    while True:
        crank, coupler, rocker = (np.array([1.0, 3.0, 2.0]) * draw.uniform(*LENGTHS, 3)).tolist()
        pivot = np.add(EXAMPLE.pivot, draw.uniform(-SHIFT, SHIFT, 3)).tolist()
        axis = np.add(EXAMPLE.axis, draw.uniform(-TILT, TILT, 3)).tolist()
        linkage = RSSR(crank, coupler, rocker, tuple(pivot), tuple(axis))
        if all(_turns(replace(linkage, coupler=coupler * part)) for part in (1.0 - SLACK, 1.0 + SLACK)):
            yield linkage


def _turns(linkage: RSSR) -> bool:
    """Whether a linkage assembles all over a turn."""
    try:
        for k in range(CHECKED):
            linkage.output(math.tau * k / CHECKED, 1)
    except DoesNotAssemble:
        return False
    return True
