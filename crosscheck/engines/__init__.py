"""What an engine is to this suite: a `Protocol`, and a declared capability table (`loading`: where it comes from).

It answers two questions:

`solve(scene, route)`
    position, velocity, acceleration in its natural form, as a `Motion`;
`constraints(scene)`
    its own residual, Jacobian, constraint velocity and drift term in a model whose coordinates are (x, y, phi) per
    body, at configurations that need not be assembled.

One whose model of a scene can be asked again says by which routes: `kept`, each with what is said of its price. Then
`model(scene, route)` builds it (`KeptModel`), and that is priced apart; by other routes it is built in every call.

An engine that lists methods of its own (`crosscheck.engines.methods`) needs no `solve`. What it cannot do it refuses by
name (`refusals`), it never skips in silence. One of positions alone says so: `delivers = ("position",)`; without that
attribute all three are owed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from enum import StrEnum
from numbers import Real
from typing import Any, ClassVar, NamedTuple, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.frames import RowMap
from crosscheck.errors import kept
from crosscheck.scenes.names import PEERS as PEERS
from crosscheck.scenes.names import PHYSICAL as PHYSICAL
from crosscheck.scenes.names import QUANTITIES as QUANTITIES
from crosscheck.scenes.names import called_for
from refkin.joints import AxesParallel, Constraint, Counted, elements_of
from refkin.model import Mechanism, Scene
from refkin.motion import Motion, PointMotion, Producer, Route, Seeding, __version__, engine_motion

API = (1, 0)
Array = NDArray[np.float64]
FORMS = ("half", "dot", "printed", "")
"""Of the joints of space; the empty one is that which the mechanism has."""


class Level(StrEnum):
    """What can be asked of an engine about one joint."""

    RESIDUAL = "residual"
    """phi(q, t) of the joint's rows."""
    JACOBIAN = "jacobian"
    """phi_q of them."""
    CONSTRAINT_VELOCITY = "constraint_velocity"
    """phi_q qd, with phi_t where the engine has the driver."""
    DRIFT = "drift"
    """gamma, as in phi_q qdd = gamma."""
    SOLVE = "solve"
    """Poses and rates of a mechanism that has the joint."""


class Support(StrEnum):
    """How an engine answers: by its own means, with the adapter supplying a part, or not at all."""

    NATIVE = "native"
    """The engine has the joint itself."""
    DERIVED = "derived"
    """The adapter supplies a part of it."""
    REFUSED = "refused"
    """It is not asked."""


@dataclass(frozen=True)
class Capability:
    """How one engine treats one element at one level, and why where it does not simply do it."""

    support: Support
    reason: str = ""


Capabilities = Mapping[str, Mapping[Level, Capability]]
"""Element of joints and drivers (one of `ELEMENTS`) -> level -> capability.

What is absent is refused at every level, and with it every joint that consists of it.
"""
OF_SPACE = (
    *("points of space coincide", "axes parallel", "axes perpendicular", "point on axis", "point in plane", "screw"),
    *("turn about axis", "turn about axis by a law", "twist about axis", "shift along axis by a law"),
    *("distance of space", "distance of space by a law", "turns in gear"),
)
ELEMENTS = (
    *("points coincide", "points coincide by a law", "point on line", "distance", "distance by a law"),
    *("coordinate by a law", "angle", "angle by a law", "rolling wheels", "rolling wheels on a carrier"),
    *("rolling on a line", "contact"),
    *OF_SPACE,
)
"""The keys of a capability table (`refkin.joints.Element.key`); `refkin.joints.elements` says what they mean.

A twist is a turn about axes that nothing else of its joint keeps parallel.
"""

NATIVE = Capability(Support.NATIVE)


def refused(reason: str) -> Capability:
    """Return the refusal with its reason."""
    return Capability(Support.REFUSED, reason)


def derived(reason: str) -> Capability:
    """Return support in which the adapter supplies the part that `reason` names."""
    return Capability(Support.DERIVED, reason)


def by_level(rows: Capability, solve: Capability) -> dict[Level, Capability]:
    """Return what a table says of an element: of constraint rows at every level the same, and how it is solved."""
    return {**dict.fromkeys(Level, rows), Level.SOLVE: solve}


def native_but(**exceptions: Capability) -> dict[Level, Capability]:
    """Return the capability at each level: native but for the exceptions."""
    return {level: exceptions.get(level.value, NATIVE) for level in Level}


