"""`crosscheck hunt`: where error / allowed is worst."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from crosscheck.commands.hard import UnknownName
from crosscheck.engines import available
from crosscheck.night.campaign import ALWAYS, find_engines
from crosscheck.night.hunting import Bag, hunt
from crosscheck.workers.journal import replace_file
from crosscheck.workers.pool import SECONDS_PER_SCENE
from refkin.scenes.files import to_toml

PASS, ABOVE, ENGINE_MISSING, INFRASTRUCTURE = 0, 1, 3, 4


def hunt_worst(
    *,
    minutes: float = 5.0,
    seed: int | None = None,
    engine: Annotated[tuple[str, ...], Parameter(negative="")] = ("exudyn", "pinocchio", "mujoco"),
    out: Path = Path("reports/hunt"),
    scene_seconds: float = SECONDS_PER_SCENE,
) -> int:
    """Hunt for the worst error / allowed over scenes in strata of the distance to a singular pose, down to 1e-15.

    Exit codes: 0 nothing above 1, 1 something, 2 usage, 3 engine missing, 4 an engine crashed or hung.

    Parameters
    ----------
    minutes
        How long.
    seed
        Where to begin; the day's date as a number by default.
    engine
        Which; may be given several times, also as `file.py:Class`. The closed form is always among them.
    out
        The folder for the worst scene of each target, as a scene file to replay.
    scene_seconds
        After this long on one scene an engine is said to hang.
    """
    if not minutes > 0:
        raise UnknownName(f"--minutes: expected a number above 0, got {minutes}")
    known = available()
    for name in engine:
        if name not in known and ":" not in name:
            raise UnknownName(f"--engine: no engine is called {name!r}; there are: {', '.join(sorted(known))}")
    found, missing = find_engines(tuple(dict.fromkeys((ALWAYS, *engine))))
    if missing:
        print("\n".join(missing.values()), file=sys.stderr)
        return ENGINE_MISSING
    night = int(time.strftime("%Y%m%d", time.gmtime())) if seed is None else seed
    bag = hunt({k: spec for k, (spec, _) in found.items()}, 60.0 * minutes, night, scene_seconds=scene_seconds)
    _write(bag, out)
    _print(bag, out)
    if bag.failures:
        return INFRASTRUCTURE
    return ABOVE if bag.above() else PASS


def _file(name: tuple[str, str, str]) -> str:
    return "-".join(name).replace(" ", "-") + ".toml"


def _write(bag: Bag, out: Path) -> None:
    """Write the worst scene of each target."""
    out.mkdir(parents=True, exist_ok=True)
    for name, catch in bag.catches.items():
        told = f"# {' '.join(name)}: {catch.ratio:.3g} times the allowed error, the worst of {bag.scenes} scenes\n\n"
        replace_file(out / _file(name), told + to_toml(catch.scene))


def _print(bag: Bag, out: Path) -> None:
    console = Console(width=None if sys.stdout.isatty() else 160)
    table = Table("engine", "route", "quantity", title=f"The worst of {bag.scenes} scenes")
    for head in ("error/allowed", "decades of the distance", "found by scene"):
        table.add_column(head, justify="right")
    for name, catch in sorted(bag.catches.items(), key=lambda pair: -pair[1].ratio):
        low, high = catch.stratum
        table.add_row(*name, f"{catch.ratio:.3g}", f"1e-{low:g} .. 1e-{high:g}", str(catch.number))
    console.print(table)
    for failure in bag.failures:
        console.print(failure, markup=False)
    console.print(f"scenes: {out}", markup=False, highlight=False)
