"""What the reference says of the scenes of a run."""

from __future__ import annotations

from collections import Counter
from typing import Any

from crosscheck.judge.records import ReferenceRow
from crosscheck.report.cells import Place


class ReferenceTotals:
    """Statuses, and the extremes with the record they were met at."""

    def __init__(self) -> None:
        self.verdicts: Counter[str] = Counter()
        self.statuses: Counter[str] = Counter()
        self.seconds = 0.0
        self.largest: dict[str, tuple[float, Place]] = {}
        self.radii: dict[str, tuple[float, Place]] = {}
        self.smallest_sigma: tuple[float, Place] | None = None

    @property
    def configurations(self) -> int:
        """How many configurations the scenes ask for."""
        return self.statuses.total()

    def add(self, row: ReferenceRow, place: Place) -> None:
        """Count one scene."""
        self.verdicts[row.verdict] += 1
        self.statuses.update(row.statuses)
        self.seconds += row.seconds
        if row.residual is not None and row.residual > self.largest.get("residual", (-1.0, place))[0]:
            self.largest["residual"] = (row.residual, place)
        for name, radius in row.certified_radius.items():
            if radius is not None and radius > self.radii.get(name, (-1.0, place))[0]:
                self.radii[name] = (radius, place)
        if self.smallest_sigma is None or row.sigma_min < self.smallest_sigma[0]:
            self.smallest_sigma = (row.sigma_min, place)

    def described(self) -> dict[str, Any]:
        """Return it as plain data."""
        count = self.configurations
        return {
            "verdicts": dict(self.verdicts.most_common()),
            "statuses": dict(self.statuses.most_common()),
            "largest_residual": _with_place(self.largest.get("residual")),
            "smallest_sigma_min": _with_place(self.smallest_sigma),
            "largest_certified_radius": {name: _with_place(extreme) for name, extreme in self.radii.items()},
            "microseconds_mean": 1e6 * self.seconds / count if count else None,
        }


def _with_place(extreme: tuple[float, Place] | None) -> dict[str, Any] | None:
    return {"value": extreme[0], **vars(extreme[1])} if extreme else None
