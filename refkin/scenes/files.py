"""Scene files: TOML (or JSON) <-> Scene.

The keys of a joint are the fields of its dataclass, so a new joint needs no line here.
"""

from __future__ import annotations

import json
import math
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import MISSING, fields
from datetime import date, time
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, field_validator
from pydantic_core import PydanticCustomError

from refkin.errors import Fault, InvalidScene
from refkin.joints import (
    DRIVER_TYPES,
    JOINT_TYPES,
    KINDS,
    SPATIAL_DRIVER_TYPES,
    SPATIAL_JOINT_TYPES,
    Constraint,
    Driver,
)
from refkin.joints.checks import mechanism_faults, scene_faults
from refkin.model import Body, Effect, Evidence, Mechanism, Point, Scene
from refkin.scenes.explained import explained, unconnected

SCHEMA = 1
MOST_TIMES = 10_000_000
DEEPEST = 20
"""How many tables and lists may stand in each other; a scene needs seven."""

if TYPE_CHECKING:
    AnyJoint = Constraint
    AnyDriver = Driver
    SpatialJoint = Constraint
    SpatialDriver = Driver
else:
    AnyJoint = Annotated[Union[JOINT_TYPES], Field(discriminator="type")]  # noqa: UP007 (a union of a tuple)
    AnyDriver = Annotated[Union[DRIVER_TYPES], Field(discriminator="type")]  # noqa: UP007
    SpatialJoint = Annotated[Union[SPATIAL_JOINT_TYPES], Field(discriminator="type")]  # noqa: UP007
    SpatialDriver = Annotated[Union[SPATIAL_DRIVER_TYPES], Field(discriminator="type")]  # noqa: UP007


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class TimeGrid(_Strict):
    """`start`, `stop` inclusive and `count`; or `values`, strictly increasing [s]."""

    start: float | None = None
    stop: float | None = None
    count: int | None = None
    values: tuple[float, ...] | None = None

    def faults(self) -> Iterator[Fault]:
        """Yield what keeps the grid from being one of its two forms."""
        grid = {"start": self.start, "stop": self.stop, "count": self.count}
        if self.values is not None:
            for key, value in grid.items():
                if value is not None:
                    yield Fault(f"times.{key}", value, "either `values` or `start`, `stop`, `count`")
            return
        for key, value in grid.items():
            if value is None:
                yield Fault(f"times.{key}", None, f"`{key}` (or `values`)")
        for key in ("start", "stop"):
            if grid[key] is not None and not math.isfinite(grid[key]):  # type: ignore[arg-type]
                yield Fault(f"times.{key}", grid[key], "a finite number")
                return
        if self.count is not None and self.count < 1:
            yield Fault("times.count", self.count, "a count of at least 1")
        if self.count is not None and self.count > MOST_TIMES:
            yield Fault("times.count", self.count, f"a count of at most {MOST_TIMES}")
        if None not in grid.values() and self.count > 1 and not self.stop > self.start:  # type: ignore[operator]
            yield Fault("times.stop", self.stop, f"a stop above start = {self.start}")
        elif None not in grid.values() and not math.isfinite(self.stop - self.start):  # type: ignore[operator]
            yield Fault("times.stop", self.stop, f"a stop at a finite distance from start = {self.start}")

    def times(self) -> tuple[float, ...]:
        """Return the times."""
        if self.values is not None:
            return self.values
        return tuple(np.linspace(self.start, self.stop, self.count).tolist())  # type: ignore[arg-type]


class SceneFile(_Strict):
    """The keys of a scene file, with the joints and drivers of the plane."""

    schema_: Literal[1] = Field(alias="schema")
    name: str = "scene"
    dimension: Literal["planar"] = "planar"
    effects: tuple[Effect, ...] = ()
    bodies_wanted: tuple[str, ...] | None = None
    evidence: tuple[Evidence, ...] = tuple(Evidence)
    times: TimeGrid
    body: tuple[Body, ...]
    joint: tuple[AnyJoint, ...] = ()
    driver: tuple[AnyDriver, ...] = ()
    point: tuple[Point, ...] = ()

    @field_validator("schema_", mode="before")
    @classmethod
    def _whole(cls, value: Any) -> Any:
        """Refuse true and 1.0, which equal 1."""
        if isinstance(value, bool | float):
            raise PydanticCustomError("schema", "Input should be {known}", {"known": SCHEMA})
        return value

    @field_validator("dimension", mode="before")
    @classmethod
    def _known(cls, value: Any) -> Any:
        """Refuse what is neither; `_read` has taken the class of the other."""
        if not (isinstance(value, str) and value in KINDS):
            raise PydanticCustomError("dimension", "Input should be {known}", {"known": " or ".join(map(repr, KINDS))})
        return value


class SpatialSceneFile(SceneFile):
    """The same, with the joints and drivers of space."""

    dimension: Literal["spatial"]  # type: ignore[assignment]
    joint: tuple[SpatialJoint, ...] = ()
    driver: tuple[SpatialDriver, ...] = ()


