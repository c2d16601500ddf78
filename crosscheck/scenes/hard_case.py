"""What a hard scene is, and how near hard scenes come to what makes them hard."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from refkin.model import Evidence, Mechanism, Scene

DISTANCES = (1e-3, 1e-6, 1e-9, 1e-12, 1e-15)
"""How near the scenes come to what makes them hard [sizes, rad]."""
GAPS = (1e-3, 1e-6, 1e-9, 1e-12)
"""By how much scenes fail to assemble: 1e-12 is still a hundred times what rounding leaves of their closure."""
STEPS = (0.1, 0.5, 1.0, 2.0)
"""Crank angle between two times [rad]."""
APPROACH = 0.5
"""How far from the hard pose a scene begins [rad, m]."""
UP, DOWN = (0.0, 1.0), (0.0, -1.0)
"""Laws c0 + c1 t of an input that is the time, or its negative: times may be given as near to 0 as numbers go."""


@dataclass(frozen=True)
class HardCase:
    """A hard scene.

    Attributes
    ----------
    case : str
        What makes it hard.
    distance : float or None
        How near it comes to that, in the unit of its kind; None where there is no such number.
    scene : Scene
    poses : callable
        Time -> bodies' coordinates near the right ones (metres, rad), None where there are none or any will do.
    any_assembly : bool
        Whether every assembly is a right answer: nothing says which one is meant.
    every : callable, optional
        Time -> all assemblies there, where closed form has them in space; else they are searched for.
    exact : bool
        Whether `poses` are right to a few roundings, and so say which branch is meant; else the branch is the one of
        the first time, also where the other one is too near to be told from it in float64.
    """

    case: str
    distance: float | None
    scene: Scene
    poses: Callable[[float], Mapping[str, tuple[float, ...]] | None]
    any_assembly: bool = False
    exact: bool = False
    every: Callable[[float], Sequence[Mapping[str, tuple[float, ...]]]] | None = None

    @property
    def key(self) -> str:
        """What names it in a list."""
        return self.case if self.distance is None else f"{self.case}, {self.distance:.0e}"


def ways_to(d: float) -> list[float]:
    """Return how far from the hard pose the times of a scene are: steps, then powers of ten, then `d`."""
    ways = [APPROACH * (1 - 0.2 * k) for k in range(5)]
    return [*ways, *(way for way in (10.0**-k for k in range(2, 16)) if way > 3 * d), d]


def timed(mechanism: Mechanism, times: Sequence[float], name: str) -> Scene:
    """Return the scene that calls for positions at some times, with all evidence."""
    return Scene(mechanism=mechanism, times=tuple(times), name=name, effects=frozenset(), evidence=frozenset(Evidence))
