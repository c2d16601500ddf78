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
        What it adds per configuration, negative by noise alone; None if it could not be measured.
    without : float or None
        What a configuration costs without it [microseconds].
    spread : float or None
        How far apart that number is taken from different rounds [microseconds]: what is no larger is noise. It is never
        less than what an effect seems to save. None if there was one round alone.
    inert : bool or None
        Whether nothing else changes: no bit in refkin, nothing beyond the allowed error in an engine, no status. None
        if that is not known: the engine has no such effect, or no answer without it either.
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
    inert: bool | None
    largest_change: float | None
    worst: str
    called_for: bool
    note: str

    @property
    def within_noise(self) -> bool:
        """Whether the price is no larger than what the measurement leaves open."""
        return self.microseconds is not None and self.microseconds <= (self.spread or 0.0)


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
    """What is measured of one route: its works by name, the effects as pairs of them, and why others are absent."""

    engine: str
    route: str
    exact: bool
    works: Mapping[str, Work]
    ablations: tuple[Ablation, ...]
    absent: Mapping[str, str] = field(default_factory=dict)