@dataclass(frozen=True, kw_only=True)
class Term:
    """An error that an engine adds by its own doing, as a bound of the scaled residual at one level.

    `level` is position (added to e_phi), velocity (e_nu) or acceleration (e_gamma); or, for an engine's own rows, one
    of `Level` (unscaled). `relative` multiplies the size of what stands in the equations there (for own rows: the
    largest coordinate, rate, or omega times rate of any body), `absolute` is added as it is. `of_rates` multiplies the
    largest rate of an angle or of a point of a joint (velocity), or the largest acceleration and square of a rate
    (acceleration), of what joints connect; they need not stand in the equations of the reference at all.

    `form` is that of the joints of space in whose rows `absolute` is left at the position. Rows of another form are
    those turned as the joint turns: what a pose leaves of the ones moves, so rates that satisfy them do not satisfy the
    others.
    """

    name: str
    level: str
    reason: str
    absolute: float = 0.0
    relative: float = 0.0
    of_rates: float = 0.0
    form: str = ""


def route_by(by: str, name: str, newton_by: str, *, linear_solve_by: str = "numpy", drift_by: str = "") -> Route:
    """Return a route on the rows of an engine, which is given estimates; also its drift terms where nobody is named.

    Parameters
    ----------
    by, name, newton_by, linear_solve_by, drift_by : str
        Whose residual and Jacobian; the method's name; who does the rest.
    """
    who = {"residual_by": by, "jacobian_by": by, "linear_solve_by": linear_solve_by, "drift_by": drift_by or by}
    return Route(name=name, newton_by=newton_by, seeding=Seeding.INITIAL_GUESS, **who)


class EngineError(Exception):
    """An engine that failed in a way that is no status."""

    def __str__(self) -> str:
        return kept(super().__str__()) or "it gave no reason"


class EngineRefusal(EngineError):
    """An engine that was asked for what it cannot do, and says so."""


class Switch(NamedTuple):
    """An effect beside kinematics: what switches it on in a model, in words and as a function."""

    description: str
    switch: Callable[[Any], None]


class KeptModel(Protocol):
    """An engine's model of a scene by one route, built once and asked again: each answer is as if it were the first."""

    def solve(self, scene: Scene) -> Motion:
        """Return the answer to the scene that it was built of, at the levels that this one calls for."""

    def close(self) -> None:
        """Free what the engine holds, unless it goes with the object."""
        return


TABULATED = "laws are tabulated with the model"
"""What the price of an answer has not in it, where a model keeps the values of laws."""


class Adapter:
    """What adapters say of their engines by class attributes.

    Attributes
    ----------
    package : module or None
        The engine's package; None if the engine is this project's own.
    solving, shipped, special, dynamic : tuple of Route
        Routes, best first; those with the engine's own settings, of hard cases; those through features that are
        avoided elsewhere; those through its dynamics, which answer no scene but may feel an effect. In space there are
        the first two alone.
    kept : mapping
        Those whose model of a scene may be asked again, each with what is said of its price.
    table : mapping
        What it can express.
    """

    api = API
    name: str
    package: Any = None
    solving: tuple[Route, ...]
    shipped: tuple[Route, ...] = ()
    special: tuple[Route, ...] = ()
    dynamic: tuple[Route, ...] = ()
    kept: Mapping[Route, str] = {}
    table: Capabilities
    effect: str | None = None

    def version(self) -> str:
        """Return the version of the engine's package."""
        return str(self.package.__version__ if self.package else __version__)

    def routes(self) -> Sequence[Route]:
        """Return the routes of every night."""
        return self.solving

    def discovery(self) -> Sequence[Route]:
        """Return the routes of hard cases alone."""
        return self.shipped

    def features(self) -> Sequence[Route]:
        """Return the routes through features."""
        return self.special

    def capabilities(self) -> Capabilities:
        """Return what it can express."""
        return self.table

    def terms(self, scene: Scene, route: Route | None = None) -> Sequence[Term]:
        """Return nothing: it adds nothing to the allowed error."""
        return ()

    def solve(self, scene: Scene, route: Route | None = None) -> Motion:
        return self.answer(scene, self.producer(scene, route))

    def model(self, scene: Scene, route: Route | None = None) -> KeptModel:
        """Return its model of a scene by a route of `kept`; raises as `solve` where it refuses the scene."""
        return self.built(scene, self.producer(scene, route))

    def producer(self, scene: Scene, route: Route | None) -> Producer:
        """Return who answers a scene; raises as `checked`."""
        return Producer(name=self.name, version=self.version(), route=self.checked(scene, route))

    def built(self, scene: Scene, producer: Producer) -> KeptModel:
        """Return its model of a scene that `checked` lets pass, by the producer's route."""
        raise NotImplementedError

    def answer(self, scene: Scene, producer: Producer) -> Motion:
        """Return its answer to a scene that `checked` lets pass: by a model that is built, asked and freed."""
        with closing(self.built(scene, producer)) as model:
            return model.solve(scene)

    def checked(self, scene: Scene, route: Route | None) -> Route:
        """Return the route, by default the best; raise EngineError if it has none such, EngineRefusal for a scene."""
        routes = (*self.solving, *self.shipped, *self.dynamic, *self.special)
        if route is not None and route not in routes:
            known = ", ".join(repr(r.name) for r in routes)
            raise EngineError(f"{self.name} has no method {route.name!r}; there are: {known}")
        refuse(refusals(self, scene, Level.SOLVE))
        route = route or self.solving[0]
        if in_space(scene.mechanism):
            if route not in (*self.solving, *self.shipped):
                raise EngineRefusal(f"{self.name} refuses method {route.name!r} in space: it is written for the plane")
            if self.effect is not None:
                why = "its adapter has them in the plane alone"
                raise EngineRefusal(f"{self.name} refuses physical effects in space: {why}")
        return route

    def constraints(self, scene: Scene) -> ConstraintModel:
        """Refuse: there are no rows, and each element says why."""
        reasons = {levels[Level.RESIDUAL].reason for levels in self.table.values()}
        raise EngineRefusal(f"{self.name}: {'; '.join(sorted(reasons))}")


