"""Linkages of space whose bodies have frames many sizes beside their joints: the same assemblies, the same statuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import refkin
from refkin.joints import GROUND
from refkin.motion import Status
from refkin.proof.singularity.diagnosis import PoseKind
from refkin.scenes.linkages import RSCR, Bennett
from tests.linkages import remade, without_estimates

LOOSE, REDUNDANT = RSCR(0.5, 2.0, 2.5, (2.5, -0.5, 0.75), (0.25, 0.5, 1.0)), Bennett(1.0, 0.7, 1.3)


def seen(linkage, sizes):
    """The first pose of a linkage whose frames are so many sizes beside their joints, in each direction."""
    scene = linkage.scene(samples=2, turns=0.01, start=0.4)
    m, far = scene.mechanism, np.full(3, sizes * scene.mechanism.unit().size)

    def origin(place):
        turn = Rotation.from_quat(place[3:], scalar_first=True)
        return (*(np.array(place[:3]) - turn.apply(far)), *place[3:])

    def moved(joint):
        ends = [end for end in "ij" if getattr(joint, f"body_{end}") != GROUND]
        return replace(joint, **{f"point_{end}": tuple(getattr(joint, f"point_{end}") + far) for end in ends})

    bodies = tuple(replace(body, estimate=origin(body.estimate)) for body in m.bodies)
    return remade(replace(scene, times=scene.times[:1]), bodies=bodies, joints=tuple(map(moved, m.joints)))


@pytest.mark.parametrize("linkage", [LOOSE, REDUNDANT])
@pytest.mark.parametrize("sizes", [2.0**7, 2.0**20])
def test_a_search_finds_each_assembly_once(linkage, sizes):
    """No start was near a frame 2^7 sizes away; with redundant rows, and 2^20, there were 48."""
    motion, near = (refkin.solve(without_estimates(seen(linkage, s))) for s in (sizes, 0.0))

    assert motion.status[0] is Status.OK
    assert motion.message.split(";")[0] == near.message.split(";")[0]


@pytest.mark.parametrize("sizes", [2.0**15, 2.0**20, 2.0**27])
def test_a_regular_pose_of_redundant_rows_is_ok(sizes):
    """It was called singular: to turn a body was almost the same as to shift it."""
    scene = seen(REDUNDANT, sizes)
    motion, near = refkin.solve(scene), refkin.solve(seen(REDUNDANT, 0.0))

    assert motion.status[0] is Status.OK
    assert np.max(np.abs(motion["link2"].omega - near["link2"].omega)) < sizes * 2.0**-50
    assert refkin.diagnose(scene).kind is PoseKind.REDUNDANT
