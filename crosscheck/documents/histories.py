"""A few solves of the reference, iteration by iteration, made when the report is: what Newton's convergence looks like.

Far from a singular pose the error is squared in each iteration. At a fold, where two assemblies meet, the Jacobian is
singular at the root itself and the error is only halved; near a fold the halving lasts until the error is about as
small as the distance to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from refkin.analysis import position
from refkin.motion_laws import Polynomial
from refkin.newton import NewtonResult
from refkin.scenes.linkages import FourBar
from refkin.system import compile_system

OFF = 0.1
"""How far each scaled coordinate of the estimate is from the pose, with alternating signs."""


@dataclass(frozen=True)
class Case:
    """A solve to show; corrections of at most `floor` say nothing about convergence.

    The floor of a regular root is 1e4 u, that of a root with a smallest singular value of sigma is 100 u / sigma.
    Within sqrt(u) of a double root the residual is at round-off, and the corrections are noise: there the floor is
    100 sqrt(u).
    """

    name: str
    linkage: FourBar
    angle: float
    floor: float


STRETCHED = FourBar(ground=3.0, crank=1.0, coupler=2.0, rocker=2.0)
"""At crank angle pi coupler and rocker lie in one line, exactly so in binary numbers: 3 + 1 = 2 + 2."""
CASES = (
    Case("regular pose", FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0), 0.7, 1e-12),
    Case("1e-3 rad from a fold", STRETCHED, math.pi - 1e-3, 1e-10),
    Case("at a fold", STRETCHED, math.pi, 1e-6),
)


def newton_histories() -> list[dict[str, Any]]:
    """Return residual and correction (largest component, scaled) per iteration, and the rates seen, for each case."""
    return [_history(case) for case in CASES]


def _history(case: Case) -> dict[str, Any]:
    result = solve(case.linkage, case.angle)
    corrections = [float(np.max(np.abs(c))) for c in result.corrections]
    ratios, orders = rates(corrections)
    seen = [r for r, c in zip(ratios, corrections[1:], strict=True) if r is not None and c > case.floor]
    telling = [o for o, c in zip(orders, corrections[2:], strict=True) if c > case.floor]
    return {
        "name": case.name,
        "linkage": {key: getattr(case.linkage, key) for key in case.linkage.LENGTHS},
        "crank_angle": case.angle,
        "estimate_off_by": OFF,
        "status": result.status.value,
        "iterations": result.iterations,
        "residual": [float(np.max(np.abs(r))) for r in result.residuals],
        "correction": corrections,
        "correction_ratio": ratios,
        "floor": case.floor,
        "typical_ratio": sorted(seen)[len(seen) // 2] if seen else None,
        "last_order": telling[-1] if telling else None,
    }


def solve(linkage: FourBar, angle: float) -> NewtonResult:
    """Solve a four-bar at a crank angle from an estimate that is off by `OFF` in every coordinate."""
    mechanism = linkage.mechanism(linkage.driver(Polynomial(coefficients=(angle,))))
    system = compile_system(mechanism, unit=mechanism.unit())
    pose = linkage.assemble(angle)
    estimate = system.to_unit(np.concatenate([pose[body.name] for body in mechanism.bodies]))
    estimate = estimate + OFF * (-1.0) ** np.arange(system.n)
    return position(system, estimate, 0.0)


def rates(corrections: list[float]) -> tuple[list[float | None], list[float | None]]:
    """Return |dq_k+1| / |dq_k|, and log(|dq_k+2| / |dq_k+1|) / log(|dq_k+1| / |dq_k|): the order of convergence."""
    ratios = [b / a if a else None for a, b in pairwise(corrections)]
    orders = [math.log(s) / math.log(r) if r and s and 0 < r < 1 and 0 < s < 1 else None for r, s in pairwise(ratios)]
    return ratios, orders
