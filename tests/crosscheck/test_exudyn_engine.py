"""exudyn's motions against closed forms, what it refuses, and faults that must not pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpmath import mp, mpf

import refkin
from crosscheck.engines import OF_SPACE, Engine, EngineError, Level, load, refusals
from crosscheck.engines.exudyn.engine import CAPABILITIES, SHIPPED, STATIC, Exudyn
from crosscheck.engines.exudyn.solve import solved
from crosscheck.judge.budget import derive
from crosscheck.measure.check import check
from refkin.joints import (
    AngleDriver,
    Constraint,
    Distance,
    DistanceDriver,
    Fixed,
    Gear,
    PointOnLine,
    Prismatic,
    RackAndPinion,
    Revolute,
    XDriver,
    YDriver,
    elements_of,
)
from refkin.model import Body, Effect, Mechanism, Scene
from refkin.motion import Motion, Seeding, Status
from refkin.motion_laws import Polynomial, Table
from refkin.system import compile_system

Truth = Callable[[Any], dict[str, tuple[Any, Any]]]
"""t -> per body where its origin is (a complex number) and how it is turned, in mpmath numbers."""

THETA = (0.4, 2.0, 0.3)
TIMES = tuple(float(t) for t in np.linspace(0.0, 2.5, 26))


@dataclass(frozen=True)
class Case:
    """A mechanism, its closed form, and the lengths on which it was built."""

    joints: tuple[Constraint, ...]
    drivers: tuple[Any, ...]
    truth: Truth

    def scene(self, times: tuple[float, ...] = TIMES, order: tuple[str, ...] | None = None, **more: Any) -> Scene:
        """Return the scene, started at an estimate that is off by up to 2 % of a radian or metre."""
        start = self.truth(mpf(times[0]))
        bodies = []
        for k, name in enumerate(order or tuple(start)):
            z, phi = start[name]
            off = 0.02 * np.sin(1.0 + k)
            size = float(abs(z)) or 1.0
            bodies.append(Body(name=name, estimate=(float(z.real) + off * size, float(z.imag), float(phi) + off)))
        return Scene(mechanism=Mechanism(tuple(bodies), self.joints, self.drivers), times=times, **more)

    def exact(self, scene: Scene) -> tuple[Any, Any, Any]:
        """Return q, qd, qdd (n, T) of the wanted bodies: derivatives of the closed form in 60 digits, by mpmath."""

        def coordinate(name: str, k: int) -> Callable[[Any], Any]:
            def value(t: Any) -> Any:
                z, phi = self.truth(t)[name]
                return (mp.re(z), mp.im(z), phi)[k]

            return value

        rows = [coordinate(name, k) for name in scene.wanted for k in range(3)]
        with mp.workdps(60):
            levels = [[[mp.diff(f, mpf(t), n) for t in scene.times] for f in rows] for n in range(3)]
            q, qd, qdd = (np.array(level, float) for level in levels)
        return q, qd, qdd


def theta(t: Any, law: tuple[float, ...] = THETA) -> Any:
    """Return the crank's angle at t."""
    return law[0] + law[1] * t + mpf(law[2]) * t * t


def between(a: Any, ra: Any, b: Any, rb: Any, side: int) -> Any:
    """Return the point at distances ra from a and rb from b, to the left (1) or right (-1) of the line from a to b."""
    d = abs(b - a)
    along = (ra * ra - rb * rb + d * d) / (2 * d)
    return a + (b - a) / d * mp.mpc(along, side * mp.sqrt(ra * ra - along * along))


def motor(body: str = "crank", law: tuple[float, ...] = THETA) -> AngleDriver:
    """Return the driver of the crank."""
    return AngleDriver(name="motor", body=body, law=Polynomial(coefficients=law))


def pin(name: str, i: str, point_i: Any, j: str, point_j: Any) -> Revolute:
    """Return a revolute joint."""
    return Revolute(name=name, body_i=i, point_i=point_i, body_j=j, point_j=point_j)


