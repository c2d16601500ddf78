"""What the documents print wrong, as it is printed: never used but to show that it is wrong.

`as_printed` versions of the METU equations (section 3.9) and of right sides in the notes on Shabana.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from crosscheck.documents.systems import Number, SquareSystem
from crosscheck.documents.systems.metu import Slotted, slotted


def metu_jacobian(m: Slotted, q: Any) -> Any:
    """Return the real Jacobian as printed: its entries (3,2) and (3,4) have the wrong sign."""
    out = slotted(m).phi_q(q)
    out[2, 1], out[2, 3] = -out[2, 1], -out[2, 3]
    return out


def metu_residual(m: Slotted, q: Any) -> Any:
    """Return the residual as printed on the right side: its first two rows have theta14 where theta15 belongs."""
    out = slotted(m).phi(q)
    out[0] = out[0] + m.a5 * (np.cos(q[0]) - np.cos(q[1]))
    out[1] = out[1] + m.a5 * (np.sin(q[0]) - np.sin(q[1]))
    return out


def metu_with_printed_jacobian(m: Slotted) -> SquareSystem:
    """Return the coupled example with its Jacobian as printed."""
    return SquareSystem(slotted(m).phi, lambda q: metu_jacobian(m, q))


def metu_with_printed_residual(m: Slotted) -> SquareSystem:
    """Return the coupled example with its right side as printed."""
    return SquareSystem(lambda q: metu_residual(m, q), slotted(m).phi_q)


def stops_without_absolute_value(residual: Number, correction: Number) -> bool:
    """Return METU's test as printed, F < 1e-8 or x(k+1) - x(k) < 1e-8: any negative number stops."""
    return bool(residual < 1e-8 or correction < 1e-8)


def coriolis_terms(count: int, rate: Number, a_theta_ud: Any) -> Any:
    """Return `count` terms theta' A_theta u'; the notes print three, the acceleration of a moving point has two."""
    return count * rate * a_theta_ud
