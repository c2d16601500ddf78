"""The command line: `crosscheck ...`. Results go to standard output, everything else to standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

import cyclopts
import numpy as np
from rich.table import Table

from crosscheck.commands.answers import to_json
from crosscheck.commands.bench import bench
from crosscheck.commands.diagnose import print_diagnosis
from crosscheck.commands.documents import ledger
from crosscheck.commands.effects import effects
from crosscheck.commands.follow import print_path
from crosscheck.commands.hard import UnknownName, hard
from crosscheck.commands.hunt import hunt_worst
from crosscheck.commands.mobility import mobility_lines
from crosscheck.commands.nightly import nightly
from crosscheck.commands.nights import baseline, history
from crosscheck.commands.price import price
from crosscheck.commands.replay import replay
from crosscheck.commands.tables import capability_table
from crosscheck.commands.tape import tape
from crosscheck.commands.usage import INFRASTRUCTURE, INTERRUPTED, PASS, USAGE, Json, UsageError, console
from crosscheck.engines import available
from crosscheck.engines import load as load_engine
from crosscheck.judge.known_gaps import InvalidGap
from crosscheck.night.campaign import OtherRun, SameName, find_engines
from crosscheck.night.golden import NoBaseline
from crosscheck.night.history import HistoryError
from crosscheck.workers.cluster import NoCluster
from crosscheck.workers.journal import Occupied
from refkin.errors import InvalidScene
from refkin.motion import Motion, Status
from refkin.scenes.files import load, schema
from refkin.solving.solve import solve as solve_scene

app = cyclopts.App(
    suppress_keyboard_interrupt=False,  # `main` says what is kept
    name="crosscheck",
    help="How many digits can you trust from exudyn, Pinocchio and MuJoCo, and what does each digit cost?",
    version_flags=["--version"],
)


@app.command
def solve(scene: Path, *, as_json: Json = False) -> int:
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
    out = console(160)
    out.print(capability_table(load_engine(spec) for spec, _ in found.values()))
    for name, (_, version) in found.items():
        out.print(f"{name} {version}")
    for reason in missing.values():
        out.print(reason, markup=False)
    return PASS


@app.command(name="schema")
def print_schema() -> int:
    """Print the JSON schema of scene files, for editors."""
    print(json.dumps(schema(), indent=2))
    return 0


def _print_motion(motion: Motion) -> None:
    table = Table("t [s]", "status", *(f"{body}.{c}" for body in motion.bodies for c in ("x", "y", "phi")))
    for k, (t, status) in enumerate(zip(motion.t, motion.status, strict=True)):
        table.add_row(f"{t:.6g}", status.value, *(f"{value:.15g}" for value in motion.q[:, k]))
    out = console(40 + 24 * len(motion.q))
    out.print(table)
    out.print(f"verdict: {motion.verdict.value}   worst scaled residual: {_worst(motion.residual)}")
    if motion.message:
        out.print(motion.message)


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


for command in (nightly, replay, hard, price, effects, bench, ledger, tape, history, baseline):
    app.command(command)
app.command(hunt_worst, name="hunt")
app.command(print_diagnosis, name="diagnose")
app.command(print_path, name="follow")


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
        NoBaseline,
        UnknownName,
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
