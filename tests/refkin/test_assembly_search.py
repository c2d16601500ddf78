"""Assemblies of groups larger than a dyad: found by way of a trial angle, proved to be all, or proved not to exist."""

from __future__ import annotations

import cmath
import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import example, given, settings
from hypothesis import strategies as st

import refkin
from refkin.joints import Distance
from refkin.model import Mechanism
from refkin.newton import NewtonStatus, newton
from refkin.proof.assembly import closed_form, search
from refkin.proof.assembly.assembly import assemblies
from refkin.proof.assembly.levenberg import levenberg_marquardt
from refkin.proof.assembly.loci import interval
from refkin.proof.assembly.search import _Intervals, _Known, closes, refined
from refkin.system import compile_system
from tests.claims import assert_near
from tests.drawn import Drawn
from tests.linkages import remade
from tests.places import CORPUS

from .assembly_cases import ROUND_OFF, bodies, cylinder, distance, four_bar, pin, solved

# ---- a four-bar driven by a cylinder between the ground and a point of its coupler

GROUND, CRANK, COUPLER, ROCKER = 4.0, 1.0, 3.5, 3.0
ANCHOR, POINT = 2 - 2j, 1.75 + 1j


def driven(length):
    at, point = (ANCHOR.real, ANCHOR.imag), (POINT.real, POINT.imag)
    return four_bar(GROUND, CRANK, COUPLER, ROCKER, cylinder("ground", at, "coupler", point, length))


def reach(angle, side):
    """Length of the cylinder at an angle of the crank, on a side of the diagonal."""
    a = np.exp(1j * angle)
    d = GROUND - a
    along = (abs(d) ** 2 + COUPLER**2 - ROCKER**2) / (2 * abs(d))
    b = a + d / abs(d) * (along + side * 1j * np.sqrt(COUPLER**2 - along**2))
    return abs(a + (b - a) / COUPLER * POINT - ANCHOR)


def limits(side):
    """Shortest and longest cylinder on a side, by golden section: both are flat, so right to round-off."""
    angles = np.linspace(0, 2 * np.pi, 721)
    rows = []
    for sign in (1, -1):
        k = int(np.argmin(sign * reach(angles, side)))
        low, high = angles[k] - 0.01, angles[k] + 0.01
        for _ in range(80):
            a, b = high - (high - low) * 0.6180339887498949, low + (high - low) * 0.6180339887498949
            low, high = (low, b) if sign * reach(a, side) < sign * reach(b, side) else (a, high)
        rows.append(float(reach((low + high) / 2, side)))
    return rows


CROSSED, OPEN = limits(-1), limits(1)


def roots(length):
    """How many angles of the crank give this length: sign changes on a fine grid, both sides."""
    angles = np.linspace(0, 2 * np.pi, 20001)
    return sum(int(np.sum(np.diff(np.sign(reach(angles, side) - length)) != 0)) for side in (1, -1))


@pytest.mark.parametrize("length", [1.0, 1.7, 2.2, 3.6, 4.2, 4.8])
def test_every_assembly_is_found_and_proved_to_be_all(length):
    system, result = solved(driven(length))

    assert result.complete
    assert len(result.poses) == roots(length) > 0
    assert max(float(np.abs(system.phi(q, 0.0)).max()) for q in result.poses) < ROUND_OFF
    assert max(result.radii) < ROUND_OFF
    assert all(-math.pi < angle <= math.pi for q in result.poses for angle in q[2::3])


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize(("missing", "status"), [(0.0, NewtonStatus.CONVERGED), (0.5, NewtonStatus.SINGULAR)])
def test_least_squares_end_at_the_same_place_whatever_the_unit_of_a_coordinate(scale, missing, status):
    result = levenberg_marquardt(
        lambda q: np.array([(scale * q[0]) ** 2 - 1.0, missing]),
        lambda q: np.array([[2.0 * scale**2 * q[0]], [0.0]]),
        np.array([3.0 / scale]),
    )

    assert result.status is status
    assert scale * result.q == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("gap", [0.3, 1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize(("limit", "sign"), [(OPEN[1], 1), (OPEN[0], -1), (CROSSED[1], 1), (CROSSED[0], -1)])
def test_a_length_beyond_what_is_reached_is_proved_to_have_no_assembly(limit, sign, gap):
    """Longer than the longest, shorter than the shortest, and between the lengths of the two sides."""
    _, missed = solved(driven(limit + sign * gap))

    assert missed.poses == ()
    assert missed.complete
    assert missed.gap > 0


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9])
def test_close_to_a_limit_two_assemblies_are_found(gap):
    _, result = solved(driven(OPEN[1] - gap))

    assert result.gap is None
    assert len(result.poses) == 2


