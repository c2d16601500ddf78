"""Many mechanisms of one topology: a scene whose joints and drivers have rows of numbers instead of numbers.

A row holds one number for each sample, and a sample is a mechanism. The joints' own `constants` and `inputs` run on
rows as they run on numbers, so a family is a `System` whose geometry and unit are rows, and all its methods work as
ever on (n, M).

A law whose times of turning hold no rows turns back at the same times in every mechanism. Of any other it is asked in
which mechanisms it may: in those where its rate, or the value of a distance, is not proved to keep its sign. They march
alone, and there it is known exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from refkin.errors import Fault, InvalidScene
from refkin.fast.given import Estimates, Geometry, constraints_of, estimates_of, has_rows, rows_in
from refkin.joints import GROUND, Constraint, Driver, Unit
from refkin.model import ROUNDED, Body, Mechanism, Scene
from refkin.motion_laws import Integral, Law, Polynomial, Sinusoid
from refkin.proof.numbers.exact import by_parts
from refkin.proof.numbers.extrema import derivative, drives_a_distance, extrema, extrema_of, zeros
from refkin.system import System


@dataclass(frozen=True)
class Family:
    """The mechanisms and their equations.

    Attributes
    ----------
    scene : Scene
        The scene that all have in common.
    constraints : tuple of Constraint
        Joints, then drivers, with rows in place of numbers.
    system : System
        With rows (M,) for geometry and unit.
    size : int
        M, the number of mechanisms.
    estimates : dict
        Body -> (3, M) in metres and rad, or None.
    faulty : (M,) array of bool
        The mechanisms that no scene may have, such as one with a length below 0: `sample` says why.
    """

    scene: Scene
    constraints: tuple[Constraint, ...]
    system: System
    size: int
    estimates: dict[str, Any]
    faulty: Any

    def sample(self, k: int) -> Scene:
        """Return the scene of one mechanism, for `refkin.solve` and everything else that takes a scene."""
        m = self.scene.mechanism
        constraints = self.of_sample(k)
        joints, drivers = constraints[: len(m.joints)], constraints[len(m.joints) :]
        bodies = []
        for body in m.bodies:
            given = self.estimates[body.name]
            estimate = None if given is None else tuple(float(x) for x in given[:, k])
            bodies.append(Body(name=body.name, estimate=cast(Any, estimate)))
        mechanism = Mechanism(tuple(bodies), joints, cast(tuple[Driver, ...], drivers))
        return replace(self.scene, mechanism=mechanism, name=f"{self.scene.name} [{k}]")

    def of_sample(self, k: int) -> tuple[Constraint, ...]:
        """Return the constraints of one mechanism."""
        return tuple(cast(Constraint, sample_of(c, k)) for c in self.constraints)

    def unit_of(self, k: int) -> Unit:
        """Return the unit of one mechanism."""
        return cast(Unit, sample_of(self.system.unit, k))


def family(scene: Scene, system: System, geometry: Geometry, estimates: Estimates | None = None) -> Family:
    """Return the family of a scene whose geometry is replaced, in part or whole, by rows.

    Parameters
    ----------
    scene : Scene
    system : System
        That of the scene.
    geometry : mapping
        Joint -> key -> the numbers of that key, one row per mechanism [m, rad].
    estimates : mapping, optional
        Body -> its estimates, one row per mechanism [m, rad].

    Raises
    ------
    UnknownName, InvalidScene
        For a joint, key or body that does not exist, a value that does not fit, rows of different lengths, or what no
        mechanism of the family may have.
    """
    constraints = constraints_of(scene.mechanism, geometry)
    given = estimates_of(scene.mechanism, {} if estimates is None else estimates)
    lengths = {len(x) for c in constraints for x in rows_in(c)} | {x.shape[1] for x in given.values() if x is not None}
    lengths -= {1}
    if len(lengths) > 1:
        raise InvalidScene([Fault("geometry", sorted(lengths), "rows of one length, one number per mechanism")])
    size = lengths.pop() if lengths else 1
    if size == 0:
        raise InvalidScene([Fault("geometry", 0, "at least one mechanism")])
    unit = _unit(constraints, size)

    def full_row(x: Any) -> Any:
        return x if isinstance(x, float) else np.broadcast_to(np.asarray(x, float), (size,))

    placed = tuple(
        replace(p, constraint=c, g=tuple(map(full_row, c.constants(unit))))
        for p, c in zip(system.placed, constraints, strict=True)
    )
    full = {name: None if x is None else np.broadcast_to(x, (3, size)) for name, x in given.items()}
    faulty = _faulty(constraints, size)
    made = Family(scene, constraints, replace(system, unit=unit, placed=placed), size, full, faulty)
    complete = np.all([np.isfinite(x).all(axis=0) for x in full.values() if x is not None], axis=0)
    sound = np.flatnonzero(~faulty & complete)
    if sound.size:
        made.sample(sound[0])  # a scene like any other: what is wrong with all of them is wrong with it
    return made


def _faulty(constraints: tuple[Constraint, ...], size: int) -> Any:
    """Return which mechanisms have rows with numbers that no scene may have, by the joints' own `faults`."""
    faulty = np.zeros(size, bool)
    for constraint in constraints:
        rows = list(rows_in(constraint))
        for row in rows:
            faulty |= ~np.isfinite(row)
        # Faults of a driver, and of whatever a joint does not add any to, are not about numbers.
        if rows and not isinstance(constraint, Driver) and type(constraint).faults is not Constraint.faults:
            for k in np.flatnonzero(~faulty).tolist():
                faulty[k] = any(True for _ in sample_of(constraint, k).faults(""))
    return faulty