class SimulatingAdapter(Adapter):
    """An adapter in whose models one physical effect may be switched on, for the ledger of effects.

    `effects` says how each is switched on, `missing` why there is none; `effect` is on in every model that solves.
    """

    effects: Mapping[str, Switch]
    missing: ClassVar[Mapping[str, str]] = {}

    def __init__(self, effect: str | None = None) -> None:
        self.effect = effect

    def dynamic_routes(self) -> Sequence[Route]:
        """Return the routes through the engine's dynamics, which answer no scene but may feel an effect."""
        return self.dynamic

    def physical_effects(self) -> Mapping[str, str]:
        """Return each of `PHYSICAL` that the engine has, with what is done to switch it on."""
        return {name: effect.description for name, effect in self.effects.items()}

    def missing_effects(self) -> Mapping[str, str]:
        """Return each of `PHYSICAL` that it does not have, with the reason; what it names in neither, it has not."""
        return self.missing

    def with_effect(self, effect: str) -> Self:
        """Return the engine with an effect switched on behind the back of the scene."""
        return type(self)(effect)


class ConstraintModel(Protocol):
    """An engine's own constraint rows, in the engine's own order and sign; `rows` maps ours onto them.

    Columns are (x, y, phi) of the scene's bodies in their order, in metres and the ground frame of the scene; in space
    (v, w) of each, at Euler parameters of length 1, and rows are those of our joints in the form that the attribute
    `form` names. Returned arrays are fresh copies. Raises nothing for unassembled configurations.
    """

    rows: Sequence[RowMap]
    owns_driver: bool

    def residual(self, q: Array, t: float) -> Array:
        """Return the engine's residual, (m,)."""

    def jacobian(self, q: Array, t: float) -> Array:
        """Return the engine's constraint Jacobian, (m, n)."""

    def constraint_velocity(self, q: Array, qd: Array, t: float) -> Array:
        """Return the engine's own phi_q qd (+ phi_t where it owns the driver), (m,)."""

    def drift(self, q: Array, qd: Array, t: float) -> Array:
        """Return gamma as the engine has it: phi_q qdd = gamma, (m,)."""

    def close(self) -> None:
        """Free what the engine holds, unless it goes with the object."""
        return


@runtime_checkable
class Engine(Protocol):
    """A peer that answers scenes."""

    name: str
    api: tuple[int, int]

    def version(self) -> str:
        """Return the version of the engine's package."""

    def routes(self) -> Sequence[Route]:
        """Return the routes it knows, best first."""

    def capabilities(self) -> Capabilities:
        """Return what it can express."""

    def terms(self, scene: Scene, route: Route | None = None) -> Sequence[Term]:
        """Return what this engine adds to the allowed error by its own doing; usually nothing."""

    def solve(self, scene: Scene, route: Route | None = None) -> Motion:
        """Return its answer to a scene; raises EngineRefusal if it cannot, EngineError if it fails."""

    def constraints(self, scene: Scene) -> ConstraintModel:
        """Return its constraint rows for the joints that it does not refuse at level residual."""


