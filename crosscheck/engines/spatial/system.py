"""The equations of a joint tree of space (`poses.Equations`): closures, unit lengths, spins held still, drivers.

Where two points meet, residual, Jacobian and drift term are the engine's own constraint (`SpaceEngine.pairs`). All
other rows are put together from the engine's places and motions of joint frames: they are the adapter's, derived.
In space the joints that are left open are held so:

=================== =====================================================================
closure             rows
=================== =====================================================================
spherical           one pair of points
revolute            two pairs, at the joint and one unit along its axis: 6 rows of rank 5
universal           one pair, h_i . h_j
fixed               one pair, f_i . h_j, g_i . h_j, f_i . g_j
cylindrical         f_i . h_j, g_i . h_j, f_i . d, g_i . d
prismatic           the same, f_i . g_j
screw               f_i . h_j, g_i . h_j, f_i . d, g_i . d, h_i . d less what the turn makes of it
orientation         f_i . h_j, g_i . h_j, f_i . g_j
twist               the angle of the turn about h
distance            (d . d - L^2) / (2 L)
gear                the sum of radius times turn of two joints of the tree
=================== =====================================================================
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from crosscheck.engines import EngineRefusal
from crosscheck.engines.poses import EPS, Equations, Tabulated
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.reading import AXIAL, COUNTED, MEETING, ROWS, Drive, F, G, H, Hold
from crosscheck.engines.spatial.tree import SpaceTree, longest_chain
from crosscheck.engines.spatial.turning import about_z, cross, skew

Array = Any


@dataclass(frozen=True)
class Place:
    """A frame on a body: a point, and the columns f, g, h of axes, in the body's own frame."""

    body: str
    u: Any
    axes: Any


class SpaceEngine(Protocol):
    """An engine's model of a `SpaceTree`, at B poses at once; columns are rates (v,) of its joints.

    It is given the places to be read, and the pairs of them, of i and of j, that it holds together itself.
    """

    tree: SpaceTree

    def still(self, q: Array) -> State:
        """Return places, axes and Jacobians at q (B, n), and of pairs d and its Jacobian."""

    def moving(self, q: Array, rates: Array, accelerations: Array | None) -> tuple[Array, Array, Array]:
        """Return velocities and accelerations (B, P, 6) of places, linear ones first, and d'' of pairs (B, K, 3)."""


@dataclass
class State:
    """What rows are made of at B poses: P places, K pairs of them, v rates; moving also velocities and accelerations.

    Places (B, P, 3), axes (B, P, 3, 3), Jacobians (B, P, 6, v); of pairs d (B, K, 3) and its Jacobian (B, K, 3, v);
    velocities and accelerations (B, P, 6) of places, and d'' (B, K, 3).
    """

    r: Array
    axes: Array
    jac: Array
    gap: Array
    gap_jac: Array
    vel: Array = None
    acc: Array = None
    gap_acc: Array = None


def at_places(twists: Array, off: Array, moves: Array) -> Array:
    """Return Jacobians (B, P, 6, v) of places, linear ones first, from the twists of rates at other points.

    Parameters
    ----------
    twists, off, moves : (B, 6, v), (B, P, 3), (P, 1, v) array
        Twists, the linear ones first; how far the places are off; which rates move them, 1 or 0.
    """
    out = np.empty((*off.shape[:2], *twists.shape[1:]))
    out[...] = twists[:, None]
    out[:, :, :3] -= skew(off) @ twists[:, None, 3:]
    out *= moves
    return out


Law = tuple[Any, Any, Any]
"""A number that a row is held at, its rate and its second derivative: (B,) each, or the same for all."""
Row = Callable[[State, Law], tuple[Any, Any]]
"""State at poses, law -> values (B,), gradients (B, v); state of a motion without accelerations, law -> gamma, None."""


