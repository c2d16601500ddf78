"""What a hard scene is, hard scenes of space, and branching mechanisms of many loops."""

from __future__ import annotations

import cmath
import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from refkin.joints import GROUND, Pair, Revolute
from refkin.model import Body, Evidence, Mechanism, Scene
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import RSSR, Bennett, Branch, Hooke, Pose
from refkin.scenes.linkages.spatial_base import SpatialLinkage

DISTANCES = (1e-3, 1e-6, 1e-9, 1e-12, 1e-15)
"""How near the scenes come to what makes them hard [sizes, rad]."""
GAPS = (1e-3, 1e-6, 1e-9, 1e-12)
"""By how much scenes fail to assemble: 1e-12 is still a hundred times what rounding leaves of their closure."""
STEPS = (0.1, 0.5, 1.0, 2.0)
"""Crank angle between two times [rad]."""
APPROACH = 0.5
"""How far from the hard pose a scene begins [rad, m]."""
UP, DOWN = (0.0, 1.0), (0.0, -1.0)
"""Laws c0 + c1 t of an input that is the time, or its negative: times may be given as near to 0 as numbers go."""


def pin(name: str, i: str, point_i: Pair, j: str, point_j: Pair = (0.0, 0.0)) -> Revolute:
    """Return a revolute joint, by its place in the frame of each body [m]; on body j it is at the origin by default.

    Parameters
    ----------
    name : str
    i, j : str
        Bodies.
    point_i, point_j : (x, y)
    """
    return Revolute(name=name, **ends(i, point_i, j, point_j))


def ends(i: str, p: tuple[float, ...], j: str, q: tuple[float, ...] = ()) -> dict[str, Any]:
    """Return the keys of the two points of a joint, each in its body's frame [m]; that on j is its origin by default.

    Parameters
    ----------
    i, j : str
    p, q : tuple of float
    """
    return {"body_i": i, "point_i": p, "body_j": j, "point_j": q or (0.0,) * len(p)}


@dataclass(frozen=True)
class HardCase:
    """A hard scene; `case` is what makes it hard, `distance` how near it comes to that, if there is such a number.

    At a time `poses` has bodies' coordinates near the right ones (metres, rad), None where there are none or any will
    do: of `any_assembly` nothing says which one is meant. If they are `exact`, right to a few roundings, they say which
    branch is; else it is the one of the first time, also where the other one is too near to be told from it in float64.
    `every` has all assemblies, where closed form has them in space; else they are searched for.
    """

    case: str
    distance: float | None
    scene: Scene
    poses: Callable[[float], Mapping[str, tuple[float, ...]] | None]
    any_assembly: bool = False
    exact: bool = False
    every: Callable[[float], Sequence[Mapping[str, tuple[float, ...]]]] | None = None

    @property
    def key(self) -> str:
        """What names it in a list."""
        return self.case if self.distance is None else f"{self.case}, {self.distance:.0e}"


def ways_to(d: float) -> list[float]:
    """Return how far from the hard pose the times of a scene are: steps, then powers of ten, then `d`."""
    ways = [APPROACH * (1 - 0.2 * k) for k in range(5)]
    return [*ways, *(way for way in (10.0**-k for k in range(2, 16)) if way > 3 * d), d]


def timed(mechanism: Mechanism, times: Sequence[float], name: str) -> Scene:
    """Return the scene that calls for positions at some times, with all evidence.

    Parameters
    ----------
    mechanism : Mechanism
    times : sequence of float
        Increasing [s].
    name : str
        Of the scene.
    """
    return Scene(mechanism=mechanism, times=tuple(times), name=name, effects=frozenset(), evidence=frozenset(Evidence))


Place = tuple[str, Pair]
"""A body and a point of it."""


def dyads(count: int, seed: int, angles: Sequence[float]) -> tuple[list[Revolute], dict[float, Pose]]:
    """Return the joints of a crank with dyads, and the poses at some angles of the crank, right to round-off.

    A dyad is two links pinned to each other and each to a body drawn among those before it, so that loops run through
    all of a branching tree. Lengths are such that at no angle the dyad is near being stretched or folded.

    Parameters
    ----------
    count : int
        How many dyads.
    seed : int
        Of the draws.
    angles : sequence of float
        Of the crank [rad].
    """
    draw = random.Random(seed)
    joints = [pin("pivot", GROUND, (0.0, 0.0), "crank")]
    poses: dict[float, Pose] = {angle: {"crank": (0.0, 0.0, angle)} for angle in angles}
    names = [GROUND, "crank"]
    for n in range(count):
        ends, first, second = _fitting(draw, names, poses)
        a, b = f"a{n}", f"b{n}"
        for pose in poses.values():
            x, y = (_where(pose, end) for end in ends)
            d, phi = cmath.polar(y - x)
            corner = cmath.acos((d * d + first**2 - second**2) / (2 * first * d)).real
            knee = x + cmath.rect(first, phi + corner)  # left of the line from x to y
            pose[a] = (x.real, x.imag, cmath.phase(knee - x))
            pose[b] = (y.real, y.imag, cmath.phase(knee - y))
        for link, (body, point) in zip((a, b), ends, strict=True):
            joints.append(pin(f"foot {link}", body, point, link))
        joints.append(pin(f"knee {n}", a, (first, 0.0), b, (second, 0.0)))
        names += [a, b]
    return joints, poses


