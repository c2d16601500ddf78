"""The same pictures by matplotlib: PNG, PDF, GIF, MP4. Installed by the extra `figures`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib import animation
from matplotlib.figure import Figure  # not pyplot: it wants a screen, and leaves figures open
from matplotlib.markers import CARETUP
from matplotlib.patches import Circle, Polygon

from refkin.output.drawing import Drawing, UnknownFormat
from refkin.output.spatial import Shape
from refkin.output.svg import STYLES, frames_of

RESOLUTION = 110
"""Dots per inch."""


def save_still(drawing: Drawing, file: Path, k: int = 0, rates: Sequence[str] = ()) -> None:
    """Write one pose in the format that the file's name ends in.

    Parameters
    ----------
    drawing, k, rates
        As in `svg.still`.
    file : Path
        Its ending says which format.

    Raises
    ------
    UnknownFormat
        If matplotlib has no such format.
    """
    arrows = [arrow for rate in rates for arrow in drawing.arrows(k, rate)]
    figure, axes = _page(drawing, arrows)
    if file.suffix[1:].lower() not in figure.canvas.get_supported_filetypes():
        raise UnknownFormat(f"{file}: expected a file of .svg, .png, .pdf or another that matplotlib writes")
    shapes = [*drawing.curves, *(shape for part in drawing.parts for shape in part.at(k))]
    for shape in (*shapes, *arrows):
        _add(axes, shape)
    figure.savefig(file)


def save_animation(drawing: Drawing, file: Path, seconds: float = 4.0) -> None:
    """Write the motion as GIF, or as MP4 where ffmpeg is installed.

    Parameters
    ----------
    drawing : Drawing
    file : Path
        Its ending says which format.
    seconds : float
        How long the film is [s].

    Raises
    ------
    UnknownFormat
        If there is no writer for such a file.
    """
    writers = {".gif": "pillow", ".mp4": "ffmpeg"}
    writer = writers.get(file.suffix.lower(), "")
    if not animation.writers.is_available(writer):
        known = ", ".join(suffix for suffix, name in writers.items() if animation.writers.is_available(name))
        lacking = f" ({writer} is not installed)" if writer else ""
        raise UnknownFormat(
            f"{file}: expected a file of {known or 'no kind: matplotlib can write none here'} or .svg{lacking}"
        )
    figure, axes = _page(drawing)
    frames = frames_of(drawing)
    box = axes.axis()

    def show(k: int) -> Sequence[Any]:
        axes.clear()
        axes.set_axis_off()
        for shape in (*drawing.curves, *(shape for part in drawing.parts for shape in part.at(k))):
            _add(axes, shape)
        axes.axis(box)
        return ()

    moving = animation.FuncAnimation(figure, show, frames=frames)
    moving.save(file, writer=writer, fps=max(1, round(len(frames) / seconds)), dpi=RESOLUTION)


def _page(drawing: Drawing, arrows: Sequence[Shape] = ()) -> tuple[Any, Any]:
    (x0, y0), (x1, y1) = drawing.box_with(arrows)
    margin = 0.06 * max(x1 - x0, y1 - y0)
    figure = Figure(figsize=(6.4, min(7.2, max(2.0, 6.4 * (y1 - y0 + 2 * margin) / (x1 - x0 + 2 * margin)))))
    figure.set_dpi(RESOLUTION)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.axis((x0 - margin, x1 + margin, y0 - margin, y1 + margin))
    return figure, axes


def _add(axes: Any, shape: Shape) -> None:
    style, (x, y) = STYLES[shape.role], shape.points
    line, width = style["stroke"], float(style.get("stroke-width", "1")) * 0.75
    fill = style["fill"] if style["fill"].startswith("#") else "none"
    if shape.role in ("velocity", "acceleration"):
        arrow = {"arrowstyle": "->", "color": line, "lw": width}
        axes.annotate("", (x[1], y[1]), (x[0], y[0]), arrowprops=arrow, zorder=5)
    elif shape.role in ("pin", "ground"):
        look = {"marker": CARETUP, "ms": 11} if shape.role == "ground" else {"marker": "o", "ms": 6, "zorder": 4}
        axes.plot(x, y, mec=line, mfc=fill, ls="none", **look)
    elif shape.radius:
        axes.add_patch(Circle((x[0], y[0]), shape.radius, fc=fill, ec=line, lw=width))
    elif fill != "none" and len(x) > 2:
        axes.add_patch(Polygon(shape.points.T, fc=fill, ec=line, lw=width, joinstyle="round"))
    else:
        axes.plot(x, y, color=line, lw=width, ls="--" if "stroke-dasharray" in style else "-", solid_capstyle="round")
