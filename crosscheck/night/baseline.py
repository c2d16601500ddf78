"""The baseline of the golden set: its file, `reports/baseline.json`, read by its types before anything is measured."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, NonNegativeFloat, NonNegativeInt, ValidationError, model_validator

from crosscheck.errors import UsageError
from crosscheck.judge.records import QUANTITIES, Strict, adapter, fault, plain
from crosscheck.night.plan import replace_file
from crosscheck.scenes.names import called_for
from refkin.errors import RefkinError
from refkin.model import Scene
from refkin.motion import Status
from refkin.scenes.files import parse

SCHEMA = 3
_INSTALLED = Path(__file__).with_name("baseline.json")
DEFAULT = _INSTALLED if _INSTALLED.is_file() else Path(__file__).parents[2] / "reports" / "baseline.json"
"""The accepted baseline: in an installed package beside this module, in a checkout among the reports."""


class NoBaseline(UsageError):
    """There is no baseline where one was asked for, or it cannot be read."""


@dataclass(frozen=True, kw_only=True)
class _Digits(Strict):
    """Of each quantity (median, worst), None without a digit."""

    position: tuple[float, float] | None
    velocity: tuple[float, float] | None
    acceleration: tuple[float, float] | None


@dataclass(frozen=True, kw_only=True)
class _Measured(Strict):
    """The digits of a method, of the quantities that it gives, and its largest error / allowed."""

    missing: NonNegativeInt
    ratio: dict[str, NonNegativeFloat | None]
    position: tuple[float, float] | None = None
    velocity: tuple[float, float] | None = None
    acceleration: tuple[float, float] | None = None

    @model_validator(mode="before")
    @classmethod
    def _has_both(cls, data: Any) -> Any:
        """Digits that are not there are held against nothing, and a method that has lost them would not be told."""
        ratio = data.get("ratio") if isinstance(data, dict) else None
        if isinstance(ratio, dict) and set(ratio) != (given := set(data) & set(QUANTITIES)):
            raise ValueError(f"expected digits and ratios of the same quantities, got {sorted(given)}, {sorted(ratio)}")
        return data


@dataclass(frozen=True, kw_only=True)
class _Reference(Strict):
    """The reference's answer: of each time a row of numbers, and a radius."""

    status: list[Status]
    position: list[list[float | None]]
    velocity: list[list[float | None]] | None
    acceleration: list[list[float | None]] | None
    certified_radius: dict[str, list[NonNegativeFloat | None]]


@dataclass(frozen=True, kw_only=True)
class _Case(Strict):
    """What `measure` returns of a scene."""

    scene: dict[str, Any]
    reference: _Reference
    rounding: _Digits
    methods: dict[str, dict[str, _Measured]]


@dataclass(frozen=True, kw_only=True)
class _Baseline(Strict):
    """What `write_baseline` writes."""

    schema: Literal[3]
    versions: dict[str, str]
    cases: Annotated[dict[str, _Case], Field(min_length=1)]


def read_baseline(path: Path) -> dict[str, Any]:
    """Return the baseline in a file; NoBaseline if there is none, or it cannot be read."""
    try:
        baseline: _Baseline = adapter(_Baseline).validate_json(path.read_bytes())
        why = next((why for name, case in baseline.cases.items() for why in _unlike_its_scene(name, case)), None)
    except FileNotFoundError as error:
        raise NoBaseline(f"there is no baseline {path}: crosscheck baseline --accept makes one") from error
    except (OSError, ValidationError) as error:
        why = fault(error) if isinstance(error, ValidationError) else error.strerror or str(error)
    if why is not None:
        raise NoBaseline(f"{path} is no baseline: {why}")
    return plain(baseline)


def _unlike_its_scene(name: str, case: _Case) -> Iterator[str]:
    """Yield where a case has another number of numbers than its scene, which is no fault of the reference."""
    key = f"cases.{name}"
    try:
        scene = parse(case.scene)
    except RefkinError as error:
        yield f"{key}.scene: {error}"
        return
    times, width = len(scene.times), len(scene.mechanism.bodies) * scene.mechanism.kind.width
    levels = {quantity: getattr(case.reference, quantity) or () for quantity in QUANTITIES}
    called = called_for(scene, QUANTITIES)
    radii = {f"certified_radius.{q}": case.reference.certified_radius.get(q, ()) for q in QUANTITIES}
    of_times = {"status": case.reference.status, **{q: levels[q] for q in QUANTITIES if q in called}, **radii}
    not_called = {q: levels[q] for q in QUANTITIES if q not in called}
    of_coordinates = {f"{q}.{k}": row for q, rows in levels.items() for k, row in enumerate(rows)}
    for expected, lists in ((times, of_times), (0, not_called), (width, of_coordinates)):
        for where, values in lists.items():
            if len(values) != expected:
                yield f"{key}.reference.{where}: {len(values)} values; expected {expected}"


def write_baseline(path: Path, cases: Mapping[str, Mapping[str, Any]], versions: Mapping[str, str]) -> None:
    """Accept what was measured as the baseline.

    Parameters
    ----------
    path : Path
        The file, which is replaced.
    cases : mapping
        Name -> case, as `measure` returns them.
    versions : mapping
        Engine -> version.
    """
    baseline = {"schema": SCHEMA, "versions": dict(versions), "cases": dict(cases)}
    replace_file(path, json.dumps(baseline, indent=1, allow_nan=False) + "\n")


def scenes_of(cases: Mapping[str, Mapping[str, Any]]) -> dict[str, Scene]:
    """Return the scenes of a baseline by name."""
    return {name: parse(dict(case["scene"])) for name, case in cases.items()}
