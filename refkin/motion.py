"""What is answered: a `Motion`. Every producer, refkin and engines alike, returns it; nothing else is compared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refkin.errors import UnknownName

Array = NDArray[np.float64]


class Status(StrEnum):
    """What is known of one pose; defined in the scene file format."""

    OK = "ok"
    SINGULAR = "singular"
    UNASSEMBLABLE = "unassemblable"
    NOT_CONVERGED = "not_converged"
    BRANCH_LOST = "branch_lost"


class Seeding(StrEnum):
    """How much of our answer a producer was given."""

    NONE = "none"
    INITIAL_GUESS = "initial_guess"
    CONFIGURATION = "configuration"


@dataclass(frozen=True, kw_only=True)
class Route:
    """Who did what on the way to an answer, and who supplied the drift term of the acceleration; in every table."""

    name: str
    residual_by: str
    jacobian_by: str
    newton_by: str
    linear_solve_by: str
    drift_by: str
    seeding: Seeding


@dataclass(frozen=True, kw_only=True)
class Producer:
    """Who made a motion: name, version, and by which route."""

    name: str
    version: str
    route: Route


@dataclass(frozen=True, kw_only=True)
class CertifiedRadius:
    """Proved bounds of the error of the scaled coordinates, largest component, per time; NaN: no proof."""

    position: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True, kw_only=True)
class PointMotion:
    """Position [m], velocity [m/s] and acceleration [m/s^2] of a point, each (2, T); None if not called for."""

    r: Array
    v: Array | None = None
    a: Array | None = None


@dataclass(frozen=True, kw_only=True)
class ContactMotion:
    """The contact parameter of a cam [rad] and its rates, each (T,); None if not called for."""

    s: Array
    sd: Array | None = None
    sdd: Array | None = None


@dataclass(frozen=True)
class BodyMotion:
    """One body's rows of a motion, by name: x, y, phi and their rates xd ... phidd, each (T,)."""

    q: Array
    qd: Array | None
    qdd: Array | None

    def __getattr__(self, name: str) -> Array:
        level = {"": self.q, "d": self.qd, "dd": self.qdd}
        for row, coordinate in enumerate(("x", "y", "phi")):
            suffix = name.removeprefix(coordinate)
            if name.startswith(coordinate) and suffix in level and level[suffix] is not None:
                return level[suffix][row]  # type: ignore[index, no-any-return]
        raise AttributeError(f"{name!r}: not a coordinate, or not called for by the scene")


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Position, velocity and acceleration of the wanted bodies over the times of a scene.

    Attributes
    ----------
    t : (T,) array
        Times [s].
    bodies : tuple of str
        The bodies whose coordinates (x [m], y [m], phi [rad], three rows each) `q` holds, in this order.
    q, qd, qdd : (n, T) array
        Coordinates and rates; `qd`, `qdd` are None if not called for. NaN means "no answer" and never has status ok.
    residual, sigma_min, condition : (T,) array
        Largest component of the scaled residual; smallest singular value and condition number of the scaled phi_q, NaN
        if not called for.
    points, contacts : mapping
        By their names the points that the scene wants, and by those of joints where cams are touched.
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
        if body not in self.bodies:
            raise UnknownName("body", body, self.bodies)
        k = 3 * self.bodies.index(body)
        return BodyMotion(*(None if level is None else level[k : k + 3] for level in self.levels))  # type: ignore[arg-type]

    @property
    def levels(self) -> tuple[Array, Array | None, Array | None]:
        """Position, velocity, acceleration."""
        return self.q, self.qd, self.qdd

    @property
    def verdict(self) -> Status:
        """The first status that is not ok, or ok."""
        return next((s for s in self.status if s is not Status.OK), Status.OK)


def nowhere(times: int) -> Array:
    """Return (T,) NaN: a bound or a number that nobody delivered."""
    return np.full(times, np.nan)


def engine_motion(
    t: Any, bodies: tuple[str, ...], q: Any, qd: Any, qdd: Any, status: Any, producer: Producer, **more: Any
) -> Motion:
    """Return a motion without evidence of its own, as engines deliver it.

    Parameters
    ----------
    t, bodies, q, qd, qdd, status, producer
        As in `Motion`.
    **more
        Its other attributes, as far as there are any.
    """
    n = len(status)
    blank = {"residual": nowhere(n), "sigma_min": nowhere(n), "condition": nowhere(n), "certified_radius": no_radius(n)}
    known = {"t": np.asarray(t, float), "bodies": bodies, "q": q, "qd": qd, "qdd": qdd, "status": status}
    return Motion(**{**blank, **known, "producer": producer, **more})


def no_radius(times: int) -> CertifiedRadius:
    """Return bounds of which none is proved."""
    return CertifiedRadius(position=nowhere(times), velocity=nowhere(times), acceleration=nowhere(times))
