"""The elements of joints as vector chains from body to body, and as relations between the angles of bodies.

A chain leads from the point of one body to the point of the other:

r_j + p_j e^(i phi_j) = r_i + p_i e^(i phi_i) + gap, with this gap:

===================== =================================================================================
points coincide       none; or the two laws
point on line         its offset, and an unknown length along the axis, which turns with body i
distance              a given length, or a law, in an unknown direction
coordinate            from the ground's origin: the law along one axis, an unknown length along the other
rolling on a line     an unknown length along the line, another across
===================== =================================================================================

Angles and rolling wheels make no chain, they relate angles; rolling on a line also relates its length to angles. A
contact on a general profile is refused: it moves along a curve. Bodies whose relative angle is known share one unknown
angle; the angle of those that the ground belongs to is none.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from crosscheck.engines import EngineRefusal
from crosscheck.engines.vector_loop.system import AngleRelation
from crosscheck.engines.vector_loop.vectors import LoopVector, Variable
from refkin import joints
from refkin.model import Mechanism, Scene
from refkin.motion_laws import Law

NOWHERE = complex(math.nan, math.nan)
Frame = tuple[complex, float]
"""Origin and angle [rad] of a body's frame."""


@dataclass(frozen=True)
class VectorChain:
    """From point p_i of body i by the gap to point p_j of body j; points in the bodies' own frames."""

    i: str
    p_i: complex
    j: str
    p_j: complex
    gap: tuple[LoopVector, ...]

    def turned_round(self) -> VectorChain:
        """Return the chain back."""
        return VectorChain(self.j, self.p_j, self.i, self.p_i, tuple(v.times(-1.0) for v in self.gap))


class Estimates:
    """The bodies' frames as the scene estimates them, in units of its size; NaN where it does not."""

    def __init__(self, scene: Scene) -> None:
        unit = scene.mechanism.unit()
        self.size, self.origin = unit.size, complex(*unit.origin)
        self._frames: dict[str, Frame] = {joints.GROUND: (0j, 0.0)}
        for body in scene.mechanism.bodies:
            e = body.estimate
            self._frames[body.name] = (NOWHERE, math.nan) if e is None else (self.local(joints.GROUND, e[:2]), e[2])

    def local(self, body: str, u: Any) -> complex:
        """Return a point of a body in its frame; on the ground counted from the origin."""
        return (complex(*u) - (self.origin if body == joints.GROUND else 0.0)) / self.size

    def frame(self, body: str) -> Frame:
        """Return origin and angle of a body."""
        return self._frames[body]

    def gap(self, chain: VectorChain) -> complex:
        """Return the estimated gap of a chain."""
        (r_i, phi_i), (r_j, phi_j) = self.frame(chain.i), self.frame(chain.j)
        return r_j + chain.p_j * cmath.exp(1j * phi_j) - r_i - chain.p_i * cmath.exp(1j * phi_i)


