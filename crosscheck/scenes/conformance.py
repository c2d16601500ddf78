"""What an engine is asked before anything is drawn: each joint and driver in the plainest mechanism that has it.

What is not asked about in a scene are pins and a driven angle, which an engine needs for any mechanism; so a wrong
answer says which joint it is. Then the same four-bar in other frames, sizes and orders, and scenes that have no answer.
Then all that in space.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from crosscheck.scenes.conformance_space import spatial_scenes
from crosscheck.scenes.hard_case import ends, pin
from refkin.joints import (
    GROUND,
    AngleDriver,
    Cam,
    Constraint,
    Disc,
    Distance,
    DistanceDriver,
    Driver,
    Fixed,
    Gear,
    PointOnLine,
    Polar,
    Prismatic,
    RackAndPinion,
    XDriver,
    YDriver,
)
from refkin.model import Body, Effect, Mechanism, Point, Scene
from refkin.motion import Status
from refkin.motion_laws import Integral, Polynomial, Sinusoid, Table
from refkin.scenes.linkages import FourBar, InvertedSliderCrank, SliderCrank

TIMES = tuple(np.linspace(0.0, 1.2, 7).tolist())
WAVE = Sinusoid(offset=0.9, amplitude=0.6, angular_frequency=1.3, phase=0.4)
"""Neither its rate nor its acceleration vanishes at any of the times."""
FOUR_BAR = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
LIMITED = FourBar(ground=4.0, crank=3.0, coupler=2.0, rocker=2.5)


@dataclass(frozen=True)
class Question:
    """A scene to ask an engine, what it is about in a few words, and the reference's verdict."""

    about: str
    scene: Scene
    expected: Status = Status.OK


def questions() -> tuple[Question, ...]:
    """Return all questions, the plainest first; no two are about the same."""
    of_space = (Question(*asked) for asked in spatial_scenes(WAVE, TIMES[::2]))
    asked = (*_joints(), *_drivers_and_laws(), *_ways_to_say_it(), *_without_answer(), *of_space)
    return (*asked, *(_by_rate(question) for question in asked if question.about in BY_RATE))


BY_RATE = (
    *("x of a point driven", "y of a point driven", "distance driven"),
    *("space: revolute", "space: displacement driven", "space: distance driven"),
)
"""What is asked about once more with the rate of its law instead of the law: one of each driver but the angle."""


def _by_rate(question: Question) -> Question:
    (driver,) = question.scene.mechanism.drivers
    wave: Any = driver.law
    rate = replace(wave, amplitude=wave.amplitude * wave.angular_frequency, phase=wave.phase + math.pi / 2, offset=0.0)
    given = replace(driver, law=Integral(rate=rate, initial=wave(0.0)))  # type: ignore[arg-type]
    mechanism = replace(question.scene.mechanism, drivers=(given,))
    return Question(f"{question.about}, by a rate", replace(question.scene, mechanism=mechanism))


CRANK = pin("O", GROUND, (0.0, 0.0), "crank", (-0.5, 0.0))
"""The pivot of a crank of 1 m, whose frame is in its middle."""


MOTOR = AngleDriver(name="motor", body="crank", law=WAVE)


def _scene(poses: dict[str, tuple[float, float, float]], *joints: Constraint, driver: Driver = MOTOR) -> Scene:
    """Return a scene; poses are rough."""
    bodies = tuple(Body(name=name, estimate=pose) for name, pose in poses.items())
    return Scene(mechanism=Mechanism(bodies, joints, (driver,)), times=TIMES, name="conformance")


