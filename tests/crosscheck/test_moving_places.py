"""Checks of guides that move, of mechanisms away from the origin, and of where on a profile a contact is looked for."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from crosscheck.measure.check import check as check_scene
from refkin.joints import GROUND, AngleDriver, Cam, Disc, Polar, Prismatic, Revolute, initial_contacts
from refkin.joints.cams import SCAN
from refkin.model import Body, Mechanism, Point, Scene
from refkin.motion import Status
from refkin.motion_laws import Polynomial, Sinusoid, Table
from refkin.newton import contracts
from refkin.solving.solve import solve
from refkin.solving.sweep import Arrival, Sweep
from refkin.system import compile_system
from tests.claims import U, assert_near

ORIGIN = (0.0, 0.0)
PROFILE = Sinusoid(offset=1.0, amplitude=0.15, angular_frequency=2.0, phase=0.3)
PIVOT = (3.0, -2.0)
TIMES = (0.0, 0.3, 0.6, 0.9)
LAW = Polynomial(coefficients=(0.4, 1.3, -0.6))


def turning(body: str = "crank", law: Any = LAW) -> AngleDriver:
    """Return the driver of an angle."""
    return AngleDriver(name="turn", body=body, law=law)


def pin(body: str, at: Any = PIVOT, point: Any = ORIGIN) -> Revolute:
    """Return a pivot on the ground, which is its body j."""
    return Revolute(name=f"pivot of {body}", body_i=body, point_i=point, body_j=GROUND, point_j=at)


def slotted() -> Scene:
    """Return a crank whose pin carries a block, in which a lever slides: a slot between two bodies that move."""
    below = (PIVOT[0], PIVOT[1] - 2.0)
    lever = {"body_i": "lever", "point_i": (0.1, 0.0), "axis_i": (0.3, 1.0)}
    slot = Prismatic(name="slot", **lever, body_j="block", point_j=ORIGIN, angle=0.7)  # type: ignore[arg-type]
    carried = Revolute(name="pin", body_i="crank", point_i=(0.6, 0.0), body_j="block", point_j=ORIGIN)
    tip = complex(*PIVOT) + 0.6 * np.exp(0.4j)
    along = np.angle(tip - complex(*below)) - np.angle(0.3 + 1j)
    bodies = (
        Body(name="crank", estimate=(*PIVOT, 0.4)),
        Body(name="lever", estimate=(*below, along)),
        Body(name="block", estimate=(tip.real, tip.imag, along + 0.7)),
    )
    joints = (pin("crank"), pin("lever", below), slot, carried)
    points = (Point(name="P", body="lever", position=(0.2, 1.5)),)
    return Scene(mechanism=Mechanism(bodies, joints, (turning(),)), times=TIMES, points=points, name="slot that moves")


def lifted() -> Scene:
    """Return a roller on an eccentric disc; its guide belongs to the follower."""
    guide = Prismatic(
        name="guide", body_i="follower", point_i=ORIGIN, axis_i=(0.0, 1.0), body_j=GROUND, point_j=(3.1, -2.0)
    )
    ends: dict[str, Any] = {"body_i": "crank", "point_i": (0.25, 0.0), "body_j": "follower", "point_j": ORIGIN}
    touch = Cam(name="touch", **ends, profile=Disc(radius=0.8), follower="roller", roller_radius=0.3)
    bodies = Body(name="crank", estimate=(*PIVOT, 0.4)), Body(name="follower", estimate=(3.1, -0.8, 0.0))
    return Scene(
        mechanism=Mechanism(bodies, (pin("crank"), guide, touch), (turning(),)), times=TIMES, name="roller on a disc"
    )


def shifted() -> Scene:
    """Return a crank that is kept away from its pivot by two laws; the pivot is the ground's, as body j."""
    wave = Sinusoid(amplitude=0.3, angular_frequency=2.0, phase=0.4)
    pivot = replace(pin("crank"), offset_law=(wave, Polynomial(coefficients=(0.1, -0.5))))
    bodies = (Body(name="crank", estimate=(PIVOT[0] - 0.1, PIVOT[1] - 0.1, 0.4)),)
    return Scene(mechanism=Mechanism(bodies, (pivot,), (turning(),)), times=TIMES, name="pivot with an offset")


def test_guides_that_move_agree_with_vector_loops():
    """A slot in a lever, a guide and an offset pivot whose body i moves, as loops of vectors."""
    for scene in (slotted(), lifted(), shifted()):
        record = check_scene(scene, ["vector_loop"])
        assert not record.disagreements, f"{scene.name}: {record['disagreements']}"
        assert len(record.answers) == 1, f"{scene.name}: {record['refusals']}"


