"""Linkages by construction: class and slack are drawn, and the lengths follow from them; nothing is filtered out."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from itertools import permutations

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from refkin.joints import Pair
from refkin.linkages import FourBar, GrashofClass, InvertedSliderCrank, SliderCrank

AnyLinkage = FourBar | SliderCrank | InvertedSliderCrank
Decades = tuple[float, float]
"""(k, k'): a number is drawn whose logarithm lies evenly between those of 10^-k and 10^-k'."""

ORDERS = tuple(permutations(("crank", "ground", "rocker", "coupler")))
SHORTEST = {
    GrashofClass.CRANK_ROCKER: "crank",
    GrashofClass.DOUBLE_CRANK: "ground",
    GrashofClass.ROCKER_CRANK: "rocker",
    GrashofClass.DOUBLE_ROCKER: "coupler",
}
BITS = 50
"""Lengths are whole multiples of 2^-50 of the longest: sums and differences of four of them are exact in a float."""


@st.composite
def four_bars(
    draw: DrawFn,
    *,
    min_size: float = 1e-3,
    max_size: float = 1e3,
    max_ratio: float = 8.0,
    max_offset: float = 10.0,
    classes: Collection[GrashofClass] = tuple(GrashofClass),
    slack_decades: Decades | None = None,
) -> FourBar:
    """Return four-bars of the given Grashof classes; no two links are equal.

    The shortest link is `min_size` to `max_size` long [m], the longest at most `max_ratio` times as much. The linkage
    stands up to `max_offset` shortest links from the origin, turned by any angle. The slack (p + q) - (s + l) is a
    good part of the shortest link, exactly 0 for a change point; or, with `slack_decades` (k, k'), +-10^-k to +-10^-k'
    of the shortest link (then no change point is drawn). ValueError if the bounds contradict each other.

    Examples from this strategy shrink towards a crank-rocker of about one metre at the origin.
    """
    _check_bounds(min_size, max_size, max_ratio, slack_decades)
    allowed = [c for c in GrashofClass if c in classes and not (slack_decades and c is GrashofClass.CHANGE_POINT)]
    if not allowed:
        raise ValueError(f"classes: expected a Grashof class that has a slack to draw, got {classes!r}")
    grashof = draw(st.sampled_from(allowed), label="Grashof class")
    size = draw(_sizes(min_size, max_size), label="size")
    lengths = draw(_lengths(grashof, size, max_ratio, slack_decades))
    order = draw(st.sampled_from([o for o in ORDERS if o[0] == SHORTEST.get(grashof, o[0])]), label="order")
    origin, angle = draw(_places(max_offset * size), label="place")
    return FourBar(**dict(zip(order, lengths, strict=True)), origin=origin, angle=angle)


@st.composite
def slider_cranks(
    draw: DrawFn,
    *,
    min_size: float = 1e-3,
    max_size: float = 1e3,
    max_ratio: float = 8.0,
    max_offset: float = 10.0,
    slack_decades: Decades | None = None,
) -> SliderCrank:
    """Return slider-cranks: central and offset, the crank shorter or longer than the rod, turning fully or not.

    Bounds are those of `four_bars`, with the shorter of crank and rod for the shortest link; the slack is
    |rod - crank| - |offset|.

    Examples from this strategy shrink towards a central slider-crank of about one metre at the origin.
    """
    _check_bounds(min_size, max_size, max_ratio, slack_decades)
    size = draw(_sizes(min_size, max_size), label="size")
    crank, rod, offset = draw(_two_and_offset(size, max_ratio, slack_decades))
    origin, angle = draw(_places(max_offset * size), label="place")
    return SliderCrank(crank, rod, offset, origin=origin, angle=angle)


@st.composite
def inverted_slider_cranks(
    draw: DrawFn,
    *,
    min_size: float = 1e-3,
    max_size: float = 1e3,
    max_ratio: float = 8.0,
    max_offset: float = 10.0,
    slack_decades: Decades | None = None,
) -> InvertedSliderCrank:
    """Return inverted slider-cranks: the lever's line through its pivot or beside it, the crank turning fully or not.

    Bounds are those of `slider_cranks`; the slack is |ground - crank| - |offset|.

    Examples from this strategy shrink towards a line through the pivot, about one metre at the origin.
    """
    _check_bounds(min_size, max_size, max_ratio, slack_decades)
    size = draw(_sizes(min_size, max_size), label="size")
    crank, ground, offset = draw(_two_and_offset(size, max_ratio, slack_decades))
    origin, angle = draw(_places(max_offset * size), label="place")
    return InvertedSliderCrank(ground, crank, offset, origin=origin, angle=angle)


@st.composite
def _lengths(
    draw: DrawFn, grashof: GrashofClass, size: float, max_ratio: float, decades: Decades | None
) -> list[float]:
    """Return s < p < q < l with a slack of the sign of the class.

    With p = s + d the longest is l = p + q - s - slack = q + d - slack: above q while slack < d, and short enough to
    assemble (l < s + p + q) while -slack < 2 s.
    """
    step = (max_ratio - 3) / 3
    d = draw(st.floats(0.25, step), label="p - s")
    above = draw(st.floats(0.125, step), label="q - p")
    slack = 0.0
    if grashof is GrashofClass.TRIPLE_ROCKER:
        slack = -draw(_slacks(1.5, decades), label="-slack")
    elif grashof is not GrashofClass.CHANGE_POINT:
        slack = draw(_slacks(d, decades), label="slack")
    s, d, above, slack = _on_grid((size, d * size, above * size, slack * size), max_ratio * size)
    return [s, s + d, s + d + above, s + 2 * d + above - slack]


@st.composite
def _two_and_offset(draw: DrawFn, size: float, max_ratio: float, decades: Decades | None) -> tuple[float, float, float]:
    """Return two lengths and an offset < their sum (so that they assemble) with |difference| - |offset| = slack."""
    forms = ("the shorter turns fully", "the shorter rocks")
    form = draw(st.sampled_from(forms if decades else ("no offset", *forms)), label="form")
    slack = more = draw(st.floats(0.25, max_ratio - 1), label="difference")
    if form == "the shorter turns fully":
        slack = draw(_slacks(more, decades), label="slack")
    elif form == "the shorter rocks":
        slack = -draw(_slacks(1.5, decades), label="-slack")
    short, more, slack = _on_grid((size, more * size, slack * size), max_ratio * size)
    side = draw(st.sampled_from((1, -1)), label="side")
    first, second = draw(st.sampled_from(((short, short + more), (short + more, short))), label="two lengths")
    return first, second, side * (more - slack)


def _slacks(largest: float, decades: Decades | None) -> SearchStrategy[float]:
    """Return slacks in shortest links: an eighth to seven eighths of the largest, or in the decades."""
    if decades is None:
        return st.floats(0.125, 0.875).map(lambda part: part * largest)
    return powers_of_ten(*decades)


def longest(linkage: AnyLinkage) -> float:
    """Return the longest length of a linkage [m]."""
    return float(max(getattr(linkage, key) for key in linkage.LENGTHS))


def powers_of_ten(first: float, last: float) -> SearchStrategy[float]:
    """Return numbers from 10^-first to 10^-last, evenly by their logarithm."""
    return st.floats(first, last).map(lambda k: 10.0**-k)


def _sizes(smallest: float, largest: float) -> SearchStrategy[float]:
    return st.floats(math.log10(smallest), math.log10(largest)).map(lambda exponent: 10.0**exponent)


def _places(radius: float) -> SearchStrategy[tuple[Pair, float]]:
    """Return (origin, angle), each of them 0 or not."""
    coordinate = st.floats(-radius, radius)
    return st.tuples(
        st.just((0.0, 0.0)) | st.tuples(coordinate, coordinate),
        st.just(0.0) | st.floats(-math.pi, math.pi),
    )


def _on_grid(lengths: Sequence[float], longest: float) -> list[float]:
    step = math.ldexp(1.0, math.frexp(longest)[1] - BITS)
    return [round(length / step) * step for length in lengths]


def _check_bounds(smallest: float, largest: float, max_ratio: float, decades: Decades | None) -> None:
    if not 0 < smallest <= largest < math.inf:
        raise ValueError(f"min_size, max_size: expected 0 < min_size <= max_size, got {smallest!r}, {largest!r}")
    if not 4 <= max_ratio <= 2.0 ** (BITS / 2):
        raise ValueError(f"max_ratio: expected 4 to 2^{BITS // 2}, got {max_ratio!r}")
    if decades is None:
        return
    finest = BITS * math.log10(2) - math.log10(max_ratio) - 2  # two digits of the slack are kept on the grid
    if not 1 <= decades[0] <= decades[1] <= finest:
        raise ValueError(f"slack_decades: expected 1 <= k <= k' <= {finest:.3g} at this max_ratio, got {decades!r}")
