"""How far an input goes: inside its range, and as near to a singular pose as is asked."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn

from crosscheck.strategies.linkages import AnyLinkage, Decades, draw_power_of_ten, longest
from refkin.joints import GROUND
from refkin.joints.annotations import is_flag
from refkin.model import Member, Scene
from refkin.scenes.linkages import ANYWHERE, Branch, Interval, InvertedSliderCrank, SliderCrank

Input = tuple[str, str]
"""(driven, relative_to), see `refkin.scenes.linkages.Linkage.INPUTS`."""


class Hardness(Member):
    """How near to a singular pose a scene goes on purpose.

    REGULAR keeps away; LIMIT goes to 10^-k of a limit position or dead centre (rad, or longest lengths of a slide);
    CHANGE_POINT has a slack of 10^-k shortest lengths and goes to the pose where that shows, or through it.
    """

    REGULAR = "regular"
    LIMIT = "limit"
    CHANGE_POINT = "change-point"


def check_asked(samples: int, **asked: tuple[Collection[str], Iterable[str]]) -> None:
    """Raise ValueError of a number of times below 1, and of words, by name, of which some are not among those known.

    A word that is not known would draw nothing, and nobody would miss it; of letters each would be looked for.

    Parameters
    ----------
    samples : int
        How many times a scene is to have.
    **asked : (collection of str, iterable of str)
        What is given by this name, and what is known.
    """
    for name, (given, known) in asked.items():
        words = isinstance(given, Collection) and not isinstance(given, str)
        if not (words and len(given) and all(word in tuple(known) for word in given)):
            raise ValueError(f"{name}: expected some of {', '.join(known)}, in a list, got {given!r}")
    if not (isinstance(samples, int | np.integer) and not is_flag(samples) and samples >= 1):
        raise ValueError(f"samples: expected a whole number from 1 on, got {samples!r}")


@dataclass(frozen=True)
class Binned:
    """A drawn scene, and what reports are binned by, as `scenes.Drawn` has it.

    `distance` says how near it comes to a pose without an assembly, as its kind has it; `hardness` where it goes on
    purpose.
    """

    scene: Scene
    kind: str
    branch: Branch = Branch.OPEN
    distance: float = 0.0
    hardness: Member = Hardness.REGULAR
    grashof: None = None


def draw_span(
    draw: DrawFn, linkage: AnyLinkage, pair: Input, hardness: Hardness, decades: Decades, widest: float
) -> tuple[float, float]:
    """Draw (first, last): the input may take any value between, and goes to `last` if that is near a singular pose.

    Spans of an angle are at most one turn.

    Parameters
    ----------
    draw : callable
        What Hypothesis draws with.
    linkage : Linkage
    pair : (driven, relative_to)
        Which input is driven.
    hardness : Hardness
        Where it goes on purpose.
    decades : (float, float)
        Of the distance from a limit.
    widest : float
        Of a span [rad].
    """
    if hardness is Hardness.REGULAR:
        return _regular(draw, linkage, pair, widest)
    if hardness is Hardness.LIMIT:
        return _to_limit(draw, linkage, pair, decades, widest)
    if linkage.closure_margin(critical_input(linkage, pair), *pair) >= 0:
        return _through(draw, linkage, pair, widest)
    return _to_gap(draw, linkage, pair, widest)


def critical_input(linkage: AnyLinkage, pair: Input) -> float:
    """Return the input at which a linkage is flat if it is at a change point, and nearly so if it is near one."""
    return min(turning_inputs(linkage, pair), key=lambda value: abs(linkage.closure_margin(value, *pair)))


def turning_inputs(linkage: AnyLinkage, pair: Input) -> list[float]:
    """Return the inputs, up to full turns, at which the closure margin is largest or smallest away from limits.

    Two links that are held at an angle are farthest and nearest end to end when they lie in line; a link that is held
    at an angle against a guide reaches highest and lowest at right angles to it.
    """
    driven, relative_to = pair
    if driven == "slider":
        return [0.0]
    on_guide = isinstance(linkage, SliderCrank) and relative_to == GROUND
    on_lever = isinstance(linkage, InvertedSliderCrank) and driven == "lever"
    first = (linkage.angle if relative_to == GROUND else 0.0) + (math.pi / 2 if on_guide or on_lever else 0.0)
    return [first, first + math.pi]


def _regular(draw: DrawFn, linkage: AnyLinkage, pair: Input, widest: float) -> tuple[float, float]:
    low, high = draw(st.sampled_from(_between_flat_poses(linkage, pair)), label="interval")
    if math.isfinite(low):
        margins = st.floats(0.0625, 0.375)
        width = high - low
        low, high = low + width * draw(margins, label="margin"), high - width * draw(margins, label="margin")
    else:
        low = draw(st.floats(-math.pi, math.pi), label="start")
        high = low + draw(st.just(math.tau) | st.floats(0.75, 6.25), label="turned")
    high = min(high, low + widest)
    if pair[0] != "slider":
        turns = math.tau * draw(st.sampled_from((0, 0, 0, 0, 1, -2)), label="turns before")
        low, high = low + turns, high + turns
    return draw(st.sampled_from(((low, high), (high, low))), label="from, to")


def _to_limit(draw: DrawFn, linkage: AnyLinkage, pair: Input, decades: Decades, widest: float) -> tuple[float, float]:
    low, high = draw(st.sampled_from(linkage.input_range(*pair)), label="interval")
    unit = longest(linkage) if pair[0] == "slider" else 1.0
    near = unit * draw_power_of_ten(draw, decades)
    away = min(widest, (high - low) * draw(st.floats(0.125, 0.75), label="part of the range"))
    return draw(st.sampled_from(((high - away, high - near), (low + away, low + near))), label="from, to")


def _through(draw: DrawFn, linkage: AnyLinkage, pair: Input, widest: float) -> tuple[float, float]:
    """Draw spans that end at the nearly flat pose, or go beyond it."""
    middle = critical_input(linkage, pair)
    low, high = next(_shifted_over(middle, interval) for interval in linkage.input_range(*pair))
    rooms = [min(room, math.pi, widest / 2) for room in (middle - low, high - middle)]
    parts = st.floats(0.25, 0.75)
    side = draw(st.sampled_from((1, -1)), label="side")
    before, after = rooms[::side]
    beyond = draw(st.just(0.0) | parts, label="beyond")
    return middle - side * before * draw(parts, label="before"), middle + side * after * beyond


def _to_gap(draw: DrawFn, linkage: AnyLinkage, pair: Input, widest: float) -> tuple[float, float]:
    """Draw spans that end beside the small gap around the critical input, by a part of its half width."""
    middle = critical_input(linkage, pair)
    low, high = draw(st.sampled_from(linkage.input_range(*pair)), label="interval")
    off = low - middle, high - middle
    from_low, from_high = (abs(x if pair[0] == "slider" else math.remainder(x, math.tau)) for x in off)
    ends = [(low, 1, from_low), (high, -1, from_high)]
    half = min(from_low, from_high)
    end, inward, _ = draw(st.sampled_from([e for e in ends if e[2] < 2 * half]), label="end")
    near = half * draw(st.floats(0.125, 1.0), label="part of the gap")
    away = min(widest, (high - low) * draw(st.floats(0.125, 0.75), label="part of the range"))
    return end + inward * away, end + inward * near


def _between_flat_poses(linkage: AnyLinkage, pair: Input) -> list[Interval]:
    """Return the input's range, cut where the flat pose of an exact change point lies inside."""
    intervals = linkage.input_range(*pair)
    if linkage.slack != 0.0:
        return list(intervals)
    flat = critical_input(linkage, pair)
    if intervals == ANYWHERE:
        return [(flat, flat + math.tau)]
    spans = []
    for low, high in intervals:
        inside = flat + math.tau * math.floor((high - flat) / math.tau)
        spans += [(low, inside), (inside, high)] if low < inside < high else [(low, high)]
    return spans


def _shifted_over(value: float, interval: Interval) -> Interval:
    """Return the interval, full turns away, that holds an angle; as it is if it holds all."""
    low, high = interval
    if low < value < high:
        return low, high
    turns = math.tau * math.floor((value - low) / math.tau)
    return low + turns, high + turns
