"""What is proved of a pose is true: held against 113-bit enclosures, on every joint, near a root and far from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flint import arb

from refkin.analysis import acceleration, velocity
from refkin.joints import GROUND, AngleDriver, Distance, PointOnLine, RackAndPinion, Revolute, Unit, XDriver
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Polynomial, Sinusoid
from refkin.proof.numbers.bounded import Bounded, Bounds, Extended, U
from refkin.proof.numbers.inputs import HALF_ULP, input_effect
from refkin.proof.numbers.preconditioned import Nearly, Preconditioned
from refkin.proof.pose.certificate import BOX, Certificate, _Ball, certify
from refkin.proof.pose.krawczyk import Enclosure, Judgement, Verdict, judge, krawczyk
from refkin.scenes.linkages import FourBar
from refkin.solving.solve import nearest, solve
from refkin.system import System, compile_system
from tests.drawn import Drawn

from .assembled import four_bar, perturbed, poses

RATES = ("velocity", "acceleration")


@dataclass(frozen=True)
class Case:
    """Poses of one mechanism, answers for them of some quality, and the truth in balls of 113 bits."""

    system: System
    t: Any
    q: Any
    rates: tuple[Any, Any]
    truth: list[Enclosure]
    true_rates: tuple[list[Any], list[Any]]

    def certificate(self) -> Certificate:
        return certify(self.system, self.q, self.t, *self.rates)


def case(system: System, q: Any, t: Any, answer: Any) -> Case:
    qd = velocity(system, answer, t)
    truth = [krawczyk(system, q[:, k], t[k], bits=113) for k in range(len(t))]
    qd_true = [e.velocity() for e in truth]
    qdd_true = [e.acceleration(v) for e, v in zip(truth, qd_true, strict=True)]
    return Case(system, t, answer, (qd, acceleration(system, answer, qd, t)), truth, (qd_true, qdd_true))


@cache
def good() -> list[Case]:
    """1000 poses as float64 solves them: four-bars, slider-cranks, inverted, pin in slot, massless coupler."""
    return [case(system, q, t, q) for system, q, t in poses(1000, seed=1)]


@cache
def coarse() -> list[Case]:
    """1000 approximations that are off by 1e-6 to 1e-1, where terms of second order matter."""
    rng = np.random.default_rng(2)
    rows = []
    for system, q, t in poses(1000, seed=3):
        off = 10.0 ** rng.uniform(-6, -1, len(t)) * rng.uniform(-1, 1, q.shape)
        rows.append(case(system, q, t, q + off))
    return rows


def contains(balls: Any, answer: Any, radii: Any) -> bool:
    """Whether the truth is within `radii` of an answer, as far as the width of its balls lets one say."""
    width = np.array([float(x.rad()) for x in balls])
    return judge(balls, answer, radii + 4 * width).verdict is Verdict.INSIDE


def misses(cases: list[Case], level: str = "position") -> tuple[int, int]:
    """Return how many certificates were given, and how many of those do not contain the truth."""
    given = missed = 0
    for c in cases:
        proof = c.certificate()
        for k in np.flatnonzero(proof.ok):
            given += 1
            if level == "position":
                missed += not contains(c.truth[k].q, c.q[:, k], proof.radii[:, k])
            else:
                which = RATES.index(level)
                radii = getattr(proof, level)[:, k]
                missed += not contains(c.true_rates[which][k], c.rates[which][:, k], radii)
    return given, missed


@pytest.mark.parametrize("level", ["position", *RATES])
def test_every_regular_pose_is_certified_and_the_ball_contains_the_solution(level: str) -> None:
    assert misses(good(), level) == (1000, 0)


@pytest.mark.parametrize("level", ["position", *RATES])
def test_on_coarse_approximations_the_ball_contains_the_solution_or_no_certificate_is_given(level: str) -> None:
    given, missed = misses(coarse(), level)
    assert (given > 500, missed) == (True, 0)


@pytest.mark.parametrize("level", ["position", *RATES])
def test_the_numbers_nearest_to_what_is_proved_are_within_their_bounds_of_the_truth_which_are_mostly_an_ulp(level):
    order, off = ("position", *RATES).index(level), []
    for c in good():
        proof = c.certificate()
        best, bounds = (proof.root, *proof.rates)[order].nearest()
        truth = [e.q for e in c.truth] if order == 0 else c.true_rates[order - 1]
        assert all(contains(truth[k], best[:, k], bounds[:, k]) for k in range(len(c.t)))
        off.append(np.max(bounds, axis=0) / np.max(np.abs(best), axis=0))

    assert np.median(np.concatenate(off)) < (8 if Extended.unit < U else 400) * U


def test_next_to_a_fold_a_proof_knows_rates_far_better_than_the_answer_that_it_is_about() -> None:
    """Engines round a law's value as we do, and seemed to have two digits more than they had."""
    law = Polynomial(coefficients=(0.9853995522992578, 0.2))
    scene = FourBar(ground=4.0, crank=3.0, coupler=1.0, rocker=3.0).scene(law=law, times=(0.0, 0.5, 1.0), branch="open")
    answer, best = (motion.certified_radius.acceleration[-1] for motion in (solve(scene), nearest(scene)))
    apart = np.max(np.abs(solve(scene).qdd - nearest(scene).qdd)[2::3, -1])

    assert (50.0 if Extended.unit < U else 0.0) * best < apart <= answer


