"""As many equations as unknowns, with their Jacobian."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

Number = Any
"""A float, a complex number or a ball."""


class SquareSystem(NamedTuple):
    """phi(q) = 0.

    Attributes
    ----------
    phi : callable
        Residual, (n,) to (n,).
    phi_q : callable
        Jacobian, (n,) to (n, n).
    """

    phi: Callable[[Any], Any]
    phi_q: Callable[[Any], Any]


def scalar(f: Callable[[Any], Any], slope: Callable[[Any], Any]) -> SquareSystem:
    """Return one equation in one unknown, as a system of one."""
    return SquareSystem(lambda q: np.array([f(q[0])]), lambda q: np.array([[slope(q[0])]]))