def opening(angle, side, length):
    """What is open at an angle of the crank: at pin B0, or at the cylinder if it does not even reach the coupler."""
    a, arm = cmath.rect(CRANK, angle), abs(POINT)
    d = ANCHOR - a
    along = (abs(d) ** 2 + arm**2 - length**2) / (2 * abs(d))
    point = a + d / abs(d) * (along + side * 1j * math.sqrt(max(0.0, arm**2 - along**2)))
    b = a + (point - a) / POINT * COUPLER
    return max(abs(abs(b - GROUND) - ROCKER), abs(d) - arm - length, abs(arm - length) - abs(d))


@pytest.mark.parametrize("excess", [0.3, 0.1, 1e-3])
def test_the_gap_is_a_lower_bound_of_what_is_open_at_every_angle(excess):
    length = OPEN[1] + excess
    system, result = solved(driven(length))
    least = min(opening(x, side, length) for x in np.linspace(0, 2 * np.pi, 5001) for side in (1, -1))

    assert 0 < result.gap * system.unit.size <= least
    assert result.message.startswith("no angle of crank closes it: at least ")


# ---- triads drawn around a pose


def outcome(drawn):
    system, result = solved(drawn.mechanism())
    return system, result, drawn.q(system)


def platform(rng):
    """A plate on three legs."""
    drawn = Drawn(rng, "plate", still=True)
    for _ in range(3):
        drawn.link("ground", "plate")
    return drawn


def ternary(rng):
    """The same with links that have a mass: a triad."""
    drawn = Drawn(rng, "plate", "first", "second", "third", still=True)
    for link in ("first", "second", "third"):
        drawn.pin("ground", link)
        drawn.pin(link, "plate")
    return drawn


def coupler_point(rng):
    """A four-bar driven by the height of a point of its coupler."""
    drawn = Drawn(rng, "crank", "coupler", "rocker", still=True)
    for i, j in (("ground", "crank"), ("crank", "coupler"), ("coupler", "rocker"), ("ground", "rocker")):
        drawn.pin(i, j)
    drawn.drive_y("coupler", drawn.point())
    return drawn


TRIADS = {"platform": platform, "ternary": ternary, "coupler point": coupler_point}


@pytest.mark.parametrize("family", TRIADS.values(), ids=TRIADS)
@settings(max_examples=12)
@example(seed=6956)
@given(seed=st.integers(0, 2**32 - 1))
def test_what_newton_finds_from_anywhere_is_among_the_assemblies(family, seed):
    """And the drawn pose itself. Rounded numbers move a pose by their rounding over sigma_min, and it has a radius."""
    rng = np.random.default_rng(seed)
    system, answer, drawn = outcome(family(rng))

    def near(q):
        sigma = float(np.linalg.svd(system.phi_q(q, 0.0), compute_uv=False)[-1])
        found = zip(answer.poses, answer.radii, strict=True)
        return sigma < 1e-4 or any(distance(x, q) < 1e-13 / sigma + radius for x, radius in found)

    assert answer.gap is None or answer.gap < 1e-9
    assert near(drawn)
    for _ in range(10):
        start = drawn + rng.uniform(-1, 1, drawn.size)
        result = newton(lambda q: system.phi(q, 0.0), lambda q: system.phi_q(q, 0.0), start, damped=True)
        closed = result.converged and result.residual < ROUND_OFF and np.abs(result.q).max() < 1e3

        assert not answer.complete or not closed or near(result.q)


def test_a_group_of_more_than_three_links_is_found_but_nothing_is_proved():
    """Three plates in a ring on pairs of legs, and one leg more: no single angle opens it."""
    drawn = Drawn(np.random.default_rng(5), "a", "b", "c", still=True)
    ring = ("ground", "a", "b", "c", "ground")
    for i, j in pairwise(ring):
        drawn.link(i, j)
        drawn.link(i, j)
    drawn.link("ground", "b")
    system, result, _ = outcome(drawn)

    assert result.gap is None
    assert not result.complete
    assert result.poses
    assert all(np.abs(system.phi(q, 0.0)).max() < ROUND_OFF * max(1.0, np.abs(q).max()) for q in result.poses)
    assert "no proof was tried" in result.message


