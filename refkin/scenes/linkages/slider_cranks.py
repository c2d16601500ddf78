"""The slider-crank, with its guide on the ground, and its inversion, with the guide on a lever."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from refkin.joints import GROUND, Constraint, Driver, PointOnLine, Prismatic, Revolute, XDriver, YDriver
from refkin.motion_laws import Law
from refkin.scenes.linkages.base import Linkage, Pose, law_keys
from refkin.scenes.linkages.closures import (
    Interval,
    between_circles,
    between_lines,
    direction_of,
    leg,
    link_to_line,
    shifted,
    two_links,
    two_links_margin,
)


@dataclass(frozen=True)
class SliderCrank(Linkage):
    """A slider-crank by its lengths [m]; the guide runs along x, `offset` above the crank pivot.

    Bodies crank (A0 A) and connecting_rod (A B), frames in the middle, and slider, frame at the wrist pin B. The
    position of the slider, as an input, is measured along the guide from the foot of the crank pivot. OPEN: with the
    crank as input, the rod points along the guide; with the slider as input, A lies to the left of the line from A0 to
    B.
    """

    crank: float
    rod: float
    offset: float = 0.0
    LENGTHS = ("crank", "rod")
    INPUTS = (("crank", GROUND), ("slider", GROUND), ("connecting_rod", GROUND), ("connecting_rod", "crank"))

    @property
    def slack(self) -> float:
        """|rod - crank| - |offset| [m], rounded once: its sign is exact; above 0 the shorter of the two turns fully."""
        return math.fsum((max(self.rod, self.crank), -min(self.rod, self.crank), -abs(self.offset)))

    def input_range(self, driven: str = "crank", relative_to: str = GROUND) -> tuple[Interval, ...]:
        """Return where the wrist pin, on its line, is in reach of crank and rod: in exact fractions of the lengths."""
        self._check_input(driven, relative_to)
        crank, rod, offset = Fraction(self.crank), Fraction(self.rod), Fraction(self.offset)
        if driven == "slider":
            return _slides(abs(crank - rod), crank + rod, abs(offset))
        if relative_to != GROUND:
            return shifted(between_circles(crank, rod, abs(offset), None), math.pi)
        held, free = (crank, rod) if driven == "crank" else (rod, crank)
        return shifted(between_lines(held, offset - free, offset + free), self.angle)

    def closure_margin(self, value: float, driven: str = "crank", relative_to: str = GROUND) -> float:
        """Return by how much crank and rod meet, or the rod's end passes the line of the wrist pin [m]."""
        self._check_input(driven, relative_to)
        if driven == "slider":
            return two_links_margin(math.hypot(value, self.offset), self.crank, self.rod)
        if relative_to != GROUND:
            return abs(self.crank + cmath.rect(self.rod, value)) - abs(self.offset)
        held, free = (self.crank, self.rod) if driven == "crank" else (self.rod, self.crank)
        return free - abs(self.offset - held * math.sin(value - self.angle))

    def transmission_angle(self, phi: float) -> float:
        """Return the angle between rod and normal of the guide at a crank angle [rad], in [0, pi].

        It is the same on both branches. The determinant of the loop equations in rod angle and slide is rod sin(mu), up
        to sign.
        """
        rise = self.offset - self.crank * math.sin(phi - self.angle)
        return math.atan2(leg(self.rod, rise), rise)

    def solve_loop(self, value: float, sign: int, driven: str, relative_to: str) -> tuple[float, float]:
        """Return the angles of crank and rod against the guide; sign as that of a `Branch`."""
        if driven == "slider":
            return two_links(complex(value, self.offset), self.crank, self.rod, sign)
        if relative_to != GROUND:
            wrist = self.crank + cmath.rect(self.rod, value)  # in the frame of the crank
            position = sign * leg(abs(wrist), abs(self.offset))
            crank = direction_of(complex(position, self.offset)) - direction_of(wrist)
            return crank, crank + value
        held = value - self.angle
        if driven == "crank":
            return held, link_to_line(self.crank * math.sin(held), self.rod, self.offset, sign)
        return link_to_line(self.rod * math.sin(held), self.crank, self.offset, sign), held

    def _pose(self, value: float, sign: int, driven: str, relative_to: str) -> Pose:
        crank, rod = self.solve_loop(value, sign, driven, relative_to)
        pin, arm = cmath.rect(self.crank, crank), cmath.rect(self.rod, rod)
        return {
            "crank": (*self.place(pin / 2), crank + self.angle),
            "connecting_rod": (*self.place(pin + arm / 2), rod + self.angle),
            "slider": (*self.place(complex((pin + arm).real, self.offset)), self.angle),
        }

    def joints(self) -> tuple[Constraint, ...]:
        """Return the pins A0, A, B and the guide, from the ground along crank, rod and slider to the ground."""
        c, r, rod = self.crank / 2, self.rod / 2, "connecting_rod"
        foot, along = self.place(complex(0.0, self.offset)), (math.cos(self.angle), math.sin(self.angle))
        rail: dict[str, Any] = {"point_i": foot, "axis_i": along, "angle": self.angle}
        return (
            Revolute(name="A0", body_i=GROUND, point_i=self.origin, body_j="crank", point_j=(-c, 0.0)),
            Revolute(name="A", body_i="crank", point_i=(c, 0.0), body_j=rod, point_j=(-r, 0.0)),
            Revolute(name="B", body_i=rod, point_i=(r, 0.0), body_j="slider", point_j=(0.0, 0.0)),
            Prismatic(name="guide", body_i=GROUND, **rail, body_j="slider", point_j=(0.0, 0.0)),
        )

    def driver(self, law: Law, driven: str = "crank", relative_to: str = GROUND) -> Driver:
        """Return the driver that makes the input follow a law; the slider's holds x or y of the wrist pin (`scene`)."""
        if driven != "slider":
            return super().driver(law, driven, relative_to)
        return (XDriver if self._drives_x else YDriver)(name="driver", body="slider", **law_keys(law))

    @property
    def _drives_x(self) -> bool:
        return abs(math.cos(self.angle)) >= abs(math.sin(self.angle))

    def _input(self, coordinate: float, driven: str) -> float:
        if driven != "slider":
            return coordinate
        x, y = self.place(complex(0.0, self.offset))
        return (coordinate - x) / math.cos(self.angle) if self._drives_x else (coordinate - y) / math.sin(self.angle)


