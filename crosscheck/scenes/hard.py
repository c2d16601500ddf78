"""Hard scenes, always the same ones, by kind and by the logarithm of the distance to what makes them hard.

Scenes approach the hard pose from a regular one and end at it, so that an engine may use what it found on the way; the
last times come nearer by powers of ten. Only positions are called for: engines whose rates an adapter solves for would
otherwise be blamed for the adapter's linear systems.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

from crosscheck.scenes.hard_case import DISTANCES, DOWN, GAPS, SPATIAL, STEPS, UP, HardCase, dyads, pin, timed, ways_to
from refkin.joints import GROUND, AngleDriver, Revolute
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import FourBar, InvertedSliderCrank, Pose, SliderCrank, rough
from refkin.scenes.linkages.base import Linkage

OFFSETS = (1e-2, 1e-4, 1e-6, 1e-8)
"""Size of the linkage over its distance from the origin."""
TREES = ((6, 4), (20, 1), (32, 1))
"""Dyads of a branching tree and the seed it is drawn with: from 30 dyads on it has more than 60 freedoms."""
PARALLELOGRAM = FourBar(ground=3.0, crank=1.0, coupler=3.0, rocker=1.0)
NEAR = 1e-2
"""Margin for which estimates are rounded [m]: they are good to two or three digits."""


def hard_cases() -> tuple[HardCase, ...]:
    """Return all hard scenes, kind by kind, the nearest last."""
    return tuple(case for kind in KINDS.values() for case in kind())


def toggle() -> Iterator[HardCase]:
    """Yield a four-bar whose crank goes to its limit position: coupler and rocker come into one line."""
    linkage = FourBar(ground=4.0, crank=2.0, coupler=2.5, rocker=2.0)
    (_, end), *_ = linkage.input_range()
    for d in DISTANCES:
        yield _approach("toggle", d, linkage, end, -1.0)


def dead_centre() -> Iterator[HardCase]:
    """Yield a slider-crank whose slider is driven to the end of its stroke: crank and rod come into one line."""
    linkage = SliderCrank(crank=1.0, rod=3.0)
    for d in DISTANCES:
        yield _approach("dead centre", d, linkage, 4.0, -1.0, driven="slider")


def near_change_point() -> Iterator[HardCase]:
    """Yield a four-bar that passes the pose where it would be flat if its slack were 0."""
    for d in DISTANCES[:4]:
        linkage = FourBar(ground=4.0, crank=1.0, coupler=4.0 - d, rocker=1.0)
        yield _steps("near change point", d, linkage, [-1.0 + 0.25 * k for k in range(9)])


def parallelogram() -> Iterator[HardCase]:
    """Yield a parallelogram that comes to the pose where it is flat, where it may go on in two ways."""
    for d in DISTANCES:
        made = _approach("parallelogram", d, PARALLELOGRAM, 0.0, 1.0)
        yield replace(made, poses=lambda t: _parallel(-t), exact=True)


def parallelogram_passed() -> Iterator[HardCase]:
    """Yield a parallelogram that passes its flat pose, between two times: it stays one, as every smooth motion does."""
    for d in DISTANCES[:4]:
        times = [-0.5, -0.3, -0.1, -d, d, 0.1, 0.3, 0.5]
        scene = _scene(PARALLELOGRAM, UP, times, _parallel(times[0]), "crank", "parallelogram, passed")
        yield HardCase("parallelogram, passed", d, scene, _parallel, exact=True)


def kite() -> Iterator[HardCase]:
    """Yield a kite that folds up: coupler and rocker come to lie on each other and on one pivot."""
    linkage = FourBar(ground=3.0, crank=3.0, coupler=1.0, rocker=1.0)
    for d in DISTANCES:
        yield _approach("kite", d, linkage, 0.0, 1.0)


def isosceles() -> Iterator[HardCase]:
    """Yield a slider-crank with rod and crank of one length, whose wrist pin comes to the crank's pivot."""
    linkage = SliderCrank(crank=1.0, rod=1.0)
    for d in DISTANCES:
        yield _approach("isosceles slider-crank", d, linkage, math.pi / 2, -1.0)


def slot() -> Iterator[HardCase]:
    """Yield a crank whose pin passes the pivot of the slotted lever at a small distance."""
    for d in DISTANCES:
        linkage = InvertedSliderCrank(ground=2.0, crank=2.0 - d)
        yield _approach("crank pin near the slot's pivot", d, linkage, 0.0, 1.0)


def unassemblable() -> Iterator[HardCase]:
    """Yield a four-bar whose coupler and rocker are too short by a gap, at the one time that is asked for."""
    for gap in GAPS:
        linkage = FourBar(ground=4.0, crank=1.0, coupler=2.0 - gap, rocker=1.0)
        closed = FourBar(ground=4.0, crank=1.0, coupler=2.0, rocker=1.0)
        scene = _scene(linkage, UP, [0.0], closed.assemble(0.0), "crank", "unassemblable")
        yield HardCase("unassemblable by a gap", gap, scene, lambda _: None)


