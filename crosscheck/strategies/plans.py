"""Mechanisms in a plane of their own, and how they come to stand on the ground with a frame for every body."""

from __future__ import annotations

import cmath
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from refkin.joints import GROUND, Constraint, Pair, Prismatic, Revolute

Place = tuple[complex, float]
"""Origin and angle of a body."""


@dataclass(frozen=True)
class Plan:
    """A mechanism in its own plane: joints by their maker, poses by the angle of `driven`, and the closures' margin."""

    driven: str
    joints: Callable[[Frames], list[Constraint]]
    poses: Callable[[float], Mapping[str, Place]]
    margin: float
    longest: float


class Frames:
    """Where the plane lies on the ground, and where each body's frame lies on the body."""

    def __init__(self, origin: complex, angle: float, own: Mapping[str, tuple[complex, float]]) -> None:
        self.own = {GROUND: (-origin * cmath.exp(-1j * angle), -angle), **own}

    def point(self, side: str, body: str, u: complex) -> dict[str, Any]:
        """Return the keys of a point of a body, which stands at u in the body's plain frame."""
        at, angle = self.own[body]
        v = (u - at) * cmath.exp(-1j * angle)
        return {f"body_{side}": body, f"point_{side}": (v.real, v.imag)}

    def ends(self, i: str, p: complex, j: str, q: complex) -> dict[str, Any]:
        """Return the keys of the two points of a joint."""
        return {**self.point("i", i, p), **self.point("j", j, q)}

    def direction(self, body: str, e: complex) -> Pair:
        """Return a direction of a body."""
        v = e * cmath.exp(-1j * self.own[body][1])
        return v.real, v.imag

    def turned(self, body: str) -> float:
        """Return the angle of a body's frame against its plain one; on the ground against the plane."""
        return self.own[body][1]

    def apart(self, i: str, j: str) -> float:
        """Return what the frames add to the angle of j against i."""
        return self.turned(j) - self.turned(i)

    def on_ground(self, place: Place, body: str) -> tuple[float, float, float]:
        """Return the coordinates of a body, from its place in the plane."""
        (r, phi), (at, angle), (at_ground, ground) = place, self.own[body], self.own[GROUND]
        origin = (r + at * cmath.exp(1j * phi) - at_ground) * cmath.exp(-1j * ground)
        return origin.real, origin.imag, phi + angle - ground

    def pin(self, name: str, i: str, p: complex, j: str, q: complex = 0j) -> Revolute:
        """Return a revolute joint."""
        return Revolute(name=name, **self.ends(i, p, j, q))

    def guide(self, name: str, p: complex, e: complex, j: str) -> Prismatic:
        """Return a guide on the ground through p along e for the origin of a body, which does not turn."""
        axis = self.direction(GROUND, e)
        return Prismatic(name=name, **self.ends(GROUND, p, j, 0j), axis_i=axis, angle=self.apart(GROUND, j))
