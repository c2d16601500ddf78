"""Mechanisms of class II drawn at a known pose, and their closed form in balls, for its tests; not a test itself."""

import cmath
import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from flint import arb, ctx
from hypothesis import strategies as st

from crosscheck.engines.closed_form.engine import ROUTE
from crosscheck.engines.closed_form.jets import Balls
from crosscheck.engines.closed_form.solution import assembled
from refkin.motion import Motion, Producer, Status, engine_motion
from tests.drawn import Drawing


class InBalls(NamedTuple):
    """The closed form evaluated in balls: rounded as a motion, and q, qd, qdd themselves."""

    motion: Motion
    balls: list[Any]


def in_balls(scene, bits=256):
    count = len(scene.times)
    with ctx.workprec(bits), np.errstate(all="ignore"):
        assembly = assembled(scene, Balls())
        x, y = map(arb, assembly.linkage.origin)
        poses = [assembly.groups[0].bodies[body.name] for body in scene.mechanism.bodies]
        jets = [(jet, shift) for p in poses for jet, shift in ((p.origin.x, x), (p.origin.y, y), (p.angle, arb(0)))]
        balls = [
            np.array([np.broadcast_to(np.asarray(arb(1) * getattr(jet, part)), (count,)) for jet, _ in jets])
            for part in "vda"
        ]
        balls[0] = balls[0] + np.array([[shift] for _, shift in jets])
        levels = [np.array(level, float) for level in balls]
    unknown = assembly.singular | assembly.absent
    status = tuple(Status.SINGULAR if k else Status.OK for k in unknown)
    motion = engine_motion(scene.times, scene.wanted, *levels, status, Producer(name="balls", version="", route=ROUTE))
    return InBalls(motion, balls)


FEW = (-(2.0**-20), 0.0, 2.0**-20)


def along(d, i, j, p, towards, part):
    """A point of body j slides on body i from p towards another point."""
    d.slide(i, j, p, p + part * (towards - p), towards - p)


def on_line(d, i, j, p, q):
    d.slide(i, j, p, q, q - p, turning=True)


def four_bar(d, p):
    """Pins p0 (ground) - 1 - p1 - 2 - p2 - 3 - p3 (ground), without a driver."""
    for i, j, point in zip(("ground", "1", "2", "3"), ("1", "2", "3", "ground"), p, strict=False):
        d.pin(i, j, point)


def massless_coupler(d, p):
    d.pin("ground", "1", p[0])
    d.link("1", "2", p[1], p[2])
    d.pin("ground", "2", p[3])


def slider_crank(d, p):
    d.pin("ground", "1", p[0])
    d.pin("1", "2", p[1])
    d.pin("3", "2", p[2])
    along(d, "ground", "3", p[3], p[4], 0.6)


def slider_crank_massless_slider(d, p):
    d.pin("ground", "1", p[0])
    d.pin("1", "2", p[1])
    on_line(d, "ground", "2", p[3], p[2])


def moving_guide(d, p):
    """A slider on a crank's guide, with a rod to the ground."""
    d.pin("ground", "1", p[0])
    along(d, "1", "2", p[1], p[2], -0.4)
    d.pin("2", "3", p[3])
    d.pin("3", "ground", p[4])


def inverted_slider_crank(d, p):
    """A block pinned to the crank slides, with an offset, on a guide pinned to the ground."""
    d.pin("ground", "1", p[0])
    d.pin("1", "2", p[1])
    along(d, "3", "2", p[3], p[4], 0.8)
    d.pin("3", "ground", p[2])


def inverted_massless_block(d, p):
    d.pin("ground", "1", p[0])
    on_line(d, "2", "1", p[3], p[1])
    d.pin("2", "ground", p[2])


def cylinder(d, p):
    """A block's travel along its guide is driven."""
    d.pin("ground", "1", p[0])
    along(d, "1", "2", p[3], p[4], 0.8)
    d.pin("2", "3", p[1])
    d.pin("3", "ground", p[2])


def six_bar(link, d, p):
    four_bar(d, p)
    d.pin(link, "4", p[4])
    d.pin("4", "5", p[5])
    d.pin("5", "ground", p[6])


def coupler_point_slides(d, p):
    four_bar(d, p)
    d.pin("2", "4", p[4])
    along(d, "5", "4", p[5], p[0], 0.3)
    d.pin("5", "ground", p[6])


def two_sliders(d, p):
    """A block on a fixed guide, a second on a guide of the first, held by a link: all angles known."""
    along(d, "ground", "1", p[0], p[1], 0.5)
    along(d, "1", "2", p[2], p[3], 0.5)
    d.link("ground", "2", p[4], p[5])


def double_slider(d, p):
    """Blocks on two fixed guides pinned together by a rod (elliptical trammel), one driven."""
    along(d, "ground", "1", p[0], p[1], 0.5)
    along(d, "ground", "2", p[2], p[3], 0.5)
    d.pin("1", "3", p[4])
    d.pin("3", "2", p[5])


