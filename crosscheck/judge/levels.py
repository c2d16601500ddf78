"""The translation of the model, apart from any solve: an engine's own rows where nothing is assembled.

Both sides are fed the same (q, qd, t). Through the adapter's `RowMap`s our row x becomes the row y the engine must
have: y = factor F(x), y_q = factor F' x_q, y' = factor F' x', gamma_y = factor (F' gamma - F'' x'^2). The allowed
error is the running error of our formulas, carried through the map, times the one safety factor of the budgets, on
both sides.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np

from crosscheck.engines import (
    ConstraintModel,
    Engine,
    EngineError,
    Level,
    Support,
    Term,
    is_plain,
    refused,
    refused_joints,
)
from crosscheck.engines.frames import RowMap
from crosscheck.engines.spatial.turning import common_columns
from crosscheck.errors import kept
from crosscheck.judge.budget import BOTH_SIDES
from crosscheck.judge.delivery import ABSOLUTE
from crosscheck.judge.records import At
from crosscheck.judge.rounding import SAFETY
from crosscheck.judge.running_error import Running, U, off_by, parts, running
from refkin.joints import Constraint, elements_of
from refkin.joints.spatial_elements import AxesParallel, TurnAboutAxis
from refkin.model import Mechanism
from refkin.solving.starts import in_form
from refkin.system import System, compile_system

TINY = float(np.finfo(float).tiny)
ABSENT = refused("not in the table")
ROUNDINGS = 8
"""Of w = 2 E p' four, of a row's product with v and w three, of the row's own entries one."""
OF_FORM = (AxesParallel.kind, TurnAboutAxis.kind)
"""Elements whose rows differ by form (`refkin.joints.spatial`)."""
LEVELS = (Level.RESIDUAL, Level.JACOBIAN, Level.CONSTRAINT_VELOCITY, Level.DRIFT)


@dataclass(frozen=True)
class Configuration:
    """A state of the bodies to evaluate at, in metres and rad; nothing makes it an assembled one.

    `contacts` are the contact parameters at which our rows of cams are evaluated, and the angles of screws.
    """

    mechanism: Mechanism
    q: Any
    qd: Any
    t: float
    contacts: Any
    _known: dict[str, tuple[System, dict[Any, Any]]] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def sizes(self) -> tuple[dict[Level, float], dict[Level, float]]:
        """The size of what an engine may add and subtract on the way to a row: of points, then of turns.

        Residual and Jacobian: the farthest coordinate from the origin; velocity: omega times that, and v; drift: omega
        times all of these. Rows of turns are products of Euler parameters p, whatever the lengths: 1, |p'| and |p'|^2.
        """
        kind = self.mechanism.kind
        q, qd = (x.reshape(-1, kind.width) for x in (self.q, self.qd))
        lever, linear = (float(np.abs(x[:, : kind.dimension]).max()) for x in (q, qd))
        turning = qd[:, kind.dimension :]
        rate = float(np.linalg.norm(turning, axis=1).max())
        omega = float(np.abs(turning).max()) if kind.name == "planar" else 2.0 * rate
        moved = linear + omega * lever
        sizes = (lever, lever, moved, omega * moved), (1.0, 1.0, rate, rate**2)
        of_points, of_turns = (dict(zip(LEVELS, size, strict=True)) for size in sizes)
        return of_points, of_turns

    def in_form(self, form: str) -> tuple[System, dict[Any, Any]]:
        """Return our equations in a form of the joints of space, and their values there: the same for all engines.

        Values come with the running error of each. The empty form is that which the mechanism has.
        """
        if form not in self._known:
            system = compile_system(in_form(self.mechanism, form))
            self._known[form] = system, _ours(system, self)
        return self._known[form]


@dataclass(frozen=True)
class LevelComparison:
    """One level of one engine over some configurations.

    `ratio` is the largest error / allowed, `digits` one number per configuration, `rows` how many rows were compared,
    `worst` names the row of the largest ratio.
    """

    ratio: float
    digits: tuple[float, ...]
    rows: int
    worst: At

    @property
    def agrees(self) -> bool:
        """Whether every row is within its allowed error."""
        return self.ratio <= 1.0


