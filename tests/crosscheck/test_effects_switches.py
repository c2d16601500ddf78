"""Every switch of an effect changes what its engine simulates, so that "inert" is not said of one that is dead."""

from __future__ import annotations

import numpy as np
import pytest

from crosscheck.engines.exudyn.engine import Exudyn
from crosscheck.engines.exudyn.integration import EFFECTS as EXUDYN
from crosscheck.engines.exudyn.model import ExudynModel
from crosscheck.engines.loading import load
from crosscheck.engines.mujoco.features import EFFECTS as MUJOCO
from crosscheck.engines.mujoco.features import affected as affected_plan
from crosscheck.engines.mujoco.model import Plan, mujoco
from crosscheck.engines.pinocchio.engine import PinocchioTree
from crosscheck.engines.pinocchio.features import EFFECTS as PINOCCHIO
from crosscheck.engines.pinocchio.features import EFFORT, UNREAD, ForwardDynamics, _with_mass, affected, pin
from crosscheck.engines.pinocchio.model import tree_model
from crosscheck.engines.tree.joint_tree import joint_tree
from crosscheck.scenes.names import PHYSICAL
from refkin.motion_laws import Polynomial, Sinusoid
from refkin.solving.solve import solve
from tests.linkages import ROCKER

SCENE = ROCKER.scene(law=Polynomial(coefficients=(0.0, 2.0)), times=(0.1, 0.2, 0.3))
ENGINES = ("exudyn", "mujoco", "pinocchio")


@pytest.mark.parametrize("name", ENGINES)
def test_every_physical_effect_is_offered_or_refused_with_a_reason(name):
    engine = load(name)
    offered, missing = engine.physical_effects(), engine.missing_effects()

    assert sorted([*offered, *missing]) == sorted(PHYSICAL)
    assert all({**offered, **missing}.values())


@pytest.mark.parametrize(("name", "off"), [("mujoco", 0.2), ("pinocchio", 1e-12)])
def test_forward_dynamics_accelerate_a_linkage_as_its_law_does(name, off):
    """MuJoCo's constraints are soft: an eighth is missing. Planted: a law without its second derivative."""
    scene = ROCKER.scene(law=Sinusoid(offset=1.0, amplitude=0.8, angular_frequency=1.3), times=SCENE.times)
    engine, right = load(name), solve(scene).qdd
    (route,) = engine.dynamic_routes()

    assert engine.solve(scene, route).qdd == pytest.approx(right, abs=off * np.max(np.abs(right)))


def exudyn_state(effect):
    """Largest force on the bodies as the static Newton sees it, largest mass, number of sensors."""
    mechanism = SCENE.mechanism
    more = None if effect is None else EXUDYN[effect].switch
    model = ExudynModel(mechanism.bodies, mechanism.constraints, more=more)
    model.set_state(np.array([body.estimate for body in mechanism.bodies]).ravel(), 0.1, np.ones(model.n))
    model.solver.ComputeODE2RHS(model.mbs)
    force = np.abs(model.solver.GetSystemResidual()[: model.n]).max()
    model.solver.ComputeMassMatrix(model.mbs)
    mass = np.abs(model.solver.GetSystemMassMatrix()).max()
    sensors = model.mbs.systemData.NumberOfSensors()
    model.close()
    return {"force": force, "mass": mass, "sensors": sensors}


IN_EXUDYN = {
    **dict.fromkeys(("gravity", "contact", "friction", "joint limits", "passive forces", "actuation"), "force"),
    "sensors": "sensors",
    "inertia": "mass",
}


def test_exudyn_has_no_force_mass_or_sensor_unless_it_is_switched_on():
    assert set(exudyn_state(None).values()) == {0}


@pytest.mark.parametrize("effect", EXUDYN)
def test_switch_of_exudyn_puts_into_its_system_what_it_says(effect):
    assert exudyn_state(effect)[IN_EXUDYN[effect]] >= 1


def mujoco_state(effect):
    """What MuJoCo's forward dynamics find at one state: forces, rows, contacts, sensors, masses."""
    tree = joint_tree(SCENE.mechanism)
    model = affected_plan(Plan(tree, tree.closures), effect).compile()
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = 0.3, 1.0
    mujoco.mj_forward(model, data)
    return {
        "bias": np.abs(data.qfrc_bias).max(),
        "contacts": data.ncon,
        "friction rows": data.nf,
        "limit rows": data.nl,
        "passive": np.abs(data.qfrc_passive).max(),
        "actuator": np.abs(data.qfrc_actuator).max(initial=0.0),
        "sensors": np.abs(data.sensordata).max(initial=0.0),
        "mass": float(model.body_mass.sum()) - tree.width,
    }


IN_MUJOCO = {
    "gravity": "bias",
    "contact": "contacts",
    "friction": "friction rows",
    "joint limits": "limit rows",
    "passive forces": "passive",
    "actuation": "actuator",
    "sensors": "sensors",
    "inertia": "mass",
}


def test_mujoco_has_no_force_row_or_sensor_unless_it_is_switched_on():
    assert {name: value for name, value in mujoco_state(None).items() if value and name != "bias"} == {}


@pytest.mark.parametrize("effect", MUJOCO)
def test_switch_of_mujoco_changes_the_quantity_that_it_acts_by(effect):
    """At rest of all else the bias force is that of rates alone, 0.06 here."""
    assert mujoco_state(effect)[IN_MUJOCO[effect]] >= 1.0


def falling(effect):
    """Return Pinocchio's accelerations of the tree with nothing that holds it, under the efforts of an effect."""
    tree = joint_tree(SCENE.mechanism, massless_links=True)
    effort = ForwardDynamics(PinocchioTree(tree), effect).effort
    planar = tree_model(tree)
    _with_mass(planar, 1.0, (0.0, 0.0))
    planar = affected(planar, effect)
    rates = np.ones(planar.model.nv)
    return pin.aba(planar.model, planar.data, 0.3 * rates, rates, effort)


@pytest.mark.parametrize("effect", ["gravity", "actuation", "inertia"])
def test_switch_of_pinocchio_is_felt_where_no_constraint_holds_the_tree(effect):
    assert np.abs(falling(effect) - falling(None)).max() > 0.01


@pytest.mark.parametrize("effect", [name for name, effect in PINOCCHIO.items() if UNREAD in effect.description])
def test_switch_that_no_algorithm_of_pinocchio_reads_changes_its_model_all_the_same(effect):
    tree = joint_tree(SCENE.mechanism, massless_links=True)

    assert affected(tree_model(tree), effect).model != tree_model(tree).model
    assert np.array_equal(falling(effect), falling(None))


def test_effort_limits_alone_are_no_actuation():
    tree = joint_tree(SCENE.mechanism, massless_links=True)

    assert set(ForwardDynamics(PinocchioTree(tree), "actuation").effort) == {EFFORT}
    assert set(ForwardDynamics(PinocchioTree(tree), None).effort) == {0.0}


@pytest.mark.parametrize("effect", [None, "gravity", "contact"])
def test_exudyn_solves_with_the_effect_that_is_switched_on_and_no_other(effect, monkeypatch):
    added = []
    for name, switch in EXUDYN.items():

        def add(*given, name=name, right=switch.switch):
            added.append(name)
            return right(*given)

        monkeypatch.setitem(EXUDYN, name, switch._replace(switch=add))
    Exudyn(effect).solve(SCENE)

    assert set(added) == {effect} - {None}
