"""Many mechanisms of one topology, each on the branch of its own estimate.

A sample is a mechanism. All go from time to time together: the quintic through their last two poses predicts, Newton
corrects, and what is then checked sample by sample is what `sweep` checks: contraction, signs of determinants,
continuity, and the residual by the formulas a person reads. A sample that fails is marched on its own in shorter steps
(`march`); if that fails, too, it is left where it is, and no other sample waits for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from refkin.errors import InvalidRequest, RefkinError, expect
from refkin.fast.block import CODES, NEVER_FOUND, OK, Block
from refkin.fast.compiled import Compiled, compiled
from refkin.fast.elimination.run import block_samples
from refkin.fast.family import Family, family
from refkin.fast.given import Estimates, Geometry
from refkin.fast.prepare import dropped, upstream
from refkin.joints import PLANE, polar_cams
from refkin.joints.annotations import check, is_flag
from refkin.model import Effect, Evidence, Scene
from refkin.motion import Status
from refkin.proof.formulas import agreeing
from refkin.system import compile_system


@dataclass(frozen=True)
class Slice:
    """Some mechanisms at one time, as a reducer gets them; its arrays are valid during the call only.

    Attributes
    ----------
    samples : slice
        Which mechanisms.
    k, t : int, float
        Which time.
    q, qd, qdd : (n, L) array or None
        The rows of the wanted bodies, as in a `Motion`; NaN in samples that are not ok.
    codes, residual : (L,) array
        Codes of `CODES`, and the largest component of the scaled residual.
    radii : (levels, L) array or None
        Certified radii of position, velocity and acceleration, as far as the scene calls for them, if it asks for
        certificates; NaN where nothing is proved.
    """

    samples: slice
    k: int
    t: float
    q: Any
    qd: Any
    qdd: Any
    codes: Any
    residual: Any
    radii: Any = None


@dataclass(frozen=True)
class Many:
    """What `solve_many` found.

    Attributes
    ----------
    t : (T,) array
    bodies : tuple of str
        The bodies whose coordinates `q` holds.
    codes : (M, T) array of uint8
        Statuses as codes of `CODES`; 0 is ok.
    q, qd, qdd : (n, M, T) array or None
        Coordinates and rates as in a `Motion`; None if not called for, or given to a reducer instead.
    residual : (M, T) array or None
        Largest component of the scaled residual; None if given to a reducer.
    radii : (levels, M, T) array or None
        Certified radii as in `Slice`; None if not asked for, or given to a reducer.
    reduced : list
        What the reducer returned, in the order of its calls.
    unseen : str
        What may lead past something between two times and back, and is not looked at, in words; "" where one law alone
        moves one loop, whose poses are then between those at the ends of a step. And whether bodies can be assembled on
        which nothing wanted depends.
    """

    family: Family
    t: Any
    bodies: tuple[str, ...]
    codes: Any
    q: Any
    qd: Any
    qdd: Any
    residual: Any
    radii: Any
    reduced: list[Any]
    unseen: str

    @property
    def ok(self) -> Any:
        """Which poses are answered, (M, T) of bool."""
        return self.codes == OK

    def status(self, sample: int) -> tuple[Status, ...]:
        """Return the statuses of one mechanism."""
        return tuple(CODES[code] for code in self.codes[self._number(sample)])

    def scene(self, sample: int) -> Scene:
        """Return the scene of one mechanism, with the evidence that was asked: for `sweep` or `refkin.solve`."""
        return self.family.sample(self._number(sample))

    def _number(self, sample: int) -> int:
        count, whole = self.family.size, isinstance(sample, int | np.integer) and not is_flag(sample)
        check("sample", f"a whole number from 0 to {count - 1}", sample, whole and 0 <= sample < count)
        return sample


def solve_many(
    scene: Scene,
    geometry: Geometry,
    estimates: Estimates | None = None,
    *,
    reducer: Callable[[Slice], Any] | None = None,
) -> Many:
    """Return position and what else the scene calls for, for many mechanisms of one topology.

    A sample goes on the branch of its own estimate. It is ok as long as Newton contracts, no determinant changes its
    sign and the residual, by the formulas of the joints, is at round-off; what some mechanisms pass between two times
    and come back from is not seen: `Many.unseen` says whether these are such. A sample that fails is not ok from there
    on, and the others do not wait for it: it is neither searched for nor proved unassemblable. That does
    `refkin.solve(many.scene(sample))`, which also has condition numbers; they are not computed here. Certificates are,
    if the scene asks for them: a pose that is ok and has none is at round-off and on its branch, but not proved. A
    sample with numbers that no scene may have is never ok; `many.scene(sample)` says what is wrong with it.

    Parameters
    ----------
    scene : Scene
        Topology, times, effects, wanted bodies, and all numbers that are the same in all mechanisms.
    geometry : mapping
        Joint or driver -> key of a scene file -> value with rows (M,) for numbers, such as
        ``{"A0": {"point_j": (-0.5 * crank, 0.0)}, "motor": {"law": Polynomial(coefficients=(0.0, speed))}}``.
    estimates : mapping, optional
        Body -> (x, y, phi) at the first time, numbers or rows; those of the scene by default. A sample whose estimate
        is not within 0.2 sizes and rad of an assembly, and much nearer to it than to all others, is not ok.
    reducer : callable, optional
        Is called with a `Slice` for every block of at most 10,240 mechanisms and every time, in order; what it returns
        is kept in `Many.reduced`, and no coordinates are stored. Without it all coordinates are: 8 n M T bytes for each
        level. Either way statuses take M T bytes, and all else about 2 kB for each sample of a block (four-bar).

    Raises
    ------
    InvalidScene, UnknownName
        If geometry or estimates do not fit the scene, or what they make of it is wrong in every mechanism.
    RefkinError
        If the equations have redundant rows, or none for some coordinate, or if bodies are of space.
    """
    expect("scene", scene, Scene)
    if not (reducer is None or callable(reducer)):
        raise InvalidRequest("reducer", "what takes a Slice", repr(reducer))
    group, made = _prepared(scene, geometry, estimates)
    left_out = dropped(scene.mechanism, group.scene.mechanism)
    samples, many = group.size, _unsolved(group, made, left_out, reducer is None)
    blocks = math.ceil(samples / block_samples(made.marching))
    with np.errstate(all="ignore"):  # what a sample that is lost computes is nobody's concern
        for b in range(blocks):
            _run(many, made, slice(b * samples // blocks, (b + 1) * samples // blocks), reducer)
    return many


def _prepared(scene: Scene, geometry: Geometry, estimates: Estimates | None) -> tuple[Family, Compiled]:
    """Return the family, reduced to what the wanted bodies depend on, and what is compiled of it."""
    system = agreeing(compile_system(scene.mechanism, scene.effects), scene.times)
    if system.kind is not PLANE:
        raise RefkinError(
            f"{scene.name} is {system.kind.name}: `solve_many` takes planar families, `sweep` either kind"
        )
    if system.m != system.n:
        raise RefkinError(f"{system.m} rows for {system.n} coordinates: redundant rows are for `sweep`, one at a time")
    group = family(scene, system, geometry, estimates)
    made = compiled(group.system, range(system.n), [p.g for p in group.system.placed])
    if made is None:
        raise RefkinError("the equations have no unique solution by their structure: some rows are redundant")
    mechanism = upstream(replace(scene, evidence=frozenset()), system, made)
    if mechanism is scene.mechanism:
        return group, made
    kept = {c.name for c in mechanism.constraints}
    names = {b.name for b in mechanism.bodies}
    return _prepared(
        replace(scene, mechanism=mechanism, bodies_wanted=scene.wanted),
        {name: rows for name, rows in geometry.items() if name in kept},
        None if estimates is None else {name: rows for name, rows in estimates.items() if name in names},
    )


def _called_for(scene: Scene) -> tuple[bool, bool, bool]:
    return True, Effect.VELOCITY in scene.effects, Effect.ACCELERATION in scene.effects


def _unsolved(group: Family, made: Compiled, left_out: str, stores: bool) -> Many:
    """Return what is to be filled in, without coordinates if a reducer gets them instead."""
    scene, times, system = group.scene, len(group.scene.times), group.system

    def empty(*first: int) -> Any:  # time before samples in memory: one time of a block is written in one piece
        return np.swapaxes(np.empty((*first, times, group.size)), -1, -2) if stores else None

    rows = system.kind.width * len(scene.wanted)
    q, qd, qdd = (empty(rows) if called else None for called in _called_for(scene))
    codes = np.full((times, group.size), NEVER_FOUND, np.uint8).T
    radii = empty(made.levels) if Evidence.CERTIFICATE in scene.evidence else None
    there = {
        "several laws together": sum(len(c.laws) for c in system.mechanism.constraints) > 1,
        "a cam's profile": bool(polar_cams(system.mechanism.constraints)),
        "a loop that another one moves": len(made.marching.outputs.determinants) > 1,
        left_out: bool(left_out),
    }
    unseen = ", ".join(what for what, is_there in there.items() if is_there)
    return Many(group, np.array(scene.times), scene.wanted, codes, q, qd, qdd, empty(), radii, [], unseen)


def _run(many: Many, made: Compiled, samples: slice, reducer: Callable[[Slice], Any] | None) -> None:
    """Take a block of samples through all times; keep, or reduce, each."""
    group, block = many.family, Block(many.family, made, samples)
    rows = np.concatenate([np.r_[group.system.columns(b)] for b in many.bodies])
    for k, t in enumerate(group.scene.times):
        if k == 0:
            block.start(t)
        else:
            block.go_to(t)
        radii = block.radii(t)
        levels = [block.levels(order) if called else None for order, called in enumerate(_called_for(group.scene))]
        if rows.tolist() != list(range(group.system.n)):
            levels = [None if level is None else level[rows] for level in levels]
        many.codes[samples, k] = block.codes
        if reducer is not None:
            q, qd, qdd = levels
            codes, residual = block.codes.copy(), block.residual
            many.reduced.append(reducer(Slice(samples, k, t, q, qd, qdd, codes, residual, radii)))
            continue
        for kept, level in zip((many.q, many.qd, many.qdd), levels, strict=True):
            if kept is not None:
                kept[:, samples, k] = level
        many.residual[samples, k] = block.residual
        if many.radii is not None:
            many.radii[:, samples, k] = radii
