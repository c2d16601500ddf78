"""Assemblies with gears, racks, cams and offset pins: found without estimates, chosen, or proved not to exist."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from flint import ctx

import refkin
from refkin import (
    Body,
    Cam,
    Distance,
    Gear,
    Mechanism,
    Polar,
    Polynomial,
    Scene,
    Sinusoid,
    Table,
    XDriver,
    compile_system,
)
from refkin.analysis import position
from refkin.proof.assembly.assembly import assemblies
from refkin.proof.assembly.closed_form import place
from refkin.proof.assembly.rigid_groups import plan
from refkin.proof.assembly.rows import read_rows
from refkin.proof.assembly.search import Search, coordinates
from tests.linkages import remade, with_estimates, with_law, without_estimates

from .contact_cases import CASES, LOBES, TIMES, cam, guide, over_profile, pin, scene, turning


@pytest.mark.parametrize("name", CASES)
def test_an_assembly_is_found_without_estimates(name):
    assert refkin.solve(replace(without_estimates(scene(name)), times=(0.0,))).verdict == "ok"


CLOSED_FORM = [
    "disc under plate",
    "disc under wedge",
    "disc under lever",
    "roller over disc",
    "tip on disc",
    "gear train",
    "rack above",
    "wheel on road",
    "shifted platform",
    "shifted rocker",
]


@pytest.mark.parametrize("name", CLOSED_FORM)
def test_closed_form_places_every_assembly_without_newton(name):
    mechanism = scene(name).mechanism
    system, names = compile_system(mechanism, unit=mechanism.unit()), [b.name for b in mechanism.bodies]
    with ctx.workprec(113):
        rows = read_rows(system, 0.5)
        branches = place(plan(rows, names), rows, names, system.unit.size).branches
    gaps = [np.max(np.abs(system.phi(coordinates(system, branch), 0.5))) for branch in branches]

    assert rows.foreign == ()
    assert gaps
    assert max(gaps) < 1e-15
    assert assemblies(system, 0.5).complete


@pytest.mark.parametrize(("estimate", "side"), [(2.2, 1), (-2.2, -1)])
def test_a_far_estimate_leads_to_the_nearest_assembly(estimate, side):
    """The lever may lie above the disc or below it."""
    bodies = Body(name="cam", estimate=(0.0, 0.0, 0.0)), Body(name="follower", estimate=(3.0, 0.0, estimate))
    given = replace(scene("tip on disc"), times=(0.0,))
    motion = refkin.solve(remade(given, bodies=bodies))

    assert np.sign(np.sin(motion["follower"].phi[0])) == side


@pytest.mark.parametrize("estimates", [((0.0, 0.0, 0.2), (0.0, 1.0, 0.0)), (None, None)], ids=["bodies", "alone"])
@pytest.mark.parametrize(("contact", "side"), [(1.25, 1), (-1.5, -1)])
def test_a_contact_estimate_chooses_among_contacts(contact, side, estimates):
    """A plate may have the highest point of the profile in its face, or the lowest."""
    given = over_profile(LOBES, "flat", times=(0.0,), estimates=estimates)
    joints = tuple(replace(j, contact_estimate=contact) if isinstance(j, Cam) else j for j in given.mechanism.joints)
    motion = refkin.solve(remade(given, joints=joints))

    assert side * motion["follower"].y[0] > 0.9


def test_a_contact_is_first_sought_where_what_is_missed_is_small_not_where_it_is_negative():
    cam = next(j for j in over_profile(LOBES, "flat", times=(0.0,)).mechanism.joints if isinstance(j, Cam))
    middle = sum(cam.span) / 2

    assert cam.initial_contact(lambda s: np.array([s - middle, 0.0 * s])) == pytest.approx(middle, abs=1e-3)


def test_a_lever_that_is_too_short_for_the_disc_is_proved_not_to_assemble():
    m = scene("tip on disc").mechanism
    joints = tuple(replace(j, point_j=(0.5, 0.0)) if isinstance(j, Cam) else j for j in m.joints)
    motion = refkin.solve(remade(scene("tip on disc"), joints=joints, times=(0.0,)))

    assert motion.verdict == "unassemblable"


def test_an_offset_out_of_reach_is_proved_not_to_assemble():
    m = scene("shifted rocker").mechanism
    far = (Polynomial(coefficients=(4.0,)), Polynomial(coefficients=(0.0,)))
    joints = tuple(replace(j, offset_law=far) if getattr(j, "offset_law", None) else j for j in m.joints)
    motion = refkin.solve(remade(scene("shifted rocker"), joints=joints, times=(0.0,)))

    assert motion.verdict == "unassemblable"


def two_trains(ratio):
    """A second pair of wheels between the first and the ring: redundant, or in contradiction."""
    m = scene("gear train").mechanism
    extra = Gear(name="g3", body_i="first", radius_i=ratio, phi0_i=0.125, body_j="ring", radius_j=2.0, phi0_j=-0.09375)
    return remade(scene("gear train"), joints=(*m.joints, extra))


def test_gears_that_contradict_each_other_are_proved_not_to_assemble():
    motion = refkin.solve(two_trains(0.625))

    assert motion.verdict == "unassemblable"
    assert "rad" in motion.message


def test_gears_that_repeat_each_other_are_redundant():
    assert refkin.solve(two_trains(0.5)).verdict == "ok"


def test_a_gear_of_many_turns_keeps_them():
    law = Polynomial(coefficients=(1e4, 1.0))
    motion = refkin.solve(with_law(scene("gear train"), law))

    assert motion.verdict == "ok"
    assert motion["second"].phi[0] == pytest.approx(0.25 - (1e4 - 0.125) / 1.5, rel=1e-15, abs=0.0)


def test_a_wheel_that_a_rack_drives_needs_no_turns_of_its_estimate():
    """The rack counts the wheel's turns: an estimate a turn off changes nothing of the answer."""
    further = with_estimates(scene("rack below"), lambda b: (*b.estimate[:2], b.estimate[2] + math.tau))
    motion = refkin.solve(further)

    assert motion["wheel"].phi == pytest.approx(refkin.solve(scene("rack below"))["wheel"].phi, abs=1e-14)


