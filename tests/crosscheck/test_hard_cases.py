"""Hard cases: the scenes come as near as they say, the arbiter is fair, and planted faults are called what they are."""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import refkin
from crosscheck.engines import EngineError
from crosscheck.engines.loading import load
from crosscheck.judge.hard_poses import GRANTED, PoseSample, least_error, residual_error, samples, truths
from crosscheck.judge.known_gaps import Finding, HardOutcome, unexplained
from crosscheck.measure import hard_table
from crosscheck.measure.hard_table import classed, hard_case_rows, outcome_of
from crosscheck.scenes.hard import KINDS, hard_cases
from crosscheck.scenes.hard_case import DISTANCES, GAPS, REACH
from crosscheck.workers.processes import Failure, FailureKind
from refkin.motion import Status
from refkin.proof.pose.krawczyk import Judgement, Verdict, krawczyk

ENGINES = Path(__file__).parent / "hard_engines.py"
CASES = {case.key: case for case in hard_cases()}
EASY = CASES["large offset, 1e-02"]
TOGGLES = [case for case in CASES.values() if case.case == "toggle"]


def planted(name: str, seconds: float = 20.0, cases=(EASY,)):
    return hard_case_rows([f"{ENGINES}:{name}"], cases=cases, findings=(), seconds=seconds)


@pytest.mark.parametrize(
    ("engine", "verdict", "told"),
    [
        ("Right", "correct", ""),
        ("Wrong", "wrong", "radii outside at t = "),
        ("Warns", "warned", "called not ok at 1 of 6 times"),
        ("Empty", "wrong", "called ok without a number"),
        ("Refuses", "refused", "refuses every scene"),
        ("Shapeless", "wrong", "expected a refkin.motion.Motion, got ndarray"),
        ("Raises", "crash", "error (ZeroDivisionError)"),
        ("Crashes", "crash", "SIGSEGV"),
    ],
)
def test_a_planted_fault_gets_its_verdict(engine, verdict, told):
    (row,) = planted(engine)

    assert (row["verdict"], told in row["note"]) == (verdict, True)


def test_a_planted_hang_is_called_one_and_the_next_case_is_tried():
    cases = [EASY, CASES["large offset, 1e-04"]]

    rows = planted("Hangs", seconds=1.0, cases=cases)

    assert [row["verdict"] for row in rows] == ["hang", "hang"]


def test_without_time_no_scene_is_begun():
    assert hard_case_rows([f"{ENGINES}:Right"], within=0.0) == []


def test_scenes_are_the_same_ones_every_time():
    assert [case.scene for case in hard_cases()] == [case.scene for case in CASES.values()]


def test_a_branching_tree_is_assembled_at_all_its_times():
    case = CASES["branching tree, 2e+01"]
    system, truth = truths(case)
    poses = [np.concatenate([case.poses(t)[b.name] for b in case.scene.mechanism.bodies]) for t in case.scene.times]

    residuals = [np.max(np.abs(system.phi(system.to_unit(q), t))) for q, t in zip(poses, case.scene.times, strict=True)]
    assert max(residuals) < 1e-14
    assert all(len(true.roots) == 1 for true in truth)


def test_every_kind_has_its_scenes_and_no_two_have_one_name():
    assert len(CASES) == sum(len(distances) for distances, _ in KINDS.values()) > 50


@pytest.mark.parametrize("case", TOGGLES, ids=lambda case: case.key)
def test_sigma_goes_with_the_root_of_the_distance_to_a_toggle(case):
    sigma = refkin.solve(case.scene).sigma_min[-1]

    # At 1e-15 the limit itself is known to 2e-16 only, a fifth of the distance.
    assert sigma == pytest.approx(0.33 * np.sqrt(case.distance), rel=0.15, abs=0.0)


