"""Hard scenes of space: joints the wrong way round, gimbal poses, limits, couplers that turn over, twists nearly alike.

Poses are those of the linkages' closed forms, and say which assembly is meant (`HardCase.exact`). Where a coupler just
reaches is known exactly: at the input 0 crank tip, pivot and reach are the sides of triangles in small whole numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from crosscheck.scenes.hard_case import GAPS, STEPS, UP, HardCase, timed, ways_to
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import RSSR, Bennett, Branch, Hooke
from refkin.scenes.linkages.spatial_base import SpatialLinkage

REACH = 6.5
"""Of the rocker's tip from the crank's at the input 0, at most: across 5/2, along 5 + 1."""
LIMITED: dict[str, Any] = {"crank": 1.0, "rocker": 1.0, "pivot": (-1.5, 3.0, 4.0), "axis": (1.0, 0.0, 0.0)}
LIMITS = (1e-3, 1e-6, 1e-9, 1e-12)
GIMBALS = (1e-2, 1e-4, 1e-6)
"""What is left of a right angle between two shafts [rad]: the ratio of their speeds goes up to one over it."""
TWISTS = (1e-2, 1e-3)
"""By how much the twists of a Bennett linkage differ [rad]; where they do not it may fold in two ways."""
FLIPS = (1.0, 2.0, 3.0)
"""By how much the rocker of an estimate is turned about an axis across its joint's [rad]."""
ESTIMATED = 3
"""Decimals of estimates."""


def rssr_limit() -> Iterator[HardCase]:
    """Yield an RSSR whose crank goes to the input beyond which its coupler is too short."""
    linkage = RSSR(**LIMITED, coupler=REACH, massless=True)
    for d in LIMITS:
        yield _case("limit of an RSSR", d, linkage, [-way for way in ways_to(d)])


def rssr_limit_of_a_body() -> Iterator[HardCase]:
    """Yield the same with a coupler that is a body, and spins as it likes."""
    linkage = RSSR(**LIMITED, coupler=REACH)
    for d in LIMITS[:2]:
        yield _case("limit of an RSSR with its coupler", d, linkage, [-way for way in ways_to(d)])


def rssr_too_long() -> Iterator[HardCase]:
    """Yield an RSSR whose coupler is longer than crank and rocker can be apart, by a gap."""
    closed = RSSR(**LIMITED, coupler=REACH, massless=True)
    for gap in GAPS:
        linkage = RSSR(**LIMITED, coupler=REACH + gap, massless=True)
        scene = _scene("unassemblable in space by a gap", linkage, [0.0], closed.assemble(0.0))
        yield HardCase("unassemblable in space by a gap", gap, scene, lambda _: None)


def gimbal() -> Iterator[HardCase]:
    """Yield a Hooke joint of almost a right angle, which comes to the pose where the output turns fastest."""
    for b in GIMBALS:
        inputs = [math.pi / 2 - way for way in (*ways_to(b), 0.0)]
        yield _case("gimbal pose of a Hooke joint", b, Hooke(beta=math.pi / 2 - b), inputs)


def bennett_nearly_alike() -> Iterator[HardCase]:
    """Yield a Bennett linkage with twists nearly alike, which passes the pose where all links lie in a line."""
    for d in TWISTS:
        steps = [math.pi - way for way in (*ways_to(d), 0.0)]
        yield _case("Bennett with twists nearly alike", d, Bennett(length=1.0, alpha=0.75, beta=0.75 + d), steps)


def turns_over() -> Iterator[HardCase]:
    """Yield a drag link whose coupler turns over once a turn, in steps of up to a third of a turn."""
    linkage = RSSR(crank=1.0, coupler=1.0, rocker=1.25, pivot=(0.25, 0.0, 0.125), axis=(0.0, 0.125, 1.0))
    for step in STEPS[1:]:
        inputs = [step * k for k in range(round(2.0 * math.pi / step) + 1)]
        yield _case("coupler that turns over", step, linkage, inputs)


def flipped() -> Iterator[HardCase]:
    """Yield an RSSR at one time, from an estimate whose rocker is turned over: its axis points the other way."""
    linkage = RSSR(**LIMITED, coupler=REACH - 0.5, massless=True)

    def every(t: float) -> Sequence[Any]:
        return [linkage.assemble(t, branch) for branch in Branch]

    for angle in FLIPS:
        near = linkage.assemble(0.0)
        *place, e0, e1, e2, e3 = near["rocker"]
        c, s = math.cos(angle / 2), math.sin(angle / 2)  # a turn about the rocker's own x axis, after its own
        over = (*place, e0 * c - e1 * s, e1 * c + e0 * s, e2 * c + e3 * s, e3 * c - e2 * s)
        case = "estimate with a joint the wrong way round"
        scene = _scene(case, linkage, [0.0], {**near, "rocker": over})
        yield HardCase(case, angle, scene, lambda _: None, any_assembly=True, every=every)


SPATIAL = (rssr_limit, rssr_limit_of_a_body, rssr_too_long, gimbal, bennett_nearly_alike, turns_over, flipped)


def _case(case: str, d: float, linkage: SpatialLinkage, inputs: Sequence[float]) -> HardCase:
    """Return the case whose input is the time, on the open branch."""
    return HardCase(case, d, _scene(case, linkage, inputs, linkage.assemble(inputs[0])), linkage.assemble, exact=True)


def _scene(case: str, linkage: SpatialLinkage, times: Sequence[float], poses: Any) -> Scene:
    bodies = (Body(name=body, estimate=tuple(round(x, ESTIMATED) for x in at)) for body, at in poses.items())
    drivers = linkage.drivers(Polynomial(coefficients=UP))
    return timed(Mechanism(tuple(bodies), linkage.joints(), drivers), times, case)
