"""Assemblies of groups larger than a dyad: found by way of a trial angle, proved to be all, or proved not to exist."""

from __future__ import annotations

import cmath
import math
from itertools import pairwise

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given, settings
from hypothesis import strategies as st

from refkin.joints import AngleDriver, Distance, DistanceDriver, Revolute, YDriver
from refkin.model import Body, Mechanism
from refkin.motion_laws import Polynomial
from refkin.newton import newton
from refkin.proof.assembly import assemblies
from refkin.proof.slopes import interval
from refkin.system import compile_system

ROUND_OFF = 1e-14


def constant(value):
    return Polynomial(coefficients=(float(value),))


def solved(mechanism):
    system = compile_system(mechanism, unit=mechanism.unit())
    return system, assemblies(system, 0.0)


def distance(one, other):
    """Largest difference of two poses, angles without whole turns."""
    off = one - other
    off[2::3] = (off[2::3] + math.pi) % math.tau - math.pi
    return float(np.abs(off).max())


# ---- a four-bar driven by a cylinder between the ground and a point of its coupler

GROUND, CRANK, COUPLER, ROCKER = 4.0, 1.0, 3.5, 3.0
ANCHOR, POINT = 2 - 2j, 1.75 + 1j


def cylinder(length):
    def pin(name, i, at_i, j, at_j):
        return Revolute(name=name, body_i=i, point_i=(at_i, 0.0), body_j=j, point_j=(at_j, 0.0))

    joints = (
        pin("A0", "ground", 0.0, "crank", 0.0),
        pin("A", "crank", CRANK, "coupler", 0.0),
        pin("B", "coupler", COUPLER, "rocker", ROCKER),
        pin("B0", "ground", GROUND, "rocker", 0.0),
    )
    driver = DistanceDriver(
        name="cylinder",
        body_i="ground",
        point_i=(ANCHOR.real, ANCHOR.imag),
        body_j="coupler",
        point_j=(POINT.real, POINT.imag),
        law=constant(length),
    )
    return Mechanism(tuple(Body(name=n) for n in ("crank", "coupler", "rocker")), joints, (driver,))


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
    found = []
    for sign in (1, -1):
        k = int(np.argmin(sign * reach(angles, side)))
        low, high = angles[k] - 0.01, angles[k] + 0.01
        for _ in range(80):
            a, b = high - (high - low) * 0.6180339887498949, low + (high - low) * 0.6180339887498949
            low, high = (low, b) if sign * reach(a, side) < sign * reach(b, side) else (a, high)
        found.append(float(reach((low + high) / 2, side)))
    return found


CROSSED, OPEN = limits(-1), limits(1)


def roots(length):
    """How many angles of the crank give this length: sign changes on a fine grid, both sides."""
    angles = np.linspace(0, 2 * np.pi, 20001)
    return sum(int(np.sum(np.diff(np.sign(reach(angles, side) - length)) != 0)) for side in (1, -1))


@pytest.mark.parametrize("length", [1.0, 1.7, 2.2, 3.6, 4.2, 4.8])
def test_every_assembly_is_found_and_proved_to_be_all(length):
    system, found = solved(cylinder(length))

    assert found.complete
    assert len(found.poses) == roots(length) > 0
    assert max(float(np.abs(system.phi(q, 0.0)).max()) for q in found.poses) < ROUND_OFF
    assert max(found.radii) < ROUND_OFF


@pytest.mark.parametrize("gap", [0.3, 1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize(("limit", "sign"), [(OPEN[1], 1), (OPEN[0], -1), (CROSSED[1], 1), (CROSSED[0], -1)])
def test_a_length_beyond_what_is_reached_is_proved_to_have_no_assembly(limit, sign, gap):
    """Longer than the longest, shorter than the shortest, and between the lengths of the two sides."""
    _, missed = solved(cylinder(limit + sign * gap))

    assert missed.poses == ()
    assert missed.complete
    assert missed.gap > 0


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9])
def test_close_to_a_limit_two_assemblies_are_found(gap):
    _, found = solved(cylinder(OPEN[1] - gap))

    assert found.gap is None
    assert len(found.poses) == 2


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
    system, found = solved(cylinder(length))
    least = min(opening(x, side, length) for x in np.linspace(0, 2 * np.pi, 5001) for side in (1, -1))

    assert 0 < found.gap * system.unit.size <= least
    assert found.message.startswith("no angle of crank closes it: at least ")


# ---- triads drawn around a pose


class Drawn:
    """Bodies that lie somewhere, and joints made to fit them."""

    def __init__(self, rng, names):
        self.rng = rng
        self.pose = {name: (self.point(), float(rng.uniform(-3, 3))) for name in names} | {"ground": (0j, 0.0)}
        self.joints, self.drivers = [], []

    def point(self):
        return complex(*self.rng.uniform(-1, 1, 2))

    def local(self, body, point):
        r, phi = self.pose[body]
        u = (point - r) * cmath.exp(-1j * phi)
        return (u.real, u.imag)

    def ends(self, i, at_i, j, at_j):
        names = {"name": f"joint {len(self.joints)}", "body_i": i, "body_j": j}
        return {**names, "point_i": self.local(i, at_i), "point_j": self.local(j, at_j)}

    def pin(self, i, j):
        at = self.point()
        self.joints.append(Revolute(**self.ends(i, at, j, at)))

    def rod(self, i, j):
        a, b = self.point(), self.point()
        self.joints.append(Distance(**self.ends(i, a, j, b), length=abs(b - a)))

    def solved(self):
        names = [n for n in self.pose if n != "ground"]
        mechanism = Mechanism(tuple(Body(name=n) for n in names), tuple(self.joints), tuple(self.drivers))
        system, found = solved(mechanism)
        flat = [c for n in names for c in (self.pose[n][0].real, self.pose[n][0].imag, self.pose[n][1])]
        return system, found, system.to_unit(np.array(flat))


