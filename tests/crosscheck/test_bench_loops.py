"""`crosscheck bench` on tiny workloads of space and on chains: budgets, refusals by name, wrong answers noticed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import refkin
from crosscheck.engines import EngineError
from crosscheck.engines.methods import Use, methods
from crosscheck.engines.ours.c_kernels import emitted
from crosscheck.engines.ours.chains import program_of
from crosscheck.judge import workloads
from crosscheck.judge.budget import propagation
from crosscheck.judge.rounding import SAFETY, output_rounding
from crosscheck.judge.workloads import allowed, of_chain, of_spatial_loops, residual_error, sparse_system
from crosscheck.measure import bench as measure
from crosscheck.scenes import workloads as works
from crosscheck.scenes.workloads import whole
from crosscheck.scenes.workloads_space import many_rssrs, one_rssr
from refkin.fast import prepared
from refkin.fast.elimination.program import Instruction, Register
from refkin.solving.solve import solve

IN_SPACE = {
    "exudyn": "MainSolverStatic.Newton, extrapolated",
    "pinocchio": "Newton on its rows, extrapolated",
    "mujoco": "Newton on its rows, extrapolated",
}
"""Each engine's best method in space."""


def tiny():
    return one_rssr("rssr-1000", 8)


def few():
    return many_rssrs("rssrs-100x72", 2, 8)


@pytest.fixture(scope="module")
def solved():
    """Answers to `few`, (21, 8) per level and mechanism."""
    work = few()
    return [[np.array(level) for level in solve(work.scene(k)).levels] for k in range(work.mechanisms)]


def judged(levels, mechanism=0):
    work = few()
    piece = whole(work, np.array([mechanism]), [level[:, None] for level in levels], range(21))
    return of_spatial_loops(work, [piece])


@pytest.mark.parametrize("engine", IN_SPACE)
@pytest.mark.parametrize("make", [tiny, few], ids=["one", "many"])
def test_the_best_method_of_each_engine_in_space_is_a_ranked_row(engine, make):
    listed = [m for m in methods(engine, Use.BENCH) if m.name == IN_SPACE[engine]]

    results = measure.measured(make(), rounds=1, listed=listed)

    assert [len(row["computes"]) for row in results["rows"]] == [3, 1]
    assert all(row["ranked"] and row["compared"] == make().configurations for row in results["rows"])
    assert {row["newton_by"] for row in results["rows"]} == {"exudyn" if engine == "exudyn" else "the adapter"}


def test_the_fast_path_answers_many_rssrs_in_turn_by_one_program_and_says_so():
    work = few()
    key = "refkin-batch", "all times at once", "no evidence"
    listed = [method for method in methods("refkin-batch") if method.key == key]
    (row, _) = measure.measured(work, rounds=1, listed=listed)["rows"]
    one, other = (prepared(work.scene(k)).made for k in range(2))

    assert row["ranked"]
    assert (row["timed"], row["compared"]) == (16, 16)
    assert "one program for all of them with the numbers of each" in row["note"]
    assert one is other


@pytest.mark.parametrize(
    ("engine", "name"),
    [
        ("c", "dense Newton"),
        ("numpy", "closed form"),
        ("refkin-batch", "sparse"),
        ("mujoco", "mujoco.batch, all times"),
    ],
)
def test_what_is_made_for_four_bars_or_chains_refuses_in_one_sentence(engine, name):
    (found,) = (m for m in methods(engine, Use.BENCH) if m.name.startswith(name))

    with pytest.raises(EngineError, match="made for"):
        found.batched(tiny(), 2)


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
def test_what_is_measured_in_space_alone_refuses_the_plane(engine):
    (found,) = (m for m in methods(engine, Use.BENCH) if m.name == IN_SPACE[engine])

    for work in (works.sweep(8), works.LoopChain("chain-10", 3)):
        with pytest.raises(EngineError, match="workloads of space"):
            found.batched(work, 2)


@pytest.mark.parametrize("order", range(3))
def test_one_wrong_number_of_space_is_noticed(solved, order):
    assert judged(solved[0]).ranked
    levels = [level.copy() for level in solved[0]]
    levels[order][14 + 4, 5] += 1e-12

    result = judged(levels)

    assert not result.ranked
    assert result.max_error > 1e-13


def test_the_answer_of_another_mechanism_is_noticed(solved):
    assert judged(solved[1], 1).ranked
    assert 0.0 < judged(solved[1], 1).worst_over_allowed < 0.5
    assert not judged(solved[0], 1).ranked


