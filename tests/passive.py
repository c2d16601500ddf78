"""Loops of space whose coupler spins passively, alone or as several bodies: built where they close, in any frames."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from refkin.joints import (
    GROUND,
    Cylindrical,
    DisplacementDriver,
    Screw,
    SpatialAngleDriver,
    SpatialDistance,
    SpatialFixed,
    SpatialPrismatic,
    SpatialRevolute,
    Spherical,
    Universal,
)
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Polynomial


def turned(v, axis, angle):
    """Rodrigues' formula."""
    axis = axis / np.linalg.norm(axis)
    return v * np.cos(angle) + np.cross(axis, v) * np.sin(angle) + axis * (axis @ v) * (1 - np.cos(angle))


def rotation(p):
    e0, e = p[0], np.array(p[1:])
    cross = np.array([[0, -e[2], e[1]], [e[2], 0, -e[0]], [-e[1], e[0], 0]])
    return (e0 * e0 - e @ e) * np.eye(3) + 2 * np.outer(e, e) + 2 * e0 * cross


@dataclass
class Loop:
    """R-S-...-S-R at one pose: everything is given in the ground frame, and written in the frames of the bodies."""

    seed: Any
    forms: tuple[str, ...] = ("half",)
    far: float = 1.0
    joints: list[Any] = field(default_factory=list)
    drivers: list[Any] = field(default_factory=list)
    poses: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.draw = np.random.default_rng(self.seed)
        self.poses[GROUND] = np.zeros(3), np.array([1.0, 0, 0, 0])

    def vector(self, size=1.0):
        return self.draw.uniform(-size, size, 3)

    def across(self, axis):
        while True:
            v = self.vector()
            if np.linalg.norm(np.cross(v, axis)) > 0.3 * np.linalg.norm(axis):
                return v

    def end(self, side, body, point, axis=None, zero=None):
        if body not in self.poses:
            p = self.draw.normal(size=4)
            self.poses[body] = self.vector(self.far), p / np.linalg.norm(p)
        r, p = self.poses[body]
        a = rotation(p)
        fields = {f"body_{side}": body, f"point_{side}": tuple(((point - r) @ a).tolist())}
        for key, v in (("axis", axis), ("zero", zero)):
            if v is not None:
                fields[f"{key}_{side}"] = tuple((v @ a * self.draw.uniform(0.5, 2.0)).tolist())
        return fields

    def join(self, cls, i, j, at, axis=None, turn=0.0, shift=0.0, **more):
        """Join two bodies, j at random the first; zero j is `turn` further about the axis, point j `shift`."""
        zero = None if axis is None else self.across(axis)
        there, other = (
            (at, None) if axis is None else (at + shift * axis / np.linalg.norm(axis), turned(zero, axis, turn))
        )
        if cls in (SpatialRevolute, Cylindrical, SpatialPrismatic, SpatialFixed, Screw):
            more["form"] = str(self.draw.choice(self.forms))
        more.setdefault("name", f"j{len(self.joints)}")
        self.joints.append(cls(**self.end("i", i, at, axis, zero), **self.end("j", j, there, axis, other), **more))
        return more["name"]

    def ball(self, i, j, at):
        i, j = self.draw.permutation([i, j]).tolist()
        return self.join(Spherical, i, j, at)

    def drive(self, cls, joint, *law):
        self.drivers.append(cls(name=f"m{len(self.drivers)}", joint=joint, law=Polynomial(coefficients=law)))

    def scene(self, name, off=0.01, stop=0.1, count=3):
        bodies = []
        for body, (r, p) in self.poses.items():
            if body != GROUND:
                estimate = (*(r + self.vector(off)), *(p + self.draw.uniform(-off, off, 4)))
                bodies.append(Body(name=body, estimate=tuple(float(x) for x in estimate)))
        mechanism = Mechanism(tuple(bodies), tuple(self.joints), tuple(self.drivers))
        return Scene(mechanism=mechanism, times=tuple(np.linspace(0.0, stop, count).tolist()), name=name)


