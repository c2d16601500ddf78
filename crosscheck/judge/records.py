"""The one `Record` of a scene: written by measurement as a line of JSON, read by judgement and report.

Everything that is decided later is a field of its own: what a comparison failed at is a `Cause`, a place is a component
and a time, a refusal names engine, joint and level. No text is ever taken apart again.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    ConfigDict,
    Field,
    NonNegativeFloat,
    NonNegativeInt,
    StringConstraints,
    TypeAdapter,
    ValidationError,
)

from crosscheck.scenes.names import QUANTITIES as QUANTITIES

MOST_DIGITS = 17.0
"""What a sample without any error is given: binary64 holds no more."""

Key = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{16}\z")]
"""What names a scene, and its files: nothing else is a name."""
Histogram = dict[Annotated[int, Field(le=10 * MOST_DIGITS)], NonNegativeInt]
"""Digits in whole tenths, rounded down -> how often."""
By = dict[int, Histogram]
"""Decade of sigma_min, the distance to a singular pose -> the digits met there."""


BEYOND_NEWTON = 2.0
"""sigma_min over a step below which Newton, started at the last pose, is not bound to the next (`known_gaps`)."""


class Strict:
    """What is read from a line holds nothing that is not known, and finite numbers."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)


class Cause(StrEnum):
    """What is wrong with an answer."""

    BEYOND = "beyond the allowed error"
    OTHER_ASSEMBLY = "other assembly"
    """It solves the constraints, and is the linkage put together another way."""
    ORDER = "depends on how a scene is stated"
    """With bodies, joints and drivers in another order, and directions of other lengths, the answer is another."""
    AGAIN = "differs when asked again"
    """Asked the same once more, it answers otherwise, or nothing: what it was asked in between matters, or chance."""
    NO_NUMBER = "status ok without a number"
    """NaN, or an infinite number, at a time whose status is ok."""
    NO_ANSWER = "no answer"
    """To a regular scene, from an engine that refuses nothing of it."""
    NOT_DELIVERED = "not delivered"
    """A level or a body that was asked for, by an engine that does not say that it never has it."""
    UNDOCUMENTED = "undocumented error term"
    """An allowance larger than rounding that no documentation of the engine states."""
    NO_ASSEMBLY = "ok where there is no assembly"
    SINGULAR_RATES = "rates in a singular pose"
    """Velocity or acceleration, called ok, of a pose in which they do not exist."""
    LOCKED_RATES = "rates of a mechanism that is locked"
    """Velocity or acceleration, called ok, where redundant rows contradict each other in it."""
    CHANGED = "changed the scene that it was given"
    """Whoever is asked after it would be asked something else: every other engine is handed another copy."""
    UNCLOSED = "ok where joints are open"
    """A pose, called ok where no answer has a bound, that leaves more of a residual than rounding does; or rates."""
    REVERSED = "joint put together the wrong way round"
    """In space: axes that must have one direction have opposite ones, or a driven angle is off by half a turn."""
    TRANSLATED = "model translated wrongly"
    """The engine's own rows are not those of the scene."""
    CRASH = "crash"
    """The engine ended its process."""
    HANG = "hang"
    """It took too long, and was ended."""
    ERROR = "error"
    """It raised what is no refusal."""
    REFERENCE = "reference"
    """The reference itself is not ok: `how` is its status."""
    LEFT_PROOF = "golden set: the reference has left its proof"
    DIGITS_LOST = "golden set: digits lost"
    """A method has fewer than it had, and than rounding explains."""


ENDED = (Cause.CRASH, Cause.HANG, Cause.ERROR)
"""Kinds in which an engine gave no answer because something ended it."""


@dataclass(frozen=True)
class At(Strict):
    """Where a number was met: a coordinate and a time, or a row of an engine."""

    component: str
    time: float | None = None

    def __str__(self) -> str:
        return self.component if self.time is None else f"{self.component} at t = {self.time:.17g}"


@dataclass(frozen=True, kw_only=True)
class Quantity(Strict):
    """One quantity of an answer.

    `ratio` is the largest error / allowed, infinity as the largest double, None if nothing was compared, and `worst`
    where that was met; `common` are the signed errors per scaled coordinate at the one time at which answers are
    compared with each other.
    """

    ratio: NonNegativeFloat | None
    digits_by_sigma: By
    worst: At | None = None
    common: list[float | None] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class MethodData(Strict):
    """Who did what on the way to an answer."""

    name: str
    residual_by: str
    jacobian_by: str
    newton_by: str
    linear_solve_by: str
    drift_by: str
    seeding: str


@dataclass(frozen=True, kw_only=True)
class EnclosedTimes(Strict):
    """At how many times an answer lies within the least error of the certified pose (113 bits), and beyond it."""

    inside: NonNegativeInt
    outside: NonNegativeInt
    undecidable: NonNegativeInt
    no_answer: NonNegativeInt
    radii: float | None = None
    """The farthest, in least errors."""