def singular() -> Iterator[HardCase]:
    """Yield a four-bar exactly at its limit position, from an estimate beside it."""
    linkage = FourBar(ground=4.0, crank=1.0, coupler=2.0, rocker=1.0)
    flat = linkage.assemble(0.0)
    scene = _scene(linkage, UP, [0.0], _moved(flat, 0.05), "crank", "singular")
    yield HardCase("singular", 0.0, scene, lambda _: flat)


def redundant() -> Iterator[HardCase]:
    """Yield two parallel loops, one rocker more than needed, that come to the pose where they are flat."""
    for d in (0.25, *DISTANCES):
        times = [-1.0 + (1.0 - d) * k / 4 for k in range(4)] + [-d]
        scene = _law_scene(_parallel_joints(), DOWN, times, _parallel_loops(-times[0]), "redundant loops")
        yield HardCase("redundant loops", d, scene, lambda t: _parallel_loops(-t), exact=True)


def branching() -> Iterator[HardCase]:
    """Yield a coupler tree of many loops: four-bars that all hang on one crank, more freedoms than a dense solver."""
    for loops in (2, 8, 32):
        times = [0.3 + 0.2 * k for k in range(6)]
        joints, poses = _fan(loops, times)
        scene = _law_scene(joints, UP, times, poses[times[0]], "branching loops")
        yield HardCase("branching loops", float(loops), scene, poses.__getitem__, exact=True)


def branching_tree() -> Iterator[HardCase]:
    """Yield a crank with dyads hung on any bodies before them, so that loops run through all of a branching tree."""
    for count, seed in TREES:
        times = [0.3 + 0.02 * k for k in range(3)]
        joints, poses = dyads(count, seed, times)
        scene = _law_scene(joints, UP, times, poses[times[0]], "branching tree")
        yield HardCase("branching tree", float(count), scene, poses.__getitem__, exact=True)


def large_offset() -> Iterator[HardCase]:
    """Yield a crank-rocker far from the origin."""
    for ratio in OFFSETS:
        linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0, origin=(4.0 / ratio, -4.0 / ratio))
        yield _steps("large offset", ratio, linkage, [0.5 + 0.1 * k for k in range(6)])


def far_start() -> Iterator[HardCase]:
    """Yield a crank-rocker at one time, from estimates whose angles are far off."""
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
    for away in (0.5, 1.5, 3.0):
        scene = _scene(linkage, UP, [0.7], _moved(linkage.assemble(0.7), away), "crank", "far start")
        yield HardCase("far start", away, scene, lambda _: None, any_assembly=True)


def coarse_steps() -> Iterator[HardCase]:
    """Yield a crank-rocker that comes to 0.02 of another assembly, in steps of up to a third of a turn."""
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.99, rocker=1.02)
    for step in STEPS:
        yield _steps("coarse steps", step, linkage, [-2.5 + step * k for k in range(round(5.0 / step) + 1)])


KINDS: Mapping[str, Callable[[], Iterator[HardCase]]] = {
    kind.__name__: kind
    for kind in (
        toggle, dead_centre, near_change_point, parallelogram, parallelogram_passed, kite, isosceles, slot,
        unassemblable, singular, redundant, branching, branching_tree, large_offset, far_start, coarse_steps, *SPATIAL,
    )
}  # fmt: skip


def _approach(case: str, d: float, linkage: Linkage, end: float, side: float, driven: str = "crank") -> HardCase:
    """Return the case whose input goes to `end` + side * d, by steps and then by powers of ten."""
    return _made(case, d, linkage, (end, -side), [-way for way in ways_to(d)], driven=driven)


def _steps(case: str, d: float, linkage: Linkage, inputs: Sequence[float]) -> HardCase:
    return _made(case, d, linkage, UP, inputs)


def _made(
    case: str, d: float, linkage: Linkage, law: tuple[float, float], times: Sequence[float], driven: str = "crank"
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
        one = FourBar(ground=4.0 + 2.0 * n / loops, crank=1.0, coupler=3.5 + n / loops, rocker=3.0)
        names = {GROUND: GROUND, "crank": "crank", "coupler": f"coupler {n}", "rocker": f"rocker {n}"}
        for joint in one.joints()[min(n, 1) :]:  # one crank for all
            assert isinstance(joint, Revolute)
            i, j = (names[body] for body in joint.bodies)
            joints.append(replace(joint, name=f"{joint.name} {n}", body_i=i, body_j=j))
        for angle in angles:
            poses[angle] |= {names[body]: q for body, q in one.assemble(angle).items()}
    return joints, poses
