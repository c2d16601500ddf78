"""Faults of a scene file in the words of who wrote it: which joint, at which line, and what was perhaps meant."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, replace
from difflib import get_close_matches
from typing import Any

from refkin.errors import Fault
from refkin.joints import DRIVER_TYPES, GROUND, JOINT_TYPES, SPATIAL_DRIVER_TYPES, SPATIAL_JOINT_TYPES
from refkin.joints.checks import WrongCount
from refkin.model import Body, Point
from refkin.motion_laws import Polynomial, Sinusoid, Table

GROUPS = ("body", "joint", "driver", "point")
KEYS = {
    "": ("schema", "name", "dimension", "effects", "bodies_wanted", "evidence", "times", *GROUPS),
    "times": ("start", "stop", "count", "values"),
    "body": tuple(f.name for f in fields(Body)),
    "joint": tuple({f.name for kind in (*JOINT_TYPES, *SPATIAL_JOINT_TYPES) for f in fields(kind)}),
    "driver": tuple({f.name for kind in (*DRIVER_TYPES, *SPATIAL_DRIVER_TYPES) for f in fields(kind)}),
    "point": tuple(f.name for f in fields(Point)),
    "law": tuple({f.name for law in (Polynomial, Sinusoid, Table) for f in fields(law)}),
}
"""The keys that may stand at a place of a scene file."""
CLOSE = 0.6
"""Similarity, of `difflib`, from which a word is taken for a misspelt one."""
TYPES: dict[str, dict[str, Sequence[Any]]] = {
    "joint": {"planar": JOINT_TYPES, "spatial": SPATIAL_JOINT_TYPES},
    "driver": {"planar": DRIVER_TYPES, "spatial": SPATIAL_DRIVER_TYPES},
}


class UnknownKey(Fault):
    """A key that there is not; if another one was perhaps meant, that is its only choice."""


def explained(faults: Iterable[Fault], data: Any, text: str = "") -> list[Fault]:
    """Return the faults with what was perhaps meant, the name of what they are in, and the line if the text tells it.

    Parameters
    ----------
    faults : iterable of Fault
        As they were found.
    data : dict
        The file as it was read.
    text : str
        The file itself, if it is TOML.
    """
    lines = _lines(text, data) if text else {}
    guessed = [_guessed(fault, data) for fault in faults]
    meant = {re.sub(r"\w+$", word, f.path) for f in guessed if isinstance(f, UnknownKey) for word in f.choices}
    kept = [f for f in guessed if f.value is not None or f.path not in meant]  # a misspelt key is not missing as well
    return [replace(fault, where=_where(fault.path, data, lines)) for fault in kept]


def at(path: str, data: Any) -> Any:
    """Return what stands at a path into the data, None if there is nothing."""
    for key in re.findall(r"\w+", path):
        try:
            data = data[int(key) if isinstance(data, list) else key]
        except (LookupError, TypeError, ValueError):
            return None
    return data


def unconnected(bodies: Sequence[Any], constraints: Sequence[Any]) -> Iterator[Fault]:
    """Yield the bodies that no joint and no driver ties, by way of others or not, to the ground."""
    beside: dict[str, set[str]] = {}
    for i, j, *carrier in (constraint.bodies for constraint in constraints):
        joined = {i, j} if carrier == [GROUND] else {i, j, *carrier}  # wheels in gear are not tied to the ground
        for body in joined:
            beside.setdefault(body, set()).update(joined)
    tied, reached = {GROUND}, [GROUND]
    while reached:
        more = beside.get(reached.pop(), set()) - tied
        tied |= more
        reached += more
    for k, body in enumerate(bodies):
        if body.name not in tied:
            yield Fault(f"body[{k}]", body.name, "a body that joints or drivers tie to the ground")


def _guessed(fault: Fault, data: Any) -> Fault:
    """Return the fault with the word that was perhaps meant."""
    key = fault.path.rpartition(".")[2]
    group = re.split(r"[.\[]", fault.path)[0]
    if isinstance(fault, UnknownKey):
        inner = re.search(r"(law|rate_law|profile)[^.]*\.[^.]*$", fault.path)
        known = KEYS["law"] if inner else KEYS.get(group if "." in fault.path else "", ())
        tables = isinstance(fault.value, list) and all(isinstance(x, dict) for x in fault.value)
        beside = at(fault.path.rpartition(".")[0], data)
        missing = [word for word in known if word == key or not (isinstance(beside, dict) and word in beside)]
        return _meant(fault, key, GROUPS if tables and not inner else missing)
    if fault.path == "dimension" and fault.value is None:
        return replace(fault, expected='"spatial", as the rest of the file is')
    if isinstance(fault, WrongCount):
        return replace(fault, value=at(fault.path, data))
    if fault.path in GROUPS and fault.expected.startswith("a list"):  # as pydantic says that it is none
        rest = fault.expected.removeprefix("a list")
        return replace(fault, expected=f"a list: each {group} under a header [[{group}]]{rest}")
    if fault.value == GROUND and group == "body":
        return replace(fault, expected=f"a name other than {GROUND!r}, which is reserved for the fixed frame")
    for dimension, types in TYPES.get(group, {}).items() if key == "type" else ():
        if fault.value in [kind.type for kind in types] and dimension != data.get("dimension", "planar"):
            return replace(fault, expected=f'{fault.expected}; or dimension = "{dimension}", which has it')
    if group == "driver" and key == "joint" and isinstance(fault.value, str):
        joints = data.get("joint")
        names = [joint.get("name") for joint in joints if isinstance(joint, dict)] if isinstance(joints, list) else []
        return _meant(fault, fault.value, [name for name in names if isinstance(name, str)])
    if isinstance(fault.value, str):
        return _meant(fault, fault.value, fault.choices)
    return fault


def _meant(fault: Fault, word: str, known: Sequence[str]) -> Fault:
    close = [] if word in known else get_close_matches(word, known, 1, CLOSE)
    did = f"{fault.expected} (did you mean {close[0]!r}?)" if close else fault.expected
    return replace(fault, expected=did, choices=tuple(close))


def _where(path: str, data: Any, lines: dict[tuple[str, int], dict[str, int]]) -> str:
    """Return "joint 'A', line 12" for a path into it; as much of it as is known."""
    match = re.match(r"(\w+)\[(\d+)\]\.?(\w*)", path)
    if not match or match[1] not in GROUPS:
        table, _, key = path.partition(".")
        line = lines.get((table, 0), {}).get(key) or lines.get(("", 0), {}).get(re.split(r"[.\[]", path)[0])
        return f"line {line}" if line else ""
    group, place, key = match[1], int(match[2]), match[3]
    try:
        name = data[group][place].get("name")
    except (AttributeError, IndexError, KeyError, TypeError):
        return ""
    parts = [f"{group} {name!r}"] if isinstance(name, str) else []
    own = lines.get((group, place), {})
    return ", ".join(parts + ([f"line {own.get(key, own[''])}"] if own else []))


def _lines(text: str, data: Any) -> dict[tuple[str, int], dict[str, int]]:
    """Return for each table of a group the line of its header, under "", and those of its keys.

    What is in no group is under ("", 0): the keys before all tables, and other tables, such as ("times", 0), by name.
    Nothing of a group of which the text shows another number of headers than there are tables: some are written inline.
    """
    lines: dict[tuple[str, int], dict[str, int]] = {}
    counts = dict.fromkeys(GROUPS, 0)
    own = top = lines["", 0] = {}
    for number, line in enumerate(text.splitlines(), 1):
        header = re.match(r"\s*\[\[\s*(\w+)\s*\]\]", line)
        if header and header[1] in counts:
            own = lines[header[1], counts[header[1]]] = {"": number}
            counts[header[1]] += 1
        elif table := re.match(r"\s*\[+\s*(\w+)\s*\]+\s*(#.*)?$", line):
            own = lines[table[1], 0] = {"": number}
            top.setdefault(table[1], number)
        elif key := re.match(r"\s*(\w+)\s*=", line):
            own.setdefault(key[1], number)
    held = data if isinstance(data, dict) else {}
    whole = {
        group for group in GROUPS if isinstance(tables := held.get(group, []), list) and counts[group] == len(tables)
    }
    return {place: keys for place, keys in lines.items() if place[0] in whole or place[0] not in GROUPS}
