"""Spatial linkages against closed forms in 40 digits, their mobility, their passive bodies, their limits."""

from __future__ import annotations

import math
from dataclasses import astuple, replace
from functools import partial
from itertools import pairwise
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
from flint import arb, ctx

import refkin
from refkin import fast
from refkin.fast.answer import _still
from refkin.joints import SPACE, Screw, SpatialDistanceDriver, SpatialPrismatic, SpatialRevolute, Spherical
from refkin.joints.spatial_drivers import DisplacementDriver, SpatialAngleDriver
from refkin.joints.spatial_frames import frame, root
from refkin.joints.spatial_vectors import Vec3
from refkin.model import Body, Mechanism, Scene
from refkin.motion import Status
from refkin.motion_laws import Polynomial
from refkin.proof.assembly import spatial as by_starts
from refkin.proof.assembly.assembly import assemblies
from refkin.proof.assembly.spatial import _SpatialReader, certain_miss, starts
from refkin.proof.numbers.preconditioned import WORSE
from refkin.proof.pose.isolate import isolate
from refkin.proof.pose.krawczyk import krawczyk
from refkin.scenes.linkages import RSCR, RSSP, RSSR, Bennett, Bricard, DoubleHooke, Hooke, RSSRChain, ScrewJack, Stewart
from refkin.scenes.linkages.base import DoesNotAssemble
from refkin.solving.mobility import count, mobility_of
from refkin.solving.starts import in_form
from refkin.system import compile_system
from tests.linkages import ROCKER, remade, without_estimates
from tests.mutation.change import mutated

EVERY = {
    "RSSR": RSSR(1.0, 3.0, 2.0, (2.5, -0.5, 0.75), (0.25, 1.0, 0.125)),
    "RSSR by distance": RSSR(1.0, 3.0, 2.0, (2.5, -0.5, 0.75), (0.25, 1.0, 0.125), massless=True),
    "RSSP": RSSP(1.0, 3.0, (0.5, 0.25, 0.5), (1.0, 0.5, 0.25)),
    "RSCR": RSCR(0.5, 2.0, 2.5, (2.5, -0.5, 0.75), (0.25, 0.5, 1.0)),
    "Bennett": Bennett(1.0, math.radians(40), math.radians(70)),
    "Hooke": Hooke(0.5),
    "double Hooke": DoubleHooke(0.5, 2.0),
    "screw jack": ScrewJack(0.1),
    "chain of ten": RSSRChain(RSSR(1.0, 3.0, 2.0, (2.5, -0.5, 0.75), (0.25, 1.0, 0.125)), 10),
}
SAMPLES = 19


def turned(linkage, samples=SAMPLES, **more):
    return refkin.solve(linkage.scene(**{"speed": 1.7, "start": 0.4, **more}, samples=samples))


@pytest.mark.parametrize("name", EVERY)
def test_a_linkage_goes_through_a_revolution_with_certified_radii(name):
    motion = turned(EVERY[name], samples=5 if "chain" in name else SAMPLES)

    assert motion.verdict is Status.OK, motion.message
    assert np.max(motion.certified_radius.position) < 1e-14
    assert np.max(motion.certified_radius.velocity) < 1e-13


@pytest.mark.parametrize("name", [name for name in EVERY if name != "screw jack"] + ["Bricard"])
def test_what_a_linkage_is_said_to_assemble_to_closes_its_joints(name):
    """A screw has a coordinate more than its bodies."""
    linkage = {**EVERY, "Bricard": Bricard(1.0, 1.2)}[name]
    m, poses = linkage.scene(start=0.9, samples=2).mechanism, linkage.assemble(0.9)
    system = compile_system(m, unit=m.unit())
    q = system.to_unit(np.concatenate([poses[body.name] for body in m.bodies]))

    assert np.max(np.abs(system.held_at(q).phi(q, 0.0))) < 1e-14


def test_a_threefold_bricard_linkage_moves_although_its_count_says_that_it_does_not():
    linkage = Bricard(1.0, 1.2)
    motion = turned(linkage, samples=3, speed=0.3, turns=0.02, start=0.9)

    assert motion.verdict is Status.OK
    assert np.max(motion.certified_radius.position) < 1e-14
    assert count(linkage.scene(start=0.9).mechanism).mobility == 0


def angle(motion, body, axis, zero):
    """Return the angle of a body's x axis about an axis of the ground, from a vector across it."""
    f, g, _ = (np.array(v.parts, float) for v in frame(axis, zero))
    x = motion[body].rotation[:, 0]
    return np.arctan2(g @ x, f @ x)


def off(a, b):
    """Return how far two angles differ, whole turns aside."""
    return np.max(np.abs((np.array(a) - np.array(b, float) + np.pi) % (2 * np.pi) - np.pi))


@pytest.mark.parametrize("name", ["RSSR", "RSCR"])
def test_the_rocker_goes_where_a_circle_meets_a_sphere_or_a_cylinder(name):
    """P cos psi + Q sin psi = K in 40 digits; the rates by derivatives of that."""
    linkage = EVERY[name]
    motion = turned(linkage)
    with mpmath.workdps(40):
        f, g = exact_frame(linkage.axis)
        a, r, length = (mpmath.mpf(x) for x in (linkage.crank, linkage.rocker, linkage.coupler))

        def psi(t):
            theta = mpmath.mpf(0.4) + mpmath.mpf(1.7) * t
            w = mpmath.matrix([a * mpmath.cos(theta), a * mpmath.sin(theta), 0]) - mpmath.matrix(linkage.pivot)
            p, q = dot(w, f), dot(w, g)
            k = ((dot(w, w) if name == "RSSR" else p * p + q * q) + r * r - length * length) / (2 * r)
            return mpmath.atan2(q, p) + mpmath.acos(k / mpmath.hypot(p, q))

        times = [mpmath.mpf(float(t)) for t in motion.t]
        truth = [[mpmath.diff(psi, t, n) if n else psi(t) for t in times] for n in range(3)]
    zero = tuple(float(x) for x in f)
    h = np.array(linkage.axis) / np.linalg.norm(linkage.axis)

    assert off(angle(motion, "rocker", linkage.axis, zero), truth[0]) < 4e-15
    assert h @ motion["rocker"].omega == pytest.approx(np.array(truth[1], float), abs=4e-15)
    assert h @ motion["rocker"].alpha == pytest.approx(np.array(truth[2], float), abs=2e-14)


