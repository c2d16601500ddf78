"""Gears, racks, cams and offset pins in a comparison: budgets, own rows beside them, and refusals by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from crosscheck.engines import Level, refusals, refused_joints
from crosscheck.engines.exudyn import parts as exudyn_parts
from crosscheck.engines.loading import load
from crosscheck.engines.mujoco.model import Plan
from crosscheck.judge.comparison import compare, reference
from crosscheck.measure.check import check
from refkin import Revolute, Table
from refkin.joints import RollingWheels
from refkin.motion import Status

from ..refkin.contact_cases import CASES, SHIFT, over_profile, scene

ENGINES = ("closed_form", "exudyn", "mujoco", "pinocchio")
WAVY = Table(argument=(-4.0, -2.0, 0.0, 2.0, 4.0), value=(1.0, 1.1, 1.0, 1.05, 1.0))


@pytest.mark.parametrize("name", CASES)
def test_a_budget_is_derived_and_the_answer_itself_is_within_it(name):
    ref = reference(scene(name))
    budget = ref.budget()

    assert compare(ref, ref.motion).agrees
    assert budget.compared.all()
    assert np.isfinite(budget.levels).all()


@pytest.mark.parametrize("name", ["plate over lobes", "gear train", "shifted rocker", "wheel on swing"])
@pytest.mark.parametrize("level", [0, 1, 2])
def test_an_answer_that_is_off_is_beyond_its_budget(name, level):
    """The comparison can fail: it sees one coordinate of one body move by a few times what is allowed."""
    ref = reference(scene(name))
    allowed = ref.budget().levels[level]
    ref.motion.levels[level][0] += 3.0 * allowed[0] * ref.system.unit.size

    assert not compare(ref, ref.motion).agrees


def test_a_profile_that_is_a_table_has_a_budget_too():
    ref = reference(over_profile(WAVY, "roller"))

    assert ref.motion.verdict is Status.OK
    assert np.isfinite(ref.budget().levels[2]).all()


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("engine", ENGINES)
def test_what_an_engine_does_not_have_is_refused_by_name_and_the_rest_is_compared(name, engine):
    record = check(scene(name), [engine])
    unknown = [c for c in scene(name).mechanism.joints if refused_joints(load(engine), [c], Level.SOLVE)]

    assert record.disagreements == []
    for joint in unknown:
        assert any(joint.name == row.name for row in record.refusals)
    assert bool(record.answers) == (not refusals(load(engine), scene(name), Level.SOLVE))
    assert engine == "closed_form" or record.levels


def test_a_pin_with_an_offset_is_not_taken_for_a_pin():
    ends = {"name": "A", "body_i": "a", "point_i": (0.0, 0.0), "body_j": "b", "point_j": (0.0, 0.0)}

    refused = [("revolute", "A", "no such element in this engine: points coincide by a law")]

    for engine in ENGINES:
        assert refused_joints(load(engine), [Revolute(**ends)], Level.SOLVE) == []
        assert refused_joints(load(engine), [Revolute(**ends, offset_law=SHIFT)], Level.SOLVE) == refused


def exchanged(wheels):
    return replace(wheels, radius_i=wheels.radius_j, radius_j=wheels.radius_i)


@pytest.mark.parametrize("engine", ["exudyn", "mujoco"])
def test_wheels_that_an_adapter_exchanges_are_seen_in_rows_and_motion(engine, monkeypatch):
    right = exudyn_parts.ADD[RollingWheels], Plan._wheels
    monkeypatch.setitem(exudyn_parts.ADD, RollingWheels, lambda b, e: right[0](b, exchanged(e)))
    monkeypatch.setattr(Plan, "_wheels", lambda plan, name, e: right[1](plan, name, exchanged(e)))
    seen = {d.quantity for d in check(scene("gear train"), [engine]).disagreements}

    assert seen >= {"position", "velocity", "acceleration", "residual", "jacobian"}
