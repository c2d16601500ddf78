"""Mechanisms of space in exudyn: bodies by Euler parameters, its own joints row by row, and their rows put in order.

Each of its objects holds the rows that ours, in the form `dot`, has too (h axis, f zero across it, g = h x f):

=================== =========================================================== ====================================
ours                exudyn, frames of columns f, g, h on markers [i, j]          its rows
=================== =========================================================== ====================================
spherical           ObjectJointSpherical                                        d
revolute            ObjectJointRevoluteZ on markers [j, i]                      -d, f_i . h_j, g_i . h_j
universal, fixed    ObjectJointSpherical, and for each other row the next line  d
f_i.h_j, g_i.h_j,   ObjectJointGeneric with one of its rotations held: y, x, z  as ours
f_i.g_j
f_i.d, g_i.d, h_i.d ObjectJointGeneric with one of its displacements held       as ours
h_i . h_j           ObjectJointGeneric, z held, columns (h, f, g) and (g, h, f) as ours
distance            ObjectConnectorDistance                                     |d| - L
angle by a law      as f_i.g_j, on [j, i], marker i turned by f at each time    sin(theta - f)
displacement        the same as h_i.d, marker i shifted by f at each time       as ours
=================== =========================================================== ====================================

A generic joint that holds two rotations at once has other rows. Rows of displacements and rotations that it leaves free
are exudyn's multipliers; they are not read. Its Jacobian with respect to Euler parameters is right after projection on
columns (v, w) alone, which is how it is read here. What laws move is set anew at each time, and takes no rate: f' is
added by the adapter. (Constraints of exudyn's relative coordinates, about any axis, would make drivers that take one,
and screws; the adapter makes neither.) Drift terms are made as in the plane (`readings`): at zero q'' accelerations of
points are w x (w x u).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from exudyn import HT
from exudyn import itemInterface as item

from crosscheck.engines import EngineRefusal, Level, Term
from crosscheck.engines.exudyn.model import CURRENT, ExudynSystem
from crosscheck.engines.exudyn.readings import OUT, ExudynRow, Readings, product
from crosscheck.engines.frames import Length, Linear, RowMap
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.reading import (
    COUNTED,
    CROSSED,
    MEETING,
    ROWS,
    Drive,
    F,
    G,
    H,
    Hold,
    Numbers,
    numbers_of,
)
from crosscheck.engines.spatial.turning import about_z, common_columns
from refkin.joints import GROUND, SI, Constraint
from refkin.model import Mechanism

Array = Any
HELD = {(F, H): 4, (G, H): 3, (F, G): 5, (H, H): 5}
"""Which axis of a generic joint holds f, g or h of i across one of j."""
NO_TWIST = "of a turn the adapter takes f_i . g_j alone, which says how far it is only where the axes are parallel"
FORM = "dot"
"""The form of our joints of space that has exudyn's rows."""
STRAIGHT = np.eye(3)
STILL = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
STILL_TERMS = tuple(
    Term(
        name="parameters from still",
        level=level.value,
        reason="a node's parameters are added to those of its reference: of e0 = (e0 - 1) + 1 one rounding is lost, "
        "|dA/de0| = 2, two bodies; of rates by what is turned, and by omega = 2 G p'",
        absolute=absolute * 2.0**-53,
        relative=relative * 2.0**-53,
    )
    for level, absolute, relative in (
        (Level.RESIDUAL, 4.0, 0.0),
        (Level.JACOBIAN, 4.0, 0.0),
        (Level.CONSTRAINT_VELOCITY, 0.0, 6.0),
        (Level.DRIFT, 0.0, 8.0),
    )
)
"""What rows of turns lose by that: of rates 2 + 1 roundings for each body, of drift terms 2 + 2."""


@dataclass(frozen=True, kw_only=True)
class SpatialRow(ExudynRow):
    """A row of a joint, or of the driver of one, which sets the frame of a marker."""

    hold: Hold
    drive: Drive | None = None
    marker: Any = None


