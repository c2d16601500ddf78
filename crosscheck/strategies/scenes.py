"""Scenes: a linkage, an input that it can follow, a motion law, and one of many ways to model it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from crosscheck.strategies.laws import WIDEST, InputDriver, crank_drive, motion_laws, slider_drive
from crosscheck.strategies.linkages import (
    AnyLinkage,
    Decades,
    four_bars,
    inverted_slider_cranks,
    longest,
    slider_cranks,
)
from crosscheck.strategies.spans import Hardness, Input, check_asked, draw_span, turning_inputs
from crosscheck.strategies.variety import Variant, draw_variant
from refkin.joints import GROUND
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Law
from refkin.scenes.linkages import ANYWHERE, Branch, FourBar, GrashofClass, Pose, SliderCrank, rough

KINDS: Mapping[str, Any] = {
    "four-bar": four_bars,
    "slider-crank": slider_cranks,
    "inverted slider-crank": inverted_slider_cranks,
}


@dataclass(frozen=True)
class Drawn:
    """A scene and what it was made of: what reports are binned by, and its poses in closed form.

    The kind is one of `KINDS`, the linkage as it is before variants of joints and frames; `pair` (driven, relative_to)
    is the input of the linkage that the driver holds, directly or by a pin, and stays within `span`; `branch` the
    assembly, as `linkage.assemble` has it for this input.
    """

    scene: Scene
    kind: str
    linkage: AnyLinkage
    pair: Input
    branch: Branch
    hardness: Hardness
    span: tuple[float, float]
    drive: InputDriver
    law: Law
    variant: Variant

    @property
    def grashof(self) -> GrashofClass | None:
        """The Grashof class of a four-bar."""
        return self.linkage.grashof if isinstance(self.linkage, FourBar) else None

    @property
    def distance(self) -> float:
        """How near the span comes to a singular pose: its smallest `closure_margin`, in longest lengths of the linkage.

        At a limit position it is 0, and sigma_min goes with its root; at a change point it is about the slack.
        """
        low, high = sorted(self.span)
        inputs = [low, high]
        for turning in turning_inputs(self.linkage, self.pair):
            # An angle is taken by the full turns that bring it to `low` or just beyond: a span is at most one turn.
            away = 0.0 if self.pair[0] == "slider" else math.tau * math.ceil((low - turning) / math.tau)
            inputs += [turning + away] if low < turning + away < high else []
        return min(self.linkage.closure_margin(value, *self.pair) for value in inputs) / longest(self.linkage)

    def pose(self, t: float) -> Pose:
        """Return the pose of the scene's bodies at a time, angles up to full turns."""
        own = self.linkage.assemble(self.input(t), self.branch, driven=self.pair[0], relative_to=self.pair[1])
        return self.variant.apply(self.linkage, own).pose

    def input(self, t: float) -> float:
        """Return the input of the linkage at a time."""
        return self.drive.back(float(self.law(t)))

    def margin(self, t: float) -> float:
        """Return the closure margin of the linkage at a time [m], 0 at a singular pose."""
        return self.linkage.closure_margin(self.input(t), *self.pair)

    def nearest(self, few: int) -> Scene:
        """Return the scene at so many of its times, in a row, around the one that is nearest to a singular pose."""
        times = self.scene.times
        least = min(range(len(times)), key=lambda k: abs(self.margin(times[k])))
        first = max(0, min(least - few // 2, len(times) - few))
        bodies = _estimated(self.pose(times[first]), self.linkage, self.margin(times[first]))
        mechanism = replace(self.scene.mechanism, bodies=bodies)
        return replace(self.scene, mechanism=mechanism, times=times[first : first + few])


def scenes(**bounds: Any) -> SearchStrategy[Scene]:
    """Return scenes of planar linkages that assemble at all their times; bounds are those of `drawn_scenes`.

    Examples from this strategy shrink towards a linkage of about one metre at the origin, with its own joints and
    frames, and a motion law of few numbers.
    """
    return drawn_scenes(**bounds).map(lambda drawn: drawn.scene)


def drawn_scenes(
    *,
    kinds: Collection[str] = tuple(KINDS),
    hardness: Collection[Hardness] = tuple(Hardness),
    decades: Decades = (2, 10),
    samples: int = 72,
    min_size: float = 1e-3,
    max_size: float = 1e3,
    max_ratio: float = 8.0,
    max_offset: float = 10.0,
) -> SearchStrategy[Drawn]:
    """Return scenes with what they were made of; `scenes` returns the scenes alone.

    Every scene assembles at all times, on one branch. Drawn are: the kind of linkage and its lengths (bounds as in
    `four_bars`); which body or slide is the input, absolute or relative; whether a driver holds it by its angle or by
    x, y or the distance of a pin; the motion law, a value or a rate; the branch; the joints (links replaced by distance
    joints, sliders by point_on_line, a body fixed to another), which body comes first in a joint; the body frames.

    Examples from this strategy shrink towards a linkage of about one metre at the origin, with its own joints and
    frames, and a motion law of few numbers.

    Parameters
    ----------
    kinds : collection of str
        Of linkages.
    hardness : collection of Hardness
        How near to a singular pose scenes may go.
    decades : (float, float)
        (k, k'): those that go near come within 10^-k to 10^-k'.
    samples : int
        How many times a scene has.
    min_size, max_size, max_ratio, max_offset
        As for `four_bars`.
    """
    bounds = {"min_size": min_size, "max_size": max_size, "max_ratio": max_ratio, "max_offset": max_offset}
    check_asked(samples, kinds=(kinds, KINDS), hardness=(hardness, Hardness))
    made = [(h, k) for h in Hardness if h in hardness for k in KINDS if k in kinds]
    linkages = {(h, k): KINDS[k](**bounds, **_class_bounds(k, h, decades)) for h, k in made}
    return scenes_of(linkages, decades, samples)


def _class_bounds(kind: str, hard: Hardness, decades: Decades) -> dict[str, Any]:
    if hard is Hardness.CHANGE_POINT:
        return {"slack_decades": decades}
    if hard is Hardness.LIMIT and kind == "four-bar":
        # At an exact change point the input can go on in two ways: that pose is a bifurcation, no limit.
        return {"classes": [c for c in GrashofClass if c is not GrashofClass.CHANGE_POINT]}
    return {}


@st.composite
def scenes_of(
    draw: DrawFn, linkages: Mapping[tuple[Hardness, str], SearchStrategy[AnyLinkage]], decades: Decades, samples: int
) -> Drawn:
    """Draw a scene of one of the linkages, each with how near to a singular pose it goes and the name of its kind.

    Parameters
    ----------
    linkages : mapping
        (hardness, kind) -> strategy of linkages.
    decades, samples
        As for `drawn_scenes`.
    """
    hard, kind = draw(st.sampled_from(tuple(linkages)), label="hardness and kind")
    linkage = draw(linkages[hard, kind], label="linkage")
    inputs: tuple[Input, ...] = linkage.INPUTS
    if hard is Hardness.LIMIT:  # every linkage has an input with a limit
        inputs = tuple(pair for pair in inputs if linkage.input_range(*pair) != ANYWHERE)
    pair = draw(st.sampled_from((*inputs, *inputs[:2], inputs[0])), label="input")  # the first are the usual ones
    drive, span = _draw_drive(draw, linkage, pair, hard, decades)
    law, times = _draw_motion(draw, drive, span, samples, monotone=hard is not Hardness.REGULAR)
    branch = draw(st.sampled_from(Branch), label="branch")
    value = drive.back(float(law(times[0])))
    own = linkage.assemble(value, branch, driven=pair[0], relative_to=pair[1])
    variant = draw_variant(draw, linkage, own, pair)
    model = variant.apply(linkage, own)
    driver = drive.driver(model, pair, law, variant.turned(pair))
    bodies = _estimated(model.pose, linkage, linkage.closure_margin(value, *pair))
    scene = Scene(
        mechanism=Mechanism(bodies, model.joints, (driver,)),
        times=tuple(times),
        name=f"{kind} {branch}, {hard}, {driver.type} driver",
    )
    return Drawn(scene, kind, linkage, pair, branch, hard, span, drive, law, variant)


def _estimated(pose: Pose, linkage: AnyLinkage, margin: float) -> tuple[Body, ...]:
    return tuple(Body(name=name, estimate=q) for name, q in rough(pose, longest(linkage), margin).items())


def _draw_drive(
    draw: DrawFn, linkage: AnyLinkage, pair: Input, hard: Hardness, decades: Decades
) -> tuple[InputDriver, tuple[float, float]]:
    held_by = draw(HELD_BY.get(pair, st.just("angle")), label="held by")
    on_circle = held_by != "angle" and pair[0] == "crank"
    span = draw_span(draw, linkage, pair, hard, decades, WIDEST if on_circle else math.inf)
    if isinstance(linkage, SliderCrank) and pair[0] == "slider":
        return slider_drive(linkage, held_by), span
    return crank_drive(linkage, held_by, sum(span) / 2) if on_circle else InputDriver(), span


HELD_BY = {
    ("crank", GROUND): st.sampled_from(("angle", "coordinate", "distance")),
    ("slider", GROUND): st.sampled_from(("coordinate", "distance")),
}


def _draw_motion(
    draw: DrawFn, drive: InputDriver, span: tuple[float, float], samples: int, monotone: bool
) -> tuple[Law, list[float]]:
    """Draw a law of what the drive holds, and the times: from 0 on, or from a part of the duration."""
    duration = 10.0 ** draw(st.floats(-1.0, 1.0), label="decade of the duration")
    first, last = map(drive.to, span)
    law = draw(motion_laws(first=first, last=last, duration=duration, monotone=monotone))
    start = 0.0 if monotone else draw(STARTS, label="part before the first time")
    return law, np.linspace(start * duration, duration, samples).tolist()


STARTS = st.just(0.0) | st.floats(0.0, 0.5)
