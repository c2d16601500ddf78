"""The answer to a problem in 30 digits, each of them proved.

A pose that `refkin.solve` has certified is enclosed anew in ball arithmetic (Krawczyk's test), position, velocity and
acceleration, with ever more bits, until both ends of every ball round to the same 30 digits: then these are the digits
of the one solution. A ball that holds 0 and nothing larger than `NOTHING` is written as 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Context, Decimal
from fractions import Fraction
from typing import Any

from flint import arb, ctx

from crosscheck.errors import CannotRun
from refkin.model import Scene
from refkin.motion import Motion, Status
from refkin.proof.numbers.exact import exact_system
from refkin.proof.pose.krawczyk import Enclosure, krawczyk, objects
from refkin.solving.solve import solve
from refkin.system import System, compile_system

DIGITS = 30
NOTHING = Fraction(1, 10**45)
"""What is called 0, relative to 1: the size of the mechanism, 1 rad, 1 size/s ..."""
BITS = (256, 512, 1024)
"""The precisions that are tried. The first gives 30 digits where a pose is no nearer than 1e-12 to a singular one."""
CONSISTENT = 2.0**-150
"""What redundant rows may leave at the solution of the others: they have to be exactly consistent."""


class NotProved(CannotRun):
    """A problem whose answer is not proved to so many digits: a fault of the set."""


@dataclass(frozen=True)
class Truth:
    """Position, velocity and acceleration in metres and radians: per level, time and coordinate a number's digits."""

    levels: tuple[list[list[str]], list[list[str]], list[list[str]]]


def certified(scene: Scene) -> Truth:
    """Return the answer to a scene.

    Raises
    ------
    NotProved
        If a pose is not certified, the branch not proved to be one between the times, or a digit not decided.
    """
    motion = solve(scene, certified=True)
    if motion.verdict is not Status.OK:
        raise NotProved(f"{scene.name}: {motion.verdict} {motion.message}")
    system = compile_system(scene.mechanism, unit=scene.mechanism.unit())
    times = [_digits_at(scene, system, motion, k) for k in range(len(scene.times))]
    return Truth(tuple([levels[order] for levels in times] for order in range(3)))  # type: ignore[arg-type]


def _digits_at(scene: Scene, system: System, motion: Motion, k: int) -> tuple[list[str], ...]:
    for bits in BITS:
        root = krawczyk(system, system.to_unit(motion.q[:, k]), scene.times[k], bits)
        if root is None:
            continue
        _consistent(scene, root)
        levels = [_decided(root, balls, order) for order, balls in enumerate(_levels(root))]
        if None not in [number for level in levels for number in level]:
            return tuple([str(number) for number in level] for level in levels)
    raise NotProved(f"{scene.name}: {BITS[-1]} bits do not prove {DIGITS} digits at t = {scene.times[k]:g}")


def _levels(root: Enclosure) -> tuple[Sequence[Any], ...]:
    velocity = root.velocity()
    return root.q, velocity, root.acceleration(velocity)


def _consistent(scene: Scene, root: Enclosure) -> None:
    """Refuse redundant rows that the solution of the others does not fulfil."""
    with ctx.workprec(root.bits):
        rows = exact_system(root.system, root.bits).phi(objects(root.q), arb(root.t))
        if not all(abs(row) < CONSISTENT for row in rows):
            raise NotProved(f"{scene.name}: redundant rows contradict each other")


def _decided(root: Enclosure, balls: Sequence[Any], order: int) -> list[str | None]:
    """Return the digits of a level in metres and radians; None for a number that is not decided."""
    system = root.system
    lengths = system.turns == 0.0
    with ctx.workprec(root.bits):
        metres = system.to_physical(objects(balls), order)[: system.of_bodies]
        size = Fraction(system.unit.size)
        return [digits_of(ball, size if length else Fraction(1)) for ball, length in zip(metres, lengths, strict=False)]


def digits_of(ball: Any, scale: Fraction = Fraction(1)) -> str | None:
    """Return the digits to which all numbers of a ball round; None if they do not round to the same.

    Parameters
    ----------
    ball : flint.arb
    scale : Fraction
        What `NOTHING` is relative to.
    """
    if not ball.is_finite():
        return None
    low, high = _exactly(ball.lower()), _exactly(ball.upper())
    if low <= 0 <= high:
        return "0" if max(-low, high) < NOTHING * scale else None
    first, last = (_rounded(end) for end in (low, high))
    return str(first) if first == last else None


def _exactly(end: Any) -> Fraction:
    mantissa, exponent = end.man_exp()
    return Fraction(int(mantissa)) * Fraction(2) ** int(exponent)


def _rounded(x: Fraction) -> Decimal:
    return Context(prec=DIGITS).divide(Decimal(x.numerator), Decimal(x.denominator)).normalize(Context(prec=DIGITS))