class SpaceSystem(Equations):
    """The rows to be solved, of a tree in an engine.

    The spin of a passive body (`Numbers.passive`), the first of those that spin as one, is held still by a row of rates
    alone, w . u = 0 along its line u: no step of Newton turns it, and its rates and accelerations are those without it.
    Where it ends depends on the way there. `build` makes the engine's model of tree, places and pairs.
    """

    def __init__(self, tree: SpaceTree, build: Callable[[SpaceTree, list[Place], list[tuple[int, int]]], Any]) -> None:
        self.tree, self._rounding = tree, 24.0 * (1 + longest_chain(tree.edges)) ** 2 * EPS
        self.places: list[Place] = []
        self.pairs: list[tuple[int, int]] = []
        self._rows: list[tuple[Row, Law]] = []
        for body in tree.numbers.bodies:
            self._place(body, np.zeros(3), np.eye(3))
        for hold in tree.closures:
            self._close(hold)
        first = [next(iter(spin.items())) for spin in tree.numbers.passive]
        self._spins = [(tree.numbers.bodies.index(body), line) for body, (_, line) in first]
        self._driven = [(drive, Tabulated(drive.law), self._drive(drive)) for drive in tree.numbers.drives]
        self._gears = [([*map(tree.turn_of, g.joints)], np.array(g.radii), g.sum) for g in tree.numbers.gears]
        self.laws = [drive.law for drive in tree.numbers.drives]
        self.engine = build(tree, self.places, self.pairs)
        self._last: tuple[Array, State] | None = None
        self.own = 3 * len(self.pairs)
        self._held = self.own + len(self._rows) + len(self._spins) + len(tree.balls) + len(self._gears)

    def _place(self, body: str, u: Any, axes: Any) -> int:
        self.places.append(Place(body, u, axes))
        return len(self.places) - 1

    def _ends(self, hold: Hold, along: float = 0.0) -> tuple[int, int]:
        """Return the places of a joint, shifted along its axis."""
        i, j = ((body, *hold.end(body)) for body in hold.bodies)
        return self._place(i[0], i[1] + along * i[2][:, 2], i[2]), self._place(j[0], j[1] + along * j[2][:, 2], j[2])

    def _close(self, hold: Hold) -> None:
        if hold.kind == JointKind.OTHER:
            raise EngineRefusal(f"{hold.name!r}: no equations here for an element that it consists of")
        i, j = self._ends(hold)
        if hold.kind in MEETING:
            self.pairs.append((i, j))
        if hold.kind == JointKind.REVOLUTE:
            self.pairs.append(self._ends(hold, 1.0))
        for what, a, *b in sorted(ROWS.get(hold.kind, ()), key=lambda row: row[0] != "dot"):
            self._rows.append((_dot(i, a, j, *b) if what == "dot" else _along(i, a, j), (0.0, 0.0, 0.0)))
        if hold.kind == JointKind.DISTANCE:
            self._rows.append((_distance(i, j), (hold.length, 0.0, 0.0)))
        if hold.kind == JointKind.TWIST:
            self._rows.append((_twist(i, j), (0.0, 0.0, 0.0)))
        if hold.kind in COUNTED:
            self._rows.append((_thread(i, j, hold.pitch), (hold.shift, 0.0, 0.0)))

    def _drive(self, drive: Drive) -> Any:
        """Return the coordinate that a driver moves, with factor and shift, or its row."""
        if drive.kind == JointKind.OTHER:
            raise EngineRefusal(f"{drive.name!r}: no equations here for an element that it consists of")
        edge = self.tree.edge_of(drive)
        if edge is None:
            i, j = self._ends(drive.hold)
            if drive.kind == JointKind.DISTANCE:
                return _distance(i, j)
            turned = _angle if drive.hold.kind in AXIAL else _twist
            return turned(i, j) if drive.kind == JointKind.ANGLE else _along(i, H, j)
        if edge.kind == JointKind.SCREW and drive.kind != JointKind.ANGLE:
            return edge.first, edge.pitch, edge.shift
        return (self.tree.turn_of(edge.hold) if drive.kind == JointKind.ANGLE else edge.first), 1.0, 0.0

    def start(self, t: float) -> Array:
        """Return the coordinates nearest the estimates; driven angles get the whole turns that laws and gears have.

        An estimate says nothing of turns, and Newton's method would turn the whole mechanism to make up for them.
        """
        q = self.tree.start()
        known = {edge.first for edge in self.tree.edges if edge.kind == JointKind.SCREW}
        for drive, law, what in self._driven:
            if drive.kind == JointKind.ANGLE and drive.hold.kind != JointKind.SCREW and not callable(what):
                q[what[0]] += math.tau * round((law(t, 0) - q[what[0]]) / math.tau)
                known.add(what[0])
        waiting = list(self._gears)
        while waiting:  # from wheel to wheel
            columns, radii, total = gear = min(waiting, key=lambda gear: len({*gear[0]} - known))
            waiting = [other for other in waiting if other is not gear]
            for column, radius in [pair for pair in zip(columns, radii, strict=True) if pair[0] not in known][-1:]:
                q[column] += math.tau * round((total - radii @ q[columns]) / (math.tau * radius))
            known.update(columns)
        return q

    # rows

    def _still(self, q: Array) -> State:
        """Return what the engine has at poses (B, n); asked again for the last ones, what it had."""
        if self._last is None or not np.array_equal(q, self._last[0]):
            self._last = q.copy(), self.engine.still(q)
        return self._last[1]

    def rows(self, q: Array, t: Array) -> tuple[Array, Array]:
        state, columns = self._still(q), self.tree.rates(q)
        residual = np.zeros((len(t), self._held + len(self._driven)))
        jacobian = np.zeros((*residual.shape, self.tree.width))
        slopes = np.empty((len(t), len(self._rows) + self.own + len(self._spins), columns.shape[1]))
        residual[:, : self.own] = state.gap.reshape(len(t), self.own)
        slopes[:, : self.own] = state.gap_jac.reshape(len(t), self.own, columns.shape[1])
        k = self.own
        for row, law in self._rows:
            residual[:, k], slopes[:, k] = row(state, law)
            k += 1
        for place, line in self._spins:
            slopes[:, k] = _through(state.axes[:, place] @ line, state.jac[:, place, 3:])
            k += 1
        np.matmul(slopes, columns, out=jacobian[:, :k])
        for ball in self.tree.balls:
            residual[:, k], jacobian[:, k, ball] = 0.5 * (_dots(q[:, ball], q[:, ball]) - 1.0), q[:, ball]
            k += 1
        for turns, radii, total in self._gears:
            residual[:, k], jacobian[:, k, turns] = q[:, turns] @ radii - total, radii
            k += 1
        for drive, tabulated, what in self._driven:
            f = tabulated(t, 0) / drive.size
            if callable(what):
                residual[:, k], slope = what(state, (f, 0.0, 0.0))
                jacobian[:, k] = _through(slope, columns)
            else:
                column, factor, shift = what
                residual[:, k], jacobian[:, k, column] = q[:, column] * factor + shift - f, factor
            k += 1
        return residual, jacobian

    def nu(self, q: Array, t: Array) -> Array:
        right = np.zeros((len(t), self._held + len(self._driven)))
        for k, (drive, law, _) in enumerate(self._driven):
            right[:, self._held + k] = law(t, 1) / drive.size
        return right

    def gamma(self, q: Array, qd: Array, t: Array) -> Array:
        rates = (self.tree.rates(q) @ qd[:, :, None])[:, :, 0]
        vel, acc, gap_acc = self.engine.moving(q, rates, None)
        state = replace(self._still(q), vel=vel, acc=acc, gap_acc=gap_acc)
        right = np.empty((len(t), self._held + len(self._driven)))
        right[:, : self.own] = -state.gap_acc.reshape(len(t), self.own)
        k = self.own
        for row, law in self._rows:
            right[:, k] = row(state, law)[0]
            k += 1
        for place, line in self._spins:
            right[:, k] = -_dots(state.axes[:, place] @ line, state.acc[:, place, 3:])
            k += 1
        for ball in self.tree.balls:
            right[:, k] = -_dots(qd[:, ball], qd[:, ball])
            k += 1
        right[:, k : self._held] = 0.0  # gears
        k = self._held
        for drive, tabulated, what in self._driven:
            f, fd, fdd = (tabulated(t, order) / drive.size for order in range(3))
            right[:, k] = what(state, (f, fd, fdd))[0] if callable(what) else fdd
            k += 1
        return right

    def round_off(self, q: Array, t: Array) -> Array:
        """Return a bound (B, 1) on what rounding leaves of a residual that is zero.

        As in the plane (`tree_system`), with products of three terms instead of two: a point at the end of `depth`
        links errs by 12 (1 + depth)^2 EPS (1 + |q|), and a row compares two.
        """
        return self._rounding * (1.0 + np.abs(q).max(axis=1, initial=0.0, keepdims=True))

    def bodies(self, q: Array, qd: Array | None, qdd: Array | None) -> tuple[Array, ...]:
        """Return of the bodies at B poses: places (B, b, 3), rotations; velocities (B, b, 6), accelerations."""
        count = len(self.tree.numbers.bodies)
        state = self._still(q)
        if qd is None:
            return state.r[:, :count], state.axes[:, :count]
        columns = self.tree.rates(q)
        rates = [None if x is None else (columns @ x[:, :, None])[:, :, 0] for x in (qd, qdd)]
        vel, acc, _ = self.engine.moving(q, *rates)
        return state.r[:, :count], state.axes[:, :count], vel[:, :count], acc[:, :count]


