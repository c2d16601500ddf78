"""A sweep answers what the reference answers, to the digits that its proofs and budgets allow, or leaves it to it."""

from __future__ import annotations

import importlib
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings

import refkin
from crosscheck.engines.ours.batch import RefkinBatch
from crosscheck.judge.comparison import compare, reference
from crosscheck.strategies import Hardness, drawn_scenes
from refkin import (
    Body,
    Effect,
    Evidence,
    FourBar,
    InvertedSliderCrank,
    Mechanism,
    Point,
    Polynomial,
    Revolute,
    Scene,
    Sinusoid,
    SpatialAngleDriver,
    SpatialRevolute,
    Spherical,
    Status,
    Table,
)
from refkin.fast import attempt, sweep
from refkin.fast.answer import by_all_rows
from refkin.fast.elimination import run
from refkin.fast.prepare import Prepared, prepared
from refkin.proof.path import branch
from refkin.scenes.linkages import RSSR
from tests.linkages import remade, system_of, with_estimates, without_estimates

from .linkworks import chain
from .scenes import ROCKER, SCENES, bare

module = importlib.import_module("refkin.fast.sweep")
answer = importlib.import_module("refkin.fast.answer")
FAST = "refkin.fast"
U = 2.0**-53


def proved(scene):
    return replace(scene, evidence=frozenset({Evidence.CERTIFICATE}))


@pytest.mark.parametrize("name", SCENES)
def test_the_proved_error_of_every_pose_is_a_few_round_offs_times_the_condition(name):
    """Radii are proved by the formulas a person reads, about poses and rates that the program made."""
    motion, system = sweep(proved(SCENES[name])), system_of(SCENES[name])
    q = system.to_unit(refkin.solve(bare(SCENES[name])).q) if system.n == system.of_bodies else None
    allowed = 64 * U * np.max(np.abs(motion.q), initial=1.0)
    if q is not None:
        inverse = np.linalg.inv(np.moveaxis(system.phi_q(q, motion.t), -1, 0))
        allowed = allowed * np.max(np.sum(np.abs(inverse), axis=2), axis=1)

    assert motion.producer.name == FAST
    assert motion.verdict is Status.OK
    assert np.all(motion.certified_radius.position <= allowed)
    assert np.isfinite(motion.certified_radius.velocity).all()
    assert np.isfinite(motion.certified_radius.acceleration).all()


@pytest.mark.parametrize("name", SCENES)
def test_a_sweep_is_within_the_budget_of_the_reference(name):
    motion = sweep(SCENES[name])
    comparison = compare(reference(SCENES[name]), motion)

    assert motion.producer.name == FAST
    assert comparison.compared == len(SCENES[name].times)
    assert {name: np.nanmax(q.ratio) for name, q in comparison.quantities.items() if not q.agrees} == {}


@settings(max_examples=100)
@given(drawn_scenes(hardness=[Hardness.REGULAR]))
def test_regular_scenes_are_answered_within_the_budget(drawn):
    motion = sweep(bare(drawn.scene))
    comparison = compare(reference(drawn.scene), motion, RefkinBatch().terms(drawn.scene))

    assert motion.producer.name == FAST
    assert motion.verdict is Status.OK
    assert {name: q.worst for name, q in comparison.quantities.items() if not q.agrees} == {}


def off_closed_form(drawn, motion):
    """How far answered poses are from the closed form [sizes, rad], (n, T)."""
    bodies = drawn.scene.mechanism.bodies
    pose = np.array([[x for b in bodies for x in drawn.pose(t)[b.name]] for t in drawn.scene.times]).T
    off = (motion.q - pose) / drawn.scene.mechanism.size()
    off[2::3] = np.angle(np.exp(1j * (motion.q[2::3] - pose[2::3])))
    return np.abs(off[:, [s is Status.OK for s in motion.status]])


@settings(max_examples=20)
@given(drawn_scenes(hardness=[Hardness.LIMIT, Hardness.CHANGE_POINT]))
def test_hard_scenes_are_never_answered_wrong(drawn):
    """Near limit positions and change points: on the branch of the reference within its budget, or left to it."""
    motion = sweep(drawn.scene)
    comparison = compare(reference(drawn.scene), motion)

    assert comparison.missing == 0
    assert comparison.agrees
    assert not comparison.other_assembly


