"""`crosscheck solve` and `crosscheck schema`: a scene's answer, and the form of scene files."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.commands.usage import Json, SceneFile, print_numbers, writable
from crosscheck.errors import naming
from refkin.model import Scene
from refkin.motion import QUANTITIES, BodyMotion, Motion, Status
from refkin.output import SceneMotion
from refkin.scenes.files import load
from refkin.solving import solve as solving
from refkin.solving.limits import expected_seconds

SCHEMA = 1
LONG = 5.0
"""Seconds of silence: what takes longer says so first."""


def solve(scene: SceneFile, *, as_json: Json = False, csv: Path | None = None) -> int:
    """Solve a scene with the reference.

    Exit codes: 0 every pose is ok, 1 not every pose is ok, 2 the scene is invalid.

    Parameters
    ----------
    csv
        Write all that the scene calls for to this file, one row per time, instead of printing a table.
    """
    read = load(scene)
    writable("csv", csv, scene)
    seconds = expected_seconds(read)
    if seconds > LONG:
        print(f"{len(read.times)} times: this takes about {seconds:.0f} s", file=sys.stderr, flush=True)
    motion = solving.solve(read)
    if csv is not None:
        with naming(csv):
            motion.to_csv(csv)
        print(f"{csv}: {len(motion.t)} times, verdict {motion.verdict}", file=sys.stderr)
    if as_json:
        print(json.dumps(to_json(read, motion)))
    elif csv is None:
        _print_motion(motion)
    return 0 if motion.verdict is Status.OK else 1


def print_schema() -> int:
    """Print the JSON schema of scene files, for editors."""
    from refkin.scenes.keys import schema  # here: pydantic is loaded where it is needed

    print(json.dumps(schema(), indent=2))
    return 0


def to_json(scene: Scene, motion: Motion) -> dict[str, Any]:
    """Return the answer to a scene as plain data; levels that were not called for are absent."""
    radius = motion.certified_radius
    return {
        "schema": SCHEMA,
        "scene": scene.name,
        "verdict": motion.verdict.value,
        "message": motion.message,
        "t": numbers(motion.t),
        "status": [s.value for s in motion.status],
        "bodies": {
            body: _called_for(q=motion[body].q, qd=motion[body].qd, qdd=motion[body].qdd, **_turning(motion[body]))
            for body in motion.bodies
        },
        "points": {name: _called_for(r=p.r, v=p.v, a=p.a) for name, p in motion.points.items()},
        "contacts": {
            name: {order: numbers(level) for order, level in vars(contact).items() if level is not None}
            for name, contact in motion.contacts.items()
        },
        "residual": numbers(motion.residual),
        "sigma_min": numbers(motion.sigma_min),
        "condition": numbers(motion.condition),
        "certified_radius": {quantity: numbers(getattr(radius, quantity)) for quantity in QUANTITIES},
    }


def _turning(body: BodyMotion) -> dict[str, Any]:
    """Return angular velocity and acceleration of a body of space; in the plane they are in qd and qdd."""
    return {key: getattr(body, key, None) for key in ("omega", "alpha")} if hasattr(body, "rotation") else {}


def numbers(values: Iterable[float]) -> list[float | None]:
    """Return floats with None for what is not finite."""
    return [float(v) if np.isfinite(v) else None for v in values]


def _called_for(**levels: Any) -> dict[str, Any]:
    """Return each level that was called for as one row of components per time."""
    return {key: [numbers(row) for row in level.T] for key, level in levels.items() if level is not None}


def _print_motion(motion: SceneMotion) -> None:
    from refkin.output.tables import wide

    if not print_numbers(wide(motion), len(motion.first_columns)):
        counts = ", ".join(f"{motion.status.count(s)} {s}" for s in dict.fromkeys(motion.status))
        print(f"no pose at any of {len(motion.t)} times: {counts}")
    residual = motion.residual[np.isfinite(motion.residual)]
    worst = f"{residual.max():.3g}" if residual.size else "none"
    print(f"verdict: {motion.verdict.value}   worst scaled residual: {worst}")
    if motion.message:
        print(motion.message)
