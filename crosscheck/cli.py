"""The command line: `crosscheck ...`. Results go to standard output, everything else to standard error."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import cyclopts
import numpy as np
from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from crosscheck import (
    bench_command,
    document_commands,
    golden,
    hard_commands,
    hunt_command,
    night_commands,
    tape_command,
)
from crosscheck.answers import to_json
from crosscheck.campaign import ALWAYS, SAMPLED, OtherRun, Plan, SameName, find_engines, run, seed_of
from crosscheck.cluster import LOCAL, NoCluster
from crosscheck.diagnosis import print_diagnosis
from crosscheck.engines import available
from crosscheck.engines import load as load_engine
from crosscheck.freedoms import mobility_lines
from crosscheck.history import HistoryError, warnings
from crosscheck.journal import Occupied
from crosscheck.known_gaps import InvalidGap, read, table
from crosscheck.paths import print_path
from crosscheck.price import command as price_command
from crosscheck.progress import shown_progress
from crosscheck.report import build, verdict
from crosscheck.report.build import HARD_CASES
from crosscheck.tables import (
    agreement_table,
    arbiter_table,
    capability_table,
    lines_with_gap,
    outcome_lines,
    rows_table,
)
from crosscheck.workers import SECONDS_PER_SCENE, Workers
from refkin.analysis import solve as solve_scene
from refkin.errors import InvalidScene
from refkin.motion import Motion, Status
from refkin.scene_files import load, schema, to_dict

PASS, DISAGREEMENT, USAGE, ENGINE_MISSING, INFRASTRUCTURE, NOTHING_RAN = range(6)
INTERRUPTED = 130
CODES = {
    verdict.PASS: PASS,
    verdict.NEW_DISAGREEMENTS: DISAGREEMENT,
    verdict.ENGINE_MISSING: ENGINE_MISSING,
    verdict.INFRASTRUCTURE: INFRASTRUCTURE,
    verdict.NOTHING_RAN: NOTHING_RAN,
}
"""A night ends as its report says; the worst comes first there."""
ENGINES = "exudyn,pinocchio,mujoco"


def _whole(_: Any, tokens: Sequence[Any]) -> int:
    """Return a whole number; cyclopts by itself takes 2.5 for 2."""
    try:
        return int(tokens[0].value)
    except ValueError as error:
        raise ValueError(f"expected a whole number, got {tokens[0].value!r}") from error


Whole = Annotated[int, Parameter(converter=_whole)]


class UsageError(Exception):
    """A request on the command line that makes no sense."""


app = cyclopts.App(
    suppress_keyboard_interrupt=False,  # `main` says what is kept
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
    found, missing = find_engines(tuple(sorted(available())))
    console = _console(160)
    console.print(capability_table(load_engine(spec) for spec, _ in found.values()))
    for name, (_, version) in found.items():
        console.print(f"{name} {version}")
    for reason in missing.values():
        console.print(reason, markup=False)
    return PASS


@app.command
def nightly(
    *,
    minutes: float | None = None,
    scenes: Whole | None = None,
    seed: Whole | None = None,
    engines: str = ENGINES,
    require_engines: str = "",
    out: Path = Path("reports/latest"),
    workers: Whole | None = None,
    cluster: str | None = None,
    scene_seconds: float = SECONDS_PER_SCENE,
    history: Path | None = None,
    baseline: Path | None = None,
    known_gaps: str = "",
    hard_seconds: float | None = None,
) -> int:
    """Draw scenes, check them on all engines, write a report.

    Exit codes: 0 pass, 1 new disagreement, 2 usage, 3 engine missing, 4 infrastructure, 5 nothing ran, 130 interrupted.
    A run that was killed or interrupted is continued by the same command.

    Parameters
    ----------
    minutes
        How long to draw new scenes (3 if neither this nor `scenes` is given).
    scenes
        How many scenes to check, those of an earlier part of the run included.
    seed
        The night's seed; the day's date as a number by default. A folder that holds a run is continued with its seed.
    engines
        Names, separated by commas, or `file.py:Class` for one that is not registered; the closed form is always among
        the sources.
    require_engines
        Engines without which the night fails with exit code 3 before anything runs.
    out
        The folder of the run: records.jsonl, report.json, index.html, disagreements/*.toml.
    workers
        Worker processes; one per processor by default.
    cluster
        Check the scenes on a Dask cluster: `local` for one of `workers` processes, or a scheduler, `tcp://host:8786`.
    scene_seconds
        After this long on one scene a worker is ended, and the engine that it was at is told.
    known_gaps
        A table to hold the run against instead of our own: a file, or `none`. Then every row of our own is told, and
        after how many scenes it was found again.
    hard_seconds
        How long the hard scenes may take, for the report's table of them; by default a quarter of a night's minutes, a
        minute at most, and 0 for a night that is given `scenes` alone.
    history
        The file that nights are kept in; `history.sqlite` beside the folder by default.
    baseline
        The accepted digits of the golden set; that of this checkout by default, if there is one.
    """
    if baseline is not None:
        golden.read(baseline)
    accepted = baseline or (golden.DEFAULT if golden.DEFAULT.is_file() else None)
    plan = _plan(minutes, scenes, seed, engines, require_engines, out, workers, cluster, scene_seconds, accepted)
    plan = replace(plan, known_gaps=known_gaps)
    with shown_progress(plan.scenes, plan.minutes) as progress:
        try:
            outcome = run(plan, progress)
        except KeyboardInterrupt:
            told = f"interrupted; what was checked is kept in {plan.out}, and the same command goes on from there"
            raise KeyboardInterrupt(told) from None
    hard_seconds = min(60.0, 15.0 * (plan.minutes or 0.0)) if hard_seconds is None else hard_seconds
    hard_commands.write_rows(plan.out / HARD_CASES, outcome.versions, {ALWAYS}, hard_seconds)
    kept = history or plan.out.parent / "history.sqlite"
    page = build(plan.out, outcome, required=outcome.required, gaps=table(known_gaps), history=kept)
    report = json.loads((plan.out / "report.json").read_text(encoding="utf-8"))
    warned = [f"warning: {line}" for line in warnings(report["trends"])] if report["trends"] else []
    console = Console(stderr=True, soft_wrap=True)
    for line in (*outcome_lines(outcome), *warned, f"report: {page}"):
        console.print(line, markup=False, highlight=False)
    return CODES[report["verdict"]]


@app.command
def replay(scene: Path, *, engines: str = ENGINES, scene_seconds: float = SECONDS_PER_SCENE) -> int:
    """Show one scene on all engines.

    Exit codes: 0 all agree, 1 some disagree, 2 usage or invalid scene, 3 engine missing, 4 infrastructure.

    Parameters
    ----------
    scene
        A scene file, for instance one that a night wrote to its folder `disagreements`.
    engines
        Names, separated by commas, or `file.py:Class`; the closed form is always among the sources.
    scene_seconds
        After this long an engine is ended, and said to hang.
    """
    job = {"scene": to_dict(load(scene)), "about": {}, "arbiter": True}
    _positive("scene-seconds", scene_seconds)
    found, missing = find_engines(_names(engines))
    with Workers(1, {name: spec for name, (spec, _) in found.items()}, scene_seconds) as pool:
        record = pool.check_one(job)
    console = _console(160)
    if "failure" in record:
        console.print(record["failure"], markup=False)
        return INFRASTRUCTURE
    told = record["reference"]
    console.print(f"refkin: {told['verdict']} {told['message']}  smallest sigma {told['sigma_min']:.3g}", markup=False)
    console.print(agreement_table(record))
    console.print(arbiter_table(record))
    console.print(rows_table(record))
    disagreements = [line for told in record["disagreements"] for line in lines_with_gap(told, record, read())]
    for line in [*record["refusals"], *missing.values(), *pool.unexplained, *disagreements]:
        console.print(line, markup=False)
    if missing:
        return ENGINE_MISSING
    return DISAGREEMENT if record["disagreements"] else PASS


@app.command
def effects(
    scene: Path, *, engines: str = ENGINES, as_json: Annotated[bool, Parameter(name="--json", negative="")] = False
) -> int:
    """Show what every effect costs on a scene, and whether one that is not called for changes anything.

    Exit codes: 0 done, 1 an effect changes another number of the reference, 2 usage or invalid scene, 3 engine missing.

    Parameters
    ----------
    scene
        A scene file (TOML, or JSON if it ends in .json); its first times are measured.
    engines
        Names, separated by commas, or `file.py:Class`.
    as_json
        Print one JSON object instead of a table.
    """
    from crosscheck.effects.show import run as show  # here, because no other command needs it

    read_scene = load(scene)
    found, missing = find_engines(_names(engines, always=()))
    inert = show(read_scene, [spec for spec, _ in found.values()], list(missing.values()), as_json)
    if missing:
        return ENGINE_MISSING
    return PASS if inert else DISAGREEMENT


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
    cluster: str | None,
    scene_seconds: float,
    baseline: Path | None,
) -> Plan:
    numbers = {"minutes": minutes, "scenes": scenes, "workers": workers, "scene-seconds": scene_seconds}
    for key, value in numbers.items():
        _positive(key, value)
    if out.exists() and not out.is_dir():
        raise UsageError(f"--out: expected a folder, got the file {out}")
    if cluster is not None and cluster != LOCAL and "://" not in cluster:
        raise UsageError(
            f"--cluster: expected {LOCAL!r} or a scheduler's address like tcp://host:8786, got {cluster!r}"
        )
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
        cluster=cluster,
        scene_seconds=scene_seconds,
        baseline=baseline,
    )


def _positive(key: str, value: float | None) -> None:
    if value is not None and not 0 < value < math.inf:
        raise UsageError(f"--{key}: expected a number above 0, got {value}")


def _names(text: str, always: tuple[str, ...] = (ALWAYS, SAMPLED)) -> tuple[str, ...]:
    """Return the names in a list separated by commas; an engine nobody has heard of is a usage error."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    known = available()
    for name in names:
        if name not in known and ":" not in name:
            raise UsageError(f"no engine is called {name!r}; there are: {', '.join(sorted(known))}, or file.py:Class")
    return tuple(dict.fromkeys((*always, *names)))


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


@app.command
def mobility(scene: Path) -> int:
    """Count the freedoms of a scene's joints, take the rank of their equations at its first pose, name redundant rows.

    Exit codes: 0 done, 1 no pose was found to take the rank at, 2 the scene is invalid.

    Parameters
    ----------
    scene
        A scene file (TOML, or JSON if it ends in .json).
    """
    lines, posed = mobility_lines(load(scene))
    print("\n".join(lines))
    return 0 if posed else 1


app.command(print_diagnosis, name="diagnose")
app.command(print_path, name="follow")
app.command(document_commands.ledger)
app.command(document_commands.mutants)
app.command(tape_command.tape)
app.command(hard_commands.hard)
app.command(hunt_command.hunt_worst, name="hunt")
app.command(price_command.price)
app.command(night_commands.history)
app.command(night_commands.baseline)
app.command(bench_command.bench)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; whatever cannot be done ends with one line that says why, and no traceback."""
    try:
        code = app(sys.argv[1:] if arguments is None else arguments, exit_on_error=False, print_error=True)
    except (
        InvalidScene,
        UsageError,
        OtherRun,
        Occupied,
        SameName,
        golden.NoBaseline,
        hard_commands.UnknownName,
    ) as error:
        code = _told(error, USAGE)
    except cyclopts.CycloptsError:
        code = USAGE
    except BrokenPipeError:
        code = PASS
    except (OSError, InvalidGap, NoCluster, HistoryError) as error:
        code = _told(error, INFRASTRUCTURE)
    except KeyboardInterrupt as error:
        code = _told(error, INTERRUPTED)
    sys.exit(code)


def _told(error: BaseException, code: int) -> int:
    print(str(error) or "interrupted", file=sys.stderr)
    return code
