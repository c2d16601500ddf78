"""Where the vector-loop method has no answer, what it refuses by name, and that faults planted in it are seen."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest

import refkin
from crosscheck.engines import EngineError
from crosscheck.engines.vector_loop import chains, system
from crosscheck.engines.vector_loop.chains import VectorChains
from crosscheck.engines.vector_loop.engine import VectorLoop
from crosscheck.engines.vector_loop.vectors import Sums
from refkin.joints import GROUND, AngleDriver, Prismatic
from refkin.model import Body, Mechanism, Scene
from refkin.motion import Status
from refkin.motion_laws import Polynomial

from .exact_linkages import CASES, cylinder, excess, four_bar, pair, pin, scotch_yoke, slider_crank
from .loop_scenes import general_cam


def out_of_reach(stop):
    """A crank whose four-bar ends at 112.0243 degrees, driven from 60 degrees at 1 rad/s."""
    linkage = refkin.FourBar(90.0, 30.0, 60.0, 45.0)
    scene = linkage.scene(law=Polynomial(coefficients=(math.radians(60.0), 1.0)), times=[0.0, 0.2])
    return replace(scene, times=(0.0, 0.2, stop))


LIMIT = math.acos((90.0**2 + 30.0**2 - 105.0**2) / (2 * 90.0 * 30.0)) - math.radians(60.0)


def test_beyond_the_limit_there_is_no_answer_at_all():
    motion = VectorLoop().solve(out_of_reach(LIMIT + 1e-9))

    assert motion.status == (Status.OK, Status.OK, Status.NOT_CONVERGED)
    assert np.isnan(motion.q[:, 2]).all()
    assert "not followed beyond t = 0.2" in motion.message


def test_at_the_limit_there_is_a_position_and_no_rates():
    """There the angles go with the root of the input, whose rounding of 1e-16 is 1e-8 of them."""
    motion = VectorLoop().solve(out_of_reach(LIMIT))

    assert motion.status == (Status.OK, Status.OK, Status.SINGULAR)
    assert abs(math.remainder(motion["rocker"].phi[2] - motion["coupler"].phi[2], math.tau)) == pytest.approx(
        math.pi, abs=1e-6
    )
    assert np.isnan(motion.qd[:, 2]).all()


def without_estimate(scene, name):
    bodies = tuple(replace(b, estimate=None) if b.name == name else b for b in scene.mechanism.bodies)
    return replace(scene, mechanism=replace(scene.mechanism, bodies=bodies))


def with_joint(scene, joint):
    return replace(scene, mechanism=replace(scene.mechanism, joints=(*scene.mechanism.joints, joint)))


def floating():
    """A body that only its angle is known of, though the constraints are as many as the coordinates."""
    body = Body(name="free", estimate=(0.0, 0.0, 0.0))
    drivers = tuple(
        AngleDriver(name=f"d{k}", body=b, law=Polynomial(coefficients=(0.0,))) for k, b in enumerate(("crank", "free"))
    )
    twice = tuple(replace(pin("A0", GROUND, 0j, "crank", 0j), name=name) for name in ("A0", "again"))
    return Scene(
        mechanism=Mechanism((Body(name="crank", estimate=(0.0, 0.0, 0.0)), body), twice, drivers), times=(0.0,)
    )


REFUSED = {
    "the angle of coupler has no estimate": (
        lambda: without_estimate(four_bar().scene, "coupler"),
        "no body has an estimate of the angle of coupler",
    ),
    "a redundant pin": (
        lambda: with_joint(four_bar().scene, pin("again", GROUND, 0j, "crank", -0.5)),
        "2 redundant constraints",
    ),
    "an angle given twice": (
        lambda: with_joint(
            slider_crank().scene,
            Prismatic(
                name="P2", body_i=GROUND, point_i=(0.0, 0.4), axis_i=(1.0, 0.0), body_j="slider", point_j=(0.0, 0.5)
            ),
        ),
        "'P2': redundant, the angle of 'slider' is given",
    ),
    "a cam of general profile": (general_cam, "refuses cam 'c' at solve: no vector .* a contact on a general profile"),
    "a body that hangs on nothing": (floating, "no joint leads from the ground to free"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_it_cannot_do_is_refused_by_name(name):
    build, words = REFUSED[name]
    with pytest.raises(EngineError, match=words):
        VectorLoop().solve(build())


# ---- planted faults: each replaces a piece of the method, and must not go unseen


def forgotten(order):
    """Laws lose one derivative."""
    return lambda f: lambda self, t, k: 0.0 * f(self, t, k) if k == order else f(self, t, k)


FAULTS = {
    "Coriolis and centripetal terms forgotten": (
        Sums,
        "acceleration",
        lambda f: lambda self, q, qd, qdd, t: f(self, q, 0.0 * qd, qdd, t),
    ),
    "sign of nu": (system.LoopSystem, "nu", lambda f: lambda *a: -f(*a)),
    "driver rate forgotten": (system.Variables, "known", forgotten(1)),
    "driver acceleration forgotten": (system.Variables, "known", forgotten(2)),
    "a slide's axis turned by 1e-9": (
        VectorChains,
        "_slide",
        lambda f: (
            lambda self, name, body, axis, gap: f(self, name, body, pair(complex(*axis) * cmath.rect(1, 1e-9)), gap)
        ),
    ),
    "a link longer by 1e-9": (
        VectorChains,
        "_link",
        lambda f: lambda self, c, length, gap: f(self, c, replace(length, constant=length.constant + 1e-9), gap),
    ),
    "a constant angle the wrong way round": (
        chains,
        "_carried",
        lambda f: lambda e, body, angle: f(e, e.body_j, angle),
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_seen(name, monkeypatch):
    cases = (four_bar(), slider_crank(tilt=0.7, angle=-1.1), scotch_yoke(), cylinder(), CASES["welded arm"]())
    healthy = max(excess(case, VectorLoop().solve(case.scene)) for case in cases)
    owner, attribute, plant = FAULTS[name]
    monkeypatch.setattr(owner, attribute, plant(getattr(owner, attribute)))

    assert healthy <= 1.0 < max(excess(case, VectorLoop().solve(case.scene)) for case in cases)
