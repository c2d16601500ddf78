"""Scenes that are made of objects instead of read from a file: rows of any kind, what is no number, their size."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from decimal import Decimal

import numpy as np
import pytest

import crosscheck
import refkin
import refkin.scenes.files
from refkin import AngleDriver, Body, Integral, Mechanism, Point, Polynomial, Revolute, Scene, Sinusoid, Table
from refkin.analysis import sweep
from refkin.joints import Gear
from refkin.model import _diameter
from refkin.scenes.linkages import Hooke
from refkin.solving.follow import driven_by
from tests.linkages import ROCKER
from tests.places import EXAMPLES

LAW = Polynomial(coefficients=(0.0, 1.0))


def mechanism(pin=(0.0, 0.0), law=None, estimate=(0.0, 0.0, 0.0), name="crank", joint=None):
    ends = {"body_i": "ground", "point_i": pin, "body_j": "crank", "point_j": (0.0, 0.0)}
    return Mechanism(
        bodies=(Body(name=name, estimate=estimate),),
        joints=(Revolute(name="A", **(ends | (joint or {}))),),
        drivers=(AngleDriver(name="motor", body="crank", law=law or LAW),),
    )


def driven(**more):
    m = mechanism()
    return replace(m, drivers=(AngleDriver(**{"name": "motor", "body": "crank", **more}),))


def scene(**more):
    return Scene(**{"mechanism": mechanism(), "times": (0.0, 1.0), **more})


def loose(item):
    """What a program has rather than tuples: lists of objects, arrays of numbers."""
    if isinstance(item, tuple):
        numbers = item and all(isinstance(x, float) for x in item)
        return np.array(item) if numbers else [loose(x) for x in item]
    if hasattr(item, "__dataclass_fields__") and not isinstance(item, type):
        return replace(item, **{key: loose(getattr(item, key)) for key in (f.name for f in fields(item) if f.init)})
    return item


@pytest.mark.parametrize("file", sorted(EXAMPLES.glob("*.toml")), ids=lambda file: file.stem)
def test_lists_and_arrays_make_the_same_scene(file):
    strict = refkin.load(file)
    m = strict.mechanism
    parts = [loose(x) for x in (m.bodies, m.joints, m.drivers)]
    again = replace(
        strict, mechanism=Mechanism(*parts), times=np.array(strict.times), effects=list(strict.effects),
        points=loose(strict.points),
    )  # fmt: skip

    assert again == strict
    assert hash(again.mechanism) == hash(m)


ROW = np.array([1.0, 2.0])
SYSTEM = refkin.compile_system(mechanism())
TABLE = Table(argument=np.array([0.0, 1.0, 2.0]), value=[0.0, 1.0, 1.5])
WRONG = {
    "joint[0].point_i: expected a row of 2 numbers, got ('a', 0.0)": lambda: mechanism(pin=("a", 0.0)),
    "joint[0].point_i: expected a row of 2 numbers, got 'ab'": lambda: mechanism(pin="ab"),
    "joint[0].point_i: expected a row of 2 numbers\n": lambda: mechanism(pin=None),
    "joint[0].point_i: expected a row of 2 numbers, got (1j, 0.0)": lambda: mechanism(pin=(1j, 0.0)),
    "joint[0].point_i: expected a row of 2 numbers, got (1.0,)": lambda: mechanism(pin=[1.0]),
    "body[0].estimate: expected a row of numbers, got 5.0": lambda: mechanism(estimate=5.0),
    "body[0].estimate: expected a row of numbers, got 'abc'": lambda: mechanism(estimate="abc"),
    "body[0].name: expected a name that is not empty, got 5": lambda: mechanism(name=5),
    "driver[0].law.coefficients: expected a row of numbers, got 2.0": lambda: mechanism(
        law=Polynomial(coefficients=2.0)
    ),
    "driver[0].law: expected a law, got 'abc'": lambda: mechanism(law="abc"),
    "driver[0].law.offset: expected a number\n": lambda: mechanism(
        law=Sinusoid(amplitude=1.0, angular_frequency=1.0, offset=None)
    ),
    "joint[0].point_i: expected a row of 2 numbers, got (np.float32(nan), 0.2)": lambda: mechanism(
        pin=(np.float32("nan"), 0.2)
    ),
    "body[0].estimate: expected a row of numbers, got (100000": lambda: mechanism(estimate=(10**400, 0.0, 0.0)),
    "driver[0].rate_law: expected a law, got 3.0": lambda: driven(rate_law=3.0),
    "driver[0].law: expected a law, got <class 'refkin.motion_laws.Polynomial'>": lambda: driven(law=Polynomial),
    "body[0]: expected a body, got (Body(name='crank'": lambda: Mechanism([[mechanism().bodies[0]]], ()),
    "body[0]: expected a body, got <class 'refkin.model.Body'>": lambda: Mechanism([Body], ()),
    "times: expected a tuple, or a list, got b'ab'": lambda: scene(times=b"ab"),
    "times: expected numbers [s], got [(1+0j)]": lambda: scene(times=np.ones(1, complex)),
    "times: expected a tuple, or a list, got 2.0": lambda: scene(times=np.array(2.0)),
    "times: expected numbers [s], got [Decimal('1')]": lambda: scene(times=[Decimal(1)]),
    "body: expected a tuple, or a list, got Body(name='crank'": lambda: Mechanism(mechanism().bodies[0], ()),
    "joint[0]: expected a joint, got Body(name='crank'": lambda: Mechanism(mechanism().bodies, mechanism().bodies),
    "driver: expected a tuple, or a list": lambda: Mechanism(mechanism().bodies, mechanism().joints, None),
    "times: expected a tuple, or a list, got 'abc'": lambda: scene(times="abc"),
    "times: expected a tuple, or a list, got 1.0": lambda: scene(times=1.0),
    "times: expected numbers [s], got ['0', '1']": lambda: scene(times=["0", "1"]),
    "times: expected numbers [s], got [(0.0, 0.0)]": lambda: scene(times=np.zeros((1, 2))),
    "effects: expected some of velocity, acceleration, got 'speed'": lambda: scene(effects=["speed"]),
    "bodies_wanted: expected a tuple, or a list, got 'crank'": lambda: scene(bodies_wanted="crank"),
    "point[0].position: expected a row of numbers, got 'ab'": lambda: scene(
        points=[Point(name="P", body="crank", position="ab")]
    ),
    "joint[0].body_j: expected a body of the scene: ground, crank\n": lambda: mechanism(joint={"body_j": None}),
    "driver[0].body: expected a body of the scene: ground, crank\n": lambda: driven(body=None, law=LAW),
    "driver[0].relative_to: expected a body of the scene: ground, crank\n": lambda: driven(relative_to=None, law=LAW),
    "driver[0].body: expected two different bodies, this one and `relative_to`, got 'ground'": lambda: driven(
        body="ground", law=LAW
    ),
    "driver[0].rate_law: expected a law that is no integral itself, got Integral(": lambda: driven(
        rate_law=Integral(rate=LAW)
    ),
    "driver[0].rate_law: expected a law that is no integral itself, got Integral(rate=P": lambda: driven(
        law=Integral(rate=Integral(rate=LAW))
    ),
    "times: expected numbers [s], got [True]": lambda: scene(times=(True,)),
    "joint[0].point_i: expected a row of 2 numbers, got (True, 0.0)": lambda: mechanism(pin=(True, 0.0)),
    "joint[0]: expected a joint, got AngleDriver(": lambda: Mechanism(mechanism().bodies, mechanism().drivers),
    "driver[0]: expected a driver, got Revolute(": lambda: Mechanism(
        mechanism().bodies, mechanism().joints, (replace(mechanism().joints[0], name="B"),)
    ),
    "body[0].name: expected a name that is not empty, got {}": lambda: mechanism(name={}),
    "joint[0].body_i: expected a body of the scene: ground, crank, got {}": lambda: mechanism(joint={"body_i": {}}),
    "driver[0].body: expected a body of the scene: ground, crank, got {}": lambda: driven(body={}, law=LAW),
    "driver[0].relative_to: expected a body of the scene: ground, crank, got {}": lambda: driven(
        relative_to={}, law=LAW
    ),
    "driver[0].name: expected a name that is not empty, got {}": lambda: driven(name={}, law=LAW),
    "driver[0].law.periodic: expected False or True, got {}": lambda: mechanism(law=replace(TABLE, periodic={})),
    "driver[0].law.periodic: expected False or True, got 'no'": lambda: mechanism(law=replace(TABLE, periodic="no")),
    "effects: expected some of velocity, acceleration, got {}": lambda: scene(effects=[{}]),
    "evidence: expected some of condition, certificate, got {}": lambda: scene(evidence=[{}]),
    "driven: expected crank; rocker; coupler": lambda: ROCKER.scene(driven=ROW),
    "turns: expected so few that they end at some time, at 2.0 rad/s, got 1e+308": lambda: ROCKER.scene(turns=1e308),
    "turns: expected so few that they end at some time, at 5e-324 rad/s, got 1": lambda: ROCKER.scene(speed=5e-324),
}


@pytest.mark.parametrize("made", WRONG.values(), ids=WRONG)
def test_what_is_no_number_or_no_row_is_told_where_a_scene_is_made(made, request):
    said = next(text for text, one in WRONG.items() if one is made)
    with pytest.raises(refkin.InvalidScene) as caught:
        made()
    assert said in f"{caught.value}\n"


def test_a_law_of_arrays_moves_a_scene_as_one_of_tuples_does():
    one, other = (
        refkin.solve(scene(mechanism=mechanism(law=law)))
        for law in (TABLE, Table(argument=(0.0, 1.0, 2.0), value=(0.0, 1.0, 1.5)))
    )
    assert one.verdict == "ok"
    assert np.array_equal(one.q, other.q)


@pytest.mark.parametrize("kind", [int, np.int32, np.float32, float, object])
def test_arrays_of_any_numbers_are_numbers_of_python(kind):
    made = scene(mechanism=mechanism(pin=np.array([1, 2], kind)), times=np.array([0, 1], kind))

    assert made == refkin.scenes.files.parse(refkin.scenes.files.to_dict(made))
    assert all(type(t) in (int, float) for t in made.times)


@pytest.mark.parametrize(
    "times", [range(3), (float(k) for k in range(3)), dict.fromkeys((0, 1, 2))], ids=["range", "generator", "keys"]
)
def test_times_may_come_from_anything_that_yields_them(times):
    assert scene(times=times) == scene(times=(0.0, 1.0, 2.0))


ASKED = {
    "q0: expected 3 coordinates, got 'abc'": lambda: refkin.position(SYSTEM, "abc", 0.0),
    "q0: expected 3 coordinates, got [1j, 0, 0]": lambda: refkin.position(SYSTEM, [1j, 0, 0], 0.0),
    "q0: expected 3 coordinates, got [None, 0, 0]": lambda: refkin.position(SYSTEM, [None, 0, 0], 0.0),
    "q0: expected 3 coordinates, got [[0], [1, 2], 0]": lambda: refkin.position(SYSTEM, [[0], [1, 2], 0], 0.0),
    "q0: expected 3 coordinates, got shape (3, 2)": lambda: refkin.position(SYSTEM, np.zeros((3, 2)), 0.0),
    "t: expected a time [s], got '0'": lambda: refkin.position(SYSTEM, [0, 0, 0], "0"),
    "t: expected a time [s], got shape (2,)": lambda: refkin.position(SYSTEM, [0, 0, 0], ROW),
    "q: expected 3 coordinates, got 'abc'": lambda: refkin.velocity(SYSTEM, "abc", 0.0),
    "q: expected 3 coordinates, got shape ()": lambda: SYSTEM.phi(0.0, 0.0),
    "t: expected a time [s], or one for each pose, got None": lambda: refkin.velocity(SYSTEM, np.zeros(3), None),
    "t: expected a time [s], or one for each pose, got shape (2,)": lambda: refkin.velocity(
        SYSTEM, np.zeros((3, 5)), ROW
    ),
    "phi_q: expected the Jacobian of each pose, got shape (2,)": lambda: refkin.velocity(SYSTEM, np.zeros(3), 0.0, ROW),
    "qd: expected velocities in the shape of q, got shape (1,)": lambda: refkin.acceleration(
        SYSTEM, [0, 0, 0], [0], 0.0
    ),
    "scene: expected a Scene, got a Mechanism": lambda: driven_by(mechanism(), "motor"),
    "driver: expected a str, got a ndarray": lambda: driven_by(scene(), ROW),
    "scene: expected a Scene, got a NoneType": lambda: sweep(None),
    "unit.size: expected a finite number above 0, got 'a'": lambda: refkin.compile_system(
        mechanism(), unit=refkin.Unit("a")
    ),
    "unit.origin: expected two or three numbers, got None": lambda: refkin.compile_system(
        mechanism(), unit=refkin.Unit(1.0, None)
    ),
    "certified: expected True or False, got array([1., 2.])": lambda: refkin.solve(scene(), certified=ROW),
    "certified: expected True or False, got 2": lambda: refkin.solve(scene(), certified=2),
    "damped: expected True or False, got array([1., 2.])": lambda: refkin.newton(abs, abs, 1.0, damped=ROW),
    "q0: expected a number or a row of numbers, got '1'": lambda: refkin.newton(abs, abs, "1"),
    "show: expected True or False, got array([1., 2.])": lambda: crosscheck.compare(scene(), [], show=ROW),
    "q: expected 3 numbers, got 'abc'": lambda: refkin.diagnose(scene(), q="abc"),
    "q: expected 3 numbers, got {}": lambda: refkin.diagnose(scene(), q={}),
    "q: expected 3 numbers, got 1.0": lambda: refkin.diagnose(scene(), q=1.0),
    "q: expected 3 numbers, got 1000": lambda: refkin.diagnose(scene(), q=10**400),
    "q: expected 3 numbers, got ['0', '0', '0']": lambda: refkin.diagnose(scene(), q=["0"] * 3),
    "q: expected 3 numbers, got [1j, 1j, 1j]": lambda: refkin.diagnose(scene(), q=[1j] * 3),
    "q: expected 3 numbers, got array([[0.": lambda: refkin.diagnose(scene(), q=np.zeros((3, 2))),
    "q is no pose at t = 0: its largest scaled residual is inf": lambda: refkin.diagnose(scene(), q=[np.inf, 0.0, 0.0]),
    "t: expected a finite time [s], got 'a'": lambda: refkin.diagnose(scene(), q=np.zeros(3), t="a"),
    "t: expected a finite time [s], got nan": lambda: refkin.diagnose(scene(), t=math.nan),
    "t: expected a finite time [s], got array([1., 2.])": lambda: refkin.diagnose(scene(), t=ROW),
    "path: expected a str or PathLike, got a NoneType": lambda: refkin.load(None),
    "path: expected a str or PathLike, got a int": lambda: refkin.load(3),
    "phi: expected a Callable, got a NoneType": lambda: refkin.newton(None, abs, 1.0),
    "phi_q: expected a Callable, got a int": lambda: refkin.newton(abs, 3, 1.0),
    "q0: expected numbers, got 1000": lambda: refkin.newton(abs, abs, 10**400),
    "phi: expected numbers, got 'a'": lambda: refkin.newton(lambda q: "a", abs, 1.0),
    "phi_q: expected a matrix of shape (1, 1), got shape () of <U1": lambda: refkin.newton(abs, lambda q: "a", 1.0),
    "name: expected a str, got a ndarray": lambda: ROCKER.scene(name=ROW),
    "until: expected two numbers, got ['0', '3']": lambda: refkin.follow(scene(), until=["0", "3"]),
    "until: expected two values that t = 0, where the path begins, is between, got (1.0, 2.0)": lambda: refkin.follow(
        scene(), until=ROW
    ),
    "no body is called array([1., 2.]); there are: crank": lambda: refkin.solve(scene())[ROW],
    "no part is called 'x'; there are: tip": lambda: refkin.solve(
        scene(points=[Point(name="tip", body="crank", position=(1.0, 0.0))])
    ).points["x"],
    "no part is called 'x'; there are: none": lambda: refkin.solve(scene()).contacts["x"],
    "no part is called 'x'; there are: crank": lambda: SYSTEM.columns("x"),
    "t: expected a finite time [s], got 'x'": lambda: refkin.solve(scene()).plot("x"),
    "t: expected a finite time [s], got 1000": lambda: refkin.solve(scene()).plot(10**400),
    "velocity: expected True or False, got array([1., 2.])": lambda: refkin.solve(scene()).plot(velocity=ROW),
    "acceleration: expected True or False, got {}": lambda: refkin.solve(scene()).plot(acceleration={}),
    "seconds: expected a number above 0, got 'a'": lambda: refkin.solve(scene()).animate("a"),
    "file: expected a str or PathLike, got a bool": lambda: refkin.solve(scene()).to_csv(True),
    "file: expected a str or PathLike, got a int": lambda: refkin.solve(scene()).plot().save(3),
    "form: expected 'wide' or 'long', got ['wide']": lambda: refkin.solve(scene()).to_dataframe(["wide"]),
    "value: expected a finite number [rad, or m], got 'a'": lambda: ROCKER.plot("a"),
    "value: expected a finite number [rad], got 'a'": lambda: Hooke(beta=0.5).assemble("a"),
    "FourBar: crank: expected a length above 0 [m], got -1.0": lambda: refkin.FourBar(4.0, np.float64(-1.0), 3.5, 3.0),
    "FourBar: crank: expected a length above 0 [m], got np.float32(inf)": lambda: refkin.FourBar(
        4.0, np.float32(math.inf), 3.5, 3.0
    ),
    "mechanism: body[0].estimate: expected 3 numbers, not 2, got [0.0, 0.5]": lambda: refkin.Mechanism(
        (refkin.Body(name="crank", estimate=(*np.array([0.0, 0.5]),)),), mechanism().joints, mechanism().drivers
    ),
    "law: expected drivers whose rates are at most 1e+300": lambda: refkin.follow(scene(mechanism=SHAKEN)),
}
SHAKEN = mechanism(law=Sinusoid(amplitude=1.0, angular_frequency=1e308))


@pytest.mark.parametrize("asked", ASKED.values(), ids=ASKED)
def test_an_argument_that_makes_no_sense_is_told_with_what_was_expected(asked):
    said = next(text for text, one in ASKED.items() if one is asked)
    with pytest.raises((refkin.RefkinError, TypeError, ValueError)) as caught:
        asked()
    assert str(caught.value).startswith(said)


def test_rates_beyond_float64_are_a_status_and_no_warning():
    motion = refkin.solve(scene(mechanism=SHAKEN))

    assert set(motion.status) == {refkin.Status.NOT_CONVERGED}
    assert "rates at t = 0 are too large for numbers" in motion.message


@pytest.mark.parametrize("until", [(0.0, 1.0), np.array([0.0, 1.0])], ids=["tuple", "array"])
def test_a_path_ends_where_a_row_of_two_numbers_says(until):
    assert refkin.follow(scene(), until=until).t[-1] == 1.0


def test_only_a_mechanism_moves():
    with pytest.raises(TypeError, match="mechanism: expected a Mechanism, got a NoneType"):
        scene(mechanism=None)


def test_a_scene_is_called_by_a_word():
    with pytest.raises(TypeError, match="name: expected a str, got a int"):
        scene(name=3)


@pytest.mark.parametrize("samples", [1, 10**12, "5", None])
def test_so_many_times_have_no_scene(samples):
    bars = refkin.FourBar(ground=4.0, crank=1.0, coupler=3.0, rocker=3.0)
    with pytest.raises(refkin.InvalidScene, match="samples: expected a whole number from 2 to 10000000"):
        bars.scene(samples=samples)


COUNT = 200
DRAW = np.random.default_rng(2)
CLOUDS = {
    "scattered": DRAW.normal(size=(COUNT, 2)),
    "on a line": np.stack([DRAW.uniform(size=COUNT), np.full(COUNT, 0.5)], axis=1),
    "upright": np.stack([np.full(COUNT, 0.5), DRAW.uniform(size=COUNT)], axis=1),
    "few places": DRAW.integers(0, 3, size=(COUNT, 2)).astype(float),
    "on a circle": np.stack([np.cos(np.arange(COUNT)), np.sin(np.arange(COUNT))], axis=1),
    "one place": np.ones((COUNT, 2)),
}


@pytest.mark.parametrize("cloud", CLOUDS)
def test_the_largest_distance_is_that_of_all_pairs(cloud):
    points = [tuple(p) for p in CLOUDS[cloud].tolist()]

    assert _diameter(points) == pytest.approx(max(math.dist(a, b) for a in points for b in points), rel=1e-15, abs=0.0)


@pytest.mark.parametrize("at", [(1.0, 0.3), (-3000.0, 1e-9)])
def test_a_hinge_that_is_stated_twice_has_no_size_by_rounding(at):
    """It was 5e-17 m, and of three poses one was ok."""
    twice = [(0.3, 0.1), (math.nextafter(0.3, 1.0), 0.1)]
    pins = [
        Revolute(name=f"pin {k}", body_i="ground", point_i=at, body_j="wheel", point_j=p) for k, p in enumerate(twice)
    ]
    motor = AngleDriver(name="motor", body="wheel", law=Polynomial(coefficients=(0.0, 1.0)))
    wheel = Body(name="wheel", estimate=(at[0] - 0.3, at[1] - 0.1, 0.0))
    mechanism = Mechanism((wheel,), pins, (motor,))

    assert mechanism.size() == 1.0
    assert refkin.solve(refkin.Scene(mechanism=mechanism, times=(0.0, 0.1, 0.5))).verdict is refkin.Status.OK


@pytest.mark.parametrize(("first", "second"), [(-0.3, 7.9), (-7.9, 0.3)])
def test_a_gear_brings_the_larger_of_its_radii(first, second):
    wheels = Gear(name="teeth", body_i="a", radius_i=first, body_j="b", radius_j=second)
    axes = tuple(
        Revolute(name=f"axis {k}", body_i="ground", point_i=(0.0, 0.0), body_j=k, point_j=(0.0, 0.0)) for k in "ab"
    )
    motor = AngleDriver(name="motor", body="a", law=Polynomial(coefficients=(0.0, 1.0)))

    assert Mechanism((Body(name="a"), Body(name="b")), (*axes, wheels), (motor,)).size() == 8.0
