"""What the page shows of the documents, as data: the ledger in short, and three experiments on what they teach.

`newton_histories`: a few solves iteration by iteration. Far from a singular pose the error is squared in each. At a
fold, where two assemblies meet, the Jacobian is singular at the root itself and the error is only halved; near a fold
the halving lasts until the error is about as small as the distance to it.

`slopes`: orders of convergence, differences against their step and sigma_min against the distance. Each line has a
slope on paper (1, 2, none, 1/2); what is shown is the slope that is fitted, with its spread.

`digits_by_iteration`: the four-bar of section 3.11 of the notes on Shabana, which stop after the first correction and
print velocities and accelerations there with five digits. How many of them are right is computed here, as is what the
next iterations would have given. The truth is a root proved in balls.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from crosscheck.documents.convergence import slope
from crosscheck.documents.ledger import all_rows, read
from crosscheck.documents.ledger.arithmetic import ArbNumbers, Binary64
from crosscheck.documents.ledger.rows import Printed
from crosscheck.documents.ledger.shabana_four_bar import estimate, four_bar, rates
from crosscheck.engines import QUANTITIES
from crosscheck.judge.records import MOST_DIGITS
from refkin.analysis import position
from refkin.differences import Scheme, jacobian
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import FourBar
from refkin.system import System, compile_system

# ---- the ledger


def documents() -> dict[str, Any]:
    """Return titles, rows with their counts, errata with the digits that are right, and all of it in one line."""
    rows = all_rows()
    return {
        "titles": dict(read().documents),
        "closing": closing(rows),
        "rows": [
            {**{key: row[key] for key in OF_ROW}, **tally(row), "errata": sum(e["counts"] for e in row["errata"])}
            for row in rows
        ],
        "errata": [
            {"row": row["id"], "document": row["document"], **{key: e[key] for key in OF_ERRATUM}}
            | {"printed": digits_told(row, e)}
            for row in rows
            for e in row["errata"]
        ],
    }


OF_ROW = ("id", "document", "item", "status", "inferred", "open", "failures", "computed_by")
OF_ERRATUM = ("kind", "cause", "reading")


def tally(row: dict[str, Any]) -> dict[str, int]:
    """Return how many numbers of a row were checked, and how many printed ones are right, truncated, wrong."""
    verdicts = [v.get("verdict") for v in row["values"]]
    return {"checked": len(verdicts), **{kind.value: verdicts.count(kind.value) for kind in Printed}}


def digits_told(row: dict[str, Any], erratum: dict[str, Any]) -> str:
    """Return the printed numbers of an erratum with their digits: "2.7109 for 2.701942 (2.4 of 5 digits)"."""
    by_name = {v["name"]: v for v in row["values"]}
    line = "{name}: {printed} for {truth} ({digits_correct:g} of {digits_printed} digits)"
    return "; ".join(line.format(**by_name[path]) for path in erratum["at"])


def closing(rows: Sequence[dict[str, Any]]) -> str:
    """Return the ledger in one line."""
    counts = {status: sum(row["status"] == status for row in rows) for status in ("pass", "fail", "open")}
    errata = sum(e["counts"] for row in rows for e in row["errata"])
    checked = sum(len(row["values"]) for row in rows)
    by_status = ", ".join(f"{n} {status}" for status, n in counts.items())
    return f"{len(rows)} rows: {by_status}; {checked} numbers and facts recomputed, {errata} errata of the documents"


# ---- Newton, iteration by iteration

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
    system, q = _posed(case.linkage, case.angle)
    result = position(system, q + OFF * (-1.0) ** np.arange(system.n), 0.0)
    corrections = [float(np.max(np.abs(c))) for c in result.corrections]
    ratios = [b / a if a else None for a, b in pairwise(corrections)]
    # log(|dq_k+2| / |dq_k+1|) / log(|dq_k+1| / |dq_k|): the order of convergence
    orders = [math.log(s) / math.log(r) if r and s and 0 < r < 1 and 0 < s < 1 else None for r, s in pairwise(ratios)]
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


# ---- orders of convergence

ROCKER = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
TOGGLE = FourBar(ground=90.0, crank=30.0, coupler=60.0, rocker=45.0)
"""Its crank stops at a limit position, where coupler and rocker lie in one line."""
FLOORS = {Scheme.FORWARD: 1e-7, Scheme.CENTRAL: 1e-9}
SMALLEST = 1e-6
"""A difference quotient errs by some 2^-52 / h in round-off: with smaller steps, or errors below the floors, that shows
beside the order, and is no part of a slope."""
EXPECTED = {Scheme.FORWARD: 1.0, Scheme.CENTRAL: 2.0}


def slopes() -> list[dict[str, Any]]:
    """Return the lines: name, what it is drawn over, points (x, error), expected and fitted slope and its spread.

    They are the error of each difference Jacobian of a four-bar against the analytic one, over the step; and sigma_min
    over the distance to a limit.
    """
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
    limit = TOGGLE.input_range()[0][1]
    distance = 10.0 ** np.arange(-9, -1.5, 0.5)
    sigma = []
    for d in distance:
        system, q = _posed(TOGGLE, limit - d)
        sigma.append(float(np.linalg.svd(system.phi_q(q, 0.0), compute_uv=False)[-1]))
    fitted, over = slope(distance, sigma, 0.0), "distance to the limit position [rad]"
    return [*lines, _line("smallest singular value", over, distance, sigma, 0.5, fitted)]


def _posed(linkage: FourBar, angle: float) -> tuple[System, Any]:
    mechanism = linkage.mechanism(linkage.driver(Polynomial(coefficients=(angle,))))
    system = compile_system(mechanism, unit=mechanism.unit())
    pose = linkage.assemble(angle)
    return system, system.to_unit(np.concatenate([pose[body.name] for body in mechanism.bodies]))


def _line(name: str, over: str, x: Any, y: Any, expected: float | None, fitted: Any) -> dict[str, Any]:
    seen = fitted is not None and fitted.points > 0
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


# ---- digits after each iteration

ROW = "D12"
ITERATIONS = 5
TRUTH_BITS = 256
PRINTED = {"velocity": "omega", "acceleration": "alpha"}
"""Quantity -> its name in the ledger."""

Levels = Sequence[Sequence[Any]]


def digits_by_iteration() -> list[dict[str, Any]]:
    """Return rows of iteration, quantity, digits: the fewest over coupler and rocker, relative to the number itself.

    The rows with the iteration "printed" are of what the notes print.
    """
    row = next(row for row in read().row if row.id == ROW)
    truth = _truth(row.inputs)
    n = Binary64()
    system = four_bar(n, row.inputs)
    history = n.newton(system, estimate(n, row.inputs), ITERATIONS)
    answers = [(q, *rates(n, row.inputs, q)[::2]) for q in history.iterates]
    rows = [
        {"iteration": str(k), "quantity": quantity, "digits": _fewest(level, right)}
        for k, levels in enumerate(answers)
        for quantity, level, right in zip(QUANTITIES, levels, truth, strict=True)
    ]
    values = {value.name: value for value in row.values}
    for quantity, name in PRINTED.items():
        level = [float(x) for x in values[name].printed]
        right = truth[QUANTITIES.index(quantity)]
        rows.append({"iteration": "printed", "quantity": quantity, "digits": _fewest(level, right)})
    return rows


def _truth(given: Mapping[str, Any]) -> Levels:
    balls = ArbNumbers(TRUTH_BITS)
    with balls.at_precision():
        q = balls.root(four_bar(balls, given), estimate(balls, given))
        qd, _, qdd = rates(balls, given, q)
        return [[float(x) for x in level] for level in (q, qd, qdd)]


def _fewest(level: Any, truth: Any) -> float:
    """Return the digits of the worst of the coordinates that are not held by the driver."""
    worst = max(abs(float(a) - b) / abs(b) for a, b in zip(level[1:], truth[1:], strict=True))
    return min(MOST_DIGITS, float(-np.log10(worst))) if worst else MOST_DIGITS
