"""What `refkin.solve` returns: a motion that knows its scene, so that it can be drawn, tabled and kept in a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any, Self

import numpy as np

from refkin.errors import expect
from refkin.joints.annotations import check, is_flag, is_real
from refkin.model import Scene
from refkin.motion import Motion
from refkin.output.tables import MissingPackage, Tabled


@dataclass(frozen=True, repr=False)
class Picture:
    """One pose of a mechanism, or its motion.

    Attributes
    ----------
    drawing : refkin.output.Drawing
    k : int or None
        Number of the pose among those of the drawing; None for the motion.
    rates : sequence of {"velocity", "acceleration"}
        What is shown by arrows in a pose.
    seconds : float
        How long one run of the motion is shown [s].
    """

    drawing: Any
    k: int | None = 0
    rates: Sequence[str] = ()
    seconds: float = 4.0

    @property
    def svg(self) -> str:
        """The text of an SVG file; a motion plays by itself."""
        from refkin.output.svg import animated, still

        if self.k is None:
            return animated(self.drawing, self.seconds)
        return still(self.drawing, self.k, self.rates)

    def _repr_svg_(self) -> str:
        return self.svg

    def __repr__(self) -> str:
        poses = f"{len(self.drawing.t)} poses" if self.k is None else f"t = {self.drawing.t[self.k]:g} s"
        return f"<Picture of {self.drawing.scene.name}, {poses}: shown by a notebook, or .save('file.svg')>"

    def save(self, file: str | Path) -> None:
        """Write it as .svg; or, by matplotlib, as .png, .pdf, a motion as .gif or, with ffmpeg, .mp4.

        Raises
        ------
        NothingToDraw
            If nobody writes such a file.
        MissingPackage
            If it takes matplotlib, which is not installed.
        """
        expect("file", file, str, PathLike)
        file = Path(file)
        if file.suffix.lower() == ".svg":
            file.write_text(self.svg, encoding="utf-8")
            return
        try:
            from refkin.output import raster
        except ImportError as error:
            message = f"{file}: matplotlib is needed for it: pip install 'refkin[figures]' ({error})"
            raise MissingPackage(message) from error
        if self.k is None:
            raster.save_animation(self.drawing, file, self.seconds)
        else:
            raster.save_still(self.drawing, file, self.k, self.rates)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SceneMotion(Motion, Tabled):
    """The motion of a scene.

    Attributes
    ----------
    scene : Scene
        What was asked; all else is as in `refkin.Motion`.
    """

    scene: Scene

    @classmethod
    def of(cls, scene: Scene, motion: Motion) -> Self:
        """Return a motion with the scene that it answers."""
        return cls(scene=scene, **{key.name: getattr(motion, key.name) for key in fields(Motion)})

    def plot(self, t: float | None = None, *, velocity: bool = False, acceleration: bool = False) -> Any:
        """Return a picture of one pose, with the curves of the scene's points.

        Parameters
        ----------
        t : float, optional
            The pose nearest to this time [s]; the first by default.
        velocity, acceleration : bool
            Whether arrows at joints and points show them.

        Returns
        -------
        Picture
            A notebook shows it; `.save("file.svg")` writes it.

        Raises
        ------
        InvalidRequest
            If the time is no finite number.
        NothingToDraw
            If there is no pose, a body is lacking, or a rate was not called for.
        """
        check("t", "a finite time [s]", t, t is None or (is_real(t) and np.isfinite(t)))
        for rate, shown in (("velocity", velocity), ("acceleration", acceleration)):
            check(rate, "True or False", shown, is_flag(shown))
        from refkin.output.drawing import RATES, Drawing

        drawing = Drawing(self.scene, self)
        rates = [rate for rate, wanted in zip(RATES, (velocity, acceleration), strict=True) if wanted]
        first, last = drawing.t[[0, -1]]
        near = first if t is None else np.clip(t, first, last)  # from far away all times would be as near
        return Picture(drawing, int(np.argmin(np.abs(drawing.t - near))), rates)

    def animate(self, seconds: float = 4.0) -> Any:
        """Return a picture of the motion that plays by itself, `seconds` long [s]; raises as `plot` does."""
        check("seconds", "a number above 0", seconds, is_real(seconds) and 0 < seconds < np.inf)
        from refkin.output.drawing import Drawing

        return Picture(Drawing(self.scene, self), None, (), seconds)

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the text, and below it the picture of the first pose, if there is one."""
        return f"<pre>{escape(repr(self))}</pre>{self._repr_svg_() or ''}"

    def _repr_svg_(self) -> str | None:
        from refkin.output.drawing import NothingToDraw

        try:
            return str(self.plot().svg)
        except NothingToDraw:
            return None

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.bodies)
