"""The keys of scene files, and what may stand behind them: how pydantic reads a file, and what is wrong with it."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from copy import deepcopy
from functools import reduce
from operator import getitem
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, field_validator
from pydantic_core import PydanticCustomError

from refkin.errors import MOST, Fault
from refkin.joints import (
    DRIVER_TYPES,
    GROUND,
    JOINT_TYPES,
    KINDS,
    PLANE,
    SPACE,
    SPATIAL_DRIVER_TYPES,
    SPATIAL_JOINT_TYPES,
    Constraint,
    Driver,
)
from refkin.joints.checks import WrongCount, mechanism_faults, scene_faults
from refkin.joints.elements import BODIES
from refkin.model import Body, Effect, Evidence, Point
from refkin.scenes import DEEPEST, MOST_TIMES, SCHEMA
from refkin.scenes.explained import GROUPS, KEYS, TYPES, UnknownKey, at, unconnected

if TYPE_CHECKING:
    AnyJoint = Constraint
    AnyDriver = Driver
    SpatialJoint = AnyJoint
    SpatialDriver = AnyDriver
else:
    AnyJoint, AnyDriver, SpatialJoint, SpatialDriver = (
        Annotated[Union[types], Field(discriminator="type")]  # noqa: UP007 (a union of a tuple)
        for types in (JOINT_TYPES, DRIVER_TYPES, SPATIAL_JOINT_TYPES, SPATIAL_DRIVER_TYPES)
    )


class _Strict(BaseModel):
    # Built when a file of the plane, or of space, is first read: each takes 40 ms.
    model_config = ConfigDict(extra="forbid", strict=True, defer_build=True)


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
                grid[key] = None
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


def read(data: Any) -> tuple[SceneFile | None, list[Fault]]:
    """Return the scene file that data describe, None if keys or types are wrong, and all that is wrong with it.

    Where more is wrong with keys and types than is told, nothing further is looked for: it takes the square of their
    number.
    """
    try:
        file = _read(data)
    except ValidationError as error:
        faults = list(_lengths(error.errors(include_url=False)))
        return None, [*faults, *(_further_faults(data, error) if len(faults) <= MOST else ())]
    return file, _meaning(file)


def schema() -> dict[str, Any]:
    """Return the JSON schema of scene files."""
    both: Any = TypeAdapter(SceneFile | SpatialSceneFile)
    made: dict[str, Any] = both.json_schema(by_alias=True)
    parts, either = made["$defs"], {name: made["$defs"].pop(name) for name in ("Body", "Point")}
    for file, kind in (("SceneFile", PLANE), ("SpatialSceneFile", SPACE)):
        for name, key, count in (("Body", "estimate", kind.width), ("Point", "position", kind.dimension)):
            own = parts[f"{kind.name}{name}"] = deepcopy(either[name])
            value = own["properties"][key]
            value.get("anyOf", [value])[0].update(minItems=count, maxItems=count)  # an estimate may be null as well
            parts[file]["properties"][name.lower()]["items"] = {"$ref": f"#/$defs/{kind.name}{name}"}
    return made


def _read(data: Any) -> SceneFile:
    """Return the file; raises ValidationError."""
    # Through JSON, because there a list may stand for a tuple although the reading is strict.
    spatial = isinstance(data, dict) and _dimension(data) == SPACE.name
    return (SpatialSceneFile if spatial else SceneFile).model_validate_json(json.dumps(data))


def _dimension(data: dict[str, Any]) -> str:
    """Return the dimension of a file; if it has none, or a wrong one, that of which less in it is wrong."""
    if (own := data.get("dimension")) in (PLANE.name, SPACE.name):
        return str(own)
    return min((PLANE.name, SPACE.name), key=lambda name: _errors({**data, "dimension": name}))


def _errors(data: Any) -> tuple[int, int]:
    """Return in how many bodies, joints, drivers keys or types are wrong, and how many are.

    A key that is missing says nothing of what a file is meant to be.
    """
    try:
        _read(data)
    except ValidationError as error:
        found = error.errors(include_url=False)
        wrong = [e["loc"] for e in found if e["type"] != "missing" or isinstance(e["loc"][-1], int)]  # short rows count
        return len({place[:2] for place in wrong}), len(wrong)
    return 0, 0


def _meaning(file: SceneFile, whole: bool = True) -> list[Fault]:
    """Return what is wrong with a file whose keys and types are right; `whole`: with all its joints and drivers."""
    grid = list(file.times.faults())
    times = file.times.values or () if grid else file.times.times()
    mechanism = SimpleNamespace(bodies=file.body, joints=file.joint, drivers=file.driver)
    wanted = {"points": file.point, "bodies_wanted": file.bodies_wanted}
    scene = scene_faults(SimpleNamespace(mechanism=mechanism, times=times, **wanted))
    loose = list(unconnected(file.body, (*file.joint, *file.driver))) if whole else []
    of_mechanism = list(mechanism_faults(mechanism))
    misnamed = any(f.choices and f.path.startswith(("joint", "driver")) for f in of_mechanism)
    faults = [*grid, *of_mechanism, *([] if misnamed else loose), *scene]  # whom the misnamed ties is not known
    # A rod of space spins about its line, and needs a row fewer, by what its joints are to tie.
    spin = isinstance(file, SpatialSceneFile) and any(f.expected == "two different bodies" for f in of_mechanism)
    # What comes of what is wrong already:
    follows = {"times": grid and not times, "driver": loose or not whole or spin}
    return [f for f in faults if not follows.get(f.path)]


def _further_faults(data: Any, error: ValidationError) -> list[Fault]:
    """Return what else is wrong beside wrong keys and types: whatever stands at the places that cannot be read.

    Those places are filled in two ways; what is found with both does not come of what they were filled with.
    """
    unread = [_fault(e).path for e in error.errors(include_url=False)]
    items = [re.fullmatch(r"((?:joint|driver)(?:\[\d+\])?)(?:\.type)?", path) for path in unread]
    places = [item[1] for item in items if item]
    names = [at(f"{place}.name", data) for place in places]
    lost = {name if isinstance(name, str) else None for name in names}
    lost |= {None for path in unread if path not in KEYS[""] and isinstance(at(path, data), list) and "[" not in path}
    (file, hidden), (other_file, other_hidden) = (_filled(data, way) for way in (0, 1))
    # Where joints are lost it is not known whom they tie, how many rows they have, and what they are.
    one, other = ([] if each is None else _meaning(each, whole=not lost) for each in (file, other_file))
    inside, same = tuple(f"{path}{sign}" for path in unread for sign in ".["), set(map(str, other))
    faults = [f for f in one if str(f) in same and f.path not in unread and not f.path.startswith(inside)]
    faults = [f for f in faults if not (f.path.endswith(".joint") and lost & {f.value, None})]
    counted = [path.removesuffix("argument") + "value" for path in unread if path.endswith("law.argument")]
    faults = [f for f in faults if f.path not in counted]  # how many values there have to be is not known
    if any(path.startswith("times.values") for path in unread):
        faults = [f for f in faults if f.path != "times"]  # what is said of them all
    # What such a joint lacks was filled in, too.
    within = tuple(f"{place}." for place in places)
    faults = [f for f in faults if not f.path.startswith(within) or at(f.path, data) is not None]
    return [*(f for f in hidden if f in other_hidden), *faults]


def _filled(given: Any, way: int) -> tuple[SceneFile | None, list[Fault]]:
    """Return the file with something of the right type at each place that cannot be read, in one of two ways.

    What a place lacks may show only when it was filled; None if that comes to no end. And what so shows to be wrong
    with what stands in the file itself, such as the members of a list of the wrong length.
    """
    data = {**deepcopy(given), "schema": SCHEMA} if isinstance(given, dict) else {}
    hidden: list[Fault] = []
    for k in range(DEEPEST):
        try:
            return _read(data), hidden
        except ValidationError as error:
            for e in error.errors(include_url=False):
                stands = e["input"] is not None and at(_path(e["loc"]), given) == e["input"]
                if k and stands and e["type"] not in UNKNOWN_KEY:
                    hidden.append(_fault(e))
                *tables, key = _parts(e["loc"])
                with suppress(LookupError, TypeError, AttributeError):  # a place that was filled from further out
                    _fill(reduce(getitem, tables, data), key, e, way, data)
    return None, hidden


def _fill(holder: Any, key: Any, error: Any, way: int, data: Any) -> None:
    """Put into a table or list of a file what pydantic, by an error, asks for there."""
    kind, context = error["type"], error.get("ctx", {})
    words = re.findall(r"'([^']*)'", str(context.get("expected_tags", context.get("expected", ""))))
    if kind in UNKNOWN_KEY:
        del holder[key]
    elif kind == "missing" and isinstance(holder, list):
        holder.append(None)  # the next round says what it should be
    elif kind in ("union_tag_invalid", "union_tag_not_found"):
        holder[key][context["discriminator"].strip("'")] = words[way] if words else ""
    elif kind == "too_long":
        del holder[key][context["max_length"] :]
    elif words:
        holder[key] = words[way % len(words)]
    elif kind == "string_type":
        used, known = _names(data)
        free = [name for name in used if name not in known] if key == "name" else [GROUND, *known]
        holder[key] = [*free, "", "-"][way]
    elif kind == "tuple_type" and key == "body" and way == 0:
        holder[key] = [{"name": name} for name in dict.fromkeys(_names(data)[0]) if name != GROUND]
    elif kind == "dimension":
        holder[key] = _dimension(data)
    else:
        holder[key] = {
            "missing": None, "float_type": (1.0, 0.75)[way], "int_type": 2 + way, "bool_type": False, "tuple_type": [],
        }.get(kind, {})  # fmt: skip


def _names(data: Any) -> tuple[list[str], list[str]]:
    """Return the names by which bodies, and joints, are called in a file, and those that they have."""
    items = [item for g in GROUPS if isinstance(data.get(g), list) for item in data[g] if isinstance(item, dict)]
    used = [item.get(key) for item in items for key in ("body", *BODIES, "relative_to", "joint")]
    wanted = data.get("bodies_wanted")
    used += wanted if isinstance(wanted, list) else []
    return [x for x in used if isinstance(x, str)], [x["name"] for x in items if isinstance(x.get("name"), str)]


def _fault(error: Any) -> Fault:
    """Return one of pydantic's findings as a fault, with the path as it is written in the file."""
    path, value = _path(error["loc"]), error.get("input")
    kind, context = error["type"], error.get("ctx", {})
    if kind == "missing":
        return Fault(path, None, MISSING_KEY)
    if kind in UNKNOWN_KEY:
        return UnknownKey(path, value, "no such key")
    if kind in ("too_short", "too_long"):
        asked = context.get("min_length", context.get("max_length"))
        return WrongCount(path, value, f"{asked} {_items(path)}, not {context.get('actual_length', 'these')}")
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        key, known = context["discriminator"].strip("'"), context.get("expected_tags")
        choices = tuple(re.findall(r"'([^']*)'", known or ""))  # pydantic's text: it hands over no list
        return Fault(f"{path}.{key}", value.get(key), f"one of {known}" if known else MISSING_KEY, choices=choices)
    expected = error["msg"].removeprefix("Input should be ")
    plain = _PLAIN.get(expected, expected.replace("a valid ", "a "))
    return Fault(
        path, value, f"{plain}, not null" if value is None else plain
    )  # None says elsewhere that none is there


