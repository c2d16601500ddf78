"""Every number of an element counts: `test_joints` sees a wrong one where it holds the formulas against it."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from refkin.joints import elements_of
from refkin.motion_laws import Polynomial
from tests.refkin.joint_cases import TIMES, UNITS, constraints, name_of, state, system_of
from tests.refkin.joint_geometry import expected_rows

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
