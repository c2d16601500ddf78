"""The records of a run as they are read back: one line at a time, each checked before anything is counted.

A line that is no record is a failure of the night with its line number, never skipped in silence.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, NonNegativeInt, ValidationError, model_validator

Histogram = dict[float, NonNegativeInt]
"""Digits, rounded down to a tenth -> how often."""


class _Data(BaseModel):
    model_config = ConfigDict(frozen=True)


class Sample(_Data):
    """The sample with the fewest digits of a decade: number of its time, digits, signed error per coordinate."""

    k: NonNegativeInt
    digits: float
    off: list[float | None]


class Cycle(_Data):
    """Errors over the times of a scene, per frame and coordinate in whole units; None where there is no answer."""

    unit: float
    off: list[list[int] | None]


class Quantity(_Data):
    """One quantity of an answer; digits, and the worst sample, by the decade of sigma_min at which they were met."""

    ratio: float | None
    worst: str = ""
    digits_by_sigma: dict[int, Histogram]
    samples: dict[int, Sample] = {}
    common: list[float | None] = []
    cycle: Cycle | None = None


class RouteData(_Data):
    """Who did what on the way to an answer."""

    name: str
    residual_by: str
    jacobian_by: str
    newton_by: str
    linear_solve_by: str
    drift_by: str
    seeding: str


class Answer(_Data):
    """One engine's answer to one scene by one route."""

    engine: str
    version: str
    route: RouteData
    quantities: dict[str, Quantity]
    missing: NonNegativeInt
    judged: NonNegativeInt
    times: NonNegativeInt
    seconds: float


class LevelRow(_Data):
    """One engine's own rows at one level, compared at configurations that need not be assembled."""

    engine: str
    level: str
    ratio: float | None
    digits: Histogram
    rows: NonNegativeInt
    worst: str = ""


class Common(_Data):
    """The one time of a scene at which answers are compared with each other, and what their errors relate to."""

    k: NonNegativeInt
    scale: dict[str, float]


class ReferenceRow(_Data):
    """What the reference says of a scene."""

    verdict: str
    message: str = ""
    statuses: dict[str, NonNegativeInt]
    sigma_min: float
    residual: float | None
    certified_radius: dict[str, float | None] = {}
    common: Common | None = None
    attainable_by_sigma: dict[str, dict[int, Histogram]] = {}
    seconds: float


class Disagreement(_Data):
    """One engine, route and quantity that is not what it must be."""

    engine: str
    route: str
    quantity: str
    kind: str
    ratio: float | None = None
    worst: str = ""

    @property
    def signature(self) -> tuple[str, str, str, str]:
        """What makes two disagreements the same one in different scenes."""
        return self.engine, self.route, self.quantity, self.kind


class Checked(_Data):
    """One scene's record; `reference` is None only with a `failure`."""

    key: str
    scene: str
    scene_file: dict[str, Any] | None = None
    about: dict[str, Any]
    reference: ReferenceRow | None = None
    answers: list[Answer]
    levels: list[LevelRow]
    refusals: list[str]
    disagreements: list[Disagreement]
    failure: str | None = None

    @model_validator(mode="after")
    def _has_a_result(self) -> Checked:
        if self.reference is None and self.failure is None:
            raise ValueError("neither reference nor failure")
        return self


class Unreadable(_Data):
    """A line that is no record, and why."""

    line: int
    reason: str


def read_records(path: Path) -> Iterator[tuple[int, bytes, Checked | Unreadable]]:
    """Yield (line number, the line, its record); nothing if there is no such file. One line is in memory at a time."""
    if not path.exists():
        return
    with path.open("rb") as lines:
        for number, line in enumerate(lines, 1):
            try:
                yield number, line, Checked.model_validate_json(line)
            except ValidationError as error:
                first = error.errors(include_url=False, include_input=False)[0]
                where = ".".join(map(str, first["loc"])) or "the line"
                yield number, line, Unreadable(line=number, reason=f"{where}: {first['msg']}")