def rod(k, p, q):
    k.ball("a", "b", p), k.ball("b", "c", q)
    return ("b",)


def rod_with_ballast(k, p, q):
    rod(k, p, q)
    k.join(SpatialFixed, *k.draw.permutation(["b", "b2"]).tolist(), p + k.vector(), k.vector())
    return ("b and b2",)


def rod_of_two(k, p, q):
    """A ball on each of two bodies that are fixed to each other."""
    k.ball("a", "b", p), k.ball("b2", "c", q)
    k.join(SpatialFixed, "b", "b2", p + k.vector(), k.vector())
    return ("b and b2",)


def rod_of_three(k, p, q):
    k.ball("a", "b", p), k.ball("b3", "c", q)
    k.join(SpatialFixed, "b", "b2", p + k.vector(), k.vector())
    k.join(SpatialFixed, "b3", "b2", p + k.vector(), k.vector())
    return ("b and b2 and b3",)


def two_halves(k, p, q):
    """A hinge along the rod: each half spins on its own."""
    k.ball("a", "b", p), k.ball("b2", "c", q)
    k.join(SpatialRevolute, *k.draw.permutation(["b", "b2"]).tolist(), p + k.draw.uniform(0, 1) * (q - p), q - p)
    return ("b", "b2")


def two_halves_with_ballast(k, p, q):
    k.join(SpatialFixed, "b3", "b2", p + k.vector(), k.vector())
    two_halves(k, p, q)
    return ("b", "b2 and b3")


def driven_halves(k, p, q):
    """A motor in that hinge: the halves spin as one."""
    k.ball("a", "b", p), k.ball("b2", "c", q)
    k.drive(SpatialAngleDriver, k.join(SpatialRevolute, "b", "b2", (p + q) / 2, p - q, turn=0.4), 0.4, 1.0)
    return ("b and b2",)


def telescope(k, p, q):
    """A leg S-P-S, its slide along the line of the balls, or beside it."""
    k.ball("a", "b", p), k.ball("b2", "c", q)
    u, aside = (q - p) / np.linalg.norm(q - p), k.vector() * k.draw.integers(0, 2)
    k.drive(DisplacementDriver, k.join(SpatialPrismatic, "b", "b2", p + aside, u, shift=0.3), 0.3, 0.1)
    return ("b and b2",)


def cylinder(k, p, q):
    """A leg S-C-S: cylinder and piston spin each on its own."""
    k.ball("a", "b", p), k.ball("b2", "c", q)
    k.drive(DisplacementDriver, k.join(Cylindrical, "b", "b2", p, (q - p) / np.linalg.norm(q - p), shift=0.3), 0.3, 0.1)
    return ("b", "b2")


def jack(k, p, q):
    """A leg S-H-S, turned by a motor: its screw and nut spin as one."""
    k.ball("a", "b", p), k.ball("b2", "c", q)
    u = (q - p) / np.linalg.norm(q - p)
    k.drive(SpatialAngleDriver, k.join(Screw, "b", "b2", p, u, turn=0.5, shift=0.1, pitch=0.2), 0.5, 0.4)
    return ("b and b2",)


def pin_along(k, p, q):
    """A universal joint whose pin on the rod lies along it, and a ball; body c slides, too."""
    k.ball("b", "c", q)
    k.joints[1] = Cylindrical(**{key: v for key, v in vars(k.joints[1]).items() if key not in ("spacing", "type")})
    u = q - p
    across = np.cross(u, k.across(u))
    k.joints.append(Universal(name="U", **k.end("i", "a", p, across), **k.end("j", "b", p, u)))
    return ("b",)


def links(k, p, q):
    """A ball, and massless links from another point of the rod."""
    k.ball("a", "b", p)
    far = p + 0.6 * (q - p)
    for n, (body, at) in enumerate((("c", q), ("c", q + k.vector()), (GROUND, p + k.vector(2.0)))):
        ends = {**k.end("i", "b", far), **k.end("j", body, at)}
        k.joints.append(SpatialDistance(name=f"link{n}", **ends, length=float(np.linalg.norm(at - far))))
    return ("b",)


