"""What is computed: four-bars and RSSRs over a turn of the crank, and chains of four-bars at one time.

The four-bars' crank turns at 1 rad/s from 0, all are OPEN, all of what is asked is position, velocity and acceleration
of three bodies. Start estimates are right to six decimals: finding the first pose is not what is measured.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from crosscheck.scenes.four_bar_answers import four_bar
from crosscheck.scenes.hard_case import pin
from crosscheck.scenes.workloads_space import SpatialLoops, many_rssrs, one_rssr
from refkin.joints import GROUND, AngleDriver, Unit
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import FourBar
from refkin.system import System, compile_system

EXAMPLE = (4.0, 1.0, 3.5, 3.0)
SPEED = 1.0
SHORTEST, LONGEST = 0.2, 1.0
"""Between these the lengths of many four-bars are drawn [m]."""
MARGIN = 0.02
"""How far from the change point, as a part of the longest length, in the workload that has a margin."""
SEED = 20260101
MECHANISMS, TIMES, SWEEP = 10_000, 360, 1000
WINDOWS = (10, 100, 1000, 10_000)
CHUNK = 500
"""So many mechanisms are answered at once when a method's accuracy is taken."""


@dataclass(frozen=True)
class FourBars:
    """Some four-bars: rows of their lengths (4, M) [m] as `ORDER`, at times t (T,); the crank's angle is `SPEED` t."""

    name: str
    lengths: Any
    t: Any

    @property
    def mechanisms(self) -> int:
        """M."""
        return int(self.lengths.shape[1])

    @property
    def configurations(self) -> int:
        """M T."""
        return self.mechanisms * len(self.t)

    @cached_property
    def starts(self) -> Any:
        """The estimates of the first pose, (9, M)."""
        return np.round(four_bar(self.lengths, SPEED * self.t[0] + np.zeros(self.mechanisms))[0], 6)

    def scene(self, mechanism: int = 0) -> Scene:
        """Return the scene of one mechanism, without evidence."""
        ground, crank, coupler, rocker = map(float, self.lengths[:, mechanism])
        linkage = FourBar(ground=ground, crank=crank, coupler=coupler, rocker=rocker)
        law = Polynomial(coefficients=(0.0, SPEED))
        scene = linkage.scene(law=law, times=self.t.tolist(), evidence=(), name=self.name)
        x = self.starts[:, mechanism].tolist()
        bodies = tuple(
            replace(b, estimate=(x[3 * k], x[3 * k + 1], x[3 * k + 2])) for k, b in enumerate(scene.mechanism.bodies)
        )
        return replace(scene, mechanism=replace(scene.mechanism, bodies=bodies))

    @property
    def geometry(self) -> dict[str, dict[str, Any]]:
        """The rows of the joints' points, by joint and key of a scene file."""
        ground, crank, coupler, rocker = self.lengths
        return {
            "A0": {"point_j": (-crank / 2, 0.0)},
            "A": {"point_i": (crank / 2, 0.0), "point_j": (-coupler / 2, 0.0)},
            "B": {"point_i": (coupler / 2, 0.0), "point_j": (rocker / 2, 0.0)},
            "B0": {"point_i": (ground, 0.0), "point_j": (-rocker / 2, 0.0)},
        }

    def first(self, mechanisms: int) -> FourBars:
        """Return the workload with the first mechanisms alone: for methods that are too slow for all."""
        return replace(self, lengths=self.lengths[:, :mechanisms])


def unit_of(lengths: Any) -> Unit:
    """Return the units of four-bars, with rows (M,) of sizes: as `Mechanism.unit` has it for one."""
    mantissa, exponent = np.frexp(np.max(lengths, axis=0))
    size: Any = np.ldexp(1.0, np.where(mantissa > np.sqrt(0.5), exponent, exponent - 1))
    return Unit(size)


def system_of(work: FourBars, mechanisms: Any) -> System:
    """Return the equations of some mechanisms of a workload, scaled, with rows (L,) for their geometry."""
    unit = unit_of(work.lengths[:, mechanisms])
    system = compile_system(work.scene().mechanism)
    placed = []
    for p in system.placed:
        rows: dict[str, Any] = {
            key: tuple(np.broadcast_to(x, work.mechanisms)[mechanisms] for x in pair)
            for key, pair in work.geometry.get(p.constraint.name, {}).items()
        }
        constraint = replace(p.constraint, **rows)
        placed.append(replace(p, constraint=constraint, g=constraint.constants(unit)))
    return replace(system, unit=unit, placed=tuple(placed))


