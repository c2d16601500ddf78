"""Following a mechanism along its poses: past limits of its input, on to the other branch, and up to change points.

`refkin.solve` answers at given times and stays on its branch. `follow` returns a path: the poses as they come one after
another, with a time, or a driver's value, that may go back and forth (pseudo-arclength continuation: predicted along
the tangent of the curve phi(q, t) = 0, corrected across it, in steps that adapt). Where t turns, the *turning point* is
found; where curves cross, the *bifurcation*, with the tangents of all, and the caller chooses how to go on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from refkin.differences import EPS
from refkin.errors import InvalidRequest, UnknownName, expect
from refkin.joints.annotations import LONGEST, check, is_real
from refkin.model import Mechanism, Scene
from refkin.motion import Array, Motion
from refkin.motion_laws import Polynomial
from refkin.output.tables import Tabled
from refkin.proof.formulas import agreeing
from refkin.proof.numbers.inputs import output_rounding
from refkin.proof.numbers.recentred import Recentred, recentred
from refkin.proof.path.curve import Crossing, Curve
from refkin.proof.path.tracing import SAME, Trace, Tracer
from refkin.proof.path.tracing import TraceEnd as PathEnd
from refkin.proof.pose.choices import isolate_every_choice
from refkin.solving.limits import said_if_long
from refkin.solving.solve import end_of_profile
from refkin.solving.starts import find_start
from refkin.solving.table_ends import continued, ends
from refkin.system import System, compile_system

_ITSELF = Polynomial(coefficients=(0.0, 1.0))
"""The law of a driver whose value is t."""
NOT_NEEDED = ("start", "along", "until", "choose")
"""Arguments of `follow` that may be None."""
NEARLY = math.sqrt(SAME)
"""A clearance below which a pose is beside one where paths meet, or that is alone."""


@dataclass(frozen=True)
class Tangent:
    """A direction in which poses go on: changes of q [m, rad] (n,) and of t that go together; only ratios matter."""

    q: Array
    t: float

    def __neg__(self) -> Tangent:
        return Tangent(-self.q, -self.t)

    @property
    def rate(self) -> Array:
        """dq/dt, the velocity on this branch; not finite where t turns."""
        with np.errstate(all="ignore"):
            return self.q / self.t


@dataclass(frozen=True)
class TurningPoint:
    """Where t turns: the pose q [m, rad] (n,) at its largest or smallest t, and its place in the path."""

    t: float
    q: Array
    index: int
    is_maximum: bool


@dataclass(frozen=True)
class Bifurcation:
    """Where curves of poses cross.

    Attributes
    ----------
    t, q : float and (n,) array
        The pose [m, rad].
    tangents : tuple of Tangent
        One of each curve: two, or four where two linkages are at their change points at once, and so on. Where they are
        not decided to second order there is no bifurcation: the path stops beside it, and says so.
    incoming : Tangent or None
        That in which the path arrived.
    index : int
        Its place in the path.
    """

    t: float
    q: Array
    tangents: tuple[Tangent, ...]
    incoming: Tangent | None
    index: int


Choice = Callable[[Bifurcation], Tangent | None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Path(Tabled):
    """Poses one after another.

    Attributes
    ----------
    t : (K,) array
        Times [s], or the values of the driver that is the parameter [rad or m].
    q : (n, K) array
        Coordinates of all bodies [m, rad].
    tangents : tuple of Tangent
        The direction of the path at each pose; where curves cross that in which it arrived.
    residual : (K,) array
        Largest scaled |phi|.
    radius : (K,) array
        Proved bound of the error of a pose at its t, largest scaled coordinate; NaN where no pose is alone at its t.
    end : PathEnd
        Why the path ends.
    parameter : str
        What t is, with its unit.
    """

    t: Array
    q: Array
    tangents: tuple[Tangent, ...]
    residual: Array
    radius: Array
    bodies: tuple[str, ...]
    turning_points: tuple[TurningPoint, ...]
    bifurcations: tuple[Bifurcation, ...]
    end: PathEnd
    message: str
    parameter: str = "t [s]"
    points: ClassVar[Mapping[str, Any]] = {}
    contacts: ClassVar[Mapping[str, Any]] = {}

    @property
    def levels(self) -> tuple[Array, None, None]:
        return self.q, None, None

    @property
    def first_columns(self) -> Mapping[str, Any]:
        return {"pose": np.arange(self.t.size), self.parameter: self.t, "proved radius": self.radius}

    @property
    def events(self) -> tuple[TurningPoint | Bifurcation, ...]:
        """The turning points and bifurcations in the order of the path."""
        return tuple(sorted((*self.turning_points, *self.bifurcations), key=lambda event: event.index))

    kind: ClassVar[Any] = Motion.kind
    __getitem__: ClassVar[Any] = Motion.__getitem__


def straight_on(bifurcation: Bifurcation) -> Tangent | None:
    """Choose the tangent that is nearest to the one the path arrived in."""
    incoming = bifurcation.incoming
    if incoming is None or not bifurcation.tangents:
        return None
    along = [_cosine(tangent, incoming) for tangent in bifurcation.tangents]
    best = int(np.argmax(np.abs(along)))
    return bifurcation.tangents[best] if along[best] > 0 else -bifurcation.tangents[best]


def follow(
    given: Scene | System,
    start: tuple[Any, float] | Bifurcation | None = None,
    *,
    along: Tangent | None = None,
    direction: int = 1,
    until: tuple[float, float] | None = None,
    choose: Choice | None = None,
    max_step: float = 0.1,
    most_points: int = 2000,
) -> Path:
    """Follow the poses of a mechanism from one of them.

    Parameters
    ----------
    given : Scene or System
        A scene's first pose is where its estimates lead to at its first time. See `driven_by` for a path whose t is the
        value of a driver instead of the time.
    start : (q, t) or Bifurcation, optional
        Another pose: coordinates (n,) [m, rad] near it, and its t; a system needs one.
    along : Tangent, optional
        The direction to set out in, at a bifurcation one of its tangents.
    direction : 1 or -1
        Without `along`: whether t grows or falls at first.
    until : (low, high), optional
        The path ends where t leaves this interval: by default, without a `start`, between the first and the last time
        of a scene that has several, else nowhere.
    choose : callable, optional
        What returns one of a bifurcation's tangents, or its negative, or None to end there; by default paths end there.
    max_step : float
        Longest step, in sizes and radians.
    most_points : int
        Number of points after which the path ends.

    Raises
    ------
    InvalidRequest
        If an argument is of another form, a system is given without a pose to start from, drivers have rates beyond
        float64, or a path begins outside of `until`.
    """
    expect("given", given, Scene, System)
    system = compile_system(continued(given.mechanism), unit=given.mechanism.unit())
    how = {"choose": choose, "max_step": max_step, "most_points": most_points}
    _check(system.n, start=start, along=along, until=until, direction=direction, **how)
    message, limits = "", (-math.inf, math.inf) if until is None else (float(until[0]), float(until[1]))
    if isinstance(start, Bifurcation):
        q, t = system.to_unit(start.q), start.t
    elif start is not None:
        q, t = system.to_unit(np.asarray(start[0], float)), float(start[1])
    elif isinstance(given, Scene):
        first = find_start(system, given)
        q, t, message = first.q, given.times[0], first.message
        if until is None and len(given.times) > 1:
            limits = given.times[0], given.times[-1]
    else:
        raise InvalidRequest("start", "(q, t), as a system alone does not say where to start", "None")
    if not limits[0] <= t <= limits[1]:
        raise InvalidRequest("until", f"two values that t = {t:.17g}, where the path begins, is between", str(limits))
    frames = recentred(agreeing(system, [t]))
    if q is None:
        return _Continuation(frames, None, limits).path(Trace(), message)
    q = frames.inward(q)
    known = [*((low, high) for _, low, high in ends(system.mechanism.constraints)), limits]
    within = max(low for low, _ in known), min(high for _, high in known)
    curve = Curve.through(frames.inner, q, np.linspace(*within, 9) if np.isfinite(within).all() else [t])
    continuation, unit = _Continuation(frames, curve, within), curve.scale[-1]
    if not unit * LONGEST > 1.0:  # a turn of an angle is no number of such units
        slower = f"drivers whose rates are at most {LONGEST:g}, between the first time and the last"
        raise InvalidRequest("law", slower, "more")
    endless = bool(np.isinf(limits).all()) and _is_driven_angle(system.mechanism)
    tracer = Tracer(curve, (within[0] / unit, within[1] / unit), max_step, most_points, endless)

    def chooser(number: int, branch_point: Crossing, incoming: Any) -> Any:
        tangent = choose(continuation.bifurcation(number, branch_point, incoming)) if choose else None
        return None if tangent is None else continuation.inward(tangent, branch_point.x[:-1])

    with said_if_long("following a path"):
        vector = None if along is None else continuation.inward(along, q)
        trace = tracer.run(curve.point(q, t), vector, direction, chooser)
        return continuation.path(trace, message)


def driven_by(scene: Scene, driver: str) -> Scene:
    """Return a scene whose time is the value of a driver [rad or m]; all other laws stay as they are at its start.

    Its one time is the driver's value at the scene's first time.

    Raises
    ------
    UnknownName
        If the scene has no driver of that name.
    InvalidRequest
        If a joint of one's own has laws that are no fields of it: they cannot be held.
    """
    expect("scene", scene, Scene)
    expect("driver", driver, str)
    m, t = scene.mechanism, scene.times[0]
    if driver not in (d.name for d in m.drivers):
        raise UnknownName("driver", driver, tuple(d.name for d in m.drivers))
    held = {d.name: Polynomial(coefficients=(float(d.laws[0](t)),)) for d in m.drivers}
    laws = {**held, driver: _ITSELF}
    drivers = tuple(replace(d, law=laws[d.name], rate_law=None, initial=0.0) for d in m.drivers)
    joints = tuple(_still(joint, t) if joint.laws else joint for joint in m.joints)
    return replace(scene, mechanism=replace(m, joints=joints, drivers=drivers), times=held[driver].coefficients)


def _still(joint: Any, t: float) -> Any:
    """Return a joint whose laws, whichever its fields are, stay as they are at a time t [s]."""
    held = [(law, Polynomial(coefficients=(float(law(t)),))) for law in joint.laws]

    def at_t(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(at_t, value))
        return next((still for law, still in held if law is value), value)

    still = replace(joint, **{field.name: at_t(getattr(joint, field.name)) for field in fields(joint) if field.init})
    if [*still.laws] != [law for _, law in held]:
        raise InvalidRequest(f"joint {joint.name!r}", "laws that are fields of it", repr(joint.laws))
    return still


class _Continuation:
    """Points of the curve in moved frames and units, as poses [m, rad] of the mechanism, and back; t is in `limits`."""

    def __init__(self, frames: Recentred, curve: Any, limits: tuple[float, float]) -> None:
        self.frames, self.curve, self.limits = frames, curve, limits

    def pose(self, x: Any) -> tuple[Any, float]:
        """Return q [m, rad] and t of a point."""
        q, t = self.curve.pose(x)
        return self.frames.system.to_physical(self.frames.outward(q)), t

    def tangent(self, x: Any, direction: Any) -> Tangent:
        """Return a direction at a point as a tangent."""
        step = direction * self.curve.scale
        rate = self.frames.outward_rate(self.curve.pose(x)[0], step[:-1])
        return Tangent(self.frames.system.to_physical(rate, order=1), float(step[-1]))

    def inward(self, tangent: Tangent, q: Any) -> Any:
        """Return a tangent as a direction (n + 1,) at inner coordinates q."""
        rate = self.frames.inward_rate(q, self.frames.system.to_unit(tangent.q, order=1))
        return np.append(rate, tangent.t) / self.curve.scale

    def bifurcation(self, number: int, branch_point: Crossing, incoming: Any) -> Bifurcation:
        """Return a crossing of the trace as a bifurcation of the path."""
        q, t = self.pose(branch_point.x)
        tangents = tuple(self.tangent(branch_point.x, v) for v in branch_point.tangents)
        return Bifurcation(t, q, tangents, None if incoming is None else self.tangent(branch_point.x, incoming), number)

    def path(self, trace: Trace, message: str) -> Path:
        """Return a trace as a path, each of its poses with its certificate."""
        system = self.frames.system
        poses = [self.pose(x) for x in trace.points]
        q = np.array([pose[0] for pose in poses]).reshape(len(poses), system.n).T
        t = np.array([pose[1] for pose in poses])
        ends = [limit for limit in self.limits if math.isfinite(limit)]
        for limit in ends:  # in the units of the curve it may be a rounding off
            t[np.abs(t - limit) <= EPS * max(map(abs, ends))] = limit
        residual, radius = _evidence(system, q, t)
        driven = (d for d in system.mechanism.drivers if d.law is _ITSELF)
        own = (f"{d.name} [{'rad' if d.law_is_angle else 'm'}]" for d in driven)
        singular = bool(poses) and self.curve.clearance(trace.points[-1]) < NEARLY
        why = _why(system, trace.end, q[:, -1], t[-1], singular) if poses else str(trace.end)
        return Path(
            t=t,
            q=q[: system.of_bodies],
            tangents=tuple(map(self.tangent, trace.points, self.directions(trace))),
            residual=residual,
            radius=radius,
            bodies=tuple(body.name for body in system.mechanism.bodies),
            turning_points=tuple(TurningPoint(float(t[k]), q[:, k], k, up) for k, up in trace.turning),
            bifurcations=tuple(self.bifurcation(*branch_point) for branch_point in trace.crossings),
            end=trace.end,
            message="; ".join(filter(None, (message, why))),
            parameter=next(own, "t [s]"),
        )

    def directions(self, trace: Trace) -> list[Any]:
        """Return the unit tangents at the points of a trace, in its direction; NaN for a point alone at a crossing."""
        points, incoming = trace.points, {number: tangent for number, _, tangent in trace.crossings}
        vectors = []
        for k, x in enumerate(points):
            near = points[max(0, k - 1)], points[min(k + 1, len(points) - 1)]
            if k not in incoming:
                vectors.append(self.curve.tangent(x, near[1] - near[0]) if len(points) > 1 else self.curve.tangent(x))
            else:
                vectors.append(np.full_like(x, np.nan) if incoming[k] is None else incoming[k])
        return vectors


def _why(system: System, end: PathEnd, q: Any, t: float, singular: bool) -> str:
    """Return why a path ends with a pose [m, rad], in words; `singular`: whether it is beside one, t among the rest."""
    tables = [name for name, *known in ends(system.mechanism.constraints) if t in known]
    if end is PathEnd.RANGE and tables:
        return f"{end}: the table of {tables[0]} ends"
    if end is not PathEnd.STOPPED:
        return end
    if cam := end_of_profile(system, system.to_unit(q)):
        return f"the contact of {cam} leaves its profile"
    return f"{end}: how paths go on beside a singular pose is not decided" if singular else end


def _pose(start: Any, n: int) -> bool:
    pair = isinstance(start, tuple | list) and len(start) == 2
    return pair and is_real(start[0], n) and is_real(start[1])


def _check(n: int, **given: Any) -> None:
    """Raise InvalidRequest for the first argument of `follow` that is of another form, n being its coordinates."""
    forms: dict[str, tuple[str, Callable[[Any], bool]]] = {
        "start": (
            f"(q, t) with {n} coordinates, or a Bifurcation",
            lambda x: isinstance(x, Bifurcation) or _pose(x, n),
        ),
        "along": (
            f"a Tangent of {n} coordinates",
            lambda x: isinstance(x, Tangent) and is_real(x.q, n) and is_real(x.t),
        ),
        "until": ("two numbers", lambda x: is_real(x, 2)),
        "direction": ("1 or -1", lambda x: is_real(x) and x in (1, -1)),
        "choose": ("what takes a bifurcation and returns a tangent", callable),
        "max_step": ("a finite number above 0", lambda x: is_real(x) and 0.0 < x < math.inf),
        "most_points": ("a whole number above 0", lambda x: isinstance(x, int | np.integer) and bool(x > 0)),
    }
    for name, (expected, well) in forms.items():
        check(name, expected, given[name], (given[name] is None and name in NOT_NEEDED) or well(given[name]))


def _is_driven_angle(mechanism: Mechanism) -> bool:
    """Whether t is the angle of a driver, and all other drivers are at rest."""
    moving = [d for d in mechanism.drivers if not (isinstance(d.law, Polynomial) and not any(d.law.coefficients[1:]))]
    return len(moving) == 1 and moving[0].law_is_angle and moving[0].laws == (_ITSELF,)


def _evidence(system: System, q: Any, t: Any) -> tuple[Any, Any]:
    """Return the residuals of poses [m, rad] (n, K), and proved bounds of their errors, (K,) each."""
    if not t.size:
        return np.zeros(0), np.zeros(0)
    scaled = system.to_unit(q)
    residual = np.array([np.max(np.abs(system.phi(x, float(at)))) for x, at in zip(scaled.T, t, strict=True)])
    proof = isolate_every_choice(system, scaled, t)
    contradicted = np.max(proof.contradiction, axis=0) > 1.0  # rows that are redundant say that there is no such pose
    return residual, np.where(contradicted, np.nan, proof.position + np.max(output_rounding(system, scaled), axis=0))


def _cosine(a: Tangent, b: Tangent) -> float:
    """Return the cosine of the angle between tangents, in the coordinates alone."""
    return float(a.q @ b.q) / max(float(np.linalg.norm(a.q) * np.linalg.norm(b.q)), 1e-300)
