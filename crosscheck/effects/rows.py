"""A row of the ledger of effects, and the two answers that it is about."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from refkin.motion import Motion

Work = Callable[[], Motion]


@dataclass(frozen=True, kw_only=True)
class EffectRow:
    """What one effect costs in one engine by one route, and whether it changes anything.

    Attributes
    ----------
    microseconds : float or None
        What it adds per configuration; None if it could not be measured.
    without : float or None
        What a configuration costs without it [microseconds].
    spread : float or None
        How far apart that number is taken from every other round and from the rest [microseconds]: less than this is
        noise; None if there was one round alone.
    inert : bool
        Whether nothing else changes: no bit in refkin, nothing beyond the allowed error in an engine, no status.
    largest_change : float or None
        The largest relative change of what both answers have; None if there are no two answers.
    worst : str
        Where that is.
    called_for : bool
        Whether a kinematic scene may call for it; the others are switched on behind its back.
    note : str
        What was switched on, and why there is no number where there is none.
    """

    engine: str
    route: str
    effect: str
    microseconds: float | None
    without: float | None
    spread: float | None
    inert: bool
    largest_change: float | None
    worst: str
    called_for: bool
    note: str


@dataclass(frozen=True)
class Ablation:
    """An effect as two works, by name: the answer without it and with it."""

    effect: str
    off: str = field(kw_only=True)
    on: str = field(kw_only=True)
    called_for: bool = field(kw_only=True)
    note: str = field(kw_only=True)


@dataclass(frozen=True)
class Bench:
    """What is measured of one route: its works by name, and the effects as pairs of them."""

    engine: str
    route: str
    exact: bool
    works: Mapping[str, Work]
    ablations: tuple[Ablation, ...]