def four_bar(
    side: int = 1,
    size: float = 1.0,
    origin: complex = 0.0,
    lengths: tuple[float, ...] = (4.0, 1.0, 3.5, 3.0),
    law: tuple[float, ...] = THETA,
) -> Case:
    """Return a four-bar of ground, crank, coupler, rocker, body frames in the middle of the links."""
    g, r, c, k = (size * length for length in lengths)
    a, d = (origin.real, origin.imag), (origin.real + g, origin.imag)

    def truth(t: Any) -> dict[str, tuple[Any, Any]]:
        pivot, far = mp.mpc(*a), mp.mpc(*d)
        p = pivot + r * mp.expj(theta(t, law))
        s = between(p, mpf(c), far, mpf(k), side)
        return {
            "crank": ((pivot + p) / 2, theta(t, law)),
            "coupler": ((p + s) / 2, mp.arg(s - p)),
            "rocker": ((far + s) / 2, mp.arg(s - far)),
        }

    joints = (
        pin("A", "ground", a, "crank", (-r / 2, 0.0)),
        pin("P", "crank", (r / 2, 0.0), "coupler", (-c / 2, 0.0)),
        pin("S", "coupler", (c / 2, 0.0), "rocker", (k / 2, 0.0)),
        pin("D", "ground", d, "rocker", (-k / 2, 0.0)),
    )
    return Case(joints, (motor(law=law),), truth)


def massless_coupler() -> Case:
    """Return the same four-bar with a distance joint for its coupler."""
    whole = four_bar()
    rod = Distance(name="rod", body_i="crank", point_i=(0.5, 0.0), body_j="rocker", point_j=(1.5, 0.0), length=3.5)
    return Case(
        (whole.joints[0], rod, whole.joints[3]),
        whole.drivers,
        lambda t: {name: pose for name, pose in whole.truth(t).items() if name != "coupler"},
    )


def slider_crank(side: int = 1) -> Case:
    """Return crank 1, rod 3, offset 0.4, on a guide tilted by 0.3 with a slider turned by 0.8 against it."""
    r, rod, offset, tilt, turned = 1.0, 3.0, 0.4, 0.3, 0.8
    axis = (2.0 * np.cos(tilt), 2.0 * np.sin(tilt))
    on_guide = (float(-offset * np.sin(tilt)), float(offset * np.cos(tilt)))

    def truth(t: Any) -> dict[str, tuple[Any, Any]]:
        u = mp.mpc(*axis) / abs(mp.mpc(*axis))
        p = r * mp.expj(theta(t))
        guide = mp.mpc(*on_guide)
        seen = (p - guide) / u
        s = guide + u * (seen.real + side * mp.sqrt(mpf(rod) ** 2 - seen.imag**2))
        return {"crank": (p / 2, theta(t)), "rod": ((p + s) / 2, mp.arg(s - p)), "slider": (s, mpf(turned))}

    joints = (
        pin("A", "ground", (0.0, 0.0), "crank", (-r / 2, 0.0)),
        pin("P", "crank", (r / 2, 0.0), "rod", (-rod / 2, 0.0)),
        pin("S", "rod", (rod / 2, 0.0), "slider", (0.0, 0.0)),
        Prismatic(
            name="guide",
            body_i="ground",
            point_i=on_guide,
            axis_i=axis,
            body_j="slider",
            point_j=(0.0, 0.0),
            angle=turned,
        ),
    )
    return Case(joints, (motor(),), truth)


