"""The reference by every method: Jacobians, stopping rules, the chord method, so many corrections, evidence."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.methods import ORDERS, Batch, Method, Model, Use, levels_of, one_by_one, priced
from crosscheck.scenes.workloads import LoopChain, Workload
from refkin.analysis import acceleration, estimate_of, velocity
from refkin.differences import Scheme, jacobian
from refkin.model import Evidence, Scene
from refkin.newton import CorrectionNorm, RoundOff, newton, solve_linear
from refkin.solving.solve import solve
from refkin.system import System, compile_system

LIMITS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6)
"""Newton squares the error: what stops at a correction of 1e-4 is right to about 1e-8."""
CHORD_LIMITS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
DIFFERENCED: tuple[tuple[str, Callable[[], Any]], ...] = (
    ("|dq| < 0.0001", partial(CorrectionNorm, 1e-4)),
    ("to round-off", RoundOff),
)
EVIDENCE: dict[str, frozenset[Evidence]] = {
    "no evidence": frozenset(),
    "condition": frozenset({Evidence.CONDITION}),
    "certificate": frozenset(Evidence),
}
FEW = 720
"""Of many mechanisms it answers about so many configurations: it is a thousand times slower than the fast path."""
LONGEST = 100
"""The longest chain that it is asked for."""
ITERATIONS = 5
"""From an estimate that is right to six decimals two would do."""
SCHEMES = {"forward": Scheme.FORWARD, "central": Scheme.CENTRAL, "complex-step": Scheme.COMPLEX_STEP}
Slope = Callable[[System, Any, float], Any]


@dataclass(frozen=True)
class ScaledProblem:
    """A scene as every Newton here meets it: scaled equations, and the estimate of the first pose."""

    system: System
    start: Any
    times: tuple[float, ...]

    def read(self, levels: Any) -> list[Any]:
        """Return levels (n, T) in metres, without contact parameters."""
        system = self.system
        return [system.to_physical(level, order)[: system.of_bodies] for order, level in enumerate(levels)]

    def poses(self, step: Callable[[Any, float], Any]) -> Any:
        """Return what a step makes of the last pose at each time, (n, T)."""
        q, poses = self.start, np.empty((self.system.n, len(self.times)))
        for k, t in enumerate(self.times):
            q = poses[:, k] = step(q, t)
        return poses

    def rates(self, q: Any, order: int) -> list[Any]:
        """Return velocity and acceleration up to an order, all times at once, by the analytic Jacobian."""
        levels: list[Any] = []
        t = np.array(self.times)
        try:
            if order > 0:
                levels.append(velocity(self.system, q, t))
            if order > 1:
                levels.append(acceleration(self.system, q, levels[0], t))
        except np.linalg.LinAlgError:
            levels += [np.full_like(q, np.nan)] * (order - len(levels))
        return levels


def problem(scene: Scene) -> ScaledProblem:
    """Return the scaled equations of a scene, and where Newton starts; raises EngineError without an estimate."""
    lost = [body.name for body in scene.mechanism.bodies if body.estimate is None]
    if lost:
        raise EngineError(f"no estimate to start from: {', '.join(lost)}")
    system = compile_system(scene.mechanism, unit=scene.mechanism.unit())
    return ScaledProblem(system, estimate_of(system, scene), scene.times)


def methods() -> Iterator[Method]:
    """Yield the methods of the reference."""
    yield from _solve_methods()
    for limit in LIMITS:
        yield _newton("Newton, analytic Jacobian", f"|dq| < {limit:g}", partial(CorrectionNorm, limit))
    yield _newton("Newton, analytic Jacobian", "to round-off", RoundOff)
    for count in range(1, 6):
        setting = f"{count} correction{'s' * (count > 1)}"
        yield _newton("Newton, stopped", setting, lambda: lambda *_: False, max_iterations=count)
    for name, scheme in SCHEMES.items():
        by, note = partial(_by_differences, scheme), "the same Jacobian gives the rates"
        for setting, stop in DIFFERENCED:
            yield _newton(f"Newton, {name} Jacobian", setting, stop, note, slope=by)
    for limit in CHORD_LIMITS:
        rule = partial(CorrectionNorm, limit)
        yield _newton("chord", f"|dq| < {limit:g}", rule, "one Jacobian per time", jacobian_every=0)
    uses, batch = frozenset({Use.BENCH}), _dense_chain
    note = "every joint's formula in Python, dense numpy.linalg.solve"
    yield Method(engine="refkin", name="Newton iteration, dense", newton_by="refkin", uses=uses, batch=batch, note=note)


def _newton(name: str, setting: str, rule: Any, note: str = "", **options: Any) -> Method:
    def build(scene: Scene) -> Model:
        given = problem(scene)
        return Model(partial(_swept, given, rule, **options), given.read)

    return priced("refkin", name, setting, "refkin", build, note)


def _analytic(system: System, q: Any, t: float) -> Any:
    return system.phi_q(q, t)


def _by_differences(scheme: Scheme, system: System, q: Any, t: float) -> Any:
    return jacobian(lambda x: system.phi(x, t), q, scheme)


def _swept(
    given: ScaledProblem, rule: Callable[[], Any], order: int, *, slope: Slope = _analytic, **options: Any
) -> Any:
    """Solve time by time, each started at the last pose; then the rates up to an order."""
    system = given.system

    def step(q: Any, t: float) -> Any:
        return newton(lambda x: system.phi(x, t), lambda x: slope(system, x, t), q, stop=rule(), **options).q

    poses = given.poses(step)
    if slope is _analytic:
        return [poses, *given.rates(poses, order)]
    return [poses, *_rates_by(slope, given, poses, order)]


def _rates_by(slope: Slope, given: ScaledProblem, q: Any, order: int) -> list[Any]:
    """Return the rates up to an order from a Jacobian that is not the analytic one, time by time."""
    system = given.system
    levels = [np.full_like(q, np.nan) for _ in range(order)]
    for k, t in enumerate(given.times if order else ()):
        matrix = slope(system, q[:, k], t)
        try:
            qd = levels[0][:, k] = solve_linear(matrix, system.nu(q[:, k], t))
            if order > 1:
                levels[1][:, k] = solve_linear(matrix, system.gamma(q[:, k], qd, t))
        except np.linalg.LinAlgError:
            continue
    return levels


def _solve_methods() -> Iterator[Method]:
    """Yield `refkin.solve`, which keeps its branch and brings what evidence it is asked for."""
    yield Method(
        engine="refkin",
        name="solve",
        newton_by="refkin",
        uses=frozenset({Use.EFFECTS, Use.HARD}),
        answer=solve,
        note="with the evidence that the scene calls for",
    )
    for setting, evidence in EVIDENCE.items():
        batch = {"uses": frozenset({Use.PRICE, Use.BENCH}), "batch": partial(_solved_in_turn, evidence)}
        more: dict[str, Any] = {} if evidence else batch
        note = "the truth itself, keeps its branch" + ", with its proof" * (Evidence.CERTIFICATE in evidence)
        yield priced("refkin", "solve", setting, "refkin", partial(_solving, evidence), note, together=True, **more)


def _solving(evidence: frozenset[Evidence], scene: Scene) -> Model:
    plain = replace(scene, evidence=evidence, points=(), bodies_wanted=None)
    return Model(lambda order: solve(replace(plain, effects=ORDERS[order])), levels_of)


def _solved_in_turn(evidence: frozenset[Evidence], workload: Workload, order: int) -> Batch:
    if isinstance(workload, LoopChain):
        raise EngineError("not made for chains: `Newton iteration, dense` is what it does there")
    return one_by_one(partial(_solving, evidence), workload, order, FEW)


def _dense_chain(workload: Workload, order: int) -> Batch:
    if not isinstance(workload, LoopChain):
        raise EngineError("made for chains")
    refuse_longer(workload, LONGEST, "a dense solve in Python takes seconds there")
    system, t = workload.system, workload.scene.times[0]
    return iterated(workload, lambda q: q - np.linalg.solve(system.phi_q(q, t), system.phi(q, t)))


def refuse_longer(work: LoopChain, longest: int, reason: str) -> None:
    """Raise EngineError if a chain has more loops than a method is asked for.

    Parameters
    ----------
    work, longest, reason : LoopChain, int, str
        How many loops are asked for at most, and why not more.
    """
    if work.windows > longest:
        raise EngineError(f"not for more than {longest} loops: {reason}")


def iterated(work: LoopChain, step: Callable[[Any], Any]) -> Batch:
    """Return a chain's Newton iteration, q (n,) -> the next iterate, both scaled; a few say where they lead."""
    start = work.system.to_unit(work.start)

    def answered() -> Any:
        q = start
        for _ in range(ITERATIONS):
            q = step(q)
        return work.system.to_physical(q)

    return Batch(lambda: step(start), 1, answered)