def configurations(mechanism: Mechanism, near: Any, t: Any, seed: str, count: int) -> list[Configuration]:
    """Return configurations around assembled poses, each coordinate moved by up to one size or one radian.

    The numbers come from `seed` alone, so a scene is always checked at the same ones.

    Parameters
    ----------
    mechanism : Mechanism
    near : (n, T) array
        The assembled poses [m, rad].
    t : (T,) array
        Their times [s].
    seed : str
        Of the draws.
    count : int
        How many.
    """
    draw = random.Random(seed)
    kind, size, count_of = mechanism.kind, mechanism.size(), len(mechanism.bodies)
    scale = np.tile([size] * kind.dimension + [1.0] * (kind.width - kind.dimension), count_of)
    samples = []
    for _ in range(count):
        sample = draw.randrange(len(t))
        move, rate = (np.array([draw.uniform(-1.0, 1.0) for _ in scale]) * scale for _ in range(2))
        bodies, contacts = np.split(near[:, sample], [len(scale)])
        q, qd = bodies + move, 3.0 * rate
        if kind.name == "spatial":
            for k in range(count_of):
                p = slice(7 * k + 3, 7 * k + 7)
                q[p] /= np.linalg.norm(q[p])
                qd[p] -= q[p] * (q[p] @ qd[p])  # so that the length stays 1
        samples.append(Configuration(mechanism, q, qd, float(t[sample]), contacts))
    return samples


def expect_model(engine: Engine, model: Any, mechanism: Mechanism) -> None:
    """Raise EngineError unless what an engine's `constraints` returned is a `ConstraintModel` of a mechanism.

    Parameters
    ----------
    engine, model, mechanism : Engine, ConstraintModel, Mechanism
    """
    who = f"engine {engine.name!r}: constraints()"
    lacking = [key for key in ("rows", "owns_driver", *LEVELS) if not hasattr(model, key)]
    if lacking:
        got = f"{type(model).__name__} without {', '.join(lacking)}"
        raise EngineError(f"{who}: expected a {ConstraintModel.__module__}.ConstraintModel, got a {got}")
    if not (isinstance(model.rows, tuple | list) and all(isinstance(m, RowMap) for m in model.rows)):
        raise EngineError(f"{who}: rows: expected a list of RowMap, got {kept(repr(model.rows))}")
    for m in model.rows:
        if not (isinstance(m.engine_row, int | np.integer) and m.engine_row >= 0 and isinstance(m.factor, Real)):
            said = "a whole engine_row from 0 on, a real factor"
            raise EngineError(f"{who}: rows: expected of a RowMap {said}, got {kept(repr(m))}")
    known = {(e.name, e.row + k) for e in elements_of(mechanism.constraints) for k in range(e.rows)}
    strange = [f"row {m.row} of {m.constraint}" for m in model.rows if (m.constraint, m.row) not in known]
    if strange:
        raise EngineError(f"{who}: the scene has no {kept(', '.join(strange))}")


def missing_rows(engine: Engine, model: ConstraintModel, mechanism: Mechanism) -> list[str]:
    """Return the rows, by name, that a model does not have exactly once although the engine's table has their element.

    A joint that is refused in part may be left out as a whole, and what it drives with it. A row whose map is flat at
    zero (factor F'(0) = 0) counts as missing.

    Parameters
    ----------
    engine, model, mechanism : Engine, ConstraintModel, Mechanism
    """
    had = [(m.constraint, m.row) for m in model.rows if TINY / U < abs(m.factor * m.form(0.0, 1)) < np.inf]
    table = engine.capabilities()
    refused = {name for _, name, _ in refused_joints(engine, mechanism.constraints, Level.RESIDUAL)}
    left_out = refused - {name for name, _ in had}
    return [
        f"row {e.row + k} of {e.name}"
        for c in mechanism.constraints
        if c.name not in left_out
        and getattr(c, "joint", "") not in refused
        and not (c.shares and c.laws)  # a driver that counts turns has a coordinate that no engine has
        for e in elements_of([c])
        if table.get(e.key, {}).get(Level.RESIDUAL, ABSENT).support is not Support.REFUSED
        and (model.owns_driver or not e.laws)
        for k in range(e.rows)
        if had.count((e.name, e.row + k)) != 1
    ]


def without_form(mechanism: Mechanism, form: str) -> list[Constraint]:
    """Return the constraints whose formulas have no rows of turns in a form: those of one form have half angles."""
    if form in ("", "half"):
        return []
    half, other = (in_form(mechanism, one).constraints for one in ("half", form))
    turns = Counter(e.name for e in elements_of(mechanism.constraints) if e.kind in OF_FORM)
    pairs: list[Any] = [pair for pair in zip(half, other, strict=True) if turns[pair[0].name]]
    terms = [(a, getattr(a, "terms", ()), getattr(b, "terms", ())) for a, b in pairs]  # formulas of its own have none
    return [a for a, x, y in terms if sum(p is not q for p, q in zip(x, y, strict=True)) < turns[a.name]]


