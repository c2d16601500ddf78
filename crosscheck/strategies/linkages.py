"""Linkages by construction: class and slack are drawn, and the lengths follow from them; nothing is filtered out."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from itertools import permutations
from typing import Any

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn

from refkin.scenes.linkages import FourBar, GrashofClass, InvertedSliderCrank, SliderCrank

AnyLinkage = FourBar | SliderCrank | InvertedSliderCrank
Decades = tuple[float, float]
"""(k, k'): a number is drawn whose logarithm lies evenly between those of 10^-k and 10^-k'."""

SHORTEST = {
    GrashofClass.CRANK_ROCKER: "crank",
    GrashofClass.DOUBLE_CRANK: "ground",
    GrashofClass.ROCKER_CRANK: "rocker",
    GrashofClass.DOUBLE_ROCKER: "coupler",
}
SIGN_OF_SLACK = {c: 1 for c in SHORTEST} | {GrashofClass.TRIPLE_ROCKER: -1, GrashofClass.CHANGE_POINT: 0}
LINKS = tuple(permutations(("crank", "ground", "rocker", "coupler")))
ORDERS = {c: st.sampled_from([o for o in LINKS if o[0] == SHORTEST.get(c, o[0])]) for c in GrashofClass}
NEAR_CHANGE_POINT = st.sampled_from(("the shorter turns fully", "the shorter rocks"))
FORMS = st.just("no offset") | NEAR_CHANGE_POINT
COORDINATES = st.floats(-1.0, 1.0, allow_subnormal=False)
ORIGINS = st.just((0.0, 0.0)) | st.tuples(COORDINATES, COORDINATES)
ANGLES = st.just(0.0) | st.floats(-math.pi, math.pi)
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

    The linkage is turned by any angle. The slack (p + q) - (s + l) is a good part of the shortest link, exactly 0 for a
    change point. ValueError if the bounds contradict each other.

    Examples from this strategy shrink towards a crank-rocker of about one metre at the origin.

    Parameters
    ----------
    min_size, max_size : float
        Bounds of the shortest link [m].
    max_ratio : float
        Bound of the longest link over the shortest.
    max_offset : float
        How far from the scene's origin the linkage may lie, in shortest links.
    classes : collection of GrashofClass
        Those that are drawn.
    slack_decades : (float, float), optional
        (k, k'): the slack is +-10^-k to +-10^-k' shortest links, and no change point is drawn.
    """
    _check_bounds(min_size, max_size, max_ratio, max_offset, slack_decades)
    allowed = [c for c in GrashofClass if c in classes and not (slack_decades and c is GrashofClass.CHANGE_POINT)]
    if not allowed:
        raise ValueError(f"classes: expected a Grashof class that has a slack to draw, got {classes!r}")
    if slack_decades and GrashofClass.TRIPLE_ROCKER in allowed:
        allowed += [GrashofClass.TRIPLE_ROCKER] * 3  # the one class below 0 as often as the four above
    grashof = draw(st.sampled_from(allowed), label="Grashof class")
    size = draw_size(draw, (min_size, max_size))
    lengths = _draw_lengths(draw, grashof, size, max_ratio, slack_decades)
    order = draw(ORDERS[grashof], label="links from short to long")
    link = dict(zip(order, lengths, strict=True))
    return FourBar(
        link["ground"], link["crank"], link["coupler"], link["rocker"], **draw_place(draw, max_offset * size)
    )


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
    ``|rod - crank| - |offset|``.

    Examples from this strategy shrink towards a central slider-crank of about one metre at the origin.

    Parameters
    ----------
    min_size, max_size, max_ratio, max_offset, slack_decades
        As for `four_bars`.
    """
    crank, rod, offset, place = _draw_sliding(draw, (min_size, max_size), max_ratio, max_offset, slack_decades)
    return SliderCrank(crank, rod, offset, **place)


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

    Bounds are those of `slider_cranks`; the slack is ``|ground - crank| - |offset|``.

    Examples from this strategy shrink towards a line through the pivot, about one metre at the origin.

    Parameters
    ----------
    min_size, max_size, max_ratio, max_offset, slack_decades
        As for `four_bars`.
    """
    crank, ground, offset, place = _draw_sliding(draw, (min_size, max_size), max_ratio, max_offset, slack_decades)
    return InvertedSliderCrank(ground, crank, offset, **place)


def _draw_lengths(
    draw: DrawFn, grashof: GrashofClass, size: float, max_ratio: float, decades: Decades | None
) -> list[float]:
    """Draw s < p < q < l with a slack of the sign of the class.

    With p = s + d the longest is l = p + q - s - slack = q + d - slack: above q while slack < d, and short enough to
    assemble (l < s + p + q) while -slack < 2 s.
    """
    step = (max_ratio - 3) / 3
    d = draw(st.floats(0.25, step), label="p - s")
    above = draw(st.floats(0.125, step), label="q - p")
    # Drawn for a change point too: classes with as many draws as another shrink to the first of them.
    slack = _draw_slack(draw, 1.5 if grashof is GrashofClass.TRIPLE_ROCKER else d, decades) * SIGN_OF_SLACK[grashof]
    s, d, above, slack = _on_grid((size, d * size, above * size, slack * size), max_ratio * size)
    return [s, s + d, s + d + above, s + 2 * d + above - slack]


def _draw_sliding(
    draw: DrawFn, bounds: tuple[float, float], max_ratio: float, max_offset: float, decades: Decades | None
) -> tuple[float, float, float, dict[str, Any]]:
    """Draw two lengths, an offset below their sum with |difference| - |offset| = slack, and a place."""
    _check_bounds(*bounds, max_ratio, max_offset, decades)
    size = draw_size(draw, bounds)
    form = draw(NEAR_CHANGE_POINT if decades else FORMS, label="form")
    slack = more = draw(st.floats(0.25, max_ratio - 1), label="difference")
    if form == "the shorter turns fully":
        slack = _draw_slack(draw, more, decades)
    elif form == "the shorter rocks":
        slack = -_draw_slack(draw, 1.5, decades)
    short, more, slack = _on_grid((size, more * size, slack * size), max_ratio * size)
    offset = (more - slack) * draw(st.sampled_from((1, -1)), label="side of the offset")
    first_is_shorter = draw(st.sampled_from((True, False)), label="first is shorter")
    lengths = (short, short + more) if first_is_shorter else (short + more, short)
    return *lengths, offset, draw_place(draw, max_offset * size)


def _draw_slack(draw: DrawFn, largest: float, decades: Decades | None) -> float:
    """Draw a slack in shortest links: an eighth to seven eighths of the largest, or in the decades."""
    if decades is None:
        return largest * draw(st.floats(0.125, 0.875), label="part of the largest slack")
    return draw_power_of_ten(draw, decades)


def draw_power_of_ten(draw: DrawFn, decades: Decades) -> float:
    """Draw a number from 10^-k to 10^-k', evenly by its logarithm."""
    return math.pow(10.0, -draw(st.floats(*decades), label="decade"))


def longest(linkage: AnyLinkage) -> float:
    """Return the longest length of a linkage [m]."""
    return float(max(getattr(linkage, key) for key in linkage.LENGTHS))


def draw_size(draw: DrawFn, bounds: tuple[float, float]) -> float:
    """Draw a length between bounds, evenly by its logarithm [m]."""
    return math.pow(10.0, draw(st.floats(*map(math.log10, bounds)), label="decade of the size"))


def draw_place(draw: DrawFn, radius: float) -> dict[str, Any]:
    """Draw where a linkage stands."""
    x, y = draw(ORIGINS, label="origin")
    return {"origin": (x * radius, y * radius), "angle": draw(ANGLES, label="angle")}


def _on_grid(lengths: Sequence[float], longest: float) -> list[float]:
    step = math.ldexp(1.0, math.frexp(longest)[1] - BITS)
    return [round(length / step) * step for length in lengths]


def _check_bounds(
    smallest: float, largest: float, max_ratio: float, max_offset: float, decades: Decades | None
) -> None:
    if not 0 < smallest <= largest < math.inf:
        raise ValueError(f"min_size, max_size: expected 0 < min_size <= max_size, got {smallest!r}, {largest!r}")
    if not 4 <= max_ratio <= 2.0 ** (BITS / 2):
        raise ValueError(f"max_ratio: expected 4 to 2^{BITS // 2}, got {max_ratio!r}")
    if not 0 <= max_offset < math.inf:
        raise ValueError(f"max_offset: expected 0 or more, got {max_offset!r}")
    finest = BITS * math.log10(2) - math.log10(max_ratio) - 2  # two digits of the slack are kept on the grid
    if decades is not None and not 1 <= decades[0] <= decades[1] <= finest:
        raise ValueError(f"slack_decades: expected 1 <= k <= k' <= {finest:.3g} at this max_ratio, got {decades!r}")