def load(path: str | Path) -> Scene:
    """Read a scene file; `.json` is read as JSON, everything else as TOML.

    Raises
    ------
    InvalidScene
        With every fault of the file, each with its key, the value and what was expected.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
        data = json.loads(text, object_pairs_hook=_once) if path.suffix == ".json" else tomllib.loads(text)
    except OSError as error:
        raise InvalidScene([Fault("file", str(path), f"a readable file ({error.strerror})")], str(path)) from error
    except UnicodeDecodeError as error:
        raise InvalidScene([Fault("file", str(path), "UTF-8 text")], str(path)) from error
    except RecursionError as error:
        raise InvalidScene(
            [Fault("file", str(path), f"at most {DEEPEST} levels of tables and lists")], str(path)
        ) from error
    except ValueError as error:  # of the format; or of a number with more digits than Python reads
        raise InvalidScene([Fault("file", str(error), "TOML (or JSON in a .json file)")], str(path)) from error
    return parse(data, str(path), "" if path.suffix == ".json" else text)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object; a key that stands twice in it is an error, as it is in TOML."""
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ValueError(f"the key {next(k for k in keys if keys.count(k) > 1)!r} twice in one object")
    return found


def parse(data: Any, source: str = "scene", text: str = "") -> Scene:
    """Return the scene that a parsed scene file describes; raises InvalidScene as `load` does.

    With the `text` of a TOML file faults name their lines.
    """
    found: list[Fault] = []
    data = _readable(data, "", found)
    paths = {fault.path for fault in found}
    try:
        file = _read(data)
    except ValidationError as error:
        found += _lengths(_fault(e) for e in error.errors(include_url=False))
        found += _further_faults(data, error)
    else:
        found += _meaning(file)
    if found:
        kept = [f for k, f in enumerate(found) if k < len(paths) or f.path not in paths]
        raise InvalidScene(explained(kept, data, text), source)
    return Scene(
        mechanism=Mechanism(file.body, file.joint, file.driver),
        times=file.times.times(),
        name=file.name,
        effects=frozenset(file.effects),
        bodies_wanted=file.bodies_wanted,
        evidence=frozenset(file.evidence),
        points=file.point,
    )


def _read(data: Any) -> SceneFile:
    # Through JSON, because there a list may stand for a tuple although the reading is strict.
    spatial = isinstance(data, dict) and data.get("dimension") == "spatial"
    return (SpatialSceneFile if spatial else SceneFile).model_validate_json(json.dumps(data))


def _readable(data: Any, path: str, found: list[Fault], depth: int = 0) -> Any:
    """Return data with only what JSON can say, and note what a scene file cannot hold: dates, and endless nesting.

    An integer beyond every float becomes infinite, and is found like any other number that is not finite.
    """
    if depth > DEEPEST:
        found.append(Fault(path, None, f"at most {DEEPEST} levels of tables and lists"))
        return None
    if isinstance(data, dict):
        return {k: _readable(v, f"{path}.{k}" if path else k, found, depth + 1) for k, v in data.items()}
    if isinstance(data, list):
        return [_readable(v, f"{path}[{k}]", found, depth + 1) for k, v in enumerate(data)]
    if isinstance(data, (date, time)):
        found.append(Fault(path, str(data), "no date or time"))
        return str(data)
    if isinstance(data, int) and abs(data) > sys.float_info.max:
        return math.copysign(math.inf, data > 0 or -1)
    return data


def _meaning(file: SceneFile) -> list[Fault]:
    """Return what is wrong with a file whose keys and types are right."""
    grid = list(file.times.faults())
    times = () if grid else file.times.times()
    mechanism = SimpleNamespace(bodies=file.body, joints=file.joint, drivers=file.driver)
    wanted = {"points": file.point, "bodies_wanted": file.bodies_wanted}
    scene = scene_faults(SimpleNamespace(mechanism=mechanism, times=times, **wanted))
    loose = unconnected(file.body, (*file.joint, *file.driver))
    found = [*grid, *mechanism_faults(mechanism), *loose, *scene]
    return [f for f in found if not (grid and f.path == "times")]


def _further_faults(data: Any, error: ValidationError) -> list[Fault]:
    """Return what else is wrong beside wrong keys and types: the meaning of the parts that can be read.

    The parts that cannot are left out, and so is every finding that leaving them out might have brought about.
    """
    bad = {e["loc"][:2] if e["loc"][0] in _GROUPS else e["loc"][:1] for e in error.errors() if e["loc"]}
    if not isinstance(data, dict) or any((group,) in bad for group in ("body", "times")):
        return []
    kept = {g: [k for k in range(len(data.get(g, ()))) if (g, k) not in bad] for g in _GROUPS if (g,) not in bad}
    whole = {key: value for key, value in data.items() if key not in _GROUPS and (key,) not in bad}
    parts = {g: [data[g][k] for k in places] for g, places in kept.items() if g in data}
    try:
        file = _read({**whole, **parts, "schema": SCHEMA})
    except ValidationError:
        return []
    unread = {str(data[g][k].get("name")) for g, k in (b for b in bad if len(b) == 2) if isinstance(data[g][k], dict)}
    found = []
    for fault in _meaning(file):
        group, _, rest = fault.path.partition("[")
        if group in kept and rest:
            place, _, tail = rest.partition("]")
            fault = Fault(f"{group}[{kept[group][int(place)]}]{tail}", fault.value, fault.expected)
        names_unread = isinstance(fault.value, str) and fault.value in unread
        if (rest or group.startswith("times")) and not names_unread:
            found.append(fault)
    return found