def _dots(a: Any, b: Any) -> Any:
    """Return the scalar products (B,) of vectors (B, k)."""
    return np.add.reduce(a * b, axis=1)


def _through(a: Any, slopes: Any) -> Any:
    """Return vectors (B, k) times matrices (B, k, v), (B, v)."""
    return (a[:, None] @ slopes)[:, 0]


def _turns(state: State, i: int, j: int) -> Any:
    """Return the gradients (B, 3, v) of how j turns against i."""
    return state.jac[:, j, 3:] - state.jac[:, i, 3:]


def _axis_motion(state: State, k: int, a: int) -> tuple[Any, Any, Any]:
    """Return an axis, its rate w x a, and alpha x a + w x (w x a)."""
    return _turning(state.axes[:, k, :, a], state.vel[:, k, 3:], state.acc[:, k, 3:])


def _turning(axis: Any, w: Any, alpha: Any) -> tuple[Any, Any, Any]:
    rate = cross(w, axis)
    return axis, rate, cross(alpha, axis) + cross(w, rate)


def _gap(state: State, i: int, j: int) -> tuple[Any, Any]:
    return state.r[:, j] - state.r[:, i], state.jac[:, j, :3] - state.jac[:, i, :3]


def _product(a: Any, b: Any) -> Any:
    """Return (a . b)'' from vectors with two derivatives."""
    return _dots(a[2], b[0]) + 2.0 * _dots(a[1], b[1]) + _dots(a[0], b[2])