@settings(max_examples=80)
@pytest.mark.parametrize("evidence", [(), (Evidence.CERTIFICATE,)])
@given(drawn_scenes(hardness=[Hardness.LIMIT, Hardness.CHANGE_POINT]))
def test_hard_scenes_stay_on_the_branch_of_the_closed_form(evidence, drawn):
    motion = sweep(replace(drawn.scene, evidence=frozenset(evidence)))

    # Where the branches are 1e-5 apart, the closed form is itself no better than the root of round-off.
    assert np.max(off_closed_form(drawn, motion), initial=0.0) < 1e-7


def driven(linkage, law, times, driven="crank", relative_to="ground", branch="open"):
    """A scene whose law may lead where the linkage cannot follow."""
    start = Polynomial(coefficients=(float(law(times[0])),))
    scene = linkage.scene(law=start, times=times[:1], driven=driven, relative_to=relative_to, branch=branch)
    mechanism = replace(scene.mechanism, drivers=(linkage.driver(law, driven, relative_to),))
    return bare(replace(scene, mechanism=mechanism), times=tuple(times))


@pytest.mark.parametrize("samples", [9, 37, 101, 1001])
def test_a_crossing_of_branches_is_not_passed(samples):
    """At an exact change point the branches cross: on one of them the sign of the determinant never changes."""
    law = Sinusoid(amplitude=-math.pi, angular_frequency=2.9573709059898547, offset=-0.49622333722343726)
    linkage = InvertedSliderCrank(ground=3.0, crank=4.0, offset=1.0)
    scene = driven(linkage, law, np.linspace(0.0, 1.0, samples).tolist(), "lever", "crank", "crossed")

    assert module.attempt(scene) is None


@pytest.mark.parametrize("slack", [1e-3, 1e-6, 1e-8])
def test_near_a_change_point_the_branch_is_kept(slack):
    """The branches come within the root of the slack of each other; the closed form knows them apart."""
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + slack)
    motion = sweep(bare(linkage.scene(turns=1, samples=361)))
    expected = [linkage.assemble(phi, "open")["rocker"][2] for phi in motion["crank"].phi]
    off = np.abs(np.angle(np.exp(1j * (motion["rocker"].phi - expected))))

    assert motion.verdict is Status.OK
    assert np.max(off) < 1e-15 / slack**0.5 + 1e-13


@pytest.mark.parametrize("times", [(0.0,), (0.0, 1.0), (0.0, 0.1, 0.11, 2.0), tuple(np.linspace(0, 40, 33).tolist())])
def test_few_and_uneven_times_are_answered_as_well(times):
    """The last of them are more than a turn of the crank apart."""
    scene = bare(ROCKER.scene(law=Polynomial(coefficients=(0.3, 2.0, 0.1)), times=times))
    motion = sweep(scene)

    assert motion.producer.name == FAST
    assert np.max(np.abs(motion.q - refkin.solve(scene).q)) < 1e-13


def test_more_times_than_a_block_has_samples(monkeypatch):
    monkeypatch.setattr(run, "MOST_SAMPLES", 256)
    scene = bare(ROCKER.scene(samples=1001))
    blocks = sweep(scene)
    monkeypatch.undo()

    assert np.array_equal(blocks.q, sweep(scene).q)
    assert np.array_equal(blocks.qdd, sweep(scene).qdd)


def test_a_table_as_law_and_an_open_profile():
    law = Table(argument=(0.0, 1.0, 2.0, 3.0, 5.0), value=(0.2, 1.0, 1.2, 2.5, 3.0))
    scene = bare(ROCKER.scene(law=law, times=tuple(np.linspace(0.0, 5.0, 101).tolist())))
    motion = sweep(scene)

    assert motion.producer.name == FAST
    assert compare(reference(scene), motion).agrees


