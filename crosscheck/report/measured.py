"""What other commands measured for a night: the price list, the effects, the engines at hard cases.

Each is a file of plain rows beside the records (`price.json`, `effects.json`, `hard_cases.json`). A file that is not
there was not measured; one that cannot be read is a failure of the night.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, NonNegativeFloat, TypeAdapter, ValidationError

Rows = list[dict[str, Any]]
VERDICTS = ("correct", "warned", "refused", "wrong", "crash", "hang")


class _Row(BaseModel):
    model_config = ConfigDict(extra="allow", allow_inf_nan=False)


class PriceRow(_Row):
    """What one setting of one method costs per configuration, and to how many digits it is right."""

    engine: str
    method: str = Field(validation_alias=AliasChoices("method", "route"))
    setting: str = Field(validation_alias=AliasChoices("setting", "knob"))
    quantity: Literal["position", "velocity", "acceleration"]
    digits: float | None
    digits_attainable: float | None = None
    microseconds: NonNegativeFloat | None
    spread: NonNegativeFloat | None = None
    scene_class: str = Field(validation_alias=AliasChoices("scene_class", "class"))


class EffectRow(_Row):
    """What one effect adds to the time of an engine, and whether it changes what was called for."""

    engine: str
    effect: str
    microseconds: float | None
    inert: bool | None
    largest_change: float | None = None


class HardCaseRow(_Row):
    """What one route made of one hard case."""

    engine: str
    route: str
    case: str
    verdict: Literal["correct", "warned", "refused", "wrong", "crash", "hang"]
    # `class` is a word of Python's; what a file says under it is kept as it is.
    quote: str | None = ""
    note: str | None = ""


KINDS: dict[str, type[_Row]] = {"price": PriceRow, "effects": EffectRow, "hard_cases": HardCaseRow}


def measured(folder: Path) -> tuple[dict[str, Rows | None], list[str]]:
    """Return the rows of each kind (None: not measured), and what is wrong with the files."""
    found: dict[str, Rows | None] = {}
    faults = []
    for name, kind in KINDS.items():
        path = folder / f"{name}.json"
        found[name] = None
        if path.exists():
            try:
                found[name] = _rows(path.read_bytes(), kind)
            except ValidationError as error:
                first = error.errors(include_url=False, include_input=False)[0]
                where = ".".join(map(str, first["loc"])) or "the file"
                faults.append(f"{path.name} cannot be read: {where}: {first['msg']}")
    return found, faults


def _rows(text: bytes, kind: type[_Row]) -> Rows:
    rows: Sequence[_Row] = TypeAdapter(list[kind]).validate_json(text)  # type: ignore[valid-type]
    return [row.model_dump() for row in rows]


class Golden(_Row):
    """How the golden set of a night compares with the accepted baseline."""

    cases: int
    versions: dict[str, str]
    engines: list[str]
    without: list[str]
    found: list[dict[str, Any]]


def read_golden(folder: Path) -> tuple[dict[str, Any] | None, list[str]]:
    """Return what `golden.json` holds (None: the set was not compared), and what is wrong with it."""
    path = folder / "golden.json"
    if not path.exists():
        return None, []
    try:
        return Golden.model_validate_json(path.read_bytes()).model_dump(), []
    except ValidationError as error:
        return None, [f"golden.json cannot be read: {error.errors(include_url=False)[0]['msg']}"]
