"""`crosscheck follow`: the poses of a scene one after another, through limits of its driver and up to change points."""

from __future__ import annotations

import json
from pathlib import Path as File
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from crosscheck.commands.solve import SCHEMA, numbers
from crosscheck.commands.usage import Json, SceneFile, Whole, positive, print_numbers, writable
from crosscheck.errors import UsageError, naming
from refkin.errors import InvalidRequest, UnknownName
from refkin.model import Scene
from refkin.motion import BodyMotion
from refkin.output.tables import wide
from refkin.proof.path.tracing import TraceEnd
from refkin.scenes.files import load
from refkin.solving.follow import Bifurcation, Path, Tangent, TurningPoint, driven_by, follow, straight_on

TIME = "time"
"""What the path's t is if it is not the value of a driver."""


def _to_json(scene: Scene, parameter: str, path: Path) -> dict[str, Any]:
    """Return a path as plain data; numbers that do not exist are null."""
    return {
        "schema": SCHEMA,
        "scene": scene.name,
        "parameter": parameter,
        "end": path.end.name.lower(),
        "message": path.message,
        "t": numbers(path.t),
        "bodies": {body: {"q": [numbers(row) for row in path[body].q.T]} for body in path.bodies},
        "tangents": [_tangent(path, tangent) for tangent in path.tangents],
        "residual": numbers(path.residual),
        "certified_radius": numbers(path.radius),
        "events": [_event(path, event) for event in path.events],
    }


def _tangent(path: Path, tangent: Tangent) -> dict[str, Any]:
    width = path.kind.width
    rows = tangent.q[: width * len(path.bodies)].reshape(-1, width)
    return {
        "t": numbers([tangent.t])[0],
        "bodies": {body: numbers(row) for body, row in zip(path.bodies, rows, strict=True)},
    }


def _event(path: Path, event: TurningPoint | Bifurcation) -> dict[str, Any]:
    at = {"index": event.index, "t": event.t}
    if isinstance(event, TurningPoint):
        return {"kind": "turning point", **at, "is_maximum": event.is_maximum}
    return {"kind": "bifurcation", **at, "tangents": [_tangent(path, tangent) for tangent in event.tangents]}


def lines(parameter: str, path: Path) -> list[str]:
    """Return what happens along a path as lines to print."""
    if not path.t.size:
        return [path.message]
    proved = np.isfinite(path.radius)
    worst = f", worst radius {np.max(path.radius[proved]):.3g}" if proved.any() else ""
    text = [
        f"{path.t.size} poses, {parameter} from {path.t[0]:.17g}",
        f"{proved.sum()} of them proved to be alone{worst}; worst scaled residual {np.max(path.residual):.3g}",
    ]
    for event in path.events:
        if isinstance(event, TurningPoint):
            how = "largest" if event.is_maximum else "smallest"
            text.append(f"pose {event.index}: {parameter} turns at its {how} value {event.t:.17g}")
        else:
            text.append(f"pose {event.index}: {len(event.tangents)} branches cross at {parameter} = {event.t:.17g}")
            text += [f"    tangent: {_direction(path, parameter, event.q, tangent)}" for tangent in event.tangents]
    return [*text, f"pose {path.t.size - 1}: {path.message}, at {parameter} = {path.t[-1]:.17g}"]


def _direction(path: Path, parameter: str, q: Any, tangent: Tangent) -> str:
    """Return how fast the bodies turn by the parameter, or, where it stands still, how they move.

    In the plane that is the rate of an angle, in space omega in the ground frame.
    """
    still = abs(tangent.t) <= 1e-9 * np.max(np.abs(tangent.q))
    rates = tangent.q if still else tangent.q / tangent.t
    per = "with the parameter at rest" if still else f"rad per unit of {parameter}"
    columns = ([x[path.kind.width * k :][: path.kind.width] for x in (q, rates)] for k in range(len(path.bodies)))
    return ", ".join(f"{body} {_turning(*at)}" for body, at in zip(path.bodies, columns, strict=True)) + f" {per}"


def _turning(q: Any, rates: Any) -> str:
    """Return the angular rate of a body in words, from its coordinates and their rates (width,)."""
    moving = BodyMotion(q, rates, None)
    return f"({', '.join(f'{x:.6g}' for x in moving.omega)})" if hasattr(moving, "omega") else f"{rates[2]:.6g}"


def print_path(
    scene: SceneFile,
    *,
    driver: str | None = None,
    backwards: Annotated[bool, Parameter(negative="")] = False,
    until: Annotated[tuple[float, float] | None, Parameter(negative="")] = None,
    through: Annotated[bool, Parameter(negative="")] = False,
    most_points: Whole = 2000,
    as_json: Json = False,
    csv: File | None = None,
) -> int:
    """Follow the poses of a scene from its first one: past limits of its driver, on to the other branch, and back.

    Exit codes: 0 the path ended where it was to end, or closed, or at a bifurcation; 1 it ended for want of a pose, of
    a small enough step or of points; 2 the scene is invalid, or has no such driver.

    Parameters
    ----------
    driver
        The driver whose value is the path's parameter; by default the only one, or else the time.
    backwards
        Set out with a falling parameter.
    until
        Two values of the parameter, at which the path ends.
    through
        Go straight on where branches cross, instead of ending there.
    most_points
        Number of poses after which the path ends.
    csv
        Write the poses to this file, one row per pose, instead of printing their table.
    """
    read = load(scene)
    writable("csv", csv, scene)
    positive("most-points", most_points)
    if until is not None and not -np.inf < min(until) < max(until) < np.inf:
        raise UsageError(f"--until: expected two different finite values, got {until[0]} and {until[1]}")
    drivers = read.mechanism.drivers
    parameter = driver if driver is not None else (drivers[0].name if len(drivers) == 1 else TIME)
    try:
        driven = read if parameter == TIME else driven_by(read, parameter)
    except UnknownName as error:
        raise UsageError(str(error)) from error
    how: dict[str, Any] = {"direction": -1 if backwards else 1, "choose": straight_on if through else None}
    try:
        path = follow(driven, until=until and (min(until), max(until)), most_points=most_points, **how)
    except InvalidRequest as error:
        raise UsageError(f"--{error}" if error.argument == "until" else str(error)) from error
    if csv is not None:
        with naming(csv):
            path.to_csv(csv)
    if as_json:
        print(json.dumps(_to_json(read, parameter, path)))
    else:
        if csv is None:
            print_numbers(wide(path), len(path.first_columns))
        print("\n".join(lines(parameter, path)))
    return 0 if path.end in (TraceEnd.RANGE, TraceEnd.CLOSED, TraceEnd.BIFURCATION) else 1