def test_the_angles_of_bricards_linkage_fulfil_his_closure():
    """The equation of Chen, You and Tarnai in 40 digits, and its derivatives; axes as written fulfil it nearly."""
    twist, start, speed = 1.2, 0.9, 0.3
    motion = turned(Bricard(1.0, twist), samples=3, speed=speed, turns=0.02, start=start)
    with mpmath.workdps(40):
        c, s = mpmath.cos(twist), mpmath.sin(twist)

        def second(t):
            value = mpmath.mpf(start) + mpmath.mpf(speed) * t
            p, q = s * s + (1 + c * c) * mpmath.cos(value), -2 * c * mpmath.sin(value)
            k = -(c * c + s * s * mpmath.cos(value)) / mpmath.hypot(p, q)
            return mpmath.atan2(q, p) + mpmath.acos(k)

        times = [mpmath.mpf(float(t)) for t in motion.t]
        truth = [[mpmath.diff(second, t, n) if n else second(t) for t in times] for n in range(3)]
    one, two = motion["link1"], motion["link2"]

    assert off(second_angle(motion, twist), truth[0]) < 2e-15
    for exact, a, b in ((truth[1], one.omega, two.omega), (truth[2], one.alpha, two.alpha)):
        along = np.sum(two.rotation[:, 2] * (b - a), axis=0)
        assert along == pytest.approx(np.array(exact, float), abs=2e-15)


def second_angle(motion, twist):
    """Return the angle from the first to the second link of a loop of hinges, about the hinge between them."""
    c, s = math.cos(twist), math.sin(twist)
    seen = np.einsum("ijt,ikt->jkt", motion["link1"].rotation, motion["link2"].rotation)  # of link 2 by link 1
    hinged = np.einsum("ij,jkt->ikt", np.array([[1, 0, 0], [0, c, s], [0, -s, c]]), seen)
    return np.arctan2(hinged[1, 0], hinged[0, 0])


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def exact_frame(axis):
    """Return f and g of an axis without a zero, in the precision in force."""
    h = mpmath.matrix([mpmath.mpf(x) for x in axis])
    h = h / mpmath.norm(h)
    least = [abs(x) for x in axis].index(min(abs(x) for x in axis))
    z = mpmath.matrix([1 if k == least else 0 for k in range(3)])
    f = z - h * dot(h, z)
    f = f / mpmath.norm(f)
    g = mpmath.matrix([h[1] * f[2] - h[2] * f[1], h[2] * f[0] - h[0] * f[2], h[0] * f[1] - h[1] * f[0]])
    return f, g


def test_an_rssp_is_the_line_that_meets_a_sphere():
    linkage = EVERY["RSSP"]
    motion = turned(linkage)
    with mpmath.workdps(40):
        u = mpmath.matrix(linkage.axis)
        u, guide = u / mpmath.norm(u), mpmath.matrix(linkage.guide)

        def shift(t):
            theta = mpmath.mpf(0.4) + mpmath.mpf(1.7) * t
            w = mpmath.matrix([mpmath.cos(theta), mpmath.sin(theta), 0]) - guide
            return dot(w, u) + mpmath.sqrt(9 - dot(w, w) + dot(w, u) ** 2)

        truth = [[shift(mpmath.mpf(float(t))) for t in motion.t]]
        truth += [[mpmath.diff(shift, mpmath.mpf(float(t)), n) for t in motion.t] for n in (1, 2)]
    h = np.array(linkage.axis) / np.linalg.norm(linkage.axis)
    slider = motion["slider"]
    pair = h @ (slider.q[:3] - np.array(linkage.guide)[:, None]), h @ slider.qd[:3], h @ slider.qdd[:3]

    for ours, exact in zip(pair, truth, strict=True):
        assert ours == pytest.approx(np.array(exact, float), abs=2e-14)
    assert np.max(np.abs(slider.omega)) < 1e-14


@pytest.mark.parametrize("beta", [0.5, 0.7])
def test_a_hooke_joint_turns_at_the_ratio_of_the_textbook_within_its_radii(beta):
    """In 40 digits, of the axis as it is written; a rate is off by 2 |dp'| + 2 |p'| |dp|."""
    motion = turned(Hooke(beta), samples=61)
    radius = motion.certified_radius
    with mpmath.workdps(40):
        y, z = -mpmath.sin(mpmath.mpf(beta)), mpmath.cos(mpmath.mpf(beta))
        y, z = mpmath.mpf(float(y)), mpmath.mpf(float(z))
        theta = [mpmath.mpf(0.4) + mpmath.mpf(1.7) * mpmath.mpf(float(t)) for t in motion.t]
        scale = mpmath.hypot(y, z)
        truth = [mpmath.mpf(1.7) * (z / scale) / (1 - (y / scale) ** 2 * mpmath.sin(x) ** 2) for x in theta]
    output = motion["output"]
    error = np.abs(np.array([0.0, y, z], float) @ output.omega - np.array(truth, float))
    allowed = 4 * radius.velocity + 4 * np.max(np.abs(output.qd), axis=0) * radius.position

    assert (error <= allowed + 16 * 2.0**-53 * np.array(truth, float)).all()
    assert np.max(error) < 2e-15


@pytest.mark.parametrize("parallel", [True, False])
def test_two_matched_hooke_joints_turn_evenly(parallel):
    even = turned(DoubleHooke(0.5, 2.0, parallel=parallel))
    last = np.array([0.0, 0.0, 1.0]) if parallel else np.array([0.0, -math.sin(1.0), math.cos(1.0)])

    assert last @ even["output"].omega == pytest.approx(np.full(SAMPLES, 1.7), abs=4e-15)
    assert np.max(np.abs(even["output"].alpha)) < 2e-14


def test_joints_in_several_forms_are_brought_into_one():
    """Only a mechanism whose rows all are in it stays as it is."""
    half = in_form(RSSR(1.0, 3.0, 2.0, (2.5, -0.5, 0.75), (0.25, 1.0, 0.125)).scene().mechanism, "half")
    dot = in_form(half, "dot")
    mixed = replace(half, joints=(dot.joints[0], *half.joints[1:]))

    assert dot != half == in_form(mixed, "half")
    assert in_form(half, "half") is half
    printed = in_form(half, "printed")  # of drivers there is no such form
    assert [part.form for part in (printed.joints[0], *printed.drivers)] == ["printed", "dot"]
    assert in_form(printed, "printed") is printed
    spaced = replace(half, joints=(replace(printed.joints[0], spacing=2.0), *half.joints[1:]))
    assert in_form(spaced, "printed").joints[0].spacing == 2.0
    assert in_form(mixed, "") is mixed


def test_the_angles_of_bennetts_linkage_have_the_product_that_he_found():
    alpha, beta = math.radians(40), math.radians(70)
    motion = turned(Bennett(1.0, alpha, beta))
    theta, other = 0.4 + 1.7 * motion.t, second_angle(motion, alpha)
    ratio = math.sin((beta + alpha) / 2) / math.sin((beta - alpha) / 2)

    # The lengths as written fulfil his condition up to rounding.
    assert np.sin(theta / 2) * np.sin(other / 2) == pytest.approx(
        ratio * np.cos(theta / 2) * np.cos(other / 2), abs=1e-13
    )