def _gap_motion(state: State, i: int, j: int) -> tuple[Any, Any, Any]:
    difference = tuple(x[:, j, :3] - x[:, i, :3] for x in (state.vel, state.acc))
    return (state.r[:, j] - state.r[:, i], *difference)


def _dot(i: int, a: int, j: int, b: int) -> Row:
    def row(state: State, f: Law) -> tuple[Any, Any]:
        if state.vel is not None:
            return -_product(_axis_motion(state, i, a), _axis_motion(state, j, b)), None
        x, y = state.axes[:, i, :, a], state.axes[:, j, :, b]
        return _dots(x, y), _through(cross(y, x), _turns(state, i, j))  # y . (w_i x x) + x . (w_j x y)

    return row


def _along(i: int, a: int, j: int) -> Row:
    def row(state: State, f: Law) -> tuple[Any, Any]:
        if state.vel is not None:
            return f[2] - _product(_axis_motion(state, i, a), _gap_motion(state, i, j)), None
        x, (d, dd) = state.axes[:, i, :, a], _gap(state, i, j)
        return _dots(x, d) - f[0], _through(cross(x, d), state.jac[:, i, 3:]) + _through(x, dd)

    return row


def _distance(i: int, j: int) -> Row:
    def row(state: State, f: Law) -> tuple[Any, Any]:
        length = np.where(f[0], f[0], 1.0)
        if state.vel is not None:
            d = _gap_motion(state, i, j)
            return (f[1] * f[1] + f[0] * f[2] - 0.5 * _product(d, d)) / length, None
        d, dd = _gap(state, i, j)
        return (_dots(d, d) - f[0] * f[0]) / (2.0 * length), _through(d, dd) / length[..., None]

    return row


