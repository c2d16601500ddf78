"""Scenes about which proofs and solvers are asked: of files, hard ones, contacts, and some whose branch ends."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from crosscheck.scenes.conformance import questions
from crosscheck.scenes.hard import hard_cases
from refkin import (
    Body,
    FourBar,
    InvertedSliderCrank,
    Mechanism,
    PointOnLine,
    Polynomial,
    Scene,
    Sinusoid,
    SliderCrank,
    Table,
    XDriver,
)
from refkin.scenes.files import load
from tests.refkin import contact_cases
from tests.refkin.hard_cases import CASES
from tests.refkin.test_answers import files


def scenes() -> dict[str, Callable[[], Scene]]:
    """Return what makes each scene, by name."""
    made: dict[str, Callable[[], Scene]] = {name: partial(load, path) for name, path in files().items()}
    made |= {f"asked {q.about}": partial(_scene, q) for q in questions()}
    made |= {f"case {case.name}": partial(_scene, case) for case in CASES[::4]}
    made |= {f"hard {case.key}": partial(_scene, case) for case in hard_cases()[::3]}
    made |= {f"contact {name}": partial(contact_cases.scene, name) for name in contact_cases.CASES}
    return made | own()


def _scene(case: object) -> Scene:
    return case.scene  # type: ignore[attr-defined]


def own() -> dict[str, Callable[[], Scene]]:
    """Return four-bars and slider-cranks whose laws turn back, pass limits and change points, or swing often."""
    times = tuple(np.linspace(0.0, 2.0, 5).tolist())
    laws = {
        "steady": Polynomial(coefficients=(0.3, 1.0)),
        "bent": Polynomial(coefficients=(0.3, 1.0, -0.6)),
        "swinging": Sinusoid(offset=0.8, amplitude=0.4, angular_frequency=40.0, phase=0.3),
        "table": Table(argument=(-1.0, 0.3, 0.9, 1.4, 2.5), value=(0.2, 0.5, 0.9, 0.6, 1.1)),
        "two knots": Table(argument=(-1.0, 3.0), value=(0.2, 0.9)),
        "three knots": Table(argument=(-1.0, 0.4, 3.0), value=(0.2, 0.9, 0.5)),
        "around": Table(argument=(0.0, 0.3, 0.7, 1.1), value=(0.4, 0.7, 0.5, 0.4), periodic=True),
    }
    linkages = {
        "rocker": FourBar(4.0, 1.0, 3.5, 3.0),
        "limited": FourBar(4.0, 2.6, 2.4, 2.5),
        "parallelogram": FourBar(3.0, 1.0, 3.0, 1.0),
        "kite": FourBar(3.0, 1.0, 1.0, 3.0),
        "slider": SliderCrank(1.0, 2.5, offset=0.3),
        "isosceles": SliderCrank(1.0, 1.0),
        "slotted": InvertedSliderCrank(ground=2.0, crank=1.0),
        "past its slot": InvertedSliderCrank(ground=1.0, crank=1.5),
    }
    return {"own trammel": trammel} | {
        f"own {name} {kind}": partial(linkage.scene, law=law, times=times)
        for name, linkage in linkages.items()
        for kind, law in laws.items()
    }


def trammel() -> Scene:
    """Return a plate that slides with two of its points on lines of the ground, and one on a line that is driven."""
    joints = tuple(
        PointOnLine(name=f"line {k}", body_i=on, point_i=at, axis_i=axis, body_j="plate", point_j=point)
        for k, (on, at, axis, point) in enumerate(
            (
                ("ground", (0.0, 0.0), (1.0, 0.1), (0.0, 0.0)),
                ("ground", (0.0, 0.0), (0.1, 1.0), (2.0, 0.0)),
                ("block", (0.0, 0.0), (1.0, 0.7), (0.5, 1.25)),
            )
        )
    )
    guide = contact_cases.guide("block", axis=(1.0, 0.0))
    push = XDriver(name="push", body="block", law=Polynomial(coefficients=(0.4, 0.2)))
    bodies = (Body(name="plate", estimate=(0.9, 0.1, 2.0)), Body(name="block", estimate=(0.4, 0.0, 0.0)))
    return Scene(mechanism=Mechanism(bodies, (*joints, guide), (push,)), times=(0.0, 0.25, 0.5), name="trammel")