def _parts(loc: Any) -> list[Any]:
    """Return the keys and indices of a place, without the types and kinds that pydantic names on the way to it."""
    return [part for k, part in enumerate(loc) if part not in _TAGS or k == len(loc) - 1]


def _path(loc: Any) -> str:
    """Return a place as it is written in a message."""
    path = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in _parts(loc))
    return path.removeprefix(".") or "file"


def _items(path: str) -> str:
    return "laws" if path.endswith("law") else "numbers"


def _lengths(errors: Iterable[Any]) -> Iterator[Fault]:
    """Yield pydantic's findings as faults, with one for all the numbers that a list lacks."""
    lacking: dict[str, list[int]] = {}
    for error in errors:
        place = re.fullmatch(r"(.*[a-z_])\[(\d)\]", _path(error["loc"]))
        if place and error["type"] == "missing" and place[1].rpartition(".")[2] not in GROUPS:
            lacking.setdefault(place[1], []).append(int(place[2]))
        else:
            yield _fault(error)
    for path, places in lacking.items():
        yield WrongCount(path, None, f"{max(places) + 1} {_items(path)}, not {min(places)}")


MISSING_KEY = "this key, which is missing"
UNKNOWN_KEY = ("extra_forbidden", "unexpected_keyword_argument")
"""What pydantic calls a key that there is not."""
_PLAIN = {"a valid array": "a list", "an object": "a table of keys", "a valid integer": "an integer"}
_TAGS = {
    *(kind.type for by_dimension in TYPES.values() for kinds in by_dimension.values() for kind in kinds),
    "polynomial",
    "sinusoid",
    "table",
    "disc",
    "polar",
}
