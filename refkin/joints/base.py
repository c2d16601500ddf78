"""What every joint and driver offers: its data, named as in a scene file, and its formulas in scalar arithmetic.

A formula takes ``g``, the numbers of the geometry (`constants`), ``f``, the values and derivatives of the laws
(`inputs`: ``f[0][k]`` is the k-th derivative of the first law) and one `BodyValues` per body. It returns rows:

=========== ============================================================== =======================================
`residual`  Phi(q, t)                                                      `rows` scalars
`jacobian`  Phi_q: one block per body                                      per body `rows` triples (d/dx, d/dy, d/dphi)
`nu`        nu = -Phi_t                                                    `rows` scalars
`gamma`     gamma = -(Phi_q qd)_q qd - 2 Phi_qt qd - Phi_tt                `rows` scalars
=========== ============================================================== =======================================

Only `+ - *`: no array, no branch on a value, no root. So the same text runs on floats, complex numbers, NumPy rows,
balls and symbols, and what is read is what is run, batched, compiled and proved. Equation numbers as (K4) and (J7) are
those of the book's theory, docs/theory.md.

A constraint may bring coordinates of its own (`parameters`), such as a cam's contact parameter: its formulas take a
`ParameterValue` after the bodies, `jacobian` returns a block of 1-tuples for it, and the last of ``f`` is what
`profile_values` returns: a function of the parameter, with its derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import zip_longest
from typing import Any

from refkin.errors import Fault
from refkin.joints.elements import BODIES, GROUND, Element
from refkin.motion_laws import STRICT, Integral, Law
from refkin.vec import BodyValues, Scalar, Vec

Triple = tuple[Scalar, Scalar, Scalar]
Rows = tuple[Scalar, ...]
Blocks = tuple[tuple[tuple[Scalar, ...], ...], ...]


@dataclass(frozen=True)
class Unit:
    """How lengths become the dimensionless numbers of a solve: (u - origin) / size for the ground, u / size on a body.

    Attributes
    ----------
    size : float
        Length of one unit [m]; a power of two, so that scaling rounds nothing.
    origin : tuple of float
        The ground point that becomes the origin [m], so that a mechanism far from its origin loses no digits; it has
        two coordinates or three.
    """

    size: float = 1.0
    origin: Any = (0.0, 0.0)

    def point(self, body: str, u: Sequence[float]) -> tuple[float, ...]:
        """Return the scaled coordinates of a point of a body, in the body's own frame."""
        away = self.origin if body == GROUND else (0.0,) * len(u)
        return tuple((x - o) / self.size for x, o in zip_longest(u, away, fillvalue=0.0))