def test_a_dyad_whose_outer_pins_coincide_turns_freely_and_nothing_is_claimed():
    """A rhombus folded onto its ground link: the coupler and rocker turn together about one pin."""
    _, result = solved(four_bar(1.0, 1.0, 1.0, 1.0, 0.0))

    assert result.gap is None
    assert not result.complete
    assert len(result.poses) > 1
    assert "the outer joints of a dyad coincide" in result.message


# ---- numbers with slopes

FUNCTIONS = {
    "product": (lambda x: x.sin() * x.cos() * 3 - x * 0.5, lambda x: 3 * math.sin(x) * math.cos(x) - x / 2),
    "quotient": (lambda x: x.cos() / (x.sin() + 3), lambda x: math.cos(x) / (math.sin(x) + 3)),
    "reciprocal": (lambda x: 2 / (x.cos() + 1.5), lambda x: 2 / (math.cos(x) + 1.5)),
    "root": (lambda x: (2 + x.sin()).sqrt(), lambda x: math.sqrt(2 + math.sin(x))),
    "modulus": (lambda x: abs(x) - x, lambda x: abs(x) - x),
    "difference": (lambda x: 1 - x.cos() * x, lambda x: 1 - math.cos(x) * x),
}


@pytest.mark.parametrize(("enclosed", "exact"), FUNCTIONS.values(), ids=FUNCTIONS)
@settings(max_examples=200)
@given(low=st.floats(-3, 3) | st.floats(-1, 0), width=st.floats(1e-9, 2) | st.floats(1, 2), share=st.floats(0, 1))
@example(low=-1.0, width=1.9, share=0.1)
def test_an_enclosure_over_an_interval_holds_every_value(enclosed, exact, low, width, share):
    with ctx.workprec(113):
        values = enclosed(interval(low, low + width)).whole
        x = min(low + share * width, low + width)

        # The float on the right is off by a few roundings of numbers up to 5.
        assert (values - exact(x)).overlaps(arb(0, 1e-14))


@pytest.mark.parametrize("name", ["product", "difference"])
def test_the_excess_of_an_enclosure_shrinks_with_the_square_of_the_width(name):
    """A quarter of the excess for half the width, about; natural interval arithmetic would leave a half.

    The radius of a ball is rounded to 30 bits: the widths are large enough for that to be lost beside the excess.
    """
    enclosed, exact = FUNCTIONS[name]
    excess = []
    with ctx.workprec(113):
        for width in (0.1, 0.05, 0.025):
            values = enclosed(interval(0.7, 0.7 + width)).whole
            sampled = [exact(x) for x in np.linspace(0.7, 0.7 + width, 101)]
            excess.append(float(values.upper() - values.lower()) - (max(sampled) - min(sampled)))

    assert excess[1] / excess[0] < 0.3
    assert excess[2] / excess[1] < 0.3


@pytest.mark.parametrize("turns", [-1, 0, 2])
@pytest.mark.parametrize(("off", "alone", "known"), [(1e-4, 1e-3, True), (1e-2, 1e-3, False)])
def test_a_branch_is_known_where_all_of_it_is_as_near_a_root_as_that_is_alone_whole_turns_aside(
    turns, off, alone, known
):
    for k in range(3):
        pose = [0.3, -0.2, 0.5]
        root = _Known(np.array(pose), alone, 0.0)
        pose[k] += off
        there = SimpleNamespace(
            r=SimpleNamespace(x=arb(pose[0]), y=arb(pose[1])), phi=arb(pose[2]) + 2 * turns * arb.pi()
        )
        system = SimpleNamespace(columns=lambda _: slice(0, 3))
        search = SimpleNamespace(names=["bar"], known=[root], system=system)

        assert _Intervals(search)._is_known(SimpleNamespace(poses={"bar": there})) is known


@pytest.mark.parametrize(("off", "allowed", "closed"), [(0.0, 0.0, True), (1e-3, 0.0, False), (1e-3, 1e-2, True)])
def test_a_pose_closes_if_its_residual_is_round_off_or_what_is_allowed(off, allowed, closed):
    system = compile_system(four_bar(GROUND, CRANK, COUPLER, ROCKER, 1.0))
    q = assemblies(system, 0.0).poses[0] + off

    assert closes(system, q, 0.0, allowed) is closed