def cross_slider(d, p):
    """Oldham-like: a block slides on a turning crank and is pinned to a block on a fixed guide."""
    d.pin("ground", "1", p[0])
    along(d, "1", "2", p[1], p[2], 0.5)
    d.pin("2", "3", p[3])
    along(d, "ground", "3", p[4], p[5], 0.5)


def welded(d, p):
    four_bar(d, p)
    d.weld("3", "4", p[4])
    d.pin("4", "5", p[5])
    on_line(d, "ground", "5", p[6], p[0])


def link_and_guide(d, p):
    """A pin of a body ends a massless link, and its guide passes over a point of the ground."""
    d.link("ground", "1", p[0], p[1])
    on_line(d, "1", "ground", p[2], p[3])


def by_crank(d, p):
    d.drive_angle("1")


TOPOLOGIES = {
    "four_bar_crank": (four_bar, by_crank, 3),
    "four_bar_rocker": (four_bar, lambda d, p: d.drive_angle("3"), 3),
    "four_bar_coupler": (four_bar, lambda d, p: d.drive_angle("2"), 3),
    "four_bar_coupler_to_crank": (four_bar, lambda d, p: d.drive_angle("2", "1"), 3),
    "four_bar_rocker_to_coupler": (four_bar, lambda d, p: d.drive_angle("3", "2"), 3),
    "four_bar_rocker_to_crank": (four_bar, lambda d, p: d.drive_angle("3", "1"), 3),
    "four_bar_coupler_point_x": (four_bar, lambda d, p: d.drive_x("2", p[1]), 3),
    "four_bar_cylinder": (four_bar, lambda d, p: d.drive_distance("ground", "1", p[4], p[1]), 3),
    "four_bar_cylinder_on_rocker": (four_bar, lambda d, p: d.drive_distance("3", "ground", p[4], p[5]), 3),
    "massless_coupler": (massless_coupler, by_crank, 2),
    "massless_coupler_relative": (massless_coupler, lambda d, p: d.drive_angle("2", "1"), 2),
    "slider_crank_by_crank": (slider_crank, by_crank, 3),
    "slider_crank_by_x": (slider_crank, lambda d, p: d.drive_x("3", p[5]), 3),
    "slider_crank_by_y": (slider_crank, lambda d, p: d.drive_y("3", p[5]), 3),
    "slider_crank_by_distance": (slider_crank, lambda d, p: d.drive_distance("3", "ground", p[2], p[5]), 3),
    "slider_crank_by_rod": (slider_crank, lambda d, p: d.drive_angle("2"), 3),
    "slider_crank_massless_slider": (slider_crank_massless_slider, by_crank, 2),
    "slider_crank_massless_slider_by_x": (slider_crank_massless_slider, lambda d, p: d.drive_x("2", p[2]), 2),
    "moving_guide": (moving_guide, by_crank, 3),
    "inverted_slider_crank": (inverted_slider_crank, by_crank, 3),
    "inverted_massless_block": (inverted_massless_block, by_crank, 2),
    "cylinder": (cylinder, lambda d, p: d.drive_distance("1", "2", p[3], p[5]), 3),
    "watt": (partial(six_bar, "3"), by_crank, 5),
    "stephenson": (partial(six_bar, "2"), by_crank, 5),
    "coupler_point_slides": (coupler_point_slides, by_crank, 5),
    "two_sliders": (two_sliders, lambda d, p: d.drive_x("1", p[6]), 2),
    "double_slider": (double_slider, lambda d, p: d.drive_y("1", p[6]), 3),
    "cross_slider": (cross_slider, by_crank, 3),
    "welded": (welded, by_crank, 5),
    "link_and_guide": (link_and_guide, lambda d, p: d.drive_y("1", p[1]), 1),
}
"""What is built, how it is driven, and how many bodies it has, by name."""

UNIT = st.floats(-1.0, 1.0)


@st.composite
def drawings(draw, build, spread=0.0):
    """Build a mechanism on world points within a square; `spread` scatters each point over that many decades.

    Shrinks towards points on a regular polygon, no two of which coincide and no three of which are in line.
    """
    corners = [cmath.exp(2j * math.pi * (k * 3 % 7) / 7) for k in range(7)]
    p = [c * 10 ** (spread * draw(UNIT)) + 0.3 * complex(draw(UNIT), draw(UNIT)) for c in corners]
    structure, drive, count = TOPOLOGIES[build]
    names = [str(k + 1) for k in range(count)]
    placed = {n: (complex(draw(UNIT), draw(UNIT)), draw(st.floats(-9.0, 9.0))) for n in names}
    drawing = Drawing(placed, (0.7 + 0.3 * draw(UNIT), draw(UNIT)))
    structure(drawing, p)
    drive(drawing, p)
    return drawing
