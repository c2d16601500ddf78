"""Spatial linkages in closed form, body by body: circle or line against sphere, cone against plane, in jets.

A body that a driver or a fixed joint holds is placed at once. One that is free to turn about a line, or to slide along
it, is placed by what else it hangs on. Turned by psi, every such condition is P cos psi + Q sin psi = K:

* a distance, or a body with joints at either end (S-S link, rods, couplers): circle against sphere;
* axes at right angles (universal joints), a point in a plane: a cone against a plane;
* of a coupler with turning joints also the angle between its axes, and shifts along them: what makes a Bennett linkage.

Two conditions that differ say cos psi and sin psi at once. One has two roots,

    (cos, sin) = (P K -+ Q S, Q K +- P S) / (P^2 + Q^2),   S^2 = P^2 + Q^2 - K^2,

of which the estimate chooses one at the first time; it is kept. Slid by s, a distance is a line against a sphere,
s = w.u +- sqrt(L^2 - w.w + (w.u)^2). A body of which two points are placed turns about the line of the two; if nothing
else holds it, it is passive, and its spin is left as it comes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from crosscheck.engines.closed_form.jets import Arithmetic, Jet, midpoint, on_circle
from crosscheck.engines.closed_form.laws import law_jet
from crosscheck.engines.closed_form.space_vectors import (
    Condition,
    Frame,
    Turning,
    Vector,
    basis,
    composed,
    least_squares,
    together,
)
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.reading import AXIAL, MEETING, Given, given, numbers_of
from crosscheck.engines.spatial.turning import matrix
from refkin.joints import GROUND, GearedTurns, elements_of
from refkin.model import Scene

ALIKE = 1e-10
"""Conditions whose coefficients are smaller than this part of a size say nothing; two whose directions differ by less
than its root say the same."""
CROSSED = (JointKind.UNIVERSAL, JointKind.PERPENDICULAR)
PARTS = (JointKind.ORIENTATION, JointKind.TURN, JointKind.TWIST, JointKind.THREAD, JointKind.OTHER)
LEAST_FREE_FIRST = (
    JointKind.FIXED, JointKind.SCREW, JointKind.REVOLUTE, JointKind.PRISMATIC, JointKind.CYLINDRICAL
)  # fmt: skip
BETWEEN = np.linspace(0.0, 1.0, 17)[1:-1]


class NotPlaced(Exception):
    """A linkage whose bodies do not follow one from another."""


@dataclass(frozen=True)
class KinematicPair:
    """A joint, or a driver that holds a distance, seen from either body: points, frames (f, g, h), numbers, laws."""

    kind: JointKind
    name: str
    bodies: tuple[str, str]
    points: tuple[Vector, Vector]
    frames: tuple[Any, Any]
    length: Jet
    pitch: Jet
    shift: Jet
    angle: Jet | None = None
    displacement: Jet | None = None

    def side(self, body: str) -> int:
        """Return 0 for body i, 1 for body j."""
        return self.bodies.index(body)

    def other(self, body: str) -> str:
        """Return the other body."""
        return self.bodies[1 - self.side(body)]


@dataclass
class Root:
    """A root that was chosen: of what, and of which share of the term that another is taken from, over the times."""

    square: Jet
    share: Jet


@dataclass
class SpatialAssembly:
    """Bodies of a scene of space placed one after another; each whose root has to be chosen needs an estimate."""

    scene: Scene
    arithmetic: Arithmetic
    choices: dict[tuple[str, str], int] = field(default_factory=dict)
    placed: dict[str, Frame] = field(default_factory=dict)
    points: dict[tuple[str, int], Vector] = field(default_factory=dict)
    roots: list[Root] = field(default_factory=list)

    def __post_init__(self) -> None:
        unit: Any = self.scene.mechanism.unit()
        self.size, self.origin = unit.size, unit.origin
        self.count = len(self.scene.times)
        self.placed[GROUND] = Frame(*(self.vector(v) for v in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))))
        self.estimates = {body.name: body.estimate for body in self.scene.mechanism.bodies}

    def number(self, value: float) -> Jet:
        """Return a constant."""
        return Jet(self.arithmetic.number(value))

    def vector(self, values: Sequence[float]) -> Vector:
        """Return a constant vector."""
        return Vector(*(self.number(v) for v in values))

    @cached_property
    def passive(self) -> tuple[dict[str, Any], ...]:
        """The bodies of each spin that moves nothing else."""
        return numbers_of(self.scene.mechanism).passive

    @cached_property
    def pairs(self) -> list[KinematicPair]:
        """The joints, with the laws of their drivers, and the distances that drivers hold."""
        conditions = list(given(self.scene.mechanism))
        known = Counter(g.name for g in conditions if g.kind not in PARTS)
        strange = [g.name for g in conditions if known[g.name] != 1]
        if strange:
            raise NotPlaced(f"{strange[0]}: no equations here for the elements that it consists of, taken together")
        laws: dict[tuple[str, str], Jet] = {(g.joint, g.kind): self._law(g) for g in conditions if g.joint}
        self._turn_in_gear(laws)
        return [self._pair(g, laws) for g in conditions if not g.joint]

    def _turn_in_gear(self, laws: dict[tuple[str, str], Jet]) -> None:
        """Add the angles of joints in gear, each from that of the other joint, to those that drivers prescribe."""
        waiting = [e for e in elements_of(self.scene.mechanism.constraints) if isinstance(e, GearedTurns)]
        while waiting:
            ends = [((e.joint_i, e.radius_i, e.phi0_i), (e.joint_j, e.radius_j, e.phi0_j)) for e in waiting]
            known = [[(name, JointKind.ANGLE) in laws for name, *_ in pair] for pair in ends]
            k = next((k for k, which in enumerate(known) if any(which)), None)
            if k is None or all(known[k]):
                raise NotPlaced(f"{waiting[k or 0].name}: not one of two angles in gear is known, but none or both")
            (name, radius, zero), (other, of_other, its_zero) = ends[k] if known[k][0] else ends[k][::-1]
            turned = (laws[name, JointKind.ANGLE] - self.number(zero)) * self.number(radius) / self.number(of_other)
            laws[other, JointKind.ANGLE] = self.number(its_zero) - turned
            del waiting[k]

    def _law(self, g: Given) -> Jet:
        jet = law_jet(g.laws[0], self.scene.times, self.arithmetic)
        return jet if g.kind is JointKind.ANGLE else jet.times(self.arithmetic.number(1.0 / self.size))

    def _pair(self, g: Given, laws: Mapping[tuple[str, str], Jet]) -> KinematicPair:
        scale = self.arithmetic.number(1.0 / self.size)  # a power of two
        points, frames = [], list[Any]()
        for body, point, axis, zero in zip(g.bodies, g.points, g.axes, g.zeros, strict=True):
            at = self.vector((0.0, 0.0, 0.0) if point is None else point)
            at = at - self.vector(self.origin) if body == GROUND and point is not None else at
            points.append(Vector(*(x.times(scale) for x in (at.x, at.y, at.z))))
            across = np.eye(3)[int(np.argmin(np.abs(axis or (0.0, 0.0, 1.0))))].tolist() if zero is None else zero
            frames.append(None if axis is None else basis(self.vector(axis), self.vector(across)))
        length, pitch, shift = (self.number(x).times(scale) for x in (g.length, g.pitch, g.shift))
        return KinematicPair(
            kind=g.kind,
            name=g.name,
            bodies=g.bodies,
            points=(points[0], points[1]),
            frames=(frames[0], frames[1]),
            length=self._law(g) if g.laws else length,
            pitch=pitch,
            shift=shift,
            angle=laws.get((g.name, JointKind.ANGLE)),
            displacement=laws.get((g.name, JointKind.DISPLACEMENT)),
        )

    # deductions

    def run(self) -> dict[str, Frame]:
        """Return every body on the ground; NotPlaced if they do not follow one from another."""
        names = [body.name for body in self.scene.mechanism.bodies]
        while len(self.placed) <= len(names):
            if not any(self._deduce(body) for body in names if body not in self.placed):
                lost = ", ".join(name for name in names if name not in self.placed)
                raise NotPlaced(f"{lost}: no circle, line or plane that meets a sphere places it")
        return self.placed

    def _deduce(self, body: str) -> bool:
        """Place a body, or a point of it, if what is placed says where it is."""
        ends = [pair for pair in self.pairs if body in pair.bodies and self._known(pair, body) is not None]
        if len({tuple(pair.points[pair.side(body)].part("v", 1)[:, 0]) for pair in ends}) > 2:
            raise NotPlaced(f"{body}: more points are held than the two that place it, by rows that may differ")
        near = [t for t in self.pairs if body in t.bodies and t.other(body) in self.placed]
        for pair in [t for kind in LEAST_FREE_FIRST for t in near if t.kind is kind]:
            freedom = self._freedom(pair, body)
            if isinstance(freedom, Frame):
                self.placed[body] = freedom
                return True
            if isinstance(freedom, Turning) and self._solved(body, freedom, pair):
                return True
            if isinstance(freedom, tuple) and self._slid(body, pair, *freedom):
                return True
        return self._between_points(body)

    def _freedom(self, pair: KinematicPair, body: str) -> Any:
        """Return a body as one pair holds it: placed, Turning, or (placed but for a shift, unit vector, its circle)."""
        side = pair.side(body)
        base, sign = self.placed[pair.other(body)], self.number(1.0 if side == 1 else -1.0)
        f, g, h = (base.turned(v) for v in pair.frames[1 - side])
        at, own = base.point(pair.points[1 - side]), pair.frames[side]
        angle, shift = pair.angle, pair.displacement
        if pair.kind is JointKind.SCREW:
            if angle is None and shift is not None:
                angle = (shift - pair.shift) / pair.pitch
            if angle is None:
                return None
            shift = pair.pitch * angle + pair.shift
        if pair.kind in (JointKind.PRISMATIC, JointKind.FIXED):
            angle = self.number(0.0)
        if pair.kind in (JointKind.REVOLUTE, JointKind.FIXED):
            shift = self.number(0.0)
        if shift is None and (pair.name, side) in self.points:
            shift = h.dot(self.points[pair.name, side] - at) * sign
        cos, sin = (self.number(1.0), self.number(0.0)) if angle is None else angle.cos_sin()
        sin = sin * sign
        axes = (f.scaled(cos) + g.scaled(sin), g.scaled(cos) - f.scaled(sin), h)
        frame = composed(at, axes, pair.points[side], own)
        if shift is None:
            return frame, h, angle is None
        frame = frame.moved(h.scaled(shift * sign))
        return Turning(frame, at, h) if angle is None else frame

    def _solved(self, body: str, turning: Turning, held_by: KinematicPair | None) -> bool:
        """Place a body that turns, from conditions P cos + Q sin = K, if these say enough."""
        rows = self._conditions(body, turning, held_by)
        clear = [row for row in rows if float(np.min(np.hypot(midpoint(row[0].v), midpoint(row[1].v)))) > ALIKE]
        if len(clear) > 1 and together(clear) > np.sqrt(ALIKE):
            cos, sin = least_squares(clear)
        elif clear:
            cos, sin = self._root(body, turning, *clear[0])
        else:
            return False
        self.placed[body] = turning.at(*on_circle(cos, sin))
        return True

    def _root(self, body: str, turning: Turning, p: Jet, q: Jet, k: Jet) -> tuple[Jet, Jet]:
        whole = p * p + q * q
        square = whole - k * k
        self.roots.append(Root(square, square / whole))
        half = _root(square)
        roots = [((p * k - q * s) / whole, (q * k + p * s) / whole) for s in (half, -half)]
        return roots[self._chosen(body, "turned", [turning.at(*pair) for pair in roots])]

    def _chosen(self, body: str, how: str, both: Sequence[Frame]) -> int:
        """Return 0 for the first of two frames if it is nearer the body's estimate at the first time, else 1."""
        if (body, how) not in self.choices:
            estimate = self.estimates[body]
            if estimate is None:
                raise NotPlaced(f"{body} has no estimate, and two assemblies")
            place = (np.array(estimate[:3]) - self.origin) / self.size
            turned = matrix(estimate[3:])
            off = []
            for frame in both:
                there = [v.part("v", self.count)[:, 0] for v in (frame.origin, frame.x, frame.y, frame.z)]
                off.append(np.linalg.norm(there[0] - place) + np.linalg.norm(np.stack(there[1:], axis=1) - turned))
            self.choices[body, how] = int(off[1] < off[0])
        return self.choices[body, how]

    def _conditions(self, body: str, turning: Turning, held_by: KinematicPair | None) -> Iterator[Condition]:
        """Yield P, Q, K of what else a body that turns hangs on, directly or by one body between."""
        for pair in self.pairs:
            if pair is held_by or body not in pair.bodies:
                continue
            side, other = pair.side(body), pair.other(body)
            if other in self.placed:
                yield from self._direct(pair, side, turning, self.placed[other])
            else:
                yield from self._by_link(pair, side, other, turning)

    def _direct(self, pair: KinematicPair, side: int, turning: Turning, base: Frame) -> Iterator[Condition]:
        point, there = turning.point(pair.points[side]), base.point(pair.points[1 - side])
        if pair.kind is JointKind.DISTANCE:
            yield point.on_sphere(there, pair.length)
        if pair.kind in MEETING:
            for axis in (base.x, base.y, base.z):
                yield point.in_plane(axis, axis.dot(there))
        if pair.frames[0] is None:
            return
        own, their = turning.direction(pair.frames[side][2]), base.turned(pair.frames[1 - side][2])
        if pair.kind in AXIAL:
            for axis in (base.x, base.y, base.z):
                yield own.in_plane(axis, axis.dot(their))
        if pair.kind in CROSSED:
            yield own.in_plane(their, self.number(0.0))
        if pair.kind is JointKind.ON_PLANE and side == 1:
            yield point.in_plane(their, their.dot(there))
        if pair.kind is JointKind.ON_PLANE and side == 0:
            yield own.in_plane(there - turning.foot, own.still.dot(point.still - turning.foot) + own.c.dot(point.c))

    def _by_link(self, pair: KinematicPair, side: int, link: str, turning: Turning) -> Iterator[Condition]:
        """Yield what a body between this one and a placed one says: the distance of its points, and of its axes."""
        for far in self._beyond(pair, link):
            base, mine, its = self.placed[far.other(link)], pair.side(link), far.side(link)
            point, there = turning.point(pair.points[side]), base.point(far.points[1 - its])
            arm = pair.points[mine] - far.points[its]
            yield point.on_sphere(there, arm.dot(arm).sqrt())
            if far.kind is JointKind.REVOLUTE:
                axis, own = base.turned(far.frames[1 - its][2]), far.frames[its][2]
                yield point.in_plane(axis, axis.dot(there) + own.dot(arm))
                if pair.kind is JointKind.REVOLUTE:
                    yield turning.direction(pair.frames[side][2]).in_plane(axis, own.dot(pair.frames[mine][2]))
            if pair.kind is JointKind.REVOLUTE:
                own = turning.direction(pair.frames[side][2])
                constant = own.still.dot(point.still - turning.foot) + own.c.dot(point.c)
                yield own.in_plane(there - turning.foot, constant - pair.frames[mine][2].dot(arm))

    def _slid(self, body: str, pair: KinematicPair, frame: Frame, axis: Vector, turns: bool) -> bool:
        """Place a body that slides, or where the point of one that also turns about the line of sliding is."""
        side = pair.side(body)
        for other in self.pairs:
            if other is pair or body not in other.bodies:
                continue
            for point, there, length in self._reach(other, body, frame):
                arm = point - there
                across = arm - axis.scaled(axis.dot(arm))
                off = point - frame.point(pair.points[side])
                if turns and np.max(np.abs((off - axis.scaled(axis.dot(off))).part("v", self.count))) > ALIKE:
                    continue
                along, square = axis.dot(arm), length * length - across.dot(across)
                self.roots.append(Root(square, square / (length * length)))
                half = _root(square)
                moved = [frame.moved(axis.scaled(s - along)) for s in (half, -half)]
                frame = moved[self._chosen(body, "slid", moved)]
                if turns:
                    self.points[pair.name, side] = frame.point(pair.points[side])
                    self._solved(body, self._freedom(pair, body), pair)
                else:
                    self.placed[body] = frame
                return True
        return False

    def _reach(self, pair: KinematicPair, body: str, frame: Frame) -> Iterator[tuple[Vector, Vector, Jet]]:
        """Yield a point of a body, where what holds it is, and the distance of the two."""
        side, other = pair.side(body), pair.other(body)
        point = frame.point(pair.points[side])
        if pair.kind is JointKind.DISTANCE and other in self.placed:
            yield point, self.placed[other].point(pair.points[1 - side]), pair.length
        if other in self.placed:
            return
        for far in self._beyond(pair, other):
            arm = pair.points[pair.side(other)] - far.points[far.side(other)]
            there = self.placed[far.other(other)].point(far.points[1 - far.side(other)])
            yield point, there, arm.dot(arm).sqrt()

    def _beyond(self, pair: KinematicPair, link: str) -> list[KinematicPair]:
        """Return the joints by whose point a body at the end of a pair hangs on a placed one, if it has a point."""
        there = [t for t in self.pairs if t is not pair and link in t.bodies and t.other(link) in self.placed]
        return [far for far in there if pair.kind in MEETING and far.kind in MEETING]

    def _between_points(self, body: str) -> bool:
        """Place a body of which two points are known; one that nothing else holds is passive, and turned anyhow."""
        known = [
            (pair, at) for pair in self.pairs if body in pair.bodies and (at := self._known(pair, body)) is not None
        ]
        for (one, p), (two, q) in combinations(known, 2):
            arm = two.points[two.side(body)] - one.points[one.side(body)]
            if np.min(midpoint(arm.dot(arm).v)) <= ALIKE:
                continue
            frame = composed(p, _across(q - p, self), one.points[one.side(body)], _across(arm, self))
            turning = Turning(frame, p, (q - p).unit())
            if not self._solved(body, turning, None):
                if not any(body in spin for spin in self.passive):
                    continue
                self.placed[body] = frame
            return True
        return False

    def _known(self, pair: KinematicPair, body: str) -> Vector | None:
        """Return where a joint's point on a body is, if the other body, or that point of it, is placed."""
        if pair.kind not in MEETING:
            return None
        other = pair.other(body)
        if other in self.placed:
            return self.placed[other].point(pair.points[1 - pair.side(body)])
        for (name, side), at in self.points.items():  # a point on the line along which the other body slides and turns
            held = next(t for t in self.pairs if t.name == name)
            if held.bodies[side] != other:
                continue
            local = pair.points[1 - pair.side(body)] - held.points[side]
            h = held.frames[side][2]
            off = local - h.scaled(h.dot(local))
            if np.max(np.abs(off.part("v", 1))) <= ALIKE:
                base = self.placed[held.bodies[1 - side]]
                return at + base.turned(held.frames[1 - side][2]).scaled(h.dot(local))
        return None


def _root(square: Jet) -> Jet:
    with np.errstate(all="ignore"):
        return square.sqrt()


def _across(line: Vector, assembly: SpatialAssembly) -> tuple[Vector, Vector, Vector]:
    """Return unit vectors along a line and across it, by the axis of the ground that is least along it each time."""
    values = np.abs(line.part("v", assembly.count))
    least = np.argmin(values, axis=0)
    rows = [assembly.arithmetic.row(tuple((least == k).astype(float).tolist())) for k in range(3)]
    f, g, h = basis(line, Vector(*(Jet(row) for row in rows)))
    return h, f, g