def sample_of(value: Any, k: int) -> Any:
    """Return the numbers of one sample of a value, or of a dataclass or tuple of values."""
    if isinstance(value, np.ndarray):
        return float(value[k if len(value) > 1 else 0])
    return by_parts(value, lambda part: sample_of(part, k)) if has_rows(value) else value


def of_samples(system: System, samples: Any) -> System:
    """Return the system of some samples of a family; `samples` is a slice or an array of numbers."""
    placed = tuple(replace(p, constraint=_cut(p.constraint, samples), g=_cut(p.g, samples)) for p in system.placed)
    return replace(system, unit=_cut(system.unit, samples), placed=placed)


def _cut(value: Any, samples: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value[samples] if value.ndim and len(value) > 1 else value
    return by_parts(value, lambda part: _cut(part, samples)) if has_rows(value) else value


def _unit(constraints: tuple[Constraint, ...], size: int) -> Unit:
    """Return the unit of every mechanism, by the rules of `Mechanism.size` and `Mechanism.unit`."""
    points: dict[str, list[Any]] = {}
    for constraint in constraints:
        for body, point in constraint.points():
            points.setdefault(body, []).append(point)
    largest = np.zeros(size)
    for on in points.values():
        for k, a in enumerate(on):
            for b in on[:k]:
                apart = np.hypot(np.subtract(a[0], b[0]), np.subtract(a[1], b[1]))
                told = apart > ROUNDED * np.fmax(np.abs(a[0]), np.abs(a[1]))
                largest = np.fmax(largest, np.where(told, apart, 0.0))
    for constraint in constraints:
        largest = np.fmax(largest, _reach(constraint, size))
    mantissa, exponent = np.frexp(largest)
    rounded = np.ldexp(1.0, np.where(mantissa > math.sqrt(0.5), exponent, exponent - 1))
    usable = (largest > 0.0) & np.isfinite(largest)
    origin = points[GROUND][0] if points.get(GROUND) else (0.0, 0.0)
    x, y = (cast(float, np.asarray(c, float)[()]) for c in origin)
    return Unit(cast(float, np.where(usable, rounded, 1.0)), (x, y))


def _reach(constraint: Constraint, size: int) -> Any:
    if not has_rows(constraint):
        return constraint.reach()
    try:
        return constraint.reach()
    except ValueError:  # the largest of two rows: sample by sample
        return np.array([cast(Constraint, sample_of(constraint, k)).reach() for k in range(size)])


def common_extrema(constraints: tuple[Constraint, ...], a: float, b: float) -> list[float]:
    """Return the times between a and b at which laws turn back in all mechanisms, in order.

    Parameters
    ----------
    constraints : tuple of Constraint
        Those whose laws are asked.
    a, b : float
        Times [s].
    """
    times: set[float] = set()
    for constraint in constraints:
        if constraint.laws and not has_rows(constraint.laws):
            times.update(extrema_of([constraint], a, b))
        else:
            times.update(t for law in constraint.laws for t in _common(law, a, b) or ())
    return sorted(times)


def _common(law: Law, a: float, b: float) -> list[float] | None:
    """Return the extrema of a law between a and b if they hold no rows, else None."""
    if isinstance(law, Polynomial) and not has_rows(law.coefficients[1:]):
        return zeros(derivative(law), a, b) if len(law.coefficients) > 1 else []
    if isinstance(law, Sinusoid) and not has_rows((law.angular_frequency, law.phase)):
        return extrema(replace(law, amplitude=1.0, offset=0.0), a, b)
    if isinstance(law, Integral) and not has_rows(law.rate):
        return extrema(law, a, b)
    return None


def may_turn(constraints: tuple[Constraint, ...], a: float, b: float, samples: int) -> Any:
    """Return in which of so many mechanisms a law may turn back between a and b at a time of its own, (samples,).

    Parameters
    ----------
    constraints : tuple of Constraint
        Those whose laws are asked.
    a, b : float
        Times [s].
    samples : int
        How many mechanisms there are.
    """
    turning = np.zeros(samples, bool)
    for constraint in constraints:
        if not has_rows(constraint.laws):
            continue
        for law in constraint.laws:
            if _common(law, a, b) is None:
                turning |= _turns(law, a, b)
            if drives_a_distance(constraint):
                turning |= ~_keeps_its_sign(law, a, b)
    return turning


def _turns(law: Law, a: float, b: float) -> Any:
    if isinstance(law, Sinusoid):
        first, last = ((law.angular_frequency * t + law.phase) / np.pi - 0.5 for t in (a, b))
        return np.floor(first) != np.floor(last)
    rate: Any = law.rate if isinstance(law, Integral) else derivative(law) if isinstance(law, Polynomial) else law
    return ~_keeps_its_sign(rate, a, b)


def _keeps_its_sign(law: Law, a: float, b: float) -> Any:
    """Return where |f| in the middle is more than it can change by up to the ends; not always where it is so."""
    middle, half = 0.5 * (a + b), 0.5 * (b - a)
    if isinstance(law, Sinusoid):
        change = half * np.abs(law.amplitude * law.angular_frequency)
    elif isinstance(law, Integral):
        rate = law.rate
        assert isinstance(rate, Polynomial | Sinusoid)  # a table has no rows
        if isinstance(rate, Sinusoid):
            change = half * (np.abs(rate.offset) + np.abs(rate.amplitude))
        else:
            change = half * (np.abs(rate(middle)) + _change(rate, middle, half))
    else:
        assert isinstance(law, Polynomial)
        change = _change(law, middle, half)
    return np.abs(law(middle)) > change


def _change(law: Polynomial, middle: float, half: float) -> Any:
    """Return by how much a polynomial can change within `half` of a time: the sum of its Taylor terms."""
    factor, change = 1.0, 0.0
    for order in range(1, len(law.coefficients)):
        factor *= half / order
        change = change + factor * np.abs(law(middle, order))
    return change
