"""Checks of linkages: poses that close, classes, ranges, transmission angles; found by other means each time."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from refkin.errors import InvalidScene
from refkin.motion_laws import Polynomial, Sinusoid
from refkin.scenes.linkages import ANYWHERE, Branch, DoesNotAssemble, FourBar, InvertedSliderCrank, Linkage, SliderCrank
from refkin.scenes.linkages.closures import corner, leg, link_to_line, two_links
from refkin.system import System, compile_system
from tests.claims import U, assert_near
from tests.linkages import LIMITED

PLACED: dict[str, Any] = {"origin": (0.3, -0.2), "angle": 0.4}
LINKAGES: tuple[Linkage, ...] = (
    FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0, **PLACED),
    LIMITED,
    SliderCrank(crank=1.0, rod=3.0, offset=0.4, **PLACED),
    SliderCrank(crank=2.0, rod=1.3, offset=-0.3),
    InvertedSliderCrank(ground=3.0, crank=1.2, offset=0.25, **PLACED),
)
ODD: tuple[Linkage, ...] = (
    FourBar(ground=10.0, crank=1.0, coupler=2.0, rocker=3.0),
    FourBar(ground=1.0, crank=1.0, coupler=5.0, rocker=1.0),
    SliderCrank(crank=1.0, rod=1.0, offset=3.0),
    SliderCrank(crank=1.0, rod=1.0, offset=-3.0),
    SliderCrank(crank=2.0, rod=0.5, offset=1.0),
    SliderCrank(crank=2.0, rod=0.5, offset=-1.0),
    SliderCrank(crank=1.0, rod=1.0, offset=1.5),
    SliderCrank(crank=1.0, rod=1.0, offset=-1.5),
    SliderCrank(crank=2.0, rod=1.3, offset=0.0),
    InvertedSliderCrank(ground=1.0, crank=0.9, offset=0.5),
)
"""Linkages that assemble nowhere, or whose inputs are limited on one side or on both."""
CLASSES = (
    FourBar(1.0, 4.0, 3.5, 3.0),
    FourBar(4.0, 3.5, 1.0, 3.0),
    FourBar(4.0, 3.0, 3.5, 1.0),
    FourBar(3.0, 1.0, 2.0, 2.0),
)
"""A double crank, a double rocker, a rocker-crank, a change point."""
ROUNDING = 64 * U


def inputs(linkage: Linkage) -> Iterator[tuple[str, str, float]]:
    """Yield every kind of input, at values well inside its range."""
    for driven, relative_to in linkage.INPUTS:
        low, high = linkage.input_range(driven, relative_to)[0]
        if math.isinf(low):
            low, high = 0.1, 0.1 + math.tau
        for share in (0.15, 0.4, 0.8):
            yield driven, relative_to, low + share * (high - low)


def posed(linkage: Linkage, value: float, branch: str, driven: str, relative_to: str) -> tuple[System, Any]:
    """Return the linkage's equations with the input held, and its pose by closed form, in their coordinates."""
    pose = linkage.assemble(value, branch, driven=driven, relative_to=relative_to)
    coordinate = value if driven != "slider" else pose["slider"][0]
    mechanism = linkage.mechanism(linkage.driver(Polynomial(coefficients=(coordinate,)), driven, relative_to))
    return compile_system(mechanism), np.concatenate([pose[body.name] for body in mechanism.bodies])


def test_dyads_close():
    """Two links, and a link and a line, close on the side that is asked for; two equal ones close a gap of nothing."""
    for gap, a, b in ((1.2 - 0.7j, 1.0, 0.9), (-0.2 + 1.1j, 2.0, 1.3), (0j, 1.5, 1.5), (3.0 + 0j, 1.0, 2.0)):
        for sign in (1, -1):
            alpha, beta = two_links(gap, a, b, sign)
            first, second = cmath.rect(a, alpha), cmath.rect(b, beta)
            assert_near(first + second, gap, 8 * ROUNDING, f"{gap} by {a} and {b}")
            side = (gap.conjugate() * first).imag * sign
            assert side > 0 or abs(gap) in (0.0, a + b), f"{gap} by {a} and {b}: on side {side}"
    for start, length, height in ((0.3, 1.0, -0.4), (-0.2, 0.7, 0.3)):
        for sign in (1, -1):
            link = cmath.rect(length, link_to_line(start, length, height, sign))
            assert_near(start + link.imag, height, ROUNDING, f"line at {height}")
            assert link.real * sign > 0, f"line at {height}: the link points to {link.real}"
    assert_near(corner(3.0, 4.0, 5.0), math.pi / 2, ROUNDING, "the corner of 3, 4, 5")
    assert_near(corner(2.0, 2.0, 2.0), math.pi / 3, ROUNDING, "the corner of an equilateral triangle")
    assert_near(corner(2.0, 0.0, 2.0), math.pi / 2, 0.0, "the corner at a side of no length")
    assert_near(leg(5.0, 3.0), 4.0, 0.0, "the leg of 3, 4, 5")


def test_assembled_poses_satisfy_the_joints():
    """The pose in closed form satisfies all joints and the driver, on both branches and at every kind of input."""
    for linkage in LINKAGES:
        for driven, relative_to, value in inputs(linkage):
            angles = []
            for branch in Branch:
                system, q = posed(linkage, value, branch, driven, relative_to)
                residual = system.phi(q, 0.0)
                assert_near(residual, 0.0 * residual, ROUNDING * linkage.reach, f"{linkage} {driven} {value} {branch}")
                angles.append(float(np.sign(np.linalg.det(system.phi_q(q, 0.0)))))
            assert angles[0] == -angles[1] != 0, f"{linkage}: both branches at {driven} = {value} are one"