def test_an_estimate_in_another_turn_is_followed_as_by_the_reference():
    scene, further = bare(ROCKER.scene(samples=20)), {"rocker": 4 * math.pi}
    scene = with_estimates(scene, lambda b: (*b.estimate[:2], b.estimate[2] + further.get(b.name, 0.0)))

    assert np.max(np.abs(sweep(scene).q - refkin.solve(scene).q)) < 1e-14


@pytest.mark.parametrize("kept", ["", "crank"])
def test_without_all_estimates_an_assembly_is_searched_and_told(kept):
    scene = without_estimates(bare(ROCKER.scene(samples=20)), kept)
    motion, ref = sweep(scene), refkin.solve(scene)

    assert motion.producer.name == FAST
    assert motion.message == ref.message
    assert np.max(np.abs(motion.q - ref.q)) < 1e-14


@pytest.mark.parametrize("off", [0.3, 0.8, 1.5])
def test_a_rough_estimate_leads_to_the_same_assembly(off):
    scene = bare(ROCKER.scene(samples=20))
    for direction in range(8):
        move = iter(off * np.cos(direction + np.arange(9.0)))
        rough = with_estimates(scene, lambda b, move=move: tuple(x + float(next(move)) for x in b.estimate))
        motion, ref = sweep(rough), refkin.solve(rough)

        assert motion.status == ref.status
        assert np.nanmax(np.abs(motion.q - ref.q)) < 1e-13


def test_redundant_rows_are_left_out_and_held_to_account():
    """A crank with two pins on the same pivot: two rows more than coordinates, which agree, or do not."""
    scene = bare(ROCKER.scene(samples=30))
    again = Revolute(name="again", body_i="ground", point_i=(0.0, 0.0), body_j="crank", point_j=(-0.5, 0.0))
    apart = replace(again, point_i=(1e-6, 0.0))
    doubled, broken = (remade(scene, joints=(*scene.mechanism.joints, joint)) for joint in (again, apart))

    assert sweep(doubled).producer.name == FAST
    assert np.max(np.abs(sweep(doubled).q - sweep(scene).q)) < 1e-14
    assert sweep(broken).verdict is refkin.solve(broken).verdict is Status.UNASSEMBLABLE


def test_a_proof_of_redundant_rows_is_given_up_where_the_reference_is_faster(monkeypatch):
    """At a gimbal it took 33 s, and came to nothing; the reference takes half a second."""
    most, made = [], branch.ConnectionProof
    monkeypatch.setattr(branch, "ConnectionProof", lambda *given: most.append(given[1]) or made(*given))
    crank = ROCKER.scene(samples=30)
    again = replace(crank.mechanism.joints[0], name="again")

    assert attempt(remade(bare(crank), joints=(*crank.mechanism.joints, again))) is not None
    assert most == [branch.FEW_TUBES]


def nearly_a_parallelogram(times):
    """Three hinges and a ball, by 22 rows for 21 coordinates: at half a turn of the crank the pins are out of reach."""
    ground, size = 2.0002, 4.0
    x, z, o, at = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 1.0
    a = np.array([math.cos(at), math.sin(at)])
    way = np.array([ground, 0.0]) - a
    r = float(np.hypot(*way))
    turn = math.atan2(way[1], way[0]) + math.acos((r * r + size - 1.0) / (4.0 * r))
    b = a + 2.0 * np.array([math.cos(turn), math.sin(turn)])

    def body(name, place, angle):
        return Body(name=name, estimate=(*place, 0.0, math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)))

    def hinge(name, i, point_i, j, **more):
        return SpatialRevolute(name=name, body_i=i, point_i=point_i, axis_i=z, body_j=j, point_j=o, axis_j=z, **more)

    bodies = (
        body("crank", (0.0, 0.0), at),
        body("coupler", a, turn),
        body("rocker", (ground, 0.0), math.atan2(b[1], b[0] - ground)),
    )
    joints = (
        hinge("O", "ground", o, "crank", zero_i=x, zero_j=x),
        hinge("A", "crank", x, "coupler"),
        Spherical(name="B", body_i="coupler", point_i=(2.0, 0.0, 0.0), body_j="rocker", point_j=x),
        hinge("D", "ground", (ground, 0.0, 0.0), "rocker"),
    )
    law = Polynomial(coefficients=(at, -math.tau))
    mechanism = Mechanism(bodies, joints, (SpatialAngleDriver(name="m", joint="O", law=law),))
    return Scene(mechanism=mechanism, times=tuple(np.linspace(0.0, 1.0, times).tolist()))


