"""The problem set: fixed mechanisms with answers proved to 30 digits, for whoever writes a solver.

`planar` and `spatial` say which mechanisms there are, `statement` which assembly is meant, and proves the answers;
`mjcf` and `exudyn_script` write them for two engines, `export` puts it all into a folder, with `grader`, which needs
nothing but Python, beside it. Here is what they share: a mechanism as it is stated, without estimates, in numbers of a
few decimals; and motion laws as formulas, which the files of a problem have: read, and run, in Python.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any

from crosscheck.errors import CannotRun
from refkin.joints import GROUND, Constraint, Driver, Element
from refkin.model import Body, Mechanism
from refkin.motion_laws import Integral, Polynomial, Sinusoid
from refkin.scenes.linkages import Linkage

VERSION = "5"
"""Of the set; whoever changes a problem, an answer or how they are written gives it another."""
SHA256 = "101c494a968798c53065a609b71ba54e680e148dcbcf40675c59f46c76865f22"
"""The hash of the whole set of that version."""
TIMES = (0.0, 0.5, 1.0, 1.5, 2.0)
"""Times of a regular problem [s]."""


@dataclass(frozen=True)
class Stated:
    """A mechanism without estimates, when it is asked for [s], and how many of its assemblies become problems.

    Of a `linkage` the two assemblies have names; `driven` is the coordinate that is its input.
    """

    title: str
    mechanism: Mechanism
    times: tuple[float, ...] = TIMES
    assemblies: int = 2
    linkage: Linkage | None = None
    driven: str = "crank"


def stated(title: str, joints: Sequence[Constraint], drivers: Driver | list[Driver], **more: Any) -> Stated:
    """Return a mechanism of the bodies that its joints and drivers name, each without an estimate.

    Parameters
    ----------
    title : str
    joints : sequence of Constraint
    drivers : Driver, or list of them
    **more
        Of `Stated`.
    """
    held = tuple(drivers) if isinstance(drivers, list) else (drivers,)
    names = dict.fromkeys(body for c in (*joints, *held) for body in c.bodies if body not in (GROUND, ""))
    return Stated(title, Mechanism(tuple(Body(name=name) for name in names), tuple(joints), held), **more)


def polynomial(*coefficients: float) -> Polynomial:
    """Return c0 + c1 t + ..."""
    return Polynomial(coefficients=coefficients)


def within(random: Random, low: float, high: float) -> float:
    """Return a number between two, of two decimals.

    Parameters
    ----------
    random : Random
    low, high : float
    """
    return round(low + (high - low) * random.random(), 2)


Family = Callable[[Random], Iterator[Stated]]


def adding(add: Mapping[type[Element], Any], element: Element) -> Any:
    """Return what adds an element to a model; CannotRun if nothing does."""
    if type(element) not in add:
        raise CannotRun(f"{element.name}: no export for {element.key}")
    return add[type(element)]


def formula(law: Any) -> str:
    """Return f(t) as an expression in `t`, with `sin` and `cos`; CannotRun for a table, which has no formula."""
    if isinstance(law, Polynomial):
        return _polynomial(law.coefficients)
    if isinstance(law, Sinusoid):
        return f"{law.offset!r} + {law.amplitude!r} * sin({law.angular_frequency!r} * t + {law.phase!r})"
    if isinstance(law, Integral) and isinstance(law.rate, Polynomial):
        return _polynomial([law.initial, *(c / (k + 1) for k, c in enumerate(law.rate.coefficients))])
    raise CannotRun(f"no formula for {law!r}")


def _polynomial(coefficients: Any) -> str:
    first, *rest = coefficients
    return f"{first!r} + t * ({_polynomial(rest)})" if rest else repr(first)