@dataclass(frozen=True)
class InvertedSliderCrank(Linkage):
    """A crank whose pin slides along a lever, by lengths [m]; the lever's line passes its pivot at distance `offset`.

    Bodies crank (A0 A) and lever (frame at its pivot B0, its line at y = offset). The pin is held by a point_on_line
    joint: no body for a block. Seen from the lever it is a slider-crank with the ground as crank and the crank as rod,
    and so it is solved. OPEN: with the crank as input, the pin has x > 0 on the lever.
    """

    ground: float
    crank: float
    offset: float = 0.0
    LENGTHS = ("ground", "crank")
    INPUTS = (("crank", GROUND), ("lever", GROUND), ("lever", "crank"))

    @property
    def slack(self) -> float:
        """|ground - crank| - |offset| [m], rounded once, so its sign is exact; above 0 the crank turns fully."""
        return self._seen_from_lever.slack

    @property
    def _seen_from_lever(self) -> SliderCrank:
        return SliderCrank(self.ground, self.crank, self.offset)

    def _same_input(self, driven: str, relative_to: str) -> tuple[str, str, int, float]:
        """Return driven, relative_to, sign, shift: seen from the lever the input is sign * value + shift."""
        self._check_input(driven, relative_to)
        if driven == "crank":
            return "connecting_rod", "crank", 1, -math.pi - self.angle
        return (
            ("crank", GROUND, -1, math.pi + self.angle)
            if relative_to == GROUND
            else ("connecting_rod", GROUND, -1, 0.0)
        )

    def input_range(self, driven: str = "crank", relative_to: str = GROUND) -> tuple[Interval, ...]:
        *there, sign, shift = self._same_input(driven, relative_to)
        intervals = shifted(self._seen_from_lever.input_range(*there), -shift)
        return intervals if sign > 0 else tuple((-high, -low) for low, high in intervals)

    def closure_margin(self, value: float, driven: str = "crank", relative_to: str = GROUND) -> float:
        *there, sign, shift = self._same_input(driven, relative_to)
        return self._seen_from_lever.closure_margin(sign * value + shift, *there)

    def transmission_angle(self, phi: float) -> float:
        """Return the angle between the lever's normal and the line from B0 to A at a crank angle [rad], in [0, pi].

        The determinant of the loop equations in lever angle and slide is |B0 A| sin(mu), up to sign.
        """
        line = abs(cmath.rect(self.crank, phi - self.angle) - self.ground)
        return math.atan2(leg(line, abs(self.offset)), self.offset)

    def _pose(self, value: float, sign: int, driven: str, relative_to: str) -> Pose:
        *there, direction, shift = self._same_input(driven, relative_to)
        ground, rod = self._seen_from_lever.solve_loop(direction * value + shift, sign, *there)
        lever = math.pi - ground
        crank = rod + lever
        return {
            "crank": (*self.place(cmath.rect(self.crank / 2, crank)), crank + self.angle),
            "lever": (*self.place(complex(self.ground)), lever + self.angle),
        }

    def joints(self) -> tuple[Constraint, ...]:
        """Return the pins of crank and lever, and the line of the lever that the crank pin stays on."""
        c, pivot, slot = self.crank / 2, self.place(complex(self.ground)), (0.0, self.offset)
        return (
            Revolute(name="A0", body_i=GROUND, point_i=self.origin, body_j="crank", point_j=(-c, 0.0)),
            Revolute(name="B0", body_i=GROUND, point_i=pivot, body_j="lever", point_j=(0.0, 0.0)),
            PointOnLine(name="A", body_i="lever", point_i=slot, axis_i=(1.0, 0.0), body_j="crank", point_j=(c, 0.0)),
        )


def _slides(inner: Fraction, outer: Fraction, offset: Fraction) -> tuple[Interval, ...]:
    """Return the slider positions at which its distance from the crank pivot lies in [inner, outer]."""
    if outer < offset:
        return ()
    far = leg(outer, offset)
    if inner <= offset:
        return ((-far, far),)
    near = leg(inner, offset)
    return ((near, far), (-far, -near))
