"""What is answered: a `Motion`. Every producer, refkin and engines alike, returns it; nothing else is compared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from refkin.errors import UnknownName
from refkin.joints import PLANE, SPACE, Kind
from refkin.model import Member

Array = NDArray[np.float64]
__version__ = "0.1.0"

Quantity = Literal["position", "velocity", "acceleration"]
QUANTITIES: tuple[str, ...] = get_args(Quantity)
"""What is computed of a motion, by order."""
SINGULAR = 2.0**-23
"""A pose is singular where sigma_min of scaled phi_q is no larger: rates err by eps over its square, here by 1/64."""


class Status(Member):
    """What is known of one pose; docs/howto/scene.md has them in a table."""

    OK = "ok"
    """A proof isolates the pose; without certificates: the residual is round-off, sigma_min well above zero."""
    SINGULAR = "singular"
    """The residual is round-off, but no test isolates the pose."""
    UNASSEMBLABLE = "unassemblable"
    """Proved: there is no pose."""
    LOCKED = "locked"
    """The pose is isolated, but redundant rows contradict each other in a rate, so that no motion exists (Haug)."""
    NOT_CONVERGED = "not_converged"
    """No answer, and no proof."""
    BRANCH_LOST = "branch_lost"
    """Not followed so far: the motion met a singular pose before, or one where redundant rows contradict each other."""


class Seeding(Member):
    """How much of our answer a producer was given."""

    NONE = "none"
    """Nothing of it."""
    INITIAL_GUESS = "initial_guess"
    """The estimates of the scene."""
    CONFIGURATION = "configuration"
    """The pose itself: rates alone are its own."""


@dataclass(frozen=True, kw_only=True)
class Route:
    """A method, as tables say it: who computes phi, phi_q, Newton's steps, linear systems and gamma (the drift)."""

    name: str
    residual_by: str = "none"
    jacobian_by: str = "none"
    newton_by: str = "none"
    linear_solve_by: str = "none"
    drift_by: str = "none"
    seeding: Seeding = Seeding.NONE


@dataclass(frozen=True, kw_only=True)
class Producer:
    """Who made a motion: name, version, and by which method."""

    name: str
    version: str
    route: Route

    @classmethod
    def of_refkin(cls, name: str, route: Route) -> Producer:
        """Return a producer of this package, whose version it has."""
        return cls(name=name, version=__version__, route=route)


@dataclass(frozen=True, kw_only=True)
class CertifiedRadius:
    """Proved bounds of the error of the scaled coordinates, largest component, per time; NaN: no proof."""

    position: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True)
class PointMotion:
    """Position [m], velocity [m/s] and acceleration [m/s^2] of a point, each (2, T) or (3, T); None: not called for."""

    r: Array
    v: Array | None = None
    a: Array | None = None


def point_motion(u: Any, q: Any, qd: Any = None, qdd: Any = None) -> PointMotion:
    """Return the motion of a point of one body: r = R + A u, v = R' + omega x A u, and a = v'.

    Parameters
    ----------
    u : tuple of float
        The point in the body's own frame [m].
    q, qd, qdd : (3, T) or (7, T) array
        The body's coordinates and their rates; qdd only with qd. What is None has no part in it.
    """
    levels = kind_of(len(q)).values(*q).point_motion(u, qd, None if qd is None else qdd)
    return PointMotion(*(None if x is None else np.array(x) for x in levels))  # type: ignore[arg-type]


def kind_of(width: int) -> Kind:
    """Return whether a body of so many coordinates is of the plane or of space."""
    return SPACE if width == SPACE.width else PLANE


@dataclass(frozen=True)
class ContactMotion:
    """A joint's own coordinate [rad] and rates, (T,) or None: of a cam its contact, of counted turns half the angle."""

    s: Array
    sd: Array | None = None
    sdd: Array | None = None


