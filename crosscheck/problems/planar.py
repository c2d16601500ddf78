"""The planar mechanisms of the problem set, by family, from regular to hard.

Every number is drawn by a seeded generator and rounded to a few decimals, so that a scene is the same on every machine;
near a singular pose the distance to it is the number. A mechanism is stated without estimates: its assemblies at the
first time are enumerated, each is a problem's or an answer that a grader refuses, and the estimates come from it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from random import Random
from typing import Any

from crosscheck.problems import TIMES, Family, Stated, polynomial, stated, within
from crosscheck.scenes.hard_case import ends, pin
from refkin.joints import (
    GROUND,
    AngleDriver,
    Cam,
    Constraint,
    Disc,
    Distance,
    DistanceDriver,
    Driver,
    Fixed,
    Gear,
    Pair,
    PointOnLine,
    Prismatic,
    RackAndPinion,
    XDriver,
)
from refkin.motion_laws import Integral, Law, Sinusoid
from refkin.scenes.linkages import FourBar, InvertedSliderCrank, Linkage, SliderCrank, law_keys

NEARER = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
"""How near hard problems come to a singular pose [sizes, rad]."""


def _turning(body: str, law: Law, name: str = "motor") -> AngleDriver:
    return AngleDriver(name=name, body=body, **law_keys(law))


def _linkage(title: str, linkage: Linkage, law: Law, driven: str = "crank", **more: Any) -> Stated:
    mechanism = linkage.mechanism(linkage.driver(law, driven))
    return Stated(title, mechanism, linkage=linkage, driven=driven, **more)


def _across(linkage: Linkage, driven: str = "crank") -> Law:
    """Return a law that takes the input over most of its range in the usual times."""
    low, high = linkage.input_range(driven)[0]
    if math.isinf(low):
        return polynomial(0.3, 2.5, 0.2)
    first, last = low + 0.15 * (high - low), high - 0.15 * (high - low)
    return polynomial(round(first, 3), round((last - first) / TIMES[-1], 3))


def _crank_rocker(random: Random) -> tuple[float, float, float]:
    """Return ground, coupler and rocker around a crank of length 1 that turns fully."""
    ground = within(random, 2.5, 4.5)
    coupler = within(random, 0.6, 0.8) * (ground + 1.0)
    return ground, round(coupler, 2), round(coupler + within(random, -0.4, 0.4) * (ground - 1.0), 2)


def four_bars(random: Random) -> Iterator[Stated]:
    """Yield four-bars of every Grashof class."""
    for k in range(14):
        linkage = FourBar(*(within(random, 1.0, 4.0) for _ in range(4)))
        while not linkage.input_range() or abs(linkage.slack) < 0.2:
            linkage = FourBar(*(within(random, 1.0, 4.0) for _ in range(4)))
        law, (low, high) = _across(linkage), linkage.input_range()[0]
        if k % 3 == 0 and math.isinf(low):
            law = Integral(rate=polynomial(1.5, 0.5, -0.25), initial=0.7)
        elif k % 3 == 0:
            middle, swing = round((low + high) / 2, 3), round(0.4 * (high - low), 3)
            law = Sinusoid(offset=middle, amplitude=swing, angular_frequency=1.5, phase=0.25)
        yield _linkage(f"four-bar, {linkage.grashof.value}", linkage, law)


def slider_cranks(random: Random) -> Iterator[Stated]:
    """Yield slider-cranks with and without offset, driven by the crank or by the slider."""
    for k in range(8):
        crank, offset = within(random, 0.5, 1.5), within(random, -0.6, 0.6) * (k % 2)
        linkage = SliderCrank(crank=crank, rod=round(crank + abs(offset) + within(random, 0.5, 3.0), 2), offset=offset)
        yield _linkage("slider-crank", linkage, _across(linkage))
    for _ in range(4):
        linkage = SliderCrank(crank=within(random, 0.8, 1.2), rod=within(random, 2.0, 4.0))
        yield _linkage("slider-crank driven by its slider", linkage, _across(linkage, "slider"), "slider")


def inverted_slider_cranks(random: Random) -> Iterator[Stated]:
    """Yield cranks whose pin runs in a slotted lever."""
    for _ in range(6):
        linkage = InvertedSliderCrank(ground=within(random, 1.5, 3.0), crank=within(random, 0.5, 1.2))
        yield _linkage("inverted slider-crank", linkage, _across(linkage))


def near_change_points(random: Random) -> Iterator[Stated]:
    """Yield four-bars whose links come nearly into one line half-way, and both assemblies near each other."""
    for d in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10):
        linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + d)
        law = polynomial(2.5, 0.64)
        yield _linkage(f"four-bar, slack {d:.0e}", linkage, law, times=(0.0, 0.5, 1.0, 1.25, 1.75))


def near_limits(random: Random) -> Iterator[Stated]:
    """Yield a four-bar whose crank, and a slider-crank whose slider, come to a distance of their limit."""
    bar, slider = FourBar(ground=4.0, crank=3.0, coupler=3.0, rocker=2.0), SliderCrank(crank=1.0, rod=3.0)
    for d in NEARER:
        times = (*(t for t in (-0.5, -0.1, -1e-2, -1e-4, -1e-6) if -t > d), -d)
        yield _linkage(f"four-bar, {d:.0e} before its limit", bar, polynomial(math.pi / 2, 1.0), times=times)
        law = polynomial(4.0, 1.0)
        yield _linkage(f"slider-crank, {d:.0e} before its dead centre", slider, law, "slider", times=times)


def flat_linkages(random: Random) -> Iterator[Stated]:
    """Yield parallelograms and kites on their way into one line, where four motions meet."""
    for d in NEARER[:3]:
        times = (*(t for t in (-0.5, -0.1, -1e-2, -1e-4, -1e-6) if -t > d), -d)
        parallelogram = FourBar(ground=3.0, crank=1.0, coupler=3.0, rocker=1.0)
        yield _linkage(f"parallelogram, {d:.0e} before it is flat", parallelogram, polynomial(0.0, -1.0), times=times)
        kite = FourBar(ground=3.0, crank=3.0, coupler=1.0, rocker=1.0)
        yield _linkage(f"kite, {d:.0e} before it is flat", kite, polynomial(0.0, 0.1), times=times)


def sizes(random: Random) -> Iterator[Stated]:
    """Yield a crank-rocker of all sizes, and far from the origin."""
    for size in (1e-9, 1e-6, 1e-3, 1e3, 1e6):
        linkage = FourBar(ground=4 * size, crank=size, coupler=3.5 * size, rocker=3 * size)
        yield _linkage(f"crank-rocker of {size:g} m", linkage, polynomial(0.3, 2.0), assemblies=1)
    for away in (1e2, 1e4, 1e6):
        linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0, origin=(away, -away), angle=0.5)
        yield _linkage(f"crank-rocker {away:g} m from the origin", linkage, polynomial(0.3, 2.0), assemblies=1)


def motions(random: Random) -> Iterator[Stated]:
    """Yield a crank-rocker that follows fast, slow and many-turned laws."""
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
    laws: dict[str, Law] = {
        "fast": polynomial(0.3, 1000.0),
        "slow": polynomial(0.3, 1e-6),
        "from rest": polynomial(0.3, 0.0, 1.0),
        "shaking": Sinusoid(offset=1.0, amplitude=0.125, angular_frequency=100.0, phase=0.5),
        "after a thousand turns": polynomial(6284.0, 2.0),
    }
    for what, law in laws.items():
        yield _linkage(f"crank-rocker, {what}", linkage, law, assemblies=1)


def six_bars(random: Random) -> Iterator[Stated]:
    """Yield crank-rockers that move a further dyad, hung on the rocker (Watt) or on the coupler (Stephenson)."""
    for k in range(12):
        ground, coupler, rocker = _crank_rocker(random)
        joints: list[Constraint] = [
            pin("A0", GROUND, (0.0, 0.0), "crank"),
            pin("A", "crank", (1.0, 0.0), "coupler"),
            pin("B", "coupler", (coupler, 0.0), "rocker", (rocker, 0.0)),
            pin("B0", GROUND, (ground, 0.0), "rocker"),
        ]
        on, tip = ("rocker", (within(random, 1.5, 3.0), 0.75)) if k % 2 else ("coupler", (coupler / 2, 1.0))
        reach = ground + 1.0
        if k % 3:
            base = (round(ground + reach, 2), within(random, -1.0, 1.0))
            link = round(reach * within(random, 0.9, 1.2), 2)
            joints += [pin("C", on, tip, "link"), pin("D", "link", (link, 0.0), "last", (round(link * 0.9, 2), 0.0))]
            joints.append(pin("E0", GROUND, base, "last"))
        else:
            joints += [pin("C", on, tip, "rod"), pin("D", "rod", (round(2 * reach, 2), 0.0), "slider")]
            joints.append(_guide("guide", GROUND, (0.0, within(random, -1.0, 1.0)), (1.0, 0.0), "slider"))
        name = ("Watt" if k % 2 else "Stephenson") + (" six-bar" if k % 3 else " six-bar with a slider")
        yield stated(name, joints, _turning("crank", polynomial(0.3, 1.5, 0.25)))


def _guide(name: str, i: str, p: Pair, axis: Pair, j: str) -> Prismatic:
    return Prismatic(name=name, **ends(i, p, j), axis_i=axis)


def geared_five_bars(random: Random) -> Iterator[Stated]:
    """Yield two cranks that a gear couples, and two couplers that meet."""
    for ratio in (1.0, -1.0, 2.0, -2.0, 0.5, 3.0):
        second = within(random, 0.6, 1.2)
        ground = within(random, 3.0, 4.0)
        left = within(random, 3.2, 3.6)
        right = round(left + within(random, -0.4, 0.4), 2)
        joints = [
            pin("A0", GROUND, (0.0, 0.0), "crank"),
            pin("B0", GROUND, (ground, 0.0), "second"),
            Gear(name="mesh", body_i="crank", radius_i=ratio, body_j="second", radius_j=1.0, phi0_j=0.5),
            pin("A", "crank", (1.0, 0.0), "left"),
            pin("B", "second", (second, 0.0), "right"),
            pin("P", "left", (left, 0.0), "right", (right, 0.0)),
        ]
        yield stated(f"geared five-bar, ratio {ratio:g}", joints, _turning("crank", polynomial(0.2, 2.0, 0.125)))


def rolling_pinions(random: Random) -> Iterator[Stated]:
    """Yield a pinion on a rack at rest, drawn along it by a crank and a rod."""
    for _ in range(4):
        radius = within(random, 0.4, 1.2)
        joints = [
            pin("A0", GROUND, (0.0, 0.0), "crank"),
            pin("A", "crank", (1.0, 0.0), "rod"),
            pin("B", "rod", (within(random, 2.5, 4.0), 0.0), "carrier"),
            _guide("guide", GROUND, (0.0, radius), (1.0, 0.0), "carrier"),
            pin("C", "carrier", (0.5, 0.0), "pinion"),
            RackAndPinion(
                name="teeth", **ends(GROUND, (0.0, 0.0), "pinion"), axis_i=(1.0, 0.0), radius=-radius, s0=3.0
            ),
        ]
        yield stated("pinion rolling on a rack", joints, _turning("crank", polynomial(0.3, 2.0)))


def chains(random: Random) -> Iterator[Stated]:
    """Yield four-bars in a row, the rocker of each the crank of the next."""
    for count in (3, 5, 7):
        joints: list[Constraint] = [pin("A0", GROUND, (0.0, 0.0), "b0")]
        for k in range(count):
            coupler, rocker = within(random, 3.4, 3.7), within(random, 2.9, 3.1)
            crank = (1.0, 0.0)
            foot = (4.0 * (k + 1), 0.0)
            joints += [
                pin(f"A{k + 1}", f"b{k}", crank, f"c{k}"),
                pin(f"B{k + 1}", f"c{k}", (coupler, 0.0), f"b{k + 1}", (rocker, 0.0)),
                pin(f"F{k + 1}", GROUND, foot, f"b{k + 1}"),
            ]
        yield stated(f"chain of {count} four-bars", joints, _turning("b0", polynomial(0.3, 1.5)))


def redundant_loops(random: Random) -> Iterator[Stated]:
    """Yield a coupler on three parallel cranks: one more than needed, and exactly consistent."""
    for start in (0.5, 1.5, 2.5):
        joints: list[Constraint] = []
        for name, x in (("crank", 0.0), ("middle", 1.5), ("rocker", 3.0)):
            joints += [
                pin(f"{name} 0", GROUND, (x, 0.0), name),
                pin(f"{name} 1", name, (1.0, 0.0), "coupler", (x, 0.0)),
            ]
        yield stated(
            "coupler on three parallel cranks", joints, _turning("crank", polynomial(start, 0.25)), assemblies=1
        )


def massless_links(random: Random) -> Iterator[Stated]:
    """Yield four-bars whose coupler is a distance, and a bar carried by three."""
    for _ in range(4):
        ground, coupler, rocker = _crank_rocker(random)
        joints = [
            pin("A0", GROUND, (0.0, 0.0), "crank"),
            pin("B0", GROUND, (ground, 0.0), "rocker"),
            Distance(name="link", **ends("crank", (1.0, 0.0), "rocker", (rocker, 0.0)), length=coupler),
        ]
        yield stated("four-bar with a massless coupler", joints, _turning("crank", polynomial(0.3, 2.0)))
    for _ in range(2):
        link = Distance(name="link", **ends(GROUND, (4.0, 0.5), "plate", (1.5, 0.0)), length=within(random, 2.2, 2.6))
        joints = [pin("A0", GROUND, (0.0, 0.0), "crank"), pin("A", "crank", (1.0, 0.0), "plate"), link]
        yield stated("plate on a crank and a link", joints, _turning("crank", polynomial(0.3, 0.4)))


def guided_bars(random: Random) -> Iterator[Stated]:
    """Yield an elliptic trammel, scotch yokes and a bar with one end on a line."""
    for _ in range(2):
        first, last = (within(random, 0.5, 1.5), 0.0), (within(random, -1.5, -0.5), 0.0)
        joints: list[Constraint] = [
            PointOnLine(name="level", **ends(GROUND, (0.0, 0.0), "bar", first), axis_i=(1.0, 0.0)),
            PointOnLine(name="upright", **ends(GROUND, (0.0, 0.0), "bar", last), axis_i=(0.0, 1.0)),
        ]
        yield stated("elliptic trammel", joints, _turning("bar", polynomial(0.3, 2.0)), assemblies=1)
    for k in range(2):
        slope = (0.25 * k, 1.0)
        joints = [
            pin("A0", GROUND, (0.0, 0.0), "crank"),
            _guide("guide", GROUND, (0.0, 0.0), (1.0, 0.0), "yoke"),
            PointOnLine(name="slot", **ends("yoke", (0.0, 0.0), "crank", (1.0, 0.0)), axis_i=slope),
        ]
        yield stated("scotch yoke", joints, _turning("crank", polynomial(0.3, 2.0)), assemblies=1)
    for _ in range(2):
        end = (within(random, 2.0, 3.0), 0.0)
        joints = [
            pin("A0", GROUND, (0.0, 0.0), "crank"),
            pin("A", "crank", (1.0, 0.0), "bar"),
            PointOnLine(name="line", **ends(GROUND, (0.0, 0.25), "bar", end), axis_i=(1.0, 0.125)),
        ]
        yield stated("bar with one end on a line", joints, _turning("crank", polynomial(0.3, 2.0)))


def cylinders(random: Random) -> Iterator[Stated]:
    """Yield booms that a cylinder lifts: the distance of two points is driven."""
    for k in range(6):
        foot, eye = (within(random, 0.8, 1.2), 0.0), (within(random, 1.8, 2.4), 0.0)
        low = round(abs(eye[0] - foot[0]) + 0.3, 2)
        at = ends(GROUND, foot, "boom", eye)
        law: Law = polynomial(low, 0.3) if k % 2 else Sinusoid(offset=low + 0.3, amplitude=0.25, angular_frequency=2.0)
        joints: list[Constraint] = [pin("O", GROUND, (0.0, 0.0), "boom")]
        if k % 3 == 2:
            joints.append(pin("A", "boom", (3.0, 0.0), "rod"))
            joints.append(pin("B", "rod", (4.0, 0.0), "slider"))
            joints.append(_guide("guide", GROUND, (0.0, 0.5), (1.0, 0.0), "slider"))
        yield stated("boom on a cylinder", joints, DistanceDriver(name="cylinder", **at, **law_keys(law)))


def platforms(random: Random) -> Iterator[Stated]:
    """Yield platforms on three legs: cranks and rods (3-RRR), or cylinders (3-RPR)."""
    feet, heads = ((0.0, 0.0), (4.0, 0.0), (2.0, 3.5)), ((-0.5, -0.25), (0.5, -0.25), (0.0, 0.5))
    for k in range(4):
        joints: list[Constraint] = []
        drivers: list[Driver] = []
        for n, (foot, head) in enumerate(zip(feet, heads, strict=True)):
            if k % 2:
                law = polynomial(within(random, 1.85, 2.05), within(random, 0.02, 0.08))
                at = ends(GROUND, foot, "plate", head)
                drivers.append(DistanceDriver(name=f"leg {n}", **at, **law_keys(law)))
                continue
            joints += [
                pin(f"foot {n}", GROUND, foot, f"crank {n}"),
                pin(f"knee {n}", f"crank {n}", (1.25, 0.0), f"rod {n}"),
                pin(f"head {n}", f"rod {n}", (within(random, 1.4, 1.6), 0.0), "plate", head),
            ]
            start = (0.75, 2.5, -1.5)[n]
            drivers.append(_turning(f"crank {n}", polynomial(start, within(random, 0.05, 0.15)), f"motor {n}"))
        legs = "cylinders" if k % 2 else "cranks"
        yield stated(f"platform on three {legs}", joints, drivers)


def cams(random: Random) -> Iterator[Stated]:
    """Yield eccentric discs that lift a follower with a flat face or a roller."""
    for form in ("flat", "roller", "point"):
        for _ in range(2):
            radius = within(random, 1.5, 2.5)
            more: dict[str, Any] = {"normal_j": (0.0, 1.0)} if form == "flat" else {}
            more |= {"roller_radius": 0.375} if form == "roller" else {}
            at = ends("cam", (0.5, 0.0), "follower")
            joints = [
                pin("A0", GROUND, (0.0, 0.0), "cam"),
                _guide("guide", GROUND, (0.25, 0.0), (0.0, 1.0), "follower"),
                Cam(name="touch", **at, profile=Disc(radius=radius), follower=form, **more),
            ]
            count = 1 if form == "flat" else 2
            yield stated(f"disc cam, {form} follower", joints, _turning("cam", polynomial(0.3, 2.0)), assemblies=count)


def welded_bodies(random: Random) -> Iterator[Stated]:
    """Yield slider-cranks driven along x, whose slider carries a body that is fixed to it."""
    for _ in range(2):
        joints = [
            pin("A0", GROUND, (0.0, 0.0), "crank"),
            pin("A", "crank", (1.0, 0.0), "rod"),
            pin("B", "rod", (within(random, 2.5, 3.5), 0.0), "slider"),
            _guide("guide", GROUND, (0.0, 0.25), (1.0, 0.0), "slider"),
            Fixed(name="weld", **ends("slider", (0.25, 0.5), "tool", (-0.5, 0.0)), angle=0.75),
        ]
        law = Sinusoid(offset=2.75, amplitude=0.5, angular_frequency=1.0)
        yield stated("slider with a tool", joints, XDriver(name="actuator", body="slider", law=law))


FAMILIES: tuple[Family, ...] = (
    four_bars, slider_cranks, inverted_slider_cranks, near_change_points, near_limits, flat_linkages, sizes, motions,
    six_bars, geared_five_bars, rolling_pinions, chains, redundant_loops, massless_links, guided_bars, cylinders,
    platforms, cams, welded_bodies,
)  # fmt: skip
"""Each draws from a generator of its own, seeded by its name: a new family changes no other."""