def test_a_screw_counts_its_turns():
    """At 1e4 rad the shift is pitch times the angle, not a turn more or less."""
    law = Polynomial(coefficients=(1e4, 1.0))
    motion = refkin.solve(ScrewJack(0.1).scene(law=law, times=(0.0, 1.0)))

    assert motion.verdict is Status.OK
    assert motion["screw"].z == pytest.approx([1000.0, 1000.1], rel=1e-15, abs=0.0)
    assert motion["platform"].zd == pytest.approx([0.1, 0.1], rel=1e-14, abs=0.0)


def test_a_screw_whose_turn_is_zero_at_first_is_followed_with_radii_at_all_times():
    """Its own coordinate hides entries of phi_q there; and rows that serve elsewhere depend on each other."""
    motion = refkin.solve(ScrewJack(0.8).scene(samples=5))

    assert motion.verdict is Status.OK
    assert np.max(motion.certified_radius.position) < 1e-14


def test_rows_are_chosen_at_each_pose():
    """Those of the first pose are nearly dependent half a turn later: the bound of acceleration was 6e-8 there."""
    motion = turned(EVERY["Bennett"], samples=37)

    assert motion.verdict is Status.OK
    assert np.max(motion.certified_radius.acceleration) < 1e-13
    assert "the bounds cover inverses of a Frobenius norm up to 3 / sigma_min of all rows" in motion.message


def off_by_ulps(ulps):
    """Return a scene of a Bennett linkage, one of whose lengths is off, and its system."""
    scene = Bennett(1.0, 0.7, 1.2).scene(speed=1.0, start=0.4, samples=2)
    first, second, *rest = scene.mechanism.joints
    longer = replace(second, point_i=(second.point_i[0] * (1 + ulps * 2.0**-52), 0.0, 0.0))
    scene = replace(scene, mechanism=replace(scene.mechanism, joints=(first, longer, *rest)))
    return scene, compile_system(scene.mechanism, unit=scene.mechanism.unit())


def farthest_root(system, levels, t):
    """Return how far off levels are of the roots of rows that serve as well, drawn from hundreds, by balls."""
    slope, farthest = system.held_at(levels[0]).phi_q(levels[0], t), np.zeros(len(levels))
    limit, random = WORSE / np.linalg.svd(slope, compute_uv=False)[-1], np.random.default_rng(3)
    for _ in range(8):
        rows = np.arange(24)
        while len(rows) > 21 or np.linalg.norm(1 / (np.linalg.svd(slope[rows], compute_uv=False) + 1e-30)) > limit:
            rows = np.sort(random.permutation(24)[:21])
        root = krawczyk(system, levels[0], t, rows=rows)
        farthest = np.fmax(farthest, [np.max(distance) for distance in root.distances(*levels)])
    return farthest


@pytest.mark.parametrize("ulps", [0, 16])
def test_radii_hold_for_choices_of_rows_that_serve_as_well(ulps):
    scene, system = off_by_ulps(ulps)
    motion = refkin.solve(replace(scene, times=scene.times[:1]))
    levels = [system.to_unit(level, order)[:, 0] for order, level in enumerate((motion.q, motion.qd, motion.qdd))]
    farthest, radii = farthest_root(system, levels, 0.0), astuple(motion.certified_radius)

    assert (farthest <= [radius[0] for radius in radii]).all()
    assert (farthest > [0.3 * radius[0] for radius in radii]).all(), "and are not much larger than that"


@pytest.mark.parametrize("ulps", [0, 16])
def test_radii_of_a_path_hold_for_choices_of_rows_that_serve_as_well(ulps):
    scene, system = off_by_ulps(ulps)
    path = refkin.follow(scene, until=(0.0, 2.0))

    for k in range(0, path.t.size, 5):
        assert farthest_root(system, [system.to_unit(path.q[:, k])], float(path.t[k])) <= path.radius[k]


MOBILITIES = {
    "RSSR": (2, 2, 0),
    "RSSR by distance": (1, 1, 0),
    "RSCR": (1, 1, 0),
    "Bennett": (-2, 1, 3),
    "Hooke": (-2, 1, 3),
    "double Hooke": (1, 1, 0),
}


@pytest.mark.parametrize("name", MOBILITIES)
def test_mobility_by_count_and_by_rank_with_the_redundant_rows_by_name(name):
    scene = EVERY[name].scene(start=0.4)
    system = compile_system(scene.mechanism, unit=scene.mechanism.unit())
    q = system.to_unit(refkin.solve(EVERY[name].scene(start=0.4, samples=2)).q[:, 0])
    by_count, by_rank, redundant = MOBILITIES[name]
    result = mobility_of(system, q)

    assert (count(scene.mechanism).mobility, result.mobility) == (by_count, by_rank)
    assert len(result.joints.dependent) == redundant
    assert all(d.row.partition("[")[0] in {j.name for j in scene.mechanism.joints} for d in result.joints.dependent)


def test_the_coupler_of_an_rssr_spins_passively_and_is_named():
    scene = EVERY["RSSR"].scene(start=0.4, samples=2)
    motion = refkin.solve(scene)
    system = compile_system(scene.mechanism, unit=scene.mechanism.unit())

    assert count(scene.mechanism).passive == ("coupler",)
    assert "passive degree of freedom: coupler spins about (1, 0, 0) through (0, 0, 0) of its own" in motion.message
    (words,) = mobility_of(system, system.to_unit(motion.q[:, 0])).passive
    assert words.startswith("coupler spins about")
    assert mobility_of(system, system.to_unit(motion.q[:, 0])).driven.freedoms == 1


TURNING_OVER = {"crank": 3.0, "coupler": 3.2, "rocker": 3.0, "pivot": (0.8, 0.3, 0.4), "axis": (0.1, 0.2, 1.0)}


def test_a_coupler_whose_frame_is_far_away_does_not_spin_either():
    """Its rates are those of balls then: at each time it is held as it stands there, not as it stood at first."""
    far, linkage = (300.0, -200.0, 100.0), RSSP(1.0, 3.0, (0.5, 0.25, 0.5), (1.0, 0.5, 0.25))
    scene = linkage.scene(law=Polynomial(coefficients=(0.4, 1.0)), times=(0.0, 0.5))
    m, points = scene.mechanism, {"S1": "point_j", "S2": "point_i"}
    rod = [tuple(np.add(getattr(j, points[j.name]), far)) for j in m.joints if j.name in points]
    joints = [replace(j, **{points[j.name]: rod.pop(0)}) if j.name in points else j for j in m.joints]
    there = remade(without_estimates(scene, "crank", "slider"), joints=tuple(joints))
    here, moved = refkin.solve(scene), refkin.solve(there)

    assert moved.verdict is Status.OK
    assert np.max(np.abs(moved["rod"].omega - here["rod"].omega)) < 1e-9


