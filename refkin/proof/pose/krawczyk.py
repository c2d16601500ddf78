"""Proofs in ball arithmetic: where exactly one solution lies, to any precision, and where there is none.

Krawczyk's operator on a box X around m, with R about the inverse of phi_q(m),

    K(X) = m - R phi(m) + (I - R phi_q(X)) (X - m) (C3),

encloses the image of X under x - R phi(x). If K(X) lies inside X, then X holds exactly one root, and K(X) holds it too.
The balls are `flint.arb`, the formulas the joints' own, the numbers those of `exact`: the truth is the scene as it is
written, each law evaluated at the binary64 time. One such proof takes about a millisecond; it decides what float64
leaves open (`certificate`), and between answers that differ.

R. Krawczyk, Newton-Algorithmen zur Bestimmung von Nullstellen mit Fehlerschranken, Computing 4 (1969); S. M. Rump, Acta
Numerica 19 (2010), section 13.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx

from refkin.proof.numbers.bounded import parts
from refkin.proof.numbers.exact import exact_system
from refkin.proof.numbers.preconditioned import Nearly, independent_rows
from refkin.system import System

MORE_BITS, DIGITS = (226, 452), 2.0**-50
"""Precisions at which a root is enclosed once more, until its rates are known to so small a part of the largest."""
JUDGE_BITS = 256
"""Precision of the difference between an answer and the truth: more than either has."""
MOST_STEPS = 12
"""Newton steps, or enclosures, before a root is given up; a regular one needs three from a float64 answer."""


@dataclass(frozen=True)
class Enclosure:
    """A proved root: exactly one solution lies in the balls `q`, and no other within `radii` of the given answer.

    Attributes
    ----------
    q : tuple of arb
        Balls, one per coordinate, that enclose the root.
    radii : (n,) array
        Half-widths of the box around the given answer that holds no other root.
    rows : (n,) array of int
        The constraint rows that were solved.
    """

    system: System
    t: float
    bits: int
    q: tuple[Any, ...]
    radii: Any
    rows: Any

    def distance(self, answer: Any, truth: tuple[Any, ...] | None = None) -> Any:
        """Return upper bounds (n,) of |answer - truth|; the truth is the position, or rates enclosed by this object."""
        return _above(self.q if truth is None else truth, answer, self.bits)

    def with_rates(self, order: int) -> tuple[Enclosure, list[Any], bool]:
        """Return the root with as many bits as rates up to an order (1, 2) ask for; these, and if they have digits.

        At 1e-16 from a singular pose a root of 113 bits leaves no digit of a velocity.
        """
        root = self
        for bits in (self.bits, *MORE_BITS):
            if bits > root.bits:
                with ctx.workprec(bits):
                    q = BallEquations(self.system, self.t, self.rows, bits).narrowed(list(root.q))
                root = Enclosure(self.system, self.t, bits, q, self.radii, self.rows)
            rates = [root.velocity()]
            if order > 1:
                rates.append(root.acceleration(rates[0]))
            sizes = [max(abs(float(x)) for x in balls) for balls in rates]
            sizes[1:] = [max(size, sizes[0] * sizes[0]) for size in sizes[1:]]
            if all(float(x.rad()) <= DIGITS * size for balls, size in zip(rates, sizes, strict=True) for x in balls):
                return root, rates, True
        return root, rates, False

    def nearest(self) -> Any:
        """Return the root as float64 numbers (n,)."""
        return np.array([float(x) for x in self.q])

    def root(self, q: Any) -> Nearly:
        """Return the root as seen from an answer q (n,)."""
        with ctx.workprec(self.bits):
            away = [parts(x - float(v)) for x, v in zip(self.q, q, strict=True)]
        shift, low, rest = np.array(away).T[..., None]
        return Nearly(np.asarray(q, float)[:, None], shift, np.abs(low) + rest)

    def distances(self, q: Any, qd: Any = None, qdd: Any = None) -> Iterator[float]:
        """Yield the largest distance of q, and of the rates (n,) that are given, from the true ones."""
        yield np.max(self.distance(q))
        if qd is not None:
            velocity = self.velocity()
            yield np.max(self.distance(qd, velocity))
            if qdd is not None:
                yield np.max(self.distance(qdd, self.acceleration(velocity)))

    def velocity(self) -> tuple[Any, ...]:
        """Return balls that enclose the solution of phi_q qd = nu at the root; NaN where phi_q may be singular."""
        return self._solved(lambda equations: equations.nu(self.q))

    def acceleration(self, qd: tuple[Any, ...]) -> tuple[Any, ...]:
        """Return balls that enclose the solution of phi_q qdd = gamma at the root, from those of its velocity."""
        return self._solved(lambda equations: equations.gamma(self.q, qd))

    def _solved(self, right: Callable[[BallEquations], Any]) -> tuple[Any, ...]:
        with ctx.workprec(self.bits):
            equations = BallEquations(self.system, self.t, self.rows, self.bits)
            return tuple(equations.slope(self.q).solve(right(equations), nonstop=True).entries())


class Verdict(StrEnum):
    """Where an answer lies."""

    INSIDE = "inside"
    """Within the allowed distance of the enclosed root, by proof."""
    OUTSIDE = "outside"
    """Beyond it, by proof."""
    UNDECIDABLE = "undecidable"
    """The enclosure is too wide to say."""


@dataclass(frozen=True)
class Judgement:
    """A verdict, and how many of the allowed radii the answer is away from the truth in its worst coordinate."""

    verdict: Verdict
    radii: float


def judge(truth: tuple[Any, ...], answer: Any, allowed: Any) -> Judgement:
    """Hold an answer against balls that enclose the truth.

    Undecidable: the balls are too wide to say, or one of the numbers is not finite.

    Parameters
    ----------
    truth : tuple of arb
        n balls, each of which holds a coordinate.
    answer : (n,) array
        In the same coordinates.
    allowed : float or (n,) array
        The errors that are allowed.
    """
    limits = np.broadcast_to(np.asarray(allowed, float), np.shape(answer)).tolist()
    with ctx.workprec(JUDGE_BITS):
        distances = [abs(x - float(a)) for x, a in zip(truth, answer, strict=True)]
        outside = any(d > limit for d, limit in zip(distances, limits, strict=True))
        inside = all(d <= limit for d, limit in zip(distances, limits, strict=True))
    away = [
        0.0 if d == 0 else float(d) / limit if limit else np.inf for d, limit in zip(distances, limits, strict=True)
    ]
    verdict = Verdict.OUTSIDE if outside else Verdict.INSIDE if inside else Verdict.UNDECIDABLE
    return Judgement(verdict, float(np.max(away)))


def krawczyk(
    system: System, q: Any, t: float, bits: int = 113, radius: Any = None, rows: Any = None
) -> Enclosure | None:
    """Prove that a box around q holds exactly one root, and enclose it as narrowly as `bits` allow; None if not proved.

    Parameters
    ----------
    system : System
        Compiled in its mechanism's own unit.
    q : (n,) array
        The answer, in the system's coordinates.
    t : float
        When [s].
    bits : int
        The precision of the balls.
    radius : float or (n,) array, optional
        Half-widths of the box; by default about the distance to the root that Newton finds from q.
    rows : (n,) array of int, optional
        The rows to solve where there are more than n; by default a maximal independent set at q.
    """
    system = system.held_at(q)
    with ctx.workprec(bits):
        if rows is None:
            rows = independent_rows(system, np.asarray(q, float)[:, None], np.array([float(t)]))
        equations = BallEquations(system, t, rows, bits)
        if radius is not None:
            around = np.broadcast_to(np.asarray(radius, float), np.shape(q))
            box = equations.enclosed([arb(float(x)) for x in q], around, inflations=0)
            return None if box is None else Enclosure(system, t, bits, box[0], around, equations.rows)
        middle = equations.newton(q)
        if middle is None:
            return None
        # The box lies around the root and holds q: a smaller one proves as much as one that lies around q.
        distance = _above(middle, q, bits)
        box = equations.enclosed(middle, 2 * distance)
        if box is None:
            return None
        return Enclosure(system, t, bits, box[0], (box[1] - distance) * (1 - 2.0**-50), equations.rows)


class BallEquations:
    """n rows of a system's equations in balls, at a time that may be a ball too, in the precision in force."""

    def __init__(self, system: System, t: Any, rows: Any, bits: int) -> None:
        self.system, self.rows = exact_system(system, bits), rows
        self.t = t if isinstance(t, arb) else arb(float(t))

    def phi(self, q: Any) -> Any:
        """Return the residual (n, 1)."""
        return column(self.system.phi(objects(q), self.t)[self.rows])

    def slope(self, q: Any) -> Any:
        """Return phi_q (n, n)."""
        return arb_mat(self.system.phi_q(objects(q), self.t)[self.rows].tolist())

    def nu(self, q: Any) -> Any:
        """Return the right side of the velocities (n, 1)."""
        return column(self.system.nu(objects(q), self.t)[self.rows])

    def gamma(self, q: Any, qd: Any) -> Any:
        """Return the right side of the accelerations (n, 1)."""
        return column(self.system.gamma(objects(q), objects(qd), self.t)[self.rows])

    def inverse(self, q: Any) -> Any:
        """Return the midpoints of the inverse of phi_q at a point, None where it is singular."""
        inverse = self.slope(q).inv(nonstop=True).mid()
        return inverse if all(x.is_finite() for x in inverse.entries()) else None

    def newton(self, q: Any) -> list[Any] | None:
        """Return a point (exact balls) near the root that Newton finds from q; None where it finds none."""
        x = [arb(float(v)) for v in q]
        last = None
        for _ in range(MOST_STEPS):
            correction = self.slope(x).solve(self.phi(x), nonstop=True).mid().entries()
            if not all(c.is_finite() for c in correction):
                return None
            size = max(abs(c) for c in correction)
            x = [(a - c).mid() for a, c in zip(x, correction, strict=True)]
            # Quadratic convergence ends at round-off; what no longer shrinks and is small is there too.
            if size < arb(2) ** (4 - ctx.prec) or (last is not None and not size < last / 2 and size < 2.0**-40):
                break
            last = size
        return x

    def enclosed(self, middle: list[Any], widths: Any, inflations: int = 6) -> tuple[tuple[Any, ...], Any] | None:
        """Return the root, if some box around a point is proved to hold exactly one, and that box's half-widths (n,).

        A box that is too small for its own round-off is widened to what the operator makes of it, a few times.
        """
        for _ in range(inflations + 1):
            balls = [arb(0, w) for w in widths.tolist()]
            image = self.image(middle, balls)
            if image is None or not all(x.is_finite() for x in image):
                return None
            if all(w.contains_interior(x) for w, x in zip(balls, image, strict=True)):
                return self.narrowed([m + x for m, x in zip(middle, image, strict=True)]), widths
            widths = np.maximum(widths, [4 * float(abs(x).upper()) + 2.0**-1000 for x in image])
        return None

    def narrowed(self, root: list[Any]) -> tuple[Any, ...]:
        """Return balls that enclose a root as narrowly as the precision allows."""
        enough = arb(2) ** -(ctx.prec // 2)  # the first steps in a wide box gain little, each more than the last
        for _ in range(MOST_STEPS):
            middle = [x.mid() for x in root]
            image = self.image(middle, [x - m for x, m in zip(root, middle, strict=True)])
            if image is None:
                break
            before = max(x.rad() for x in root)
            root = [x.intersection(m + y) for x, m, y in zip(root, middle, image, strict=True)]
            size = max(x.rad() for x in root)
            if not size < (before / 2 if size < enough else before):
                break
        return tuple(root)

    def image(self, middle: list[Any], widths: list[Any]) -> list[Any] | None:
        """Return K(middle + widths) - middle, None where no inverse was found."""
        inverse = self.inverse(middle)
        if inverse is None:
            return None
        whole = [m + w for m, w in zip(middle, widths, strict=True)]
        identity = arb_mat(len(middle), len(middle), 1)
        image = (identity - inverse * self.slope(whole)) * column(widths) - inverse * self.phi(middle)
        return list(image.entries())


def objects(q: Any) -> Any:
    """Return balls as an object array, which NumPy would otherwise try to look into."""
    out = np.empty(len(q), object)
    out[:] = list(q)
    return out


def column(entries: Any) -> Any:
    """Return balls as a matrix of one column."""
    return arb_mat([[x] for x in entries])


def _above(balls: Any, q: Any, bits: int) -> Any:
    """Return upper bounds (n,) in float64 of the distance from q to anything in the balls."""
    with ctx.workprec(bits):
        return np.array([float(abs(x - float(v)).upper()) * (1 + 2.0**-50) for x, v in zip(balls, q, strict=True)])