@dataclass(frozen=True)
class AnswerPiece:
    """Some answers to a workload of four-bars, or of RSSRs: to L configurations, each of a mechanism at a time.

    `rows` says which coordinates, of the nine in the plane, of all in space; `levels` (rows, L) are coordinates in m
    and rad, then what rates there are.
    """

    mechanisms: Any
    times: Any
    rows: Any
    levels: tuple[Any, ...]

    def of(self, samples: Any) -> AnswerPiece:
        """Return some of the answers."""
        return AnswerPiece(
            self.mechanisms[samples], self.times[samples], self.rows, tuple(x[:, samples] for x in self.levels)
        )


def whole(work: FourBars | SpatialLoops, mechanisms: Any, levels: Iterable[Any], rows: Any = range(9)) -> AnswerPiece:
    """Return the answers of some mechanisms at all times as a piece.

    Parameters
    ----------
    work : FourBars or SpatialLoops
    mechanisms : (M,) array of int
        Which of them.
    levels : iterable of (rows, M, T) array
        Positions, and as many rates as there are.
    rows : sequence of int
        Which coordinates a level holds.
    """
    count = len(work.t)
    return AnswerPiece(
        np.repeat(mechanisms, count),
        np.tile(np.arange(count), len(mechanisms)),
        rows,
        tuple(np.reshape(level, (len(rows), -1)) for level in levels),
    )


def chunks(work: FourBars) -> Iterator[Any]:
    """Yield the numbers of the mechanisms of a workload, `CHUNK` at a time."""
    for start in range(0, work.mechanisms, CHUNK):
        yield np.arange(start, min(start + CHUNK, work.mechanisms))


@dataclass(frozen=True)
class LoopChain:
    """Four-bars side by side, each coupled to the next: the rocker of one is the crank of the next; at one time."""

    name: str
    windows: int
    law: ClassVar[Polynomial] = Polynomial(coefficients=(1.2, 0.2))
    """The angle of the first rocker."""

    @cached_property
    def rockers(self) -> list[float]:
        """The lengths of the windows + 1 rockers [m]."""
        return [1.0 + 0.05 * (k % 3) for k in range(self.windows + 1)]

    @cached_property
    def couplers(self) -> list[float]:
        """The lengths of the couplers [m]."""
        return [abs(b - a) for a, b in pairwise(self._tips)]

    @property
    def feet(self) -> list[float]:
        """The rockers' pivots on the x axis [m]."""
        return [SPACING * k for k in range(self.windows + 1)]

    @property
    def _tips(self) -> list[complex]:
        angles = (1.2 + 0.1 * (k % 2) for k in range(self.windows + 1))
        return [foot + cmath.rect(r, phi) for foot, r, phi in zip(self.feet, self.rockers, angles, strict=True)]

    @cached_property
    def scene(self) -> Scene:
        """The scene: bodies rocker 0, 1, ... and then coupler 0, 1, ...; without evidence."""
        links, joints, tips = [], [], self._tips
        for k, (foot, tip, r) in enumerate(zip(self.feet, tips, self.rockers, strict=True)):
            links.append((f"rocker{k}", (foot + tip) / 2, cmath.phase(tip - foot)))
            joints.append(pin(f"foot{k}", GROUND, (foot, 0.0), f"rocker{k}", (-r / 2, 0.0)))
        for k, (a, b) in enumerate(pairwise(tips)):
            links.append((f"coupler{k}", (a + b) / 2, cmath.phase(b - a)))
            half, left, right = self.couplers[k] / 2, self.rockers[k] / 2, self.rockers[k + 1] / 2
            joints.append(pin(f"left{k}", f"rocker{k}", (left, 0.0), f"coupler{k}", (-half, 0.0)))
            joints.append(pin(f"right{k}", f"coupler{k}", (half, 0.0), f"rocker{k + 1}", (right, 0.0)))
        driver = AngleDriver(name="motor", body="rocker0", law=self.law)
        estimates = {name: (round(z.real, 3), round(z.imag, 3), round(phi, 3)) for name, z, phi in links}
        bodies = tuple(Body(name=name, estimate=q) for name, q in estimates.items())
        mechanism = Mechanism(bodies, tuple(joints), (driver,))
        return Scene(mechanism=mechanism, times=(0.0,), name=self.name, evidence=frozenset())

    @cached_property
    def system(self) -> System:
        """The equations, scaled."""
        mechanism = self.scene.mechanism
        return compile_system(mechanism, unit=mechanism.unit())

    @cached_property
    def start(self) -> Any:
        """Coordinates (n,) in metres and radians from which Newton starts, right to six decimals."""
        return np.round(np.asarray(self.truth()[0], float), 6)

    def truth(self) -> tuple[Any, Any, Any]:
        """Return coordinates, velocities, accelerations (n,) in long double, loop after loop by the closed form."""
        count = self.windows + 1
        out = [np.empty((2 * count - 1, 3), np.longdouble) for _ in range(3)]
        phi, omega, alpha = (np.longdouble(self.law(0.0, order)) for order in range(3))
        for k, (coupler, crank, rocker) in enumerate(zip(self.couplers, self.rockers, self.rockers[1:], strict=False)):
            lengths = tuple(np.longdouble(x) for x in (SPACING, crank, coupler, rocker))
            levels = four_bar(lengths, phi, omega, alpha)
            bodies = [k, count + k, k + 1]
            for level, values in zip(out, levels, strict=True):
                level[bodies] = values.reshape(3, 3)
            out[0][bodies, 0] += SPACING * k
            phi, omega, alpha = (values[8] for values in levels)
        return out[0].ravel(), out[1].ravel(), out[2].ravel()