@pytest.mark.parametrize("certified", [False, True])
def test_a_coupler_that_turns_over_is_followed_and_does_not_spin(certified):
    with_body, without = (RSSR(**TURNING_OVER, massless=m).scene(samples=91, start=0.4) for m in (False, True))
    motion, other = refkin.solve(with_body, certified=certified), refkin.solve(without)
    p, coupler = motion["coupler"].q[3:], motion["coupler"]
    line = coupler.rotation[:, 0]

    assert motion.verdict is Status.OK
    assert np.min(np.abs(p[:, 0] @ p)) < 0.5, "it turns over"
    for body in ("crank", "rocker"):
        assert np.max(np.abs(motion[body].q - other[body].q)) < 1e-15
        assert np.max(np.abs(motion[body].qdd - other[body].qdd)) < 1e-14
    assert np.max(np.abs(np.sum(coupler.omega * line, axis=0))) < 1e-15
    assert np.max(np.abs(np.sum(coupler.alpha * line, axis=0))) < 4e-15


def test_the_plain_analysis_follows_a_coupler_that_turns_over():
    motion = refkin.analysis.sweep(RSSR(**TURNING_OVER).scene(samples=91, start=0.4))

    assert motion.verdict is Status.OK


FORMS = ("half", "dot", "printed")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", ["RSSR", "RSSP", "double Hooke"])
def test_joints_in_every_form_give_one_motion(name, form):
    half, other = (
        refkin.solve(type(EVERY[name])(**vars(EVERY[name]) | {"form": f}).scene(start=0.4, samples=7))
        for f in ("half", form)
    )

    assert other.verdict is Status.OK
    assert np.max(np.abs(half.q - other.q)) < 4e-15
    assert np.max(np.abs(half.qdd - other.qdd)) < 2e-13


@pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12])
def test_near_its_limit_an_rssr_is_solved_or_says_that_it_is_not(distance):
    """The rocker reaches furthest where K^2 = P^2 + Q^2; the errors grow as 1/sqrt(d), and no ok is wrong."""

    def margin(theta):
        with mpmath.workdps(40):
            f, g = exact_frame(LIMITED.axis)
            w = mpmath.matrix([mpmath.cos(theta), mpmath.sin(theta), 0]) - mpmath.matrix(LIMITED.pivot)
            k = (dot(w, w) + 4 - mpmath.mpf(LIMITED.coupler) ** 2) / 4
            return 1 - abs(k) / mpmath.hypot(dot(w, f), dot(w, g))

    with mpmath.workdps(40):
        inside = next(x / 50 for x in range(315) if margin(mpmath.mpf(x) / 50) > 0)
        limit = mpmath.findroot(margin, (inside - 0.02, inside), solver="anderson", tol=1e-60)
        theta = float(limit) + distance
        w = mpmath.matrix([mpmath.cos(theta), mpmath.sin(theta), 0]) - mpmath.matrix(LIMITED.pivot)
        f, g = exact_frame(LIMITED.axis)
        p, q = dot(w, f), dot(w, g)
        k = (dot(w, w) + 4 - mpmath.mpf(LIMITED.coupler) ** 2) / 4
        truth = [float(mpmath.atan2(q, p) + s * mpmath.acos(k / mpmath.hypot(p, q))) for s in (1, -1)]
    motion = refkin.solve(LIMITED.scene(law=Polynomial(coefficients=(theta,)), times=(0.0,)))

    assert motion.verdict in (Status.OK, Status.SINGULAR)
    if motion.verdict is Status.OK:
        psi = angle(motion, "rocker", LIMITED.axis, tuple(float(x) for x in f))
        error = min(off(psi, t) for t in truth)
        assert error < 4 * motion.certified_radius.position[0] + 1e-15
    assert motion.verdict is Status.OK or distance < 1e-11


def test_an_rssr_is_followed_through_its_limit():
    start = next(x / 10 for x in range(63) if _assembles(LIMITED, x / 10) and _assembles(LIMITED, x / 10 + 0.2))
    law = Polynomial(coefficients=(start + 0.1, 1.0))
    path = refkin.follow(LIMITED.scene(law=law, times=(0.0,)), most_points=60)

    assert len(path.turning_points) >= 1
    assert np.max(path.residual) < 1e-13


def _assembles(linkage, value):
    try:
        linkage.assemble(value)
    except refkin.RefkinError:
        return False
    return True


LIMITED = RSSR(1.0, 1.2, 2.0, (2.5, 0.5, 0.75), (0.25, 0.2, 1.0), massless=True)
SHORT = RSSP(1.0, 1.1, (0.5, 0.75, 0.5), (1.0, 0.5, 0.25))


@pytest.mark.parametrize("linkage", [LIMITED, SHORT], ids=["RSSR", "RSSP"])
def test_a_link_is_proved_not_to_reach_exactly_where_the_closed_form_says_so(linkage):
    """At 40 inputs: a proof where it does not assemble, none where it does."""
    inside = next(x / 10 for x in range(63) if _assembles(linkage, x / 10))
    scene = linkage.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=(inside,))
    system = compile_system(scene.mechanism, unit=scene.mechanism.unit())
    inputs = [0.1 + 0.15 * k for k in range(40)]
    proved = [certain_miss(system, value) is not None for value in inputs]

    assert proved == [not _assembles(linkage, value) for value in inputs]
    assert set(proved) == {False, True}


def _held_twice(joint, driver, first, second):
    """A bolt on one joint of the ground that two drivers move as two laws say."""
    x, z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    axes = {"zero_i": x, "zero_j": x, "axis_i": z, "axis_j": z}
    ends = {"body_i": "ground", "body_j": "bolt", "point_i": (0.0, 0.0, 4.0), "point_j": (0.0, 0.0, 0.0)}
    drivers = tuple(driver(name=name, joint="J", law=law) for name, law in (("one", first), ("other", second)))
    body = Body(name="bolt", estimate=(0.0, 0.0, 4.0, 1.0, 0.0, 0.0, 0.0))
    return Mechanism((body,), (joint(name="J", **axes, **ends),), drivers)


TURNS, SHIFTS = (SpatialRevolute, SpatialAngleDriver), (SpatialPrismatic, DisplacementDriver)


@pytest.mark.parametrize(
    ("kinds", "off", "missing"),
    [
        (TURNS, 0.5, "other asks for an angle of J that is 0.5 rad off that of one"),
        (SHIFTS, 0.5, "other asks for a displacement of J that is 0.5 m off that of one"),
        (TURNS, -1e-9 - math.tau, "other asks for an angle of J that is 1e-09 rad off that of one"),
        (TURNS, 6 * math.tau, ""),
        (TURNS, 0.0, ""),
        (SHIFTS, 0.0, ""),
    ],
)
def test_drivers_of_one_joint_that_contradict_each_other_are_told(kinds, off, missing):
    """It was: the search found none."""
    laws = (Polynomial(coefficients=(value, 1.0)) for value in (0.25, 0.25 + off))
    motion = refkin.solve(Scene(mechanism=_held_twice(*kinds, *laws), times=(0.0, 0.5)))

    assert motion.verdict is (Status.UNASSEMBLABLE if missing else Status.OK)
    assert motion.message.startswith(missing)


