"""A property-based test of a solver of your own, whole: `pytest examples/test_own_solver.py`.

Hypothesis draws four-bars; the solver is held against the reference, within errors that are derived, not tuned; a
linkage that fails is made as simple as can be, and printed so that it can be pasted into a program.
"""

import cmath

import numpy as np
from hypothesis import given, settings

import crosscheck
from crosscheck.strategies import four_bars


def rocker(linkage, crank):
    """The solver: angle of the rocker [rad] at an angle of the crank, and its rate for each radian of the crank."""
    crank = crank - linkage.angle
    pin = cmath.rect(linkage.crank, crank)
    line = pin - linkage.ground  # from the rocker's pivot to the crank pin
    cosine = (linkage.rocker**2 + abs(line) ** 2 - linkage.coupler**2) / (2 * linkage.rocker * abs(line))
    angle = cmath.phase(line) - cmath.acos(cosine).real
    coupler = cmath.phase(linkage.ground + cmath.rect(linkage.rocker, angle) - pin)
    rate = linkage.crank * np.sin(crank - coupler) / (linkage.rocker * np.sin(angle - coupler))
    return angle + linkage.angle, rate


@settings(deadline=None)
@given(four_bars(classes=["crank-rocker", "double-crank"]))
def test_the_rocker_is_where_the_reference_has_it(linkage):
    speed = 2.0  # rad/s
    scene = linkage.scene(speed=speed, turns=1, samples=25, branch="open")
    answers = np.array([rocker(linkage, speed * t) for t in scene.times])

    crosscheck.assert_agrees({"rocker": {"phi": answers[:, 0], "phid": speed * answers[:, 1]}}, scene)
