"""Where nothing is compared an answer that is called ok has numbers, closed joints, and points on its own bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import crosscheck
import refkin
from crosscheck.engines import Term
from crosscheck.engines.loading import load
from crosscheck.engines.spatial.turning import product
from crosscheck.judge.comparison import compare, reference
from crosscheck.judge.records import QUANTITIES, Cause
from crosscheck.judge.uncompared import Uncompared, opened_beside
from crosscheck.measure.check import check
from crosscheck.scenes.conformance import WAVE
from crosscheck.scenes.conformance_space import spatial_scenes
from refkin.motion import Status
from refkin.solving.starts import in_form
from refkin.system import compile_system
from tests.crosscheck.made_up_engines import Made
from tests.crosscheck.test_judgements import some
from tests.linkages import ROCKER, beside, remade
from tests.places import CORPUS, ROOT
from tests.refkin.test_answers import files

OPEN, NUMBERLESS = (("position", cause) for cause in (Cause.UNCLOSED, Cause.NO_NUMBER))
LOST = {
    "limit-touched-1e-17": Status.BRANCH_LOST,
    "crank-over-a-gap": Status.BRANCH_LOST,
    "parallelogram-passed": Status.BRANCH_LOST,
    "space-distance-through-zero": Status.BRANCH_LOST,
    "cam-bump-between-times": Status.BRANCH_LOST,
    "swings-beyond-count": Status.NOT_CONVERGED,
    "unassemblable-but-assembled": Status.LOCKED,
}


def corpus(name):
    return refkin.load(CORPUS / f"{name}.toml")


def at(status, **levels):
    """Return a change of what is said at the times at which the reference has a status: ok, and these numbers."""

    def change(motion):
        here = np.array([s is status for s in motion.status])
        new = {name: np.where(here, level, getattr(motion, name)) for name, level in levels.items()}
        said = [Status.OK if there else s for there, s in zip(here, motion.status, strict=True)]
        return replace(motion, status=tuple(said), **new)

    return change


def found(scene, change, expected, **more):
    """Return what is wrong with the reference's own answer after a change."""
    said = check(scene, [Made("made", change, **more)], {"expected": str(expected)}).disagreements
    return {(d.quantity, d.kind) for d in said if d.method != "rows" and d.kind is not Cause.ORDER}


@pytest.mark.parametrize("name", LOST)
def test_where_the_reference_has_no_motion_joints_are_closed_and_numbers_are_there(name):
    status = LOST[name]

    assert OPEN in found(corpus(name), at(status, q=0.7), status)
    assert NUMBERLESS in found(corpus(name), at(status, q=np.nan), status)


@pytest.mark.parametrize("name", ["crank-over-a-gap", "swings-beyond-count"])
def test_rates_that_are_not_there_are_no_numbers_but_where_there_are_none(name):
    status = LOST[name]
    closed = at(status, q=1.0, qd=np.nan, qdd=np.nan)

    assert ("velocity", Cause.NO_NUMBER) in found(corpus(name), closed, status)
    none = at(Status.SINGULAR, qd=np.nan, qdd=np.nan)
    assert found(corpus("singular-in-the-end"), none, Status.SINGULAR) == set()


def lost(scene, status):
    """Return the reference of a scene as if it knew no motion, or no pose either, and its answer, all of it ok."""
    ref = reference(some(refkin.load(files()[scene])) if isinstance(scene, str) else scene)
    levels = [level if status is Status.LOCKED else np.full_like(level, np.nan) for level in ref.levels]
    motion, *others = (replace(ref.motion, status=(s,) * len(ref.motion.t)) for s in (Status.OK, status))
    return replace(ref, motion=others[0], levels=tuple(levels), _budgets={}), motion


@pytest.mark.parametrize("status", [Status.LOCKED, Status.BRANCH_LOST])
@pytest.mark.parametrize("name", ["gear", "rack_and_pinion", "cam", "spatial-screw", "slider-turned-1e4-rad"])
def test_a_closed_pose_is_closed_whatever_the_turns_and_whatever_joints_bring(name, status):
    ref, motion = lost(name, status)
    q, turned = motion.q, motion.kind.name == "planar"
    q[2::3] += 2 * np.pi * np.arange(len(motion.bodies))[:, None] * turned
    kinds = [
        [
            fault["kind"]
            for fault in Uncompared(ref, replace(motion, q=q + off * (np.arange(len(q)) == row)[:, None])).unclosed()
        ]
        for row in range(len(q))
        for off in (0.0, 1e-9)
    ]

    assert kinds == [[], [Cause.UNCLOSED]] * len(q)