def moving_guide(block: bool) -> Case:
    """Return a crank whose pin slides in a lever pivoted at -2, with a block turned by -0.5 in between, or without."""
    r, pivot, turned = 1.0, (-2.0, 0.5), -0.5

    def truth(t: Any) -> dict[str, tuple[Any, Any]]:
        p, d = r * mp.expj(theta(t)), mp.mpc(*pivot)
        lever = mp.arg(p - d)
        poses = {"crank": (p / 2, theta(t)), "lever": (d, lever)}
        return {**poses, "block": (p, lever + mpf(turned))} if block else poses

    ends = [pin("A", "ground", (0.0, 0.0), "crank", (-r / 2, 0.0)), pin("D", "ground", pivot, "lever", (0.0, 0.0))]
    guide: dict[str, Any] = {"name": "guide", "body_i": "lever", "point_i": (0.2, 0.0), "axis_i": (3.0, 0.0)}
    if block:
        slide: Constraint = Prismatic(**guide, body_j="block", point_j=(0.0, 0.0), angle=turned)
        return Case((*ends, pin("P", "crank", (r / 2, 0.0), "block", (0.0, 0.0)), slide), (motor(),), truth)
    return Case((*ends, PointOnLine(**guide, body_j="crank", point_j=(r / 2, 0.0))), (motor(),), truth)


def welded() -> Case:
    """Return a crank with a plate fixed to its end, turned by 0.9."""

    def truth(t: Any) -> dict[str, tuple[Any, Any]]:
        end, turned = mp.expj(theta(t)), theta(t) + mpf(0.9)
        return {"crank": (0 * end, theta(t)), "plate": (end - mp.mpc(0.3, 0.2) * mp.expj(turned), turned)}

    weld = Fixed(name="weld", body_i="crank", point_i=(1.0, 0.0), body_j="plate", point_j=(0.3, 0.2), angle=0.9)
    return Case((pin("A", "ground", (0.0, 0.0), "crank", (0.0, 0.0)), weld), (motor(),), truth)


def arm(drivers: tuple[Any, ...], truth: Truth) -> Case:
    """Return two links of 1 and 0.8 in a row, frames at their first ends."""
    joints = (pin("A", "ground", (0.0, 0.0), "upper", (0.0, 0.0)), pin("B", "upper", (1.0, 0.0), "lower", (0.0, 0.0)))
    return Case(joints, drivers, truth)


def elbow() -> Case:
    """Return the arm with its second link driven against the first."""
    bend = AngleDriver(name="bend", body="lower", relative_to="upper", law=Polynomial(coefficients=(0.5, 0.7)))

    def truth(t: Any) -> dict[str, tuple[Any, Any]]:
        turned = theta(t) + mpf(0.5) + mpf(0.7) * t
        return {"upper": (mp.mpc(0), theta(t)), "lower": (mp.expj(theta(t)), turned)}

    return arm((motor("upper"), bend), truth)


def reach() -> Case:
    """Return the arm with its tip driven in x and y."""
    x, y = (1.1, 0.1, -0.02), (0.6, -0.2)
    tip: dict[str, Any] = {"body": "lower", "point": (0.8, 0.0)}
    drivers = (
        XDriver(name="x", law=Polynomial(coefficients=x), **tip),
        YDriver(name="y", law=Polynomial(coefficients=y), **tip),
    )

    def truth(t: Any) -> dict[str, tuple[Any, Any]]:
        at = mp.mpc(x[0] + x[1] * t + mpf(x[2]) * t * t, y[0] + y[1] * t)
        b = between(mp.mpc(0), mpf(1), at, mpf(0.8), 1)
        return {"upper": (mp.mpc(0), mp.arg(b)), "lower": (b, mp.arg(at - b))}

    return arm(drivers, truth)


def cylinder() -> Case:
    """Return a boom of 1 about the origin, lifted by a cylinder from (1.5, -0.5) to its end."""
    foot, length = (1.5, -0.5), (1.2, 0.2, -0.01)
    lift = DistanceDriver(
        name="lift",
        body_i="ground",
        point_i=foot,
        body_j="boom",
        point_j=(1.0, 0.0),
        law=Polynomial(coefficients=length),
    )

    def truth(t: Any) -> dict[str, tuple[Any, Any]]:
        f = length[0] + length[1] * t + mpf(length[2]) * t * t
        return {"boom": (mp.mpc(0), mp.arg(between(mp.mpc(0), mpf(1), mp.mpc(*foot), f, 1)))}

    return Case((pin("A", "ground", (0.0, 0.0), "boom", (0.0, 0.0)),), (lift,), truth)