def test_what_newton_calls_converged_but_does_not_close_is_improved_by_least_squares(monkeypatch):
    system = compile_system(four_bar(GROUND, CRANK, COUPLER, ROCKER, 1.0))
    q = assemblies(system, 0.0).poses[0]
    monkeypatch.setattr(search, "position", lambda system, start, t, **_: SimpleNamespace(q=start, converged=True))

    assert refined(system, q + 1e-3, 0.0) == pytest.approx(q, abs=ROUND_OFF)


def test_what_closed_form_places_at_no_trial_angle_is_found_from_poses_that_no_joint_holds():
    """The search found none of ten; of some with gears and cams it found none either."""
    rng = np.random.default_rng(8)
    drawn = Drawn(rng, *(f"b{k}" for k in range(6)), still=True)
    names, left = list(drawn.pose), 17
    drawn.drive_angle("b0")
    while left:
        (i, j), kind = (names[k] for k in rng.permutation(7)[:2]), rng.integers(3)
        left -= 2 if kind == 0 else 1
        drawn.pin(i, j) if kind == 0 else drawn.link(i, j) if kind == 1 else drawn.slide(i, j, turning=True)
    system, _ = drawn.system()
    result = assemblies(system, 0.0)

    assert "the group is larger than a triad: no proof was tried" in result.message
    assert len(result.poses) > 1
    assert not result.complete
    assert all(closes(system, q, 0.0) for q in result.poses)


def test_what_closes_only_at_angles_without_digits_is_no_assembly():
    """Newton went to 4e15 rad, where a residual of 0.3 is rounding; without its turns the pose was called one."""
    slot = refkin.PointOnLine(
        name="slot", body_i="b", point_i=(-2.0, -2.0), axis_i=(0.0, 1.0), body_j="a", point_j=(-1.0, -1.0)
    )
    pins = (
        pin("R1", "b", (-2.0, 2.0), "a", (-1.0, 3.0)),
        pin("R2", "c", (-1.0, 1.0), "b", (-1.0, 1.0)),
        pin("R3", "c", (-1.0, -1.0), "ground", (0.0, -1.0)),
        pin("R4", "c", (-3.0, -1.0), "a", (-2.0, 0.0)),
    )
    system, actual = solved(Mechanism(bodies("a", "b", "c"), (slot, *pins)))

    assert actual.poses
    assert all(np.abs(system.phi(q, 0.0)).max() < ROUND_OFF for q in actual.poses)


def test_bodies_that_roll_on_each_other_turn_together_and_a_whole_turn_is_no_other_assembly():
    """A slide on an arm that a cylinder holds, its rack in mesh with the arm: there were 17 assemblies of two."""
    slide = refkin.Prismatic(
        name="slide", body_i="arm", point_i=(0.0, 0.0), axis_i=(1.0, 0.0), body_j="rack", point_j=(0.0, 0.0)
    )
    mesh = refkin.RackAndPinion(
        name="mesh", body_i="rack", point_i=(0.0, 0.0), axis_i=(1.0, 0.0), body_j="arm", point_j=(1.0, 0.0), radius=8.0
    )
    held = cylinder("ground", (2.0, 0.0), "arm", (1.0, 0.0), 1.5)
    pivot = pin("pivot", "ground", (0.0, 0.0), "arm", (0.0, 0.0))
    _, actual = solved(Mechanism(bodies("arm", "rack"), (pivot, slide, mesh), (held,)))
    angle = math.acos((2.0**2 + 1.0 - 1.5**2) / 4.0)

    assert sorted(q[2] for q in actual.poses) == pytest.approx([-angle, angle], abs=ROUND_OFF)


def geared_cranks(length, ratio=1.0):
    pivots = pin("O", "ground", (0.0, 0.0), "left", (0.0, 0.0)), pin("Q", "ground", (3.0, 0.0), "right", (0.0, 0.0))
    teeth = refkin.Gear(name="teeth", body_i="left", radius_i=1.0, body_j="right", radius_j=ratio, phi0_j=math.pi)
    held = cylinder("left", (1.0, 0.0), "right", (1.0, 0.0), length)
    return Mechanism(bodies("left", "right"), (*pivots, teeth), (held,))