def _joints() -> Iterator[Question]:
    crank = {"crank": (0.21, 0.45, 1.13)}
    along = (0.3, 0.4)
    yield Question("revolute", FOUR_BAR.scene(law=WAVE, times=TIMES))
    yield Question("prismatic", SliderCrank(crank=1.0, rod=3.0, offset=0.4).scene(law=WAVE, times=TIMES))
    slot = Prismatic(name="slot", **ends("lever", (0.0, 0.3), "block", (0.1, 0.0)), axis_i=(1.0, 0.2), angle=0.4)
    pins = (pin("A", "crank", (0.5, 0.0), "block", (0.0, 0.0)), pin("B0", GROUND, (3.0, 0.0), "lever", (0.0, 0.0)))
    moving = {**crank, "block": (0.42, 0.91, 2.9), "lever": (3.0, 0.0, 2.5)}
    yield Question("prismatic between moving bodies", _scene(moving, CRANK, *pins, slot))
    on_line = PointOnLine(name="line", **ends(GROUND, (0.3, -0.2), "rod", (2.5, 0.1)), axis_i=along)
    inverted = InvertedSliderCrank(ground=3.0, crank=1.0, offset=0.3).scene(law=WAVE, times=TIMES)
    yield Question("point_on_line of a moving body", inverted)
    rod = {**crank, "rod": (0.42, 0.91, 0.66)}
    yield Question("point_on_line", _scene(rod, CRANK, pin("A", "crank", (0.5, 0.0), "rod", (0.0, 0.0)), on_line))
    link = Distance(name="link", **ends("crank", (0.5, 0.0), "rocker", (1.5, 0.0)), length=3.5)
    pivot = pin("B0", GROUND, (4.0, 0.0), "rocker", (-1.5, 0.0))
    yield Question("distance", _scene({**crank, "rocker": (3.6, 1.45, 1.84)}, CRANK, pivot, link))
    plate = Fixed(name="weld", **ends("crank", (0.5, 0.1), "plate", (-0.3, 0.2)), angle=0.4)
    yield Question("fixed", _scene({**crank, "plate": (0.54, 1.24, 1.53)}, CRANK, plate))
    wheel = {**crank, "wheel": (2.0, 0.5, -1.7)}
    axle = pin("W", GROUND, (2.0, 0.5), "wheel", (0.0, 0.0))
    mesh = Gear(name="mesh", body_i="crank", radius_i=1.2, body_j="wheel", radius_j=0.8, phi0_i=0.2, phi0_j=-0.3)
    yield Question("gear", _scene(wheel, CRANK, axle, mesh))
    inner = {**wheel, "wheel": (2.0, 0.5, 1.1)}
    yield Question("internal gear", _scene(inner, CRANK, axle, replace(mesh, radius_j=-0.8)))
    arm = pin("W", "crank", (0.5, 0.0), "wheel", (0.0, 0.0))
    planet = replace(mesh, body_i=GROUND, carrier="crank", radius_i=-1.2)
    yield Question("gear on a carrier", _scene({**crank, "wheel": (0.42, 0.91, -1.15)}, CRANK, arm, planet))
    rack_guide = Prismatic(name="guide", **ends(GROUND, (0.0, 1.4), "rack"), axis_i=along, angle=0.2)
    teeth = ends("rack", (0.1, 0.0), "crank", (-0.5, 0.0))
    rack = RackAndPinion(name="teeth", **teeth, axis_i=along, radius=0.7, phi0=0.3, s0=0.2)
    yield Question("rack_and_pinion", _scene({**crank, "rack": (-1.2, -0.21, 0.2)}, CRANK, rack_guide, rack))
    below = replace(rack, radius=-0.7)
    yield Question("rack on the other side", _scene({**crank, "rack": (-0.66, 0.52, 0.2)}, CRANK, rack_guide, below))
    lift = Prismatic(name="guide", **ends(GROUND, (0.2, 0.0), "follower"), axis_i=(0.0, 1.0), angle=0.3)
    for about, cam, height in _cams():
        yield Question(about, _scene({**crank, "follower": (0.2, height, 0.3)}, CRANK, lift, cam))


def _cams() -> Iterator[tuple[str, Cam, float]]:
    """Yield each follower on a disc off its pivot, and on a profile of its own, and how high it is at first [m]."""
    law = Sinusoid(offset=1.0, amplitude=0.1, angular_frequency=1.0)
    disc = {"name": "cam", **ends("crank", (-0.3, 0.1), "follower", (0.1, -0.2)), "profile": Disc(radius=1.1)}
    general = {"name": "cam", **ends("crank", (-0.5, 0.0), "follower", (0.1, -0.2)), "profile": Polar(law=law)}
    for name, shape, heights in (("disc", disc, (1.49, 1.42, 1.69)), ("profile", general, (1.22, 1.1, 1.38))):
        yield f"cam: flat on a {name}", Cam(**shape, follower="flat", normal_j=(0.5, 1.75)), heights[0]
        yield f"cam: point on a {name}", Cam(**shape, follower="point"), heights[1]
        yield f"cam: roller on a {name}", Cam(**shape, follower="roller", roller_radius=0.25), heights[2]


