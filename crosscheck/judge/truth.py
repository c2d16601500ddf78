"""The certified truth of a scene: how many digits of an answer are right, for certain, and how many can be.

The truth is the reference's motion with its proved radius. The digits of an answer are -log10 of its error plus that
radius and the truth's own rounding to metres, relative to the size of the mechanism (position) or to the largest
component at that time (velocity, acceleration): so many are right whatever the truth is within its radius. A row states
the fewest over the times.

Attainable digits are what half an ulp of every given number leaves, to first order: of the geometry, of the time, of
the laws' values, and of the answer in metres and radians. How far those half ulps move the three residuals is carried
to the three levels as in a budget (`crosscheck.judge.budget`), and half an ulp of the answer is added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from crosscheck.engines import QUANTITIES
from crosscheck.judge.budget import times_with
from crosscheck.judge.comparison import Reference, difference, reference, scaled, scales
from crosscheck.judge.records import MOST_DIGITS
from refkin.model import Evidence, Scene
from refkin.motion import Status
from refkin.proof.numbers.bounded import Times, bounded_system, box, read
from refkin.proof.numbers.inputs import HALF_ULP, half_ulp, input_effect
from refkin.system import System


class NoTruth(Exception):
    """A scene of which no pose is certified: there is nothing to hold an answer against."""


class CertifiedTruth:
    """What answers to a scene are held against; NoTruth if there is none at any time.

    `known` (T,) says at which times there is a certified truth, the others are left out; `attainable` are the fewest
    attainable digits over those times by quantity.
    """

    def __init__(self, scene: Scene) -> None:
        self.ref: Reference = reference(replace(scene, evidence=frozenset(Evidence)))
        motion = self.ref.motion
        self.known = times_with(motion, Status.OK)
        if not self.known.any():
            raise NoTruth(f"{scene.name}: no pose is certified, so no digit has a price: {motion.message}")
        self.bodies = [body.name for body in scene.mechanism.bodies]
        self._rows = np.concatenate([np.r_[self.ref.system.columns(body)] for body in scene.wanted])
        of_rows, rests = [x[self._rows][:, self.known] for x in self.ref.levels], self.ref.rests[:, self.known]
        self._scales = [scales(of_rows, k, rests) for k in range(3)]
        levels = attainable_levels(self.ref, self.known)
        parts = [np.max(a[self._rows], axis=0) / scale for (a, _), scale in zip(levels, self._scales, strict=True)]
        self.attainable = dict(zip(QUANTITIES, map(_digits, parts), strict=False))

    def digits(self, level: Any, order: int, before: Sequence[Any] = ()) -> tuple[float | None, str]:
        """Return the fewest digits of a level (width * bodies, T) over the times, and what is to be said of them.

        In space rates come with the levels `before` them: the signs of Euler parameters are those of the position.

        None if a time has no answer; the note says how many.
        """
        levels = {**dict(enumerate(before)), order: level}
        theirs, ours = (part[-1] for part in scaled(self.ref, self.bodies, levels))
        every = np.abs(difference(self.ref.system, theirs, ours, order)[self._rows][:, self.known])
        missing = int(np.sum(~np.isfinite(every).all(axis=0)))
        if missing:
            return None, f"no answer at {missing} of {every.shape[1]} times"
        # How far the truth may be off: its proved radius, and the rounding to metres that it went through.
        proved = getattr(self.ref.motion.certified_radius, QUANTITIES[order])[self.known]
        radius = half_ulp(self.ref.system, self.ref.levels[order][:, self.known], order)[self._rows] + proved
        at = np.argmax(every + radius, axis=0), np.arange(every.shape[1])
        scale = self._scales[order]
        worst = (every + radius)[at] / scale
        k = int(np.argmax(worst))
        known, off = (radius[at] / scale)[k], (every[at] / scale)[k]
        return _digits(worst), f"truth proved to {_digits(known):.1f} digits there" if known > off else ""


def attainable_levels(ref: Reference, known: Any) -> list[tuple[Any, Any]]:
    """Return the attainable error of position, velocity, acceleration, and these themselves; (n, B), scaled.

    The B times are those `known`, (T,) of bool: some at which the reference is ok.
    """
    samples = np.isin(np.flatnonzero(times_with(ref.motion, Status.OK)), np.flatnonzero(known))
    system, t, carry = ref.system, ref.motion.t[known], ref.propagation
    q, qd, qdd = (level[:, known] for level in ref.levels)
    e_phi = input_effect(system, q, t, HALF_ULP)
    moved = carry.carried.at(samples)(e_phi, *_inputs_in_rates(system, q, qd, qdd, t))
    return [(m + half_ulp(system, x, k), x) for k, (m, x) in enumerate(zip(moved, (q, qd, qdd), strict=True))]


def _inputs_in_rates(system: System, q: Any, qd: Any, qdd: Any, t: Any) -> tuple[Any, Any]:
    """Return how far half an ulp of every given number moves phi_q qd - nu and phi_q qdd - gamma, (m, B) each."""
    moved, samples = bounded_system(system, error=HALF_ULP), len(t)
    times = Times(t, 3)  # by order 3 the time in order 2
    pose, rate, bend = box(q), box(qd), box(qdd)
    slope = moved.phi_q(pose, times)
    at_rate = slope @ rate - moved.nu(pose, times)
    at_bend = slope @ bend - moved.gamma(pose, rate, times)
    return read(at_rate, samples).spread, read(at_bend, samples).spread


def _digits(errors: Any) -> float:
    """Return -log10 of the largest error, between none and `MOST_DIGITS`."""
    largest = float(np.max(errors))
    return float(np.clip(-np.log10(largest), 0.0, MOST_DIGITS)) if largest > 0.0 else MOST_DIGITS