def _fitting(
    draw: random.Random, names: Sequence[str], poses: dict[float, Pose]
) -> tuple[tuple[Place, Place], float, float]:
    """Return two places and two lengths that join them at every angle."""
    while True:
        i, j = draw.sample(list(names), 2)
        ends = tuple((body, (draw.uniform(-1.0, 1.0), draw.uniform(-1.0, 1.0))) for body in (i, j))
        gaps = [abs(_where(pose, ends[0]) - _where(pose, ends[1])) for pose in poses.values()]
        first, second = (gaps[0] * draw.uniform(0.7, 0.9) for _ in range(2))
        reach = first + second
        if 0.5 < gaps[0] < 4.0 and all(max(0.35 * reach, 1.2 * abs(first - second)) < g < 0.95 * reach for g in gaps):
            return (ends[0], ends[1]), first, second


def _where(pose: Pose, place: Place) -> complex:
    body, point = place
    x, y, phi = pose.get(body, (0.0, 0.0, 0.0))
    return complex(x, y) + complex(*point) * cmath.rect(1.0, phi)


REACH = 6.5
"""Of the rocker's tip from the crank's at the input 0, at most: across 5/2, along 5 + 1."""
LIMITED: dict[str, Any] = {"crank": 1.0, "rocker": 1.0, "pivot": (-1.5, 3.0, 4.0), "axis": (1.0, 0.0, 0.0)}
AT_LIMIT = RSSR(**LIMITED, coupler=REACH, massless=True)
TURNING_OVER = RSSR(crank=1.0, coupler=1.0, rocker=1.25, pivot=(0.25, 0.0, 0.125), axis=(0.0, 0.125, 1.0))
LIMITS = (1e-3, 1e-6, 1e-9, 1e-12)
GIMBALS = (1e-2, 1e-4, 1e-6)
"""What is left of a right angle between two shafts [rad]: the ratio of their speeds goes up to one over it."""
TWISTS = (1e-2, 1e-3)
"""By how much the twists of a Bennett linkage differ [rad]; where they do not it may fold in two ways."""
FLIPS = (1.0, 2.0, 3.0)
"""By how much the rocker of an estimate is turned about an axis across its joint's [rad]."""
ESTIMATED = 3
"""Decimals of estimates."""


def _too_long(case: str, gap: float) -> HardCase:
    linkage = RSSR(**LIMITED, coupler=REACH + gap, massless=True)
    return HardCase(case, gap, _scene(case, linkage, [0.0], AT_LIMIT.assemble(0.0)), lambda _: None)


def _flipped(case: str, angle: float) -> HardCase:
    linkage = RSSR(**LIMITED, coupler=REACH - 0.5, massless=True)
    near = linkage.assemble(0.0)
    *place, e0, e1, e2, e3 = near["rocker"]
    c, s = math.cos(angle / 2), math.sin(angle / 2)  # a turn about the rocker's own x axis, after its own
    over = (*place, e0 * c - e1 * s, e1 * c + e0 * s, e2 * c + e3 * s, e3 * c - e2 * s)
    scene = _scene(case, linkage, [0.0], {**near, "rocker": over})
    every = lambda t: [linkage.assemble(t, branch) for branch in Branch]  # noqa: E731
    return HardCase(case, angle, scene, lambda _: None, any_assembly=True, every=every)


Kind = tuple[Sequence[float], Callable[[str, float], HardCase]]
"""How near the scenes of a kind come, and what makes one from the name of its kind and that number."""
SPATIAL: Mapping[str, Kind] = {
    # An RSSR whose crank goes to the input beyond which its coupler is too short.
    "limit of an RSSR": (LIMITS, lambda case, d: _case(case, d, AT_LIMIT, [-way for way in ways_to(d)])),
    # The same with a coupler that is a body, and spins as it likes.
    "limit of an RSSR with its coupler": (
        LIMITS[:2],
        lambda case, d: _case(case, d, replace(AT_LIMIT, massless=False), [-way for way in ways_to(d)]),
    ),
    # An RSSR whose coupler is longer than crank and rocker can be apart, by a gap.
    "unassemblable in space by a gap": (GAPS, _too_long),
    # A Hooke joint of almost a right angle, which comes to the pose where the output turns fastest.
    "gimbal pose of a Hooke joint": (
        GIMBALS,
        lambda case, b: _case(case, b, Hooke(beta=math.pi / 2 - b), [math.pi / 2 - way for way in (*ways_to(b), 0.0)]),
    ),
    # A Bennett linkage with twists nearly alike, which passes the pose where all links lie in a line.
    "Bennett with twists nearly alike": (
        TWISTS,
        lambda case, d: _case(
            case, d, Bennett(length=1.0, alpha=0.75, beta=0.75 + d), [math.pi - way for way in (*ways_to(d), 0.0)]
        ),
    ),
    # A drag link whose coupler turns over once a turn, in steps of up to a third of a turn.
    "coupler that turns over": (
        STEPS[1:],
        lambda case, step: _case(case, step, TURNING_OVER, [step * k for k in range(round(2.0 * math.pi / step) + 1)]),
    ),
    # An RSSR at one time, from an estimate whose rocker is turned over: its axis points the other way.
    "estimate with a joint the wrong way round": (FLIPS, _flipped),
}


def _case(case: str, d: float, linkage: SpatialLinkage, inputs: Sequence[float]) -> HardCase:
    """Return the case whose input is the time, on the open branch."""
    return HardCase(case, d, _scene(case, linkage, inputs, linkage.assemble(inputs[0])), linkage.assemble, exact=True)


def _scene(case: str, linkage: SpatialLinkage, times: Sequence[float], poses: Any) -> Scene:
    bodies = (Body(name=body, estimate=tuple(round(x, ESTIMATED) for x in at)) for body, at in poses.items())
    drivers = linkage.drivers(Polynomial(coefficients=UP))
    return timed(Mechanism(tuple(bodies), linkage.joints(), drivers), times, case)
