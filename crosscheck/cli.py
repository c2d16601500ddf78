"""The command line: `crosscheck ...`. Results go to standard output, everything else to standard error."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import cyclopts
import numpy as np
from cyclopts import Parameter
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from crosscheck.answers import to_json
from crosscheck.campaign import DISAGREEMENT, ENGINE_MISSING, INFRASTRUCTURE, PASS, USAGE, Plan, OtherRun, find_engines, run, seed_of
from crosscheck.engines import available
from crosscheck.engines import load as load_engine
from crosscheck.report import build
from crosscheck.tables import agreement_table, capability_table, disagreement_lines, rows_table
from crosscheck.workers import Workers
from refkin.analysis import solve as solve_scene
from refkin.errors import InvalidScene
from refkin.motion import Motion, Status
from refkin.scene_files import load, schema, to_dict


class UsageError(Exception):
    """A request on the command line that makes no sense."""


app = cyclopts.App(
    name="crosscheck",
    help="How many digits can you trust from exudyn, Pinocchio and MuJoCo, and what does each digit cost?",
    version_flags=["--version"],
)


@app.command
def solve(scene: Path, *, as_json: Annotated[bool, Parameter(name="--json", negative="")] = False) -> int:
    """Solve a scene with the reference.

    Exit codes: 0 every pose is ok, 1 not every pose is ok, 2 the scene is invalid.

    Parameters
    ----------
    scene
        A scene file (TOML, or JSON if it ends in .json).
    as_json
        Print one JSON object instead of a table.
    """
    read = load(scene)
    motion = solve_scene(read)
    if as_json:
        print(json.dumps(to_json(read, motion)))
    else:
        _print_motion(motion)
    return 0 if motion.verdict is Status.OK else 1


@app.command(name="engines")
def print_engines() -> int:
    """Print what each engine can do: joint x engine x level, and why not where it refuses."""
    names = sorted(available())
    versions, missing = find_engines(tuple(names))
    console = _console(160)
    console.print(capability_table(load_engine(name) for name in versions))
    for name, version in versions.items():
        console.print(f"{name} {version}")
    for reason in missing.values():
        console.print(reason)
    return 0


@app.command
def nightly(
    *,
    minutes: float | None = None,
    scenes: int | None = None,
    seed: int | None = None,
    engines: str = "exudyn,pinocchio,mujoco",
    require_engines: str = "",
    out: Path = Path("reports/latest"),
    workers: int | None = None,
) -> int:
    """Draw scenes, check them on all engines, write a report.

    Exit codes: 0 pass, 1 new disagreement, 2 usage, 3 engine missing, 4 infrastructure, 5 nothing ran.

    Parameters
    ----------
    minutes
        How long to draw new scenes (3 if neither this nor `scenes` is given).
    scenes
        How many scenes to check.
    seed
        The night's seed; the day's date as a number by default. A folder that holds a run is resumed with its seed.
    engines
        Names, separated by commas; the closed form is always among the sources.
    require_engines
        Engines without which the night fails with exit code 3.
    out
        The folder of the run: records.jsonl, report.json, index.html.
    workers
        Worker processes; one per processor by default.
    """
    plan = _plan(minutes, scenes, seed, engines, require_engines, out, workers)
    with _progress(plan) as progress:
        outcome = run(plan, progress)
    page = build(plan.out, outcome)
    console = Console(stderr=True)
    for line in disagreement_lines(outcome.new[:20]):
        console.print(f"new: {line}", markup=False)
    for line in outcome.failed[:20]:
        console.print(f"not checked: {line}", markup=False)
    for name, reason in outcome.missing.items():
        console.print(f"missing: {name}: {reason}", markup=False)
    code = outcome.exit_code(plan.required)
    console.print(f"{outcome.checked} scenes checked, {len(outcome.new)} new and {outcome.known} known disagreements")
    console.print(f"report: {page}", markup=False)
    return code


@app.command
def replay(scene: Path, *, engines: str = "exudyn,pinocchio,mujoco") -> int:
    """Show one scene on all engines.

    Exit codes: 0 all agree, 1 some disagree, 2 the scene is invalid, 3 an engine is missing.

    Parameters
    ----------
    scene
        A scene file, for instance one that a night wrote to its folder `disagreements`.
    engines
        Names, separated by commas; the closed form is always among the sources.
    """
    read = load(scene)
    names = _names(engines)
    versions, missing = find_engines(names)
    with Workers(1) as pool:
        record = pool.check_alone({"scene": to_dict(read), "about": {}}, tuple(versions))
    console = _console(160)
    if "failure" in record:
        console.print(record["failure"], markup=False)
        return INFRASTRUCTURE
    told = record["reference"]
    console.print(f"refkin: {told['verdict']} {told['message']}  smallest sigma {told['sigma_min']:.3g}", markup=False)
    console.print(agreement_table(record))
    console.print(rows_table(record))
    for line in [*record["refusals"], *missing.values(), *disagreement_lines(record["disagreements"])]:
        console.print(line, markup=False)
    if missing:
        return ENGINE_MISSING
    return DISAGREEMENT if record["disagreements"] else PASS


@app.command(name="schema")
def print_schema() -> int:
    """Print the JSON schema of scene files, for editors."""
    print(json.dumps(schema(), indent=2))
    return 0


def _plan(
    minutes: float | None,
    scenes: int | None,
    seed: int | None,
    engines: str,
    require_engines: str,
    out: Path,
    workers: int | None,
) -> Plan:
    for key, value in (("minutes", minutes), ("scenes", scenes), ("workers", workers)):
        if value is not None and not value > 0:
            raise UsageError(f"--{key}: expected a number above 0, got {value}")
    if minutes is None and scenes is None:
        minutes = 3.0
    required = _names(require_engines, always=())
    return Plan(
        seed=seed_of(out, seed),
        out=out,
        engines=tuple(dict.fromkeys((*_names(engines), *required))),
        required=required,
        minutes=minutes,
        scenes=scenes,
        workers=workers or os.cpu_count() or 1,
    )


def _names(text: str, always: tuple[str, ...] = ("closed_form",)) -> tuple[str, ...]:
    """Return the names in a list separated by commas; an engine nobody has heard of is a usage error."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    known = available()
    for name in names:
        if name not in known:
            raise UsageError(f"no engine is called {name!r}; there are: {', '.join(sorted(known))}")
    return tuple(dict.fromkeys((*always, *names)))


