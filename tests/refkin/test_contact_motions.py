"""Checks of cams that turn: followers against closed forms, contact parameters with their rates."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from refkin.joints import GROUND, AngleDriver, Cam, Disc, Gear, Polar, Prismatic, Revolute
from refkin.model import Body, Mechanism, Scene
from refkin.motion import Motion, Status
from refkin.motion_laws import Polynomial, Sinusoid
from refkin.solving.solve import solve
from refkin.system import compile_system
from tests.claims import U, assert_near

ORIGIN = (0.0, 0.0)
TIMES = tuple(np.linspace(0.0, 2.4, 9).tolist())
TURN = Polynomial(coefficients=(0.2, 1.1, 0.3))
PROFILE = Sinusoid(offset=1.0, amplitude=0.15, angular_frequency=2.0, phase=0.3)
ALLOWED = 2048 * U
"""Conditions here are below 10, rates below 20."""


def lifted(**cam: Any) -> Motion:
    """Return the motion of a follower that a cam on the origin lifts along y."""
    pivot = Revolute(name="pivot", body_i=GROUND, point_i=ORIGIN, body_j="cam", point_j=ORIGIN)
    guide = Prismatic(name="guide", body_i=GROUND, point_i=ORIGIN, axis_i=(0.0, 1.0), body_j="follower", point_j=ORIGIN)
    touch = Cam(name="touch", body_i="cam", body_j="follower", point_j=ORIGIN, **cam)
    driver = AngleDriver(name="turn", body="cam", law=TURN)
    bodies = Body(name="cam", estimate=(0.0, 0.0, 0.2)), Body(name="follower", estimate=(0.0, 1.1, 0.0))
    motion = solve(Scene(mechanism=Mechanism(bodies, (pivot, guide, touch), (driver,)), times=TIMES))
    assert motion.verdict is Status.OK, f"{cam}: {motion.verdict} {motion.message}"
    return motion


def demand_lift(motion: Motion, y: Any, yd: Any, ydd: Any, told: str) -> None:
    """Demand the lift of the follower and its rates."""
    follower = motion["follower"]
    for found, expected, level in ((follower.y, y, "y"), (follower.yd, yd, "y'"), (follower.ydd, ydd, "y''")):
        assert_near(found, expected, ALLOWED, f"{told}: {level}")


def test_a_knife_edge_follows_its_profile():
    """A point above the pivot is lifted by d(s) at s = 90 degrees - theta, and s is reported with its rates."""
    motion = lifted(point_i=ORIGIN, profile=Polar(law=PROFILE), follower="point")
    theta, w, a = (TURN(np.array(TIMES), k) for k in range(3))
    s = math.pi / 2 - theta
    d = [PROFILE(s, k) for k in range(3)]
    demand_lift(motion, d[0], -d[1] * w, d[2] * w * w - d[1] * a, "knife edge")
    contact = motion.contacts["touch"]
    turns = math.tau * np.round((contact.s - s) / math.tau)
    assert_near(contact.s - turns, s, ALLOWED, "contact parameter")
    assert_near(contact.sd, -w, ALLOWED, "rate of the contact parameter")
    assert_near(contact.sdd, -a, ALLOWED, "acceleration of the contact parameter")


def test_a_flat_face_follows_an_eccentric():
    """A face on a disc off its pivot is lifted by radius and height of the centre, as disc and as profile."""
    e, radius = 0.25, 0.8
    theta, w, a = (TURN(np.array(TIMES), k) for k in range(3))
    y = e * np.sin(theta) + radius
    yd, ydd = e * np.cos(theta) * w, e * (np.cos(theta) * a - np.sin(theta) * w * w)
    round_ = Polar(law=Polynomial(coefficients=(radius,)))
    for profile in (Disc(radius=radius), round_):
        motion = lifted(point_i=(e, 0.0), profile=profile, follower="flat", normal_j=(0.0, 1.0))
        demand_lift(motion, y, yd, ydd, f"face on {profile.kind}")


def test_a_roller_follows_an_eccentric():
    """A roller above the pivot keeps the sum of the radii from the centre of a disc, as disc and as profile."""
    e, radius, rho = 0.25, 0.8, 0.3
    theta, w, a = (TURN(np.array(TIMES), k) for k in range(3))
    x, h = e * np.cos(theta), e * np.sin(theta)
    xd, hd = -h * w, x * w
    xdd, hdd = -hd * w - h * a, xd * w + x * a
    up = np.sqrt((radius + rho) ** 2 - x * x)
    upd = -x * xd / up
    updd = -(xd * xd + x * xdd + upd * upd) / up
    for profile in (Disc(radius=radius), Polar(law=Polynomial(coefficients=(radius,)))):
        motion = lifted(point_i=(e, 0.0), profile=profile, follower="roller", roller_radius=rho)
        demand_lift(motion, h + up, hd + upd, hdd + updd, f"roller on {profile.kind}")


def test_gears_turn_by_their_ratio():
    """A wheel driven through another turns back by the ratio of the radii, over many turns."""
    axles = tuple(
        Revolute(name=f"axle {name}", body_i=GROUND, point_i=at, body_j=name, point_j=ORIGIN)
        for name, at in (("i", ORIGIN), ("j", (1.0, 0.0)))
    )
    mesh = Gear(name="mesh", body_i="i", radius_i=0.4, body_j="j", radius_j=0.6)
    fast = AngleDriver(name="turn", body="i", law=Polynomial(coefficients=(0.3, 30.0)))
    bodies = tuple(Body(name=name, estimate=(x, 0.0, 0.0)) for name, x in (("i", 0.0), ("j", 1.0)))
    motion = solve(Scene(mechanism=Mechanism(bodies, (*axles, mesh), (fast,)), times=TIMES))
    assert motion.verdict is Status.OK, f"{motion.verdict} {motion.message}"
    assert_near(motion["j"].phi, -2 / 3 * motion["i"].phi, 1e-13, "angle")
    assert_near(motion["j"].phid, np.full(len(TIMES), -20.0), 1e-13, "speed")


def test_parameters_stand_behind_the_bodies():
    """A contact parameter is a coordinate of its own, an angle, after those of all bodies; other joints have none."""
    touch = Cam(
        name="touch",
        body_i="a",
        point_i=ORIGIN,
        body_j="b",
        point_j=ORIGIN,
        profile=Polar(law=PROFILE),
        follower="point",
    )
    pin = Revolute(name="pin", body_i=GROUND, point_i=ORIGIN, body_j="a", point_j=ORIGIN)
    second = Cam(
        name="second",
        body_i="b",
        point_i=ORIGIN,
        body_j="a",
        point_j=ORIGIN,
        profile=Polar(law=PROFILE),
        follower="point",
    )
    drivers = tuple(AngleDriver(name=f"d{k}", body="a", law=TURN) for k in range(3))
    system = compile_system(Mechanism((Body(name="a"), Body(name="b")), (pin, touch, second), drivers))
    assert (system.n, system.of_bodies) == (8, 6), f"{system.n} coordinates, {system.of_bodies} of bodies"
    found = [system.parameter(name) for name in ("pin", "touch", "second")]
    assert [(p.start, p.stop) for p in found] == [(0, 0), (6, 7), (7, 8)], f"{found}"
    assert system.angles.tolist() == [False, False, True, False, False, True, True, True], f"{system.angles}"
