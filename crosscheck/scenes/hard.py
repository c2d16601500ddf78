"""Hard scenes, always the same ones, by kind and by the logarithm of the distance to what makes them hard.

Scenes approach the hard pose from a regular one and end at it, so that an engine may use what it found on the way; the
last times come nearer by powers of ten. Only positions are called for: engines whose rates an adapter solves for would
otherwise be blamed for the adapter's linear systems.

And the scenes of the nightly's price list, the same every night, so that prices can be compared over nights: one
four-bar each far from trouble, and where digits are dear.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from crosscheck.scenes.hard_case import (
    DISTANCES,
    DOWN,
    GAPS,
    SPATIAL,
    STEPS,
    UP,
    HardCase,
    Kind,
    dyads,
    pin,
    timed,
    ways_to,
)
from refkin.joints import GROUND, AngleDriver, Revolute
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import FourBar, InvertedSliderCrank, Pose, SliderCrank, rough
from refkin.scenes.linkages.base import Branch, Linkage

TREES = {6.0: 4, 20.0: 1, 32.0: 1}
"""Dyads of a branching tree and the seed it is drawn with: from 30 dyads on it has more than 60 freedoms."""
PARALLELOGRAM = FourBar(ground=3.0, crank=1.0, coupler=3.0, rocker=1.0)
TOGGLE = FourBar(ground=4.0, crank=2.0, coupler=2.5, rocker=2.0)
FLAT = FourBar(ground=4.0, crank=1.0, coupler=2.0, rocker=1.0)
"""At crank angle 0 all its links lie in one line."""
REGULAR = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
NEAR = 1e-2
"""Margin for which estimates are rounded [m]: they are good to two or three digits."""


def hard_cases() -> tuple[HardCase, ...]:
    """Return all hard scenes, kind by kind, the nearest last."""
    return tuple(made(kind, d) for kind, (distances, made) in KINDS.items() for d in distances)


def _parallelogram(case: str, d: float) -> HardCase:
    made = _approach(case, d, PARALLELOGRAM, 0.0, 1.0)
    return replace(made, poses=lambda t: _parallel(-t), exact=True)


def _parallelogram_passed(case: str, d: float) -> HardCase:
    times = [-0.5, -0.3, -0.1, -d, d, 0.1, 0.3, 0.5]
    return HardCase(
        case, d, _scene(PARALLELOGRAM, UP, times, _parallel(times[0]), "crank", case), _parallel, exact=True
    )


def _unassemblable(case: str, gap: float) -> HardCase:
    scene = _scene(replace(FLAT, coupler=2.0 - gap), UP, [0.0], FLAT.assemble(0.0), "crank", "unassemblable")
    return HardCase(case, gap, scene, lambda _: None)


def _singular(case: str, d: float) -> HardCase:
    flat = FLAT.assemble(0.0)
    return HardCase(case, d, _scene(FLAT, UP, [0.0], _moved(flat, 0.05), "crank", case), lambda _: flat)


def _redundant(case: str, d: float) -> HardCase:
    times = [-1.0 + (1.0 - d) * k / 4 for k in range(4)] + [-d]
    scene = _law_scene(_parallel_joints(), DOWN, times, _parallel_loops(-times[0]), case)
    return HardCase(case, d, scene, lambda t: _parallel_loops(-t), exact=True)


def _branching(case: str, loops: float, made: tuple[Sequence[Revolute], dict[float, Pose]]) -> HardCase:
    joints, poses = made
    scene = _law_scene(joints, UP, list(poses), next(iter(poses.values())), case)
    return HardCase(case, loops, scene, poses.__getitem__, exact=True)


def _far_start(case: str, away: float) -> HardCase:
    scene = _scene(REGULAR, UP, [0.7], _moved(REGULAR.assemble(0.7), away), "crank", case)
    return HardCase(case, away, scene, lambda _: None, any_assembly=True)


KINDS: Mapping[str, Kind] = {
    # A four-bar whose crank goes to its limit position: coupler and rocker come into one line.
    "toggle": (DISTANCES, lambda case, d: _approach(case, d, TOGGLE, TOGGLE.input_range()[0][1], -1.0)),
    # A slider-crank whose slider is driven to the end of its stroke: crank and rod come into one line.
    "dead centre": (
        DISTANCES,
        lambda case, d: _approach(case, d, SliderCrank(crank=1.0, rod=3.0), 4.0, -1.0, driven="slider"),
    ),
    # A four-bar that passes the pose where it would be flat if its slack were 0.
    "near change point": (
        DISTANCES[:4],
        lambda case, d: _made(case, d, replace(FLAT, coupler=4.0 - d), [-1.0 + 0.25 * k for k in range(9)]),
    ),
    # A parallelogram that comes to the pose where it is flat, where it may go on in two ways.
    "parallelogram": (DISTANCES, _parallelogram),
    # One that passes its flat pose, between two times: it stays one, as every smooth motion does.
    "parallelogram, passed": (DISTANCES[:4], _parallelogram_passed),
    # A kite that folds up: coupler and rocker come to lie on each other and on one pivot.
    "kite": (DISTANCES, lambda case, d: _approach(case, d, FourBar(3.0, 3.0, 1.0, 1.0), 0.0, 1.0)),
    # A slider-crank with rod and crank of one length, whose wrist pin comes to the crank's pivot.
    "isosceles slider-crank": (
        DISTANCES,
        lambda case, d: _approach(case, d, SliderCrank(crank=1.0, rod=1.0), math.pi / 2, -1.0),
    ),
    # A crank whose pin passes the pivot of the slotted lever at a small distance.
    "crank pin near the slot's pivot": (
        DISTANCES,
        lambda case, d: _approach(case, d, InvertedSliderCrank(ground=2.0, crank=2.0 - d), 0.0, 1.0),
    ),
    # A four-bar whose coupler and rocker are too short by a gap, at the one time that is asked for.
    "unassemblable by a gap": (GAPS, _unassemblable),
    # A four-bar exactly at its limit position, from an estimate beside it.
    "singular": ((0.0,), _singular),
    # Two parallel loops, one rocker more than needed, that come to the pose where they are flat.
    "redundant loops": ((0.25, *DISTANCES), _redundant),
    # A coupler tree of many loops: four-bars that all hang on one crank, more freedoms than a dense solver.
    "branching loops": (
        (2.0, 8.0, 32.0),
        lambda case, n: _branching(case, n, _fan(int(n), [0.3 + 0.2 * k for k in range(6)])),
    ),
    # A crank with dyads hung on any bodies before them, so that loops run through all of a branching tree.
    "branching tree": (
        tuple(TREES),
        lambda case, n: _branching(case, n, dyads(int(n), TREES[n], [0.3 + 0.02 * k for k in range(3)])),
    ),
    # A crank-rocker far from the origin.
    "large offset": (
        (1e-2, 1e-4, 1e-6, 1e-8),  # the size of the linkage over its distance from the origin
        lambda case, part: _made(
            case, part, replace(REGULAR, origin=(4.0 / part, -4.0 / part)), [0.5 + 0.1 * k for k in range(6)]
        ),
    ),
    # A crank-rocker at one time, from estimates whose angles are far off.
    "far start": ((0.5, 1.5, 3.0), _far_start),
    # A crank-rocker that comes to 0.02 of another assembly, in steps of up to a third of a turn.
    "coarse steps": (
        STEPS,
        lambda case, step: _made(
            case, step, FourBar(4.0, 1.0, 3.99, 1.02), [-2.5 + step * k for k in range(round(5.0 / step) + 1)]
        ),
    ),
    **SPATIAL,
}
"""How near each kind of hard scene comes to what makes it hard, and what makes the scene."""


def _approach(case: str, d: float, linkage: Linkage, end: float, side: float, driven: str = "crank") -> HardCase:
    """Return the case whose input goes to `end` + side * d, by steps and then by powers of ten."""
    return _made(case, d, linkage, [-way for way in ways_to(d)], (end, -side), driven)


def _made(
    case: str, d: float, linkage: Linkage, times: Sequence[float], law: tuple[float, float] = UP, driven: str = "crank"
) -> HardCase:
    """Return the case whose input follows a law, on the open branch."""

    def pose(t: float) -> Pose:
        return linkage.assemble(law[0] + law[1] * t, driven=driven)

    return HardCase(case, d, _scene(linkage, law, times, pose(times[0]), driven, case), pose)


def _scene(
    linkage: Linkage, law: tuple[float, float], times: Sequence[float], pose: Pose, driven: str, name: str
) -> Scene:
    driver = linkage.driver(Polynomial(coefficients=law), driven)
    estimate = rough(pose, linkage.mechanism(driver).size(), NEAR)
    return timed(linkage.mechanism(driver, estimate), times, name)


def _moved(pose: Pose, angle: float) -> Pose:
    """Return a pose with all bodies but the first turned by an angle about their origins."""
    first, *_ = pose
    return {body: (x, y, phi + (0.0 if body == first else angle)) for body, (x, y, phi) in pose.items()}


def _law_scene(
    joints: Sequence[Revolute], law: tuple[float, float], times: Sequence[float], pose: Pose, name: str
) -> Scene:
    """Return the scene of joints whose crank follows a law, with the rounded pose as estimate."""
    driver = AngleDriver(name="driver", body="crank", law=Polynomial(coefficients=law))
    bodies = tuple(Body(name=body, estimate=q) for body, q in rough(pose, 4.0, NEAR).items())
    return timed(Mechanism(bodies, tuple(joints), (driver,)), times, name)


def _parallel_joints() -> list[Revolute]:
    """Return the joints of a coupler on three parallel cranks."""
    joints = []
    for k, (crank, x) in enumerate((("crank", 0.0), ("middle", 1.5), ("rocker", 3.0))):
        joints.append(pin(f"foot {k}", GROUND, (x, 0.0), crank, (-0.5, 0.0)))
        joints.append(pin(f"head {k}", crank, (0.5, 0.0), "coupler", (x - 1.5, 0.0)))
    return joints


def _parallel(angle: float) -> Pose:
    """Return the pose of the parallelogram, without the closed form of four-bars: exact where that is nearly flat."""
    return {body: q for body, q in _parallel_loops(angle).items() if body != "middle"}


def _parallel_loops(angle: float) -> Pose:
    c, s = math.cos(angle), math.sin(angle)
    cranks = {name: (x + c / 2, s / 2, angle) for name, x in (("crank", 0.0), ("middle", 1.5), ("rocker", 3.0))}
    return {**cranks, "coupler": (1.5 + c, s, 0.0)}


def _fan(loops: int, angles: Sequence[float]) -> tuple[list[Revolute], dict[float, Pose]]:
    """Return four-bars with couplers on one crank pin and rockers on pivots of their own, and their poses."""
    joints: list[Revolute] = []
    poses: dict[float, Pose] = {angle: {} for angle in angles}
    for n in range(loops):
        one: Any = FourBar(ground=4.0 + 2.0 * n / loops, crank=1.0, coupler=3.5 + n / loops, rocker=3.0)
        names = {GROUND: GROUND, "crank": "crank", "coupler": f"coupler {n}", "rocker": f"rocker {n}"}
        for joint in one.joints()[min(n, 1) :]:  # one crank for all
            i, j = (names[body] for body in joint.bodies)
            joints.append(replace(joint, name=f"{joint.name} {n}", body_i=i, body_j=j))
        for angle in angles:
            poses[angle] |= {names[body]: q for body, q in one.assemble(angle).items()}
    return joints, poses


SAMPLES = 73
SPEED = 2.0
"""Of the crank [rad/s]."""
SLACK, SPAN = 1e-4, 0.15
"""Distance of the lengths from a change point [m]; how far the crank turns to either side of the pose [rad]."""
SHORT_OF = 1e-6
"""How far before the dead centre the crank stops [rad]."""
AWAY = 2.0**20
"""How far from the origin of the ground a linkage lies [m], in x and in y."""


@cache
def priced_classes() -> dict[str, Scene]:
    """Return the scenes of the price list by their class."""
    far = replace(REGULAR, origin=(AWAY, AWAY))
    flat = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + SLACK)
    limited = FourBar(ground=4.0, crank=2.0, coupler=1.5, rocker=2.5)
    limit = max(limited.input_range()[0])
    return {
        "regular": _turning(REGULAR, "regular"),
        # a crank that turns through the pose at which all links nearly lie in one line
        "near a change point": _swept(flat, math.pi - SPAN, math.pi + SPAN, "near a change point"),
        # one that turns towards the limit at which coupler and rocker lie in one line, up to just before it
        "near a dead centre": _swept(limited, limit - 4 * SPAN, limit - SHORT_OF, "near a dead centre"),
        "far from the origin": _turning(far, "far from the origin"),
    }


def _turning(linkage: FourBar, name: str) -> Scene:
    return linkage.scene(speed=SPEED, turns=1, samples=SAMPLES, branch=Branch.OPEN, name=name)


def _swept(linkage: FourBar, start: float, stop: float, name: str) -> Scene:
    times = np.linspace(0.0, (stop - start) / SPEED, SAMPLES).tolist()
    law = Polynomial(coefficients=(start, SPEED))
    return linkage.scene(law=law, times=times, branch=Branch.OPEN, name=name)