def compare_levels(
    engine: Engine,
    model: ConstraintModel,
    mechanism: Mechanism,
    at: Sequence[Configuration],
    terms: Sequence[Term] = (),
) -> dict[Level, LevelComparison]:
    """Compare every level that the engine declares for the joints; driver rows only if it owns the driver.

    Rows of turns are left out where our formulas have them in another form only (`without_form`).

    Parameters
    ----------
    engine, model, mechanism : Engine, ConstraintModel, Mechanism
    at : sequence of Configuration
        Where.
    terms : sequence of Term
        What the engine adds to its own rows.
    """
    table = engine.capabilities()
    elements = {(e.name, e.row + k): e for e in elements_of(mechanism.constraints) for k in range(e.rows)}
    other = {c.name for c in without_form(mechanism, getattr(model, "form", ""))}
    of = [(m, elements[m.constraint, m.row]) for m in model.rows]
    maps = [m for m, e in of if (model.owns_driver or not e.laws) and not (e.name in other and e.kind in OF_FORM)]
    able = [table.get(elements[m.constraint, m.row].key, {}) for m in maps]
    expected = [_expected(model, c, maps) for c in at] if maps else []
    compared = {}
    for level in LEVELS:
        of_level = [k for k, one in enumerate(able) if one.get(level, ABSENT).support is not Support.REFUSED]
        if of_level:
            own = [maps[k] for k in of_level]
            samples = [
                _compare_at(level, model, c, own, value[of_level], allowed[of_level], terms)
                for c, (value, allowed) in zip(at, (of_all[level] for of_all in expected), strict=True)
            ]
            compared[level] = _worst_of(samples, own)
    return compared


def _worst_of(samples: Sequence[tuple[Any, Any]], maps: Sequence[RowMap]) -> LevelComparison:
    ratios = np.array([ratio for ratio, _ in samples])
    sample, row = divmod(int(np.argmax(ratios)), len(maps))
    worst = At(f"row {maps[row].row} of {maps[row].constraint}, configuration {sample}")
    return LevelComparison(float(ratios.max()), tuple(float(d) for _, d in samples), len(maps), worst)


def _compare_at(
    level: Level,
    model: ConstraintModel,
    at: Configuration,
    maps: Sequence[RowMap],
    expected: Any,
    allowed: Any,
    terms: Sequence[Term],
) -> tuple[Any, float]:
    """Return error / allowed per mapped row, and the digits of the worst row, at one configuration."""
    theirs = {
        Level.RESIDUAL: lambda: model.residual(at.q, at.t),
        Level.JACOBIAN: lambda: model.jacobian(at.q, at.t),
        Level.CONSTRAINT_VELOCITY: lambda: model.constraint_velocity(at.q, at.qd, at.t),
        Level.DRIFT: lambda: model.drift(at.q, at.qd, at.t),
    }[level]()
    needed = (1 + max(m.engine_row for m in maps), *np.shape(expected)[1:])
    if not (is_plain(theirs, "fiu") and theirs.shape[1:] == needed[1:] and len(theirs) >= needed[0]):
        got = np.shape(theirs) if isinstance(theirs, np.ndarray) else type(theirs).__name__
        raise EngineError(f"own rows, {level}: expected an array of shape {needed} or with more rows, got {got}")
    of_level = [term for term in terms if term.level == level]
    if of_level:
        sizes = np.array([at.sizes[m.either][level] for m in maps])
        added = sum(t.absolute + t.relative * sizes for t in of_level) * np.abs([m.factor for m in maps])
        allowed = allowed + added.reshape(-1, *[1] * (allowed.ndim - 1))
    error = np.abs(theirs[[m.engine_row for m in maps]] - expected)
    ratios = np.where(error == 0.0, 0.0, error / np.maximum(allowed, TINY)).reshape(len(maps), -1).max(axis=1)
    _, ours = at.in_form(getattr(model, "form", ""))
    relative = float(np.fmax.reduce(error, axis=None)) / max(ours["scale"][level], TINY)
    return ratios.tolist(), min(17.0, -np.log10(relative)) if relative else 17.0


def _signed(maps: Sequence[RowMap], theirs: Any, ours: Any, first_row: Mapping[str, int]) -> list[RowMap]:
    """Return maps of rows whose sign is that of Euler parameters with the sign that their joint's residual has here."""
    signed = []
    for m in maps:
        joint = [n for n in maps if n.either and n.constraint == m.constraint]
        same = sum(theirs[n.engine_row] * n.factor * ours[first_row[n.constraint] + n.row] for n in joint)
        signed.append(replace(m, factor=-m.factor) if m.either and same < 0.0 else m)
    return signed