@dataclass(frozen=True, eq=False, repr=False)
class BodyMotion:
    """One body's rows of a motion, by name: x, y, phi and their rates xd ... phidd, each (T,).

    In space x, y, z, e0 ... e3 and their rates; and in the ground frame `omega` [rad/s] and `alpha` [rad/s^2], (3, T),
    and `rotation`, (3, 3, T), the matrix A of r + A u.
    """

    q: Array
    qd: Array | None
    qdd: Array | None

    def __post_init__(self) -> None:
        for rate, rows in (("", self.q), ("d", self.qd), ("dd", self.qdd)):
            names = (f"{coordinate}{rate}" for coordinate in kind_of(len(self.q)).coordinates)
            vars(self).update({} if rows is None else zip(names, rows, strict=True))

    def __getattr__(self, name: str) -> Array:
        if kind_of(len(self.q)) is SPACE and name in ("omega", "alpha", "rotation"):
            body, rates = SPACE.values(*self.q), self.qd if name == "omega" else self.qdd
            turn: Array | None = body.rotation() if name == "rotation" else body.omega(rates)
            if turn is not None:
                return turn
        raise AttributeError(f"{name!r}: not a coordinate, or not called for by the scene")

    def __repr__(self) -> str:
        return f"<BodyMotion: {', '.join(list(vars(self))[3:])} at {self.q.shape[1]} times>"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Motion:
    """Position, velocity and acceleration of the wanted bodies over the times of a scene.

    `q`, `qd`, `qdd` (n, T) hold three rows, x [m], y [m], phi [rad] and their rates, for each of `bodies` at times `t`
    (T,) [s]; in space seven, x, y, z, e0, e1, e2, e3. None: not called for; NaN: no answer, which never has status ok.
    `residual`, `sigma_min`, `condition` (T,) are the largest component of phi, the smallest singular value and the
    condition number of phi_q, of the scaled system. `points` and `contacts` say by name how the wanted points move, and
    the own coordinates of joints.
    """

    t: Array
    bodies: tuple[str, ...]
    q: Array
    qd: Array | None
    qdd: Array | None
    status: tuple[Status, ...]
    residual: Array
    producer: Producer
    sigma_min: Array
    condition: Array
    certified_radius: CertifiedRadius
    points: Mapping[str, PointMotion] = field(default_factory=dict)
    contacts: Mapping[str, ContactMotion] = field(default_factory=dict)
    message: str = ""

    def __getitem__(self, body: str) -> BodyMotion:
        """Return the motion of one body; raise UnknownName if it is not among those that were wanted."""
        if not isinstance(body, str) or body not in self.bodies:
            raise UnknownName("body", body, self.bodies)
        k = (width := self.kind.width) * self.bodies.index(body)
        return BodyMotion(*(None if level is None else level[k : k + width] for level in self.levels))  # type: ignore[arg-type]

    def __repr__(self) -> str:
        levels = [name for name, level in zip(("q", "qd", "qdd"), self.levels, strict=True) if level is not None]
        return (
            f"<Motion by {self.producer.name} {self.producer.version}, {self.producer.route.name}\n"
            f"times:   {len(self.t)}, {', '.join(f'{t:g}' for t in self.t[[0, -1]])} s\n"
            f"bodies:  {', '.join(self.bodies)}\nholds:   {', '.join([*levels, *self.points])}\n"
            f"verdict: {self.verdict}, {self.status.count(Status.OK)} times ok{self.message and f'; {self.message}'}>"
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Motion) and _same(asdict(self), asdict(other))

    @property
    def kind(self) -> Kind:
        """Whether the bodies are of the plane or of space."""
        return kind_of(len(self.q) // len(self.bodies))

    @property
    def levels(self) -> tuple[Array, Array | None, Array | None]:
        return self.q, self.qd, self.qdd

    @property
    def verdict(self) -> Status:
        """The first status that is not ok, or ok."""
        return next((s for s in self.status if s is not Status.OK), Status.OK)


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    return np.array_equal(a, b, equal_nan=True) if np.ndarray in (type(a), type(b)) else bool(a == b)


def nowhere(times: int) -> Array:
    """Return (T,) NaN: numbers that nobody delivered."""
    return np.full(times, np.nan)


def engine_motion(
    t: Any, bodies: tuple[str, ...], q: Any, qd: Any, qdd: Any, status: Any, producer: Producer, **more: Any
) -> Motion:
    """Return a motion without evidence of its own, as engines deliver it.

    Parameters
    ----------
    t, bodies, q, qd, qdd, status, producer, **more
        As in `Motion`; evidence that is not given is NaN.
    """
    rest = {**dict.fromkeys(("residual", "sigma_min", "condition"), nowhere(len(status))), **more}
    rest.setdefault("certified_radius", no_radius(len(status)))
    return Motion(t=np.asarray(t, float), bodies=bodies, q=q, qd=qd, qdd=qdd, status=status, producer=producer, **rest)


def no_radius(times: int) -> CertifiedRadius:
    """Return bounds of which none is proved."""
    return CertifiedRadius(position=nowhere(times), velocity=nowhere(times), acceleration=nowhere(times))
