"""What tests share: how near two arrays are to be."""

from __future__ import annotations

import numpy as np

U = 2.0**-53
"""Unit round-off of binary64."""


def assert_near(found, expected, allowed, told):
    """Two arrays have one shape and differ by what is allowed at most; NaN is near nothing."""
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.shape == expected.shape, f"{told}: shape {found.shape}, expected {expected.shape}"
    away = np.abs(found - expected)
    assert (away <= allowed).all(), f"{told}: {found} is not {expected}, off by {np.max(away, initial=0.0):.3g}"
