"""A sweep that meets a bifurcation between two times does not answer on the branch that it did not come from."""

from __future__ import annotations

import numpy as np
import pytest

import refkin
from refkin.motion import Status
from refkin.motion_laws import Polynomial

PARALLELOGRAM = refkin.FourBar(ground=3.0, crank=1.0, coupler=3.0, rocker=1.0)


@pytest.mark.parametrize("beyond", [1e-3, 1e-6, 1e-9, 1e-12])
def test_no_pose_beyond_a_flat_parallelogram_is_called_ok_on_the_other_branch(beyond):
    times = [-0.5, -0.3, -0.1, -beyond, beyond, 0.1]
    law = Polynomial(coefficients=(0.0, 1.0))
    motion = refkin.solve(PARALLELOGRAM.scene(law=law, times=times, branch="crossed", effects=()))

    ok = np.array([status is Status.OK for status in motion.status])

    assert motion["coupler"].phi[ok] == pytest.approx(0.0, abs=1e-7)
    assert ok[:3].all()