@pytest.mark.parametrize("times", [2, 20, 128, 361])
def test_redundant_rows_lead_over_no_gap_though_their_determinant_keeps_its_sign(times):
    """It was called ok beyond, on the other assembly, with a radius of 8e-17."""
    assert attempt(nearly_a_parallelogram(times)) is None
    assert sweep(nearly_a_parallelogram(min(times, 20))).status[-1] is not Status.OK


def test_a_scene_that_is_prepared_is_told_in_a_few_lines():
    """Expressions were written as trees, which for space took longer than a minute."""
    assert len(repr(prepared(refkin.load("examples/rssr.toml")))) < 2_000_000


def redundant_loop():
    """A Bennett linkage, and its answer by the reference in scaled coordinates."""
    scene = bare(refkin.load("tests/corpus/space-bennett-by-the-program.toml"))
    system, motion = system_of(scene), refkin.solve(scene)
    return system, [system.to_unit(level, order) for order, level in enumerate(motion.levels)], motion.t


@pytest.mark.parametrize("level", [0, 1, 2])
def test_what_is_lost_is_brought_back_by_all_rows_and_samples_that_have_lost_nothing_stay(level):
    """To what rounding leaves in all rows by the least singular value, 0.2; a thousand times that is planted."""
    system, exact, t = redundant_loop()
    given = [x.copy() for x in exact]
    given[level][:, 5] += 1e-10 * np.cos(np.arange(system.n)) * np.max(np.abs(exact[level][:, 5]))
    better = by_all_rows(system, [x.copy() for x in given], t)
    for now, then, right in zip(better, given, exact, strict=True):
        off = np.max(np.abs(now - right), axis=0) / np.max(np.abs(right), axis=0)
        assert off[5] < 1e-13
        assert np.array_equal(np.delete(now, 5, axis=1), np.delete(then, 5, axis=1))


def test_no_rows_close_numbers_that_are_not_finite():
    system, exact, t = redundant_loop()
    for level in range(3):
        levels = [x.copy() for x in exact]
        levels[level][3, 7] = np.nan
        assert by_all_rows(system, levels, t) is None


@pytest.mark.parametrize("name", ["unassemblable-but-assembled", "unassemblable-acceleration-only"])
def test_rows_that_contradict_each_other_in_a_rate_are_no_answer_of_the_program_without_a_proof_either(name):
    scene = bare(refkin.load(f"tests/corpus/{name}.toml"))

    assert attempt(scene) is None
    assert sweep(scene).verdict is Status.LOCKED
    assert attempt(replace(scene, effects=frozenset())) is not None


def test_effects_bodies_and_points_are_reported_as_by_the_reference():
    point = Point(name="P", body="coupler", position=(0.3, 0.2))
    for effects in ((), (Effect.VELOCITY,), (Effect.ACCELERATION,), tuple(Effect)):
        scene = bare(ROCKER.scene(samples=15), effects=frozenset(effects), bodies_wanted=("rocker",), points=(point,))
        motion, ref = sweep(scene), refkin.solve(scene)

        assert motion.bodies == ("rocker",)
        for ours, theirs in (
            *zip(motion.levels, ref.levels, strict=True),
            *((getattr(motion.points["P"], k), getattr(ref.points["P"], k)) for k in "rva"),
        ):
            assert (ours is None) == (theirs is None)
            assert ours is None or np.max(np.abs(ours - theirs)) < 1e-13


def test_contacts_are_reported_as_by_the_reference():
    scene = SCENES["roller over lobes"]
    ours, theirs = sweep(scene).contacts["contact"], refkin.solve(scene).contacts["contact"]

    for key in ("s", "sd", "sdd"):
        assert np.max(np.abs(getattr(ours, key) - getattr(theirs, key))) < 1e-13


def test_without_what_nobody_wants_the_rest_is_the_same():
    scene = bare(chain(4), bodies_wanted=("rocker2",))

    assert sweep(scene).producer.name == FAST
    assert np.max(np.abs(sweep(scene).q - refkin.solve(scene).q)) < 1e-14


