"""Equations as a straight-line program give the numbers of the formulas, to the last bit, and of no other mechanism."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from refkin.scenes.files import load
from refkin.solving.straight_line import StraightLineSystem
from refkin.system import compile_system
from tests.places import ROOT

from .contact_cases import CASES, scene

SPACE = sorted(ROOT.glob("tests/corpus/space-*.toml"))[::3]
MECHANISMS = {name: scene(name).mechanism for name in CASES} | {p.stem: load(p).mechanism for p in SPACE}
SLIDER = MECHANISMS["plate over lobes"]


def with_program(mechanism):
    system = compile_system(mechanism, unit=mechanism.unit())
    return system, StraightLineSystem.of(system)


@pytest.mark.parametrize("name", MECHANISMS)
def test_a_program_gives_the_formulas_numbers(name):
    system, other = with_program(MECHANISMS[name])
    random = np.random.default_rng(0)

    for shape, t in (((system.n,), 0.125), ((system.n, 3), np.array([0.0, 0.0625, 0.125]))):
        q = random.normal(size=shape)
        for one, program in ((system, other), (system.held_at(q), other.held_at(q))):
            assert np.array_equal(one.phi(q, t), program.phi(q, t))
            assert np.array_equal(one.phi_q(q, t), program.phi_q(q, t))
            assert np.array_equal(one.phi(q, t / 2), program.phi(q, t / 2))


def test_another_mechanism_is_not_run_by_the_program_of_this_one():
    system, program = with_program(SLIDER)
    (first, *rest), q = system.placed, np.random.default_rng(0).normal(size=system.n)
    moved = (replace(first, g=tuple(x + 0.5 for x in first.g)), *rest)

    assert np.array_equal(replace(program, placed=moved).phi(q, 0.0), replace(system, placed=moved).phi(q, 0.0))


def test_numbers_that_were_kept_are_not_those_of_a_pose_that_was_overwritten():
    system, program = with_program(SLIDER)
    q, t = np.random.default_rng(0).normal(size=(system.n, 2)), np.zeros(2)
    old = q.copy()
    assert np.array_equal(program.phi(q, t), system.phi(q, t))
    q += 1.0

    assert all(np.array_equal(s.phi(q, t), system.phi(q.copy(), t)) for s in (system, program))
    assert np.array_equal(program.phi(old, t), system.phi(old, t))
