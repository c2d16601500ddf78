"""Joints of the plane of every combination of elements, in both orders: solved, and answered by all engines."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Literal

import numpy as np
import pytest

from crosscheck.measure.check import check
from refkin import AngleDriver, Body, Mechanism, Revolute, Scene, Status
from refkin.joints import Distance, Element, Gear, Pair, PointOnLine, RelativeAngle
from refkin.joints.base import Blocks, Constraint, Rows
from refkin.joints.planar import BetweenPoints
from refkin.motion_laws import Polynomial
from refkin.system import compile_system
from refkin.vec import BodyValues

ENGINES = ("exudyn", "mujoco", "pinocchio", "vector_loop", "closed_form")


@dataclass(frozen=True, kw_only=True)
class Turn(Constraint):
    """phi_j - phi_i = angle."""

    rows = 1
    body_i: str
    body_j: str
    angle: float
    type: Literal["turn"] = "turn"

    def elements(self) -> Iterator[Element]:
        yield RelativeAngle(body_i=self.body_i, body_j=self.body_j, angle=self.angle)

    def constants(self, unit: Any) -> tuple[float, ...]:
        return (self.angle,)

    @staticmethod
    def residual(g: Any, f: Any, i: Any, j: Any) -> Rows:
        return (j.phi - i.phi - g[0],)

    @staticmethod
    def jacobian(g: Any, f: Any, i: Any, j: Any) -> Blocks:
        return ((0, 0, -1),), ((0, 0, 1),)

    @staticmethod
    def gamma(g: Any, f: Any, i: Any, j: Any) -> Rows:
        return (0,)


@dataclass(frozen=True, kw_only=True)
class Teeth(Gear):
    """A gear on the ground by formulas of the two wheels alone."""

    @staticmethod
    def residual(g: Any, f: Any, i: Any, j: Any) -> Rows:  # type: ignore[override]
        return Gear.residual(g, f, i, j, BodyValues(0.0, 0.0, 0.0))

    @staticmethod
    def jacobian(g: Any, f: Any, i: Any, j: Any) -> Blocks:  # type: ignore[override]
        return Gear.jacobian(g, f, i, j, BodyValues(0.0, 0.0, 0.0))[:2]


PARTS = {Revolute: 4, PointOnLine: 6, Distance: 6, Turn: 1, Teeth: 4}
"""Joints of one element each, and how many numbers their formulas have."""


@dataclass(frozen=True, kw_only=True)
class Joined(BetweenPoints):
    """What some joints of one element say, one after another."""

    axis_i: Pair
    length: float
    angle: float
    radius_i: float = 1.0
    radius_j: float = -2.0
    phi0_i: float
    phi0_j: float
    type: Literal["joined"] = "joined"
    parts: ClassVar[tuple[type[Constraint], ...]] = ()

    def own(self) -> Iterator[Constraint]:
        for part in self.parts:
            known = {field.name for field in fields(part)} & {field.name for field in fields(self)} - {"type"}
            yield part(**{key: getattr(self, key) for key in known})

    def elements(self) -> Iterator[Element]:
        for part in self.own():
            yield from part.elements()

    def constants(self, unit: Any) -> tuple[float, ...]:
        return tuple(number for part in self.own() for number in part.constants(unit))

    @classmethod
    def each(cls, name: str, g: Any, *more: Any) -> list[Any]:
        ends = list(itertools.accumulate((PARTS[part] for part in cls.parts), initial=0))
        numbers = [g[start:end] for start, end in itertools.pairwise(ends)]
        return [getattr(part, name)(own, *more) for part, own in zip(cls.parts, numbers, strict=True)]

    @classmethod
    def residual(cls, *at: Any) -> Rows:
        return tuple(row for rows in cls.each("residual", *at) for row in rows)

    @classmethod
    def jacobian(cls, *at: Any) -> Blocks:
        return tuple(
            tuple(row for rows in block for row in rows) for block in zip(*cls.each("jacobian", *at), strict=True)
        )

    @classmethod
    def gamma(cls, *at: Any) -> Rows:
        return tuple(row for rows in cls.each("gamma", *at) for row in rows)


def named(parts: Any) -> str:
    return "+".join(part.__name__ for part in parts)


def joint_of(parts: Any) -> type[Joined]:
    """Return the joint of some parts; engines are handed copies, so that it needs a name."""
    name = "Of" + "".join(part.__name__ for part in parts)
    if name not in globals():
        rows = sum(part.rows for part in parts)
        globals()[name] = type(name, (Joined,), {"parts": tuple(parts), "rows": rows, "__module__": __name__})
    return globals()[name]


def scene_of(parts: Any) -> Scene:
    """Return a crank with a part that hangs on it by the joint, and on the ground by rods."""
    along, off = (0.0 if Revolute in parts else 0.3), (0.0 if {Revolute, PointOnLine} & {*parts} else 0.4)
    crank, angle = 0.4, 0.5
    turn, axis = complex(math.cos(crank), math.sin(crank)), complex(2.0, 1.0) / abs(complex(2.0, 1.0))
    d = turn * axis * complex(along, off)
    at = turn * complex(0.8, 0.1) + d
    turned = turn * complex(math.cos(angle), math.sin(angle))
    place = at - turned * complex(0.2, -0.1)
    joint = joint_of(parts)(
        name="P", body_i="crank", point_i=(0.8, 0.1), axis_i=(2.0, 1.0), body_j="part", point_j=(0.2, -0.1),
        length=abs(d) or 1.0, angle=angle, phi0_i=crank, phi0_j=crank + angle,
    )  # fmt: skip
    pin = Revolute(name="O", body_i="ground", point_i=(0.0, 0.0), body_j="crank", point_j=(0.0, 0.0))
    ends = (((0.9, 0.2), 2.5), ((-0.3, 0.8), 2.5j), ((0.9, 0.2), -2.4j))
    feet = [place + turned * complex(*tip) + way for tip, way in ends]
    rods = [
        Distance(
            name=f"D{k}", body_i="ground", point_i=(foot.real, foot.imag), body_j="part", point_j=tip, length=abs(way)
        )
        for k, (foot, (tip, way)) in enumerate(zip(feet, ends, strict=True))
    ]
    motor = AngleDriver(name="motor", body="crank", law=Polynomial(coefficients=(crank, 0.5, 0.2)))
    poses = (0.0, 0.0, crank), (place.real, place.imag, crank + angle)
    bodies = tuple(
        Body(name=name, estimate=tuple(round(x, 2) for x in pose))
        for name, pose in zip(("crank", "part"), poses, strict=True)
    )
    system = compile_system(Mechanism(bodies, (pin, joint, *rods), (motor,)))
    slope = np.asarray(system.phi_q(np.concatenate(poses), 0.0), float)
    assert np.abs(system.phi(np.concatenate(poses), 0.0)).max() < 1e-14
    own = {p.constraint.name: slope[p.row : p.row + p.constraint.rows] for p in system.placed}
    held = np.concatenate([own[name] for name in ("O", "P", "motor")])
    sharp = {
        some: np.linalg.svd(np.concatenate([held, *(own[rod.name] for rod in some)]))[1][5]
        for some in itertools.combinations(rods, 6 - np.linalg.matrix_rank(held, 1e-9))
    }
    chosen = max(sharp, key=lambda some: sharp[some])
    mechanism = Mechanism(bodies, (pin, *chosen, joint), (motor,))
    return Scene(
        mechanism=mechanism, times=(0.0, 0.1), effects=frozenset({"velocity", "acceleration"}), name=named(parts)
    )


def apart(parts: Any) -> bool:
    """Whether parts exclude each other: points that meet and keep a distance, an angle and wheels while one turns."""
    return {Revolute, Distance} <= {*parts} or {Turn, Teeth} <= {*parts}


ORDERS = [
    order
    for n in range(1, len(PARTS) + 1)
    for parts in itertools.combinations(PARTS, n)
    if not apart(parts)
    for order in dict.fromkeys((parts, parts[::-1]))
]


@pytest.mark.parametrize("parts", ORDERS, ids=named)
def test_a_joint_of_any_planar_elements_is_solved_and_answered_by_every_engine_that_has_them(parts):
    redundant = {Revolute, PointOnLine} <= {*parts}  # vector loops refuse that, and exudyn's own settings stop there
    refused = ({"pinocchio"} if Teeth in parts else set()) | ({"vector_loop"} if redundant else set())

    record = check(scene_of(parts), ENGINES)

    assert record.reference.verdict == Status.OK
    seen = [d for d in record.disagreements if not (redundant and (d.method, d.quantity) == ("shipped", "status"))]
    assert [str(d) for d in seen] == []
    assert {answer.engine for answer in record.answers} - {"closed_form"} == {*ENGINES[:4]} - refused
    assert {answer.compared for answer in record.answers if not (redundant and answer.method.name == "shipped")} == {2}
