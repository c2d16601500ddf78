"""How evidence and rates scale with the distance d to a singularity: the orders that theory gives, fitted.

A fold, phi(q) = d with phi'' != 0, has its roots sqrt(d) apart and phi' as small: sigma_min ~ d^(1/2), rates ~
d^(-1/2), accelerations ~ d^(-3/2); the box in which one root is proved to be the only one shrinks like sigma_min, and
the error that rounding leaves in float64 grows like its inverse. Where branches cross, both go on smoothly: sigma_min ~
d, rates and accelerations ~ 1. The next terms are d^(1/2), or d, smaller: over the distances below they move a fitted
order by less than 0.01.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

import refkin
from crosscheck.documents.convergence import slope
from refkin import FourBar, InvertedSliderCrank, Polynomial, SliderCrank, Status
from refkin.differences import EPS
from refkin.proof.pose.certificate import certify, unique_within
from tests.linkages import LIMITED, system_of

TOLERANCE = 0.02
DISTANCES = 10.0 ** np.arange(-7.0, -3.5, 0.5)


@dataclass(frozen=True)
class Law:
    """A scene at a distance d, and the orders in d of what is found there; None where no law is known.

    Attributes
    ----------
    sigma, rate, acceleration, unique : float or None
        Of sigma_min, of the largest rates, and of the half-width of the box in which the pose is the only one.
    """

    scene: object
    sigma: float
    rate: float
    acceleration: float | None
    unique: float


def four_bar(lengths, angle, **more):
    return FourBar(*lengths).scene(law=Polynomial(coefficients=(angle, 1.0)), times=(0.0,), **more)


def toggle(d):
    """A crank at d before its limit."""
    return LIMITED.scene(law=Polynomial(coefficients=(LIMITED.input_range()[0][1] - d, 1.0)), times=(0.0,))


def dead_centre(d):
    """A slider at d before the end of its stroke, 1/4 + 1/2."""
    law = Polynomial(coefficients=(0.75 - d, 1.0))
    return SliderCrank(0.25, 0.5).scene(driven="slider", law=law, times=(0.0,))


def near_change_point(d):
    """Links with a slack of d, where the branches come closest."""
    return four_bar((4.0, 1.0, 3.5, 1.5 + d), math.pi)


def change_point(d):
    return four_bar((4.0, 1.0, 3.5, 1.5), math.pi - d)


def parallelogram(d):
    return four_bar((3.0, 1.0, 3.0, 1.0), math.pi - d)


def kite(d):
    return four_bar((3.0, 1.0, 1.0, 3.0), math.pi - d)


def isosceles(d):
    """Crank and rod of one length: at a right angle the slider may stay at rest, or go on."""
    return SliderCrank(1.0, 1.0).scene(law=Polynomial(coefficients=(math.pi / 2 - d, 1.0)), times=(0.0,))


def near_pivot(d):
    """A crank pin that passes the pivot of its slot at d, seen when it has gone d / 2 beyond the nearest point."""
    law = Polynomial(coefficients=(d / 2, 1.0))
    return InvertedSliderCrank(ground=1.0 + d, crank=1.0).scene(law=law, times=(0.0,))


LAWS = {
    "toggle": Law(toggle, 0.5, -0.5, -1.5, 0.5),
    "dead centre": Law(dead_centre, 0.5, -0.5, -1.5, 0.5),
    # Of phi = y^2 - x^2 - d at x = 0: y ~ d^(1/2), dy/dx = x / y = 0, d2y/dx2 = 1 / y.
    "near change point": Law(near_change_point, 0.5, 0.0, -0.5, 0.5),
    "change point": Law(change_point, 1.0, 0.0, 0.0, 1.0),
    "parallelogram": Law(parallelogram, 1.0, 0.0, None, 1.0),
    "kite": Law(kite, 1.0, 0.0, None, 1.0),
    "isosceles slider-crank": Law(isosceles, 1.0, 0.0, None, 1.0),
    # Of the angle atan2(y, d): 1 / d and 1 / d^2.
    "pin near the slot's pivot": Law(near_pivot, 1.0, -1.0, -2.0, 1.0),
}


@pytest.fixture(scope="module", params=LAWS)
def found(request):
    """The law, and what is found at all distances, by name; (distances,) arrays."""
    law = LAWS[request.param]
    rows = []
    for d in DISTANCES:
        scene = law.scene(d)
        motion = refkin.solve(scene)
        system = system_of(scene)
        proof = certify(system, system.to_unit(motion.q), motion.t)
        unique = unique_within(system, proof.rows, system.to_unit(motion.q), motion.t, proof.position)
        assert motion.verdict is Status.OK
        rows.append(
            (
                motion.sigma_min[0],
                np.max(np.abs(motion.qd)),
                np.max(np.abs(motion.qdd)),
                unique[0],
                motion.certified_radius.position[0],
                proof.position[0],
            )
        )
    return law, dict(
        zip(("sigma", "rate", "acceleration", "unique", "radius", "certified"), np.array(rows).T, strict=True)
    )


@pytest.mark.parametrize("level", ["sigma", "rate", "acceleration"])
def test_a_level_scales_as_theory_says(found, level):
    law, values = found
    expected = getattr(law, level)
    if expected is None:  # a branch that goes on along a straight line, or stands still, accelerates by round-off
        assert np.max(values[level]) < 10.0
        return
    fitted = slope(DISTANCES, values[level], floor=0.0)

    assert fitted.points
    assert fitted.is_near(expected, TOLERANCE)


def test_the_box_of_one_root_shrinks_as_roots_come_together(found):
    law, values = found

    assert slope(DISTANCES, values["unique"], floor=0.0).is_near(law.unique, 0.1)


def test_the_radius_that_float64_certifies_is_what_rounding_leaves_over_sigma(found):
    """It may be less by the luck of the rounding of one pose, and never is more than a few roundings over sigma."""
    _, values = found

    assert np.all(values["certified"] > 0)
    assert np.max(values["certified"] * values["sigma"]) < 64 * EPS


def test_where_float64_leaves_little_the_answer_is_that_of_balls(found):
    _, values = found

    assert np.max(values["radius"]) <= 2.0**-36


def test_a_wrong_order_is_seen():
    """The law of a fold is not that of a crossing."""
    sigma = [refkin.solve(toggle(d)).sigma_min[0] for d in DISTANCES]

    assert not slope(DISTANCES, sigma, floor=0.0).is_near(1.0, TOLERANCE)