def held(k, p, q):
    """A motor in a hinge off the line, and a link from beside the line to the ground: nothing spins."""
    k.ball("a", "b", p), k.ball("b2", "c", q)
    at, far = (p + q) / 2 + k.vector(0.3), p + k.vector()
    k.drive(SpatialAngleDriver, k.join(SpatialRevolute, "b", "b2", at, k.vector(), turn=0.4), 0.4)
    side = k.across(q - p) + p
    ends = {**k.end("i", "b", side), **k.end("j", GROUND, far)}
    k.joints.append(SpatialDistance(name="link", **ends, length=float(np.linalg.norm(far - side))))
    return ()


SPINNING = (
    rod,
    rod_with_ballast,
    rod_of_two,
    rod_of_three,
    two_halves,
    two_halves_with_ballast,
    driven_halves,
    telescope,
    cylinder,
    jack,
    pin_along,
    links,
)


def loop(coupler, seed, forms=("half",), far=1.0, **more):
    """Return a loop with a coupler, and the bodies that spin in it, in words."""
    k = Loop((seed, len(coupler.__name__)), forms, far)
    o1, o2 = k.vector(far), k.vector(far)
    o2 = o1 + (o2 - o1) / np.linalg.norm(o2 - o1) * k.draw.uniform(2, 3)
    a1, a2 = k.vector(), k.vector()
    p = o1 + np.cross(a1, k.across(a1)) / np.linalg.norm(a1) + 0.2 * a1
    q = o2 + 1.5 * np.cross(a2, k.across(a2)) / np.linalg.norm(a2) - 0.2 * a2
    k.drive(SpatialAngleDriver, k.join(SpatialRevolute, GROUND, "a", o1, a1, turn=0.3, name="motor"), 0.3, 0.7, 0.1)
    k.join(SpatialRevolute, "c", GROUND, o2, a2)
    names = coupler(k, p, q)
    return k.scene(coupler.__name__, **more), {frozenset(name.split(" and ")) for name in names}


def sliding(cls, seed, wide, driven="crank"):
    """A loop R-S-S and a joint with an axis that is moved across itself; what is driven, and (D, rho, L, crank).

    D leads from the axis to the crank's end, or to its pivot where the crank is free, rho to the rod's other end.
    """
    k = Loop(seed, ("half", "dot", "printed"))
    o1, a1, a2 = k.vector(), k.vector(), k.vector()
    p = o1 + 0.5 * (across := np.cross(a1, k.across(a1))) / np.linalg.norm(across)
    q = p + (rod := k.vector()) / np.linalg.norm(rod)
    near = q + 0.4 * (across := np.cross(a2, k.across(a2))) / np.linalg.norm(across)
    crank = k.join(SpatialRevolute, GROUND, "a", o1, a1, turn=0.3)
    k.ball("a", "b", p), k.ball("b", "c", q)
    ends = k.draw.permutation([GROUND, "c"]).tolist()
    turn = {} if cls is SpatialPrismatic else {"turn": 0.2}
    name = k.join(cls, *ends, near, a2, shift=0.1, **turn, **({"pitch": 0.3} if cls is Screw else {}))
    k.drive(SpatialAngleDriver, crank if driven == "crank" else name, 0.3 if driven == "crank" else 0.2)
    if cls is Cylindrical:
        k.drive(SpatialAngleDriver, name, 0.2)
    u = a2 / np.linalg.norm(a2)
    away = np.cross(u, np.cross(p - near, u))
    away = -away / np.linalg.norm(away)
    side = "point_i" if ends[0] == GROUND else "point_j"
    at = tuple((np.array(getattr(k.joints[-1], side)) + wide * away).tolist())
    k.joints[-1] = replace(k.joints[-1], **{side: at})
    far = np.linalg.norm(np.cross((p if driven == "crank" else o1) - near - wide * away, u))
    return k.scene(cls.__name__, count=1), (far, 0.4, 1.0, 0.5)
