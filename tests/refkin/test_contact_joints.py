"""Gears, racks, cams, offset pins and moving slots in whole scenes, against closed forms to 40 digits.

An answer must have status ok, and all of it, rates too, must lie within its own certified radius of the truth
(`contact_cases`; rates are derivatives in 40 digits).
"""

from __future__ import annotations

from functools import lru_cache

import mpmath
import numpy as np
import pytest
from mpmath import mpf

import refkin
from refkin import RackAndPinion
from refkin.scenes.files import load, to_toml

from .contact_cases import CASES, CONTACTS, TIMES, scene

LEVELS = ("position", "velocity", "acceleration")


@lru_cache
def solved(name):
    return refkin.solve(scene(name))


def rates(f, order):
    """A function of time, or its derivative, at all times."""
    with mpmath.workdps(40):
        return [mpmath.diff(f, mpf(t), order) if order else f(mpf(t)) for t in TIMES]


def errors(answer, truth):
    """The distances of floats from the truth, less the half ulp by which an answer in metres is rounded."""
    with mpmath.workdps(40):
        values = [float(abs(mpf(float(a)) - b)) for a, b in zip(answer, truth, strict=True)]
    return np.array(values) - np.spacing(np.abs(answer)) / 2


def largest_error(name, order):
    """The largest error of any body's coordinate in the units of the proof, (T,)."""
    motion, size = solved(name), scene(name).mechanism.size()
    pose, result = CASES[name][0], []
    for body in motion.bodies:
        for k, unit in enumerate((size, size, 1.0)):
            truth = rates(lambda t, k=k, body=body: pose(t)[body][k], order)
            answer = (motion[body].q, motion[body].qd, motion[body].qdd)[order][k]
            result.append(errors(answer, truth) / unit)
    return np.max(result, axis=0)


@pytest.mark.parametrize("name", CASES)
def test_every_pose_is_proved(name):
    motion = solved(name)

    assert motion.verdict == "ok", motion.message
    assert all(np.max(getattr(motion.certified_radius, level)) < 1e-12 for level in LEVELS)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("level", LEVELS)
def test_the_closed_form_lies_within_the_certified_radius(name, level):
    order = LEVELS.index(level)

    assert np.all(largest_error(name, order) <= getattr(solved(name).certified_radius, level))


@pytest.mark.parametrize("name", CONTACTS)
@pytest.mark.parametrize("level", LEVELS)
def test_the_contact_parameter_lies_within_the_certified_radius(name, level):
    order = LEVELS.index(level)
    contact = solved(name).contacts["contact"]
    answer, truth = (contact.s, contact.sd, contact.sdd)[order], rates(CONTACTS[name], order)
    if order == 0:
        truth = [
            x + 2 * mpmath.pi * round(float((a - x) / (2 * mpmath.pi))) for a, x in zip(answer, truth, strict=True)
        ]

    assert np.all(errors(answer, truth) <= getattr(solved(name).certified_radius, level))


@pytest.mark.parametrize("name", CASES)
def test_a_scene_file_says_it_all(name, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(to_toml(scene(name)), encoding="utf-8")

    assert load(path) == scene(name)
    assert np.array_equal(refkin.solve(load(path)).qdd, solved(name).qdd)


@pytest.mark.parametrize("name", ["rack above", "rack below", "wheel on road", "wheel on swing"])
def test_a_pinion_does_not_slide_on_its_rack(name):
    """The pinion's and the rack's material points at the pitch point have the same velocity along the rack."""
    motion, teeth = solved(name), next(j for j in CASES[name][1][0] if isinstance(j, RackAndPinion))
    wheel = motion[teeth.body_j]
    still = np.zeros((3, len(TIMES)))
    rack, moving = (still, still) if teeth.body_i == "ground" else (motion[teeth.body_i].q, motion[teeth.body_i].qd)
    along, left = np.array([np.cos(rack[2]), np.sin(rack[2])]), np.array([-np.sin(rack[2]), np.cos(rack[2])])
    at = wheel.q[:2] + left * teeth.radius  # a pinion to the right of the axis has the rack to its left
    slip = 0.0
    for q, qd, sign in ((wheel.q, wheel.qd, 1), (rack, moving, -1)):
        arm = at - q[:2]
        slip = slip + sign * np.sum(along * (qd[:2] + qd[2] * np.array([-arm[1], arm[0]])), axis=0)

    assert np.max(np.abs(slip)) < 1e-14
