"""The command `crosscheck effects`: the ledger of effects on a scene, as a table or as one JSON object."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.table import Table

from crosscheck.commands.engines import ENGINES, names
from crosscheck.commands.progress import shown_progress
from crosscheck.commands.usage import Json, coloured, console, table
from crosscheck.errors import DISAGREEMENT, ENGINE_MISSING, PASS
from crosscheck.judge.effects_rows import EffectRow
from crosscheck.measure.effects_ablations import REFKIN
from crosscheck.measure.effects_ledger import effects_ledger
from crosscheck.workers.installed import find_engines
from refkin.model import Scene
from refkin.motion import Status
from refkin.scenes.files import load
from refkin.solving.solve import solve


def effects(scene: Path, *, engines: str = ENGINES, as_json: Json = False) -> int:
    """Show what every effect costs on a scene, and whether one that is not called for changes anything.

    Exit codes: 0 done, 1 an effect changes another number of the reference, or no pose of the scene is found, 2 usage
    or invalid scene, 3 engine missing.

    Parameters
    ----------
    scene
        A scene file (TOML, or JSON if it ends in .json); its first times are measured.
    engines
        Names, separated by commas, or `file.py:Class`.
    as_json
        Print one JSON object instead of a table.
    """
    read_scene = load(scene)
    motion = solve(read_scene)
    if Status.OK not in motion.status:
        print(f"{read_scene.name}: no pose is found, so no effect has a price: {motion.message}", file=sys.stderr)
        return DISAGREEMENT
    installed, missing = find_engines(names(engines, always=()))
    inert = show(read_scene, [spec for spec, _ in installed.values()], list(missing.values()), as_json)
    if missing:
        return ENGINE_MISSING
    return PASS if inert else DISAGREEMENT


SCHEMA = 2


def show(scene: Scene, engines: Sequence[str], missing: Sequence[str], as_json: bool) -> bool:
    """Measure the effects on a scene and print them; return whether each leaves refkin's other numbers as they were."""
    with shown_progress(1 + len(engines), noun="producers") as tell:
        rows = effects_ledger(scene, engines, tell=tell)
    if as_json:
        print(json.dumps(to_json(scene.name, rows, missing)))
    else:
        out = console(180)
        out.print(ledger_table(scene.name, rows))
        for line in (*felt_lines(rows), *absent_lines(rows), *missing):
            out.print(line)
    ours = [row.inert for row in rows if row.engine == REFKIN]
    return True in ours and False not in ours


def to_json(scene: str, rows: Sequence[EffectRow], missing: Sequence[str] = ()) -> dict[str, object]:
    """Return the ledger as plain data."""
    return {"schema": SCHEMA, "scene": scene, "rows": [asdict(row) for row in rows], "missing": list(missing)}


def named(row: EffectRow) -> str:
    """Return engine, method and setting of a row."""
    return ", ".join(filter(None, (row.engine, row.method, row.setting)))


def ledger_table(scene: str, rows: Sequence[EffectRow]) -> Table:
    """Return the rows as a table, method by method; times are per configuration."""
    prices = (">adds\nmicroseconds", ">noise\nmicroseconds", ">to\nmicroseconds")
    heads = ("engine, method", "effect", *prices, "inert", ">largest change", "note")
    shown: list[Any] = []
    last = ""
    for row in (row for row in rows if row.inert is not None):
        name = named(row)
        shown += [None] if last not in ("", name) else []
        price = "within noise" if row.within_noise else _number(row.microseconds)
        numbers = (price, _number(row.spread), _number(row.without))
        change = "-" if row.largest_change is None else f"{row.largest_change:.2g}"
        cells = ("" if name == last else name, row.effect, *numbers, "yes" if row.inert else "no", change, row.note)
        shown.append(cells if row.inert else [coloured(cell, "red") for cell in cells])
        last = name
    title = f"{scene}: what each effect costs per configuration, and whether it is inert"
    return table(*heads, rows=shown, title=title)


def felt_lines(rows: Sequence[EffectRow]) -> list[str]:
    """Return a line for each effect that is not inert: which, where it is felt, and how much."""
    lines = []
    for row in rows:
        if row.inert is False:
            what = row.note if row.largest_change is None else f"changes {row.worst} by {row.largest_change:.2g}"
            lines.append(f"not inert: {row.effect} in {named(row)}: {what}")
    if not lines and all(row.inert is None for row in rows):
        return ["no effect was measured"]
    return lines or ["every effect that was measured is inert where it is not called for"]


def absent_lines(rows: Sequence[EffectRow]) -> list[str]:
    """Return a line for each reason why effects have no price: in which engine, by which methods, and which."""
    reasons: dict[tuple[str, str], tuple[list[str], list[str]]] = {}
    for row in rows:
        if row.inert is None:
            by, effects = reasons.setdefault((row.engine, row.note), ([], []))
            by += [row.method] if row.method not in by else []
            effects += [row.effect] if row.effect not in effects else []
    return [
        f"no price in {engine} ({', '.join(by)}): {', '.join(effects)}: {why}"
        for (engine, why), (by, effects) in reasons.items()
    ]


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
