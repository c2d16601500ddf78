"""Points fixed in a body: what is not known stays so, what is not given is not reported."""

from __future__ import annotations

import numpy as np

from refkin.motion import point_motion


def test_no_answer_stays_no_answer():
    """NaN where a body's pose is not known."""
    q = np.array([[0.0, np.nan], [0.0, np.nan], [0.0, np.nan]])
    motion = point_motion((1.0, 0.0), q, q, q)

    assert np.isnan(motion.a[:, 1]).all()
    assert not np.isnan(motion.a[:, 0]).any()


def test_rates_that_are_not_given_are_not_reported():
    q = np.zeros((3, 2))

    assert point_motion((1.0, 0.0), q).v is None
    assert point_motion((1.0, 0.0), q, q).a is None
