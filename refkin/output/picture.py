"""A picture: it shows itself in a notebook, and saves itself as the kind of file that a name ends in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from refkin.output.drawing import Drawing
from refkin.output.svg import animated, still
from refkin.output.tables import MissingPackage


@dataclass(frozen=True, repr=False)
class Picture:
    """One pose of a mechanism, or its motion.

    Attributes
    ----------
    drawing : Drawing
    k : int or None
        Number of the pose among those of the drawing; None for the motion.
    rates : sequence of {"velocity", "acceleration"}
        What is shown by arrows in a pose.
    seconds : float
        How long one run of the motion is shown [s].
    """

    drawing: Drawing
    k: int | None = 0
    rates: Sequence[str] = ()
    seconds: float = 4.0

    @property
    def svg(self) -> str:
        """The text of an SVG file; a motion plays by itself."""
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