def refused_joints(engine: Engine, constraints: Iterable[Constraint], level: Level) -> list[tuple[str, str, str]]:
    """Return (type, name, reason) of what `engine` does not have at `level`: once for each element that it refuses.

    Parameters
    ----------
    engine, constraints, level : Engine, iterable of Constraint, Level
        Joints and drivers, and what would be asked.
    """
    table, unsupported = engine.capabilities(), []
    for constraint in constraints:
        reasons, elements = [], list(elements_of([constraint]))
        rows = int(isinstance(constraint, Counted))  # what a gear counts turns with
        parallel = any(isinstance(element, AxesParallel) for element in elements)
        for element in elements:
            rows += element.rows
            key = element.key if parallel or element.key != "turn about axis" else "twist about axis"
            capability = table.get(key, {}).get(level)
            if capability is None:
                reasons.append(f"no such element in this engine: {key}")
            elif capability.support is Support.REFUSED:
                reasons.append(capability.reason)
        if rows != constraint.rows and getattr(constraint, "form", "") != "printed":  # more rows, the same joint
            reasons.insert(0, "no such joint in this engine: no elements say what it is")
        unsupported += [(constraint.type, constraint.name, reason) for reason in dict.fromkeys(reasons)]
    return unsupported


def refusals(engine: Engine, scene: Scene, level: Level) -> list[str]:
    """Return why `engine` cannot answer `scene` at `level`, joint by joint; empty if it can.

    Parameters
    ----------
    engine, scene, level : Engine, Scene, Level
    """
    refused = refused_joints(engine, scene.mechanism.constraints, level)
    return [f"{engine.name} refuses {kind} {name!r} at {level}: {reason}" for kind, name, reason in refused]


def refuse(reasons: Sequence[str]) -> None:
    """Raise EngineRefusal with the reasons, if there are any."""
    if reasons:
        raise EngineRefusal("; ".join(reasons))


def in_space(mechanism: Mechanism) -> bool:
    """Return whether a mechanism is one of space."""
    return mechanism.kind.name == "spatial"


def expressed(engine: Engine, scene: Scene) -> list[Constraint]:
    """Return the joints and drivers that `engine` has constraint rows of: those that it does not refuse there."""
    return [c for c in scene.mechanism.constraints if not refused_joints(engine, [c], Level.RESIDUAL)]


def answered(
    scene: Scene, levels: Sequence[Any], points: Iterable[Sequence[Any]], status: Any, producer: Producer, **more: Any
) -> Motion:
    """Return what a scene calls for of the motion of its wanted bodies and of its points.

    Parameters
    ----------
    scene, status, producer : Scene, sequence of Status, Producer
    levels, points : sequence of (n, T) array, iterable of such
        Positions, and as many rates as there are, of all wanted bodies; of one point after the other.
    **more
        Of `engine_motion`.
    """
    moved = {p.name: PointMotion(*called_for(scene, each)) for p, each in zip(scene.points, points, strict=True)}
    called = called_for(scene, levels)
    return engine_motion(scene.times, scene.wanted, *called, status, producer, points=moved, **more)


UNLIKE = (np.matrix, np.ma.MaskedArray)
"""Arrays unlike others: rows of a matrix are matrices, and nothing is larger than a masked number, or is not."""


def is_plain(value: Any, kinds: str) -> bool:
    """Return whether a value is an array like others, of numbers of some kinds, as `numpy.dtype.kind` has them."""
    return isinstance(value, np.ndarray) and not isinstance(value, UNLIKE) and value.dtype.kind in kinds


def all_of(engine: Any, key: str, listed: Any, kind: type) -> None:
    """Raise EngineError unless what an engine lists is a list of such.

    Parameters
    ----------
    engine, key, listed, kind : Engine, str, list, type
        The function of the engine that lists it, and what each of it is.
    """
    if not (isinstance(listed, tuple | list) and all(isinstance(one, kind) for one in listed)):
        wanted = f"a list of {kind.__module__}.{kind.__name__}"
        raise EngineError(f"engine {engine.name!r}: {key}(): expected {wanted}, got {kept(repr(listed))}")


def terms_of(engine: Engine, *asked: Any) -> Sequence[Term]:
    """Return an engine's error terms of a scene, perhaps by one route; EngineError if they are of another form."""
    terms = engine.terms(*asked)
    all_of(engine, "terms", terms, Term)
    levels = (*QUANTITIES, *(level for level in Level if level is not Level.SOLVE))
    for term in terms:
        sizes = (term.absolute, term.relative, term.of_rates)
        if term.level not in levels or not all(isinstance(size, Real) for size in sizes):
            said = f"numbers at a level of {', '.join(levels)}, got {sizes} at {term.level!r}"
            raise EngineError(f"engine {engine.name!r}: terms(): expected of {term.name!r} {kept(said)}")
        if term.form not in FORMS:
            said = f"a form of {', '.join(FORMS[:-1])} or '', got {term.form!r}"
            raise EngineError(f"engine {engine.name!r}: terms(): expected of {term.name!r} {kept(said)}")
    return terms
