"""The files of a night beside its records: prices, effects, hard cases, the golden set, the documents, the pictures.

Each is a file of plain rows. A file that is not there was not measured; one that cannot be read is a failure of the
night.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    NonNegativeInt,
    PositiveFloat,
    field_serializer,
    model_validator,
)

from crosscheck.judge.known_gaps import KindOfGap
from crosscheck.judge.prices import EffectRow, PriceRow
from crosscheck.judge.records import Strict, adapter, read_file
from crosscheck.scenes.names import called

Rows = list[dict[str, Any]]
VERDICTS = ("correct", "warned", "refused", "wrong", "crash", "hang")


PICTURES = {"width": 300, "height": 190, "scenes": [], "marks": []}
"""No pictures."""


class _Row(BaseModel):
    model_config = ConfigDict(extra="allow", allow_inf_nan=False)


@dataclass(frozen=True, kw_only=True)
class _PriceFile(PriceRow, Strict):
    """A row of the price list, with the class of its scene."""

    scene_class: str


class _HardCaseFile(_Row):
    """How a method did at a case; nothing explains what has no class (`kind`, as `class` is a word of Python's)."""

    engine: str
    method: str
    setting: str = ""
    case: str
    distance: float | None = None
    of: NonNegativeInt = 0
    verdict: Literal["correct", "warned", "refused", "wrong", "crash", "hang"]
    kind: KindOfGap | None = Field(None, alias="class")
    quote: str | None = ""
    note: str | None = ""


KINDS: dict[str, type[Any]] = {"price": _PriceFile, "effects": EffectRow, "hard_cases": _HardCaseFile}


def measured(folder: Path) -> tuple[dict[str, Rows | None], list[str]]:
    """Return the rows of each kind (None: not measured), and what is wrong with the files."""
    rows: dict[str, Rows | None] = {}
    faults: list[str] = []
    for name, kind in KINDS.items():
        read, wrong = read_file(folder / f"{name}.json", list[kind])  # type: ignore[valid-type]
        rows[name] = None if read is None else adapter(list[kind]).dump_python(read, by_alias=True)  # type: ignore[valid-type]
        faults += wrong
    if contradictions := _contradictions(rows["hard_cases"] or ()):
        faults.append(f"hard_cases.json contradicts itself: {contradictions[0]}")
    for row in (*(rows["effects"] or ()), *(rows["hard_cases"] or ())):
        row["method"] = called(row["method"], row.get("setting", ""))
    return rows, faults


def _contradictions(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return where rows of hard cases cannot all be true: of so many cases each method is asked each once."""
    met = Counter((row["engine"], row["method"], row["setting"], row["case"], row["distance"]) for row in rows)
    told = [
        f"{engine} · {called(method, setting)} was asked {case} at {distance} twice"
        for (engine, method, setting, case, distance), count in met.items()
        if count > 1 and distance is not None  # an older version wrote none
    ]
    of, cases = sorted({row["of"] for row in rows}), len({(row["case"], row["distance"]) for row in rows})
    if len(of) > 1:
        told.append(f"of {' and of '.join(map(str, of))} cases")
    elif of and 0 < of[0] < cases:
        told.append(f"{cases} of {of[0]} cases")
    return told


class Documents(_Row):
    """The source documents recomputed, and the experiments on convergence that they describe."""

    newton_histories: Rows
    slopes: Rows
    iterations: Rows
    documents: dict[str, Any] | None


class _Series(_Row):
    """The course of one time over nights: one value for each, and {place of a change: its factor}."""

    name: str
    priced: bool = False
    nights: Annotated[list[str], Field(min_length=1)]
    values: list[PositiveFloat]
    changes: dict[NonNegativeInt, PositiveFloat]

    @model_validator(mode="after")
    def _of_its_nights(self) -> Self:
        if len(self.values) != (count := len(self.nights)) or max(self.changes, default=0) >= count:
            raise ValueError(f"expected {count} values, and changes at places below {count}")
        return self

    @field_serializer("changes")
    def _as_in_json(self, changes: dict[int, float]) -> dict[str, float]:
        return {str(place): factor for place, factor in changes.items()}


class Trends(_Row):
    """The nights that were kept, and the course of what they cost."""

    nights: list[str]
    series: list[_Series]
    not_shown: int = 0


Place = Annotated[list[float], Field(min_length=2, max_length=6)]
"""Where a part is: pixels and degrees, and of space how it is stretched, and how far in front it lies."""
Pin = Annotated[list[float], Field(min_length=2, max_length=2)]
Arrow = Annotated[list[float], Field(min_length=6, max_length=6)]


class _DrawnScene(_Row):
    """A scene's mechanism, as `moving_parts` has drawn it: of space, with `fit` beside it."""

    name: str
    key: str
    ground: list[Place]
    guide: str
    parts: list[_DrawnPart]
    frames: list[list[Place]]


class _DrawnPart(_Row):
    path: str
    pins: list[Pin]
    guide: str


class _Cycle(_Row):
    factor: float
    frames: list[list[Place] | None]


class _Mark(_Row):
    """Of whose fewest digits a picture is, in which scene, and where parts are in it."""

    engine: str
    method: str
    quantity: str
    decade: int
    digits: float
    time: float
    factor: float
    pose: list[Place]
    ghost: list[Place]
    arrows: list[Arrow]
    cycle: _Cycle | None
    scene: NonNegativeInt


class Pictures(_Row):
    """Scenes in motion, and the marks whose pictures they are."""

    width: int
    height: int
    scenes: list[_DrawnScene]
    marks: list[_Mark]

    @model_validator(mode="after")
    def _of_its_scenes(self) -> Self:
        if max((mark.scene for mark in self.marks), default=-1) >= len(self.scenes):
            raise ValueError(f"expected marks of scenes below {len(self.scenes)}")
        for mark in self.marks:
            parts = len(self.scenes[mark.scene].parts)
            frames = (mark.pose, mark.ghost, *((mark.cycle and mark.cycle.frames) or ()))
            if max(len(places or ()) for places in frames) > parts:
                raise ValueError(f"expected places of {parts} parts in every mark of scene {mark.scene}")
        return self
