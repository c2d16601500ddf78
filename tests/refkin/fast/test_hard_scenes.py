"""Scenes in which the answer ends, or is in doubt: what a sweep says of them is what the reference says."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import refkin
from refkin import Evidence, FourBar, Polynomial, Sinusoid, SliderCrank, Status
from refkin.fast import attempt, sweep
from tests.linkages import LIMITED, PARALLELOGRAM, remade, with_law

from .scenes import ROCKER, bare

KITE = FourBar(ground=2.0, crank=1.0, coupler=1.0, rocker=2.0)


def turning(linkage, law, times, **where):
    """The linkage from its pose at the first time on, with a law that need not stay in its range."""
    first = Polynomial(coefficients=(float(law(times[0])),))
    scene = linkage.scene(law=first, times=times[:1], **where)
    return bare(replace(with_law(scene, law), times=tuple(times)))


def without_a_pose():
    """A crank-rocker whose coupler is then made too short to close."""
    scene = bare(ROCKER.scene(samples=5))
    joints = tuple(
        replace(j, point_i=(j.point_i[0] * 0.1, 0.0)) if j.body_i == "coupler" else j for j in scene.mechanism.joints
    )
    return remade(scene, joints=joints)


def stretched():
    """A slider-crank driven by its slider to where it is stretched, which it reaches at the last time."""
    linkage = SliderCrank(crank=1.0, rod=3.0)
    return turning(linkage, Polynomial(coefficients=(3.5, 0.25)), (0.0, 0.5, 1.0, 1.5, 2.0), driven="slider")


LIMIT = LIMITED.input_range()[0][1]
SCENES = {
    "a parallelogram through its flat pose": turning(
        PARALLELOGRAM, Polynomial(coefficients=(1.0, 1.0)), np.linspace(0.0, 3.0, 16).tolist()
    ),
    "a parallelogram that comes to its flat pose": turning(
        PARALLELOGRAM, Polynomial(coefficients=(1.0, math.pi - 1.0)), np.linspace(0.0, 1.0, 9).tolist()
    ),
    "a parallelogram short of its flat pose": turning(
        PARALLELOGRAM, Polynomial(coefficients=(1.0, 1.0)), np.linspace(0.0, 2.0, 9).tolist()
    ),
    "a kite through its change point": turning(
        KITE, Polynomial(coefficients=(1.0, 1.0)), np.linspace(0.0, 3.0, 16).tolist()
    ),
    **{
        f"beyond a limit and back in {count} times": turning(
            LIMITED, Sinusoid(amplitude=LIMIT + 0.05, angular_frequency=1.0), np.linspace(0.0, 3.0, count).tolist()
        )
        for count in (13, 25, 200)
    },
    "just short of a limit and back": turning(
        LIMITED, Sinusoid(amplitude=LIMIT - 1e-9, angular_frequency=1.0), np.linspace(0.0, 3.0, 25).tolist()
    ),
    "to a stretched pose": stretched(),
    "not to be assembled": without_a_pose(),
    "regular": bare(ROCKER.scene(samples=9)),
}


@pytest.mark.parametrize("proved", [False, True])
@pytest.mark.parametrize("name", SCENES)
def test_every_status_is_that_of_the_reference(name, proved):
    scene = replace(SCENES[name], evidence=frozenset({Evidence.CERTIFICATE}) if proved else frozenset())
    motion, ref = sweep(scene), refkin.solve(scene)

    assert motion.status == ref.status
    assert np.array_equal(np.isnan(motion.q), np.isnan(ref.q))
    assert np.nanmax(np.abs(motion.q - ref.q), initial=0.0) < 1e-7


@pytest.mark.parametrize("name", [name for name, scene in SCENES.items() if name != "regular"])
def test_no_pose_in_doubt_is_answered_by_the_program(name):
    """Whatever is answered there is the reference's answer, or all of it is regular."""
    answer = attempt(SCENES[name])

    assert answer is None or refkin.solve(SCENES[name]).verdict is Status.OK


def test_the_scenes_end_in_more_than_one_way():
    """The tests above are about something: reached, lost, singular, and not to be assembled."""
    words = {status for scene in SCENES.values() for status in refkin.solve(scene).status}

    assert {Status.OK, Status.BRANCH_LOST, Status.UNASSEMBLABLE} <= words
