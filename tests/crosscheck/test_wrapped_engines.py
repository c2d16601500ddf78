"""Engines that are right but for one fault, of kinds that nobody's adapter has: a small night sees every one of them.

It draws equal links, too, and scenes that end in a singular pose or in none: who mistakes them is seen.

The night's scenes are drawn as they are in any night, at fewer times; the right answer is that of the closed form. What
both take of a scene, the reference and that answer, is computed once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain
from typing import Any

import numpy as np
import pytest

from crosscheck.engines import EngineError
from crosscheck.engines.closed_form.engine import ClosedForm
from crosscheck.measure import check as checking
from crosscheck.night.campaign import run
from crosscheck.night.plan import NightPlan
from crosscheck.scenes.drawing import ENDED, EQUAL, SPECIAL_EVERY, describe, draw
from refkin.joints import GROUND
from refkin.model import Effect, Scene
from refkin.motion import Motion, Status

from .fake_engines import engine_file

NIGHT, SAMPLES = 20261122, 9
SCENES = (*range(56), 111)
"""The last is the first that has two drivers."""
Fault = Callable[[Motion, Scene], Motion]


class Wrapped(ClosedForm):
    """The closed form with a fault."""

    name = "wrapped"
    delivers = ("position", "velocity", "acceleration")

    def __init__(self, fault: Fault) -> None:
        super().__init__()
        self.fault = fault

    def solve(self, scene, route=None):
        return self.fault(right(scene), scene)


@cache
def right(scene: Scene) -> Motion:
    return ClosedForm().solve(scene)


@cache
def night() -> list[tuple[Any, dict[str, Any]]]:
    drawn = [draw(NIGHT, number, SAMPLES) for number in SCENES]
    return [(d.scene, describe(d)) for d in drawn]


@pytest.fixture(autouse=True)
def solved_once(monkeypatch):
    monkeypatch.setattr(checking, "reference", reference)
    monkeypatch.setattr(checking, "SHARPNESS", math.inf)  # nothing that a fault changes


reference = cache(checking.reference)


def kinds(fault: Fault, scene: Scene, about: dict[str, Any]) -> set[str]:
    """Return the kinds of disagreements of an engine with a fault in one scene."""
    return {d.kind for d in checking.check(scene, [Wrapped(fault)], about).disagreements if d.engine == "wrapped"}


def seen(fault: Fault, kind: str) -> bool:
    """Whether the night has a scene in which an engine with a fault has a disagreement of a kind."""
    return any(kind in kinds(fault, *drawn) for drawn in night())


@dataclass(frozen=True)
class At:
    """A change of one level of a motion, where `where` says so; (3 bodies, T) arrays."""

    level: str
    change: Callable[[Any, Motion], Any]

    def __call__(self, motion: Motion, scene: Scene) -> Motion:
        return replace(motion, **{self.level: self.change(getattr(motion, self.level).copy(), motion)})


def on(rows: Any, columns: Any, do: Callable[[Any], Any]) -> Callable[[Any, Motion], Any]:
    """Return a change of some rows and columns alone."""

    def change(level, motion):
        level[rows, columns] = do(level[rows, columns])
        return level

    return change


EVERY, ANGLES = slice(None), slice(2, None, 3)


def swapped(motion: Motion, scene: Scene) -> Motion:
    """The first two bodies change places."""
    if len(motion.bodies) < 2:
        return motion
    order = [1, 0, *range(2, len(motion.bodies))]
    rows = np.concatenate([np.r_[3 * k : 3 * k + 3] for k in order])
    return replace(motion, q=motion.q[rows], qd=motion.qd[rows], qdd=motion.qdd[rows])


def late(motion: Motion, scene: Scene) -> Motion:
    """Every time has the answer of the one before it."""
    return replace(motion, **{k: np.roll(getattr(motion, k), 1, axis=1) for k in ("q", "qd", "qdd")})


def stale(motion: Motion, scene: Scene) -> Motion:
    """The last time has the answer of the last but one."""
    if len(motion.t) < 2:
        return motion
    levels = {key: getattr(motion, key).copy() for key in ("q", "qd", "qdd")}
    for level in levels.values():
        level[:, -1] = level[:, -2]
    return replace(motion, **levels)


def believing(motion: Motion, scene: Scene) -> Motion:
    """Nothing is ever not ok; a time without an answer has the last one's."""
    levels = {key: getattr(motion, key).copy() for key in ("q", "qd", "qdd")}
    for level in levels.values():
        for k in range(1, level.shape[1]):
            level[:, k] = np.where(np.isfinite(level[:, k]), level[:, k], level[:, k - 1])
    return replace(motion, status=(Status.OK,) * len(motion.t), **levels)


