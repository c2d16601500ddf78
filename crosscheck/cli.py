"""The command line: `crosscheck ...`. Results go to standard output, everything else to standard error."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import cyclopts
from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from crosscheck.answers import to_json
from refkin.analysis import solve as solve_scene
from refkin.errors import InvalidScene
from refkin.motion import Motion, Status
from refkin.scene_files import load, schema

PASS, DISAGREEMENT, USAGE, ENGINE_MISSING, INFRASTRUCTURE, NOTHING_RAN = range(6)

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


@app.command(name="schema")
def print_schema() -> int:
    """Print the JSON schema of scene files, for editors."""
    print(json.dumps(schema(), indent=2))
    return 0


def _print_motion(motion: Motion) -> None:
    table = Table("t [s]", "status", *(f"{body}.{c}" for body in motion.bodies for c in ("x", "y", "phi")))
    for k, (t, status) in enumerate(zip(motion.t, motion.status, strict=True)):
        table.add_row(f"{t:.6g}", status.value, *(f"{value:.15g}" for value in motion.q[:, k]))
    console = Console(width=None if sys.stdout.isatty() else 40 + 24 * len(motion.q))
    console.print(table)
    console.print(f"verdict: {motion.verdict.value}   worst scaled residual: {_worst(motion.residual)}")
    if motion.message:
        console.print(motion.message)


def _worst(values: object) -> str:
    import numpy as np

    finite = np.asarray(values)[np.isfinite(np.asarray(values))]
    return f"{finite.max():.3g}" if finite.size else "none"


def main() -> None:
    """Run the command line; an invalid scene or usage ends with exit code 2 and no traceback."""
    try:
        code = app(exit_on_error=False, print_error=True)
    except InvalidScene as error:
        print(error, file=sys.stderr)
        code = USAGE
    except cyclopts.CycloptsError:
        code = USAGE
    except BrokenPipeError:
        code = PASS
    sys.exit(code)