def geared_five_bar() -> Case:
    """Return two geared cranks whose tips carry two links with a common end; the second wheel is the larger one."""

    def truth(t: Any) -> dict[str, tuple[Any, Any]]:
        first, second = theta(t), mpf(0.25) + mpf(-0.5) / mpf(0.75) * (theta(t) - mpf(0.125))
        p, s = mp.expj(first), 2 + mp.expj(second)
        tip = between(p, mpf(2), s, mpf(1.75), 1)
        return {
            "crank": (mp.mpc(0), first),
            "wheel": (mp.mpc(2), second),
            "left": (p, mp.arg(tip - p)),
            "right": (s, mp.arg(tip - s)),
        }

    teeth = Gear(name="teeth", body_i="crank", radius_i=0.5, phi0_i=0.125, body_j="wheel", radius_j=0.75, phi0_j=0.25)
    joints = (
        pin("A", "ground", (0.0, 0.0), "crank", (0.0, 0.0)),
        pin("D", "ground", (2.0, 0.0), "wheel", (0.0, 0.0)),
        pin("P", "crank", (1.0, 0.0), "left", (0.0, 0.0)),
        pin("S", "wheel", (1.0, 0.0), "right", (0.0, 0.0)),
        pin("T", "left", (2.0, 0.0), "right", (1.75, 0.0)),
        teeth,
    )
    return Case(joints, (motor(),), truth)


CASES: dict[str, Callable[[], Case]] = {
    "four-bar": four_bar,
    "four-bar crossed": lambda: four_bar(-1),
    "four-bar of 1e-9 m": lambda: four_bar(1, 1e-9),
    "four-bar of 1e9 m": lambda: four_bar(-1, 1e9),
    "four-bar 1e6 m away": lambda: four_bar(1, 1.0, complex(1e6, -2e6)),
    "four-bar after 1600 turns": lambda: four_bar(law=(1e4, 2.0, 0.3)),
    "four-bar with a massless coupler": massless_coupler,
    "slider-crank": slider_crank,
    "slider-crank crossed": lambda: slider_crank(-1),
    "moving guide": lambda: moving_guide(block=True),
    "point on a moving line": lambda: moving_guide(block=False),
    "fixed": welded,
    "relative angle": elbow,
    "x and y of a point": reach,
    "driven distance": cylinder,
    "geared five-bar": geared_five_bar,
}


def ratios(case: Case, scene: Scene, motion: Motion, terms: tuple[Any, ...] = ()) -> list[float]:
    """Return the largest error / allowed of position, velocity, acceleration: the derived budget at the closed form."""
    system = compile_system(scene.mechanism, unit=scene.mechanism.unit())
    size = np.tile([system.unit.size, system.unit.size, 1.0], len(scene.mechanism.bodies))[:, None]
    shift = np.tile([*system.unit.origin, 0.0], len(scene.mechanism.bodies))[:, None]
    exact = case.exact(scene)
    q, qd, qdd = (exact[0] - shift) / size, exact[1] / size, exact[2] / size
    budget = derive(system, motion, q, qd, qdd, terms)
    rows = []
    for k, allowed in enumerate((budget.position, budget.velocity, budget.acceleration)):
        level = motion.levels[k]
        assert level is not None
        error = level - exact[k]
        if k == 0:
            error[2::3] = np.arctan2(np.sin(error[2::3]), np.cos(error[2::3]))
        rows.append(float(np.max(np.abs(error / size) / allowed)))
    return rows