@pytest.mark.parametrize("gap", GAPS)
@pytest.mark.parametrize("where", ["", "in space "])
def test_a_gap_is_proved_and_is_the_one_that_was_made(where, gap):
    system, (truth,) = truths(CASES[f"unassemblable {where}by a gap, {gap:.0e}"])
    made = REACH + gap - REACH if where else gap
    spread = 16 * 2.0**-50 if where else 0.0  # some numbers of the size, and what proofs spread each by in space

    assert not truth.roots
    assert truth.gap == pytest.approx(made / system.unit.size, rel=1e-4 if where else 1e-3, abs=spread)


@pytest.mark.parametrize(("key", "row"), [*((case.key, 2) for case in TOGGLES), ("limit of an RSSR, 1e-09", 10)])
def test_two_least_errors_off_is_wrong_and_half_of_one_is_not(key, row):
    case = CASES[key]
    system, truth = truths(case)
    motion = refkin.solve(case.scene)
    for factor, verdict in ((0.5, HardOutcome.CORRECT), (2.0, HardOutcome.WRONG)):
        q = motion.q.copy()
        balls, allowed = truth[-1].roots[0]
        q[:, -1] = system.to_physical(np.array([float(x) for x in balls]))
        q[row, -1] += factor * allowed[row]
        poses = samples(system, truth, case.scene, replace(motion, q=q), ())
        assert classed(poses)[0] == verdict


def test_times_at_which_nothing_is_decided_are_counted_and_held_against_nobody():
    inside, open_ = (Judgement(verdict, 0.5) for verdict in (Verdict.INSIDE, Verdict.UNDECIDABLE))
    poses = [PoseSample(t, judged, True) for t, judged in enumerate((inside, open_, inside))]

    assert classed(poses) == (HardOutcome.CORRECT, "undecidable at 1 of 3 times")
    assert classed(poses[:1]) == (HardOutcome.CORRECT, "")


def test_a_pose_that_lacks_one_number_is_no_pose():
    case = TOGGLES[0]
    system, truth = truths(case)
    motion = refkin.solve(case.scene)
    q = motion.q.copy()
    q[4, -1] = np.nan
    *before, last = samples(system, truth, case.scene, replace(motion, q=q), ())

    assert last.judgement is None
    assert last.note == "called ok without a number"
    assert all(s.judgement is not None for s in before)


@pytest.mark.parametrize("kind", ["toggle", "dead centre"])
def test_what_newton_leaves_in_float64_is_attainable_down_to_the_fold(kind):
    worst = 0.0
    for case in (c for c in CASES.values() if c.case == kind):
        system, truth = truths(case)
        poses = samples(system, truth, case.scene, refkin.solve(case.scene), ())
        worst = max(worst, *(s.judgement.radii for s in poses))

    assert 1e-3 < worst < 1.0


def test_the_least_error_covers_every_pose_with_a_residual_of_round_off():
    case = CASES["toggle, 1e-09"]
    system, truth = truths(case)
    t, (balls, allowed) = case.scene.times[-1], truth[-1].roots[0]
    q = np.array([float(x) for x in balls])
    e = residual_error(system, q, t)
    draw = np.random.default_rng(1)
    inside = 0
    for _ in range(400):
        # a Newton step for a residual that is moved by up to e: the pose that a code with that rounding may find
        moved = q.copy()
        shift = draw.uniform(-1.0, 1.0, system.m) * e
        for _ in range(30):
            moved = moved - np.linalg.solve(system.phi_q(moved, t), system.phi(moved, t) - shift)
        inside += bool(np.all(np.abs(moved - q) <= allowed))

    assert inside == 400


def test_the_poses_in_which_scenes_begin_are_regular_enough_for_what_is_granted():
    norms = []
    for case in CASES.values():
        if len(case.scene.times) > 1 and not case.case.startswith("branching"):
            system, truth = truths(replace(case, scene=replace(case.scene, times=case.scene.times[:1])))
            q = np.array([float(x) for x in truth[0].roots[0][0]])
            norms.append(np.linalg.norm(np.linalg.pinv(system.phi_q(q, case.scene.times[0])), 2))

    assert max(norms) < GRANTED