def test_the_reduced_equation_of_a_geared_five_bar_holds():
    """Two geared cranks and two massless links on one pin: Newton on all coordinates closes the loop."""
    joints = (
        pin("left"),
        pin("right", (2.0, 0.0)),
        Gear(name="teeth", body_i="left", radius_i=1.0, body_j="right", radius_j=1.0),
        Distance(name="a", body_i="left", point_i=(1.0, 0.0), body_j="tip", point_j=(0.0, 0.0), length=2.0),
        Distance(name="b", body_i="right", point_i=(1.0, 0.0), body_j="tip", point_j=(0.0, 0.0), length=2.0),
    )
    still = Polynomial(coefficients=(0.0,))
    bodies = tuple(Body(name=n) for n in ("left", "right", "tip"))
    given = Scene(mechanism=Mechanism(bodies, joints, (turning("left"), turning("tip", still))), times=TIMES)
    motion = refkin.solve(given)

    assert motion.verdict == "ok"
    assert motion["right"].phi == pytest.approx(-motion["left"].phi, abs=1e-15)
    arms = {side: np.array([np.cos(motion[side].phi), np.sin(motion[side].phi)]) for side in ("left", "right")}
    tips = [motion[side].q[:2] + arm for side, arm in arms.items()]
    assert all(np.linalg.norm(tip - motion["tip"].q[:2], axis=0) == pytest.approx(2.0, abs=1e-14) for tip in tips)


def test_newton_finds_the_contact_too():
    given = scene("roller over lobes")
    system = compile_system(given.mechanism)
    q = np.array([x for b in given.mechanism.bodies for x in b.estimate] + [1.25])
    result = position(system, q, 0.0)

    assert result.converged
    assert result.q[6] == pytest.approx(refkin.solve(given).contacts["contact"].s[0], abs=1e-14)


def test_a_wheel_that_a_rack_has_turned_far_is_found_where_it_is():
    """No driver gives the wheel's angle, but the rack counts its turns: 7.5 along a radius of 0.75."""
    far = XDriver(name="push", body="rack", law=Polynomial(coefficients=(7.5,)))
    given = without_estimates(scene("rack below"))
    motion = refkin.solve(remade(given, drivers=(far,), times=(0.0,)))

    assert motion.verdict == "ok"
    assert motion["wheel"].phi[0] == pytest.approx(10.0, rel=1e-15, abs=0.0)