def test_open_and_crossed_are_what_they_say():
    """Open is the four-bar with its rocker ahead of the coupler, the slider-crank whose rod points along its guide."""
    for linkage in LINKAGES:
        for value in (0.3, -0.5, 0.15):
            first, second = (linkage.assemble(value + linkage.angle, branch) for branch in Branch)
            for pose, sign in ((first, 1.0), (second, -1.0)):
                assert _side(linkage, pose) * sign > 0, f"{linkage} at {value}: sign {sign}"


def _side(linkage: Linkage, pose: Any) -> float:
    """Return a number whose sign tells the branches apart."""
    if isinstance(linkage, FourBar):
        return math.sin(pose["rocker"][2] - pose["coupler"][2])
    if isinstance(linkage, SliderCrank):
        return math.cos(pose["connecting_rod"][2] - linkage.angle)
    pin = np.array(pose["crank"][:2]) * 2 - np.array(linkage.origin)
    lever = pose["lever"]
    return float((pin - np.array(lever[:2])) @ np.array([math.cos(lever[2]), math.sin(lever[2])]))


def test_ranges_end_where_the_linkage_does():
    """Inside its range an input assembles, outside it does not; an input that turns fully assembles all around."""
    for linkage in (*LINKAGES, *ODD, *CLASSES):
        for driven, relative_to in linkage.INPUTS:
            intervals = linkage.input_range(driven, relative_to)
            if not intervals:
                around = np.linspace(-4.0, 4.0, 81)
                margins = [linkage.closure_margin(x, driven, relative_to) for x in around]
                assert max(margins) < 0.0, f"{linkage} {driven}: it assembles, but has no range"
            if intervals == ANYWHERE:
                margins = [linkage.closure_margin(x, driven, relative_to) for x in np.linspace(0.0, math.tau, 49)]
                assert min(margins) > -ROUNDING * linkage.reach, f"{linkage} {driven}: open by {min(margins)}"
                continue
            for low, high in intervals:
                for end, inward in ((low, 1.0), (high, -1.0)):
                    _demand_end(linkage, driven, relative_to, end, 1e-3 * inward)


def _demand_end(linkage: Linkage, driven: str, relative_to: str, end: float, inward: float) -> None:
    text = f"{linkage} {driven} at {end}"
    assert linkage.closure_margin(end + inward, driven, relative_to) > 0, f"{text}: does not assemble inside"
    outside = linkage.closure_margin(end - inward, driven, relative_to)
    assert outside < 0, f"{text}: assembles outside"
    assert abs(linkage.closure_margin(end, driven, relative_to)) < 1e-12 * linkage.reach, f"{text}: not at its end"
    with pytest.raises(DoesNotAssemble):
        linkage.assemble(end - inward, driven=driven, relative_to=relative_to)


SLACKS = [((1.0, 3.0, 0.4), 1.6), ((3.0, 1.0, -0.4), 1.6), ((1.0, 1.2, 0.5), -0.3)]


@pytest.mark.parametrize(("lengths", "slack"), SLACKS)
def test_the_slack_of_a_slider_crank_is_what_lies_between_its_lengths_and_its_offset(lengths, slack):
    assert_near(SliderCrank(*lengths).slack, slack, ROUNDING, f"slack of {lengths}")


def test_at_the_change_point_the_crank_turns():
    assert FourBar(3.0, 1.0, 2.0, 2.0).input_range() == ANYWHERE


def test_laws_beyond_the_range_are_refused():
    """A linkage that cannot follow a law says so; one that can is driven by it, whole turns away as well."""
    for offset, amplitude, fits in (
        (0.0, 1.9, True),
        (0.0, 2.1, False),
        (math.tau, 1.9, True),
        (-4 * math.pi, 1.9, True),
        (1.0, 1.2, False),
        (-1.0, 1.2, False),
    ):
        law = Sinusoid(offset=offset, amplitude=amplitude, angular_frequency=1.0)
        times = tuple(np.linspace(0.0, math.tau, 41).tolist())
        try:
            LIMITED.scene(law=law, times=times)
        except InvalidScene:
            assert not fits, f"{law} was refused"
        else:
            assert fits, f"{law} was not refused"


def test_slides_beyond_the_range_are_refused():
    """A slider may be driven to the very end of its range, wherever its guide lies, and not beyond."""
    for angle, along in ((0.4, 0), (1.3, 1)):
        linkage = SliderCrank(crank=1.0, rod=3.0, offset=0.4, origin=(0.3, -0.2), angle=angle)
        low, high = linkage.input_range("slider")[0]
        for first, last, fits in (
            (low + 1e-6, high - 1e-6, True),
            (low - 1e-3, high, False),
            (low, high + 1e-3, False),
        ):
            ends = [linkage.place(complex(s, 0.4))[along] for s in (first, last)]
            law = Polynomial(coefficients=(ends[0], ends[1] - ends[0]))
            try:
                linkage.scene(law=law, times=(0.0, 1.0), driven="slider")
            except InvalidScene:
                assert not fits, f"guide at {angle}: {first} to {last} was refused"
            else:
                assert fits, f"guide at {angle}: {first} to {last} was not refused"
