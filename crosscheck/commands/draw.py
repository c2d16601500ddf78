"""`crosscheck draw` and `crosscheck animate`: a scene's mechanism as a picture, still or moving."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from crosscheck.commands.usage import SceneFile, positive, writable
from crosscheck.errors import PASS, CannotRun, UsageError, naming
from refkin.model import Effect, Scene
from refkin.output import MissingPackage, NothingToDraw, SceneMotion
from refkin.output.drawing import UnknownFormat
from refkin.scenes.files import load
from refkin.solving.solve import solve

Flag = Annotated[bool, Parameter(negative="")]


def draw(
    scene: SceneFile,
    *,
    out: Path | None = None,
    time: float | None = None,
    velocity: Flag = False,
    acceleration: Flag = False,
) -> int:
    """Draw the mechanism of a scene in one pose, with the curves of its points.

    Exit codes: 0 drawn, 2 the scene or the request is invalid (nothing here writes files of that ending), 4 there is no
    pose to draw, or the file cannot be written (matplotlib is missing).

    Parameters
    ----------
    out
        The file, .svg in the working folder by default; .png, .pdf need the extra `figures`.
    time
        The time of the pose [s]; the nearest of the scene's times is taken, the first by default.
    velocity
        Show velocities by arrows at the joints and points.
    acceleration
        Show accelerations so, too.
    """
    if time is not None and not np.isfinite(time):
        raise UsageError(f"--time: expected a finite number [s], got {time}")
    file = out or Path(f"{scene.stem}.svg")
    writable("out", file, scene)
    with _one_line(), naming(file):
        effects = frozenset(Effect) if acceleration else frozenset({Effect.VELOCITY} if velocity else ())
        picture = _drawable(load(scene), effects).plot(time, velocity=velocity, acceleration=acceleration)
        picture.save(file)
    drawing, k = picture.drawing, picture.k
    print(f"{file}: {drawing.scene.name}, t = {drawing.t[k]:g} s, {drawing.status[k]}")
    return PASS


def animate(scene: SceneFile, *, out: Path | None = None, seconds: float = 4.0) -> int:
    """Draw the motion of a scene as a file that plays by itself.

    Exit codes: as `crosscheck draw`.

    Parameters
    ----------
    out
        The file, .svg in the working folder by default; .gif needs the extra `figures`, .mp4 ffmpeg as well.
    seconds
        How long one run of the motion is shown [s].
    """
    positive("seconds", seconds)
    file = out or Path(f"{scene.stem}-moving.svg")
    writable("out", file, scene)
    with _one_line(), naming(file):
        picture = _drawable(load(scene), frozenset()).animate(seconds)
        picture.save(file)
    print(f"{file}: {picture.drawing.scene.name}, {len(picture.drawing.t)} poses in {seconds:g} s")
    return PASS


def _drawable(scene: Scene, effects: frozenset[Effect]) -> SceneMotion:
    """Return the motion of all bodies of a scene, unproved."""
    return solve(replace(scene, bodies_wanted=None, effects=effects, evidence=frozenset()))


@contextmanager
def _one_line() -> Iterator[None]:
    """End the command where there is nothing to draw, or no way to."""
    try:
        yield
    except UnknownFormat as error:
        raise UsageError(str(error)) from error
    except (NothingToDraw, MissingPackage) as error:
        raise CannotRun(str(error)) from error
