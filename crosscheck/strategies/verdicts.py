"""Scenes that come out otherwise than ok, for certain, and linkages whose links are equal.

A crank is turned towards the pose in which the other two links lie in one line. Its pin sits in its frame so that this
pose is at the angle 0 exactly, and the lengths are whole multiples of 2^-20 of a size: where they add up to the pin's
farthest distance the last pose is singular, to the last bit; where they fall short of it there is none. In space it is
the coupler of an RSSR that crank and rocker, across each other, can just be apart by, or not quite.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from crosscheck.strategies.linkages import draw_place, draw_size
from crosscheck.strategies.scenes import Drawn, scenes_of
from crosscheck.strategies.space_plans import RockerCircle
from crosscheck.strategies.spans import Binned, Hardness
from refkin.joints import GROUND, AngleDriver, Pair, Prismatic, Revolute
from refkin.model import Body, Mechanism, Member, Scene
from refkin.motion import Status
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import RSSR, Branch, FourBar

GRID = 2.0**-20
"""Lengths are whole multiples of this part of the crank's."""
PARTS = st.integers(2**18, 2**21)
"""A quarter to twice the crank."""
GRID_OF_SPAN = 61
"""Inputs of a span at which distances are looked at."""
GAPS = st.one_of(st.just(0), st.integers(1, 2**17))
"""What the lengths fall short of the pin's farthest distance, in the same multiples: 0, or 1e-6 to an eighth."""


@dataclass(frozen=True)
class Ended(Binned):
    """A drawn scene that ends in a singular pose or in none: `expected` is the verdict that it must have."""

    hardness: Member = Hardness.LIMIT
    expected: Status = Status.OK


@st.composite
def ended_scenes(draw: DrawFn, *, samples: int = 72) -> Ended:
    """Return scenes that end in a stretched pose, or beyond it.

    Examples from this strategy shrink towards a four-bar with a crank of one metre that ends in the pose itself.
    """
    size = math.ldexp(1.0, draw(st.integers(-10, 10), label="size"))
    kind = draw(st.sampled_from(("four-bar", "slider-crank", "RSSR")), label="kind")
    gap = draw(GAPS, label="gap")
    one, two = draw(PARTS, label="second link"), draw(PARTS, label="third length")
    side = draw(st.sampled_from((1.0, -1.0)), label="side")
    begin = draw(st.floats(0.5, 1.5), label="angle at first")
    a, expected = 2**20, Status.UNASSEMBLABLE if gap else Status.SINGULAR
    times = tuple(np.linspace(0.0, 1.0, samples).tolist())
    name, branch = f"{kind}, {expected} in the end", Branch.OPEN if side > 0 else Branch.CROSSED
    if kind == "RSSR":
        return Ended(_rssr(one, two, gap, size * GRID, branch, begin, times, name), kind, branch, expected=expected)
    if kind == "four-bar":
        assume(a + two - gap > one)  # what is left for the rocker
        lengths = (a, one, a + two - gap - one, two)
        away = math.hypot(two + a * math.cos(begin), a * math.sin(begin))
        assume(abs(lengths[1] - lengths[2]) < away < 0.99 * (lengths[1] + lengths[2]))
        joints, pose = _four_bar(lengths, size * GRID, side, begin)
    else:
        assume(two < a)  # the slide is below the pin's highest place
        lengths = (a, a - two - gap, two, 0)
        assume(lengths[1] > 2**16 and abs(a * math.cos(begin) - two) < 0.99 * lengths[1])
        joints, pose = _slider_crank(lengths, size * GRID, side, begin)
    law = Polynomial(coefficients=(begin, -begin))
    driver = AngleDriver(name="driver", body="crank", law=law)
    bodies = tuple(Body(name=name, estimate=place) for name, place in pose.items())
    scene = Scene(mechanism=Mechanism(bodies, joints, (driver,)), times=times, name=name)
    return Ended(scene, kind, branch, expected=expected)