@pytest.mark.parametrize(("kinds", "first", "second"), [(TURNS, 2.5, 2.5 + 6 * math.tau), (SHIFTS, 0.3, 0.1 + 0.2)])
def test_drivers_of_one_joint_that_agree_but_for_rounding_are_no_contradiction_without_an_estimate(
    kinds, first, second
):
    """With one Newton's method decides, and nothing is asked for a proof."""
    mechanism = _held_twice(*kinds, *(Polynomial(coefficients=(value, 1.0)) for value in (first, second)))
    mechanism = replace(mechanism, bodies=(replace(mechanism.bodies[0], estimate=None),))

    assert refkin.solve(Scene(mechanism=mechanism, times=(0.0,))).verdict is Status.OK


def test_drivers_of_a_screw_count_turns_and_those_of_two_joints_have_laws_of_their_own():
    first, second = (Polynomial(coefficients=(value,)) for value in (0.25, 0.25 + math.tau))
    screwed = _held_twice(partial(Screw, pitch=0.5), SpatialAngleDriver, first, second)
    sliding = replace(screwed, drivers=(screwed.drivers[0], DisplacementDriver(name="shift", joint="J", law=second)))
    one = _held_twice(*TURNS, first, first)
    other = replace(one.joints[0], name="K", body_i="bolt", body_j="nut")
    nut, turned = (
        replace(one.bodies[0], name="nut", estimate=None),
        replace(one.drivers[1], joint="K", law=Polynomial(coefficients=(1.5,))),
    )
    two = Mechanism((*one.bodies, nut), (*one.joints, other), (one.drivers[0], turned))
    twice, both, of_two = (refkin.solve(Scene(mechanism=m, times=(0.0,))) for m in (screwed, sliding, two))

    assert twice.message.startswith("other asks for an angle of J that is 6.28319 rad off that of one")
    assert (both.verdict, of_two.verdict) == (Status.NOT_CONVERGED, Status.OK)


@pytest.mark.parametrize("seed", range(4))
def test_balls_of_one_body_that_agree_but_for_rounding_are_assembled_beside_bodies_that_nothing_drives(seed):
    """Three rows are redundant and three are lacking: of rows there were none too many, and 2e-15 m were missing."""
    draw, place = np.random.default_rng(seed), np.array([300.0, 100.0, 70.0])
    turn, ends = draw.normal(size=4), draw.normal(size=(3, 3))
    there = place + ends @ SPACE.values(*place, *(turn / np.linalg.norm(turn))).rotation().T
    pairs = [
        {"body_i": "ground", "point_i": at, "body_j": "plate", "point_j": u} for at, u in zip(there, ends, strict=True)
    ]
    balls = [Spherical(name=f"ball {k}", **pair) for k, pair in enumerate(pairs)]
    hinge = {"body_i": "ground", "point_i": place, "point_j": ends[0], "axis_i": turn[:3], "axis_j": turn[:3]}
    hinges = [SpatialRevolute(name=f"hinge of {k}", body_j=f"bolt {k}", **hinge) for k in range(3)]
    bodies = [Body(name=name, estimate=(*place, *turn)) for name in ("plate", "bolt 0", "bolt 1", "bolt 2")]
    motion = refkin.solve(Scene(mechanism=Mechanism(bodies, (*balls, *hinges)), times=(0.0,)))

    assert motion.verdict is Status.SINGULAR, motion.message
    assert "idle motion" in motion.message


@pytest.mark.parametrize("length", [0.3, 9.0])
def test_a_link_to_a_point_on_a_hinge_misses_its_circle_by_as_much_as_the_nearest_angle_leaves(length):
    """The point lies beside the hinge's own axis and above its place on it."""
    hinge = {"point_i": (0.5, -0.25, 1.0), "axis_i": (1.0, 2.0, 2.0), "point_j": (0.25, 0.5, 0.0), "axis_j": (0, 3, 4)}
    joint = SpatialRevolute(name="R", body_i="ground", body_j="arm", **hinge)
    body = Body(name="arm", estimate=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    law, ends = Polynomial(coefficients=(1.0,)), {"point_i": (0.0, 0.0, 0.0), "point_j": (1.0, 0.0, 0.0)}
    driver = SpatialDistanceDriver(name="d", body_i="ground", body_j="arm", **ends, law=law)
    system = compile_system(Mechanism((body,), (joint,), (driver,)))
    u, near, z = np.array([1.0, -0.5, 2.0]), np.array([2.0, 1.0, -0.5]), np.array([1.0, 2.0, 2.0]) / 3
    own, axis = u - hinge["point_j"], np.array([0.0, 3.0, 4.0]) / 5
    height, radius = own @ axis, np.linalg.norm(own - (own @ axis) * axis)
    x = np.cross(z, [1.0, 0.0, 0.0]) / np.linalg.norm(np.cross(z, [1.0, 0.0, 0.0]))
    angles = np.linspace(0.0, 2 * np.pi, 4001)[:, None]
    circle = hinge["point_i"] + height * z + radius * (np.cos(angles) * x + np.sin(angles) * np.cross(z, x))
    distances = np.linalg.norm(circle - near, axis=1)
    missed = max(distances.min() - length, length - distances.max())

    with ctx.workprec(120):
        gap = _SpatialReader(system, 0.0).gap(Vec3(*map(arb, near.tolist())), tuple(u), "arm", arb(length))
    assert missed > 0.1
    assert float(gap) == pytest.approx(missed, rel=1e-5)


def test_a_sweep_into_a_limit_ends_there_and_proves_that_it_goes_no_further():
    start = next(x / 10 for x in range(63) if _assembles(LIMITED, x / 10))
    motion = refkin.solve(LIMITED.scene(start=start + 0.1, speed=1.0, samples=19))

    assert motion.status[0] is Status.OK
    assert Status.UNASSEMBLABLE in motion.status
    assert "L does not reach rocker: at least" in motion.message


def test_of_a_stewart_platform_on_three_points_two_legs_are_at_each():
    platform = Stewart.three_three()

    assert len(set(platform.base)) == len(set(platform.platform)) == 3
    assert platform.lengths() == pytest.approx([math.sqrt(1.0**2 + 0.6**2 - 1.0 * 0.6 + 0.8**2)] * 6)


def test_a_stewart_platform_on_three_points_has_eight_assemblies_each_certified():
    mechanism = Stewart.three_three().scene(samples=2).mechanism
    system = compile_system(mechanism, unit=mechanism.unit())
    poses = assemblies(system, 0.3).poses

    assert len(poses) == 8
    assert isolate(system, np.array(poses).T, np.full(8, 0.3)).ok.all()


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_a_body_a_quarter_turn_back_on_its_hinge_is_in_one_assembly_and_not_in_two(axis):
    """The sum of its Euler parameters is 0 but for rounding, which decides on the sign of p."""
    ends = {"point_i": (0.0, 0.0, 0.0), "axis_i": axis, "point_j": (0.0, 0.0, 0.0), "axis_j": axis}
    zeros = dict.fromkeys(("zero_i", "zero_j"), (1.0, 2.0, 3.0))
    hinge = SpatialRevolute(name="hinge", body_i="ground", body_j="door", **ends, **zeros)
    motor = SpatialAngleDriver(name="motor", joint="hinge", law=Polynomial(coefficients=(-math.pi / 2,)))
    mechanism = Mechanism((Body(name="door"),), (hinge,), (motor,))

    assert len(assemblies(compile_system(mechanism, unit=mechanism.unit()), 0.0).poses) == 1


@pytest.mark.parametrize("estimate", [None, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)])
def test_a_body_half_a_turn_from_its_estimate_is_in_the_only_assembly_and_not_in_one_of_two(estimate):
    """Three doors, each hung on the one before; p and -p of the second are as far from no turn as each other."""
    doors, hinges, motors = ("ground", "a", "b", "c"), [], []
    lines = dict.fromkeys(("axis_i", "axis_j"), (1.0, 2.0, -1.0)) | dict.fromkeys(("zero_i", "zero_j"), (1.0, 2.0, 3.0))
    for i, j in pairwise(doors):
        points = {"point_i": (0.5 * (i != "ground"), 0.0, 0.0), "point_j": (0.0, 0.0, 0.0)}
        hinges.append(SpatialRevolute(name=f"hinge {j}", body_i=i, body_j=j, **points, **lines))
        law = Polynomial(coefficients=(-math.pi / 2,))
        motors.append(SpatialAngleDriver(name=f"motor {j}", joint=f"hinge {j}", law=law))
    bodies = tuple(Body(name=name, estimate=estimate) for name in doors[1:])

    motion = refkin.solve(Scene(mechanism=Mechanism(bodies, hinges, motors), times=(0.0,)))

    assert "the only" in motion.message
    assert "2 found" not in motion.message