class ExudynSpace(ExudynSystem):
    """A mechanism in exudyn at configurations that need not be assembled; lengths in the numbers' unit.

    `lines` are its rows, in the order of ours: joints, then drivers.
    """

    def __init__(self, numbers: Numbers, holds: Sequence[Hold], drives: Sequence[Drive]) -> None:
        super().__init__()
        self.numbers = numbers
        self.bodies = {GROUND: self.mbs.AddObject(item.ObjectGround())}
        for body in numbers.bodies:
            node = self.mbs.AddNode(item.NodeRigidBodyEP(referenceCoordinates=STILL.tolist()))
            rigid = item.ObjectRigidBody(nodeNumber=node, mass=0.0, inertia=[0.0] * 6)
            self.bodies[body] = self.mbs.AddObject(rigid)
        self.lines: list[SpatialRow] = []
        self.read = Readings(self.mbs, self.bodies)
        for hold in holds:
            self._joint(hold)
        for drive in drives:
            self._driver(drive)
        self.mbs.Assemble()
        self.begin(redundant=True)  # rows may depend on each other, spins idle
        self.live = [list(self.data.GetObjectLTGAE(line.item))[line.own] for line in self.lines]
        self.driven = [(k, line, line.drive) for k, line in enumerate(self.lines) if line.drive is not None]
        meeting = [(k, line) for k, line in enumerate(self.lines) if line.what == "d"]
        self._others = [pair for pair in enumerate(self.lines) if pair[1].what != "d"]
        self._meeting, self._ends = [k for k, _ in meeting], self.read.ends([line for _, line in meeting])
        self._factors = np.array([line.factor for _, line in meeting])
        self.t, self.f = np.nan, [np.nan] * len(self.driven)
        self.still, self.no_forces = np.tile(STILL, len(numbers.bodies)), np.zeros(self.m)

    # building

    def _markers(self, hold: Hold, i: Any = STRAIGHT, j: Any = STRAIGHT) -> list[Any]:
        """Return markers at the ends of a joint, with frames i and j."""
        frames = zip(hold.bodies, (i, j), strict=True)
        ends = [(self.bodies[b], HT(rotation=frame, translation=hold.end(b)[0])) for b, frame in frames]
        return [self.mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=body, localHT=at)) for body, at in ends]

    def _generic(self, markers: list[Any], axis: int) -> Any:
        """Add a generic joint that holds one axis between markers."""
        held = [int(k == axis) for k in range(6)]
        return self.mbs.AddObject(item.ObjectJointGeneric(markerNumbers=markers, constrainedAxes=held))

    def _add(self, hold: Hold, number: Any, which: Sequence[int] = (), **more: Any) -> None:
        """Take in a row of a joint, or of a driver, as a row of an exudyn object; of axes it is about these columns."""
        frames, ends = (hold.frame_i, hold.frame_j), tuple((b, tuple(map(float, hold.end(b)[0]))) for b in hold.bodies)
        axes = tuple(frame[:, k] for frame, k in zip(frames, which, strict=False))
        line = SpatialRow(**{"name": hold.name, "hold": hold, "item": number, "ends": ends, "axes": axes, **more})
        self.lines.append(line)
        self.read.ask(line)

    def _joint(self, hold: Hold) -> None:
        if hold.kind in COUNTED | {JointKind.OTHER}:
            raise EngineRefusal(f"exudyn refuses {hold.kind} {hold.name!r}: the adapter makes no such joint")
        ours = iter(hold.rows)

        def add(number: Any, own: int, what: tuple[Any, ...], factor: float = 1.0) -> None:
            said: dict[str, Any] = {"component": what[1]} if what[0] == "d" else {"which": what[1:]}
            form = Length(hold.length) if what[0] == "length" else Linear()
            self._add(hold, number, row=next(ours), own=own, what=what[0], factor=factor, form=form, **said)

        if hold.kind == JointKind.REVOLUTE:
            markers = self._markers(hold, hold.frame_i, hold.frame_j)[::-1]
            revolute = self.mbs.AddObject(item.ObjectJointRevoluteZ(markerNumbers=markers))
            for k in range(3):
                add(revolute, k, ("d", k), -1.0)
            add(revolute, 3, ("dot", F, H))
            add(revolute, 4, ("dot", G, H))
            return
        if hold.kind in MEETING:
            meeting = self.mbs.AddObject(item.ObjectJointSpherical(markerNumbers=self._markers(hold)))
            for k in range(3):
                add(meeting, k, ("d", k))
        if hold.kind == JointKind.DISTANCE:
            rod = item.ObjectConnectorDistance(markerNumbers=self._markers(hold), distance=hold.length)
            add(self.mbs.AddObject(rod), 0, ("length",))
        for what in ROWS.get(JointKind.TURN if hold.kind == JointKind.TWIST else hold.kind, ()):
            own, i, j = HELD[what[1:]] if what[0] == "dot" else what[1], hold.frame_i, hold.frame_j
            if what == CROSSED:
                i, j = i[:, [H, F, G]], j[:, [G, H, F]]
            add(self._generic(self._markers(hold, i, j), own), own, what)

    def _driver(self, drive: Drive) -> None:
        hold = drive.hold
        markers = self._markers(hold, hold.frame_i, hold.frame_j)
        more: dict[str, Any] = {"name": drive.name, "row": drive.row, "drive": drive, "marker": markers[0]}
        if drive.kind == JointKind.DISTANCE:
            rod = self.mbs.AddObject(item.ObjectConnectorDistance(markerNumbers=markers, distance=1.0))
            self._add(hold, rod, what="length", law=0, **more)
        elif drive.kind == JointKind.ANGLE:
            self._add(hold, self._generic(markers[::-1], 5), own=5, what="dot", which=(G, F), **more)
        elif drive.kind == JointKind.DISPLACEMENT:
            self._add(hold, self._generic(markers, 2), own=2, what="along", which=(H,), **more)
        else:
            raise EngineRefusal(f"exudyn refuses driver {drive.name!r} of type {drive.kind!r}")

    # states

    def set_state(self, q: Array, t: float, qd: Array | None = None) -> None:
        """Put exudyn at coordinates (r, p) of each body, their rates and a time."""
        self.set_time(t)
        self.data.SetODE2Coordinates(q - self.still, CURRENT)
        if qd is not None:
            self.data.SetODE2Coordinates_t(qd, CURRENT)
        self.data.SetAECoordinates(self.no_forces, CURRENT)

    def set_time(self, t: float) -> None:
        """Put what laws move at a time."""
        if t == self.t:
            return
        self.t = np.nan  # a length that exudyn does not take leaves the others set
        self.f = [float(drive.value(t)) for _, _, drive in self.driven]
        for f, (_, line, _) in zip(self.f, self.driven, strict=True):
            if line.what == "length":
                self.set_length(line.item, line.name, t, abs(f))
            else:
                frame, place = line.hold.frame_i, line.hold.u_i
                frame, place = (frame @ about_z(f), place) if line.what == "dot" else (frame, place + f * frame[:, H])
                self.mbs.SetMarkerParameter(line.marker, "localHT", HT(rotation=frame, translation=place))
        self.t = t

    def coordinates(self) -> Array:
        """Return where exudyn is."""
        q: Array = self.data.GetODE2Coordinates(CURRENT) + self.still
        return q

    # rows

    def lengths(self) -> Sequence[tuple[int, float]]:
        moved = zip(self.f, self.driven, strict=True)
        return [(self.live[k], abs(f)) for f, (k, line, _) in moved if line.what == "length"]

    def residual(self, q: Array, t: float) -> Array:
        """Return its rows (m,) at a configuration; that of a driven distance as (d . d - f^2) / 2."""
        self.set_state(q, t)
        return self.squared(self.equations())[self.live]

    def jacobian(self, q: Array, t: float) -> Array:
        """Return its Jacobian (m, 6 b) in columns (v, w) of each body."""
        return self.both(q, t)[1] @ common_columns(q)

    def both(self, q: Array, t: float) -> tuple[Array, Array]:
        """Return rows (m,) and their Jacobian (m, 7 b) at a configuration, in columns that are exudyn's own."""
        self.set_state(q, t)
        rows = self.equations()
        slopes = self.slopes(rows)[self.live]
        return self.squared(rows)[self.live], slopes

    def constraint_velocity(self, q: Array, qd: Array, t: float) -> Array:
        """Return the rates of its rows (m,), with what laws add."""
        self.set_state(q, t, qd)
        return self.times_lengths(self.equations(of_velocity=True))[self.live] + self.law_rates(t)

    def law_rates(self, t: float) -> Array:
        """Return what laws add to the rates of rows (m,) where it stands: exudyn knows no rate of what is set."""
        out = np.zeros(len(self.lines))
        for f, (k, line, drive) in zip(self.f, self.driven, strict=True):
            fd = drive.value(t, 1)
            if line.what == "length":
                out[k] = -f * fd
            elif line.what == "along":
                out[k] = -fd
            else:  # g_i turned by f, times f_j: the rate of the turned vector is minus f_i turned
                frame = self._turned(line.hold.body_i) @ line.hold.frame_i @ about_z(f)
                out[k] = -fd * (frame[:, F] @ self._turned(line.hold.body_j) @ line.hold.frame_j[:, F])
        return out

    def drifts(self, q: Array, qd: Array, t: Array) -> Array:
        """Return gamma (B, m) in columns (v, w): minus the second derivative of rows while v and w stay as they are.

        What is read of points and axes is where bodies are, whatever the time.
        """
        states = []
        for at, rate in zip(q - self.still, qd, strict=True):
            self.data.SetODE2Coordinates(at, CURRENT)
            self.data.SetODE2Coordinates_t(rate, CURRENT)
            states.append(self.read.now())
        self.read.keep(states)
        out, (i, j) = np.empty((len(t), len(self.lines))), map(self.read.at, self._ends)
        out[:, self._meeting] = (i - j) * self._factors  # of points that meet, most rows: all together
        for k, line in self._others:
            out[:, k] = -self._bend(line, t)
        return out

    def _bend(self, line: SpatialRow, t: Array) -> Array:
        """Return the second derivatives (B,) of one row."""
        hold = line.hold
        f = [0.0 * t if line.drive is None else line.drive.value(t, k) for k in range(3)]
        if line.drive is None or line.what != "dot":
            return line.factor * self.read.bend(line, f)
        frame = hold.frame_i @ about_z(f[0])
        x, y = (self.read.axis(hold.body_i, frame[..., k]) for k in (G, F))  # x' loses f' y, y' gains f' x
        f1, f2 = f[1][:, None], f[2][:, None]
        turned = (x[0], x[1] - f1 * y[0], x[2] - 2.0 * f1 * y[1] - f2 * y[0] - f1**2 * x[0])
        return product(turned, self.read.axis(hold.body_j, line.axes[1]))

    def _turned(self, body: str) -> Array:
        if body == GROUND:
            return np.eye(3)
        return self.mbs.GetObjectOutputBody(self.bodies[body], OUT.RotationMatrix).reshape(3, 3)


class ExudynSpaceRows(ExudynSpace):
    """exudyn's rows for some joints and drivers of a mechanism, in metres: a `ConstraintModel` in the form `dot`."""

    owns_driver = True
    form = FORM

    def __init__(self, mechanism: Mechanism, constraints: Sequence[Constraint]) -> None:
        numbers, known = numbers_of(mechanism, SI), {c.name for c in constraints}
        holds = [hold for hold in numbers.holds if hold.name in known]
        # the driver of turns that count has a coordinate for them, which the adapter makes none of
        counted = {d.name for d in numbers.drives if d.hold.name in numbers.counted and d.kind == JointKind.ANGLE}
        drives = [d for d in numbers.drives if d.name in known - counted]
        super().__init__(numbers, holds, drives)
        self.rows: Sequence[RowMap] = tuple(
            RowMap(constraint=line.name, row=line.row, engine_row=k, factor=line.factor, form=line.form)
            for k, line in enumerate(self.lines)
        )