SI = Unit()
"""Metres and the scene's own origin."""


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What depends on whether bodies are of the plane or of space.

    Attributes
    ----------
    coordinates : tuple of str
        The names of a body's coordinates; those of its origin come first.
    freedoms, dimension : int
        How many ways a free body has to move, and how many coordinates a point.
    turns : tuple of float
        For each coordinate the turn [rad] that goes with a change of 1: 0 for lengths, 1 for an angle.
    still : tuple of float
        The coordinates of the ground.
    values : class
        The values of one body, made of its coordinates; `point_motion` says how a point of it moves.
    own_rows : callable
        Yields the constraints that bodies bring of their own, beyond the given ones.
    """

    name: str
    coordinates: tuple[str, ...]
    freedoms: int
    dimension: int
    turns: tuple[float, ...]
    still: tuple[float, ...]
    values: Any
    own_rows: Callable[[Any, Any], Iterable[Any]] = field(default=lambda bodies, constraints: (), repr=False)

    @property
    def width(self) -> int:
        """The number of coordinates of a body."""
        return len(self.coordinates)


PLANE = Kind(
    name="planar",
    coordinates=("x", "y", "phi"),
    freedoms=3,
    dimension=2,
    turns=(0.0, 0.0, 1.0),
    still=(0.0, 0.0, 0.0),
    values=BodyValues,
)


@dataclass(frozen=True, kw_only=True)
class Constraint:
    """A joint or driver between `body_i` and `body_j`.

    Subclasses are dataclasses whose fields are the keys of a scene file; they state the four formulas, `constants`,
    where a law drives them `laws` and how a law's value is scaled, and `elements`, which say the same without formulas.
    """

    name: str
    type: str = field(init=False)
    kind = PLANE
    law_is_angle = False
    """Whether a law gives angles [rad], or lengths [m], which the unit scales."""
    __pydantic_config__ = STRICT

    @property  # so that a class has none: Hypothesis prints those of drawn drivers as well
    def _repr_pretty_(self) -> Any:
        return lambda printer, cycle: printer.text(repr(self))  # without class variables, which nobody can paste

    @property
    def rows(self) -> int:
        """The number of equations."""
        raise NotImplementedError

    @property
    def independent(self) -> int:
        """The number of equations less those that repeat others of the same constraint."""
        return self.rows

    @property
    def parameters(self) -> int:
        """The number of coordinates that the constraint itself brings, all angles."""
        return 0

    @property
    def shares(self) -> tuple[str, ...]:
        """The joints whose own coordinates enter this constraint too."""
        return ()

    def among(self, joints: Sequence[Constraint]) -> Constraint:
        """Return the constraint with the joint that it names, if any, found among those of the mechanism."""
        return self

    @property
    def passive(self) -> str:
        """The passive degree of freedom, in words, if to hold it is all that the constraint does; "" otherwise."""
        return ""

    def gauge(self, g: Any, q: Any) -> tuple[Any, ...]:
        """Return the numbers that hold a passive freedom as it is at a pose; `q` starts with its body's coordinates."""
        return ()

    @property
    def bodies(self) -> tuple[str, ...]:
        """The names of the bodies i and j, and of a carrier: the formulas take one after the other."""
        return tuple(getattr(self, key) for key in BODIES if hasattr(self, key))

    @property
    def laws(self) -> tuple[Law, ...]:
        """The functions of time that enter the constraint."""
        return ()

    @property
    def law_keys(self) -> tuple[str, ...]:
        """Where each of the laws stands in a scene file."""
        return ()

    def points(self) -> Iterator[tuple[str, Any]]:
        """Yield (body, point in its frame) for each joint point."""
        for body, point in (("body_i", "point_i"), ("body_j", "point_j")):
            if (at := getattr(self, point, None)) is not None:
                yield getattr(self, body), at

    def elements(self) -> Iterator[Element]:
        """Yield what the constraint consists of, in the order of its rows; nothing if no known element says it."""
        yield from ()

    @cached_property
    def placed_elements(self) -> tuple[Element, ...]:
        """The elements, each with the joint's name and with the first of the joint's rows that are its own."""
        own = list(self.elements())
        return tuple(replace(e, name=self.name, row=sum(x.rows for x in own[:k])) for k, e in enumerate(own))

    def reach(self) -> float:
        """Return a length [m] that the constraint itself brings, such as that of a massless link."""
        return 0.0

    def constants(self, unit: Unit) -> tuple[float, ...]:
        """Return the scaled geometry, flat, in the order in which the formulas unpack it."""
        return tuple(c for body, point in self.points() for c in unit.point(body, point))

    def inputs(self, t: Any, unit: Unit, order: int) -> tuple[tuple[Scalar, ...], ...]:
        """Return for each law its scaled value and derivatives up to `order` at t."""
        (shifts, factor), orders = self.law_scale(unit), range(order + 1)
        laws = zip(self.laws, shifts, strict=True)
        return tuple([tuple([(law(t, k) - (0.0 if k else shift)) / factor for k in orders]) for law, shift in laws])

    def profile_values(self, s: Scalar, unit: Unit, order: int) -> tuple[Scalar, ...]:
        """Return the scaled value of the profile at the parameter s, and its derivatives up to `order`."""
        raise NotImplementedError

    def law_scale(self, unit: Unit) -> tuple[tuple[float, ...], float]:
        """Return per law the shift, and the factor: a scaled law is (f - shift) / factor."""
        return (0.0,) * len(self.laws), 1.0 if self.law_is_angle else unit.size

    def faults(self, path: str) -> Iterator[Fault]:
        """Yield what is wrong with the constraint's own numbers."""
        for key, law in zip(self.law_keys, self.laws, strict=True):
            known = law.rate if isinstance(law, Integral) else law
            unknown = isinstance(known, type) or not hasattr(known, "faults")
            yield from [Fault(f"{path}.{key}", known, "a law")] if unknown else law.faults(f"{path}.{key}")

    @staticmethod
    def residual(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        """Return Phi."""
        raise NotImplementedError

    @staticmethod
    def jacobian(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Blocks:
        """Return the blocks of Phi_q for body i and body j."""
        raise NotImplementedError

    def nu(self, g: Any, f: Any, *at: Any) -> Rows:
        """Return -Phi_t: zero where no law moves anything."""
        return (0,) * self.rows

    @staticmethod
    def gamma(g: Any, f: Any, i: BodyValues, j: BodyValues) -> Rows:
        """Return gamma, the right side of the acceleration equation, as many scalars as Phi has."""
        raise NotImplementedError


def turned_points(g: Any, i: BodyValues, j: BodyValues) -> tuple[Vec, Vec]:
    """Return a_i = A_i point_i and a_j = A_j point_j (J1); the points stand first in g.

    Parameters
    ----------
    g : sequence of float
        A joint's scaled geometry: `point_i`, `point_j`, and what its type has besides.
    i, j : BodyValues
        The two bodies' poses, scaled.
    """
    return i.turned(Vec(g[0], g[1])), j.turned(Vec(g[2], g[3]))


def arms(g: Any, i: BodyValues, j: BodyValues) -> tuple[Vec, Vec, Vec]:
    """Return a_i, a_j and d = r_j + a_j - r_i - a_i (J1).

    Parameters
    ----------
    g, i, j
        As for `turned_points`.
    """
    a_i, a_j = turned_points(g, i, j)
    return a_i, a_j, j.r + a_j - i.r - a_i


def drift(a_i: Vec, a_j: Vec, i: BodyValues, j: BodyValues) -> Vec:
    """Return the part of d'' that holds no acceleration: omega_i^2 a_i - omega_j^2 a_j (J2).

    Parameters
    ----------
    a_i, a_j : Vec
        Vectors that turn with their bodies, scaled.
    i, j : BodyValues
        The two bodies, with the rates that they have.
    """
    bias: Vec = a_i * (i.omega * i.omega) - a_j * (j.omega * j.omega)
    return bias


def gap_rate(a_i: Vec, a_j: Vec, i: BodyValues, j: BodyValues) -> Vec:
    """Return d' = v_j + omega_j a_j.perp() - v_i - omega_i a_i.perp().

    Parameters
    ----------
    a_i, a_j, i, j
        As for `drift`.
    """
    rate: Vec = j.v + a_j.perp() * j.omega - i.v - a_i.perp() * i.omega
    return rate


def offset(f: Any, order: int) -> Vec:
    """Return the vector of two laws, or its derivative of the given order; zero where there are no laws."""
    return Vec(f[0][order], f[1][order]) if f else Vec(0, 0)


def along(n: Vec, a_i: Vec, a_j: Vec) -> tuple[Triple, Triple]:
    """Return the gradient of n . d with n held fixed, for body i and for body j.

    Parameters
    ----------
    n : Vec
        The direction.
    a_i, a_j : Vec
        The arms of d, as `arms` returns them.
    """
    return (*(-n).parts, -n.dot(a_i.perp())), (*n.parts, n.dot(a_j.perp()))
