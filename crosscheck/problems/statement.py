"""A problem: a scene with the assembly that is meant, the proved answer to it, and the other assemblies by name.

The answer has 30 digits. A pose that `refkin.solve` has certified is enclosed anew in ball arithmetic (Krawczyk's
test), position, velocity and acceleration, with ever more bits, until both ends of every ball round to the same 30
digits: then these are the digits of the one solution. A ball that holds 0 and nothing larger than `NOTHING` is
written as 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Context, Decimal
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
from flint import arb, ctx

from crosscheck.errors import CannotRun
from crosscheck.problems import Stated, planar, spatial
from refkin.joints import SPACE
from refkin.model import Body, Scene
from refkin.motion import Motion, Status
from refkin.proof.assembly.assembly import assemblies
from refkin.proof.assembly.search import Assemblies
from refkin.proof.assembly.spatial import signed
from refkin.proof.numbers.exact import exact_system, fraction_of
from refkin.proof.pose.krawczyk import Enclosure, krawczyk, objects
from refkin.scenes.linkages import Branch
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


Truth = Sequence[list[list[str]]]
"""Position, velocity and acceleration in metres and radians: per level, time and coordinate a number's digits."""


def certified(scene: Scene) -> Truth:
    """Return the answer to a scene.

    NotProved if a pose is not certified, the branch not proved to be one between the times, or a digit not decided.
    """
    motion = solve(scene, certified=True)
    if motion.verdict is not Status.OK:
        raise NotProved(f"{scene.name}: {motion.verdict} {motion.message}")
    system = compile_system(scene.mechanism, unit=scene.mechanism.unit())
    times = [_digits_at(scene, system, motion, k) for k in range(len(scene.times))]
    return [[levels[order] for levels in times] for order in range(3)]


def _digits_at(scene: Scene, system: System, motion: Motion, k: int) -> list[list[str]]:
    for bits in BITS:
        root = krawczyk(system, system.to_unit(motion.q[:, k]), scene.times[k], bits)
        if root is None:
            continue
        with ctx.workprec(bits):
            rows = exact_system(system, bits).phi(objects(root.q), arb(root.t))
            if not all(abs(row) < CONSISTENT for row in rows):  # redundant ones, that the others' solution leaves open
                raise NotProved(f"{scene.name}: redundant rows contradict each other")
        velocity = root.velocity()
        enclosed = (root.q, velocity, root.acceleration(velocity))
        levels = [_decided(root, balls, order) for order, balls in enumerate(enclosed)]
        if None not in [number for level in levels for number in level]:
            return [[str(number) for number in level] for level in levels]
    raise NotProved(f"{scene.name}: {BITS[-1]} bits do not prove {DIGITS} digits at t = {scene.times[k]:g}")


def _decided(root: Enclosure, balls: Sequence[Any], order: int) -> list[str | None]:
    """Return the digits of a level in metres and radians; None for a number that is not decided."""
    system = root.system
    lengths = system.turns == 0.0
    with ctx.workprec(root.bits):
        metres = system.to_physical(objects(balls), order)[: system.of_bodies]
        size = Fraction(system.unit.size)
        return [digits_of(ball, size if length else Fraction(1)) for ball, length in zip(metres, lengths, strict=False)]


def digits_of(ball: Any, scale: Fraction = Fraction(1)) -> str | None:
    """Return the digits to which all numbers of a `flint.arb` round; None if they do not round to the same.

    `NOTHING` is relative to the scale.
    """
    if not ball.is_finite():
        return None
    low, high = fraction_of(ball.lower()), fraction_of(ball.upper())
    if low <= 0 <= high:
        return "0" if max(-low, high) < NOTHING * scale else None
    context = Context(prec=DIGITS)
    ends = (context.divide(Decimal(x.numerator), Decimal(x.denominator)) for x in (low, high))
    first, last = (end.normalize(context) for end in ends)
    return str(first) if first == last else None


MOST_OTHERS = 7
"""Of a mechanism's other assemblies so many are kept, the nearest."""
SIDES = {1: "left", -1: "right", 0: "flat"}


@dataclass(frozen=True)
class Problem:
    """A problem of the set; its name is made of family, number and assembly.

    The assembly is "open" or "crossed" of a linkage, on which side each dyad's inner joint lies, or a number, in order
    of size. `others` has, per time and by name, those of other assemblies in metres and radians, as far as each goes.
    """

    name: str
    family: str
    title: str
    assembly: str
    scene: Scene
    truth: Truth
    others: tuple[Mapping[str, list[float]], ...]