def _ours(system: System, at: Configuration) -> dict[Any, Any]:
    """Return our values at a configuration, with the running errors of each."""
    coordinates = np.append(at.q, at.contacts)
    rates = np.append(at.qd, 0.0 * at.contacts)
    lost = U * np.abs(coordinates)  # of a point's place in the ground frame, once composed
    rounded, qd, spatial = running(coordinates, lost), running(rates), system.kind.name == "spatial"
    # Turns of space multiply by a lever what is lost of a place far from the origin: no `Term` knows it.
    q = running(coordinates, lost * np.resize([1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0], len(lost)) if spatial else 0.0)
    slope, gamma = system.phi_q(q, at.t), system.gamma(q, qd, at.t)
    rate = off_by(parts(slope), rates, parts(system.nu(q, at.t)))
    slope = slope[:, : system.of_bodies]
    if spatial:
        slope, gamma = _in_common_columns(slope, gamma, at)
        rate = rate[0], rate[1] + ROUNDINGS * U * np.abs(parts(slope)[0]) @ _turning(at)
    values = parts(system.phi(rounded, at.t)), parts(slope), rate, parts(gamma)
    scale = {level: float(np.max(np.abs(value))) for level, (value, _) in zip(LEVELS, values, strict=True)}
    return {**dict(zip(LEVELS, values, strict=True)), "scale": scale}


def _turning(at: Configuration) -> Any:
    """Return bounds of v and w = 2 E p' as sums of products, by which an engine in common columns is given rates."""
    columns = np.abs(common_columns(at.q)).T @ np.abs(at.qd)
    return columns * np.tile([1.0, 1.0, 1.0, 4.0, 4.0, 4.0], len(at.q) // 7)  # the columns have E^T / 2


def _in_common_columns(slope: Any, gamma: Any, at: Configuration) -> tuple[Any, Any]:
    """Return a Jacobian with columns (v, w) of each body instead of its coordinates, and gamma with w' in place of p''.

    p' = E^T w / 2, and where w' is zero p'' = -|w|^2 p / 4: gamma gains what that part of p'' is multiplied by.
    """
    columns, bent = common_columns(at.q), gamma.copy()
    for k, (q, qd) in enumerate(zip(at.q.reshape(-1, 7), at.qd.reshape(-1, 7), strict=True)):
        for c in range(3, 7):
            bent = bent + slope[:, 7 * k + c] * float(qd[3:] @ qd[3:] * q[c])  # |w|^2 / 4 = |p'|^2
    out = np.empty((len(slope), columns.shape[1]), object)
    for row, entries in enumerate(slope):
        for c, column in enumerate(columns.T):
            there = np.flatnonzero(column)
            out[row, c] = sum((entries[n] * float(column[n]) for n in there), Running(0.0))
    return out, bent


def _expected(model: ConstraintModel, at: Configuration, maps: Sequence[RowMap]) -> dict[Level, tuple[Any, Any]]:
    """Return the rows that the engine must have, and the allowed errors, at every level."""
    system, ours = at.in_form(getattr(model, "form", ""))
    given = system.placed[: len(system.mechanism.constraints)]  # without rows of bodies, some named as a joint is
    first_row = {p.constraint.name: p.row for p in given}
    if any(m.either for m in maps):
        maps = _signed(maps, model.residual(at.q, at.t), ours[Level.RESIDUAL][0], first_row)
    return _mapped(maps, [first_row[m.constraint] + m.row for m in maps], ours)


def _mapped(maps: Sequence[RowMap], rows: Sequence[int], ours: Mapping[Any, Any]) -> dict[Level, tuple[Any, Any]]:
    """Return what maps make of our rows of these numbers at every level, and the allowed errors."""
    (x, ex), (slope, e_slope), (rate, e_rate), (gamma, e_gamma) = (
        [part[rows] for part in ours[level]] for level in LEVELS
    )
    forms = [[m.factor * m.form(v, order) for order in range(3)] for m, v in zip(maps, x, strict=True)]
    f0, f1, f2 = np.array(forms, float).T
    # F'' at an x known to ex
    beside = np.array([m.factor * m.form(v, 2) for m, v in zip(maps, x + ex, strict=True)], float) - f2
    own = np.array([abs(m.factor) * min(ABSOLUTE, getattr(m.form, "rounding", 0.0)) for m in maps])
    # own: of one that has y by a product, not from x
    bend, along, largest = np.abs(f2), np.abs(slope), U * np.max(np.abs(slope), axis=1, keepdims=True)
    steep = np.abs(f1)
    mapped = {
        Level.RESIDUAL: (f0, steep * ex + own),
        Level.JACOBIAN: (
            f1[:, None] * slope,
            steep[:, None] * (e_slope + largest) + (bend * ex)[:, None] * along + own[:, None] * along,
        ),
        Level.CONSTRAINT_VELOCITY: (f1 * rate, steep * e_rate + (bend * ex + own) * np.abs(rate)),
        Level.DRIFT: (
            f1 * gamma - f2 * rate**2,
            steep * e_gamma
            + bend * (2 * np.abs(rate) * e_rate + ex * np.abs(gamma) + U * rate**2)
            + (np.abs(beside) + own) * rate**2,
        ),
    }
    return {
        level: (value, BOTH_SIDES * SAFETY * (error + 2 * U * np.abs(value)))
        for level, (value, error) in mapped.items()
    }