@pytest.mark.parametrize(("part", "said"), [(0.5, []), (100.0, [Cause.UNCLOSED])])
def test_in_space_hinges_are_closed_to_rounding_of_the_angle_that_a_driver_asks_for(part, said):
    """An engine in joint angles turned the rocker as far as the crank, and its ball was said to be open."""
    scene = some(refkin.load(ROOT / "examples" / "rssr.toml"))
    (motor,) = scene.mechanism.drivers
    law = replace(motor.law, coefficients=(0.4 + 3200 * np.pi, 1.0))
    mechanism = replace(scene.mechanism, drivers=(replace(motor, law=law),))
    ref, motion = lost(replace(scene, mechanism=mechanism), Status.BRANCH_LOST)
    q, half = motion.q.copy(), part * np.spacing(3200 * np.pi) / 2
    q[-4:] = product(q[-4:].T, np.array([1.0, 0.0, 0.0, half])).T

    assert [fault["kind"] for fault in Uncompared(ref, replace(motion, q=q)).unclosed()] == said


@pytest.mark.parametrize("status", [Status.LOCKED, Status.BRANCH_LOST])
@pytest.mark.parametrize("name", ["crank-rocker", "gear", "rack_and_pinion", "redundant-16-ulp", "spatial-fixed"])
def test_where_nothing_is_compared_rates_are_those_of_the_pose(name, status):
    """Any that were numbers would do: of each coordinate of each body one is off by 1e-9 of a radian or size."""
    ref, motion = lost(name, status)
    if motion.kind.name == "planar":
        motion = replace(motion, q=motion.q + 2 * np.pi * (np.arange(len(motion.q)) % 3 == 2)[:, None])
    assert list(Uncompared(ref, motion).opening()) == []

    for order, (letter, quantity) in enumerate([("qd", "velocity"), ("qdd", "acceleration")], 1):
        size = 1e-9 * max(1.0, ref.system.unit.size) * np.max(np.abs(ref.motion.levels[order])).clip(1.0)
        for row in range(len(motion.q)):
            off = replace(
                motion, **{letter: getattr(motion, letter) + size * (np.arange(len(motion.q)) == row)[:, None]}
            )
            said = {(fault["quantity"], fault["kind"]) for fault in Uncompared(ref, off).opening()}
            assert (quantity, Cause.UNCLOSED) in said


@pytest.mark.parametrize(
    ("name", "engine"),
    [
        ("limit-touched-by-another-loop", "exudyn"),
        ("rate-law-alias", "closed_form"),
        ("laws-turn-back-together", "mujoco"),
    ],
)
def test_an_engine_that_goes_on_where_the_reference_does_not_has_rates_of_its_own_pose(name, engine):
    scene, other = corpus(name), load(engine)
    motion, terms = other.solve(scene), other.terms(scene)

    def said(**levels):
        off = replace(motion, **{letter: getattr(motion, letter) * by for letter, by in levels.items()})
        return found(scene, lambda _: off, Status.BRANCH_LOST, terms=lambda *_: terms)

    assert said() == set()
    assert {("velocity", Cause.UNCLOSED), ("acceleration", Cause.UNCLOSED)} <= said(qd=1.0 + 1e-9)
    assert {kind for kind in said(qdd=1.0 + 1e-9) if Cause.UNCLOSED in kind} == {("acceleration", Cause.UNCLOSED)}


@pytest.mark.parametrize(("bodies", "said"), [(("rocker",), [Cause.UNCLOSED]), (("coupler",), [])])
def test_of_some_bodies_the_joints_among_them_and_with_the_ground_are_asked(bodies, said):
    """A coupler alone has none."""
    scene = replace(corpus("singular-in-the-end"), bodies_wanted=bodies)
    ref, motion = reference(scene), refkin.solve(scene)
    moved = replace(motion, q=motion.q + 1e-9, status=(Status.OK,) * len(motion.t))

    assert [fault["kind"] for fault in Uncompared(ref, moved).unclosed()] == said


def test_rates_are_asked_of_parts_of_which_all_bodies_answer():
    """At its dead centre a slider stands still, and is rounded as a crank is whose rate the answer does not tell."""
    crank = refkin.SliderCrank(crank=1.0, rod=2.5).scene(
        law=refkin.Polynomial(coefficients=(0.0, 1e3)), times=(0.0, 0.1)
    )
    ref, motion = lost(beside(crank, ROCKER.scene(times=crank.times)), Status.BRANCH_LOST)
    last = {letter: getattr(motion, letter)[6:] for letter in ("q", "qd", "qdd")}
    fewer = replace(motion, bodies=motion.bodies[2:], **last)
    for row, off, said in ((1, 1e-13, []), (2, 1e-13, []), (-1, 1e-9, [Cause.UNCLOSED] * 2)):
        answer = replace(fewer, qd=fewer.qd + off * (np.arange(12) == row % 12)[:, None])
        assert [fault["kind"] for fault in Uncompared(ref, answer).opening()] == said


