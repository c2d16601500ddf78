"""Contact parameters among the coordinates: where they sit, and that nothing else is taken for one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import refkin
from refkin import Body, Mechanism, Point, Polar, compile_system
from refkin.output import Drawing

from .contact_cases import CASES, scene


def test_parameters_come_after_all_bodies():
    system = compile_system(scene("plate over lobes").mechanism)

    assert (system.n, system.m, system.of_bodies) == (7, 7, 6)
    assert system.parameter("contact") == slice(6, 7)
    assert system.parameter("guide of follower") == slice(0, 0)
    assert system.angles.tolist() == [False, False, True, False, False, True, True]


def test_units_change_lengths_and_leave_parameters_alone():
    mechanism = scene("plate over lobes").mechanism
    system = compile_system(mechanism, unit=refkin.Unit(0.25, (3.0, -2.0)))
    q = np.arange(1.0, 8.0)

    assert system.to_unit(q).tolist() == [-8.0, 16.0, 3.0, 4.0, 28.0, 6.0, 7.0]
    assert system.to_physical(system.to_unit(q)).tolist() == q.tolist()
    assert system.to_physical(system.to_unit(q, 1), 1).tolist() == q.tolist()


def test_a_body_asked_for_alone_is_that_body_and_its_point_lies_on_it():
    whole = replace(scene("lever over lobes"), points=(Point(name="tip", body="follower", position=(2.0, 0.0)),))
    motion, alone = refkin.solve(whole), refkin.solve(replace(whole, bodies_wanted=("follower",)))

    assert np.array_equal(alone.q, motion["follower"].q)
    assert np.array_equal(alone.points["tip"].r[0], 3.0 + 2.0 * np.cos(motion["follower"].phi))


@pytest.mark.parametrize("name", CASES)
def test_the_order_of_bodies_and_joints_does_not_matter(name):
    m = scene(name).mechanism
    other = replace(scene(name), mechanism=Mechanism(m.bodies[::-1], m.joints[::-1], m.drivers[::-1]))
    one, two = refkin.solve(scene(name)), refkin.solve(other)
    allowed = m.size() * (one.certified_radius.position + two.certified_radius.position) + 1e-15

    for body in one.bodies:
        assert np.all(np.max(np.abs(one[body].q - two[body].q), axis=0) <= allowed)


def times(lengths, factor):
    return tuple(x * factor for x in lengths) if isinstance(lengths, tuple) else lengths * factor


def scaled(item, factor):
    """A joint, driver or law with all its lengths multiplied."""
    lengths = {"point", "point_i", "point_j", "radius", "radius_i", "radius_j", "s0", "roller_radius", "length"}
    of_lengths = {"offset", "amplitude", "coefficients", "value"}
    keys = {}
    for key in item.__dataclass_fields__:
        value = getattr(item, key)
        if key in lengths and value is not None:
            keys[key] = times(value, factor)
        elif key == "profile":
            keys[key] = scaled(value, factor)
        elif key == "law" and (isinstance(item, Polar) or item.type in ("x", "y")):
            law = {k: getattr(value, k) for k in of_lengths & value.__dataclass_fields__.keys()}
            keys[key] = replace(value, **{k: times(v, factor) for k, v in law.items()})
        elif key == "offset_law" and value is not None:
            laws = [{k: getattr(law, k) for k in of_lengths & law.__dataclass_fields__.keys()} for law in value]
            parts = [{k: times(v, factor) for k, v in law.items()} for law in laws]
            keys[key] = tuple(replace(law, **part) for law, part in zip(value, parts, strict=True))
    return replace(item, **keys)


@pytest.mark.parametrize("name", CASES)
def test_a_copy_of_another_size_gives_the_same_bits(name):
    factor = 2.0**-30
    m = scene(name).mechanism
    bodies = tuple(Body(name=b.name, estimate=(*(x * factor for x in b.estimate[:2]), b.estimate[2])) for b in m.bodies)
    small = Mechanism(bodies, *(tuple(scaled(c, factor) for c in group) for group in (m.joints, m.drivers)))
    one, two = refkin.solve(scene(name)), refkin.solve(replace(scene(name), mechanism=small))

    for body in one.bodies:
        assert np.array_equal(one[body].qdd * [[factor], [factor], [1.0]], two[body].qdd)
    assert np.array_equal(one.certified_radius.position, two.certified_radius.position)
    drawn = [[s for part in Drawing(m.scene, m).parts for s in part.at(0)] for m in (one, two)]
    for shape, copy in zip(*drawn, strict=True) if name != "crank by its rate" else ():  # it has no length
        assert (shape.role, shape.radius * factor) == (copy.role, copy.radius)
        assert copy.points / factor == pytest.approx(shape.points, abs=1e-12)
