"""A block of mechanisms on their way through the times of a scene, all together: the machinery of `many`."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from refkin.errors import Fault, InvalidScene
from refkin.fast.certify import FamilyProof
from refkin.fast.compiled import Compiled
from refkin.fast.elimination.run import Workspace
from refkin.fast.family import Family, common_extrema, may_turn, of_samples, sample_of
from refkin.fast.march import (
    ENOUGH,
    FARTHEST,
    FURTHEST,
    LEAST,
    PART,
    SHORT,
    SMALL,
    SMALLEST_PIVOT,
    SMOOTH,
    March,
    Pose,
    profile_of,
    weights,
)  # fmt: skip
from refkin.fast.residual import residual_of_rows, without_zeros
from refkin.fast.sweep import NEAR
from refkin.joints import initial_contacts
from refkin.model import Evidence
from refkin.motion import Status
from refkin.newton import CONTRACTION, ROUND_OFF
from refkin.proof.numbers.extrema import extrema_of
from refkin.proof.numbers.inputs import coordinates_have_digits, half_ulp, laws_have_digits
from refkin.solving.starts import NEARBY
from refkin.system import compile_system

CODES = (Status.OK, Status.NOT_CONVERGED, Status.BRANCH_LOST)
"""The statuses that a sample can have, by code."""
OK, NEVER_FOUND, LOST = range(3)
MOST_NEWTON = 3
"""So many Newton steps are made by all samples; those that need more are marched on their own."""
START_NEWTON = 12
MOST_BETWEEN = 64
"""So many steps at most are made by all samples between two times."""
PRICE_OF_A_STEP, PRICE_OF_A_SAMPLE, PRICE_ALONE = 300.0, 0.2, 15.0
"""About what a step of all samples costs, what each sample adds to it, and what a step of one alone costs [us]."""
MOST_STEPS_ALONE = 2000
"""So many steps a sample may be marched on its own, all times together: about 20 ms."""


class Block:
    """Some samples of a family and where they are.

    Attributes
    ----------
    codes : (L,) array of uint8
        Codes of `CODES`: OK for the samples that are on the branch they started on.
    residual : (L,) array
        Largest component of the scaled residual at the present time.
    """

    def __init__(self, group: Family, made: Compiled, samples: slice) -> None:
        self.group, self.made, self.samples = group, made, samples
        self.count = samples.stop - samples.start
        self.system = of_samples(group.system, samples)
        self.checked = without_zeros(self.system)
        self.driven = {k: p.constraint for k, p in enumerate(self.system.placed) if p.constraint.laws}
        self.given = self._laws(group.scene.times[0])
        common = [k for k, laws in self.given.items() if not any(np.ndim(x) for law in laws for x in law)]
        self.space = Workspace(made.marching, self.count, common=common)
        profile = profile_of([p.constraint for p in self.system.placed], self.system.unit)
        self.space.give_geometry([p.g for p in self.system.placed], profile)
        out = made.marching.outputs
        self.core_rows = [self.space.row(rows[c]) for rows in out.levels for c in made.core]
        # Levels of the core at the last time but one, at the last, and at the present one.
        self.history = [np.zeros((3, len(made.core), self.count)) for _ in range(3)]
        self.codes = np.where(group.faulty[samples], NEVER_FOUND, OK).astype(np.uint8)
        self.signs = np.ones((len(out.determinants), self.count))
        self.residual = np.full(self.count, np.nan)
        proves = Evidence.CERTIFICATE in group.scene.evidence
        self.proof = FamilyProof(self.system, made, self.count) if proves else None
        self.times: list[float] = []
        self.helpers: dict[int, March] = {}

    @property
    def alive(self) -> Any:
        """Which samples are on their branch."""
        return self.codes == OK

    def _laws(self, t: float) -> dict[int, Any]:
        """Return by constraint the values and derivatives of its laws."""
        return {k: constraint.inputs(t, self.system.unit, 2) for k, constraint in self.driven.items()}

    def start(self, t: float) -> None:
        """Find the solution next to each sample's estimate, by the rule of `sweep`."""
        self.space.give_laws(self.given)
        estimate = self._estimates(t)
        for c, row in zip(self.made.core, self.space.core(), strict=True):
            row[:] = estimate[c]
        corrections, late = self._iterate(START_NEWTON)
        self._answer()
        bodies = self.system.of_bodies
        off = np.max(np.abs(self.space.level(0)[:bodies] - estimate[:bodies]), axis=0)
        if corrections:
            first, second = corrections[0], corrections[1] if len(corrections) > 1 else 0.0
            contracts = (second <= CONTRACTION * first) & (NEAR * off * second <= first**2)
            near = (off <= SMALL) | ((off <= NEARBY) & contracts)
            self.codes[late | ~near] = NEVER_FOUND
        for sign, row in zip(self.signs, self.made.marching.outputs.determinants, strict=True):
            sign[:] = np.sign(self.space.row(row))
        self.codes[self.alive & ~self._regular()] = NEVER_FOUND
        self._check(t, NEVER_FOUND)
        self._remember(t)

    def _estimates(self, t: float) -> Any:
        """Return the estimates in scaled coordinates, (n, L)."""
        given = [self.group.estimates[b.name] for b in self.group.scene.mechanism.bodies]
        missing = [b.name for b, x in zip(self.group.scene.mechanism.bodies, given, strict=True) if x is None]
        if missing:
            raise InvalidScene([Fault(f"estimates.{missing[0]}", None, "an estimate of its first pose")])
        q = np.zeros((self.system.n, self.count))
        q[: self.system.of_bodies] = np.concatenate([x[:, self.samples] for x in given])
        q = self.system.to_unit(q)
        if self.system.n > self.system.of_bodies:
            for sample in range(self.count):
                scene = self.group.sample(self.samples.start + sample)
                alone = compile_system(scene.mechanism, unit=self.group.unit_of(self.samples.start + sample))
                q[:, sample] = initial_contacts(alone, q[:, sample], t)
        return q

    def go_to(self, t: float) -> None:
        """Take all samples to time t by way of the times at which laws turn back; those at times of their own alone."""
        start, constraints = self.times[-1], tuple(self.driven.values())
        alone = may_turn(constraints, start, t, self.count)
        between = common_extrema(constraints, start, t)
        if len(between) > MOST_BETWEEN:
            between, alone = [], np.ones(self.count, bool)
        for end in (*between, t):
            self._monotonously(end, alone)

    def _monotonously(self, t: float, alone: Any) -> None:
        """Take all samples to time t, in as many steps as the laws of most of them ask for; the others march alone."""
        start, asked = self.times[-1], np.float64(1.0)
        given = ([law[0] for laws in each.values() for law in laws] for each in (self.given, self._laws(t)))
        for a, b in zip(*given, strict=True):
            asked = np.maximum(asked, np.ceil(np.abs(np.subtract(b, a)) / FURTHEST))  # NaN stays, and marches alone
        count = self._steps(asked)
        hasty = alone | ~(asked <= count)
        for k in range(1, count):
            self._step(start + (t - start) * k / count, hasty)
        self._step(t, hasty)

    def _steps(self, asked: Any) -> int:
        """Return how many steps all samples make, so that they, and those alone that ask for more, cost the least."""
        if (asked <= 1.0).all():
            return 1
        asked = np.broadcast_to(asked, self.count)[self.alive]
        together = PRICE_OF_A_STEP + PRICE_OF_A_SAMPLE * self.count
        alone = np.minimum(np.nan_to_num(asked, nan=1.0), MOST_STEPS_ALONE) * PRICE_ALONE
        counts: set[int] = {1, *np.unique(asked[asked <= MOST_BETWEEN]).astype(int).tolist()}
        return min(counts, key=lambda count: count * together + float(np.sum(alone, where=~(asked <= count))))

    def _step(self, t: float, hasty: Any) -> None:
        before, last = [None, *self.times][-2:]
        assert last is not None
        h = t - last
        if before is not None and last - before < max(SHORT * h, LEAST):
            before = None
        taylor = [0.0, 0.0, 0.0, 1.0, h, h * h / 2], [0.0, 0.0, 0.0, 0.0, 1.0, h]
        value, rate = taylor if before is None else weights(before, last, t)
        guess, rates = (_combined(factors, [*self.history[0], *self.history[1]]) for factors in (value, rate))
        self.given = self._laws(t)
        self.space.give_laws(self.given)
        for row, values in zip(self.space.core(), guess, strict=True):
            row[:] = values
        undecided = (hasty & self.alive) | self._newton()
        self._march_alone(undecided, t)
        self._answer()
        strayed = self.alive & ~undecided & ~(self._regular() & self._continues(guess, rates, h))
        if strayed.any():
            self._march_alone(strayed, t)
            self._answer()
        if (undecided | strayed).any():
            self.codes[self.alive & ~self._regular()] = LOST
        self._check(t, LOST)
        self._remember(t)

    def _answer(self) -> None:
        """Compute what follows from the core coordinates, and note the levels of the core."""
        self.space.run("answer")
        for known, row in zip(self.history[2].reshape(-1, self.count), self.core_rows, strict=True):
            known[:] = row

    def _newton(self) -> Any:
        """Make the Newton steps that each sample asks for; return which samples did not converge, or not at once."""
        corrections, late = self._iterate(MOST_NEWTON)
        if len(corrections) < 2:
            return late
        first, second = corrections[:2]
        return late | (self.alive & (first >= SMALL) & ~(second <= CONTRACTION * first))

    def _iterate(self, most: int) -> tuple[list[Any], Any]:
        """Return the corrections of up to `most` Newton steps, and which samples that are alive did not converge.

        A sample that has converged takes no part in further steps, so that its bits do not depend on other samples; its
        further corrections are 0.
        """
        step, core = self.space.row(self.made.marching.outputs.step), self.space.core()
        corrections: list[Any] = []
        late = self.alive
        while core and late.any() and len(corrections) < most:
            kept = [row.copy() for row in core] if corrections else []
            self.space.run("newton")
            for row, values in zip(core, kept, strict=bool(kept)):
                np.copyto(row, values, where=~late)
            corrections.append(np.where(late, step, 0.0) if kept else step.copy())
            late = late & ~(step <= ENOUGH)
        return corrections, late if core else np.zeros(self.count, bool)

    def _continues(self, guess: Any, rates: Any, h: float) -> Any:
        """Return which samples, and their rates, are where the prediction has them, by the rules of `march`."""
        if not len(guess):
            return np.ones(self.count, bool)
        q, v, _ = self.history[2]
        off, move, bent = (_largest(a - b) for a, b in ((q, guess), (q, self.history[1][0]), (v, rates)))
        near = off <= np.minimum(FARTHEST, np.maximum(PART * move, SMALL))
        return near & (bent * h <= np.maximum(SMOOTH * off, SMALL))

    def _regular(self) -> Any:
        """Return in which samples no determinant has changed its sign, or is nearly 0."""
        ok = np.ones(self.count, bool)
        out = self.made.marching.outputs
        for sign, determinant, pivot in zip(self.signs, out.determinants, out.pivots, strict=True):
            ok &= (self.space.row(determinant) * sign > 0) & (self.space.row(pivot) > SMALLEST_PIVOT)
        return ok

    def _march_alone(self, samples: Any, t: float) -> None:
        """Take some samples to t one by one, in steps as short as it takes; those that cannot go there are lost."""
        for sample in np.flatnonzero(samples).tolist():
            if sample not in self.helpers:
                self.helpers[sample] = self._helper(sample)
            march = self.helpers[sample]
            known = zip(self.times[::-1], self.history[1::-1], strict=False)  # the last time, and the one before it
            poses = [Pose(at, tuple(map(tuple, x[..., sample].tolist())), march.laws(at)) for at, x in known]
            path = march.to(t, poses[0], poses[1] if len(poses) > 1 else None)
            if path is None:
                self.codes[sample] = LOST
                continue
            for row, x in zip(self.space.core(), path[-1].levels[0], strict=True):
                row[sample] = x

    def _helper(self, sample: int) -> March:
        """Return what marches one sample alone."""
        k = self.samples.start + sample
        constraints, unit = self.group.of_sample(k), self.group.unit_of(k)
        single = self.made.march
        numbers = [float(sample_of(self.group.system.placed[c].g[m], k)) for c, m in single.geometry]
        extrema = partial(extrema_of, constraints)
        march = March(single, single.prepare(numbers), constraints, unit, extrema, MOST_STEPS_ALONE)
        march.signs = tuple(self.signs[:, sample].tolist())
        return march

    def _check(self, t: float, code: int) -> None:
        """Give a code to the samples that the formulas a person reads do not accept.

        Nor is one ok whose rates are not finite, or whose laws have no digits and of which nothing is proved.
        """
        q, highest = self.space.level(0), self.space.level(self.made.levels - 1)
        digits = laws_have_digits(self.system, t) & coordinates_have_digits(q)
        if self.proof is not None and not np.all(digits):
            digits = digits | np.isfinite(self.radii(t)[0])
        self.codes[self.alive & ~(digits & np.isfinite(np.add.reduce(highest)))] = code
        self.residual = residual_of_rows(self.checked, q, t)
        open_ = np.flatnonzero(self.alive & ~(self.residual <= ROUND_OFF))
        if open_.size:  # as `refkin.solve` has it: 32 units of the largest coordinate, or of the size
            scale = np.max(np.abs(q[:, open_]), axis=0)
            self.codes[open_[~(self.residual[open_] <= ROUND_OFF * scale)]] = code

    def _remember(self, t: float) -> None:
        """Note the levels of the core; samples that are lost are carried on at rest."""
        self.times = [*self.times[-1:], t]
        self.history = [*self.history[1:], self.history[0]]
        for levels in self.history[:2] if not self.alive.all() else ():
            levels[:, :, ~self.alive] = 0.0

    def radii(self, t: float) -> Any:
        """Return the certified radii (levels, L) of the present poses, NaN where nothing is proved; None if not asked.

        They are those of scaled coordinates; the way back to metres rounds once more where the ground has an origin.
        """
        if self.proof is None:
            return None
        levels = [self.space.level(order) for order in range(self.made.levels)]
        bounds = self.proof.radii(levels, t).copy()
        if any(np.any(x) for x in self.system.unit.origin):
            bounds[0] += np.max(half_ulp(self.system, levels[0]), axis=0)
        bounds[:, ~self.alive] = np.nan
        return bounds

    def levels(self, order: int) -> Any:
        """Return coordinates or rates in metres and rad, (n, L), NaN where there are none: once, after all else."""
        level = self.system.to_physical(self.space.level(order), order, in_place=True)
        if not self.alive.all():
            level[:, ~self.alive] = np.nan
        return level


def _largest(differences: Any) -> Any:
    return np.maximum.reduce(np.abs(differences, out=differences))


def _combined(factors: list[float], rows: Any) -> Any:
    """Return the sum of factor times row, always in the same order, as BLAS would not."""
    total = factors[0] * rows[0]
    part = np.empty_like(total)
    for factor, row in zip(factors[1:], rows[1:], strict=True):
        total += np.multiply(factor, row, out=part)
    return total