SPACING = 1.5
Workload = FourBars | SpatialLoops | LoopChain


def workload(name: str) -> Workload:
    """Return a workload by its name; KeyError if there is none."""
    return WORKLOADS[name](name)


def sweep(count: int, name: str = "sweep-1000") -> FourBars:
    """Return one four-bar at so many times over a turn."""
    return FourBars(name, np.array(EXAMPLE)[:, None], np.linspace(0.0, math.tau, count))


def many(name: str, mechanisms: int, times: int, margin: float) -> FourBars:
    """Return random four-bars whose crank turns fully, at so many times over a turn.

    Parameters
    ----------
    name : str
    mechanisms, times : int
        How many.
    margin : float
        As for `grashof`.
    """
    return FourBars(name, grashof(mechanisms, margin), np.arange(times) * (math.tau / times))


WORKLOADS: dict[str, Callable[[str], Workload]] = {
    "sweep-1000": partial(sweep, SWEEP),
    "many-10000x360": partial(many, mechanisms=MECHANISMS, times=TIMES, margin=MARGIN),
    "many-10000x360-any": partial(many, mechanisms=MECHANISMS, times=TIMES, margin=0.0),
    **{f"chain-{n}": partial(LoopChain, windows=n) for n in WINDOWS},
    "rssr-1000": partial(one_rssr, times=SWEEP),
    "rssrs-100x72": partial(many_rssrs, mechanisms=100, times=72),
}
"""In the order in which they are run."""


def grashof(count: int, margin: float) -> Any:
    """Return lengths (4, count) of four-bars whose crank turns fully, drawn uniformly and kept by Grashof's rule.

    The slack is above `margin` times the longest length; with 0 it is only above 0, and some are next to it.
    """
    draw = np.random.default_rng(SEED)
    four_bars = np.empty((4, 0))
    while four_bars.shape[1] < count:
        lengths = draw.uniform(SHORTEST, LONGEST, (4, 4 * count))
        in_order = np.sort(lengths, axis=0)
        slack = in_order[1] + in_order[2] - in_order[0] - in_order[3]
        turns = (in_order[0] == lengths[1]) | (in_order[0] == lengths[0])
        four_bars = np.concatenate([four_bars, lengths[:, turns & (slack > margin * in_order[3])]], axis=1)
    return four_bars[:, :count]