@pytest.mark.parametrize("rho", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("side", [1, -1])
def test_a_small_roller_stays_on_the_side_of_the_profile_where_it_is_estimated(rho, side):
    """The equations know both: a roller outside, and one inside, two radii away."""
    s, law = 1.43577, Sinusoid(offset=1.2, amplitude=0.3, angular_frequency=1.0)
    tangent = (law(s, 1) + 1j * law(s)) * np.exp(1j * s)
    centre = law(s) * np.exp(1j * s) - side * 1j * rho * tangent / abs(tangent)
    held = guide("follower", (centre.real, 0.0))
    joints, _ = cam(Polar(law=law), "roller", held, roller_radius=rho)
    bodies = Body(name="cam", estimate=(0.0, 0.0, 0.0)), Body(name="follower", estimate=(centre.real, centre.imag, 0.0))
    still = turning("cam", Polynomial(coefficients=(0.0,)))
    motion = refkin.solve(Scene(mechanism=Mechanism(bodies, joints, (still,)), times=(0.0,)))

    assert motion.verdict == "ok"
    assert motion["follower"].y[0] == pytest.approx(centre.imag, abs=1e-13)


@pytest.mark.parametrize("rho", [1e-3, 1e-6])
def test_a_small_roller_is_found_though_its_rows_are_divided_by_its_radius(rho):
    """Half a degree of the profile is many radii long, and a rounding of the pose a large residual."""
    given = scene("roller over lobes")
    joints = tuple(replace(j, roller_radius=rho) if isinstance(j, Cam) else j for j in given.mechanism.joints)
    motion = refkin.solve(remade(given, joints=joints))

    assert motion.verdict == "ok"


@pytest.mark.parametrize(("times", "gone"), [((0.0, 0.25, 5.0), 1), (tuple(0.25 * k for k in range(9)), 0)])
def test_a_sweep_that_runs_out_of_steps_from_an_asked_time_says_so_and_claims_no_singular_pose(
    times, gone, monkeypatch
):
    monkeypatch.setattr("refkin.solving.sweep.MOST_STEPS", 200)
    monkeypatch.setattr("refkin.solving.sweep.Winding.of", lambda *_: None)  # wheels alone are reached at once
    fast = turning("first", Polynomial(coefficients=(0.0, 100.0)))
    motion = refkin.solve(remade(scene("gear train"), drivers=(fast,), times=times))

    assert [s.value for s in motion.status] == ["ok"] * (len(times) - gone) + ["not_converged"] * gone
    assert ("gave up" in motion.message) == bool(gone)


def test_trial_angles_lie_within_a_turn_and_contacts_on_the_profile():
    """Of an open table no contact lies before its first argument or behind its last."""
    law = Table(argument=(0.5, 0.75, 1.0, 1.5), value=(1.0, 1.1, 1.15, 1.2))
    joints, _ = cam(profile=Polar(law=law), follower="point", held=guide("follower"))
    looking = object.__new__(Search)
    looking.system = SimpleNamespace(mechanism=SimpleNamespace(joints=joints))
    looking.turned = ("cam",)
    trials = np.array([point for point, _ in zip(looking._halton(), range(64), strict=False)])

    assert (np.abs(trials[:, 0]) <= math.pi).all()
    assert ((trials[:, 1] >= 0.5) & (trials[:, 1] <= 1.5)).all()
    assert (np.ptp(trials, axis=0) > 0.9 * np.array([math.tau, 1.0])).all()


@pytest.mark.parametrize(("estimate", "contact"), [(None, 1.604), (-39.26, -39.260)])
def test_of_a_spiral_only_contacts_within_two_turns_are_looked_for(estimate, contact):
    """Six turns back its distance is negative, and a lever touches it nearer to where it is estimated."""
    spiral = Polar(law=Polynomial(coefficients=(1.0, 0.05)))
    ends = {"body_i": "cam", "point_i": (0.0, 0.0), "body_j": "lever", "point_j": (-1.8, 0.0)}
    touch = Cam(name="touch", **ends, profile=spiral, follower="point", contact_estimate=estimate)
    bodies = (Body(name="cam", estimate=(0.0, 0.0, 0.0)), Body(name="lever", estimate=(2.0, 1.0, 0.0)))
    turned = turning("cam", Polynomial(coefficients=(-0.2205592722708484,)))
    m = Mechanism(bodies, (pin("cam"), pin("lever", at=(2.0, 1.0)), touch), (turned,))
    motion = refkin.solve(Scene(mechanism=m, times=(0.0,)))

    assert motion.verdict == "ok"
    assert motion.contacts["touch"].s[0] == pytest.approx(contact, abs=1e-3)