def test_a_lever_on_a_crank_pin_turns_as_its_triangle_does():
    """Away from the origin, a slotted lever and a point of it have the motion of the closed form, with two rates."""
    scene = slotted()
    motion, t = solve(scene), np.array(TIMES)
    assert motion.verdict is Status.OK, f"{motion.verdict} {motion.message}"
    axis = (0.3 + 1j) / abs(0.3 + 1j)
    offset = (np.conj(axis) * 0.1).imag  # of the slot from the lever's pivot, across

    def arms(t: Any) -> Any:
        """Angle of the lever at complex times, as a complex step asks for: atan2 of an analytic pair."""
        theta = LAW(t)
        x, y = 0.6 * np.cos(theta), 2.0 + 0.6 * np.sin(theta)
        return np.arctan(y / x) + np.where(np.real(x) < 0, math.pi, 0.0) - np.arcsin(offset / np.sqrt(x * x + y * y))

    phi = arms(t) - np.angle(axis)
    phid = np.imag(arms(t + 1e-100j)) / 1e-100
    lever = motion["lever"]
    assert_near(lever.phi, phi, 256 * U, "angle of the lever")
    assert_near(lever.phid, phid, 256 * U, "rate of the lever")
    r = complex(PIVOT[0], PIVOT[1] - 2.0) + (0.2 + 1.5j) * np.exp(1j * phi)
    v = (0.2 + 1.5j) * 1j * phid * np.exp(1j * phi)
    point = motion.points["P"]
    assert_near(point.r, [r.real, r.imag], 512 * U, "point of the lever")
    assert_near(point.v, [v.real, v.imag], 512 * U, "its velocity")
    pivot = motion["crank"]
    assert_near([pivot.xd, pivot.yd], np.zeros((2, len(t))), 64 * U, "velocity of a pivot away from the origin")


def test_a_contact_is_looked_for_all_around():
    """A closed profile is searched over its turn, an open one over its table or two turns, and the best point found."""
    wave = Sinusoid(amplitude=0.1, angular_frequency=2.0, offset=1.0)
    table = Table(argument=(-0.5, 0.4, 1.2, 2.0), value=(1.0, 1.1, 1.2, 1.1))
    spans = (
        (wave, True, (-math.pi, math.pi)),
        (Sinusoid(amplitude=0.1, angular_frequency=2.5, offset=1.0), False, (-math.tau, math.tau)),
        (Polynomial(coefficients=(1.0,)), True, (-math.pi, math.pi)),
        (Polynomial(coefficients=(1.0, 0.1)), False, (-math.tau, math.tau)),
        (table, False, (-0.5, 2.0)),
    )
    for law, closed, span in spans:
        profile = Polar(law=law)
        assert (profile.closed, profile.span) == (closed, span), f"{law}: {profile.closed}, {profile.span}"
    knife: dict[str, Any] = {"body_i": "cam", "point_i": ORIGIN, "body_j": "follower", "point_j": ORIGIN}
    touch = Cam(name="touch", **knife, profile=Polar(law=PROFILE), follower="point")
    drivers = tuple(AngleDriver(name=f"d{k}", body="cam", law=LAW) for k in range(5))
    system = compile_system(Mechanism((Body(name="cam"), Body(name="follower")), (touch,), drivers))
    last = (math.tau / (SCAN - 1)) * (2 / (SCAN - 1)) ** 2
    for s in np.linspace(-3.0, 3.0, 13):
        at = PROFILE(s) * np.exp(1j * (s + 0.4))
        contacts = initial_contacts(system, np.array([0.0, 0.0, 0.4, at.real, at.imag, 0.0, 0.0]), 0.0)
        assert_near(contacts[6], s, 0.501 * last, "touched at")


def test_no_step_turns_an_angle_further_than_a_radian(monkeypatch):
    """A fast crank is followed in steps, however well its motion is predicted."""
    scene = slotted()
    system = compile_system(scene.mechanism, unit=scene.mechanism.unit())
    start = system.to_unit(solve(scene).q[:, 0])
    sweep = Sweep(system, [0.0], [start])
    assert sweep.to(TIMES[-1]) is Arrival.REACHED, "the last time is not reached"
    turns = np.abs(np.diff(np.array(sweep.q), axis=0))[:, system.angles]
    assert float(np.max(turns)) <= 1.0, f"a step turns by {np.max(turns)}"
    wheel = Mechanism((Body(name="crank"),), (pin("crank"),), (turning(law=Polynomial(coefficients=(0.0, 50.0))),))
    fast = compile_system(wheel, unit=wheel.unit())
    monkeypatch.setattr("refkin.solving.sweep.Winding.of", lambda *_: None)  # a wheel alone is reached at once
    sweep = Sweep(fast, [0.0], [np.zeros(3)])
    assert sweep.to(1.0) is Arrival.REACHED, f"50 rad in {len(sweep.q)} steps"
    assert len(sweep.q) > 50, f"50 rad in {len(sweep.q)} steps"


def test_a_slow_contraction_is_no_contraction():
    """Newton's second correction shows another root near, unless both are round-off."""
    for sizes, holds in (([1.0], True), ([1.0, 0.1], True), ([1.0, 0.5], False), ([1e-8, 9e-9], True)):
        assert contracts(sizes) is holds, f"{sizes}: {not holds}"
