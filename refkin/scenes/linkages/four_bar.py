"""The four-bar: four links, four revolutes."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction

from refkin.joints import GROUND, Constraint, Revolute
from refkin.scenes.linkages.base import Linkage, Pose
from refkin.scenes.linkages.closures import Interval, between_circles, corner, shifted, two_links, two_links_margin

SENSE = {"ground": -1, "crank": 1, "coupler": 1, "rocker": -1}
"""Signs of the links in the closed loop crank + coupler - rocker - ground = 0."""


class GrashofClass(StrEnum):
    """What a four-bar can do, by where its shortest link is (Grashof 1883); no link turns fully in a triple-rocker."""

    CRANK_ROCKER = "crank-rocker"
    """The crank is shortest, and turns fully."""
    DOUBLE_CRANK = "double-crank"
    """The ground is: crank and rocker turn fully (drag link)."""
    ROCKER_CRANK = "rocker-crank"
    """The rocker is, and turns fully."""
    DOUBLE_ROCKER = "double-rocker"
    """The coupler is: it alone turns fully."""
    TRIPLE_ROCKER = "triple-rocker"
    """No link turns fully: shortest and longest are longer than the other two."""
    CHANGE_POINT = "change-point"
    """They are as long: the linkage folds into one line."""


BY_SHORTEST = {
    "crank": GrashofClass.CRANK_ROCKER,
    "ground": GrashofClass.DOUBLE_CRANK,
    "rocker": GrashofClass.ROCKER_CRANK,
    "coupler": GrashofClass.DOUBLE_ROCKER,
}


@dataclass(frozen=True)
class FourBar(Linkage):
    """A four-bar by its lengths [m]: bodies crank (A0 A), coupler (A B), rocker (B0 B), pivots A0 and B0 on the ground.

    The frame of a body is in the middle of its link, x along it. A sum of vectors does not depend on their order, so
    every pair of links can be the input; what is said of ground and crank holds for any pair. OPEN: with the crank as
    input, B lies to the left of the line from A to B0.
    """

    ground: float
    crank: float
    coupler: float
    rocker: float
    LENGTHS = ("ground", "crank", "coupler", "rocker")
    INPUTS = (
        ("crank", GROUND),
        ("rocker", GROUND),
        ("coupler", GROUND),
        ("coupler", "crank"),
        ("rocker", "coupler"),
        ("rocker", "crank"),
    )

    @property
    def slack(self) -> float:
        """(p + q) - (s + l) [m] with s, l the shortest and the longest link; rounded once, so its sign is exact."""
        shortest, p, q, longest = sorted(getattr(self, key) for key in self.LENGTHS)
        return math.fsum((p, q, -shortest, -longest))

    @property
    def grashof(self) -> GrashofClass:
        """The Grashof class."""
        if self.slack == 0.0:
            return GrashofClass.CHANGE_POINT
        if self.slack < 0.0:
            return GrashofClass.TRIPLE_ROCKER
        return BY_SHORTEST[min(self.LENGTHS, key=lambda key: float(getattr(self, key)))]

    def input_range(self, driven: str = "crank", relative_to: str = GROUND) -> tuple[Interval, ...]:
        self._check_input(driven, relative_to)
        p, q, a, b = (Fraction(getattr(self, link)) for link in (relative_to, driven, *_free(driven, relative_to)))
        shift = self._zero(relative_to) + (math.pi if SENSE[driven] == SENSE[relative_to] else 0.0)
        return shifted(between_circles(p, q, abs(a - b), a + b), shift)

    def closure_margin(self, value: float, driven: str = "crank", relative_to: str = GROUND) -> float:
        a, b = (getattr(self, link) for link in _free(driven, relative_to))
        return two_links_margin(abs(self._gap(value, driven, relative_to)), a, b)

    def transmission_angle(self, phi: float) -> float:
        """Return the angle between coupler and rocker at a crank angle [rad], in [0, pi], the same on both branches.

        The determinant of the loop equations in the angles of coupler and rocker is coupler rocker sin(mu), up to sign.
        """
        return corner(self.coupler, self.rocker, abs(self._gap(phi, "crank", GROUND)))

    def _zero(self, relative_to: str) -> float:
        return self.angle if relative_to == GROUND else 0.0

    def _gap(self, value: float, driven: str, relative_to: str) -> complex:
        """Return what the two free links must add up to, in the frame of link `relative_to`."""
        self._check_input(driven, relative_to)
        held = cmath.rect(getattr(self, driven), value - self._zero(relative_to))
        return complex(-SENSE[relative_to] * getattr(self, relative_to) - SENSE[driven] * held)

    def _pose(self, value: float, sign: int, driven: str, relative_to: str) -> Pose:
        free = _free(driven, relative_to)
        a, b = (getattr(self, link) for link in free)
        directions = two_links(self._gap(value, driven, relative_to), a, b, sign)
        phi = {relative_to: 0.0, driven: value - self._zero(relative_to)}
        for link, direction in zip(free, directions, strict=True):
            phi[link] = direction + (math.pi if SENSE[link] < 0 else 0.0)
        phi = {link: angle - phi["ground"] for link, angle in phi.items()}
        crank, coupler, rocker = (cmath.rect(getattr(self, link), phi[link]) for link in ("crank", "coupler", "rocker"))
        middles = {"crank": crank / 2, "coupler": crank + coupler / 2, "rocker": self.ground + rocker / 2}
        return {link: (*self.place(z), phi[link] + self.angle) for link, z in middles.items()}

    def joints(self) -> tuple[Constraint, ...]:
        """Return the pins A0, A, B, B0, from the ground along crank, coupler and rocker to the ground."""
        crank, coupler, rocker = self.crank / 2, self.coupler / 2, self.rocker / 2
        pivot = self.place(complex(self.ground))
        return (
            Revolute(name="A0", body_i=GROUND, point_i=self.origin, body_j="crank", point_j=(-crank, 0.0)),
            Revolute(name="A", body_i="crank", point_i=(crank, 0.0), body_j="coupler", point_j=(-coupler, 0.0)),
            Revolute(name="B", body_i="coupler", point_i=(coupler, 0.0), body_j="rocker", point_j=(rocker, 0.0)),
            Revolute(name="B0", body_i=GROUND, point_i=pivot, body_j="rocker", point_j=(-rocker, 0.0)),
        )


def _free(driven: str, relative_to: str) -> tuple[str, str]:
    """Return the two links that are not held by the input."""
    first, second = (link for link in SENSE if link not in (driven, relative_to))
    return first, second