def without_curvature(row: Any) -> Any:
    return tuple(type(x)(x.mid, x.rounding, 0.0) if isinstance(x, Bounded) else x for x in row)


@pytest.mark.parametrize("joint", [Revolute, PointOnLine, Distance])
def test_the_curvature_of_one_row_left_out_is_seen(joint: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    right, cases = joint.jacobian, coarse()

    def wrong(*values: Any) -> Any:
        return tuple((without_curvature(block[0]), *block[1:]) for block in right(*values))

    monkeypatch.setattr(joint, "jacobian", staticmethod(wrong))
    assert misses(cases)[1] > 0


def test_one_wrong_entry_of_the_jacobian_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    right, cases = Revolute.jacobian, coarse()

    def wrong(*values: Any) -> Any:
        block_i, ((x, y, phi), *rest) = right(*values)
        return block_i, ((x, y, phi * 1.001), *rest)

    monkeypatch.setattr(Revolute, "jacobian", staticmethod(wrong))
    assert misses(cases)[1] > 0


@pytest.mark.parametrize("level", RATES)
def test_rates_taken_at_the_improved_point_instead_of_around_it_are_seen(
    level: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    right, cases = Nearly.box, coarse()

    def wrong(self: Nearly) -> Any:
        return right(Nearly(self.given, self.shift, 0.0 * self.remainder))

    monkeypatch.setattr(Nearly, "box", wrong)
    assert misses(cases, level)[1] > 0


def test_what_an_inverse_leaves_of_jacobians_is_bounded_by_the_worst_of_them_and_not_by_much_more() -> None:
    """Of entries known to a rounding of up to 1e-3: the worst has |I - R mid| + |R| rounding."""
    system, q, t = poses(8, seed=5)[0]
    pose, rng = Preconditioned(system, np.arange(system.n), q, t, 0), np.random.default_rng(4)
    slope = system.phi_q(q, t) + rng.uniform(-1e-3, 1e-3, (system.n, system.n, len(t)))
    rounding, v = rng.uniform(0.0, 1e-3, slope.shape), rng.uniform(0.5, 1.0, q.shape)
    worst = np.abs(np.eye(system.n)[..., None] - np.einsum("ijb,jkb->ikb", pose.inverse, slope))
    worst += np.einsum("ijb,jkb->ikb", np.abs(pose.inverse), rounding)
    ratio = pose.defect_on(Bounds(slope, rounding, 0.0 * slope), v) / np.einsum("ijb,jb->ib", worst, v)

    assert np.min(ratio) >= 1.0
    assert np.max(ratio) < 1.0 + 1e-9


def test_a_box_around_a_sum_holds_it_though_its_middle_is_rounded() -> None:
    """Neither sum is a long double, be it known exactly or not."""
    for given, shift, remainder in (
        (1.0, 2.0**-70, 0.0),
        (1.0, 2.0**-70, 2.0**-80),
        (1024.0, 2.0**-55, 0.0),
        (1.0, 0.25, 0.0),
    ):
        (x,) = Nearly(*(np.full((1, 1), value) for value in (given, shift, remainder))).box()
        off = abs(float(x.mid[0] - given - shift)) + abs(float(np.longdouble(given) - x.mid[0] + shift))

        assert off + remainder <= (x.rounding + x.spread)[0] < 2.0**-60 * given


def test_the_position_bound_is_sharp() -> None:
    ratios = []
    for c in good():
        errors = [np.max(e.distance(c.q[:, k])) for k, e in enumerate(c.truth)]
        ratios.extend(c.certificate().position / errors)
    # Without a long double beyond binary64 the rounding of phi itself is in the bound.
    assert np.median(ratios) < (1.1 if Extended.unit < U else 50)


def test_an_answer_moved_by_two_radii_is_judged_outside() -> None:
    for c in good():
        radii = c.certificate().radii
        for k, truth in enumerate(c.truth):
            worst, moved = np.argmax(radii[:, k]), c.q[:, k].copy()
            while abs(moved[worst] - c.q[worst, k]) < 2 * radii[worst, k]:
                moved[worst] = np.nextafter(moved[worst], np.inf)
            assert judge(truth.q, moved, radii[:, k]).verdict is Verdict.OUTSIDE


def test_balls_wider_than_what_is_allowed_are_undecidable() -> None:
    system, q, t = poses(1, seed=4)[0]
    truth = krawczyk(system, q[:, 0], t[0], bits=53)
    assert truth is not None
    assert judge(truth.q, truth.nearest(), 1e-18).verdict is Verdict.UNDECIDABLE


def test_what_may_not_be_off_at_all_is_not_off_or_off_without_measure() -> None:
    truth = (arb(1.0), arb(2.0))

    assert judge(truth, np.array([1.0, 2.5]), [0.0, 1.0]) == Judgement(Verdict.INSIDE, 0.5)
    assert judge(truth, np.array([1.5, 2.5]), [0.0, 1.0]) == Judgement(Verdict.OUTSIDE, np.inf)


def test_float64_and_balls_prove_the_same_radius() -> None:
    for system, q, t in poses(40, seed=5):
        radii = certify(system, q, t).radii
        for k in range(len(t)):
            truth = krawczyk(system, q[:, k], t[k])
            assert truth is not None
            assert np.all(truth.distance(q[:, k]) <= radii[:, k] + 1e-28)  # the width of 113-bit balls


def test_what_a_law_loses_in_float64_is_in_the_bound() -> None:
    d = Drawn(np.random.default_rng(7), "bar")
    d.pin(GROUND, "bar")
    law = Sinusoid(amplitude=0.5, angular_frequency=1e3, phase=0.1)
    d.drivers.append(AngleDriver(name="motor", body="bar", law=law))
    system, start = d.system()
    t = 12345.678
    start[2] = law(t)
    truth = krawczyk(system, start, t, bits=200)
    assert truth is not None
    answer = np.array([*truth.nearest()[:2], start[2]])
    lost = float(truth.distance(answer)[2])
    proved = certify(system, answer[:, None], [t]).radii[2, 0]
    assert 1e-12 < lost <= proved <= lost * (1 + 1e-6)


@pytest.mark.parametrize("size", [2.0**-30, 2.0**30])
def test_a_change_of_unit_by_a_power_of_two_changes_no_bit_of_a_certificate(size: float) -> None:
    plain, scaled = (perturbed(four_bar(np.random.default_rng(8)), by) for by in (lambda x: x, lambda x: x * size))
    q = plain[1][:, None]
    assert np.array_equal(certify(plain[0], q, [0.0]).radii, certify(scaled[0], q, [0.0]).radii)


@pytest.mark.parametrize("seed", range(20))
def test_half_an_ulp_of_the_geometry_moves_the_pose_by_its_effect_on_phi_at_most(seed: int) -> None:
    rng, metre = np.random.default_rng(seed), Unit()
    system, q = perturbed(four_bar(np.random.default_rng([9, seed])), lambda x: x, metre)
    neighbour = perturbed(four_bar(np.random.default_rng([9, seed])), lambda x: beside(x, rng), metre)[0]
    one, two = krawczyk(system, q, 0.0, bits=200), krawczyk(neighbour, q, 0.0, bits=200)
    assert one is not None
    assert two is not None
    moved = np.abs([float(a - b) for a, b in zip(one.q, two.q, strict=True)])
    # A neighbour is at most two half-ulps U |x| away; the driver's law is not moved. Second order: 1e-9 of it.
    effect = input_effect(system, q[:, None], np.zeros(1), HALF_ULP)[:, 0]
    carried = np.abs(np.linalg.inv(system.phi_q(q, 0.0))) @ effect
    assert np.all(moved <= 2 * carried * (1 + 1e-9) + 1e-30)
    assert np.max(moved) > 0.02 * np.max(carried)


def beside(x: float, rng: np.random.Generator) -> float:
    return float(np.nextafter(x, rng.choice([-9.0, 9.0])))


def height(root: float) -> System:
    """A point above the origin, held at x = 0 and by a rod of length `root`: its height solves y^2 = root^2."""
    body = Body(name="b", estimate=(0.0, root, 0.0))
    rod = Distance(name="rod", body_i=GROUND, point_i=(0.0, 0.0), body_j="b", point_j=(0.0, 0.0), length=root)
    still = Polynomial(coefficients=(0.0,))
    drivers = (XDriver(name="x", body="b", law=still), AngleDriver(name="phi", body="b", law=still))
    return compile_system(Mechanism((body,), (rod,), drivers))


@pytest.mark.parametrize("away", [0.05, 0.2, 0.4, 0.5])
def test_the_radius_of_one_square_holds_its_root_also_where_the_root_is_beyond_newtons_step(away):
    """Newton's step from y is (y^2 - r^2) / (2 y), the way to the root y - r: longer, by what is of second order."""
    root = 1.0 - away
    certificate = certify(height(root), np.array([[0.0], [1.0], [0.0]]), np.zeros(1))

    assert certificate.ok[0]
    assert away <= certificate.radii[1, 0] <= 1.001 * away


def test_a_box_that_is_given_holds_the_root_or_is_not_proved() -> None:
    system, q = height(1.0), np.array([0.0, 1.001, 0.0])

    assert krawczyk(system, q, 0.0, radius=0.002) is not None
    assert krawczyk(system, q, 0.0, radius=0.0005) is None  # a wider box would hold it


@pytest.mark.parametrize("rate", [1.0, -1.0])
def test_the_bound_of_a_wrong_velocity_counts_what_the_inverse_at_a_pose_that_is_off_makes_of_it(rate):
    """The height rests; of a rate given at a pose 5 % too high the inverse there takes 95 % away."""
    root = 0.95
    qd = np.array([[0.0], [rate], [0.0]])
    certificate = certify(height(root), np.array([[0.0], [1.0], [0.0]]), np.zeros(1), qd)

    assert certificate.ok[0]
    assert 1.0 <= certificate.velocity[1, 0] <= 1.1


def test_the_radius_counts_what_the_inverse_of_two_nearly_parallel_lines_leaves():
    """Straight rows without curvature: a point is off along the lines by more than their rows have digits for."""
    body = Body(name="b", estimate=(0.0, 0.0, 0.0))
    ends: dict[str, Any] = {"body_i": GROUND, "point_i": (0.0, 0.0), "body_j": "b", "point_j": (0.0, 0.0)}
    lines = [
        PointOnLine(name=f"line {k}", **ends, axis_i=axis) for k, axis in enumerate([(1.0, 0.5), (1.0, 0.5 + 1e-7)])
    ]
    still = AngleDriver(name="phi", body="b", law=Polynomial(coefficients=(0.0,)))
    system = compile_system(Mechanism((body,), tuple(lines), (still,)))
    for along in (0.1, -0.3, 0.7):
        q = along * np.array([[1.0], [0.5], [0.0]])
        certificate = certify(system, q, np.zeros(1))

        assert certificate.ok[0]
        assert (np.abs(q + certificate.root.shift) <= certificate.root.remainder).all()
        assert (np.abs(q) <= certificate.radii).all()


def test_a_ball_reaches_no_further_than_the_slopes_that_its_proof_has_looked_at():
    """A step of 1 of which an inverse leaves a part has a ball of 1 / (1 - part); slopes are known on one of 2.5.

    Where they change, what the inverse leaves at the root is what it leaves at the pose and the change on the way.
    """
    left, bend = np.array([0.2, 0.5, 0.7, 0.95]), 0.1
    pose: Any = SimpleNamespace(
        q=np.zeros((1, 4)),
        carried=lambda _: (np.ones((1, 4)), np.zeros((1, 4))),
        slope_over=lambda _: SimpleNamespace(spread=None),
        defect_on=lambda _, w: left * w,
        spread_on=lambda *_: BOX * bend * np.array([[1.0, 0.0, 0.0, 0.0]]),
    )
    phi: Any = None

    ball, radius = _Ball(pose, phi), (0.8 - math.sqrt(0.8**2 - 2 * bend)) / bend

    assert ball.ok.tolist() == [True, True, False, False]
    assert ball.radii[0, :2] == pytest.approx([radius, 2.0], rel=1e-5)
    assert ball.defect_at_root[0, :2] == pytest.approx([0.2 + bend * radius, 0.5], rel=1e-5)


@pytest.mark.parametrize("evidence", [{"certificate"}, set()])
def test_what_an_inverse_leaves_all_of_proves_nothing(evidence):
    """Two plates as one, on a rack and in a slot across it: a pose that moves on was ok, with a radius below 0."""
    pins = (
        Revolute(name=name, body_i="a", point_i=at, body_j="b", point_j=at)
        for name, at in (("pin", (-3.0, 1.0)), ("second pin", (0.0, 0.0)))
    )
    wheel: dict[str, Any] = {"body_i": GROUND, "point_i": (4.0, 0.0), "body_j": "b", "point_j": (4.0, 0.0)}
    slot: dict[str, Any] = {"body_i": GROUND, "point_i": (-2.0, -3.0), "body_j": "a", "point_j": (-2.0, -3.0)}
    held = (
        RackAndPinion(name="rack", **wheel, axis_i=(3.0, 4.0), radius=2.0),
        PointOnLine(name="slot", **slot, axis_i=(-4.0, 3.0)),
    )
    bodies = tuple(Body(name=name, estimate=(0.0, 0.0, 0.0)) for name in "ba")
    mechanism = Mechanism(bodies, (*held, *pins))
    motion = solve(Scene(mechanism=mechanism, times=(0.0,), effects=frozenset(), evidence=frozenset(evidence)))

    assert motion.verdict == "singular"
    assert "idle motion: no driver holds b and a" in motion.message
