"""The reference by every route: Jacobians, stopping rules, the chord method, so many corrections, evidence, lanes."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.price_route import PricedRoute, Refused
from refkin.analysis import acceleration, estimated, velocity
from refkin.differences import Scheme, jacobian
from refkin.model import Effect, Evidence, Scene
from refkin.motion import Motion
from refkin.newton import CorrectionNorm, RoundOff, newton, solve_linear
from refkin.solving.solve import solve
from refkin.system import System, compile_system

ORDERS: tuple[frozenset[Effect], ...] = (frozenset(), frozenset({Effect.VELOCITY}), frozenset(Effect))
LIMITS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6)
"""Newton squares the error: what stops at a correction of 1e-4 is right to about 1e-8."""
CHORD_LIMITS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
DIFFERENCED: tuple[tuple[str, Callable[[], Any]], ...] = (
    ("|dq| < 0.0001", partial(CorrectionNorm, 1e-4)),
    ("to round-off", RoundOff),
)
SCHEMES = {"forward": Scheme.FORWARD, "central": Scheme.CENTRAL, "complex-step": Scheme.COMPLEX_STEP}
Slope = Callable[[System, Any, float], Any]


@dataclass(frozen=True)
class Problem:
    """A scene as every Newton here meets it: scaled equations, and the estimate of the first pose."""

    scene: Scene
    system: System
    start: Any
    times: tuple[float, ...]

    def read(self, levels: Any) -> list[Any]:
        """Return levels (n, T) in metres, without contact parameters."""
        system = self.system
        return [system.to_physical(level, order)[: system.of_bodies] for order, level in enumerate(levels)]

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


def problem(scene: Scene) -> Problem:
    """Return the scaled equations of a scene, and where Newton starts."""
    system = compile_system(scene.mechanism, unit=scene.mechanism.unit())
    return Problem(scene, system, estimated(system, scene), scene.times)


def routes(scene: Scene) -> Iterator[PricedRoute | Refused]:
    """Yield the routes of the reference."""
    given = problem(scene)
    lost = [body.name for body in scene.mechanism.bodies if body.estimate is None]
    if lost:
        reason = f"no estimate to start from: {', '.join(lost)}"
        yield Refused(engine="refkin", name="Newton", reason=reason)
    else:
        yield from _newton_routes(given)
    yield from _solve_routes(scene)
    yield from _lanes_routes(scene)


def _newton_routes(given: Problem) -> Iterator[PricedRoute]:
    def route(name: str, knob: str, solve: Any, note: str = "") -> PricedRoute:
        return PricedRoute(
            engine="refkin", name=name, knob=knob, newton_by="refkin", solve=solve, read=given.read, note=note
        )

    for limit in LIMITS:
        rule = partial(CorrectionNorm, limit)
        yield route("Newton, analytic Jacobian", f"|dq| < {limit:g}", partial(_swept, given, rule))
    yield route("Newton, analytic Jacobian", "to round-off", partial(_swept, given, RoundOff))
    for count in range(1, 6):
        knob = f"{count} correction{'s' * (count > 1)}"
        yield route("Newton, stopped", knob, partial(_swept, given, _no_rule, max_iterations=count))
    for name, scheme in SCHEMES.items():
        by, note = partial(_by_differences, scheme), "the same Jacobian gives the rates"
        for knob, stop in DIFFERENCED:
            yield route(f"Newton, {name} Jacobian", knob, partial(_swept, given, stop, slope=by), note)
    for limit in CHORD_LIMITS:
        chord = partial(_swept, given, partial(CorrectionNorm, limit), jacobian_every=0)
        yield route("chord", f"|dq| < {limit:g}", chord, "one Jacobian per time")


def _never(residual: Any, correction: Any, q: Any) -> bool:
    return False


def _no_rule() -> Any:
    """Return the stopping test that never stops: the cap on corrections does."""
    return _never


def _at(function: Callable[[Any, float], Any], t: float, q: Any) -> Any:
    return function(q, t)


def _analytic(system: System, q: Any, t: float) -> Any:
    return system.phi_q(q, t)


def _by_differences(scheme: Scheme, system: System, q: Any, t: float) -> Any:
    return jacobian(lambda x: system.phi(x, t), q, scheme)


def _swept(given: Problem, rule: Callable[[], Any], order: int, *, slope: Slope = _analytic, **options: Any) -> Any:
    """Solve time by time, each started at the last pose; then the rates up to an order."""
    system, q = given.system, given.start
    found = np.empty((system.n, len(given.times)))
    for k, t in enumerate(given.times):
        phi, phi_q = partial(_at, system.phi, t), partial(_at, partial(slope, system), t)
        result = newton(phi, phi_q, q, stop=rule(), **options)
        q = found[:, k] = result.q
    if slope is _analytic:
        return [found, *given.rates(found, order)]
    return [found, *_rates_by(slope, given, found, order)]


def _rates_by(slope: Slope, given: Problem, q: Any, order: int) -> list[Any]:
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


def _solve_routes(scene: Scene) -> Iterator[PricedRoute]:
    """Yield `refkin.solve`, which keeps its branch and brings what evidence it is asked for."""
    for knob, evidence in (
        ("no evidence", frozenset[Evidence]()),
        ("condition", frozenset({Evidence.CONDITION})),
        ("certificate", frozenset(Evidence)),
    ):
        yield PricedRoute(
            engine="refkin",
            name="solve, branch kept",
            knob=knob,
            newton_by="refkin",
            solve=partial(_solved, replace(scene, evidence=evidence, bodies_wanted=None)),
            read=_read_motion,
            note="the truth itself" + ", with its proof" * (Evidence.CERTIFICATE in evidence),
        )


def _solved(scene: Scene, order: int) -> Motion:
    return solve(replace(scene, effects=ORDERS[order]))


def _read_motion(motion: Motion) -> list[Any]:
    return [level for level in motion.levels if level is not None]


def _lanes_routes(scene: Scene) -> Iterator[PricedRoute]:
    """Yield the compiled path over whole rows of times, where it is installed."""
    try:
        fast: Any = importlib.import_module("refkin.fast")
    except ImportError:
        return
    for knob, evidence in (("no evidence", frozenset[Evidence]()), ("certificate", frozenset(Evidence))):
        yield PricedRoute(
            engine="refkin",
            name="lanes",
            knob=knob,
            newton_by="refkin (compiled elimination)",
            solve=partial(_compiled, replace(scene, evidence=evidence, bodies_wanted=None), fast.attempt),
            read=_read_motion,
            note="all times at once",
        )


def _compiled(scene: Scene, attempt: Callable[[Scene], Motion | None], order: int) -> Motion:
    found = attempt(replace(scene, effects=ORDERS[order]))
    if found is None:
        raise EngineError("the compiled path leaves this scene to refkin.solve")
    return found