@dataclass(frozen=True, kw_only=True)
class Answer(Strict):
    """One engine's answer to one scene by one method: none at `missing` times, compared at `compared`.

    `feature`: by a feature of the engine that its other methods avoid. `granted`: the error terms that the engine's
    documentation grants it beyond rounding, by name [sizes].
    """

    engine: str
    version: str
    method: MethodData
    quantities: dict[str, Quantity]
    missing: NonNegativeInt
    compared: NonNegativeInt
    times: NonNegativeInt
    seconds: NonNegativeFloat
    certificate: EnclosedTimes | None = None
    feature: bool = False
    granted: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class LevelRow(Strict):
    """One engine's own rows at one level, compared at configurations that need not be assembled."""

    engine: str
    level: str
    ratio: NonNegativeFloat | None
    digits: Histogram
    rows: NonNegativeInt
    worst: At | None = None


@dataclass(frozen=True, kw_only=True)
class Common(Strict):
    """The one time of a scene at which answers are compared with each other, and what their errors relate to."""

    k: NonNegativeInt
    scale: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class ReferenceRow(Strict):
    """What the reference says of a scene; `sigma_min` is the smallest over its times.

    `sigma_per_step` is the smallest sigma_min of a step over what a coordinate changes by in it, `excuse` (time,
    sigma_min) a nearly singular pose that excused an engine for giving no answer. `sharpness` has of some scenes, by
    quantity, the largest component of what is allowed over that of the sensitivity to the input, and the smallest of
    any component, at one time (`crosscheck.judge.samples`). `redundant` is a mechanism of more rows than coordinates.
    """

    verdict: str
    statuses: dict[str, NonNegativeInt]
    sigma_min: NonNegativeFloat
    residual: NonNegativeFloat | None
    seconds: NonNegativeFloat
    message: str = ""
    sigma_per_step: float | None = None
    redundant: bool = False
    excuse: tuple[float, float] | None = None
    sharpness: dict[str, tuple[float, float]] = field(default_factory=dict)
    certified_radius: dict[str, float | None] = field(default_factory=dict)
    common: Common | None = None
    rounding_by_sigma: dict[str, By] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class RefusalRow(Strict):
    """What an engine refuses: one joint at one level for a reason, or, with `joint` empty, a scene."""

    engine: str
    reason: str
    joint: str = ""
    name: str = ""
    level: str = ""

    def __str__(self) -> str:
        if not self.joint:
            return self.reason
        return f"{self.engine} refuses {self.joint} {self.name!r} at {self.level}: {self.reason}"


@dataclass(frozen=True, kw_only=True)
class Disagreement(Strict):
    """One engine, method and quantity that is not what it must be.

    `how`: of a crash the signal or exit code, of an error the exception, of the reference its status; `ratio` is error
    / allowed, `at` where that is largest; `violated` names joints and drivers, the most violated first. `bound` says of
    another assembly, or of no answer, that it was met before any step to which Newton is not bound.
    """

    engine: str
    method: str
    quantity: str
    kind: Cause
    how: str = ""
    ratio: float | None = None
    at: At | None = None
    message: str = ""
    violated: list[str] = field(default_factory=list)
    bound: bool = False

    @property
    def name(self) -> str:
        """The kind with how it came, as it is shown."""
        return f"{self.kind} ({self.how})" if self.how else str(self.kind)

    @property
    def worst(self) -> str:
        """Where it is, and what else is known of it, as it is shown."""
        return "; ".join(filter(None, (str(self.at or ""), self.message)))

    def __str__(self) -> str:
        ratio = "" if self.ratio is None else f", {self.ratio:.3g} times the allowed error"
        return f"{self.engine} ({self.method}), {self.quantity}: {self.name}{ratio}; {self.worst}"

    @property
    def signature(self) -> tuple[str, str, str, str]:
        """What makes two disagreements the same one in different scenes."""
        return self.engine, self.method, self.quantity, self.name


def wrong(quantity: str, kind: Cause, message: str = "") -> dict[str, Any]:
    """Return what is wrong with a quantity, or the "status", as a `Disagreement` takes it.

    Parameters
    ----------
    quantity, kind, message : str, Cause, str
    """
    return {"quantity": quantity, "kind": kind, "message": message}


@dataclass(frozen=True, kw_only=True)
class Record(Strict):
    """What was measured of one scene; `reference` is None only with a `failure`.

    `about` is what the generator knows of it, its number in the night as `shard`; `run` the digest of the run that it
    is of (`crosscheck.night.campaign`), "" if it is of none.
    """

    key: Key
    scene: str
    about: dict[str, str | int | float | bool | None]
    answers: list[Answer]
    levels: list[LevelRow]
    refusals: list[RefusalRow]
    disagreements: list[Disagreement]
    reference: ReferenceRow | None = None
    failure: str | None = None
    run: str = ""


