"""Orders of convergence, measured when the page is made: differences against their step, sigma_min against distance.

Each line has a slope on paper (1, 2, none, 1/2); what is shown is the slope that is fitted, with its spread.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from crosscheck.documents.convergence import Kind, slope
from refkin.differences import Scheme, jacobian
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import FourBar
from refkin.system import System, compile_system

ROCKER = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
TOGGLE = FourBar(ground=90.0, crank=30.0, coupler=60.0, rocker=45.0)
"""Its crank stops at a limit position, where coupler and rocker lie in one line."""
FLOORS = {Scheme.FORWARD: 1e-7, Scheme.CENTRAL: 1e-9}
SMALLEST = 1e-6
"""A difference quotient errs by some 2^-52 / h in round-off: with smaller steps, or errors below the floors, that shows
beside the order, and is no part of a slope."""
EXPECTED = {Scheme.FORWARD: 1.0, Scheme.CENTRAL: 2.0}


def slopes() -> list[dict[str, Any]]:
    """Return the lines: name, what it is drawn over, points (x, error), expected and fitted slope and its spread."""
    return [*_differences(), _sigma()]


def _differences() -> list[dict[str, Any]]:
    """Return the error of each difference Jacobian of a four-bar against the analytic one, over the step."""
    system, q = _posed(ROCKER, 1.0)
    exact = system.phi_q(q, 0.0)
    h = 10.0 ** np.arange(-12, 0.0, 0.5)
    lines = []
    for scheme in Scheme:
        errors = [float(np.max(np.abs(jacobian(lambda x: system.phi(x, 0.0), q, scheme, k) - exact))) for k in h]
        kept = [k for k, size in enumerate(h) if size > 0.99 * SMALLEST]
        fitted = slope(h[kept], [errors[k] for k in kept], FLOORS[scheme]) if scheme in FLOORS else None
        # A complex step errs with h^2, too; below 1e-8 that is under round-off, which is how it is used.
        name = f"{scheme.value.replace('_', ' ')} difference"
        lines.append(_line(name, "step", h, errors, EXPECTED.get(scheme), fitted))
    return lines


def _sigma() -> dict[str, Any]:
    limit = TOGGLE.input_range()[0][1]
    distance = 10.0 ** np.arange(-9, -1.5, 0.5)
    sigma = []
    for d in distance:
        system, q = _posed(TOGGLE, limit - d)
        sigma.append(float(np.linalg.svd(system.phi_q(q, 0.0), compute_uv=False)[-1]))
    fitted = slope(distance, sigma, 0.0)
    return _line("smallest singular value", "distance to the limit position [rad]", distance, sigma, 0.5, fitted)


def _posed(linkage: FourBar, angle: float) -> tuple[System, Any]:
    mechanism = linkage.mechanism(linkage.driver(Polynomial(coefficients=(angle,))))
    system = compile_system(mechanism, unit=mechanism.unit())
    pose = linkage.assemble(angle)
    return system, system.to_unit(np.concatenate([pose[body.name] for body in mechanism.bodies]))


def _line(name: str, over: str, x: Any, y: Any, expected: float | None, fitted: Any) -> dict[str, Any]:
    seen = fitted is not None and fitted.kind is not Kind.INCONCLUSIVE
    return {
        "name": name,
        "over": over,
        "x": [float(v) for v in x],
        "y": [float(v) for v in y],
        "expected": expected,
        "fitted": fitted.value if seen else None,
        "spread": fitted.spread if seen else None,
        "points": fitted.points if seen else 0,
    }
