"""Relations that hold between answers, whatever the answers are: free oracles.

Each allows what the certificates of both answers prove, and a few roundings of the numbers that were changed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from refkin import (
    AngleDriver,
    FourBar,
    Integral,
    InvertedSliderCrank,
    Polynomial,
    Revolute,
    Scene,
    SliderCrank,
    Status,
    solve,
)
from tests.linkages import with_estimates

LAW = Polynomial(coefficients=(0.4, 1.3, -0.2))
TIMES = tuple(np.linspace(0.0, 2.0, 9))
LINKAGES = [
    FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0),
    FourBar(ground=1.0, crank=3.0, coupler=3.5, rocker=2.5),
    SliderCrank(crank=1.0, rod=3.0, offset=0.4),
    InvertedSliderCrank(ground=2.0, crank=1.0, offset=0.2),
]
U = 2.0**-53


def scene_of(linkage, law=LAW, times=TIMES):
    return linkage.scene(law=law, times=times)


def solved(scene):
    motion = solve(scene)

    assert motion.verdict is Status.OK
    return motion


def allowed(*motions, level="position"):
    """What the certificates leave open between answers, in metres (the size is at most 4) and rad."""
    proved = sum(getattr(m.certified_radius, level) for m in motions)
    size = max(np.max(np.abs(level_of(m, level))) for m in motions)
    return 4.0 * proved + 64 * U * max(1.0, size)


def level_of(motion, level):
    return dict(zip(("position", "velocity", "acceleration"), motion.levels, strict=True))[level]


def assert_same(a, b, mapped, factors=(1.0, 1.0, 1.0)):
    """Every level of b is the mapped level of a, within what is proved of both."""
    for k, level in enumerate(("position", "velocity", "acceleration")):
        difference = np.max(np.abs(mapped(a.levels[k], k) - b.levels[k]), axis=0)
        assert np.all(difference <= factors[k] * allowed(a, b, level=level)), level


@pytest.mark.parametrize("linkage", LINKAGES, ids=lambda k: type(k).__name__)
def test_turning_the_ground_turns_the_motion(linkage):
    angle, shift = 0.7, (3.0, -2.0)
    turned = solved(
        scene_of(replace(linkage, origin=shift, angle=angle), law=Polynomial(coefficients=(1.1, 1.3, -0.2)))
    )
    c, s = np.cos(angle), np.sin(angle)

    def mapped(level, k):
        out = level.copy()
        out[0::3] = c * level[0::3] - s * level[1::3] + (shift[0] if k == 0 else 0.0)
        out[1::3] = s * level[0::3] + c * level[1::3] + (shift[1] if k == 0 else 0.0)
        out[2::3] += angle if k == 0 else 0.0
        return out

    # The turned scene's own numbers are rounded (its ground points and its law): one more allowance of that size.
    assert_same(solved(scene_of(linkage)), turned, mapped, factors=(16.0, 16.0, 16.0))


@pytest.mark.parametrize("linkage", LINKAGES, ids=lambda k: type(k).__name__)
def test_the_mirror_image_moves_as_the_mirror_image(linkage):
    scene = scene_of(linkage)
    flip = lambda p: (p[0], -p[1])  # noqa: E731
    keys = ("point_i", "point_j", "axis_i")
    joints = tuple(
        replace(j, **{k: flip(getattr(j, k)) for k in keys if hasattr(j, k)}) for j in scene.mechanism.joints
    )
    bodies = tuple(replace(b, estimate=(b.estimate[0], -b.estimate[1], -b.estimate[2])) for b in scene.mechanism.bodies)
    backwards = Polynomial(coefficients=tuple(-c for c in LAW.coefficients))
    drivers = (replace(scene.mechanism.drivers[0], law=backwards),)
    mirrored = replace(scene, mechanism=replace(scene.mechanism, bodies=bodies, joints=joints, drivers=drivers))
    sign = np.tile([1.0, -1.0, -1.0], len(bodies))[:, None]

    assert_same(solved(scene), solved(mirrored), lambda level, k: sign * level)


@pytest.mark.parametrize("linkage", LINKAGES, ids=lambda k: type(k).__name__)
def test_the_order_and_the_names_of_bodies_do_not_matter(linkage):
    scene = scene_of(linkage)
    m = scene.mechanism
    turned = replace(scene, mechanism=replace(m, bodies=m.bodies[::-1], joints=m.joints[::-1]))
    a, b = solved(scene), solved(turned)
    rows = np.concatenate([np.arange(3 * k, 3 * k + 3) for k in range(len(m.bodies))][::-1])

    assert_same(a, b, lambda level, k: level[rows])


@pytest.mark.parametrize("linkage", LINKAGES, ids=lambda k: type(k).__name__)
def test_the_film_run_backwards_has_the_velocities_reversed(linkage):
    """f(2 - t): positions and accelerations in reverse order, velocities with the other sign."""
    forward = solved(scene_of(linkage))
    c0, c1, c2 = LAW.coefficients
    reverse = Polynomial(coefficients=(c0 + 2 * c1 + 4 * c2, -c1 - 4 * c2, c2))
    scene = scene_of(linkage, law=reverse)
    backward = solved(with_estimates(scene, lambda b: tuple(np.round(forward[b.name].q[:, -1], 2).tolist())))
    for level, sign in (("position", 1.0), ("velocity", -1.0), ("acceleration", 1.0)):
        difference = np.max(np.abs(level_of(forward, level)[:, ::-1] - sign * level_of(backward, level)), axis=0)
        # The reversed law's coefficients are rounded: its argument errs by a few ulps.
        assert np.all(difference <= 16.0 * allowed(forward, backward, level=level)), level


@pytest.mark.parametrize("linkage", LINKAGES[:2], ids=["crank-rocker", "double-crank"])
def test_another_driver_at_the_same_pose_gives_the_same_motion(linkage):
    """The rocker driven as it moved: the crank must move as it was driven."""
    by_crank = solved(scene_of(linkage))
    scene = scene_of(linkage)
    for k in range(len(TIMES)):
        phi, rate, bend = (getattr(by_crank["rocker"], name)[k] for name in ("phi", "phid", "phidd"))
        law = Polynomial(coefficients=(float(phi), float(rate), float(bend) / 2))
        bodies = tuple(replace(b, estimate=tuple(by_crank[b.name].q[:, k].tolist())) for b in scene.mechanism.bodies)
        m = replace(scene.mechanism, bodies=bodies, drivers=(AngleDriver(name="motor", body="rocker", law=law),))
        by_rocker = solved(replace(scene, mechanism=m, times=(0.0,)))
        for level in ("position", "velocity", "acceleration"):
            ours, theirs = level_of(by_crank, level)[:, k], level_of(by_rocker, level)[:, 0]
            spread = 1.0 / min(by_rocker.sigma_min[0], by_crank.sigma_min[k]) ** 2
            # The rocker's rounded rates are carried to the crank, at worst by 1/sigma for each level.
            assert np.max(np.abs(ours - theirs)) <= 64 * U * spread * max(1.0, np.max(np.abs(ours))) * 16.0, level


@pytest.mark.parametrize("linkage", LINKAGES, ids=lambda k: type(k).__name__)
def test_a_joint_stated_twice_changes_nothing(linkage):
    scene = scene_of(linkage)
    m = scene.mechanism
    twice = next(j for j in m.joints if isinstance(j, Revolute))
    again = replace(scene, mechanism=replace(m, joints=(*m.joints, replace(twice, name="again"))))

    assert_same(solved(scene), solved(again), lambda level, k: level)


@pytest.mark.parametrize("linkage", LINKAGES, ids=lambda k: type(k).__name__)
def test_twice_the_speed_is_twice_the_velocity_and_four_times_the_acceleration(linkage):
    """By a power of two: position and velocity to the bit, for times and law are scaled exactly."""
    scene = scene_of(linkage)
    fast = Polynomial(coefficients=tuple(c * 2.0**k for k, c in enumerate(LAW.coefficients)))
    a, b = solved(scene), solved(scene_of(linkage, law=fast, times=tuple(t / 2 for t in TIMES)))

    assert all(np.array_equal(2.0**k * a.levels[k], b.levels[k]) for k in range(3))


def test_a_law_and_its_rate_are_the_same_law():
    linkage = LINKAGES[0]
    rate = Integral(rate=Polynomial(coefficients=(1.3, -0.4)), initial=0.4)
    scene = scene_of(linkage)
    driver = AngleDriver(name="driver", body="crank", rate_law=rate.rate, initial=rate.initial)
    as_rate = replace(scene, mechanism=replace(scene.mechanism, drivers=(driver,)))

    assert_same(solved(scene), solved(as_rate), lambda level, k: level)


@pytest.mark.parametrize("turned", [1e9, -3e12])
def test_the_order_of_bodies_decides_no_assembly_where_a_crank_has_turned_far(turned):
    """A crank at 1e9 rad is equally far from its estimate in each of them, and the square of that swallows the rest."""
    plain = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene(samples=2)
    m = plain.mechanism
    estimates = {"crank": (0.5, 0.0, 0.0), "coupler": (2.02, 1.42, 0.95), "rocker": (3.52, 1.42, 1.9)}
    bodies = tuple(replace(body, estimate=estimates[body.name]) for body in m.bodies)
    law = Polynomial(coefficients=(turned,))
    there = [replace(m, bodies=order, drivers=(replace(m.drivers[0], law=law),)) for order in (bodies, bodies[::-1])]
    poses = [solve(Scene(mechanism=one, times=(0.0,)))["rocker"].q[:, 0] for one in there]

    assert poses[0][1] > 0.0
    np.testing.assert_allclose(*poses, rtol=0, atol=1e-6)
