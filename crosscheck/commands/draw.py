"""`crosscheck draw` and `crosscheck animate`: a scene's mechanism as a picture, still or moving."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from crosscheck.errors import PASS, CannotRun, UsageError
from refkin.model import Effect, Scene
from refkin.output import Drawing, NothingToDraw, animated, still
from refkin.scenes.files import load
from refkin.solving.solve import solve

Flag = Annotated[bool, Parameter(negative="")]


def draw(
    scene: Path,
    *,
    out: Path | None = None,
    time: float | None = None,
    velocity: Flag = False,
    acceleration: Flag = False,
) -> int:
    """Draw the mechanism of a scene in one pose, with the curves of its points.

    Exit codes: 0 drawn, 2 the scene or the request is invalid, 4 there is no pose to draw, or nobody writes such a file
    (matplotlib is missing, or does not know its ending).

    Parameters
    ----------
    scene
        A scene file (TOML, or JSON if it ends in .json).
    out
        The file, .svg in the working folder by default; .png, .pdf need the extra `figures`.
    time
        The time of the pose [s]; the nearest of the scene's times is taken, the first by default.
    velocity
        Show velocities by arrows at the joints and points.
    acceleration
        Show accelerations so, too.
    """
    rates = [name for name, wanted in (("velocity", velocity), ("acceleration", acceleration)) if wanted]
    with _one_line():
        drawing, file = _drawing(load(scene), rates), out or Path(f"{scene.stem}.svg")
        k = 0 if time is None else int(np.argmin(np.abs(drawing.t - time)))
        if file.suffix.lower() == ".svg":
            file.write_text(still(drawing, k, rates), encoding="utf-8")
        else:
            _raster(file).save_still(drawing, file, k, rates)
    print(f"{file}: {drawing.scene.name}, t = {drawing.t[k]:g} s, {drawing.status[k]}")
    return PASS


def animate(scene: Path, *, out: Path | None = None, seconds: float = 4.0) -> int:
    """Draw the motion of a scene as a file that plays by itself.

    Exit codes: as `crosscheck draw`.

    Parameters
    ----------
    scene
        A scene file (TOML, or JSON if it ends in .json).
    out
        The file, .svg in the working folder by default; .gif needs the extra `figures`, .mp4 ffmpeg as well.
    seconds
        How long one run of the motion is shown [s].
    """
    if not 0 < seconds < np.inf:
        raise UsageError(f"--seconds: expected a number above 0, got {seconds}")
    with _one_line():
        drawing, file = _drawing(load(scene), []), out or Path(f"{scene.stem}-moving.svg")
        if file.suffix.lower() == ".svg":
            file.write_text(animated(drawing, seconds), encoding="utf-8")
        else:
            _raster(file).save_animation(drawing, file, seconds)
    print(f"{file}: {drawing.scene.name}, {len(drawing.t)} poses in {seconds:g} s")
    return PASS


def _drawing(scene: Scene, rates: list[str]) -> Drawing:
    effects = frozenset(Effect) if Effect.ACCELERATION in rates else frozenset(map(Effect, rates))
    asked = replace(scene, bodies_wanted=None, effects=effects, evidence=frozenset())
    return Drawing(asked, solve(asked))


@contextmanager
def _one_line() -> Iterator[None]:
    """End the command where there is nothing to draw, or no way to."""
    try:
        yield
    except NothingToDraw as error:
        raise CannotRun(str(error)) from error


def _raster(file: Path) -> ModuleType:
    try:
        from refkin.output import raster
    except ImportError as error:
        raise CannotRun(f"{file}: matplotlib is needed for it: pip install 'refkin[figures]' ({error})") from error
    return raster
