"""Scene files: TOML (or JSON) <-> Scene.

The keys of a joint are the fields of its dataclass: a new joint needs no line here, nor where files are read (`keys`).
"""

from __future__ import annotations

import json
import math
import re
import sys
import tomllib
from dataclasses import MISSING, fields, replace
from datetime import date, time
from os import PathLike
from pathlib import Path
from typing import Any

from refkin.errors import Fault, InvalidRequest, InvalidScene, expect
from refkin.model import Mechanism, Scene
from refkin.scenes import DEEPEST, SCHEMA
from refkin.scenes.explained import GROUPS, at, explained

LONGEST_INTEGER = 14_000
"""Bits of an integer that Python writes in decimals."""

SURROGATE, TEXT = re.compile("[\ud800-\udfff]"), "text without half of a character (a lone surrogate)"


def load(path: str | Path) -> Scene:
    """Read a scene file; `.json` is read as JSON, everything else as TOML.

    Raises
    ------
    InvalidScene
        With every fault of the file, each with its key, the value and what was expected.
    """
    expect("path", path, str, PathLike)
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
        data = json.loads(text, object_pairs_hook=_once) if path.suffix == ".json" else tomllib.loads(text)
    except OSError as error:
        raise InvalidScene([Fault("file", str(path), f"a readable file ({error.strerror})")], str(path)) from error
    except UnicodeDecodeError as error:
        line = 1 + error.object[: error.start].count(b"\n")
        fault = Fault("file", error.object[error.start : error.start + 1], "UTF-8 text", f"line {line}")
        raise InvalidScene([fault], str(path)) from error
    except RecursionError as error:
        raise InvalidScene(
            [Fault("file", str(path), f"at most {DEEPEST} levels of tables and lists")], str(path)
        ) from error
    except ValueError as error:  # of the format; or of a number with more digits than Python reads
        raise InvalidScene([Fault("file", str(error), "TOML (or JSON in a .json file)")], str(path)) from error
    return parse(data, str(path), "" if path.suffix == ".json" else text)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object; a key that stands twice in it is an error, as it is in TOML."""
    table = dict(pairs)
    if len(table) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ValueError(f"the key {next(k for k in keys if keys.count(k) > 1)!r} twice in one object")
    return table


def parse(data: Any, source: str = "scene", text: str = "") -> Scene:
    """Return the scene that a parsed scene file describes; raises InvalidScene as `load` does.

    Parameters
    ----------
    data : dict
        What the file holds, as TOML or JSON gives it.
    source : str
        What faults call it.
    text : str
        The file itself, if it is TOML: then faults name their lines.
    """
    from refkin.scenes import keys  # here: pydantic is loaded when a file is read

    every: list[Fault] = []
    given, data = data, _readable(data, "", every)
    paths = {fault.path for fault in every}
    file, of_keys = keys.read(data)
    every += of_keys
    if every or file is None:
        kept = [f for k, f in enumerate(every) if k < len(paths) or f.path not in paths]
        raise InvalidScene(explained((_quoted(f, given) for f in kept), data, text), source)
    return Scene(
        mechanism=Mechanism(file.body, file.joint, file.driver),
        times=file.times.times(),
        name=file.name,
        effects=frozenset(file.effects),
        bodies_wanted=file.bodies_wanted,
        evidence=frozenset(file.evidence),
        points=file.point,
    )


def _quoted(fault: Fault, data: Any) -> Fault:
    """Return a fault with the integer that stands in the file where it was read as infinite, if it can be written."""
    value = at(fault.path, data) if fault.value in (math.inf, -math.inf) else None
    writable = isinstance(value, int) and value.bit_length() < LONGEST_INTEGER
    return replace(fault, value=value) if writable else fault


def _readable(data: Any, path: str, faults: list[Fault], depth: int = 0) -> Any:
    """Return data with only what JSON can say, and note what a scene file cannot hold: dates, endless nesting, no text.

    Half of a pair of surrogates is an escape in JSON, and no character. An integer beyond every float becomes infinite,
    and is found like any other number that is not finite.
    """
    if depth > DEEPEST:
        faults.append(Fault(path, None, f"at most {DEEPEST} levels of tables and lists"))
        return None
    if isinstance(data, dict):
        halves = [k for k in data if SURROGATE.search(str(k))]
        faults += [Fault(f"{path}.{k}" if path else k, k, TEXT) for k in halves]
        data = {k: v for k, v in data.items() if k not in halves}
        return {k: _readable(v, f"{path}.{k}" if path else k, faults, depth + 1) for k, v in data.items()}
    if isinstance(data, list):
        return [_readable(v, f"{path}[{k}]", faults, depth + 1) for k, v in enumerate(data)]
    if isinstance(data, str) and SURROGATE.search(data):
        faults.append(Fault(path, data, TEXT))
        return SURROGATE.sub("\ufffd", data)  # the same for the same name: nothing else is wrong with it
    if isinstance(data, (date, time)):
        faults.append(Fault(path, str(data), "no date or time"))
        return None  # which nothing else may stand on
    if isinstance(data, int) and abs(data) > sys.float_info.max:
        return math.copysign(math.inf, data > 0 or -1)
    return data


def to_dict(scene: Scene) -> dict[str, Any]:
    """Return the scene as the data of a scene file; `parse` gives the same scene back, bit for bit.

    Raises
    ------
    InvalidRequest
        If a law is none of those that a scene file has a `kind` for.
    """
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
    for key, items in zip(GROUPS, groups, strict=True):
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


def _plain(item: Any) -> Any:
    """Return a dataclass as plain data, leaving out what has its default; a law is read again by its `kind`."""
    if isinstance(item, tuple):
        return [_plain(part) for part in item]
    if callable(item) and not hasattr(item, "kind"):
        raise InvalidRequest("scene", "laws that a file can say (a rate only of a driver: `rate_law`)", repr(item))
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
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # TOML has no pairs of surrogates