class VectorChains:
    """The vector chains and relations of a scene's joints; `guesses` has each unknown of theirs with its estimate."""

    def __init__(self, scene: Scene, angles: Mapping[str, Variable], estimates: Estimates) -> None:
        self._angles, self._estimates, self._t0 = angles, estimates, float(scene.times[0])
        self.guesses: dict[str, float] = {}
        self.relations: list[AngleRelation] = []
        self.chains = [chain for e in joints.elements_of(scene.mechanism.constraints) for chain in self._read(e)]

    def _read(self, e: joints.Element) -> Iterator[VectorChain]:
        if isinstance(e, joints.RelativeAngle):
            return
        if isinstance(e, joints.RollingWheels):
            size = self._estimates.size
            radii = {e.body_i: e.radius_i / size, e.body_j: e.radius_j / size}
            if e.carrier != joints.GROUND:
                radii[e.carrier] = -sum(radii.values())
            turning = tuple((radius, self._angles[body]) for body, radius in radii.items())
            self.relations.append(AngleRelation(turning, -(e.radius_i * e.zero_i + e.radius_j * e.zero_j) / size))
            return
        ends = [(joints.GROUND, 0j)] if isinstance(e, joints.PointCoordinate) else []
        ends += [(body, self._estimates.local(body, u)) for body, u in e.ends]
        (i, p_i), (j, p_j) = ends
        open_chain = VectorChain(i, p_i, j, p_j, ())
        yield VectorChain(i, p_i, j, p_j, self._gap(e, self._estimates.gap(open_chain)))

    def _gap(self, e: joints.Element, gap: complex) -> tuple[LoopVector, ...]:
        """Return what leads from point i to point j; `gap` is the estimated one."""
        size = self._estimates.size
        if isinstance(e, joints.PointsCoincide):
            return tuple(LoopVector(along, self._law(law)) for along, law in zip((1.0, 1j), e.laws, strict=False))
        if isinstance(e, joints.PointCoordinate):
            origin = self._estimates.origin
            along, shift = (1j, origin.imag) if e.axis else (1.0, origin.real)
            across = self._unknown(f"coordinate across {_called(e)}", (gap / (1j * along)).real)
            return LoopVector(along, self._law(e.laws[0], shift)), LoopVector(1j * along, across)
        if isinstance(e, joints.PointDistance):
            length, sign = Variable(e.length / size), 1.0
            if e.laws:
                length, sign = self._law(e.laws[0]), math.copysign(1.0, e.laws[0](self._t0))
            return (self._link(e, length, sign * gap),)
        if isinstance(e, joints.GuidedPoint):
            (x, y), slide = e.axis_i, self._slide(f"slide on {_called(e)}", e.body_i, e.axis_i, gap)
            aside = LoopVector(e.offset / size * complex(-y, x) / math.hypot(x, y), angle=self._angles[e.body_i])
            return (aside, slide) if e.offset else (slide,)
        if isinstance(e, joints.RollingOnLine):
            return self._rack(e, gap)
        raise EngineRefusal(
            f"vector_loop refuses {e.key} of {e.name!r}: no vector of given or sliding length stands for it"
        )

    def _link(self, e: joints.Element, length: Variable, gap: complex) -> LoopVector:
        return LoopVector(1.0, length, self._unknown(f"direction of {_called(e)}", math.atan2(gap.imag, gap.real)))

    def _slide(self, name: str, body: str, axis: joints.Pair, gap: complex) -> LoopVector:
        """Return a vector of unknown length along an axis of a body."""
        along = complex(*axis) / math.hypot(*axis)
        length = (gap * cmath.exp(-1j * self._estimates.frame(body)[1]) / along).real
        return LoopVector(along, self._unknown(name, length), self._angles[body])

    def _rack(self, e: joints.RollingOnLine, gap: complex) -> tuple[LoopVector, ...]:
        """Return slides along the axis and across; along - s0 - radius (phi_j - phi_i - phi0) = 0 is a relation."""
        size, (x, y) = self._estimates.size, e.axis_i
        along = self._slide(f"slide on {_called(e)}", e.body_i, (x, y), gap)
        across = self._slide(f"distance from {_called(e)}", e.body_i, (-y, x), gap)
        radius = e.radius / size
        turning = ((-radius, self._angles[e.body_j]), (radius, self._angles[e.body_i]))
        self.relations.append(AngleRelation(((1.0, along.length), *turning), radius * e.phi0 - e.s0 / size))
        return along, across

    def _law(self, law: Law, shift: float = 0.0) -> Variable:
        return Variable(-shift / self._estimates.size, laws=((1.0 / self._estimates.size, law),))

    def _unknown(self, name: str, guess: float) -> Variable:
        self.guesses[name] = guess
        return Variable(unknown=name)


def _called(e: joints.Element) -> str:
    """Return the joint's name, with the row of an element that is not its first: each has unknowns of its own."""
    return f"{e.name}, row {e.row}" if e.row else e.name


def angle_families(mechanism: Mechanism) -> tuple[dict[str, Variable], dict[str, tuple[str, ...]]]:
    """Return the angle of each body, ground included; and the bodies that share an unknown angle, by its name.

    EngineError if the difference of two angles is given twice.
    """
    left = [e for e in joints.elements_of(mechanism.constraints) if isinstance(e, joints.RelativeAngle)]
    angles: dict[str, Variable] = {}
    members: dict[str, tuple[str, ...]] = {}
    for root in (joints.GROUND, *(body.name for body in mechanism.bodies)):
        if root in angles:
            continue
        name = None if root == joints.GROUND else f"angle of {root}"
        angles[root], family = Variable(unknown=name), [root]
        for body in family:
            for e in [e for e in left if body in e.bodies]:
                left.remove(e)
                other = e.body_j if body == e.body_i else e.body_i
                if other in angles:
                    raise EngineRefusal(f"vector_loop refuses {e.name!r}: redundant, the angle of {other!r} is given")
                angles[other] = _carried(e, body, angles[body])
                family.append(other)
        if name is not None:
            members[name] = tuple(family)
    return angles, members


def _carried(e: joints.RelativeAngle, body: str, angle: Variable) -> Variable:
    """Return the angle of the other body from that of `body`, where phi_j = phi_i + what is given."""
    sign = 1.0 if body == e.body_i else -1.0
    laws = tuple((sign, law) for law in e.laws)
    return Variable(angle.constant + sign * e.angle, angle.unknown, (*angle.laws, *laws))