Z, X = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)


def spatial(scene, balls=()):
    """Return a planar scene as one of space, with hinges about z, slides across z; some pins are balls."""
    bodies = []
    for b in scene.mechanism.bodies:
        px, py, phi = b.estimate
        bodies.append(Body(name=b.name, estimate=(px, py, 0.0, math.cos(phi / 2), 0.0, 0.0, math.sin(phi / 2))))
    joints = tuple(in_space(j, j.name in balls) for j in scene.mechanism.joints)
    (driver,) = scene.mechanism.drivers
    motor = refkin.SpatialAngleDriver(name="driver", joint="A0", law=driver.law)
    return Scene(mechanism=Mechanism(tuple(bodies), joints, (motor,)), times=scene.times)


def in_space(j, ball):
    ends = {"name": j.name, "body_i": j.body_i, "point_i": (*j.point_i, 0.0)}
    ends |= {"body_j": j.body_j, "point_j": (*j.point_j, 0.0)}
    if isinstance(j, refkin.Distance):
        return refkin.SpatialDistance(**ends, length=j.length)
    if isinstance(j, refkin.Prismatic):
        (x, y), c, s = j.axis_i, math.cos(j.angle), math.sin(j.angle)
        axes = {"axis_i": (x, y, 0.0), "axis_j": (c * x + s * y, c * y - s * x, 0.0)}
        return refkin.SpatialPrismatic(**ends, **axes, zero_i=Z, zero_j=Z)
    if isinstance(j, refkin.PointOnLine):
        x, y = j.axis_i
        return refkin.PointOnPlane(**ends, axis_i=(-y, x, 0.0))
    line = {"axis_i": Z, "axis_j": Z, "zero_i": X, "zero_j": X}
    return refkin.Spherical(**ends) if ball else refkin.SpatialRevolute(**ends, **line)


def massless(scene):
    """Return a four-bar whose coupler is a distance."""
    m = scene.mechanism
    (a, b) = (next(j for j in m.joints if j.name == name) for name in "AB")
    ends = {"body_i": "crank", "point_i": a.point_i, "body_j": "rocker", "point_j": b.point_j}
    link = refkin.Distance(name="L", **ends, length=math.dist(a.point_j, b.point_i))
    joints = tuple(j for j in m.joints if j.name not in "AB")
    return replace(scene, mechanism=Mechanism((m.bodies[0], m.bodies[2]), (*joints, link), m.drivers))


FOUR_BAR = ROCKER.scene(samples=9, start=0.3)
PLANAR = {
    "four-bar, balls at the coupler": (FOUR_BAR, "AB"),
    "four-bar, hinges alone": (FOUR_BAR, ""),
    "four-bar, a massless coupler": (massless(FOUR_BAR), ""),
    "slider-crank, balls at the rod": (refkin.SliderCrank(1.0, 3.0, 0.25).scene(samples=9, start=0.3), "AB"),
    "slider-crank, hinges alone": (refkin.SliderCrank(1.0, 3.0, 0.25).scene(samples=9, start=0.3), ""),
    "inverted slider-crank": (refkin.InvertedSliderCrank(2.0, 1.0, 0.5).scene(samples=9, start=0.3), ""),
}


@pytest.mark.parametrize("name", PLANAR)
def test_a_planar_linkage_written_as_a_spatial_scene_has_the_planar_answer(name):
    """To 1e-15 of a pose, and of the largest rate. With hinges or slides alone three rows are redundant."""
    scene, balls = PLANAR[name]
    plane, space = refkin.solve(scene), refkin.solve(spatial(scene, balls))

    assert space.verdict is Status.OK
    for body in plane.bodies:
        ours, theirs = space[body], plane[body]
        turn = 2 * np.arctan2(ours.q[6], ours.q[3]) - theirs.phi
        pose = np.array([ours.x - theirs.x, ours.y - theirs.y, (turn + np.pi) % (2 * np.pi) - np.pi])
        levels = ((ours.qd, ours.omega, theirs.qd), (ours.qdd, ours.alpha, theirs.qdd))

        assert np.max(np.abs([*pose, ours.z])) < 1e-15
        for rates, turning, plain in levels:
            assert np.max(np.abs([*rates[:2], turning[2]] - plain)) < 1e-15 * max(1.0, np.max(np.abs(plain)))