def test_evidence_is_that_of_the_reference():
    scene = ROCKER.scene(samples=40)
    motion, ref = sweep(scene), refkin.solve(scene)

    assert motion.producer.name == FAST
    for name in ("sigma_min", "condition"):
        assert np.allclose(getattr(motion, name), getattr(ref, name), rtol=1e-12)
    radius = motion.certified_radius.position + ref.certified_radius.position
    system = system_of(scene)
    assert np.all(np.max(np.abs(system.to_unit(motion.q) - system.to_unit(ref.q)), axis=0) <= radius)


@pytest.mark.parametrize(("level", "off", "first"), [(0, 0.0, 0), (0, 1e-12, 0), (0, 1e-12, 4), (1, np.nan, 4)])
def test_a_pose_whose_loops_are_open_is_no_answer(level, off, first):
    """However fast it goes, if one of many is, nor one without rates; those near a singular pose are solved anew."""
    scene = bare(ROCKER.scene(speed=1e4, samples=5))
    ready, by_reference = prepared(scene), refkin.solve(scene)
    levels = [ready.system.to_unit(level, order) for order, level in enumerate(by_reference.levels)]
    levels[level][4, first:] += off
    levels[1][:, 3] += 1.0
    result = answer.motion(ready, levels, np.array([np.inf, 1.0, 1.0, 1e-4, 1.0]))

    assert (result is None) is bool(off)
    assert result is None or result.qd == pytest.approx(by_reference.qd, rel=1e-9, abs=1e-9)


def test_a_singular_pose_among_regular_ones_is_not_answered_without_a_proof():
    """A parallelogram, flat at the second of two times."""
    linkage = FourBar(ground=3.0, crank=1.0, coupler=3.0, rocker=1.0)
    scene = bare(linkage.scene(start=0.5, turns=0.01, samples=2))
    system = system_of(scene)
    poses = [np.concatenate([linkage.assemble(angle)[b.name] for b in scene.mechanism.bodies]) for angle in (0.5, 0.0)]
    q = np.array([system.to_unit(pose) for pose in poses]).T
    first, both = (Prepared(replace(scene, times=scene.times[:count]), system, None) for count in (1, 2))

    assert answer._evidence(first, [q[:, :1]], np.arange(1)) is not None
    assert answer._evidence(both, [q], np.arange(2)) is None


LOST = math.tau * 2e8
"""So far numbers have 2e-7 left: more than what a pose is called singular by [rad]."""


@pytest.mark.parametrize(("late", "off"), [(LOST, 0.0), (0.0, LOST)], ids=["of a law", "of a coordinate"])
def test_where_numbers_have_no_digits_it_is_left_to_the_reference(late, off):
    """A law that adds up large numbers to a small one; an estimate off by so many turns."""
    scene = bare(ROCKER.scene(law=Polynomial(coefficients=(0.3 - late, 1.0)), times=(late,)))
    further = {"coupler": off}

    assert attempt(with_estimates(scene, lambda b: (*b.estimate[:2], b.estimate[2] + further.get(b.name, 0.0)))) is None


# Planted faults. Each replaces code that a sweep runs.


def mirrored(space):
    """Newton that leaves some samples on the other branch: B of the four-bar mirrored at the line from A to B0."""
    ok = module_newton(space)
    crank = next(
        space.row(at.number) for leaf, at in space.program.inputs.items() if (leaf.kind, leaf.place[-1]) == LAW
    )
    for sample in range(0, space.samples, 7):
        other = ROCKER.assemble(float(crank[sample]), "crossed")
        for row, body in zip(space.core(), ("coupler", "rocker"), strict=True):
            row[sample] = other[body][2]
    return ok


module_newton = module.newton
LAW = "f", 0
"""What a law's value is among the inputs of a program, of which its place says the order last."""