@pytest.mark.parametrize("name", CASES)
def test_static_route_agrees_with_the_closed_form_within_the_budget(name: str) -> None:
    case = CASES[name]()
    scene = case.scene()
    motion = Exudyn().solve(scene)

    assert motion.verdict is Status.OK
    assert max(ratios(case, scene, motion)) < 1.0


@pytest.mark.parametrize("name", [n for n in CASES if n not in ("four-bar of 1e-9 m", "four-bar 1e6 m away")])
def test_shipped_route_agrees_with_the_closed_form_within_its_stopping_rule(name: str) -> None:
    case = CASES[name]()
    scene = case.scene()
    motion = Exudyn().solve(scene, SHIPPED)

    assert motion.verdict is Status.OK
    assert max(ratios(case, scene, motion, tuple(Exudyn().terms(scene, SHIPPED)))) < 1.0


def test_shipped_tolerances_do_not_see_a_linkage_of_a_nanometre_and_no_answer_is_ok() -> None:
    motion = Exudyn().solve(CASES["four-bar of 1e-9 m"]().scene(), SHIPPED)

    assert set(motion.status) == {Status.NOT_CONVERGED}
    assert np.all(np.isnan(motion.q))
    assert "reported success with a residual" in motion.message


def test_only_the_shipped_route_adds_to_the_allowed_error() -> None:
    scene = four_bar().scene()

    assert Exudyn().terms(scene) == Exudyn().terms(scene, STATIC) == ()
    assert [term.name for term in Exudyn().terms(scene, SHIPPED)] == ["stopping rule"]


def test_permuted_bodies_give_the_permuted_answer_within_the_budget() -> None:
    case = four_bar()
    scene = case.scene(order=("rocker", "crank", "coupler"))
    motion = Exudyn().solve(scene)

    assert motion.bodies == ("rocker", "crank", "coupler")
    assert max(ratios(case, scene, motion)) < 1.0


def test_only_what_is_called_for_is_reported() -> None:
    whole = Exudyn().solve(four_bar().scene())
    part = Exudyn().solve(four_bar().scene(effects=frozenset({Effect.ACCELERATION}), bodies_wanted=("rocker",)))
    position = Exudyn().solve(four_bar().scene(effects=frozenset()))

    assert part.qd is None
    assert part.bodies == ("rocker",)
    assert np.array_equal(whole["rocker"].qdd, part["rocker"].qdd)  # type: ignore[arg-type]
    assert position.qd is position.qdd is None
    assert np.array_equal(whole.q, position.q)


