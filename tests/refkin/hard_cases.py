"""Hard planar scenes with their truth: closed forms of dyads in balls of 300 bits, from the scene's own numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb, ctx

from refkin import FourBar, InvertedSliderCrank, Polynomial, Scene, Sinusoid, SliderCrank, Status
from tests.linkages import remade, with_law

BITS = 300
Truth = Callable[[float], dict[str, Any] | None]
"""Returns the directions (x, y) of bodies at a time, as balls; None where the mechanism is not, or not decided."""


@dataclass(frozen=True)
class Case:
    """A scene, its truth, and what must be found: a status for each time, or None where several are honest."""

    name: str
    scene: Scene
    truth: Truth
    must: tuple[Status | None, ...]


def meeting(p: Any, r: Any, q: Any, s: Any, sign: int) -> Any:
    """Return where the circles around p and q meet, left of the line from p to q for sign 1; None if they do not."""
    d = (q[0] - p[0], q[1] - p[1])
    square = d[0] ** 2 + d[1] ** 2
    along = (r**2 - s**2 + square) / (2 * square)
    height = r**2 / square - along**2
    if not height >= 0:
        return None
    across = sign * height.sqrt()
    return p[0] + along * d[0] - across * d[1], p[1] + along * d[1] + across * d[0]


def way(p: Any, q: Any) -> Any:
    return q[0] - p[0], q[1] - p[1]


def law_value(law: Any, t: float) -> Any:
    """Return a polynomial or a sinusoid, exactly."""
    if isinstance(law, Polynomial):
        return sum((arb(c) * arb(t) ** k for k, c in enumerate(law.coefficients)), arb(0))
    turned = arb(law.angular_frequency) * arb(t) + arb(law.phase)
    return arb(law.offset) + arb(law.amplitude) * turned.sin()


def precisely(truth: Truth) -> Truth:
    def at(t: float) -> dict[str, Any] | None:
        with ctx.workprec(BITS):
            return truth(t)

    return at


def four_bar_truth(lengths: tuple[float, ...], law: Any, branch: str = "open") -> Truth:
    """The truth also of a law that leaves the range of the crank and comes back: what is there then, if it does."""
    ground, crank, coupler, rocker = map(arb, lengths)

    def truth(t: float) -> dict[str, Any] | None:
        phi = law_value(law, t)
        a = (crank * phi.cos(), crank * phi.sin())
        b = meeting(a, coupler, (ground, arb(0)), rocker, 1 if branch == "open" else -1)
        return None if b is None else {"coupler": way(a, b), "rocker": way((ground, arb(0)), b)}

    return precisely(truth)


def four_bar(lengths: tuple[float, ...], law: Any, times: Any, branch: str, **place: Any) -> tuple[Scene, Truth]:
    scene = FourBar(*lengths, **place).scene(law=law, times=tuple(times), branch=branch)
    return scene, four_bar_truth(lengths, law, branch)


def pulled(crank: float, rod: float, law: Any, times: Any, branch: str, **place: Any) -> tuple[Scene, Truth]:
    """A slider-crank driven by its slider."""
    scene = SliderCrank(crank, rod, **place).scene(driven="slider", law=law, times=tuple(times), branch=branch)

    def truth(t: float) -> dict[str, Any] | None:
        x = (law_value(law, t), arb(0))
        a = meeting((arb(0), arb(0)), arb(crank), x, arb(rod), 1 if branch == "open" else -1)
        return None if a is None else {"crank": way((arb(0), arb(0)), a), "connecting_rod": way(a, x)}

    return scene, precisely(truth)


def slotted(distance: float, law: Any, times: Any) -> tuple[Scene, Truth]:
    """A crank of length 1 whose pin passes the pivot of its slot at a distance."""
    ground = 1.0 + distance
    scene = InvertedSliderCrank(ground=ground, crank=1.0).scene(law=law, times=tuple(times))

    def truth(t: float) -> dict[str, Any] | None:
        phi = law_value(law, t)
        return {"lever": way((arb(ground), arb(0)), (phi.cos(), phi.sin()))}

    return scene, precisely(truth)


def ok(times: Any) -> tuple[Status, ...]:
    return (Status.OK,) * len(times)


BRANCHES = ("open", "crossed")
ROCKER = (4.0, 1.0, 3.5, 3.0)
LIMITED = (0.9, 0.3, 0.6, 0.45)
NOW = (0.0,)


def constant(value: float) -> Polynomial:
    return Polynomial(coefficients=(value, 1.0))


def toggles() -> list[Case]:
    """At 10^-1 ... 10^-10 before the limit of a crank, and before both ends of a slider's stroke."""
    limit = FourBar(*LIMITED).input_range()[0][1]
    cases = []
    for k in range(1, 11):
        d = 10.0**-k
        for branch in BRANCHES:
            for side in (1, -1):
                built = four_bar(LIMITED, constant(side * (limit - d)), NOW, branch)
                cases.append(Case(f"toggle {side} 1e-{k} {branch}", *built, ok(NOW)))
            for end in (0.75 - d, 0.25 + d):
                cases.append(
                    Case(
                        f"dead centre {end:.3g} 1e-{k} {branch}",
                        *pulled(0.25, 0.5, constant(end), NOW, branch),
                        ok(NOW),
                    )
                )
    return cases