def test_samples_on_the_other_branch_are_noticed_though_their_residual_is_round_off(monkeypatch):
    """With continuity and signs skipped they are answered: only the comparison with the reference sees them then."""
    scene = bare(ROCKER.scene(samples=200))
    monkeypatch.setattr(module, "newton", mirrored)

    assert module.attempt(scene) is None

    monkeypatch.setattr(module._Task, "_on_branch", lambda task, space, guess: np.ones(space.samples, bool))
    motion = module.attempt(scene)

    assert motion is not None
    assert motion.verdict is Status.OK
    assert not compare(reference(scene), motion).agrees


@pytest.fixture
def attempted_wrongly(monkeypatch):
    """What is answered of a scene where an instruction is off by 1e-9."""
    forget = importlib.import_module("refkin.fast.compiled").forget

    def attempted(scene, name):
        right = run.FUNCTIONS[name]

        def wrong(*numbers):
            right(*numbers)
            numbers[-1][...] += 1e-9

        monkeypatch.setitem(run.FUNCTIONS, name, wrong)
        return module.attempt(scene)

    forget()
    yield attempted
    forget()


def test_a_wrong_instruction_is_noticed(attempted_wrongly):
    """Every subtraction of the answer that makes a coordinate of the coupler is off."""
    assert attempted_wrongly(bare(ROCKER.scene(samples=50)), "sub") is None


def test_with_the_verification_skipped_a_wrong_instruction_is_answered(monkeypatch, attempted_wrongly):
    """Then the comparison with the reference goes red: the angle of the crank and its rates are copied from the law."""
    scene = bare(ROCKER.scene(samples=50))
    monkeypatch.setattr(answer, "is_round_off", lambda residual, q: np.array(True))
    motion = attempted_wrongly(scene, "copy")

    assert motion is not None
    assert not compare(reference(scene), motion).agrees


@pytest.mark.parametrize("stage", ["_start", "_marched", "_samples"])
def test_whatever_fails_the_reference_answers(monkeypatch, stage):
    scene = bare(ROCKER.scene(samples=20))
    monkeypatch.setattr(module._Task, stage, lambda *_: None)
    motion = sweep(scene)

    assert motion.producer.name == "refkin"
    assert np.array_equal(motion.q, refkin.solve(scene).q)


def test_a_far_guess_is_made_again_from_nearer(monkeypatch):
    """Marched in steps that are much too long for the quintic: the poses between are marched, too."""
    march = importlib.import_module("refkin.fast.march")
    scene = bare(ROCKER.scene(samples=300))
    monkeypatch.setattr(march, "FAR", 1e3)
    monkeypatch.setattr(module, "CONTINUOUS", 1e-5)
    quartered = []
    quarter = module.Guesses.quarter
    monkeypatch.setattr(module.Guesses, "quarter", lambda *args: quartered.append(1) or quarter(*args))
    motion = module.attempt(scene)

    assert quartered
    assert motion is not None
    assert compare(reference(scene), motion).agrees


@pytest.mark.parametrize("turns", [10.0, 1e4, 1e6])
def test_after_many_turns_the_answer_is_still_that_of_the_reference(turns):
    """The angle keeps its turns, and its spacing is what the answer may be off by."""
    law = Polynomial(coefficients=(turns * math.tau, 1.0))
    scene = bare(ROCKER.scene(law=law, times=tuple(np.linspace(0.0, 3.0, 40).tolist())))
    motion, ref = sweep(scene), refkin.solve(scene)

    assert motion.producer.name == FAST
    assert np.max(np.abs(motion.q - ref.q)) <= 8 * np.spacing(turns * math.tau)


@pytest.mark.parametrize(("second", "taken"), [(0.012, True), (0.013, False)])
@pytest.mark.parametrize(("e", "more"), [(0.1, (1e-9,)), (1e-5, ())])
def test_an_estimate_decides_only_where_newton_says_that_the_other_solution_is_eight_times_further(
    second, taken, e, more
):
    """Corrections of e and then of e^2 / s tell how far s the other is; the furthest coordinate is off by 0.1."""
    answer = SimpleNamespace(levels=[(0.2, 0.0, e)], steps=(e, 100.0 * e * e * second, *more))
    task = SimpleNamespace(
        scene=SimpleNamespace(mechanism=SimpleNamespace(bodies=[Body(name="b", estimate=(0.1, 0.0, 0.0))])),
        system=SimpleNamespace(n=3, of_bodies=3, to_unit=np.array),
        made=SimpleNamespace(core=[2]),
        _first=lambda core: answer,
    )
    q = module._Task._near_estimate(task)

    assert (q is not None) is taken


