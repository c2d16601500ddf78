"""A row of the ledger of effects: what one effect costs with one method, and whether it changes anything."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class EffectRow:
    """What one effect costs in one engine by one method, and whether it changes anything.

    Attributes
    ----------
    microseconds : float or None
        What it adds per configuration, negative by noise alone; None if it could not be measured.
    without : float or None
        What a configuration costs without it [microseconds].
    spread : float or None
        How far apart that number is taken from different rounds [microseconds]: what is no larger is noise. It is never
        less than what an effect seems to save. None without a price.
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
    method: str
    setting: str
    effect: str
    microseconds: float | None = None
    without: float | None = None
    spread: float | None = None
    inert: bool | None = None
    largest_change: float | None = None
    worst: str = ""
    called_for: bool
    note: str = ""

    @property
    def within_noise(self) -> bool:
        """Whether the price is no larger than what the measurement leaves open."""
        return self.microseconds is not None and self.microseconds <= (self.spread or 0.0)