def to_dict(scene: Scene) -> dict[str, Any]:
    """Return the scene as the data of a scene file; `parse` gives the same scene back, bit for bit."""
    data: dict[str, Any] = {
        "schema": SCHEMA,
        "name": scene.name,
        "dimension": scene.mechanism.kind.name,
        "effects": sorted(scene.effects),
        "evidence": sorted(scene.evidence),
    }
    if scene.bodies_wanted is not None:
        data["bodies_wanted"] = list(scene.bodies_wanted)
    data["times"] = {"values": list(scene.times)}
    groups = (scene.mechanism.bodies, scene.mechanism.joints, scene.mechanism.drivers, scene.points)
    for key, items in zip(("body", "joint", "driver", "point"), groups, strict=True):
        if items:
            data[key] = [_plain(item) for item in items]
    return data


def to_toml(scene: Scene) -> str:
    """Return the scene as the text of a scene file."""
    lines, tables = [], []
    for key, value in to_dict(scene).items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            tables += [line for item in value for line in ("", f"[[{key}]]", *_entries(item))]
        elif isinstance(value, dict):
            tables = ["", f"[{key}]", *_entries(value), *tables]
        else:
            lines.append(f"{key} = {_toml(value)}")
    return "\n".join([*lines, *tables, ""])


def schema() -> dict[str, Any]:
    """Return the JSON schema of scene files, for editors."""
    both: Any = TypeAdapter(SceneFile | SpatialSceneFile)
    return both.json_schema(by_alias=True)  # type: ignore[no-any-return]


def _plain(item: Any) -> Any:
    """Return a dataclass as plain data, leaving out what has its default."""
    if isinstance(item, tuple):
        return [_plain(part) for part in item]
    if not hasattr(item, "__dataclass_fields__"):
        return item
    keep = {}
    for key in fields(item):
        value = getattr(item, key.name)
        if key.name in ("type", "kind") or key.default is MISSING or value != key.default:
            keep[key.name] = _plain(value)
    return keep


def _entries(table: dict[str, Any]) -> list[str]:
    return [f"{key} = {_toml(value)}" for key, value in table.items()]


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(_entries(value)) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, float):
        return repr(float(value))
    return json.dumps(value)


def _fault(error: Any) -> Fault:
    """Return one of pydantic's findings as a fault, with the path as it is written in the file."""
    path = "" if error["loc"] else "file"
    for k, part in enumerate(error["loc"]):
        if isinstance(part, int):
            path += f"[{part}]"
        elif part not in _TAGS or k == len(error["loc"]) - 1:
            path += f".{part}" if path else part
    value = error.get("input")
    kind, context = error["type"], error.get("ctx", {})
    if kind == "missing":
        return Fault(path, None, MISSING_KEY)
    if kind in ("extra_forbidden", "unexpected_keyword_argument"):
        return Fault(path, value, "no such key")
    if kind in ("too_short", "too_long"):
        asked = context.get("min_length", context.get("max_length"))
        return Fault(path, value, f"{asked} {_items(path)}, not {context.get('actual_length', 'these')}")
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        key = context["discriminator"].strip("'")
        return Fault(f"{path}.{key}", context.get("tag"), f"one of {context.get('expected_tags', 'the known ones')}")
    return Fault(path, value, error["msg"].removeprefix("Input should be ").removeprefix("a valid "))


def _items(path: str) -> str:
    return "laws" if path.endswith("law") else "numbers"


def _lengths(faults: Iterable[Fault]) -> Iterator[Fault]:
    """Yield the faults, with one for all the numbers that a list lacks."""
    lacking: dict[str, list[int]] = {}
    for fault in faults:
        place = re.fullmatch(r"(.*[a-z_])\[(\d)\]", fault.path)
        if place and fault.expected == MISSING_KEY and place[1].rpartition(".")[2] not in _GROUPS:
            lacking.setdefault(place[1], []).append(int(place[2]))
        else:
            yield fault
    for path, places in lacking.items():
        yield Fault(path, None, f"{max(places) + 1} {_items(path)}, not {min(places)}")


MISSING_KEY = "this key, which is missing"
_GROUPS = ("body", "joint", "driver", "point")
_TAGS = {
    *(c.__dataclass_fields__["type"].default for c in (*JOINT_TYPES, *DRIVER_TYPES)),
    *(c.__dataclass_fields__["type"].default for c in (*SPATIAL_JOINT_TYPES, *SPATIAL_DRIVER_TYPES)),
    "polynomial",
    "sinusoid",
    "table",
    "disc",
    "polar",
}