@pytest.mark.parametrize("name", ["space-printed-flipped", "space-bodies-at-rest"])
def test_a_pose_is_closed_in_the_form_of_a_rule_however_many_rows_that_has(name):
    """An index was out of range: half angles are fewer rows than printed ones."""
    ref, motion = lost(corpus(name), Status.BRANCH_LOST)
    rule = Term(name="rule", level="position", reason="made up", absolute=1e-12, form="half")

    assert list(Uncompared(ref, motion, [rule]).unclosed()) == []
    (fault,) = Uncompared(ref, replace(motion, q=motion.q + 1e-9), [rule]).unclosed()
    assert fault["kind"] is Cause.UNCLOSED


@pytest.mark.parametrize("arbiter", [False, True])
def test_a_regular_loop_is_on_its_own_branch_also_while_another_is_stretched(arbiter):
    """The answer is 1e13 least errors from the only pose that is near; the certificate says so, too."""
    stretched = corpus("singular-in-the-end")
    both, crossed = (
        beside(stretched, ROCKER.scene(times=stretched.times, branch=branch)) for branch in ("open", "crossed")
    )
    there = refkin.solve(crossed).q[:, -1]

    def flipped(motion):
        q = motion.q.copy()
        if len(motion.t) == len(both.times):
            q[:, -1] = there
        return at(Status.SINGULAR, qd=np.nan, qdd=np.nan)(replace(motion, q=q))

    record = check(both, [Made("made", flipped)], {"expected": "singular"}, arbiter=arbiter)
    (said,) = [d for d in record.disagreements if d.method != "rows"]
    assert (said.kind, said.quantity, said.at.time) == (Cause.OTHER_ASSEMBLY, "position", both.times[-1])
    assert " 2." in said.at.component
    assert said.ratio > 1e12
    assert not arbiter or record.answers[0].certificate.outside == 1


def test_rates_in_a_singular_pose_are_no_less_wrong_for_one_that_is_missing():
    some = np.array([np.nan, *[5.0] * 8])[:, None]
    rates = {(quantity, Cause.SINGULAR_RATES) for quantity in ("velocity", "acceleration")}
    rated = at(Status.SINGULAR, qd=some, qdd=some)
    assert found(corpus("singular-in-the-end"), rated, Status.SINGULAR) == rates


@pytest.mark.parametrize(("name", "status"), [("singular-in-the-end", Status.SINGULAR), ("time-resolution", Status.OK)])
@pytest.mark.parametrize(("letter", "quantity"), [("r", "position"), ("v", "velocity"), ("a", "acceleration")])
def test_where_nothing_is_compared_points_are_where_the_bodies_of_the_answer_have_them(name, status, letter, quantity):
    scene = corpus(name)
    body = scene.mechanism.bodies[-1].name
    scene = replace(scene, points=(refkin.Point(name="P", body=body, position=(0.3, -0.4)),))
    verdict = reference(scene).motion.verdict

    def moved(motion, off):
        here = np.array([s is status for s in motion.status])
        point = motion.points["P"]
        there = replace(point, **{letter: np.where(here & np.array([[False], [True]]), off, getattr(point, letter))})
        return replace(at(Status.SINGULAR)(motion), points={"P": there})

    record = check(scene, [Made("made", lambda motion: moved(motion, 1e30))], {"expected": str(verdict)})
    (said,) = [d for d in record.disagreements if d.method != "rows"]
    assert (said.quantity, said.kind, said.at.component) == (quantity, Cause.BEYOND, "P.y")
    assert said.ratio > 1e10
    assert found(scene, at(Status.SINGULAR), verdict) == set()


