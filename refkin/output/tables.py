"""A motion as a table, with one row per time or one per number; headers name what stands below, with its unit."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from refkin.motion import Motion

UNITS = (("m", "m", "rad"), ("m/s", "m/s", "rad/s"), ("m/s^2", "m/s^2", "rad/s^2"))
NAMES = (("x", "y", "phi"), ("xd", "yd", "phid"), ("xdd", "ydd", "phidd"))
LEVELS = ("position", "velocity", "acceleration")


def columns(motion: Motion) -> Iterator[tuple[str, str, str, str, Any]]:
    """Yield what, quantity, level, unit and values (T,) of each column beyond time and status.

    What is a body or a point, in the order of the motion; levels that were not called for have no columns.
    """
    for level, rows in enumerate(motion.levels):
        if rows is not None:
            for k, values in enumerate(rows):
                yield motion.bodies[k // 3], NAMES[level][k % 3], LEVELS[level], UNITS[level][k % 3], values
    for name, point in motion.points.items():
        for level, pair in enumerate((point.r, point.v, point.a)):
            if pair is not None:
                for axis in range(2):
                    yield name, NAMES[level][axis], LEVELS[level], UNITS[level][axis], pair[axis]


def wide(motion: Motion) -> dict[str, Any]:
    """Return header -> column: time, status, then `body.x [m]` and so on, each (T,)."""
    table: dict[str, Any] = {"t [s]": motion.t, "status": np.array([str(status) for status in motion.status])}
    return table | {f"{what}.{name} [{unit}]": values for what, name, _, unit, values in columns(motion)}


def long(motion: Motion) -> dict[str, Any]:
    """Return header -> column with one row per number: t [s], status, name, quantity, level, unit, value."""
    written = list(columns(motion))
    count, status = len(motion.t), np.array([str(s) for s in motion.status])
    texts = {
        key: np.repeat([c[k] for c in written], count) for k, key in enumerate(("name", "quantity", "level", "unit"))
    }
    value = np.concatenate([c[4] for c in written])
    return {"t [s]": np.tile(motion.t, len(written)), "status": np.tile(status, len(written)), **texts, "value": value}


def write_csv(motion: Motion, file: str | Path) -> None:
    """Write the wide table; every number with the digits that give it back exactly, nothing where there is none."""
    table = wide(motion)
    with open(file, "w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out)
        writer.writerow(table)
        writer.writerows([_cell(x) for x in row] for row in zip(*table.values(), strict=True))


def _cell(x: Any) -> str:
    if isinstance(x, str):
        return str(x)
    return repr(float(x)) if np.isfinite(x) else ""
