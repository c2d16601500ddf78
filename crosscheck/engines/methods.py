"""One class for a method, and the registry that compare, price, effects, hard and bench iterate.

A method is a producer, a name and a setting. Its model of a scene is built once; what is timed answers all times of the
scene at once, in the producer's own coordinates; reading that as poses of bodies is a third thing. An engine lists its
methods by `methods()`. One that does not has one for each of its routes, and these serve every measurement: so an
engine of a user's own appears in every table, and need say no more than its routes. Nothing asks an engine past them.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Sequence, Set
from copy import deepcopy
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from importlib import import_module
from typing import Any, TypeVar

import numpy as np

from crosscheck.engines import (
    PEERS,
    QUANTITIES,
    Array,
    Engine,
    EngineError,
    Level,
    Term,
    all_of,
    refusals,
    refuse,
    terms_of,
)
from crosscheck.engines.loading import load
from crosscheck.engines.undisturbed import quiet
from crosscheck.errors import kept
from crosscheck.scenes.names import called, called_for, order_of
from crosscheck.scenes.workloads import AnswerPiece, FourBars, LoopChain, Workload, whole
from crosscheck.scenes.workloads_space import SpatialLoops
from refkin.model import Effect, Scene
from refkin.motion import Motion, Producer, Route, Seeding, Status, engine_motion

Copied = TypeVar("Copied", Scene, Motion)
PRICED = ("refkin", "refkin-batch", "scipy", *PEERS)
"""Whose methods a price list has by default."""
MODULES = {
    "refkin": "ours.refkin_methods",
    "refkin-batch": "ours.batch",
    "scipy": "ours.scipy_methods",
    "numpy": "ours.rivals",
    "c": "ours.rivals",
    "exudyn": "exudyn.methods",
    "mujoco": "mujoco.methods",
    "pinocchio": "pinocchio.methods",
}
"""Producer -> the module of `crosscheck.engines` whose `methods()` lists its methods; others say it themselves."""
ORDERS: tuple[frozenset[Effect], ...] = (frozenset(), frozenset({Effect.VELOCITY}), frozenset(Effect))
"""What a scene calls for whose answer goes up to position, velocity, acceleration."""
PART, PART_IN_SPACE = 3600, 720
"""Of many mechanisms a method that takes one scene after the other answers about so many configurations."""


class Use(StrEnum):
    """What a method is measured for."""

    COMPARE = "compare"
    """Held against the reference over drawn scenes."""
    PRICE = "price"
    """Digits against time on one scene."""
    EFFECTS = "effects"
    """Each effect switched on by itself."""
    HARD = "hard"
    """Scenes at and near singular poses."""
    BENCH = "bench"
    """Large workloads, against C."""
    FEATURE = "feature"
    """Features of the engine that its other methods avoid, on the scenes that are drawn for them."""


ALL = frozenset(Use) - {Use.FEATURE}


@dataclass(frozen=True)
class Model:
    """A scene as a method has built it.

    Attributes
    ----------
    solve : callable
        Order (0 position, 1 velocity too, 2 acceleration too) -> the answer at all times of the scene, in the
        producer's own coordinates. This is what is timed.
    read : callable
        That answer -> per order (3n, T): x, y [m], phi [rad] of each of the scene's n bodies, or their derivatives; NaN
        where there is no answer.
    """

    solve: Callable[[int], Any]
    read: Callable[[Any], Sequence[Any]]


@dataclass(frozen=True)
class Batch:
    """A workload as a method has built it.

    Attributes
    ----------
    run : callable
        What is timed.
    count : int
        How many configurations one call answers, or how many Newton iterations it makes.
    answers : callable
        What was answered: `AnswerPiece`s of four-bars or RSSRs, or the coordinates (n,) of a chain.
    note : str
        What a reader has to know of it at this workload, beside the method's own note.
    """

    run: Callable[[], object]
    count: int
    answers: Callable[[], Any]
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Method:
    """A producer, a name and a setting.

    Attributes
    ----------
    engine, name, setting : str
        Who, how, at which setting. Settings come in their order: what should be more accurate comes later.
    newton_by : str
        Who ran Newton.
    seeding : Seeding
        How much of our answer it is given.
    uses : set of Use
    build : callable or None
        Scene -> its model. Raises EngineError if the method refuses the scene. None: it has but answers, whose price
        holds the building of a model, or it takes workloads alone.
    batch : callable or None
        Workload and order -> what is timed; by default one scene after the other.
    highest : int
        The highest order it gives.
    at_once : bool
        Whether all orders come from one run, so that each costs what all cost.
    together : bool
        Whether it finds the poses of all times together, so that one costs less the more there are.
    steps : bool
        Whether it steps in time, so that a pose needs the one before it.
    note : str
        What a reader has to know of it.
    adapter : Engine, optional
        The engine whose method it is: it says what it can express, and what it adds to the allowed error.
    route : Route, optional
        Who does what in it; by default the engine all of it.
    answer : callable, optional
        Scene -> its whole answer, with statuses of its own and the motion of points; by default what its model answers.
    """

    engine: str
    name: str
    newton_by: str
    uses: frozenset[Use]
    setting: str = ""
    seeding: Seeding = Seeding.INITIAL_GUESS
    build: Callable[[Scene], Model] | None = None
    batch: Callable[[Any, int], Batch] | None = None
    highest: int = 2
    at_once: bool = False
    together: bool = False
    steps: bool = False
    note: str = ""
    adapter: Any = None
    route: Route | None = None
    answer: Callable[[Scene], Motion] | None = None

    @property
    def key(self) -> tuple[str, str, str]:
        """What it is called by: engine, name, setting."""
        return self.engine, self.name, self.setting

    @property
    def called(self) -> str:
        """What it is called where settings have no column."""
        return called(self.name, self.setting)

    @property
    def delivers(self) -> tuple[str, ...]:
        """The quantities that it owes."""
        able = getattr(self.adapter, "delivers", QUANTITIES)
        return tuple(quantity for quantity in QUANTITIES[: self.highest + 1] if quantity in able)

    @property
    def producer(self) -> Producer:
        """Who makes its answers."""
        who = dict.fromkeys(("residual_by", "jacobian_by", "linear_solve_by", "drift_by"), self.engine)
        route = self.route or Route(name=self.called, newton_by=self.newton_by, seeding=self.seeding, **who)
        return Producer(name=self.engine, version=getattr(self.adapter, "version", str)(), route=route)

    def model(self, scene: Scene) -> Model:
        """Return its model of a scene; raises EngineError if it refuses the scene, or takes none."""
        build = self.build or (partial(_asked_anew, self.answer) if self.answer else None)
        if build is None:
            raise EngineError(f"{self.engine}, {self.name}: made for the benchmark's workloads alone")
        self._refuse(scene)
        model = build(scene)
        if not isinstance(model, Model):
            raise EngineError(
                f"{self.engine}, {self.name}: build: expected a {__name__}.Model, got {kept(repr(model))}"
            )
        return model

    def _refuse(self, scene: Scene) -> None:
        """Raise EngineRefusal where the engine's table says so: nobody is asked what he says he has not."""
        if hasattr(self.adapter, "capabilities"):
            refuse(refusals(self.adapter, scene, Level.SOLVE))

    def solve(self, scene: Scene, order: int | None = None) -> Motion:
        """Return its answer at all times of a scene, up to an order, or as the scene calls for; EngineError if refused.

        The scene is handed over as it is: whoever needs it afterwards, hands over a copy.
        """
        if order is not None:
            scene = replace(scene, effects=ORDERS[order])
        with quiet():
            if self.answer is not None:
                self._refuse(scene)
                return self.answer(scene)
            bodies = tuple(body.name for body in scene.mechanism.bodies)
            model, order = self.model(scene), min(order_of(scene), self.highest)
            read = model.read(model.solve(order))
            several = isinstance(read, tuple | list | np.ndarray) and len(read) and read[0] is not None
            if not several or any(np.ndim(level) != 2 for level in read if level is not None):  # as a motion has them
                expected = f"read: expected a list of arrays (rows, times), got {kept(repr(read))}"
                raise EngineError(f"{self.engine}, {self.name}: {expected}")
            levels = called_for(scene, read[: order + 1])
            return motion_of(scene.times, bodies, levels, self.producer)

    def terms(self, scene: Scene) -> Sequence[Term]:
        """Return what it adds to the allowed error of a scene by its own doing."""
        if not hasattr(self.adapter, "terms"):
            return ()
        with quiet():
            return terms_of(self.adapter, scene, self.producer.route)

    def affected(self, effect: str) -> Method:
        """Return the method with one of the engine's physical effects switched on behind the back of scenes."""
        return next(one for one in methods(self.adapter.with_effect(effect)) if one.key == self.key)

    def batched(self, workload: Workload, order: int) -> Batch:
        """Return a workload as the method takes it; EngineError says why it does not."""
        if self.batch is not None:
            return self.batch(workload, order)
        if isinstance(workload, LoopChain):
            raise EngineError("not made for chains: it makes no single Newton iterations")
        return one_by_one(self.model, workload, order)


