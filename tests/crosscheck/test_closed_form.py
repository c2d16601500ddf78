"""The closed form against loop closures in complex numbers, and against differences of its own positions."""

from dataclasses import replace

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import assume, event, given, settings
from hypothesis import strategies as st

from crosscheck.engines.closed_form.engine import ClosedForm
from refkin.model import Mechanism
from refkin.motion import Status

from .closed_form_scenes import FEW, TOPOLOGIES, drawings, in_balls
from .loop_closures import U, open_rows


@pytest.mark.parametrize("build", TOPOLOGIES)
@pytest.mark.parametrize(("decades", "times"), [(0.0, FEW), (3.0, (0.0,))], ids=["", "lengths differ by six decades"])
@settings(max_examples=50)
@given(data=st.data())
def test_truth_closes_every_loop_at_every_level(build, decades, times, data):
    scene = data.draw(drawings(build, spread=decades)).scene(times)
    motion = in_balls(scene).motion
    event(motion.verdict)
    assume(motion.verdict is Status.OK)

    assert open_rows(scene, motion) == []


@pytest.mark.parametrize("build", TOPOLOGIES)
@settings(max_examples=50)
@given(data=st.data())
def test_the_pose_drawn_is_the_pose_found(build, data):
    """Branch and turns: drawn poses have either orientation in each dyad, and angles up to 9 rad.

    The joints carry one rounding of the pose drawn. At a fold a rounding u moves the pose by sqrt(u) = 1e-8, hence the
    bound; the other assembly is further by the chord, which is assumed to be longer.
    """
    scene = data.draw(drawings(build)).scene(times=(0.0,))
    motion = in_balls(scene).motion
    assume(motion.verdict is Status.OK)
    assume(np.abs(motion.qd).max() < 1e4)  # a chord of 1e-4: far longer than 1e-6

    assert np.abs(motion.q[:, 0] - np.concatenate([b.estimate for b in scene.mechanism.bodies])).max() < 1e-6


@pytest.mark.parametrize("build", TOPOLOGIES)
@settings(max_examples=25)
@given(data=st.data())
def test_rates_are_the_differences_of_positions(build, data):
    """Central differences at h = 2^-100 in 400 bits err by h^2 f''' / 6 < 1e-40 and are exact to float."""
    h = 2.0**-100
    scene = data.draw(drawings(build)).scene(times=(-h, 0.0, h))
    assume(in_balls(replace(scene, times=(0.0,))).motion.verdict is Status.OK)
    motion = in_balls(scene, bits=400)
    assume(motion.motion.verdict is Status.OK)
    with ctx.workprec(400):
        q = motion.balls[0]
        rate, acceleration = (q[:, 2] - q[:, 0]) / arb(2 * h), (q[:, 2] - 2 * q[:, 1] + q[:, 0]) / arb(h) ** 2
    size = np.abs(motion.motion.qdd).max() ** 2 + 1  # bounds f''' by the growth of f''
    assume(size < 1e20)

    assert np.abs(rate.astype(float) - motion.motion.qd[:, 1]).max() <= 4 * U * np.abs(motion.motion.qd).max()
    assert np.abs(acceleration.astype(float) - motion.motion.qdd[:, 1]).max() <= 4 * U * np.abs(motion.motion.qdd).max()


@given(data=st.data(), build=st.sampled_from(["four_bar_crank", "slider_crank_by_crank", "inverted_slider_crank"]))
def test_floats_agree_with_balls_within_the_conditioning(data, build):
    """For one dyad between unit-size loops driven by unit rates.

    With s the sine of the dyad: |qd| <= c / s, |qdd| <= c / s^3. A rounding u of the pins moves the pose by u / s, so
    level k is off by u / s^(2 k + 1). 1 / s is measured by the truth itself, as the largest rate; the frames' arms and
    angles add a factor of their size, about 10 each.
    """
    scene = data.draw(drawings(build)).scene(times=(0.0,))
    exact, floats = in_balls(scene).motion, ClosedForm().solve(scene)
    assume(exact.verdict is Status.OK and floats.verdict is Status.OK)
    cosecant = 1.0 + np.abs(exact.qd).max()
    off = [np.abs(a - b).max() for a, b in zip(floats.levels, exact.levels, strict=True)]

    assert all(error <= 1000 * U * cosecant ** (2 * k + 1) for k, error in enumerate(off)), (off, cosecant)


@given(data=st.data(), build=st.sampled_from(list(TOPOLOGIES)))
def test_balls_hold_what_more_bits_find(data, build):
    scene = data.draw(drawings(build)).scene(times=(0.0,))
    coarse, fine = in_balls(scene), in_balls(scene, bits=400)
    assume(coarse.motion.verdict is Status.OK)

    assert all(a.overlaps(b) for a, b in zip(np.ravel(coarse.balls), np.ravel(fine.balls), strict=True))


@given(data=st.data(), build=st.sampled_from(list(TOPOLOGIES)))
def test_the_order_of_bodies_and_joints_does_not_matter(data, build):
    scene = data.draw(drawings(build)).scene(times=(0.0,))
    m = scene.mechanism
    turned = replace(scene, mechanism=Mechanism(m.bodies[::-1], m.joints[::-1], m.drivers))
    one, two = in_balls(scene), in_balls(turned)
    assume(one.motion.verdict is Status.OK)
    in_order = two.balls[0].reshape(-1, 3)[::-1]

    assert all(a.overlaps(b) for a, b in zip(one.balls[0].flat, in_order.flat, strict=True))