@pytest.mark.parametrize("slack", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("side", [1, -1])
def test_static_route_keeps_the_branch_past_a_near_change_point(slack: float, side: int) -> None:
    """There the branches come as near as sqrt(slack), and a step of 0.2 rad passes them at once."""
    case = four_bar(side, lengths=(5.5 - slack, 1.0, 3.5, 3.0))
    scene = case.scene()
    motion = Exudyn().solve(scene)

    assert motion.verdict is Status.OK
    assert max(ratios(case, scene, motion)) < 1.0


def test_times_out_of_reach_are_marked_and_the_others_are_answered() -> None:
    """The crank of a triple rocker is driven past its limit, 2.5477 rad, and back again."""
    case = four_bar(lengths=(4.0, 3.0, 3.5, 3.2), law=(2.0, 1.5, -0.75))
    scene = case.scene(times=tuple(np.linspace(0.0, 2.0, 21).tolist()))
    motion = Exudyn().solve(scene)
    reached = [2.0 + 1.5 * t - 0.75 * t * t < 2.5476 for t in scene.times]

    assert reached.count(False) == 11
    assert [status is Status.OK for status in motion.status] == reached
    assert [bool(np.all(np.isfinite(column))) for column in motion.q.T] == reached
    assert "11 of 21 times not ok, first t = 0.5" in motion.message


@pytest.mark.parametrize("route", [STATIC, SHIPPED])
def test_a_linkage_that_cannot_be_assembled_gets_no_answer_and_nothing_is_printed_or_written(
    route: Any, tmp_path: Any, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    whole = four_bar()
    short = replace(
        whole, joints=(*whole.joints[:2], pin("S", "coupler", (-1.7, 0.0), "rocker", (-1.4, 0.0)), whole.joints[3])
    )
    motion = Exudyn().solve(short.scene(), route)

    assert set(motion.status) == {Status.NOT_CONVERGED}
    assert np.all(np.isnan(motion.q))
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


def parallelogram() -> Case:
    """Return a parallelogram with a third crank, a rod between the middles of coupler and ground: one row too many."""

    def truth(t: Any) -> dict[str, tuple[Any, Any]]:
        end = mp.expj(theta(t))
        return {"crank": (end / 2, theta(t)), "coupler": (1 + end, mpf(0)), "rocker": (2 + end / 2, theta(t))}

    joints = (
        pin("A", "ground", (0.0, 0.0), "crank", (-0.5, 0.0)),
        pin("P", "crank", (0.5, 0.0), "coupler", (-1.0, 0.0)),
        pin("S", "coupler", (1.0, 0.0), "rocker", (0.5, 0.0)),
        pin("D", "ground", (2.0, 0.0), "rocker", (-0.5, 0.0)),
        Distance(name="rod", body_i="ground", point_i=(1.0, 0.0), body_j="coupler", point_j=(0.0, 0.0), length=1.0),
    )
    return Case(joints, (motor(),), truth)


def test_redundant_rows_are_solved_by_the_static_route() -> None:
    case = parallelogram()
    scene = case.scene(times=(0.0, 0.2, 0.4, 0.6, 0.8, 1.0))
    motion = Exudyn().solve(scene)

    assert motion.verdict is Status.OK
    assert max(ratios(case, scene, motion)) < 1.0


def test_redundant_rows_stop_the_shipped_settings_and_no_time_is_ok() -> None:
    assert set(Exudyn().solve(parallelogram().scene(), SHIPPED).status) == {Status.NOT_CONVERGED}


@pytest.mark.parametrize("route", [STATIC, SHIPPED])
def test_a_slider_that_starts_upside_down_is_never_taken_for_an_answer(route: Any) -> None:
    """exudyn's prismatic joint holds the sine of the angle, which is zero at a half turn as well."""
    scene = slider_crank().scene()
    x, y, phi = scene.mechanism.bodies[2].estimate or (0.0, 0.0, 0.0)
    flipped = Body(name="slider", estimate=(x, y, phi + np.pi))
    mechanism = Mechanism((*scene.mechanism.bodies[:2], flipped), scene.mechanism.joints, scene.mechanism.drivers)
    motion = Exudyn().solve(replace(scene, mechanism=mechanism), route)

    assert set(motion.status) == {Status.NOT_CONVERGED}
    assert "holds only the sine of 'guide'" in motion.message


def test_a_slider_that_starts_whole_turns_off_comes_back_on_the_turn_of_its_joint() -> None:
    case = slider_crank()
    scene = case.scene()
    x, y, phi = scene.mechanism.bodies[2].estimate or (0.0, 0.0, 0.0)
    turned = Body(name="slider", estimate=(x, y, phi - 3 * 2 * np.pi))
    mechanism = Mechanism((*scene.mechanism.bodies[:2], turned), scene.mechanism.joints, scene.mechanism.drivers)
    motion = Exudyn().solve(replace(scene, mechanism=mechanism))

    assert motion.verdict is Status.OK
    assert np.max(np.abs(motion["slider"].phi - 0.8)) < 1e-14


def test_rates_at_a_singular_jacobian_are_no_answer() -> None:
    singular, beyond_rounding = np.array([[1.0, 1.0], [1.0, 1.0]]), np.array([[1.0, 1.0], [1.0, 1.0 + 2.0**-52]])

    for matrix in (singular, beyond_rounding, np.vstack([singular, singular])):
        assert np.all(np.isnan(solved(matrix, np.arange(float(len(matrix))))))
    assert np.array_equal(solved(np.eye(2), np.array([1.0, 2.0])), [1.0, 2.0])


@pytest.mark.parametrize("kind", ["rate", "table"])
def test_a_law_by_rate_or_by_table_drives_as_the_polynomial_it_stands_for(kind: str) -> None:
    """The cubic spline through values of a quadratic is that quadratic."""
    law = (0.5, 2.0, 0.25)
    knots = [0.5 * k for k in range(6)]
    laws: dict[str, dict[str, Any]] = {
        "rate": {"rate_law": Polynomial(coefficients=(2.0, 0.5)), "initial": 0.5},
        "table": {"law": Table(argument=tuple(knots), value=tuple(0.5 + 2.0 * t + 0.25 * t * t for t in knots))},
    }
    case = replace(four_bar(law=law), drivers=(AngleDriver(name="motor", body="crank", **laws[kind]),))
    scene = case.scene()
    motion = Exudyn().solve(scene)

    assert motion.verdict is Status.OK
    assert max(ratios(case, scene, motion)) < 1.0


# What is declared and what is refused


def test_every_type_in_the_table_is_solved_by_a_case_above() -> None:
    solved = [c for build in CASES.values() for c in (*build().joints, *build().drivers)]

    assert set(CAPABILITIES) - set(OF_SPACE) == {element.key for element in elements_of(solved)}


def test_an_unknown_joint_is_refused_by_name_and_left_out_of_the_rows() -> None:
    whole = four_bar()
    ends: dict[str, Any] = {"body_i": "crank", "point_i": (0.0, 0.0), "body_j": "rocker", "point_j": (0.0, 0.0)}
    rack = RackAndPinion(name="R", **ends, axis_i=(1.0, 0.0), radius=1.0)
    scene = replace(whole, joints=(*whole.joints, rack)).scene()
    engine = Exudyn()

    assert refusals(engine, scene, Level.RESIDUAL) == [
        "exudyn refuses rack_and_pinion 'R' at residual: no such element in this engine: rolling on a line"
    ]
    assert "R" not in {row.constraint for row in engine.constraints(scene).rows}
    with pytest.raises(EngineError, match="refuses rack_and_pinion 'R' at solve: no such element"):
        engine.solve(scene)


def test_a_body_without_estimate_is_refused_by_name() -> None:
    scene = four_bar().scene()
    bodies = (scene.mechanism.bodies[0], Body(name="coupler"), scene.mechanism.bodies[2])
    lost = replace(scene, mechanism=Mechanism(bodies, scene.mechanism.joints, scene.mechanism.drivers))

    with pytest.raises(EngineError, match="no estimate for coupler"):
        Exudyn().solve(lost)


def test_an_unknown_route_is_refused_with_those_there_are() -> None:
    with pytest.raises(EngineError, match="no route 'dynamic'; there are: 'static', 'shipped'"):
        Exudyn().solve(four_bar().scene(), replace(STATIC, name="dynamic"))


def test_the_engine_is_registered_keeps_the_protocol_and_says_how_it_is_seeded() -> None:
    engine = load("exudyn")

    assert isinstance(engine, Engine)
    assert engine.version().startswith("1.13.")
    assert [(r.name, r.seeding) for r in engine.routes()] == [
        ("static", Seeding.INITIAL_GUESS),
        ("shipped", Seeding.INITIAL_GUESS),
    ]


def test_the_row_of_a_distance_driver_stops_as_early_as_its_length_allows() -> None:
    """Our row is exudyn's times the driven length, here 1.9 sizes: so is what its stopping rule leaves."""
    scene = refkin.load(Path(__file__).parents[1] / "corpus" / "exudyn-shipped-distance-driver.toml")
    record = check(scene, ["exudyn"])

    assert [item for item in record.disagreements if item.route == SHIPPED.name] == []