def test_a_stewart_platform_goes_with_its_six_legs():
    """From a phase on; the parameters of its home are scaled to length 1, as those of an estimate are."""
    platform = Stewart.three_three()
    motion = refkin.solve(platform.scene(speed=1.0, samples=13))
    later = refkin.solve(platform.scene(speed=1.0, start=motion.t[1], turns=0.5, samples=7))

    assert motion.verdict is Status.OK
    assert np.max(motion.certified_radius.acceleration) < 1e-14
    assert later["platform"].q == pytest.approx(motion["platform"].q[:, 1:8], abs=1e-14)
    assert replace(platform, home=(*platform.home[:3], 2.0, 0.0, 0.0, 0.0)).lengths() == platform.lengths()


def test_a_law_that_no_stewart_platform_goes_by_is_refused():
    """Its rate at t = 0 was taken for all times: by this law the legs stood still, and all was ok."""
    with pytest.raises(refkin.InvalidScene, match="Stewart: law: expected a polynomial of degree 1 at most, got Pol"):
        Stewart.three_three().scene(law=Polynomial(coefficients=(0.0, 0.0, 1.0)), times=(0.0, 1.0))


@pytest.mark.parametrize("name", ["RSSR", "RSSR by distance", "RSSP"])
def test_the_fast_path_proves_linkages_of_space_by_its_own_program(name, monkeypatch):
    """A passive coupler has the rates that it has without spin; how far it is turned itself is nobody's."""
    scene = EVERY[name].scene(speed=1.7, start=0.4, samples=19)
    reference = refkin.solve(scene)
    monkeypatch.setattr("refkin.fast.answer.isolate_every_choice", None)
    motion = fast.attempt(scene)
    ours, theirs = motion.certified_radius, reference.certified_radius

    assert np.max(ours.position) < 1e-14
    for body in set(motion.bodies) - {"coupler", "rod"}:
        assert np.max(np.abs(motion[body].q - reference[body].q)) <= np.max(ours.position + theirs.position)
    for body in motion.bodies:
        assert np.max(np.abs(motion[body].omega - reference[body].omega)) <= 8 * np.max(ours.velocity)
        assert np.max(np.abs(motion[body].alpha - reference[body].alpha)) <= 8 * np.max(ours.acceleration)
        assert np.max(np.abs(motion[body].qdd[:3] - reference[body].qdd[:3])) <= 8 * np.max(ours.acceleration)


def test_the_fast_path_solves_no_more_of_a_chain_than_what_is_wanted():
    scene = RSSRChain(EVERY["RSSR"], 2).scene(start=0.4, samples=5, evidence=("certificate",))
    scene = replace(scene, bodies_wanted=("rocker1",))
    motion, reference = fast.attempt(scene), refkin.solve(scene)

    assert "rocker2" not in fast.legend(scene)
    assert np.max(np.abs(motion.q - reference.q)) < 1e-14
    assert np.max(np.abs(motion.qdd - reference.qdd)) < 1e-13


def test_families_of_space_are_refused_by_name():
    with pytest.raises(refkin.RefkinError, match="is spatial: `solve_many` takes planar families"):
        fast.solve_many(EVERY["RSSR"].scene(start=0.4, samples=2), {"S1": {"point_i": (np.ones(3), 0.0, 0.0)}})


def hamilton(a, b):
    """The product of two quaternions (4,), by the matrix of the first."""
    e, x, y, z = a
    return np.array([[e, -x, -y, -z], [x, e, -z, y], [y, z, e, -x], [z, -y, x, e]]) @ b


def test_without_its_spin_a_body_moves_the_points_of_its_line_as_before():
    """And its Euler parameters, whose length stays 1, have no rate that is a turn about the line."""
    draw = np.random.default_rng(3)
    line, through, sign = (
        np.array([2.0, -1.0, 2.0]) / 3.0,
        np.array([0.3, -0.2, 0.5]),
        np.array([1.0, -1.0, -1.0, -1.0]),
    )
    q, qd, qdd = draw.normal(size=(3, 7))
    p = q[3:] = q[3:] / np.linalg.norm(q[3:])
    qd[3:] -= p * (p @ qd[3:])
    qdd[3:] -= p * (p @ qdd[3:] + qd[3:] @ qd[3:])
    still = [level[:, 0] for level in _still((line, through), q[:, None], [qd[:, None], qdd[:, None]])[0]]
    spin = hamilton(p, [0.0, *line])

    assert [spin @ level[3:] for level in still] == pytest.approx([0.0, 0.0], abs=1e-14)
    assert (p @ still[0][3:], p @ still[1][3:]) == pytest.approx((0.0, -still[0][3:] @ still[0][3:]), abs=1e-14)
    for point in (through, through - 2.0 * line):
        for k in (1, 2):
            moves = []
            for levels in ((q, qd, qdd), (q, *still)):
                p0, p1, p2 = (level[3:] for level in levels)
                turned = {1: ((p1, p0, 1), (p0, p1, 1)), 2: ((p2, p0, 1), (p1, p1, 2), (p0, p2, 1))}[k]
                arm = sum(n * hamilton(hamilton(a, [0.0, *point]), sign * b) for a, b, n in turned)
                moves.append(levels[k][:3] + arm[1:])
            assert moves[0] == pytest.approx(moves[1], abs=1e-13)


@pytest.mark.parametrize("square", [6.25, np.array([6.25, 0.0, 1e-300])])
def test_a_root_is_that_of_each_number_of_a_row(square):
    assert np.all(root(square) == np.sqrt(square))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_cosine_that_rounding_leaves_beyond_1_is_one_of_1_and_no_further(sign):
    linkage = EVERY["RSSR"]

    assert linkage._cosine(0.3, sign * (1.0 + 2.0**-45)) == math.acos(sign)
    assert linkage._cosine(0.3, sign * 0.5) == math.acos(sign * 0.5)
    with pytest.raises(DoesNotAssemble):
        linkage._cosine(0.3, sign * (1.0 + 2.0**-43))


def test_starts_from_anywhere_are_spread_over_a_cube_and_favour_no_turn():
    """The mean of p p^T of evenly spread p is I / 4; that of r r^T for r in a cube of half a side 1 is I / 3."""
    scene = EVERY["RSSR"].scene(samples=2)
    poses = np.stack(list(starts(compile_system(scene.mechanism, unit=scene.mechanism.unit()), 0.0, 500)))
    p = np.concatenate([poses[:, at : at + 4] for at in (3, 10, 17)])
    r = np.concatenate([poses[:, at : at + 3] for at in (0, 7, 14)])

    assert np.linalg.norm(p, axis=1) == pytest.approx(1.0)
    assert p.T @ p / len(p) == pytest.approx(np.eye(4) / 4, abs=0.02)
    assert np.abs(r).max() <= 1.0
    assert np.mean(r, axis=0) == pytest.approx(np.zeros(3), abs=0.02)
    assert r.T @ r / len(r) == pytest.approx(np.eye(3) / 3, abs=0.02)


