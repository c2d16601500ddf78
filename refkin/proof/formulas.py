"""Whether the formulas of a joint of one's own belong together: a proof of its residual says nothing of its rates.

phi_q, nu and gamma are derivatives of phi. Those of refkin's joints are held against complex steps by its tests; a
class from elsewhere is asked before it is believed, at a pose of no special place (Squire and Trapp, SIAM Review 40,
1998).
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from refkin.differences import jacobian
from refkin.errors import RefkinError
from refkin.model import Effect
from refkin.system import System

H = 1e-100
"""The complex step: no difference is taken, so nothing cancels."""
OFF = 1e-9
"""What rounding leaves of a derivative is far below this part of the largest number in it, and a wrong term above."""
BETWEEN = 0.382
"""Where between the first time and the last formulas are held to each other, as a part of the way."""
WRITTEN = "formulas add, subtract, multiply, and take sines and cosines by refkin.vec.cosine_and_sine"


def agreeing(system: System, times: Sequence[float]) -> System:
    """Return the system; RefkinError names a joint of another's class of which a formula is not the derivative it is.

    Joints that bring or share a parameter are not asked. Laws are those of a time between the first and the last, where
    rates are more seldom zero than at an end.
    """
    t = times[0] + BETWEEN * (times[-1] - times[0])
    for p in system.placed:
        if type(p.constraint).__module__.partition(".")[0] != "refkin" and len(p.starts) == 2:
            c, columns = p.constraint, [s + k for s in p.starts if s is not None for k in range(system.kind.width)]
            alone = replace(system, placed=(replace(p, row=0),), m=c.rows)
            with warnings.catch_warnings(action="error", category=np.exceptions.ComplexWarning):
                try:
                    for formula, own, meant in _derivatives(alone, np.array(columns), t):
                        _compare(f"{c.type} {c.name!r}: expected {formula}", own, meant)
                except (TypeError, ValueError, ArithmeticError, np.exceptions.ComplexWarning) as error:
                    raise RefkinError(f"{c.type} {c.name!r}: {WRITTEN} ({error})") from error
    return system


def _derivatives(alone: System, columns: Any, t: float) -> Iterator[tuple[str, Any, Any]]:
    """Yield what each formula of a joint says, and what it has to: name, array, array."""
    q, qd = np.cos(np.arange(1.0, alone.n + 1.0)), np.cos(2.0 + np.arange(alone.n))
    moved, later = q + 1j * H * qd, t + 1j * H

    def residual(x: Any) -> Any:
        at = q.astype(x.dtype)
        at[columns] = x
        return alone.phi(at, t)

    yield "jacobian", alone.phi_q(q, t)[:, columns], jacobian(residual, q[columns])
    if Effect.VELOCITY in alone.effects:
        yield "nu", alone.nu(q, t), -np.imag(alone.phi(q.astype(complex), later)) / H
    if Effect.ACCELERATION in alone.effects:
        rate = alone.phi_q(moved, later) @ qd - alone.nu(moved, later)
        yield "gamma", alone.gamma(q, qd, t), -np.imag(rate) / H


def _compare(what: str, own: Any, meant: Any) -> None:
    wrong = ~(np.abs(own - meant) <= OFF * max(1.0, np.abs(own).max(), np.abs(meant).max())) & np.isfinite(meant)
    for place in np.argwhere(wrong).tolist()[:1]:
        at = tuple(place)
        raise RefkinError(f"{what}{place} to be the derivative of the residual, {meant[at]:.9g}, got {own[at]:.9g}")