@pytest.mark.parametrize("order", [0, 1, 2])
def test_beside_a_singular_pose_what_a_budget_allows_opens_no_joint(order):
    """At sigma_min = 1e-6 one coordinate could be off by 1e-9, 1e-4 of a rate, 9 of an acceleration of 0.07.

    So far rounding leads along the way that the joints hardly hold, and there alone.
    """
    law = refkin.Polynomial(coefficients=(np.pi - 0.5 - 1e-5, 0.5))
    scene = refkin.FourBar(ground=4.0, crank=1.0, coupler=4.0, rocker=1.0).scene(law=law, times=(0.0, 1.0))
    ref = reference(scene)
    q, t, allowed = ref.levels[0][:, 1], ref.motion.t[1], ref.budget().levels[order][:, 1]
    along = np.linalg.svd(ref.system.phi_q(q, t))[2][-1]
    alone = np.arange(len(q)) == np.argmax(allowed)

    def off_by(off):
        levels = [level.copy() for level in ref.motion.levels]
        levels[order][:, 1] += ref.system.to_physical(off, max(order, 1))
        return replace(ref.motion, q=levels[0], qd=levels[1], qdd=levels[2])

    wrong, right = off_by(0.9 * allowed * alone), off_by(0.9 * along * np.min(allowed / np.abs(along)))
    assert compare(ref, wrong).agrees
    assert found(scene, lambda motion: wrong, Status.OK) == {(QUANTITIES[order], Cause.UNCLOSED)}
    assert found(scene, lambda motion: right, Status.OK) == set()
    formed = (Term(name="rule", level="position", reason="", absolute=1e-20, form="half"),)  # the plane has no forms
    (fault,) = opened_beside(ref, wrong, formed, compare(ref, wrong, formed))
    assert (fault["quantity"], fault["kind"]) == (QUANTITIES[order], Cause.UNCLOSED)
    with pytest.raises(AssertionError, match=f"{QUANTITIES[order]}: ok where joints are open"):
        crosscheck.assert_agrees(wrong, scene)


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("absolute", [0.0, 1e-13])
def test_beside_a_singular_pose_joints_are_asked_of_whoever_has_rows_of_another_form(absolute, order):
    """Rows in dot products are linear in those in half angles, and so is what is left in them: no term lets them off.

    A cylinder nearly as long as it can be, at which it lifts its boom no further.
    """
    longest, terms = 2.5279215651039446, (Term(name="r", level="position", reason="", absolute=absolute, form="dot"),)
    law = refkin.Polynomial(coefficients=(1.2, longest - 1e-10 - 1.2))
    boom = next(scene for about, scene, _ in spatial_scenes(WAVE, (0.0, 1.0)) if about == "space: distance driven")
    scene = remade(boom, drivers=(replace(boom.mechanism.drivers[0], law=law),))
    ref = reference(scene)
    allowed, levels = ref.budget(terms).levels[order][:, 1], [level.copy() for level in ref.motion.levels]
    alone = np.arange(len(allowed)) == np.argmax(allowed)
    levels[order][:, 1] += ref.system.to_physical(0.9 * allowed * alone, max(order, 1))
    wrong = replace(ref.motion, q=levels[0], qd=levels[1], qdd=levels[2])
    compared = compare(ref, wrong, terms)

    assert compared.agrees
    assert {fault["quantity"] for fault in opened_beside(ref, wrong, terms, compared)} == {QUANTITIES[order]}
    dot = compile_system(in_form(scene.mechanism, "dot"), unit=ref.system.unit)
    q, t = ref.levels[0][:, 1], 1.0
    for _ in range(4):  # what such rows leave is no fault, nor are rates that solve them
        q = q - np.linalg.solve(dot.phi_q(q, t), dot.phi(q, t) - 0.9 * absolute)
    qd = np.linalg.solve(dot.phi_q(q, t), dot.nu(q, t))
    levels = [level.copy() for level in ref.motion.levels]
    for k, level in enumerate((q, qd, np.linalg.solve(dot.phi_q(q, t), dot.gamma(q, qd, t)))):
        levels[k][:, 1] = ref.system.to_physical(level, k)
    right = replace(ref.motion, q=levels[0], qd=levels[1], qdd=levels[2])
    assert list(opened_beside(ref, right, terms, compare(ref, right, terms))) == []


def test_rates_may_be_those_of_another_pose_that_is_allowed():
    """Two poses that are off by as much, to either side, are twice as far apart: rates of the one were 1.8 too much."""
    law = refkin.Polynomial(coefficients=(np.pi - 0.5 - 1e-4, 0.5))
    scene = refkin.FourBar(ground=4.0, crank=1.0, coupler=4.0, rocker=1.0).scene(law=law, times=(0.0, 1.0))
    ref, terms = reference(scene), (Term(name="rule", level="position", reason="", absolute=1e-12),)
    system, t, levels = ref.system, 1.0, [level.copy() for level in ref.motion.levels]
    left = 0.9e-12 * np.sign(np.linalg.svd(system.phi_q(ref.levels[0][:, 1], t))[0][:, -1])

    def pose(left):
        q = ref.levels[0][:, 1]
        for _ in range(4):
            q = q - np.linalg.solve(system.phi_q(q, t), system.phi(q, t) - left)
        return q

    q = pose(-left)
    qd = np.linalg.solve(system.phi_q(q, t), system.nu(q, t))
    qdd = np.linalg.solve(system.phi_q(q, t), system.gamma(q, qd, t))
    for order, level in enumerate((pose(left), qd, qdd)):
        levels[order][:, 1] = system.to_physical(level, order)
    answer = replace(ref.motion, q=levels[0], qd=levels[1], qdd=levels[2])
    compared = compare(ref, answer, terms)

    assert compared.agrees
    assert list(opened_beside(ref, answer, terms, compared)) == []
