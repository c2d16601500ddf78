"""A problem: a scene with the assembly that is meant, the proved answer to it, and the other assemblies by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from random import Random
from typing import Any

import numpy as np

from crosscheck.problems.certified import NotProved, Truth, certified
from crosscheck.problems.planar import FAMILIES, Stated
from refkin.model import Body, Scene
from refkin.proof.assembly.assembly import Assemblies, assemblies
from refkin.scenes.linkages import Branch, rough
from refkin.system import System, compile_system

MOST_OTHERS = 7
"""Of a mechanism's other assemblies so many are kept, the nearest."""
SIDES = {1: "left", -1: "right", 0: "flat"}


@dataclass(frozen=True)
class Problem:
    """A problem of the set.

    Attributes
    ----------
    name : str
        Family, number and assembly.
    assembly : str
        "open" or "crossed" of a linkage; on which side each dyad's inner joint lies; or a number, in order of size.
    truth : Truth
    others : tuple of dict
        Per time, name of another assembly -> its coordinates in metres and radians (float64).
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
        system = compile_system(self.stated.mechanism, unit=self.stated.mechanism.unit())
        found = [assemblies(system, t) for t in self.stated.times]
        names = assembly_names(self.stated, system, found[0])
        meant = names[self.assembly]
        scene = _scene(self.stated, system, found[0], self.assembly, f"{self.name} {meant}".replace(" ", "-"))
        truth = certified(scene)
        others = tuple(
            _others(system, known, [float(x) for x in row], dict(zip(found[0].branches, names, strict=False)))
            for known, row in zip(found, truth.levels[0], strict=True)
        )
        return Problem(scene.name, self.family, self.stated.title, meant, scene, truth, others)


def drafts(only: str = "") -> Iterator[Draft]:
    """Yield the problems of the set in their order, or those whose family's name contains a text."""
    for family in FAMILIES:
        name = family.__name__.replace("_", "-")
        for k, stated in enumerate(family(Random(name)) if only in name else ()):
            for assembly in range(stated.assemblies):
                yield Draft(f"{name}-{k + 1:02d}", name, stated, assembly)


def assembly_names(stated: Stated, system: System, found: Assemblies) -> list[str]:
    """Return a name for each assembly at the first time."""
    if len(found.poses) < stated.assemblies:
        raise NotProved(f"{stated.title}: {len(found.poses)} assemblies, {stated.assemblies} expected")
    if stated.linkage is not None:
        value = float(stated.mechanism.drivers[0].laws[0](stated.times[0]))
        poses = {b: stated.linkage.assemble(value, b, driven=stated.driven) for b in Branch}
        rows = {b: np.concatenate([pose[body.name] for body in stated.mechanism.bodies]) for b, pose in poses.items()}
        return [min(Branch, key=lambda b: _apart(system, q, system.to_unit(rows[b]))).value for q in found.poses]
    if found.branches and all(found.branches) and len(set(found.branches)) == len(found.poses):
        return ["-".join(SIDES[side] for side in sides) for sides in found.branches]
    return ["only"] if len(found.poses) == 1 else [f"number {k + 1}" for k in range(len(found.poses))]


def _scene(stated: Stated, system: System, found: Assemblies, k: int, name: str) -> Scene:
    """Return the scene with estimates of the k-th assembly, as rough as the nearest other one allows."""
    near = min((_apart(system, found.poses[k], q) for n, q in enumerate(found.poses) if n != k), default=1.0)
    metres = system.to_physical(found.poses[k])
    pose = {body.name: tuple(metres[system.columns(body.name)].tolist()) for body in stated.mechanism.bodies}
    size = system.unit.size
    estimates = rough(pose, size, size * min(near, 1.0) ** 2 / 4)
    bodies = tuple(Body(name=body, estimate=estimate) for body, estimate in estimates.items())
    return Scene(mechanism=replace(stated.mechanism, bodies=bodies), times=stated.times, name=name)


def _apart(system: System, q: Any, other: Any) -> float:
    """Return the largest difference of two poses in the system's coordinates, angles up to whole turns."""
    difference = np.abs(np.asarray(q) - other)
    turned = np.abs((difference + np.pi) % (2 * np.pi) - np.pi)
    return float(np.max(np.where(system.angles, turned, difference)))


def _others(
    system: System, found: Assemblies, own: Sequence[float], names: Mapping[Any, str]
) -> Mapping[str, list[float]]:
    """Return the assemblies at a time but the one that is meant, the nearest ones, by name."""
    at = system.to_unit(np.array(own))
    away = sorted(range(len(found.poses)), key=lambda k: _apart(system, at, found.poses[k]))
    out: dict[str, list[float]] = {}
    for k in away[1 : MOST_OTHERS + 1]:
        name = names.get(found.branches[k] if found.branches else None, f"other {len(out) + 1}")
        out[name] = [float(x) for x in system.to_physical(found.poses[k])]
    return out