def test_a_rod_that_just_reaches_its_line_reaches_it_whichever_way_its_square_is_rounded():
    """As long as the crank, about whose axis the line goes, so at right angles to it at every input."""
    rng = np.random.default_rng(0)
    for length, value in zip(rng.uniform(0.5, 2.0, 50), rng.uniform(0.0, 6.0, 50), strict=True):
        pose = RSSP(length, length, (0.0, 0.0, 0.5), (0.0, 0.0, 1.0)).assemble(value)

        assert pose["slider"][:3] == pytest.approx((0.0, 0.0, 0.0), abs=1e-7)


def test_a_search_of_space_ends_where_so_many_starts_lead_nowhere_new_and_has_each_pose_once(monkeypatch):
    """Where Newton's method ends from each start: nowhere, at one of two poses, or at a third from the last start."""
    many = by_starts.ENOUGH
    tried, ends = [], [None, 0.0, 0.0, 1.0, *[0.0, None] * (many // 2 - 1), 2.0, *[1.0] * many, 3.0]
    monkeypatch.setattr(by_starts, "starts", lambda *_: iter(range(len(ends))))
    monkeypatch.setattr(by_starts, "signed", lambda _, q, like: q)
    monkeypatch.setattr(by_starts, "recentred", lambda s: SimpleNamespace(inner=s, furthest=0.0, outward=lambda q: q))
    monkeypatch.setattr(
        by_starts, "refined", lambda _, k, t: tried.append(k) or (None if ends[k] is None else np.array([ends[k]]))
    )

    assert by_starts.assemblies_in_space(SimpleNamespace(n=1, of_bodies=1), 0.0) == [0.0, 1.0, 2.0]
    assert len(tried) == len(ends) - 1


def test_a_large_mechanism_of_space_has_fewer_starts_and_its_list_says_so(monkeypatch):
    """A start takes 0.14 s with eight bodies: 120 of them took 14 s."""
    m = RSSRChain(EVERY["RSSR"], np.int64(3)).scene(samples=2).mechanism
    system, tried = compile_system(m, unit=m.unit()), []
    monkeypatch.setattr(by_starts, "refined", lambda _, q, t: tried.append(q))
    found = assemblies(system, 0.0)

    assert len(tried) == 22
    assert found.message == "the search found none; so large a mechanism has 22 starts in vain at most"
    assert not found.complete


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: Bennett(1.5, 0.5, 0.5), ["Bennett: alpha: expected a twist [rad] that is neither 0 nor beta = 0.5"]),
        (lambda: Bennett(1.5, 0.0, 0.5), ["Bennett: alpha: expected a twist [rad] that is neither 0 nor beta = 0.5"]),
        (lambda: Bennett(1.5, "x", None), ["Bennett: alpha: expected a finite number, got 'x'", "Bennett: beta: "]),
        (lambda: replace(EVERY["RSSR"], axis=(0, 0, 0)), ["RSSR: axis: expected a vector that is not zero"]),
        (
            lambda: replace(EVERY["RSSR"], pivot=(2.5, -0.5)),
            ["RSSR: pivot: expected 3 finite numbers, got (2.5, -0.5)"],
        ),
        (lambda: replace(EVERY["RSCR"], pivot=(math.nan, 0.0, 0.0)), ["RSCR: pivot: expected 3 finite numbers"]),
        (lambda: replace(EVERY["RSSP"], guide=2.0), ["RSSP: guide: expected 3 finite numbers, got 2.0"]),
        (lambda: DoubleHooke(0.5, phase=math.inf), ["DoubleHooke: phase: expected a finite number, got inf"]),
        (lambda: DoubleHooke(0.5, parallel="no"), ["DoubleHooke: parallel: expected False or True, got 'no'"]),
        (lambda: replace(EVERY["RSSR"], massless="no"), ["RSSR: massless: expected False or True, got 'no'"]),
        (
            lambda: replace(EVERY["RSSR"], massless=np.array([True, False])),
            ["RSSR: massless: expected False or True, got array("],
        ),
        (lambda: Hooke(0.5, form="dots"), ["Hooke: form: expected 'half' or 'dot' or 'printed', got 'dots'"]),
        (
            lambda: RSSRChain(None, 2.5),
            ["RSSRChain: first: expected an RSSR", "RSSRChain: count: expected a whole number above 0, got 2.5"],
        ),
        (
            lambda: RSSRChain(replace(EVERY["RSSR"], massless=True), 2),
            ["RSSRChain: first: expected an RSSR with a coupler that is a body"],
        ),
        (
            lambda: Stewart((), ((1.0, 2.0),) * 6, ()),
            [
                f"Stewart: {key}: expected {how} finite numbers"
                for key, how in (("base", "6 times 3"), ("platform", "6 times 3"), ("home", "7"))
            ],
        ),
    ],
)
def test_numbers_that_make_no_linkage_of_space_are_named(made, said):
    with pytest.raises(refkin.InvalidScene) as caught:
        made()

    lines = str(caught.value).splitlines()
    assert [True] * len(said) == [line.startswith(text) for line, text in zip(lines, said, strict=True)]


@pytest.mark.parametrize("name", ["RSSR", "RSCR"])
@pytest.mark.parametrize("coupler", [9.0, 0.01])
def test_what_a_coupler_misses_by_is_the_length_that_is_too_much_or_lacks(name, coupler):
    """Against the rocker's end at many angles; of the RSCR seen along its axis."""
    linkage, angles = replace(EVERY[name], coupler=coupler), np.linspace(0.0, math.tau, 100_001)
    f, g, h = (np.array(v.parts) for v in frame(linkage.axis, None))
    w = np.array([linkage.crank, 0.0, 0.0]) - linkage.pivot
    w = w - (w @ h) * h if name == "RSCR" else w
    ends = linkage.rocker * (np.outer(np.cos(angles), f) + np.outer(np.sin(angles), g))
    away = np.linalg.norm(ends - w, axis=1)
    with pytest.raises(DoesNotAssemble, match="miss by") as caught:
        linkage.assemble(0.0)

    assert caught.value.gap == pytest.approx(max(away.min() - coupler, coupler - away.max()), abs=1e-6)


def test_a_loop_of_angles_that_does_not_close_misses_by_no_length():
    with pytest.raises(DoesNotAssemble, match="its last two links do not meet") as caught:
        Bricard(1.0, 1.2).assemble(math.pi)

    assert math.isnan(caught.value.gap)


@pytest.mark.filterwarnings("error")
def test_a_pose_whose_chosen_rows_have_no_inverse_has_no_radius_and_warns_of_nothing():
    """On some processors the tenth has none by its rounding alone; here the last of each group has none on any."""
    found, without = "self.factors =", "self.inverse[-1] = np.nan; self.factors ="
    with mutated("refkin.proof.pose.choices:_Moves.__init__", found, without):
        motion = refkin.solve(Bennett(length=1.5, alpha=0.8, beta=0.5).scene(samples=13))

    assert motion.verdict is Status.OK
    assert 0 < np.isnan(motion.certified_radius.position).sum() < 13