@pytest.mark.parametrize(
    ("steps", "taken"), [((), True), ((1e-3, 1e-7, 1e-12), True), ((1e-3, 1e-7), False), ((1e-3, 2e-3, 1e-12), False)]
)
def test_a_near_estimate_is_taken_if_newton_contracts_from_it_and_ends_at_round_off(steps, taken):
    """What is near is asked nothing else; from a root itself there is no step."""
    q = np.zeros(3)
    system = SimpleNamespace(n=3, of_bodies=3, to_unit=np.array)
    scene = SimpleNamespace(mechanism=SimpleNamespace(bodies=[Body(name="bar", estimate=(0.0, 0.0, 0.0))]))
    task = SimpleNamespace(system=system, scene=scene, made=SimpleNamespace(core=[2]))
    task._first = lambda _: SimpleNamespace(levels=[q], steps=steps)

    assert (module._Task._near_estimate(task) is not None) is taken


@pytest.mark.parametrize("levels", [1, 2, 3])
@pytest.mark.parametrize(
    ("linkage", "near"),
    [(ROCKER, []), (ROCKER, [1, 3]), (RSSR(1.0, 3.0, 2.0, (2.5, -0.5, 0.75), (0.25, 1.0, 0.125)), [1, 3])],
)
def test_near_a_singular_pose_rates_are_solved_anew_and_elsewhere_they_stay(levels, linkage, near):
    """Those of a passive body are without spin at the pose that it has."""
    scene = linkage.scene(samples=5)
    system = refkin.compile_system(scene.mechanism, unit=scene.mechanism.unit())
    right, t = [system.to_unit(level, k) for k, level in enumerate(refkin.solve(scene).levels)], np.array(scene.times)
    off = [x + (order > 0) * (np.arange(5) % 2) for order, x in enumerate(right[:levels])]
    corrected = answer._by_pivots(system, [x.copy() for x in off], t, np.array(near, int))

    for level, x, y in zip(corrected, right, off, strict=False):
        assert level == pytest.approx(np.where(np.isin(np.arange(5), near), x, y), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(("pivots", "smallest"), [((0.5, 1e-4, 0.3), 1e-4), ((), math.inf)])
@pytest.mark.parametrize("accepted", [True, False])
def test_of_a_single_time_the_smallest_pivot_counts(pivots, smallest, accepted):
    found = SimpleNamespace(levels=[[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], pivots=pivots)
    march, made = SimpleNamespace(accepts=lambda given: accepted and given is found), SimpleNamespace(levels=2)
    task = SimpleNamespace(_first={7.0: found}.get, march=march, made=made)
    said = importlib.import_module("refkin.fast.sweep")._Task._alone(task, SimpleNamespace(levels=[7.0]))

    assert (said is not None) is accepted
    assert not said or ([level.tolist() for level in said[0]], *said[1]) == ([[[1.0], [2.0]], [[3.0], [4.0]]], smallest)


@pytest.mark.parametrize("doubt", [{}, {"ok": [True, False]}, {"bits": [53, 113]}, {"contradiction": [0.0, 1.5]}])
def test_there_are_no_radii_if_float64_does_not_prove_every_sample(monkeypatch, doubt):
    ready, levels = (
        prepared(ROCKER.scene(samples=2)),
        dict.fromkeys(("position", "velocity", "acceleration"), np.zeros(2)),
    )
    proof = {"ok": [True, True], "bits": [53, 53], "contradiction": [0.0, 1.0], **levels, **doubt}
    proof = SimpleNamespace(why="", **{name: np.array(value) for name, value in proof.items()})
    monkeypatch.setattr(answer, "radii", lambda *_: None)
    monkeypatch.setattr(answer, "isolate_every_choice", lambda *_: proof)
    some = [np.zeros((ready.system.n, 2))] * 3

    assert (answer._certified(ready.system, ready.made, some, np.arange(2.0)) is None) is bool(doubt)