def test_turns_that_wheels_in_gear_have_made_make_no_other_assembly_of_the_plane():
    """Two cranks in gear, their tips held apart, lean in or out: 27 assemblies were found, of every number of turns."""
    _, actual = solved(geared_cranks(2.0))

    assert sorted(math.sin(q[2]) for q in actual.poses) == pytest.approx([-math.sqrt(0.75), math.sqrt(0.75)])


@pytest.mark.parametrize("length", [1.3, 1.55, 2.0])
def test_wheels_in_gear_that_newton_turned_beyond_all_digits_are_in_no_assembly(length):
    """They were in the first, at 1e15 rad, and a scene without estimates had no answer."""
    mechanism = geared_cranks(length, ratio=2.0)
    _, actual = solved(mechanism)

    assert len(actual.poses) == 2
    assert refkin.solve(refkin.Scene(mechanism=mechanism, times=(0.0,))).verdict == "ok"


@pytest.mark.parametrize(("place", "count"), [((-0.8, -0.8), 2), ((-0.8, 0.4), 4), ((-0.5, 0.6), 6)])
def test_a_body_that_points_exactly_backwards_is_in_one_assembly_and_not_in_two(place, count):
    """Its angle is pi or -pi, as rounding has it: a platform on three links had three, five or seven."""
    base, own = [(0.0, 0.0), (2.0, 0.5), (0.5, 2.0)], [(0.5, -0.5), (-1.0, 0.5), (0.0, 1.0)]
    links = tuple(
        Distance(
            name=f"link {k}", body_i="ground", point_i=a, body_j="platform", point_j=b,
            length=math.dist(a, np.subtract(place, b)),
        )
        for k, (a, b) in enumerate(zip(base, own, strict=True))
    )  # fmt: skip
    _, actual = solved(Mechanism(bodies("platform"), links))

    assert actual.complete
    assert min(distance(p, q) for k, p in enumerate(actual.poses) for q in actual.poses[:k]) > 1e-3
    assert len(actual.poses) == count


def test_a_body_without_an_estimate_is_put_between_the_others_where_they_are(monkeypatch):
    """The search finds one assembly alone, 0.6 m from where the estimates of the others, which are exact, have them."""
    scene = refkin.load(CORPUS / "space-points-planes-and-links.toml")
    first, *others = scene.mechanism.bodies
    without = remade(scene, bodies=(replace(first, estimate=None), *others), times=scene.times[:1])
    motion = refkin.solve(without)

    assert_near(motion.q[:, 0], refkin.solve(scene).q[:, 0], 1e-12, "q")
    assert motion.message == "no estimate for b1: that of the estimate, the nearest of 2 found"
    nothing = search.Assemblies(searched=True)
    monkeypatch.setattr("refkin.solving.starts.assemblies", lambda *_: nothing)  # nor is it lost where none is found
    assert_near(refkin.solve(without).q[:, 0], motion.q[:, 0], 1e-12, "q")


def test_a_search_ends_where_its_steps_do_and_says_that_there_may_be_more(monkeypatch):
    """Bars on the coupler have two sides each, so an interval many branches: it took 24600 steps, and 9 s."""
    steps, names, m = [], "abcdefg", driven(4.5)
    own = [pin(b, "coupler", (0.4 * k, 0.25), b, (0.0, 0.0)) for k, b in enumerate(names)]
    rods = [
        Distance(name=f"rod {b}", body_i="ground", point_i=(0.4 * k, -2.0), body_j=b, point_j=(2.0, 0.5), length=3.0)
        for k, b in enumerate(names)
    ]
    m = Mechanism((*m.bodies, *bodies(*names)), (*m.joints, *own, *rods), m.drivers)
    take = closed_form._Worker.take
    monkeypatch.setattr(closed_form._Worker, "take", lambda *given: steps.append(1) or take(*given))
    monkeypatch.setattr(search, "refined", lambda *_: None)
    actual = solved(m)[1]

    assert len(steps) < 12_000
    assert actual.searched
    assert not actual.complete
    assert "may hold more" in actual.message


def test_to_know_that_there_are_assemblies_one_that_is_proved_will_do():
    """All were looked for, at up to four times of a branch that ends where others go on: 6 s each."""
    m = driven(4.5)
    system = compile_system(m, frozenset(), m.unit())
    every, one = (assemblies(system, 0.0, trying=trying) for trying in (True, False))

    assert len(every.poses) > len(one.poses) == 1
    assert one.radii[0] < 1e-12
    assert not one.complete
    assert not one.unassemblable
