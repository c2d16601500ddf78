"""A sweep that meets a bifurcation between two times does not answer on the branch that it did not come from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import refkin
from refkin.motion import Status
from refkin.motion_laws import Polynomial
from tests.linkages import PARALLELOGRAM, remade, with_law


@pytest.mark.parametrize("beyond", [1e-3, 1e-6, 1e-9, 1e-12])
def test_no_pose_beyond_a_flat_parallelogram_is_called_ok_on_the_other_branch(beyond):
    times = [-0.5, -0.3, -0.1, -beyond, beyond, 0.1]
    law = Polynomial(coefficients=(0.0, 1.0))
    motion = refkin.solve(PARALLELOGRAM.scene(law=law, times=times, branch="crossed", effects=()))

    ok = np.array([status is Status.OK for status in motion.status])

    assert motion["coupler"].phi[ok] == pytest.approx(0.0, abs=1e-7)
    assert ok[:3].all()


@pytest.mark.parametrize("beyond", [1e-6, 3e-8, 3.0000000000000004e-09])
@pytest.mark.parametrize("size", [1.0, 2.3])
def test_an_estimate_nearer_to_a_parallelogram_than_to_its_twin_starts_the_parallelogram(beyond, size):
    """Newton starts within a thousandth of what lies between them; rounding over sigma_min is more than that."""
    linkage = refkin.FourBar(ground=3 * size, crank=size, coupler=3 * size, rocker=size)
    scene = linkage.scene(law=Polynomial(coefficients=(np.pi + beyond, 1.0)), times=[0.0], branch="crossed", effects=())
    off = 1e-3 * beyond
    phi = np.pi + beyond
    c, s = np.cos(phi) * size, np.sin(phi) * size
    crank, coupler, rocker = (c / 2, s / 2, phi), (c + 1.5 * size, s, off), (c / 2 + 3 * size, s / 2, phi)
    estimates = {"crank": crank, "coupler": coupler, "rocker": rocker}
    bodies = tuple(replace(body, estimate=estimates[body.name]) for body in scene.mechanism.bodies)
    motion = refkin.solve(remade(scene, bodies=bodies))

    assert motion.verdict in (Status.OK, Status.SINGULAR)
    assert motion.verdict is Status.SINGULAR or abs(motion["coupler"].phi[0]) <= beyond / 4


def test_an_estimate_that_is_a_singular_pose_to_the_bit_is_a_start():
    """Newton has nothing to correct there."""
    linkage = refkin.FourBar(ground=3.0, crank=3.0, coupler=1.0, rocker=1.0)
    scene = linkage.scene(law=Polynomial(coefficients=(0.5, 1.0)), times=[0.0], branch="open", effects=())
    estimates = {"crank": (1.5, 0.0, 0.0), "coupler": (3.5, 0.0, 0.0), "rocker": (3.5, 0.0, 0.0)}
    bodies = tuple(replace(body, estimate=estimates[body.name]) for body in scene.mechanism.bodies)
    motion = refkin.solve(remade(with_law(scene, Polynomial(coefficients=(0.0, 1.0))), bodies=bodies))

    assert motion.verdict is Status.SINGULAR
    assert np.isfinite(motion.q).all()


@pytest.mark.parametrize("beyond", [1e-2, 1e-6, 1e-10])
def test_a_limit_that_is_passed_and_come_back_from_within_one_step_is_seen(beyond):
    """Both ends of the step have the same pose, and the law turns back between them beyond the limit of the crank."""
    linkage = refkin.FourBar(ground=4.0, crank=2.0, coupler=2.5, rocker=2.0)
    (_, end), *_ = linkage.input_range()
    law = refkin.Sinusoid(amplitude=end * (1.0 + beyond), angular_frequency=1.0)
    scene = linkage.scene(law=Polynomial(coefficients=(end * np.sin(0.5), 1.0)), times=[0.5], branch="open", effects=())
    scene = replace(with_law(scene, law), times=(0.5, np.pi - 0.5))
    first = linkage.scene(law=Polynomial(coefficients=(law(0.5), 1.0)), times=[0.0], branch="open").mechanism.bodies
    scene = remade(scene, bodies=first)

    assert refkin.solve(scene).status == (Status.OK, Status.BRANCH_LOST)