@pytest.mark.parametrize("distance", DISTANCES)
def test_the_truth_beside_a_fold_is_on_the_branch_of_the_first_time(distance):
    case = CASES[f"toggle, {distance:.0e}"]
    system, truth = truths(case)
    sides = []
    for t, true in zip(case.scene.times, truth, strict=True):
        balls, _ = true.roots[0]
        sides.append(np.sign(np.linalg.det(system.phi_q(np.array([float(x) for x in balls]), t))))

    assert len(set(sides)) == 1


def test_another_assembly_is_told_as_one():
    case = CASES["coarse steps, 1e+00"]
    system, truth = truths(case)
    motion = refkin.solve(case.scene)
    linkage = refkin.FourBar(ground=4.0, crank=1.0, coupler=3.99, rocker=1.02)
    other = linkage.assemble(case.scene.times[-1], "crossed")
    q = motion.q.copy()
    q[:, -1] = np.concatenate([other[body] for body in motion.bodies])

    poses = samples(system, truth, case.scene, replace(motion, q=q), ())

    assert (poses[-1].judgement.verdict, poses[-1].note) == (Verdict.OUTSIDE, "on the other assembly")


def test_full_turns_are_no_error():
    system, truth = truths(EASY)
    motion = refkin.solve(EASY.scene)
    q = motion.q.copy()
    q[2::3] += 2 * np.pi

    poses = samples(system, truth, EASY.scene, replace(motion, q=q), ())
    assert classed(poses)[0] == HardOutcome.CORRECT
    assert {pose.note for pose in poses} == {""}


def test_an_answer_where_there_is_no_assembly_is_wrong_and_no_answer_is_right():
    case = CASES["unassemblable by a gap, 1e-09"]
    system, truth = truths(case)
    motion = refkin.solve(case.scene)
    answered = replace(motion, q=np.zeros_like(motion.q), status=(Status.OK,))

    assert classed(samples(system, truth, case.scene, answered, ()))[0] == HardOutcome.WRONG
    outcome, note = classed(samples(system, truth, case.scene, motion, ()))
    assert (outcome, note.startswith("rightly, there is no assembly")) == (HardOutcome.REFUSED, True)


def test_the_reference_is_nowhere_wrong():
    outcomes = {key: outcome_of(("refkin", "solve", "", key))[0] for key in CASES if "branching" not in key}

    assert {key for key, outcome in outcomes.items() if outcome == HardOutcome.WRONG} == set()


def test_the_enclosure_is_the_certificate_of_113_bits():
    system, truth = truths(EASY)
    balls, _ = truth[0].roots[0]
    enclosure = krawczyk(system, np.array([float(x) for x in balls]), EASY.scene.times[0])

    assert enclosure is not None
    assert enclosure.bits == 113
    assert all(x.overlaps(y) for x, y in zip(balls, enclosure.q, strict=True))


def test_the_least_error_is_near_round_off_at_a_regular_pose():
    system, truth = truths(EASY)
    q = np.array([float(x) for x in truth[0].roots[0][0]])

    assert 1e-15 < np.max(least_error(system, q, EASY.scene.times[0])[system.angles]) < 1e-12


@pytest.mark.parametrize("engine", ["mujoco", "pinocchio"])
@pytest.mark.parametrize("case", [case for case in CASES.values() if case.case.startswith("isosceles")])
def test_a_pose_next_to_two_branches_that_cross_is_singular_and_not_missing(engine, case):
    """Within a root of rounding of their crossing the sign of the determinant is rounding, and says nothing."""
    value = load(engine).solve(case.scene).status

    assert set(value) <= {Status.OK, Status.SINGULAR}
    assert list(value) == sorted(value, key=lambda status: status is Status.SINGULAR)


