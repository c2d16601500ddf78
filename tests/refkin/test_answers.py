"""What the scenes of the corpus, of the documents and of the examples are answered with is what it was.

No test of one claim sees all that a change of a formula does. Here every answer is held against the one that was given
when the file was made: statuses and sentences as they stand, numbers within what another processor's rounding may
make of them. Whoever means a change makes the file anew, `python -m tests.refkin.test_answers`, and says what changed.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

import refkin
from refkin import analysis, fast
from refkin.model import Scene
from refkin.output.drawing import Drawing, NothingToDraw, Part
from refkin.scenes.files import load
from tests.kept import read, write
from tests.places import ROOT

FILE = Path(__file__).with_name("answers.json")
SOLVERS = {"solve": refkin.solve, "fast": fast.sweep, "plain": analysis.sweep}
AT = 4
"""Times of each scene of which numbers are kept, at most."""
LEVEL, RADIUS = 1e-8, 1024.0
"""What another processor makes of levels and sigma_min, as a part of the largest number, and how many times a radius,
of which a part is the residual that rounding happened to leave."""
WEIGHTS = np.cos(np.arange(1e4))
BY_ROUNDING = ("space-leg-too-long", "fast-guided-beside-a-change-point")
"""Scenes of which a sentence or a radius is another where another processor rounds."""
LONGEST = 0.5
"""Seconds that a scene which is kept may take."""


def files() -> dict[str, Path]:
    """Return the files of scenes, by name."""
    folders = ("tests/corpus", "docs/scenes", "examples")
    return {path.stem: path for folder in folders for path in sorted((ROOT / folder).glob("*.toml"))}


def answers(path: Path) -> dict:
    """Return what is kept of the answers to a scene, and of the drawing of the first of them."""
    scene = load(path)
    motions = {name: solver(scene) for name, solver in SOLVERS.items()}
    return {**{name: kept(motion) for name, motion in motions.items()}, "drawn": drawn(scene, motions["solve"])}


def drawn(scene: Scene, motion: refkin.Motion) -> list:
    """Return what is kept of a drawing: of each shape its role, radius and a sum of its points, by parts."""
    try:
        drawing = Drawing(replace(scene, bodies_wanted=None), motion)
    except NothingToDraw as error:
        return [str(error)]
    parts = [(part.name, part.shapes) for part in drawing.parts if isinstance(part, Part)]
    shapes = [(name, shape) for name, some in (*parts, ("curves", drawing.curves)) for shape in some]
    numbers = [[float(np.nan_to_num(s.points).ravel() @ WEIGHTS[: s.points.size]), s.radius] for _, s in shapes]
    said = [f"{name}: {shape.role}" for name, shape in shapes]
    return [said, [[float(f"{x:.10g}") for x in pair] for pair in (*numbers, *drawing.box.tolist())]]


def kept(motion: refkin.Motion) -> dict:
    """Return what is kept of a motion: of each level the sums, at some times, with weights that nothing cancels."""
    some = np.unique(np.linspace(0, len(motion.t) - 1, AT).round().astype(int))
    weights = np.cos(np.arange(len(motion.q)))
    levels = [[np.nan] if level is None else weights @ level[:, some] for level in (*motion.levels, motion.q**2)]
    radii = [asdict(motion.certified_radius)[name][some] for name in ("position", "velocity", "acceleration")]
    return {
        "said": [*motion.status, motion.message],
        "levels": [[float(f"{x:.10g}") for x in level] for level in (*levels, motion.sigma_min[some])],
        "radii": [[float(f"{x:.3g}") for x in radius] for radius in radii],
    }


KEPT = read(FILE)


@pytest.mark.parametrize("name", KEPT)
def test_an_answer_is_what_it_was(name):
    every = answers(files()[name])
    now, was = every.pop("drawn"), KEPT[name]["drawn"]
    assert now[0] == was[0]
    if now[1:]:
        assert np.array(now[1]) == pytest.approx(np.array(was[1]), abs=LEVEL * np.max(np.abs(was[1])), rel=0.0)
    for solver, now in every.items():
        was = KEPT[name][solver]

        assert now["said"] == was["said"], solver
        for level, before in zip(now["levels"], was["levels"], strict=True):
            largest = np.nanmax(np.abs([*before, 1e-3]))
            assert level == pytest.approx(before, abs=LEVEL * largest, rel=0.0, nan_ok=True), solver
        for radius, before in zip(now["radii"], was["radii"], strict=True):
            assert np.log2(radius) == pytest.approx(np.log2(before), abs=np.log2(RADIUS), nan_ok=True), solver


def quick() -> Iterator[tuple[str, dict]]:
    """Yield the names and answers of the scenes that are kept."""
    for name, path in files().items():
        start = time.process_time()
        with suppress(refkin.RefkinError):
            answer = answers(path)
            if name not in BY_ROUNDING and time.process_time() - start < LONGEST:
                yield name, answer


if __name__ == "__main__":
    write(FILE, dict(quick()))
