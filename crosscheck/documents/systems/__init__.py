"""The systems of equations of the source documents, each as plain functions phi and phi_q, with the equation cited.

========= ====================================================================================================
`me451`   ME451, Kinematics and Dynamics of Machine Systems: Newton-Raphson (slides, October 25, 2010)
`metu`    METU, Mechanisms, section 3.9: iterative solution of the loop closure equations
`me581`   ME581: Newton-Raphson for the four-bar, numerical partial derivatives (notes, 2019)
`shabana` Notes on Shabana, Computational Dynamics, chapter 3
========= ====================================================================================================

But for the one mechanism that Problem 3.5.6 is held against, they know nothing of bodies and joints:
`refkin.newton.newton`, `refkin.differences.jacobian` and `crosscheck.documents.convergence` work on them as on any
square system. The numbers that are passed in decide the arithmetic: floats, complex numbers for a complex step, or
`flint.arb` balls, of which a NumPy array holds objects. So what a document prints can be recomputed in binary64 and
enclosed to any precision by one text.

What a document prints wrong is not repeated here: the row that shows it to be wrong holds it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

Number = Any
"""A float, a complex number or a ball."""


class SquareSystem(NamedTuple):
    """phi(q) = 0: the residual (n,) of q (n,), and the Jacobian phi_q (n, n)."""

    phi: Callable[[Any], Any]
    phi_q: Callable[[Any], Any]


def scalar(f: Callable[[Any], Any], slope: Callable[[Any], Any]) -> SquareSystem:
    """Return one equation in one unknown, as a system of one."""
    return SquareSystem(lambda q: np.array([f(q[0])]), lambda q: np.array([[slope(q[0])]]))
