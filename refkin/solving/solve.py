"""A whole scene, certified: on one branch from the first pose on, each pose proved, or a message why it is not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from refkin.analysis import ROUTE, acceleration, motion_of, sigma_min, slow_enough, velocity
from refkin.differences import EPS
from refkin.errors import expect
from refkin.joints import polar_cams
from refkin.joints.annotations import check, is_flag
from refkin.model import Effect, Evidence, Scene
from refkin.motion import QUANTITIES, SINGULAR, Motion, Producer, Status, no_radius, nowhere
from refkin.newton import is_round_off
from refkin.output.scene_motion import SceneMotion
from refkin.proof.assembly.assembly import assemblies
from refkin.proof.assembly.search import Assemblies
from refkin.proof.formulas import agreeing
from refkin.proof.numbers.inputs import HALF_ULP, has_digits, input_effect, output_rounding
from refkin.proof.numbers.recentred import recentred
from refkin.proof.path.branch import step_over_crossing
from refkin.proof.path.curve import MISSING
from refkin.proof.pose.choices import isolate_every_choice
from refkin.proof.pose.isolate import FLOAT64, Isolation
from refkin.proof.pose.krawczyk import Enclosure
from refkin.proof.singularity.diagnosis import NEAR as NEARLY_SINGULAR
from refkin.proof.singularity.diagnosis import diagnose_scaled
from refkin.solving.ahead import Leaps
from refkin.solving.limits import check_size, said_if_long
from refkin.solving.mobility import too_many_drivers
from refkin.solving.starts import find_start, unassemblable
from refkin.solving.straight_line import StraightLineSystem
from refkin.solving.sweep import Arrival, Sweep
from refkin.system import System, compile_system

CLEARLY = 1 / 8
"""How far numbers may move phi for its root to be told from others nearby, in units of sigma_min, by and large."""
AT_END = 1e-6
"""Distance [rad] from the end of a profile that a sweep, which halves its steps, certainly comes below."""
MOST_SEARCHES = 4
"""How many searches for a proof that poses do not exist, where closed form does not do: a second or some each."""


def solve(scene: Scene, *, certified: bool = False) -> SceneMotion:
    """Return position and what else the scene calls for, with evidence, on the branch of its estimates.

    Numbers that fail are statuses in the result, never exceptions. With `certified` it is also proved that between the
    times the branch was never changed (`proof.path.branch`); where that is not proved, the branch is lost. What would
    take more than the limits (`solving.limits`) is refused; what takes long says so meanwhile.
    """
    return _solved(scene, certified)


def nearest(scene: Scene) -> SceneMotion:
    """Return what `solve` does, moved to the numbers nearest to what is proved: what other answers are held against.

    A proof knows the solution better than the answer that it is about, by Newton's step in extended precision: next to
    singular poses by two digits and more. Where rows are redundant, it stays the answer.
    """
    return _solved(scene, certified=False, moved=True)


def _solved(scene: Scene, certified: bool, moved: bool = False) -> SceneMotion:
    expect("scene", scene, Scene)
    check("certified", "True or False", certified, is_flag(certified))
    check_size(scene)
    with said_if_long(f"solving {scene.name!r} at {len(scene.times)} times"):
        answer = _answer(scene, certified)
        if moved:
            answer.to_nearest()
        return SceneMotion.of(scene, answer.motion())


def _answer(scene: Scene, certified: bool) -> _Answer:
    system = agreeing(compile_system(scene.mechanism, scene.effects, scene.mechanism.unit()), scene.times)
    system = StraightLineSystem.of(system)
    assembled = cache(lambda t: assemblies(system, t, trying=False))
    q, status, message = _positions(system, scene, certified, lambda t: (assembled(t).gap or 0.0) > MISSING)
    answer = _Answer(system, scene, q, status, message)
    reached = np.flatnonzero(np.isfinite(q[0]))
    if reached.size:
        answer.judge(reached)
    answer.prove_impossible(assembled)
    answer.explain()
    return answer


def _positions(
    system: System, scene: Scene, certified: bool, hopeless: Callable[[float], bool]
) -> tuple[Any, list[Status], str]:
    """Return the poses that were reached (NaN elsewhere), a first status per time, and a message.

    A branch that is lost with poses ahead, which only save time, is tried without, unless it is proved that there is no
    pose, or a step passed every test and is not proved: it would be taken again.
    """
    count = len(scene.times)
    start = find_start(system, scene)
    if start.q is None:
        later = [Status.NOT_CONVERGED] * (count - 1)
        return np.full((system.n, count), np.nan), [start.status, *later], start.message
    frames = recentred(system)
    proving, first = Evidence.CERTIFICATE in scene.evidence, frames.inward(start.q)
    for ahead in (True, False):
        sweep = Sweep(frames.inner, [scene.times[0]], [first], proving=proving, certified=certified, hopeless=hopeless)
        leaps = Leaps(sweep, scene.times if ahead else ())
        q, done, why, rest = _swept(sweep, scene.times, leaps)
        step = _first_unproved(sweep, scene.times[:done], leaps)
        ended = done < count and rest is Status.BRANCH_LOST and not hopeless(scene.times[done])
        lost = ended if step is None else step in sweep.uncertified
        if leaps.ahead is None or not lost:
            break
    q = np.stack([frames.outward(pose) for pose in q.T], axis=-1) if frames.shifts.any() else q
    if step is not None:
        done = sum(t <= sweep.t[step] for t in scene.times)
        why = f"after t = {sweep.t[step]:.17g} it is not proved on which branch the motion goes on"
        ends_at = sweep.t[step + 1]
        if ends_at in scene.times and sweep.comes_to_singular_pose(step):
            done, why = done + 1, _undecided(ends_at)  # no step to such a pose can be proved, nor is it ever called ok
        q[:, done:], rest = np.nan, Status.BRANCH_LOST
    status = [Status.OK] * done + [rest] * (count - done)
    return q, status, "; ".join(filter(None, (start.message, why)))


def _first_unproved(sweep: Sweep, times: Sequence[float], leaps: Leaps) -> int | None:
    """Return the first step of a sweep that needs a proof and has none; None if all have one.

    Steps that lead to none of the times that it has reached, or to none before branches cross, need none.
    """
    steps = sweep.unproved
    step = leaps.first_astray(steps)
    if not steps or step is not None:
        return step
    full, t, q = sweep.full, np.array(sweep.t), np.array(sweep.q).T
    crossed = step_over_crossing(full, t, q, sweep.uncertified)
    last = max(time for time in times if crossed is None or time <= t[crossed])
    step = sweep.first_unproved([k for k in steps if t[k] < last])
    return crossed if step is None else step


def _swept(sweep: Sweep, times: tuple[float, ...], leaps: Leaps) -> tuple[Any, int, str, Status]:
    """Take a sweep to the times.

    Return the poses (NaN elsewhere), how many were reached, why no more, and the status of the rest.
    """
    q = np.full((len(sweep.q[0]), len(times)), np.nan)
    q[:, 0] = sweep.q[0]
    done = 1
    while done < len(times):
        poses = leaps.over(done)
        q[:, done : done + len(poses)], done = np.reshape(poses, (-1, len(q))).T, done + len(poses)
        if done == len(times):
            break
        arrival = sweep.to(times[done])
        if arrival is Arrival.OUT_OF_STEPS:
            return q, done, sweep.why, Status.NOT_CONVERGED
        if arrival is Arrival.STOPPED:
            cam = end_of_profile(sweep.system, sweep.q[-1])
            end = f"the contact of {cam} leaves its profile after t = {sweep.t[-1]:.17g}"
            return q, done, end if cam else sweep.why, Status.BRANCH_LOST
        q[:, done] = sweep.q[-1]
        if arrival is Arrival.AT_SINGULAR_POSE:
            return q, done + 1, _undecided(sweep.t[-1]), Status.BRANCH_LOST
        done += 1
    return q, len(times), "", Status.OK


def end_of_profile(system: System, q: Any) -> str:
    """Return the joint whose contact is at an end of its open profile, "" if there is none."""
    for cam in polar_cams(system.mechanism.joints):
        (s,) = q[system.parameter(cam.name)]
        if min(abs(s - end) for end in cam.profile.law.domain()) < AT_END:
            return str(cam.name)
    return ""


def _undecided(t: float) -> str:
    return f"the pose at t = {t:g} is singular: how the branch goes on is not decided"


class _Answer:
    """The arrays of a motion while they are filled, in the system's coordinates."""

    def __init__(self, system: System, scene: Scene, q: Any, status: list[Status], message: str) -> None:
        self.system, self.scene, self.t, self.q, self.status = system, scene, np.array(scene.times), q, status
        count = len(status)
        self.messages = [message, *(p.constraint.passive for p in system.placed)]
        self.contradicted = False
        self.qd, self.qdd = np.full_like(q, np.nan), np.full_like(q, np.nan)
        self.residual, self.sigma_min, self.condition = (nowhere(count) for _ in range(3))
        self.radius = no_radius(count)
        self.proofs = list[tuple[Any, Isolation]]()

    def judge(self, samples: Any) -> None:
        """Fill rates and evidence of the poses that were reached, and give each its status."""
        solvable, regular = self._look(samples)
        self._rates(samples[solvable])
        proved = Evidence.CERTIFICATE in self.scene.evidence
        # Redundant rows that contradict each other leave a residual at a regular pose, or none but in the rates: proof
        # decides there.
        redundant = self.system.m > self.system.n and bool(self.system.effects)
        ok = np.zeros(len(samples), bool)
        if not (proved or redundant):
            ok = self._closed(samples) & regular & has_digits(self.system, self.q[:, samples], self.t[samples])
        for group in (~ok & solvable, ~ok & ~solvable):
            ok[group] = self._prove(samples[group])
        slow = slow_enough(self._called_for() or [self.q], axis=0)
        for k, isolated, closes in zip(samples.tolist(), ok.tolist(), self._closed(samples).tolist(), strict=True):
            if self.status[k] is Status.OK and not isolated:
                self.status[k] = Status.SINGULAR if closes and self._has_digits(k) else Status.NOT_CONVERGED
            if self.status[k] is Status.OK and not slow[k]:
                self.status[k] = Status.NOT_CONVERGED
                self.messages.append(f"rates at t = {self.t[k]:.17g} are too large for numbers")
        for k in samples[1:]:  # no pose counts as one of the branch after one that is not
            if self.status[k] is Status.OK and self.status[k - 1] is not Status.OK:
                self.status[k] = Status.BRANCH_LOST
                self.q[:, k] = self.residual[k] = self.sigma_min[k] = self.condition[k] = np.nan
        for k in samples:
            if self.status[k] not in (Status.OK, Status.LOCKED):
                self._withhold(k, 0)

    def _has_digits(self, k: int) -> bool:
        """Return whether rounding of the scene's numbers moves phi by less than tells poses apart; note where not."""
        q, t = self.q[:, [k]], self.t[[k]]
        moved = float(np.max(input_effect(self.system, q, t, HALF_ULP)))
        if moved <= max(SINGULAR, CLEARLY * sigma_min(self.system.held_at(q).phi_q(q, t)[..., 0])):
            return True
        self.messages.append(f"laws have no digits at t = {self.t[k]:.17g}: the last ones move phi by {moved:.3g}")
        return False

    def _withhold(self, k: int, order: int) -> None:
        """Give no rates of this order or beyond at a time, and no radii from this order on."""
        for level in (self.qd, self.qdd)[max(order - 1, 0) :]:
            level[:, k] = np.nan
        for radii in (self.radius.position, self.radius.velocity, self.radius.acceleration)[order:]:
            radii[k] = np.nan

    def _closed(self, samples: Any) -> Any:
        """Return whether the residual of each pose is round-off."""
        return is_round_off(self.residual[None, samples], self.q[:, samples])

    def _look(self, samples: Any) -> tuple[Any, Any]:
        """Fill the residual; return where phi_q can be solved with, and where its sigma_min is above SINGULAR.

        Singular values are computed where the scene calls for them, and where a bound that costs less leaves doubt.
        """
        q, t, n = self.q[:, samples], self.t[samples], self.system.n
        system = self.system.held_at(q)
        self.residual[samples] = np.max(np.abs(system.phi(q, t)), axis=0)
        jacobian = np.moveaxis(system.phi_q(q, t), -1, 0)
        solvable = np.zeros(len(samples), bool)
        if Evidence.CONDITION not in self.scene.evidence:
            limit = np.maximum(SINGULAR, n * EPS * np.linalg.norm(jacobian, axis=(1, 2)))
            solvable = _at_least(jacobian) > 2 * limit  # 2: the bound is rounded
        regular, asked = solvable.copy(), ~solvable
        if asked.any():
            sigma = np.linalg.svd(jacobian[asked], compute_uv=False)
            smallest = self.sigma_min[samples[asked]] = sigma[:, n - 1]
            with np.errstate(divide="ignore", invalid="ignore"):
                self.condition[samples[asked]] = sigma[:, 0] / smallest
            solvable[asked], regular[asked] = smallest > n * EPS * sigma[:, 0], smallest > SINGULAR
        return solvable, regular

    def _rates(self, samples: Any) -> None:
        """Fill velocity and acceleration, as far as the scene calls for them."""
        if not self.system.effects or not samples.size:
            return
        q, t = self.q[:, samples], self.t[samples]
        system = self.system.held_at(q)
        phi_q = system.phi_q(q, t)
        with np.errstate(over="ignore", invalid="ignore"):  # a time whose rates are no numbers is not ok
            self.qd[:, samples] = velocity(system, q, t, phi_q)
            if Effect.ACCELERATION in system.effects:
                self.qdd[:, samples] = acceleration(system, q, self.qd[:, samples], t, phi_q)

    def _called_for(self) -> list[Any]:
        """Return the rates that the scene calls for."""
        return [self.qd, self.qdd][: len(self.system.effects)]

    def _prove(self, samples: Any) -> Any:
        """Return which poses are isolated, by proof, and note the proved radii."""
        if not samples.size:
            return np.zeros(0, bool)
        rates = [level[:, samples] if np.isfinite(level[:, samples]).all() else None for level in (self.qd, self.qdd)]
        answers = (self.system, self.q[:, samples], self.t[samples], *rates)
        isolation = isolate_every_choice(*answers)
        self.messages.append(isolation.why)
        self.proofs.append((samples, isolation))
        for name in QUANTITIES:
            getattr(self.radius, name)[samples] = getattr(isolation, name)
        for sample, enclosure in isolation.enclosures.items():
            isolation.ok[sample] &= self._take(samples[sample], enclosure)
        self._contradicted(samples, (isolation.contradiction > 1.0) & isolation.ok, isolation.contradiction)
        self.radius.position[samples] += np.max(output_rounding(self.system, self.q[:, samples]), axis=0)
        # Nearly singular, and other rows of the redundant ones may say something else: its rates may be anything.
        for k in np.flatnonzero(isolation.ok & np.isnan(self.radius.position[samples])):
            isolation.ok[k] = recentred(self.system).is_regular(self.q[:, samples[k]], self.t[samples[k]])
        return isolation.ok

    def _contradicted(self, samples: Any, where: Any, size: Any) -> None:
        """Give the status of poses, and of rates, at which redundant rows contradict each other (3, B)."""
        for k, levels, times in zip(samples, where.T, size.T, strict=True):
            if not levels.any():
                continue
            order = int(np.argmax(levels))
            self.status[k] = Status.LOCKED if order else Status.NOT_CONVERGED
            self._withhold(k, order)
            if not self.contradicted:
                what = QUANTITIES[order]
                self.messages.append(
                    f"at t = {self.t[k]:g} redundant rows contradict each other in {what}: "
                    f"{times[order]:.3g} times what rounding explains"
                )
            self.contradicted = True

    def _take(self, k: int, root: Enclosure) -> bool:
        """Replace an answer by the numbers nearest to its enclosed root, and the rates by those there.

        Return whether they may be believed: of no use are rates without digits where a pose is nearly singular.

        Bounds over all choices of redundant rows are about the answer as it was: they grow by how far it is moved.
        """
        order = len(self.system.effects)
        root, rates, known = root.with_rates(order) if order else (root, [], True)
        self._move(self.q, self.radius.position, k, root.nearest(), root)
        self._look(np.array([k]))
        of_rates = ((self.qd, self.radius.velocity), (self.qdd, self.radius.acceleration))
        for (level, radii), balls in zip(of_rates, rates, strict=False):
            self._move(level, radii, k, [float(x) for x in balls], root, balls)
        return known or not self.sigma_min[k] <= SINGULAR

    def _move(self, level: Any, radii: Any, k: int, answer: Any, root: Enclosure, truth: Any = None) -> None:
        moved = np.max(np.abs(answer - level[:, k]))
        level[:, k] = answer
        own = np.max(root.distance(level[:, k], truth))
        radii[k] = own if self.system.m == self.system.n else np.maximum(own, (radii[k] + moved) * (1 + EPS))

    def to_nearest(self) -> None:
        """Move answers to the numbers nearest to what float64 proves; those of balls are there (`_take`)."""
        for samples, proof in self.proofs if self.system.m == self.system.n else ():
            sharp = (proof.bits == FLOAT64) & [self.status[k] is Status.OK for k in samples]
            at, radii = samples[sharp], (self.radius.position, self.radius.velocity, self.radius.acceleration)
            if not at.size:
                continue
            for level, radius, known in zip((self.q, self.qd, self.qdd), radii, proof.levels, strict=False):
                best, off = known.nearest()
                level[:, at], radius[at] = best[:, sharp], np.max(off[:, sharp], axis=0)
            q = self.q[:, at]
            self.residual[at] = np.max(np.abs(self.system.held_at(q).phi(q, self.t[at])), axis=0)
            self.radius.position[at] += np.max(output_rounding(self.system, q), axis=0)

    def explain(self) -> None:
        """Say of the first singular pose what it is; else of the first that but rounding of the numbers isolates."""
        if Status.SINGULAR in self.status:
            k = self.status.index(Status.SINGULAR)
            self.messages.append(diagnose_scaled(self.system, self.q[:, k], float(self.t[k])).message)
            return
        by_rounding = np.flatnonzero(self.condition * self.system.n * EPS >= 1.0).tolist()
        for k in [k for k in by_rounding if self.status[k] is Status.OK][:1]:
            found = diagnose_scaled(self.system, self.q[:, k], float(self.t[k]))
            self.messages.append(f"at t = {self.t[k]:g} {found.message}" if found.sigma < NEARLY_SINGULAR else "")

    def prove_impossible(self, assembled: Callable[[float], Assemblies]) -> None:
        """Give the status UNASSEMBLABLE to poses that were not reached where that is proved; say what is missing.

        It is, too, where all assemblies are known, and redundant rows contradict each other in every one.
        """
        message, searches = "", 0
        for k, t in enumerate(self.scene.times):
            if self.status[k] in (Status.BRANCH_LOST, Status.NOT_CONVERGED) and searches < MOST_SEARCHES:
                searched = assembled(t)
                searches += searched.searched
                if searched.unassemblable:
                    self.status[k] = Status.UNASSEMBLABLE
                    message = message or f"at t = {t:g} {unassemblable(self.system, searched)}"
                elif self.contradicted and searched.complete and self._all_contradict(searched.poses, t):
                    self.status[k] = Status.UNASSEMBLABLE
        self.messages += [message, "" if self.status[0] is Status.OK else too_many_drivers(self.system.mechanism)]

    def _all_contradict(self, poses: Sequence[Any], t: float) -> bool:
        """Whether redundant rows contradict each other at each of some assemblies at a time, by proof."""
        proof = isolate_every_choice(self.system, np.column_stack(poses), np.full(len(poses), t))
        return bool((proof.ok & (proof.contradiction[0] > 1.0)).all())

    def motion(self) -> Motion:
        """Return the answer in metres, for the bodies and effects that the scene calls for."""
        self.q[:, [k for k, s in enumerate(self.status) if s in (Status.NOT_CONVERGED, Status.UNASSEMBLABLE)]] = np.nan
        computed = (True, bool(self.system.effects), Effect.ACCELERATION in self.system.effects)
        levels = (self.q, self.qd, self.qdd)
        condition, count = Evidence.CONDITION in self.scene.evidence, len(self.status)
        return motion_of(
            self.system,
            self.scene,
            self.t,
            [level if has else None for level, has in zip(levels, computed, strict=True)],
            status=tuple(self.status),
            residual=self.residual,
            sigma_min=self.sigma_min if condition else nowhere(count),
            condition=self.condition if condition else nowhere(count),
            certified_radius=self.radius,
            producer=Producer.of_refkin("refkin", ROUTE),
            message="; ".join(dict.fromkeys(filter(None, self.messages))),
        )


def _at_least(matrices: Any) -> Any:
    """Return a lower bound of the smallest singular value of each matrix (B, m, n), m >= n; 0 if none is known.

    It is 1 / |M^-1| in Frobenius's norm, at most sqrt(n) below that value; of redundant rows the factor R has the
    singular values.
    """
    square = matrices if matrices.shape[1] == matrices.shape[2] else np.linalg.qr(matrices, mode="r")
    try:
        return 1.0 / np.linalg.norm(np.linalg.inv(square), axis=(1, 2))
    except np.linalg.LinAlgError:  # one of them is singular to the last bit
        return np.zeros(len(matrices))
