"""What `refkin.solve` returns: a motion that knows its scene, so that it can be drawn, tabled and kept in a file."""

from __future__ import annotations

from dataclasses import dataclass, fields
from html import escape
from typing import Any, Self

import numpy as np

from refkin.errors import InvalidRequest
from refkin.model import Scene
from refkin.motion import Motion
from refkin.output.tables import Tabled


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
        if t is not None and not np.isfinite(t):
            raise InvalidRequest("t", "a finite time [s]", repr(t))
        from refkin.output.drawing import RATES, Drawing
        from refkin.output.picture import Picture

        drawing = Drawing(self.scene, self)
        rates = [rate for rate, wanted in zip(RATES, (velocity, acceleration), strict=True) if wanted]
        return Picture(drawing, 0 if t is None else int(np.argmin(np.abs(drawing.t - t))), rates)

    def animate(self, seconds: float = 4.0) -> Any:
        """Return a picture of the motion that plays by itself, `seconds` long [s]; raises as `plot` does."""
        if not 0 < seconds < np.inf:
            raise InvalidRequest("seconds", "a number above 0", repr(seconds))
        from refkin.output.drawing import Drawing
        from refkin.output.picture import Picture

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