def platform(rng):
    """A plate on three legs."""
    drawn = Drawn(rng, ("plate",))
    for _ in range(3):
        drawn.rod("ground", "plate")
    return drawn


def ternary(rng):
    """The same with links that have a mass: a triad."""
    drawn = Drawn(rng, ("plate", "first", "second", "third"))
    for link in ("first", "second", "third"):
        drawn.pin("ground", link)
        drawn.pin(link, "plate")
    return drawn


def coupler_point(rng):
    """A four-bar driven by the height of a point of its coupler."""
    drawn = Drawn(rng, ("crank", "coupler", "rocker"))
    for i, j in (("ground", "crank"), ("crank", "coupler"), ("coupler", "rocker"), ("ground", "rocker")):
        drawn.pin(i, j)
    at = drawn.point()
    drawn.drivers.append(YDriver(name="m", body="coupler", point=drawn.local("coupler", at), law=constant(at.imag)))
    return drawn


TRIADS = {"platform": platform, "ternary": ternary, "coupler point": coupler_point}


@pytest.mark.parametrize("family", TRIADS.values(), ids=TRIADS)
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_what_newton_finds_from_anywhere_is_among_the_assemblies(family, seed):
    """And the drawn pose itself. Rounded numbers move a pose by their rounding over sigma_min."""
    rng = np.random.default_rng(seed)
    system, found, drawn = family(rng).solved()

    def near(q):
        sigma = float(np.linalg.svd(system.phi_q(q, 0.0), compute_uv=False)[-1])
        return sigma < 1e-4 or any(distance(x, q) < 1e-13 / sigma for x in found.poses)

    assert found.gap is None or found.gap < 1e-9
    assert near(drawn)
    for _ in range(10):
        start = drawn + rng.uniform(-1, 1, drawn.size)
        result = newton(lambda q: system.phi(q, 0.0), lambda q: system.phi_q(q, 0.0), start, damped=True)
        closed = result.converged and result.residual < ROUND_OFF and np.abs(result.q).max() < 1e3

        assert not found.complete or not closed or near(result.q)


def test_a_group_of_more_than_three_links_is_found_but_nothing_is_proved():
    """Three plates in a ring on pairs of legs, and one leg more: no single angle opens it."""
    drawn = Drawn(np.random.default_rng(5), ("a", "b", "c"))
    ring = ("ground", "a", "b", "c", "ground")
    for i, j in pairwise(ring):
        drawn.rod(i, j)
        drawn.rod(i, j)
    drawn.rod("ground", "b")
    system, found, _ = drawn.solved()

    assert found.gap is None
    assert not found.complete
    assert found.poses
    assert all(np.abs(system.phi(q, 0.0)).max() < ROUND_OFF * max(1.0, np.abs(q).max()) for q in found.poses)
    assert "no proof was tried" in found.message


def test_a_dyad_whose_outer_pins_coincide_turns_freely_and_nothing_is_claimed():
    """A rhombus folded onto its ground link: the coupler and rocker turn together about one pin."""
    joints = tuple(
        Revolute(name=name, body_i=i, point_i=(at_i, 0.0), body_j=j, point_j=(at_j, 0.0))
        for name, i, at_i, j, at_j in (
            ("A0", "ground", 0.0, "crank", 0.0),
            ("A", "crank", 1.0, "coupler", 0.0),
            ("B", "coupler", 1.0, "rocker", 1.0),
            ("B0", "ground", 1.0, "rocker", 0.0),
        )
    )
    motor = AngleDriver(name="motor", body="crank", law=constant(0.0))
    names = ("crank", "coupler", "rocker")
    _, found = solved(Mechanism(tuple(Body(name=n) for n in names), joints, (motor,)))

    assert found.gap is None
    assert not found.complete
    assert len(found.poses) > 1
    assert "the outer joints of a dyad coincide" in found.message


# ---- numbers with slopes

FUNCTIONS = {
    "product": (lambda x: x.sin() * x.cos() * 3 - x * 0.5, lambda x: 3 * math.sin(x) * math.cos(x) - x / 2),
    "quotient": (lambda x: x.cos() / (x.sin() + 3), lambda x: math.cos(x) / (math.sin(x) + 3)),
    "reciprocal": (lambda x: 2 / (x.cos() + 1.5), lambda x: 2 / (math.cos(x) + 1.5)),
    "root": (lambda x: (2 + x.sin()).sqrt(), lambda x: math.sqrt(2 + math.sin(x))),
    "modulus": (lambda x: abs(x.sin()) - abs(x), lambda x: abs(math.sin(x)) - abs(x)),
    "difference": (lambda x: 1 - x.cos() * x, lambda x: 1 - math.cos(x) * x),
}


@pytest.mark.parametrize(("enclosed", "exact"), FUNCTIONS.values(), ids=FUNCTIONS)
@settings(max_examples=60, deadline=None)
@given(low=st.floats(-3, 3), width=st.floats(1e-9, 2), share=st.floats(0, 1))
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
