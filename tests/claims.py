"""What tests share: how near two arrays are to be, and how far difference quotients may be off."""

from __future__ import annotations

import numpy as np

from refkin.differences import EPS, Scheme

U = 2.0**-53
"""Unit round-off of binary64."""


def assert_near(actual, expected, allowed, value):
    """Two arrays have one shape and differ by what is allowed at most; NaN is near nothing."""
    actual, expected = np.asarray(actual), np.asarray(expected)
    assert actual.shape == expected.shape, f"{value}: shape {actual.shape}, expected {expected.shape}"
    away = np.abs(actual - expected)
    assert (away <= allowed).all(), f"{value}: {actual} is not {expected}, off by {np.max(away, initial=0.0):.3g}"


def error_bound(scheme, h, second, third, evaluation, slope):
    """The bounds of `refkin.differences` for steps h, from bounds of the second and third derivative and the slope."""
    if scheme is Scheme.FORWARD:
        return h * second / 2 + 2 * evaluation / h
    if scheme is Scheme.CENTRAL:
        return h**2 * third / 6 + evaluation / h
    return 8 * EPS * slope
