"""Every joint and driver: its residual against its meaning, its other formulas against it, in every arithmetic."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from flint import arb, ctx

from refkin.differences import EPS, Scheme, jacobian, step
from refkin.errors import Fault
from refkin.joints import DRIVER_TYPES, JOINT_TYPES, AngleDriver, Constraint, elements_of
from refkin.motion_laws import Polynomial
from refkin.proof.numbers.exact import exact_system
from refkin.proof.pose.krawczyk import objects
from refkin.system import System
from tests.claims import U, assert_near
from tests.refkin.joint_cases import LAW, TIMES, UNITS, constraints, name_of, state, system_of
from tests.refkin.joint_geometry import expected_rows, powers

ROUNDING = 256 * U
"""What about a hundred roundings of numbers of the size of the largest term may leave, with a reserve of two."""
STEP = 1e-100


def cases() -> Iterator[tuple[Constraint, System, slice, float]]:
    """Yield each constraint with its system in each unit, its rows, and a time."""
    for constraint in constraints():
        for unit, t in zip(UNITS, TIMES, strict=True):
            yield constraint, *system_of(constraint, unit), t


def size(*values: Any) -> float:
    """Return the largest number, by which rounding errors grow; at least 1."""
    return max(1.0, *(float(np.max(np.abs(v), initial=0.0)) for v in values))


def _phi(system: System, t: float, q: Any) -> Any:
    return system.phi(q, t)


def test_residual_is_the_geometry():
    """The residual of every joint and driver is what its elements mean, row by row, in metres and in other units."""
    for c, system, rows, t in cases():
        q, _, _ = state(system)
        physical = system.to_physical(q)
        pose = {
            b.name: (complex(*physical[3 * k : 3 * k + 2]), float(physical[3 * k + 2]))
            for k, b in enumerate(system.mechanism.bodies)
        }
        pose["ground"] = (0j, 0.0)
        s = float(q[-1]) if c.parameters else 0.0
        scale = system.unit.size
        expected = [
            x / scale**p for e in elements_of([c]) for x, p in zip(expected_rows(e, pose, t, s), powers(e), strict=True)
        ]
        allowed = ROUNDING * size(expected, physical / scale) ** 2
        assert_near(system.phi(q, t)[rows], expected, allowed, name_of(c))


def test_jacobian_is_the_derivative():
    """The Jacobian of every joint and driver is the complex-step derivative of its residual."""
    for c, system, rows, t in cases():
        q, _, _ = state(system)
        slope = system.phi_q(q, t)[rows]
        exact = jacobian(partial(_phi, system, t), q, Scheme.COMPLEX_STEP)[rows]
        assert_near(slope, exact, ROUNDING * size(slope), name_of(c))


def test_nu_is_minus_the_time_derivative():
    """The velocity side of every joint and driver is minus the derivative of its residual by time."""
    for c, system, rows, t in cases():
        q, _, _ = state(system)
        moved = system.phi(q.astype(complex), t + STEP * 1j)[rows]
        nu = system.nu(q, t)
        assert nu.shape == (system.m,), f"{name_of(c)}: nu has shape {nu.shape} for {system.m} rows"
        assert_near(nu[rows], -np.imag(moved) / STEP, ROUNDING * size(nu), name_of(c))


def test_gamma_has_every_term():
    """phi_q qdd - gamma of every joint and driver is the derivative of phi_q qd - nu along a motion."""
    for c, system, rows, t in cases():
        q, qd, qdd = state(system)
        e = STEP * 1j
        moved = system.phi_q(q + e * qd, t + e) @ (qd + e * qdd) - system.nu(q + e * qd, t + e)
        left, gamma = system.phi_q(q, t) @ qdd, system.gamma(q, qd, t)
        assert_near((left - gamma)[rows], np.imag(moved)[rows] / STEP, ROUNDING * size(left, gamma), name_of(c))


def test_rows_of_samples_are_the_samples():
    """A batch of configurations gives sample by sample what one configuration gives."""
    for c, system, rows, _ in cases():
        states = [state(system, seed) for seed in range(3)]
        q, qd = (np.stack([each[k] for each in states], axis=-1) for k in (0, 1))
        t = np.linspace(0.1, 0.9, 3)
        whole = (system.phi(q, t), system.phi_q(q, t), system.nu(q, t), system.gamma(q, qd, t))
        for k in range(3):
            at = q[:, k], t[k]
            sample = (system.phi(*at), system.phi_q(*at), system.nu(*at), system.gamma(q[:, k], qd[:, k], t[k]))
            for a, b in zip(whole, sample, strict=True):
                assert_near(a[rows][..., k], b[rows], ROUNDING * size(b), name_of(c))


def test_balls_hold_what_floats_give():
    """On balls, with the scene's numbers exact, the same formulas give what floats give, to round-off."""
    for c, system, rows, t in cases():
        q, qd, _ = state(system)
        exact = exact_system(system, 113)
        with ctx.workprec(113):
            at, rate, when = *(objects([arb(x) for x in level.tolist()]) for level in (q, qd)), arb(t)
            balls = (exact.phi(at, when), exact.phi_q(at, when), exact.nu(at, when), exact.gamma(at, rate, when))
            listed = [np.array([float(arb(x)) for x in np.ravel(b[rows])]) for b in balls]
        floats = (system.phi(q, t), system.phi_q(q, t), system.nu(q, t), system.gamma(q, qd, t))
        for a, b in zip(listed, floats, strict=True):
            assert_near(a, np.ravel(b[rows]), 4 * ROUNDING * size(b), name_of(c))


