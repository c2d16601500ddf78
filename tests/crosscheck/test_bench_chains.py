"""The benchmark's chains: their budgets are taken from below, wrong coordinates are noticed, long ones are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import refkin
from crosscheck.engines import EngineError
from crosscheck.engines.methods import methods
from crosscheck.engines.ours.c_kernels import emitted
from crosscheck.engines.ours.chains import program_of
from crosscheck.judge.budget import SAFETY, output_rounding, propagation
from crosscheck.judge.workloads import allowed, of_chain, residual_error, sparse_system
from crosscheck.scenes import workloads as works
from refkin.fast.elimination.program import Instruction, Register

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
    rounded = output_rounding(system.system, q[:, None], still, still)[0][:, 0]
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