@dataclass(frozen=True)
class Draft:
    """A problem before its answer is proved, which takes most of the time: what it is, and which assembly is meant."""

    name: str
    family: str
    stated: Stated
    assembly: int

    def problem(self) -> Problem:
        """Return the problem, with the answer that is proved."""
        stated = self.stated
        system = compile_system(stated.mechanism, unit=stated.mechanism.unit())
        solutions = _in_order(assemblies(system, stated.times[0]))
        names = _assembly_names(stated, system, solutions)
        away = [round(_apart(system, solutions.poses[self.assembly], q), 6) for q in solutions.poses]  # mirrored: alike
        nearest = sorted(range(len(away)), key=away.__getitem__)[: MOST_OTHERS + 1]
        scenes = {names[k]: _scene(stated, system, solutions, k, f"{self.name} {names[k]}") for k in nearest}
        meant = names[self.assembly]
        own = scenes.pop(meant)
        others = followed(scenes, len(own.times))
        return Problem(own.name, self.family, stated.title, meant, own, certified(own), others)


def followed(scenes: Mapping[str, Scene], times: int) -> tuple[Mapping[str, list[float]], ...]:
    """Return per time where the scenes of some assemblies have gone, by their names, as far as they go."""
    motions = {name: solve(scene) for name, scene in scenes.items()}
    return tuple(
        {name: motion.q[:, k].tolist() for name, motion in motions.items() if motion.status[k] is Status.OK}
        for k in range(times)
    )


def drafts(only: str = "") -> Iterator[Draft]:
    """Yield the problems of the set in their order, or those whose family's name contains a text."""
    for family in (*planar.FAMILIES, *spatial.FAMILIES):
        name = family.__name__.replace("_", "-")
        for k, stated in enumerate(family(Random(name)) if only in name else ()):
            for assembly in range(stated.assemblies):
                yield Draft(f"{name}-{k + 1:02d}", name, stated, assembly)


def _assembly_names(stated: Stated, system: System, solutions: Assemblies) -> list[str]:
    """Return a name for each assembly at the first time."""
    if len(solutions.poses) < stated.assemblies:
        raise NotProved(f"{stated.title}: {len(solutions.poses)} assemblies, {stated.assemblies} expected")
    if stated.linkage is not None:
        value = float(stated.mechanism.drivers[0].laws[0](stated.times[0]))
        poses = {b: stated.linkage.assemble(value, b, driven=stated.driven) for b in Branch}
        rows = {b: np.concatenate([pose[body.name] for body in stated.mechanism.bodies]) for b, pose in poses.items()}
        return [min(Branch, key=lambda b: _apart(system, q, system.to_unit(rows[b]))).value for q in solutions.poses]
    if solutions.branches and all(solutions.branches) and len(set(solutions.branches)) == len(solutions.poses):
        return ["-".join(SIDES[side] for side in sides) for sides in solutions.branches]
    return ["only"] if len(solutions.poses) == 1 else [f"number {k + 1}" for k in range(len(solutions.poses))]


def _in_order(solutions: Assemblies) -> Assemblies:
    """Return assemblies that were found by search, in whatever order, sorted by their coordinates."""
    if all(solutions.branches):
        return solutions
    return replace(solutions, poses=tuple(sorted(solutions.poses, key=lambda q: np.round(q, 6).tolist())))


def _scene(stated: Stated, system: System, solutions: Assemblies, k: int, name: str) -> Scene:
    """Return the scene with estimates of the k-th assembly, as rough as the nearest other one allows."""
    near = min((_apart(system, solutions.poses[k], q) for n, q in enumerate(solutions.poses) if n != k), default=1.0)
    decimals = max(2, math.ceil(-math.log10(min(near, 1.0) / 20)))
    lengths = decimals - math.floor(math.log10(system.unit.size))
    metres = system.to_physical(solutions.poses[k])
    bodies = []
    for body in stated.mechanism.bodies:
        at = metres[system.columns(body.name)].tolist()
        origin, turned = at[: system.kind.dimension], at[system.kind.dimension :]
        estimate = [round(x, lengths) + 0.0 for x in origin] + [round(x, decimals) + 0.0 for x in turned]  # none is -0
        bodies.append(Body(name=body.name, estimate=tuple(estimate)))
    mechanism = replace(stated.mechanism, bodies=tuple(bodies))
    return Scene(mechanism=mechanism, times=stated.times, name=name.replace(" ", "-"))


def _apart(system: System, q: Any, other: Any) -> float:
    """Return the largest difference of two poses in the system's coordinates, whole turns and signs of p aside."""
    difference = np.abs(q - (signed(system, other, q) if system.kind is SPACE else other))
    turned = np.abs((difference + np.pi) % (2 * np.pi) - np.pi)
    return float(np.max(np.where(system.angles, turned, difference)))