def test_every_time_without_a_proof_of_the_truth_is_counted_as_unjudged(solved, monkeypatch):
    ref = workloads._certified(few(), 0)
    radius = replace(ref.motion.certified_radius, acceleration=np.where(np.arange(8) < 5, np.nan, 1e-15))
    unproved = replace(ref, motion=replace(ref.motion, certified_radius=radius))
    monkeypatch.setattr(workloads, "_certified", lambda *_: unproved)

    assert judged(solved[0]).uncompared == 5


def test_an_answer_that_is_missing_in_space_is_no_rank(solved):
    levels = [level.copy() for level in solved[0]]
    levels[0][:, 3] = np.nan

    result = judged(levels)

    assert not result.ranked
    assert result.max_error == np.inf


def test_the_other_sign_of_euler_parameters_is_the_same_answer(solved):
    levels = [level.copy() for level in solved[0]]
    for level in levels:
        level[17:21] *= -1.0

    assert judged(levels).ranked


def test_cranks_of_many_rssrs_turn_fully_and_all_differ():
    work = many_rssrs("rssrs-100x72", 20, 8)

    assert len({linkage.coupler for linkage in work.linkages}) == 20
    for linkage in work.linkages:
        for angle in np.linspace(0.0, 2.0 * np.pi, 50):
            linkage.assemble(float(angle))


def test_workloads_of_space_are_as_large_as_their_names_say():
    sizes = {
        name: (works.workload(name).mechanisms, works.workload(name).configurations)
        for name in works.WORKLOADS
        if name.startswith("rssr")
    }

    assert sizes == {"rssr-1000": (1, 1000), "rssrs-100x72": (100, 7200)}


WORK = works.LoopChain("chain-10", 3)


def test_what_is_allowed_is_less_than_the_budget_of_a_comparison_and_not_much_less():
    system = sparse_system(WORK)
    motion = refkin.solve(WORK.scene)
    levels = [system.system.to_unit(level, order) for order, level in enumerate(motion.levels)]
    whole = propagation(system.system, motion, *levels).budget().levels[0, :, 0]
    part = allowed(system, levels[0][:, 0], 0.0) / whole

    assert np.all(part <= 1.0)
    assert np.all(part > 0.2)


def test_random_signs_carry_most_of_what_the_worst_signs_would_and_no_more():
    system = sparse_system(WORK)
    q, still = system.system.to_unit(refkin.solve(WORK.scene).q)[:, 0], np.zeros((system.system.n, 1))
    rounded = output_rounding(system.system, q[:, None], still, still, np.zeros(1))[0][:, 0]
    worst = np.abs(np.linalg.inv(system.system.phi_q(q, 0.0))) @ (SAFETY * residual_error(system, q, 0.0))
    part = (allowed(system, q, 0.0) - rounded) / worst

    assert np.all(part <= 1.0 + 1e-9)
    assert np.all(part > 0.3)


def test_the_truth_is_ranked_and_one_wrong_coordinate_is_not():
    q = np.asarray(WORK.truth()[0], float)
    assert of_chain(WORK, q).ranked
    for coordinate in range(len(q)):
        wrong = q.copy()
        wrong[coordinate] += 1e-11
        assert not of_chain(WORK, wrong).ranked


def test_nan_is_not_ranked():
    system = sparse_system(WORK)
    assert not of_chain(WORK, np.full(system.system.n, np.nan)).ranked


LONG = {
    ("refkin-batch", "all times at once", "no evidence"): 100,
    ("refkin", "Newton iteration, dense", ""): 100,
    ("c", "same program", ""): 100,
    ("c", "dense Newton", ""): 1000,
}


@pytest.mark.parametrize("key", LONG, ids=", ".join)
def test_a_chain_that_is_too_long_for_a_method_is_refused_with_the_reason(key):
    long = works.LoopChain("chain-10000", LONG[key] + 1)

    with pytest.raises(EngineError, match=f"not for more than {LONG[key]} loops: .+"):
        next(method for method in methods(key[0]) if method.key == key).batched(long, 0)


def test_operations_that_are_no_arithmetic_are_not_put_into_c():
    program, _ = program_of(WORK.scene)
    with_profile = Instruction("profile", Register("w", 0), (Register("w", 1),), (0, 0))
    with pytest.raises(EngineError, match="profile"):
        emitted(replace(program, segments={**program.segments, "answer": (with_profile,)}))
    with_block = Instruction("inverse", Register("x", 0), (Register("w", 1),), 1)
    with pytest.raises(EngineError, match="block"):
        emitted(replace(program, segments={**program.segments, "answer": (with_block,)}))