def giving_up(motion: Motion, scene: Scene) -> Motion:
    """A regular time in the middle is said not to converge."""
    status = [*motion.status]
    status[len(status) // 2] = Status.NOT_CONVERGED
    return replace(motion, status=tuple(status))


def near_limits(motion: Motion, scene: Scene) -> Motion:
    """Accelerations have the other sign where they are largest."""
    qdd = motion.qdd.copy()
    k = int(np.nanargmax(np.max(np.abs(qdd), axis=0))) if np.isfinite(qdd).any() else 0
    qdd[:, k] *= -1.0
    return replace(motion, qdd=qdd)


def degrees(level, motion):
    """Angles beyond half a turn go by way of degrees with four decimals."""
    far = np.abs(level[ANGLES]) > math.pi
    level[ANGLES] = np.where(far, np.radians(np.round(np.degrees(level[ANGLES]), 4)), level[ANGLES])
    return level


def only_first_body(motion: Motion, scene: Scene) -> Motion:
    return replace(motion, bodies=motion.bodies[:1], q=motion.q[:3], qd=motion.qd[:3], qdd=motion.qdd[:3])


def mirrored(motion: Motion, scene: Scene) -> Motion:
    """The mechanism is mirrored in the x axis."""
    sign = np.tile([1.0, -1.0, -1.0], len(motion.bodies))[:, None]
    return replace(motion, q=sign * motion.q, qd=sign * motion.qd, qdd=sign * motion.qdd)


def differenced(motion: Motion, scene: Scene) -> Motion:
    """Velocities are differences of positions."""
    if len(motion.t) < 3:
        return motion
    return replace(motion, qd=np.gradient(motion.q, motion.t, axis=1))


def one_driver_drops(motion: Motion, scene: Scene) -> Motion:
    """What the last driver's law curves by is left out of accelerations where there is another driver."""
    if len(scene.mechanism.drivers) < 2:
        return motion
    ref = reference(scene)
    system, (q, *_) = ref.system, ref.levels
    curved = np.zeros((system.m, len(motion.t)))
    curved[-1] = [scene.mechanism.drivers[-1].laws[0](t, 2) for t in motion.t]
    off = np.linalg.solve(np.moveaxis(system.phi_q(q, motion.t), -1, 0), curved.T[..., None])[..., 0].T
    rows = np.concatenate([np.r_[system.columns(body)] for body in motion.bodies])
    return replace(motion, qdd=motion.qdd - system.to_physical(off, 2)[rows])


def every_other(motion: Motion, scene: Scene) -> Motion:
    """Half of the times are answered."""
    levels = {key: getattr(motion, key)[:, ::2] for key in ("q", "qd", "qdd")}
    return replace(motion, t=motion.t[::2], status=motion.status[::2], **levels)


def unit_vectors(motion: Motion, scene: Scene) -> Motion:
    """Directions are taken to have length 1."""
    given = [getattr(joint, key, None) for joint in scene.mechanism.joints for key in checking.DIRECTIONS]
    off = [abs(math.hypot(*u) - 1.0) for u in given if u is not None]
    return replace(motion, q=motion.q * (1.0 + 1e-3 * round(max(off, default=0.0), 9)))


def evenly(motion: Motion, scene: Scene) -> Motion:
    """Times are taken to be evenly apart."""
    times = tuple(np.linspace(scene.times[0], scene.times[-1], len(scene.times)))
    if np.allclose(times, scene.times):
        return motion
    return replace(right(replace(scene, times=times)), t=motion.t)


def made_up(motion: Motion, scene: Scene) -> Motion:
    """Where no error is bounded the pose is made up, and called ok without rates."""
    levels, there = (
        {key: getattr(motion, key).copy() for key in ("q", "qd", "qdd")},
        ~reference(scene).budget().compared,
    )
    for level, number in zip(levels.values(), (0.123, math.nan, math.nan), strict=True):
        level[:, there] = number
    status = tuple(Status.OK if wrong else s for wrong, s in zip(there, motion.status, strict=True))
    return replace(motion, status=status, **levels)


def growing(order: str) -> Fault:
    """Return the fault that rates of Euler parameters of a passive body have a part along these parameters."""

    def fault(motion: Motion, scene: Scene) -> Motion:
        level = getattr(motion, order).copy()
        for body in chain(*reference(scene).passive):
            own = slice(7 * motion.bodies.index(body) + 3, 7 * motion.bodies.index(body) + 7)
            level[own] += 0.3 * motion.q[own]
        return replace(motion, **{order: level})

    return fault


def twice(motion: Motion, scene: Scene) -> Motion:
    """The first body is answered for twice, the second time wrongly."""
    rows = motion.kind.width
    levels = {key: np.vstack([getattr(motion, key), 1.1 * getattr(motion, key)[:rows]]) for key in ("q", "qd", "qdd")}
    return replace(motion, bodies=(*motion.bodies, motion.bodies[0]), **levels)


FAULTS: dict[str, tuple[Fault, str]] = {
    "without what a second driver's law curves by": (one_driver_drops, "beyond the allowed error"),
    "a body twice": (twice, "not delivered"),
    "times as a list": (lambda motion, scene: replace(motion, t=list(motion.t)), "not delivered"),
    "no velocity": (lambda motion, scene: replace(motion, qd=None), "not delivered"),
    "no acceleration": (lambda motion, scene: replace(motion, qdd=None), "not delivered"),
    "one body alone": (only_first_body, "not delivered"),
    "two bodies swapped": (swapped, "beyond the allowed error"),
    "late by one time": (late, "beyond the allowed error"),
    "a stale answer at the last time": (stale, "beyond the allowed error"),
    "the sign of one acceleration": (near_limits, "beyond the allowed error"),
    "ok where there is nothing": (believing, "ok where there is no assembly"),
    "no answer at a regular time": (giving_up, "no answer"),
    "directions of other lengths taken for unit vectors": (unit_vectors, "depends on how a scene is stated"),
    "times of its own": (lambda motion, scene: replace(motion, t=motion.t + 1e-3), "not delivered"),
    "times of which it knows the first and the last": (evenly, "beyond the allowed error"),
    "half of the times": (every_other, "not delivered"),
    "a body that nobody knows": (
        lambda motion, scene: replace(motion, bodies=("stranger", *motion.bodies[1:])),
        "not delivered",
    ),
    "a pose made up where it is singular": (made_up, "ok where joints are open"),
    "velocities of a passive body along its parameters": (growing("qd"), "beyond the allowed error"),
    "accelerations of a passive body along its parameters": (growing("qdd"), "beyond the allowed error"),
    "not a number in one place": (At("qd", on(-1, -1, lambda x: math.nan)), "status ok without a number"),
    "infinity in one place": (At("qdd", on(0, -1, lambda x: math.inf)), "status ok without a number"),
    "positions of float32": (At("q", on(EVERY, EVERY, lambda x: np.float32(x))), "beyond the allowed error"),
    "velocities of float32": (At("qd", on(EVERY, EVERY, lambda x: np.float32(x))), "beyond the allowed error"),
    "accelerations of float32": (At("qdd", on(EVERY, EVERY, lambda x: np.float32(x))), "beyond the allowed error"),
    "rounded to ten decimals": (At("q", on(EVERY, EVERY, lambda x: np.round(x, 10))), "beyond the allowed error"),
    "wrong at one time alone": (
        At("q", on(0, slice(3, 4), lambda x: x + 1e-9 * abs(x) + 1e-12)),
        "beyond the allowed error",
    ),
    "degrees at large angles": (At("q", degrees), "beyond the allowed error"),
    "angles of the wrong sense": (At("q", on(ANGLES, EVERY, lambda x: -x)), "beyond the allowed error"),
    "mirrored": (mirrored, "beyond the allowed error"),
    "rates per minute": (At("qd", on(EVERY, EVERY, lambda x: 60.0 * x)), "beyond the allowed error"),
    "angular rates in degrees": (At("qd", on(ANGLES, EVERY, np.degrees)), "beyond the allowed error"),
    "velocities by differences": (differenced, "beyond the allowed error"),
    "millimetres": (At("q", on(slice(0, None, 3), EVERY, lambda x: 1e3 * x)), "beyond the allowed error"),
    "off by 1e-12 of itself": (At("q", on(slice(0, 3), EVERY, lambda x: x * (1 + 1e-12))), "beyond the allowed error"),
    "a body without acceleration": (At("qdd", on(slice(-3, None), EVERY, np.zeros_like)), "beyond the allowed error"),
    "a first time that is the estimate": (lambda motion, scene: estimated(motion, scene), "beyond the allowed error"),
}


def estimated(motion: Motion, scene: Scene) -> Motion:
    """The first pose is the estimate itself."""
    q = motion.q.copy()
    for k, name in enumerate(motion.bodies):
        q[3 * k : 3 * k + 3, 0] = next(b.estimate for b in scene.mechanism.bodies if b.name == name)
    return replace(motion, q=q)


def test_a_right_engine_is_blamed_for_nothing():
    assert [about for scene, about in night() if kinds(lambda motion, scene: motion, scene, about)] == []


@pytest.mark.parametrize("name", FAULTS)
def test_a_small_night_sees_an_engine_with_one_fault(name):
    fault, kind = FAULTS[name]

    assert seen(fault, kind)


PLANT = """
        from crosscheck.judge.comparison import reference
        from crosscheck.judge.samples import input_sensitivity
        ref = reference(scene)
        judged = np.flatnonzero(ref.budget().compared)[::8]
        off = np.zeros((3, *ref.levels[0].shape))
        off[:, :, judged] = 10.0 * input_sensitivity(ref, judged.tolist())
        qd, qdd = (None if rate is None else rate + ref.system.to_physical(off[k], 1)[: ref.system.of_bodies]
                   for k, rate in ((1, motion.qd), (2, motion.qdd)))
        motion = replace(motion, qd=qd, qdd=qdd)
"""


def test_a_real_night_sees_an_engine_whose_rates_are_off_by_ten_times_the_sensitivity(tmp_path):
    spec = engine_file(tmp_path, name="planted", after=PLANT.strip())
    night = run(NightPlan(seed=9, out=tmp_path / "night", engines=(spec,), scenes=12, workers=1, shrinking_seconds=0.0))

    assert night.failed == []
    assert {(new.disagreement.engine, new.disagreement.quantity) for new in night.new} == {
        ("planted", "velocity"),
        ("planted", "acceleration"),
    }


def test_what_raises_an_error_at_a_singular_pose_is_excused_and_elsewhere_not():
    def raising(motion: Motion, scene: Scene) -> Motion:
        if all(status is Status.OK for status in motion.status):
            return motion
        raise EngineError("the Jacobian is singular")

    def always(motion: Motion, scene: Scene) -> Motion:
        raise EngineError("out of order")

    assert seen(always, "no answer")
    for scene, about in night():
        if about["expected"] == "singular":
            assert kinds(raising, scene, about) == set()


NUMBERS = range(0, 10 * SPECIAL_EVERY, SPECIAL_EVERY)


@cache
def ended() -> list[Any]:
    drawn = (draw(3, number + ENDED, SAMPLES) for number in NUMBERS)
    return [replace(d, scene=replace(d.scene, effects=frozenset(Effect))) for d in drawn]  # some call for less


@cache
def equal() -> list[Any]:
    return [draw(3, number + EQUAL, 3) for number in NUMBERS]


def resting(motion: Motion, scene: Scene) -> Motion:
    """Nothing is ever not ok, and there are no rates."""
    return replace(believing(motion, scene), qd=None, qdd=None)


def confusing(motion: Motion, scene: Scene) -> Motion:
    """Bodies whose joint points are equally far apart are taken for one another."""
    points: dict[str, list[complex]] = {body: [] for body in (GROUND, *motion.bodies)}
    for constraint in scene.mechanism.joints:
        for body, point in constraint.points():
            points[body].append(complex(*point))
    spans = [abs(points[body][0] - points[body][-1]) for body in motion.bodies]
    first = [next(j for j, other in enumerate(spans) if abs(other - span) <= 1e-6 * span) for span in spans]
    rows = np.concatenate([np.arange(3 * j, 3 * j + 3) for j in first])
    return replace(motion, q=motion.q[rows], qd=motion.qd[rows], qdd=motion.qdd[rows])


def shown(drawn: Any, fault: Fault = lambda motion, scene: motion) -> set[str]:
    """Return the kinds of all disagreements where an engine with a fault is asked for a drawn scene."""
    return {d.kind for d in checking.check(drawn.scene, [Wrapped(fault)], describe(drawn)).disagreements}


def test_the_reference_proves_how_each_scene_ends():
    assert {d.expected for d in ended()} == {Status.SINGULAR, Status.UNASSEMBLABLE}
    assert [shown(d) for d in ended()] == [set()] * len(NUMBERS)


@pytest.mark.parametrize(
    ("expected", "kind"),
    [(Status.UNASSEMBLABLE, "ok where there is no assembly"), (Status.SINGULAR, "rates in a singular pose")],
)
def test_an_engine_that_says_ok_where_there_is_nothing_fails(expected, kind):
    of_kind = [d for d in ended() if d.expected is expected]

    assert of_kind
    assert all(kind in shown(d, believing) for d in of_kind)
    assert all((kind in shown(d, resting)) is (expected is Status.UNASSEMBLABLE) for d in of_kind)


def test_another_verdict_than_the_one_a_scene_was_made_for_is_the_reference_s_disagreement():
    drawn = ended()[0]
    value = checking.check(drawn.scene, [], {**describe(drawn), "expected": "ok"}).disagreements

    assert [(d.engine, d.how) for d in value] == [("refkin", drawn.expected.value)]


def test_an_engine_that_mistakes_equal_bodies_is_seen_on_equal_links_alone():
    unequal = [draw(3, number, 3) for number in range(5)]

    assert [shown(d) for d in equal()] == [set()] * len(NUMBERS)
    assert any(shown(d, confusing) for d in equal())
    assert not any(shown(d, confusing) for d in unequal)