def _rssr(
    rocker: int, away: int, gap: int, unit: float, branch: Branch, begin: float, times: tuple[float, ...], name: str
) -> Scene:
    """Return an RSSR whose crank, about z, comes to 0, its tip `away` from the rocker's pivot and in its plane.

    The rocker turns about x. So they are apart by away + rocker at most in the end, and by more before it.
    """
    crank, coupler = float(2**20), rocker + away + gap
    circle = RockerCircle(
        np.array([crank, float(away), 0.0]), np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), float(rocker)
    )
    angles = np.linspace(-begin, 0.0, GRID_OF_SPAN)
    least, greatest = circle.reach(crank * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1))
    assume(np.all(least < 0.99 * coupler) and np.all(greatest[:-1] > greatest[-1]) and greatest[0] > coupler * 1.01)
    linkage = RSSR(
        crank=unit * crank,
        coupler=unit * coupler,
        rocker=unit * rocker,
        pivot=(unit * crank, unit * away, 0.0),
        axis=(1.0, 0.0, 0.0),
        massless=True,
    )
    pose = linkage.assemble(-begin, branch)
    bodies = tuple(Body(name=body, estimate=(*at[:3], *(round(x, 3) for x in at[3:]))) for body, at in pose.items())
    drivers = linkage.drivers(Polynomial(coefficients=(-begin, begin)))
    return Scene(mechanism=Mechanism(bodies, linkage.joints(), drivers), times=times, name=name)


def _four_bar(lengths: tuple[int, ...], unit: float, side: float, phi: float) -> tuple:  # type: ignore[type-arg]
    """Return the joints and the pose with the crank at an angle; its pin lies behind its pivot at the angle 0."""
    crank, coupler, rocker, ground = (unit * x for x in lengths)
    joints = (
        _pin("A0", GROUND, (0.0, 0.0), "crank", (0.0, 0.0)),
        _pin("A", "crank", (-crank, 0.0), "coupler", (0.0, 0.0)),
        _pin("B", "coupler", (coupler, 0.0), "rocker", (rocker, 0.0)),
        _pin("B0", GROUND, (ground, 0.0), "rocker", (0.0, 0.0)),
    )
    x, y = -crank * math.cos(phi), -crank * math.sin(phi)
    away, line = math.hypot(ground - x, y), math.atan2(-y, ground - x)
    corner = math.acos((coupler**2 + away**2 - rocker**2) / (2 * coupler * away))
    angle = line + side * corner
    tip = x + coupler * math.cos(angle), y + coupler * math.sin(angle)
    turned = math.atan2(tip[1], tip[0] - ground)
    return joints, {"crank": (0.0, 0.0, phi), "coupler": (x, y, angle), "rocker": (ground, 0.0, turned)}


def _slider_crank(lengths: tuple[int, ...], unit: float, side: float, phi: float) -> tuple:  # type: ignore[type-arg]
    """Return the joints and the pose with the crank at an angle; its pin lies above its pivot at the angle 0."""
    crank, rod, offset, _ = (unit * x for x in lengths)
    joints = (
        _pin("A0", GROUND, (0.0, 0.0), "crank", (0.0, 0.0)),
        _pin("A", "crank", (0.0, crank), "rod", (0.0, 0.0)),
        _pin("B", "rod", (rod, 0.0), "slider", (0.0, 0.0)),
        Prismatic(
            name="S", body_i=GROUND, point_i=(0.0, offset), axis_i=(1.0, 0.0), body_j="slider", point_j=(0.0, 0.0)
        ),
    )
    x, y = -crank * math.sin(phi), crank * math.cos(phi)
    along = side * math.sqrt(rod**2 - (y - offset) ** 2)
    angle = math.atan2(offset - y, along)
    return joints, {"crank": (0.0, 0.0, phi), "rod": (x, y, angle), "slider": (x + along, offset, 0.0)}


def _pin(name: str, i: str, point_i: Pair, j: str, point_j: Pair) -> Revolute:
    return Revolute(name=name, body_i=i, point_i=point_i, body_j=j, point_j=point_j)


RATIOS = st.floats(0.375, 0.875) | st.floats(1.25, 1.875)
EQUAL = (("crank", "rocker"), ("coupler", "rocker"), ("crank", "coupler"), ("crank", "coupler", "rocker"))


@st.composite
def equal_four_bars(draw: DrawFn) -> FourBar:
    """Return four-bars of which two or three moving links are equal; none at a change point."""
    size = draw_size(draw, (1e-3, 1e3))
    equal = draw(st.sampled_from(EQUAL), label="equal links")
    other = {key: draw(RATIOS, label=key) for key in ("ground", "crank", "coupler", "rocker") if key not in equal}
    lengths = [size * other.get(key, 1.0) for key in FourBar.LENGTHS]
    linkage = FourBar(*lengths, **draw_place(draw, 10.0 * size))
    assume(abs(linkage.slack) > size / 16)
    return linkage


def equal_linkages(samples: int = 72) -> SearchStrategy[Drawn]:
    """Return regular scenes of linkages of which two or three links are equal, so that bodies are easily mistaken."""
    return scenes_of({(Hardness.REGULAR, "equal four-bar"): equal_four_bars()}, (3, 10), samples)