def change_points() -> list[Case]:
    """Slack of 10^-1 ... 10^-12: the pose where branches are closest, and coarse turns past it; slack below 0 too."""
    cases = []
    for k in range(1, 13):
        for branch in BRANCHES:
            lengths = (4.0, 1.0, 3.5, 1.5 + 10.0**-k)
            cases.append(
                Case(f"near change point 1e-{k} {branch}", *four_bar(lengths, constant(math.pi), NOW, branch), ok(NOW))
            )
            times = np.linspace(0.0, 6.28, 6)
            built = four_bar(lengths, constant(0.3), times, branch)
            # A turn past 1e-12 may be given up, never wrong.
            must = ok(times) if k < 11 else (Status.OK,) + (None,) * 5
            cases.append(Case(f"turn past 1e-{k} {branch}", *built, must))
        lengths, times = (4.0, 1.0, 3.5, 1.5 - 10.0**-k), np.linspace(0.0, 2 * math.pi, 8)
        law = Sinusoid(amplitude=FourBar(*lengths).input_range()[0][1] * (1 + 1e-3), angular_frequency=1.0)
        scene, _ = four_bar(lengths, Sinusoid(amplitude=0.5, angular_frequency=1.0), times, "open")
        truth = four_bar_truth(lengths, law)
        cases.append(Case(f"over the limit 1e-{k}", with_law(scene, law), truth, (Status.OK,) + (None,) * 7))
    return cases


def flat_poses() -> list[Case]:
    """Parallelograms, antiparallelograms and kites: regular poses, and coarse motions that come to their flat pose."""
    cases = []
    for name, lengths in (("parallelogram", (3.0, 1.0, 3.0, 1.0)), ("kite", (3.0, 1.0, 1.0, 3.0))):
        for branch in BRANCHES:
            for k in range(1, 8):
                built = four_bar(lengths, constant(math.pi - 10.0**-k), NOW, branch)
                cases.append(Case(f"{name} 1e-{k} {branch}", *built, ok(NOW) if k < 7 else (None,)))
            for samples in (5, 8, 30):
                times = np.linspace(0.0, 4.0, samples)
                scene, truth = four_bar(lengths, constant(1.0), times, branch)
                must = tuple(Status.OK if t < math.pi - 1.0 else None for t in times)
                cases.append(
                    Case(f"{name} over its flat pose {samples} {branch}", scene, until(truth, math.pi - 1.0), must)
                )
    return cases


def until(truth: Truth, end: float) -> Truth:
    """The truth of a motion that is not decided after a time."""
    return lambda t: truth(t) if t < end else None


