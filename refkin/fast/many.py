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

from refkin.errors import RefkinError
from refkin.fast.block import CODES, NEVER_FOUND, OK, Block
from refkin.fast.compiled import Compiled, compiled
from refkin.fast.elimination.run import block_samples
from refkin.fast.family import Family, family
from refkin.fast.given import Estimates, Geometry
from refkin.fast.prepare import upstream
from refkin.joints import PLANE, polar_cams
from refkin.model import Effect, Evidence, Scene
from refkin.motion import Status
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
        moves one loop, whose poses are then between those at the ends of a step.
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
        return tuple(CODES[code] for code in self.codes[sample])

    def scene(self, sample: int) -> Scene:
        """Return the scene of one mechanism, with the evidence that was asked: for `sweep` or `refkin.solve`."""
        return self.family.sample(sample)


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
        is not much nearer to one assembly than to all others is not ok.
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
    group, made = _prepared(scene, geometry, estimates)
    samples = group.size
    blocks = math.ceil(samples / block_samples(made.marching))
    result = _Result(group, made, reducer)
    with np.errstate(all="ignore"):  # what a sample that is lost computes is nobody's concern
        for b in range(blocks):
            result.run(slice(b * samples // blocks, (b + 1) * samples // blocks))
    return result.many()


def _prepared(scene: Scene, geometry: Geometry, estimates: Estimates | None) -> tuple[Family, Compiled]:
    """Return the family, reduced to what the wanted bodies depend on, and what is compiled of it."""
    implied = {Effect.VELOCITY} if Effect.ACCELERATION in scene.effects else set()
    system = compile_system(scene.mechanism, scene.effects | implied)
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


class _Result:
    """What is kept of all blocks."""

    def __init__(self, group: Family, made: Compiled, reducer: Callable[[Slice], Any] | None) -> None:
        self.group, self.made, self.reducer = group, made, reducer
        self.t = np.array(group.scene.times)
        effects = group.scene.effects
        called = (True, Effect.VELOCITY in effects, Effect.ACCELERATION in effects)
        self.orders = [order for order, wanted in enumerate(called) if wanted]
        self.rows = np.concatenate([np.r_[group.system.columns(b)] for b in group.scene.wanted])
        times, samples = len(self.t), group.size
        self.codes = np.full((times, samples), NEVER_FOUND, np.uint8)
        self.reduced: list[Any] = []
        # Time before samples in memory: one time of a block is written in one piece.
        kept = self.orders if reducer is None else []
        self.stored = {order: np.empty((len(self.rows), times, samples)) for order in kept}
        self.residual = np.empty((times, samples)) if reducer is None else None
        proves = Evidence.CERTIFICATE in group.scene.evidence
        self.radii = np.empty((made.levels, times, samples)) if proves and reducer is None else None

    def run(self, samples: slice) -> None:
        """Take a block of samples through all times."""
        block = Block(self.group, self.made, samples)
        for k, t in enumerate(self.group.scene.times):
            if k == 0:
                block.start(t)
            else:
                block.go_to(t)
            self._take(block, samples, k, t)

    def _take(self, block: Block, samples: slice, k: int, t: float) -> None:
        """Keep, or reduce, one time of one block."""
        levels: list[Any] = [None, None, None]
        for order in self.orders:
            level = block.levels(order)
            levels[order] = level[self.rows] if len(self.rows) < len(level) else level
        self.codes[k, samples] = block.codes
        if self.reducer is not None:
            q, qd, qdd = levels
            codes, residual = block.codes.copy(), block.residual
            self.reduced.append(self.reducer(Slice(samples, k, t, q, qd, qdd, codes, residual, block.radii(t))))
            return
        for order, rows in self.stored.items():
            rows[:, k, samples] = levels[order]
        self.residual[k, samples] = block.residual  # type: ignore[index]
        if self.radii is not None:
            self.radii[:, k, samples] = block.radii(t)

    def many(self) -> Many:
        """Return what was found."""
        q, qd, qdd = (np.swapaxes(self.stored[k], 1, 2) if k in self.stored else None for k in range(3))
        residual = None if self.residual is None else self.residual.T
        radii = None if self.radii is None else np.swapaxes(self.radii, 1, 2)
        wanted = self.group.scene.wanted
        return Many(self.group, self.t, wanted, self.codes.T, q, qd, qdd, residual, radii, self.reduced, self.unseen())

    def unseen(self) -> str:
        """Return in words what is not looked at between two times; "" if there is no such thing."""
        constraints = self.group.system.mechanism.constraints
        there = {
            "several laws together": sum(len(c.laws) for c in constraints) > 1,
            "a cam's profile": bool(polar_cams(constraints)),
            "a loop that another one moves": len(self.made.marching.outputs.determinants) > 1,
        }
        return ", ".join(what for what, is_there in there.items() if is_there)