METHODS = {"a": [("a", "newton", ""), ("a", "steps", "1e-3")], "b": [("b", "newton", "")]}
FATES = {"newton": ("correct", "well"), "steps": Failure(FailureKind.HANG, "no answer within 3 s")}
SAID = Finding(
    engine="a", method="steps", cases=("large offset",), verdict="hang", kind="documented limit",
    quote="it may take long", source="its manual", reason="", since="", date=datetime.date(2026, 11, 22), script="a.py",
)  # fmt: skip


@pytest.fixture
def table(monkeypatch):
    """The table of two engines made up; of one method the answer never comes, of cases of space its end is told.

    At a kite the process that they share fails, whoever is asked.
    """
    asked, alone = [], []

    def fate(name, key):
        return Failure(FailureKind.CRASH, "SIGSEGV", "SIGSEGV") if "RSSR" in key else FATES[name]

    def in_turn(function, jobs, seconds, count):
        for job in jobs:
            asked.append((*job, seconds))
            yield Failure(FailureKind.ERROR, "its neighbour's doing", "") if "kite" in job[3] else fate(job[1], job[3])

    def by_itself(function, arguments, *seconds):
        if function is hard_table.listed:
            return [METHODS.get(spec, LACKING) for spec in arguments]
        alone.extend((*job, *seconds) for job in arguments)
        return [fate(name, key) for _, name, _, key in arguments]

    monkeypatch.setattr(hard_table, "call_each", by_itself)
    monkeypatch.setattr(hard_table, "call_in_turn", in_turn)
    return lambda *some, **more: (hard_case_rows(*some, findings=[SAID], **more), asked, alone)


LACKING = EngineError("no engine is called 'c'")


def test_every_method_is_asked_every_case_and_its_row_says_what_came_of_it(table):
    some, told = list(CASES.values()), []
    rows, asked, alone = table(["a", "b"], seconds=3.0, tell=lambda *words: told.append(words))
    every = [key for of_engine in METHODS.values() for key in of_engine]
    crashed = [case for case in some if "RSSR" in case.key]

    assert [(r["engine"], r["method"], r["setting"], r["case"], r["distance"]) for r in rows] == [
        (*key, case.case, case.distance) for case in some for key in every
    ]
    assert sorted(asked) == sorted((*key, case.key, 3.0) for case in some for key in every)
    failed = [job for job in asked if "RSSR" in job[3] or "kite" in job[3] or job[1] == "steps"]
    assert sorted(alone) == sorted(failed)
    assert [done for done, _ in told] == list(range(len(some)))
    kinds = [CASES[key].case for _, key in told]
    assert set(kinds[: len(set(kinds))]) == set(kinds)  # the first of every kind come first
    for row, (_, name, _), case in zip(rows, every * len(some), [c for c in some for _ in every], strict=True):
        explained = name == "steps" and case.case == "large offset"
        verdict = "crash" if case in crashed else {"newton": "correct", "steps": "hang"}[name]
        assert (row["verdict"], row["of"]) == (verdict, len(some))
        assert row["class"] == ("documented limit" if explained else None)
        assert row["quote"] == ("it may take long (its manual)" if explained else None)
        assert row["note"].startswith({"crash": "crash (SIGSEGV): ", "correct": "well", "hang": "hang: "}[verdict])
        shared = "kite" in case.case and name == "newton"
        assert row["note"].endswith("well; in a process with other engines: error") is shared
    assert crashed
    assert unexplained(rows) == [row for row in rows if row["verdict"] != "correct" and not row["class"]]


def test_when_time_is_up_no_other_case_is_begun_by_anybody(table, monkeypatch):
    now = iter([0.0, 1.0, 2.0, 9.0])
    monkeypatch.setattr(hard_table, "time", SimpleNamespace(monotonic=lambda: next(now)))
    rows, *_ = table(["a", "b"], 5.0)

    assert len(rows) == 2 * 3
    assert len({(row["case"], row["distance"]) for row in rows}) == 2
    assert {row["of"] for row in rows} == {len(CASES)}


def test_an_engine_that_is_not_there_is_named_before_any_case(table):
    with pytest.raises(EngineError, match=r"^no engine is called 'c'$"):
        table(["a", "c"])