class Recorder:
    """A law that writes down which of its derivatives are asked for."""

    def __init__(self) -> None:
        self.orders: set[int] = set()

    def __call__(self, t: Any, order: int = 0) -> Any:
        self.orders.add(order)
        return LAW(t, order)

    def domain(self) -> tuple[float, float]:
        return LAW.domain()

    def integral(self, t: Any) -> Any:
        return LAW.integral(t)

    def faults(self, path: str) -> Iterator[Fault]:
        return iter(())


def test_laws_are_asked_no_further_than_needed():
    """Both phi and phi_q ask a law for its value alone, nu for the first derivative, gamma for the second."""
    law = Recorder()
    system, _ = system_of(AngleDriver(name="c", body="b", law=law), UNITS[0])  # type: ignore[arg-type]
    q, qd, _ = state(system)
    calls: tuple[tuple[Callable[[], Any], int], ...] = (
        (lambda: system.phi(q, 0.3), 0),
        (lambda: system.phi_q(q, 0.3), 0),
        (lambda: system.nu(q, 0.3), 1),
        (lambda: system.gamma(q, qd, 0.3), 2),
    )
    for call, highest in calls:
        law.orders.clear()
        call()
        assert max(law.orders, default=0) == highest, (
            f"orders {law.orders} were asked for, {highest} is the highest needed"
        )


def test_every_type_is_among_the_cases():
    """No joint or driver type is left out of these checks."""
    assert {type(c) for c in constraints()} == {*JOINT_TYPES, *DRIVER_TYPES}, "a type has no case"


def test_profiles_reach_the_third_derivative():
    """A moving contact on a curve takes third derivatives of its profile: the cases' laws have them."""
    for c in constraints():
        law = getattr(getattr(c, "profile", None), "law", None)
        assert law is None or abs(law(0.3, 3)) > 0.01, f"{name_of(c)}: its third derivative vanishes"


def test_a_difference_takes_a_step_of_the_best_part_of_a_coordinate_and_of_one_where_it_is_smaller() -> None:
    """Rounding over h against h, or h^2, of the next derivative (Nocedal and Wright, section 8.1)."""
    x = np.array([0.0, 0.3, -0.9, 5.0, -3e4])
    sizes = np.array([1.0, 1.0, 1.0, 5.0, 3e4])
    for scheme, power in ((Scheme.FORWARD, 1 / 2), (Scheme.CENTRAL, 1 / 3)):
        h = step(scheme, x)
        assert_near(h / sizes, EPS**power * np.ones(5), 4 * U, f"{scheme}")
        assert not ((x + h) - x - h).any(), f"{scheme}: the step is rounded"


CASES = [(c, element) for c in constraints() for element in elements_of([c])]
NUMBERED = [(c, e, f.name) for c, e in CASES for f in fields(e) if f.name not in ("name", "row", "kind", "rows")]


def rows(c, element):
    """Return formula and statement of an element's rows, at a random configuration in metres."""
    system, _ = system_of(c, UNITS[0])
    q, _, _ = state(system)
    pose = {b.name: (complex(*q[3 * k : 3 * k + 2]), q[3 * k + 2]) for k, b in enumerate(system.mechanism.bodies)}
    pose["ground"] = (0j, 0.0)
    ours = system.phi(q, TIMES[0])[element.row : element.row + element.rows]
    return ours, np.array(expected_rows(element, pose, TIMES[0], q[-1] if c.parameters else 0.0))


def broken(value):
    """Yield a value with one of its numbers, or its body, wrong; nothing where there is none."""
    if isinstance(value, str):
        yield "b" if value == "a" else "a"
    elif isinstance(value, tuple):
        yield from ((*value[:k], wrong, *value[k + 1 :]) for k, x in enumerate(value) for wrong in broken(x))
    elif isinstance(value, float):
        yield value + 0.1
    elif callable(value):
        yield Polynomial(coefficients=(0.6, 0.3))


@pytest.mark.parametrize("c", constraints(), ids=name_of)
def test_a_joint_has_as_many_rows_as_its_elements(c):
    assert sum(element.rows for element in elements_of([c])) == c.rows


@pytest.mark.parametrize(("c", "element", "key"), NUMBERED, ids=[f"{name_of(c)}, {e.key}, {k}" for c, e, k in NUMBERED])
def test_a_wrong_number_in_an_element_is_seen(c, element, key):
    if element.laws and key in ("length", "angle"):
        return  # the law stands in its place
    wrongs = list(broken(getattr(element, key)))
    apart = [np.max(np.abs(np.subtract(*rows(c, replace(element, **{key: wrong}))))) for wrong in wrongs]

    assert not wrongs or max(apart) > 1e-3


def test_no_body_of_an_element_is_another_than_its_joints():
    assert all({*element.bodies} <= {*c.bodies} for c, element in CASES)