def priced(
    engine: str, name: str, setting: str, newton_by: str, build: Callable[[Scene], Model], note: str = "", **more: Any
) -> Method:
    """Return a method of which prices are measured, unless its `uses` are said.

    Parameters
    ----------
    engine, name, setting, newton_by, build, note, **more
        As `Method` has them; the other of its fields that are said.
    """
    given: dict[str, Any] = {"engine": engine, "name": name, "setting": setting, "newton_by": newton_by}
    return Method(**{**given, "build": build, "note": note, "uses": frozenset({Use.PRICE}), **more})


def one_by_one(
    build: Callable[[Scene], Model],
    workload: FourBars | SpatialLoops,
    order: int,
    configurations: int | None = None,
    note: str = "",
) -> Batch:
    """Return the first mechanisms of a workload as one scene after the other.

    Parameters
    ----------
    build, workload, order : callable, FourBars or SpatialLoops, int
        Scene -> its model; the highest level that is asked for, 0 to 2.
    configurations : int, optional
        About how many are asked for; by default `PART`, in space `PART_IN_SPACE`.
    note : str
        What is said of the batch.
    """
    asked = configurations or (PART_IN_SPACE if isinstance(workload, SpatialLoops) else PART)
    part = workload.first(max(1, asked // len(workload.t)))
    models = [build(part.scene(sample)) for sample in range(part.mechanisms)]

    def answers() -> Iterable[AnswerPiece]:
        for sample, model in enumerate(models):
            levels = [floats(level)[:, None] for level in model.read(model.solve(order))[: order + 1]]
            yield whole(part, np.array([sample]), levels, range(len(levels[0])))

    return Batch(lambda: [model.solve(order) for model in models], part.configurations, answers, note)


def of_four_bars(workload: Workload) -> FourBars:
    """Return a workload of four-bars; raises EngineError if it is none."""
    if not isinstance(workload, FourBars):
        raise EngineError("made for four-bars")
    return workload


def methods(engine: str | Engine, use: Use | None = None) -> list[Method]:
    """Return the methods of a producer: one of `OURS`, what `engines.loading.load` takes, or an engine.

    Given a `use`, only those that are measured for it. EngineError if there is no such producer, or its package is
    missing.
    """
    listed = _listed(engine)
    return [method for method in listed if use is None or use in method.uses]


def _listed(engine: str | Engine) -> list[Method]:
    if isinstance(engine, str) and engine in MODULES:
        try:
            listed = import_module(f"crosscheck.engines.{MODULES[engine]}").methods()
            return [one for one in listed if one.engine == engine]
        except ImportError as error:
            raise EngineError(f"{engine} is not installed: {error}") from error
    loaded: Any = load(engine) if isinstance(engine, str) else engine
    if not hasattr(loaded, "methods"):
        return of_routes(loaded)
    listed = list(loaded.methods())
    all_of(loaded, "methods", listed, Method)
    for one in listed:
        if not (isinstance(one.uses, Set) and one.highest in range(3)):
            said = f"a set of Use, and highest 0 to 2, got {one.uses!r} and {one.highest!r}"
            raise EngineError(f"engine {loaded.name!r}: methods(): expected of a Method {said}")
    return [replace(one, engine=loaded.name, adapter=loaded) for one in listed]


def copied(one: Copied) -> Copied:
    """Return an equal scene or motion, all of it anew."""
    try:
        new: Copied = pickle.loads(pickle.dumps(one, pickle.HIGHEST_PROTOCOL))
    except Exception:  # a class of one's own that a function defines, or one that is copied in a way of its own
        return deepcopy(one)  # takes five times as long
    return new


def of_routes(engine: Engine, uses: frozenset[Use] = ALL) -> list[Method]:
    """Return a method for each route of an engine, and for those of hard cases, features and effects alone."""
    listed = [_of_route(engine, route, uses) for route in engine.routes()]
    for use, key in ((Use.HARD, "discovery"), (Use.FEATURE, "features"), (Use.EFFECTS, "dynamic_routes")):
        listed += [_of_route(engine, route, frozenset({use})) for route in getattr(engine, key, tuple)()]
    return listed


def _of_route(engine: Engine, route: Route, uses: frozenset[Use]) -> Method:
    kept = getattr(engine, "kept", {})
    return Method(
        engine=engine.name,
        name=route.name,
        newton_by=route.newton_by,
        seeding=route.seeding,
        uses=uses,
        highest=max((QUANTITIES.index(quantity) for quantity in getattr(engine, "delivers", ())), default=2),
        note=kept.get(route, "builds its model in every call"),
        adapter=engine,
        route=route,
        build=partial(_kept, engine, route) if route in kept else None,
        answer=lambda scene: engine.solve(scene, route),
    )


def _kept(engine: Any, route: Route, scene: Scene) -> Model:
    """Return a scene as an engine builds it by a route, to be asked again."""
    plain = _plain(scene)
    with quiet():
        return _asked(engine.model(plain, route).solve, plain)


def _asked_anew(answer: Callable[[Scene], Motion], scene: Scene) -> Model:
    """Return a scene as a method takes it that has no model apart from its answer."""
    return _asked(answer, _plain(scene))


def _plain(scene: Scene) -> Scene:
    """Return a copy of a scene that wants all bodies, no points and no evidence."""
    return copied(replace(scene, evidence=frozenset(), points=(), bodies_wanted=None))


def _asked(answer: Callable[[Scene], Motion], plain: Scene) -> Model:
    def asked(order: int) -> Motion:
        with quiet():
            return answer(replace(plain, effects=ORDERS[order]))

    return Model(asked, levels_of)


def levels_of(motion: Motion) -> list[Array]:
    """Return the levels that a motion has."""
    return [level for level in motion.levels if level is not None]


def floats(level: Any) -> Array:
    """Return numbers as floats; EngineError if they are complex: the real parts alone are nobody's answer."""
    if np.iscomplexobj(level):
        raise EngineError(f"expected an array of floats, got {np.asarray(level).dtype}")
    return np.asarray(level, float)


def motion_of(times: Any, bodies: tuple[str, ...], levels: Sequence[Any], producer: Producer) -> Motion:
    """Return levels of bodies as a motion: ok wherever there are numbers. Complex ones stay what they are.

    Parameters
    ----------
    times, bodies, producer : (T,) array, tuple of str, Producer
        Times [s].
    levels : sequence of (n, T) array or None
        Positions, and as many rates as there are [m, rad].
    """
    levels = [level if level is None or np.iscomplexobj(level) else floats(level) for level in levels]
    there = np.all([np.isfinite(level).all(axis=0) for level in levels if level is not None], axis=0)
    status = tuple(Status.OK if ok else Status.NOT_CONVERGED for ok in there)
    q, qd, qdd = [*levels, None, None][:3]
    return engine_motion(times, bodies, q, qd, qdd, status, producer)