def scales() -> list[Case]:
    """Length ratios, units, places and driver angles far from 1: each alone."""
    cases = []
    times = np.linspace(0.0, 6.0, 7)
    for k in (-6, -4, 4, 6):
        ratio = 10.0**k
        for branch in BRANCHES:
            lengths = (1.0, ratio, 1.0, 1.0) if ratio < 1 else (ratio, 1.0, ratio, 1.5)
            cases.append(Case(f"ratio 1e{k} {branch}", *four_bar(lengths, constant(0.4), times, branch), ok(times)))
    for unit in (1e-9, 1e-3, 1e3, 1e9):
        for branch in BRANCHES:
            lengths = tuple(x * unit for x in ROCKER)
            cases.append(Case(f"unit {unit:g} {branch}", *four_bar(lengths, constant(0.4), times, branch), ok(times)))
    for offset in (1e4, -1e8):
        for branch in BRANCHES:
            for name, built in (
                ("four-bar", four_bar((4.0, 1.0, 3.5, 3.0), constant(0.4), times, branch, origin=(offset, 0.0))),
                ("slider", pulled(0.25, 0.5, constant(0.5), (0.0, 0.1, 0.2), branch, origin=(0.0, offset))),
            ):
                cases.append(Case(f"{name} at {offset:g} {branch}", *built, ok(built[0].times)))
    for turns in (1e3, 1e5):
        for branch in BRANCHES:
            cases.append(Case(f"{turns:g} rad {branch}", *four_bar(ROCKER, constant(turns), times, branch), ok(times)))
    return cases


def coarse() -> list[Case]:
    """Few samples a turn, over two turns; and slots whose pivot is passed at 10^-1 ... 10^-12."""
    cases = []
    for samples in (5, 6, 7, 9, 12):
        times = np.linspace(0.0, 4 * math.pi, samples)
        cases += [
            Case(f"coarse {samples} {b}", *four_bar(ROCKER, constant(0.2), times, b), ok(times)) for b in BRANCHES
        ]
    for k in range(1, 13):
        times = np.linspace(0.1, 2 * math.pi + 0.3, 10)
        cases.append(Case(f"slot 1e-{k}", *slotted(10.0**-k, constant(0.0), times), ok(times)))
    return cases


def gaps() -> list[Case]:
    """Links that miss each other by 10^-1 ... 10^-9 of the size."""
    cases = []
    for k in range(1, 10):
        d = 10.0**-k
        scene, _ = four_bar((4.0, 1.0, 3.0, 2.5), constant(math.pi), NOW, "open")
        lengths = (4.0, 1.0, 3.0, 2.0 - 4 * d)
        cases.append(
            Case(
                f"gap 1e-{k}",
                missing(scene, FourBar(*lengths)),
                four_bar_truth(lengths, constant(math.pi)),
                (Status.UNASSEMBLABLE,),
            )
        )
        scene, _ = pulled(0.25, 0.5, constant(0.7), NOW, "open")
        for x in (0.75 + d, 0.25 - d):
            cases.append(
                Case(
                    f"out of reach {x:.3g} 1e-{k}",
                    with_law(scene, constant(x)),
                    lambda t: None,
                    (Status.UNASSEMBLABLE,),
                )
            )
    return cases


def missing(scene: Scene, linkage: FourBar) -> Scene:
    """The scene with the joints of links that do not reach."""
    return remade(scene, joints=linkage.joints())


def singular() -> list[Case]:
    """Poses that are singular exactly, in numbers without rounding: never ok."""
    cases = []
    for x in (0.25, 0.75):
        scene, _ = pulled(0.25, 0.5, constant(0.5), NOW, "open")
        cases.append(Case(f"dead centre at {x}", with_law(scene, constant(x)), lambda t: None, (Status.SINGULAR,)))
    for name, lengths in (
        ("change point", (4.0, 1.0, 5.0, 2.0)),
        ("parallelogram", (3.0, 1.0, 3.0, 1.0)),
        ("kite", (3.0, 1.0, 1.0, 3.0)),
    ):
        scene, _ = four_bar(lengths, constant(0.5), NOW, "open")
        cases.append(Case(f"flat {name}", with_law(scene, constant(0.0)), lambda t: None, (Status.SINGULAR,)))
    return cases


FAMILIES = (toggles, change_points, flat_poses, scales, coarse, gaps, singular)
CASES = [case for family in FAMILIES for case in family()]