@contextmanager
def _progress(plan: Plan) -> Iterator[Callable[[int], None]]:
    """Show a bar on a terminal, nothing elsewhere."""
    console = Console(stderr=True)
    start = time.monotonic()
    total = plan.scenes if plan.scenes is not None else 60.0 * (plan.minutes or 0.0)
    with Progress(
        TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), console=console, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("checking", total=total)

        def show(checked: int) -> None:
            done = checked if plan.scenes is not None else time.monotonic() - start
            bar.update(task, completed=min(done, total), description=f"{checked} scenes")

        yield show


def _console(width: int) -> Console:
    return Console(width=None if sys.stdout.isatty() else width)


def _print_motion(motion: Motion) -> None:
    table = Table(r"t \[s]", "status", *(f"{body}.{c}" for body in motion.bodies for c in ("x", "y", "phi")))
    for k, (t, status) in enumerate(zip(motion.t, motion.status, strict=True)):
        table.add_row(f"{t:.6g}", status.value, *(f"{value:.15g}" for value in motion.q[:, k]))
    console = _console(40 + 24 * len(motion.q))
    console.print(table)
    console.print(f"verdict: {motion.verdict.value}   worst scaled residual: {_worst(motion.residual)}")
    if motion.message:
        console.print(motion.message)


def _worst(values: object) -> str:
    finite = np.asarray(values)[np.isfinite(np.asarray(values))]
    return f"{finite.max():.3g}" if finite.size else "none"


def main() -> None:
    """Run the command line; an invalid scene or usage ends with exit code 2 and no traceback."""
    try:
        code = app(exit_on_error=False, print_error=True)
    except (InvalidScene, UsageError, OtherRun) as error:
        print(error, file=sys.stderr)
        code = USAGE
    except cyclopts.CycloptsError:
        code = USAGE
    except BrokenPipeError:
        code = PASS
    sys.exit(code)