@dataclass(kw_only=True)
class NewCase(Strict):
    """A disagreement that no known gap accounts for, and the scene that shows it.

    The scene is that of the record `key`, number `shard` in the night, of which a part was checked if it is
    `shortened`, or of the `case` of the golden set. Its scene `file` is in the folder of the night; `shrunk` says
    whether it was made minimal, `note` what was done for that.
    """

    disagreement: Disagreement
    key: str
    shard: int | None = None
    shortened: bool = False
    case: str = ""
    file: str | None = None
    shrunk: bool = False
    note: str = ""


class Unreadable(ValueError):
    """A line that is no record, and why: the key, its value and what was expected; or a `torn` one, that is no JSON."""

    def __init__(self, reason: str, torn: bool = False, line: int = 0) -> None:
        super().__init__(reason)
        self.reason, self.torn, self.line = reason, torn, line


@cache
def adapter(kind: Any) -> TypeAdapter[Any]:
    """Return what reads and writes a dataclass of rows."""
    return TypeAdapter(kind)


def plain(record: Any) -> dict[str, Any]:
    """Return a record, or a part of one, as plain data: what a line of records.jsonl holds."""
    data: dict[str, Any] = TypeAdapter(type(record)).dump_python(record, mode="json")
    return data


def line_of(record: Record) -> bytes:
    """Return the line of a record; ValueError if it holds a number that is not finite: JSON has none."""
    data = adapter(Record).dump_python(record, exclude_defaults=True)
    return json.dumps(data, allow_nan=False, separators=(",", ":")).encode()


def read_line(line: bytes | str) -> Record:
    """Return the record of a line; raises Unreadable."""
    try:
        record: Record = adapter(Record).validate_json(line)
    except ValidationError as error:
        raise Unreadable(fault(error), error.errors()[0]["type"] == "json_invalid") from error
    if record.reference is None and record.failure is None:
        raise Unreadable("reference: missing; expected one, or a failure")
    for k, answer in enumerate(record.answers):
        if answer.missing + answer.compared > answer.times:
            counted = f"{answer.missing} without an answer and {answer.compared} compared"
            raise Unreadable(f"answers.{k}: {counted}; expected at most {answer.times} in all")
    told = Counter((answer.engine, answer.method.name) for answer in record.answers)
    if twice := [f"{engine} ({method})" for (engine, method), count in told.items() if count > 1]:
        raise Unreadable(f"answers: {', '.join(twice)} more than once; expected each method once")
    return record


def fault(error: ValidationError, under: str = "") -> str:
    """Return the first fault of data: its key `under` another, its value and what was expected, in one line."""
    first = error.errors(include_url=False)[0]
    where = ".".join(filter(None, (under, *map(str, first["loc"])))) or "the line"
    value = "missing" if first["type"] == "missing" else repr(first["input"])
    return f"{where}: {value if len(value) <= 80 else value[:77] + '...'}; {first['msg'][0].lower()}{first['msg'][1:]}"


def read_file(path: Path, kind: Any) -> tuple[Any, list[str]]:
    """Return what a file of a night holds (None: there is none), read as some type, and what is wrong with it."""
    if not path.exists():
        return None, []
    try:
        return adapter(kind).validate_json(path.read_bytes()), []
    except ValidationError as error:
        return None, [f"{path.name} cannot be read: {fault(error)}"]


def _later_of_equals(path: Path) -> set[int]:
    """Return the lines whose scene another line has under a smaller number of the night."""
    first: dict[bytes, tuple[int, int]] = {}
    later = set()
    with path.open("rb") as lines:
        for at, line in enumerate(lines, 1):
            match = KEY_AND_NUMBER.match(line) if line.endswith(b"\n") else None
            if match:
                place = int(match[2]), at
                known = first.setdefault(match[1], place)
                if place[0] != known[0]:
                    first[match[1]] = min(place, known)
                    later.add(max(place, known)[1])
    return later


KEY_AND_NUMBER = re.compile(rb'\{"key":"([^"]*)".*?"shard":(\d+)')
"""At the beginning of a line of a drawn scene."""


def read_records(path: Path) -> Iterator[tuple[int, Record | Unreadable]]:
    """Yield (line number, its record); nothing if there is no such file. One line is in memory at a time.

    Workers race, so a scene may have two lines: only that with the smaller number of the night is read.
    """
    if not path.exists():
        return
    passed_over = _later_of_equals(path)
    with path.open("rb") as lines:
        for number, line in enumerate(lines, 1):
            if number in passed_over:
                continue
            try:
                yield number, read_line(line)
            except Unreadable as error:
                yield number, Unreadable(error.reason, error.torn, number)