def _angle(i: int, j: int) -> Row:
    """Return the row of a driven angle; its gamma is that where the axes of the joint are one, as where it closes."""

    def row(state: State, f: Law) -> tuple[Any, Any]:
        h = state.axes[:, i, :, H]
        if state.vel is not None:
            return f[2] - _dots(h, state.acc[:, j, 3:] - state.acc[:, i, 3:]), None
        x = state.axes[:, i].swapaxes(1, 2) @ state.axes[:, j]
        angle = np.arctan2(x[:, 1, 0] - x[:, 0, 1], x[:, 0, 0] + x[:, 1, 1])
        return _nearest(angle - f[0]), _through(h, _turns(state, i, j))

    return row


def _nearest(angle: Any) -> Any:
    """Return angles (B,) less whole turns, exactly: C's `remainder`, which NumPy has not; NaN where there is none."""
    return np.array([math.remainder(x, math.tau) if math.isfinite(x) else math.nan for x in angle.tolist()])


def _turn(state: State, i: int, j: int, angle: Any) -> tuple[Any, Any, Any, Any]:
    """Return i turned by an angle about its axis, by how much j is turned further, the gradient by w, its divisor.

    A turn is twice atan2(e3, e0) of the Euler parameters that lead from frame to frame, of which g_i . f_j - f_i . g_j
    is 4 e0 e3 and f_i . f_j + g_i . g_j, the divisor, 2 (e0^2 - e3^2). The gradient is that where the first is zero.
    """
    x, y = state.axes[:, i] @ about_z(angle), state.axes[:, j]
    (xf, xg), (yf, yg) = ((z[:, :, F], z[:, :, G]) for z in (x, y))
    beside = _dots(xf, yf) + _dots(xg, yg)
    further = np.arctan2(_dots(xg, yf) - _dots(xf, yg), beside)
    return x, further, (cross(yf, xg) - cross(yg, xf)) / beside[:, None], beside


def _twist(i: int, j: int) -> Row:
    """Return the row of a turn, by a law or by nothing, about axes that need not have one direction."""

    def row(state: State, f: Law) -> tuple[Any, Any]:
        x, further, about, beside = _turn(state, i, j, f[0])
        if state.vel is None:
            return further, _through(about, _turns(state, i, j))
        w, own = state.vel[:, i, 3:], np.multiply(f[1], x[:, :, H].T).T
        g, f_ = (_turning(x[:, :, a], w + own, state.acc[:, i, 3:] + cross(w, own)) for a in (G, F))
        bend = _product(g, _axis_motion(state, j, F)) - _product(f_, _axis_motion(state, j, G))
        return f[2] - bend / beside, None

    return row


def _thread(i: int, j: int, pitch: float) -> Row:
    """Return the row of a screw, h_i . d - shift - pitch theta: of the turns that theta may count the nearest."""
    height, twist = _along(i, H, j), _twist(i, j)

    def row(state: State, f: Law) -> tuple[Any, Any]:
        (off, along), angle = height(state, f), _turn(state, i, j, 0.0)[1]
        if state.vel is None:
            _, slope = twist(state, (angle, 0.0, 0.0))
            return pitch * _nearest(off / pitch - angle), along - pitch * slope
        rate = _dots(_turn(state, i, j, angle)[2], state.vel[:, j, 3:] - state.vel[:, i, 3:])
        return off - pitch * twist(state, (angle, rate, 0.0))[0], None

    return row
