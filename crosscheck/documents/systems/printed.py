"""What METU prints wrong in section 3.9, as it is printed: never used but to show that it is wrong."""

from __future__ import annotations

from typing import Any

import numpy as np

from crosscheck.documents.systems import Number, SquareSystem
from crosscheck.documents.systems.metu import Slotted, slotted


def metu_with_printed_jacobian(m: Slotted) -> SquareSystem:
    """Return the coupled example with its Jacobian as printed: entries (3,2) and (3,4) have the wrong sign."""
    right = slotted(m)

    def phi_q(q: Any) -> Any:
        out = right.phi_q(q)
        out[2, 1], out[2, 3] = -out[2, 1], -out[2, 3]
        return out

    return SquareSystem(right.phi, phi_q)


def metu_with_printed_residual(m: Slotted) -> SquareSystem:
    """Return the coupled example with its right side as printed: the first two rows have theta14 for theta15."""
    right = slotted(m)

    def phi(q: Any) -> Any:
        out = right.phi(q)
        out[0] = out[0] + m.a5 * (np.cos(q[0]) - np.cos(q[1]))
        out[1] = out[1] + m.a5 * (np.sin(q[0]) - np.sin(q[1]))
        return out

    return SquareSystem(phi, right.phi_q)


def stops_without_absolute_value(residual: Number, correction: Number) -> bool:
    """Return METU's test as printed, F < 1e-8 or x(k+1) - x(k) < 1e-8: any negative number stops."""
    return bool(residual < 1e-8 or correction < 1e-8)