def _drivers_and_laws() -> Iterator[Question]:
    slider = SliderCrank(crank=1.0, rod=3.0, offset=0.4)
    travel = replace(WAVE, offset=3.2, amplitude=0.3)
    relative = FOUR_BAR.scene(law=replace(WAVE, offset=-0.4), times=TIMES, driven="coupler", relative_to="crank")
    yield Question("angle between bodies, driven", relative)
    yield Question("x driven", slider.scene(law=travel, times=TIMES, driven="slider"))
    upright = replace(slider, angle=math.pi / 2)
    yield Question("y driven", upright.scene(law=travel, times=TIMES, driven="slider"))
    at = ends(GROUND, (2.0, 0.0), "crank", (0.5, 0.0))
    piston = DistanceDriver(name="piston", **at, law=replace(WAVE, offset=2.0, amplitude=0.4))
    yield Question("distance driven", _scene({"crank": (0.04, 0.5, 1.48)}, CRANK, driver=piston))
    held: dict[str, Any] = {"body": "crank", "point": (0.5, 0.1), "law": replace(WAVE, offset=0.1, amplitude=0.3)}
    by_x, by_y = XDriver(name="x", **held), YDriver(name="y", **held)
    yield Question("x of a point driven", _scene({"crank": (0.16, 0.47, 1.25)}, CRANK, driver=by_x))
    yield Question("y of a point driven", _scene({"crank": (0.5, 0.06, 0.12)}, CRANK, driver=by_y))
    laws: dict[str, Any] = {
        "polynomial": Polynomial(coefficients=(0.3, 1.1, -0.4, 0.2)),
        "table": Table(argument=(-1.0, -0.3, 0.5, 0.8, 1.1, 3.0), value=(0.2, 0.4, 0.7, 1.1, 1.0, 0.9)),
        "periodic table": Table(argument=(0.0, 0.3, 0.5, 0.9), value=(0.4, 0.7, 0.6, 0.4), periodic=True),
        "rate": Integral(rate=WAVE, initial=0.3),
    }
    for name, law in laws.items():
        yield Question(f"law: {name}", FOUR_BAR.scene(law=law, times=TIMES))
    moved = replace(CRANK, offset_law=(replace(WAVE, amplitude=0.2), Polynomial(coefficients=(0.1, 0.3))))
    yield Question("revolute with an offset by a law", _scene({"crank": (1.19, 0.55, 1.13)}, moved))


def _ways_to_say_it() -> Iterator[Question]:
    plain = FOUR_BAR.scene(law=WAVE, times=TIMES)
    m = plain.mechanism
    pins: Any = m.joints
    turned = tuple(pin(j.name, j.body_j, j.point_j, j.body_i, j.point_i) for j in pins)
    yield Question("the ground as second body", replace(plain, mechanism=replace(m, joints=turned)))
    yield Question("the other assembly", FOUR_BAR.scene(law=WAVE, times=TIMES, branch="crossed"))
    small = FourBar(ground=0.004, crank=0.001, coupler=0.0035, rocker=0.003, origin=(0.05, -0.02), angle=0.7)
    yield Question("millimetres, away from the origin, turned", small.scene(law=WAVE, times=TIMES))
    beside = tuple(replace(j, point_j=(j.point_j[0], 0.4)) if j.body_j == "rocker" else j for j in pins)
    yield Question("a frame beside its joints", replace(plain, mechanism=replace(m, joints=beside)))
    yield Question("positions alone", replace(plain, effects=frozenset()))
    yield Question("velocities alone", replace(plain, effects=frozenset({Effect.VELOCITY})))
    yield Question("accelerations alone", replace(plain, effects=frozenset({Effect.ACCELERATION})))
    yield Question("some of the bodies", replace(plain, bodies_wanted=("rocker",)))
    at = {"P": ("coupler", (1.3, -0.7)), "Q": ("rocker", (0.4, 0.9))}
    points = tuple(Point(name=name, body=body, position=place) for name, (body, place) in at.items())
    yield Question("points of two bodies", replace(plain, points=points))
    apart = FOUR_BAR.scene(law=WAVE, times=(-0.9, -0.1, 0.0, 0.05, 0.8))
    yield Question("times before zero, not evenly apart", apart)
    yield Question("one time", replace(plain, times=TIMES[:1]))


def _without_answer() -> Iterator[Question]:
    plain = FOUR_BAR.scene(law=WAVE, times=TIMES)
    m = plain.mechanism
    far = tuple(replace(j, point_i=(8.5, 0.0)) if j.name == "B0" else j for j in m.joints)  # type: ignore[call-arg]
    yield Question("parts that do not meet", replace(plain, mechanism=replace(m, joints=far)), Status.UNASSEMBLABLE)
    (_, limit), *_ = LIMITED.input_range()
    law = Polynomial(coefficients=(limit - 0.5, 0.1))
    ends = replace(LIMITED.scene(law=law, times=TIMES), times=(0.0, 1.0, 2.0, 7.0))
    yield Question("driven beyond its limit", ends, Status.UNASSEMBLABLE)
