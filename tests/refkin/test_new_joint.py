"""Joints and elements that exist nowhere but here: what a new one needs is known, and what it lacks is said."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np
import pytest

import refkin
from refkin import AngleDriver, Body, Effect, FourBar, Integral, Mechanism, Polynomial, Revolute, Scene, Sinusoid
from refkin.errors import InvalidRequest, InvalidScene, RefkinError
from refkin.fast import solve_large, solve_many
from refkin.fast import sweep as fast_sweep
from refkin.joints import (
    DRIVER_TYPES,
    SPATIAL_DRIVER_TYPES,
    DisplacementDriver,
    Distance,
    DistanceDriver,
    PointOnPlane,
    SpatialAngleDriver,
    SpatialDistance,
    SpatialDistanceDriver,
    SpatialPointDistance,
    SpatialRevolute,
    Spherical,
    XDriver,
    YDriver,
)
from refkin.joints.elements import OfPoints
from refkin.joints.planar import ends_of
from refkin.joints.spatial import BetweenSpatialPoints
from refkin.joints.spatial_terms import Span
from refkin.proof.assembly.assembly import assemblies
from refkin.scenes import files
from refkin.scenes.linkages import RSSR
from refkin.system import compile_system
from tests.refkin.joint_cases import BETWEEN

LOOP = RSSR(crank=1.0, coupler=3.0, rocker=2.0, pivot=(2.5, -0.5, 0.75), axis=(0.25, 1.0, 0.125), massless=True)
LAW = Polynomial(coefficients=(0.4, 1.0))


def with_rod(cls: Any, **size: float) -> Scene:
    """Return a loop of space whose rod is a joint of a class, of size 3 by whatever name."""
    scene = LOOP.scene(law=LAW, times=(0.0, 0.1, 0.2))
    (link,) = (j for j in scene.mechanism.joints if isinstance(j, SpatialDistance))
    ends = {key: getattr(link, key) for key in ("name", "body_i", "point_i", "body_j", "point_j")}
    joints = tuple(cls(**ends, **size) if j is link else j for j in scene.mechanism.joints)
    return replace(scene, mechanism=replace(scene.mechanism, joints=joints))


def test_a_joint_without_a_field_of_its_element_is_refused_where_its_class_is_written():
    """The element's default, a length of 0, was taken in silence, and no such loop closes."""
    with pytest.raises(TypeError, match=r"Rod: .* property `length`, which its element SpatialPointDistance takes"):

        @dataclass(frozen=True, kw_only=True)
        class Rod(BetweenSpatialPoints):
            span: float
            type: Literal["rod"] = "rod"
            formulas = (Span(),)
            consists_of = (SpatialPointDistance,)


@dataclass(frozen=True, kw_only=True)
class SpannedRod(BetweenSpatialPoints):
    """A rod that calls its length a span."""

    span: float
    type: Literal["spanned_rod"] = "spanned_rod"
    formulas = (Span(),)
    consists_of = (SpatialPointDistance,)

    @property
    def length(self) -> float:
        return self.span


def test_a_property_fills_the_field_of_an_element():
    scene, other = with_rod(SpannedRod, span=3.0), with_rod(SpatialDistance, length=3.0)
    (rod,) = (j for j in scene.mechanism.joints if isinstance(j, SpannedRod))

    assert [e.length for e in rod.elements()] == [3.0]
    assert refkin.solve(scene).verdict == "ok"
    np.testing.assert_array_equal(refkin.solve(scene).q, refkin.solve(other).q)


@dataclass(frozen=True, kw_only=True)
class Strut(OfPoints):
    """An element of its own: two points keep a distance."""

    kind = "strut"
    spins_about = ("point_i", "point_j")
    length: float


@dataclass(frozen=True, kw_only=True)
class StiffStrut(OfPoints):
    """An element of its own that does not say which spins it does not feel."""

    kind = "stiff strut"
    length: float


@dataclass(frozen=True, kw_only=True)
class OfStrut(SpatialDistance):
    """A rod between two points, of an element of its own."""

    type: Literal["of_strut"] = "of_strut"  # type: ignore[assignment]
    consists_of = (Strut,)


@dataclass(frozen=True, kw_only=True)
class OfStiffStrut(SpatialDistance):
    """The same, of an element that feels every spin."""

    type: Literal["of_stiff_strut"] = "of_stiff_strut"  # type: ignore[assignment]
    consists_of = (StiffStrut,)


def hung_rod(cls: Any) -> Scene:
    """Return a rod on the ball of a crank whose tip is on a plane and on a link: it spins about its own line."""
    tip, z, at = (2.2, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    hinge = {"axis_i": z, "zero_i": (1.0, 0.0, 0.0), "axis_j": z, "zero_j": (1.0, 0.0, 0.0)}
    joints = (
        SpatialRevolute(name="O", body_i="ground", point_i=at, body_j="crank", point_j=at, **hinge),
        Spherical(name="ball", body_i="crank", point_i=(1.0, 0.0, 0.0), body_j="rod", point_j=at),
        cls(name="link", body_i="ground", point_i=(3.0, 0.2, 0.1), body_j="rod", point_j=tip, length=1.0),
        PointOnPlane(name="plane", body_i="ground", point_i=(0, 0, 0.3), axis_i=(0, 0.1, 1), body_j="rod", point_j=tip),
    )
    bodies = (
        Body(name="crank", estimate=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.2)),
        Body(name="rod", estimate=(0.92, 0.39, 0.0, 1.0, 0.0, -0.1, -0.1)),
    )
    return Scene(
        mechanism=Mechanism(bodies, joints, (SpatialAngleDriver(name="motor", joint="O", law=LAW),)), times=(0.0, 0.2)
    )


def test_an_element_says_itself_which_spins_it_does_not_feel():
    scene, other = hung_rod(OfStrut), hung_rod(SpatialDistance)

    assert refkin.solve(scene).verdict == "ok"
    np.testing.assert_array_equal(refkin.solve(scene).q, refkin.solve(other).q)
    with pytest.raises(InvalidScene, match="1 more constraint"):
        hung_rod(OfStiffStrut)


ANGLE = {"name": "c", "body": "b"}


def turning(driver: Any, **more: Any) -> Scene:
    pivot = Revolute(name="O", body_i="ground", point_i=(0.0, 0.0), body_j="b", point_j=(0.5, 0.0), **more)
    return Scene(mechanism=Mechanism((Body(name="b"),), (pivot,), (driver,)), times=(0.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class Careless(Distance):
    """A link that says nothing of what its length may be."""

    type: Literal["careless"] = "careless"  # type: ignore[assignment]

    def faults(self, path: str) -> Any:
        return iter(())


def test_numbers_that_the_formulas_cannot_take_are_a_fault_of_the_joint():
    link = {**BETWEEN, "body_i": "ground", "name": "rod"}
    scene = turning(AngleDriver(**ANGLE, law=LAW))
    m = replace(scene.mechanism, joints=(*scene.mechanism.joints, Careless(**link, length=0.0)))

    with pytest.raises(
        InvalidScene, match=r"rod: expected numbers that the formulas .* can take \(float division by zero\)"
    ):
        refkin.solve(replace(scene, mechanism=m))


INTEGRAL = Integral(rate=Sinusoid(amplitude=0.3, angular_frequency=1.7, offset=2.0), initial=0.3)
DRIVERS = (
    AngleDriver(**ANGLE, law=INTEGRAL),
    XDriver(**ANGLE, law=INTEGRAL),
    YDriver(**ANGLE, law=INTEGRAL),
    DistanceDriver(**BETWEEN, law=INTEGRAL),
    SpatialAngleDriver(name="c", joint="j", law=INTEGRAL),
    DisplacementDriver(name="c", joint="j", law=INTEGRAL),
    SpatialDistanceDriver(
        name="c", body_i="a", point_i=(0.0, 0.0, 0.0), body_j="b", point_j=(0.0, 0.0, 0.0), law=INTEGRAL
    ),
)


def test_every_driver_has_a_case():
    assert {type(d) for d in DRIVERS} == {*DRIVER_TYPES, *SPATIAL_DRIVER_TYPES}


@pytest.mark.parametrize("driver", DRIVERS, ids=lambda d: type(d).__name__)
def test_a_law_given_as_a_rate_is_the_rate_law_of_every_driver(driver):
    assert driver == replace(driver, law=None, rate_law=INTEGRAL.rate, initial=INTEGRAL.initial)
    assert driver.laws == (INTEGRAL,)


@pytest.mark.parametrize("more", [{"initial": 0.5}, {"rate_law": INTEGRAL.rate}], ids=str)
def test_a_rate_is_given_once(more):
    driver = AngleDriver(**ANGLE, law=INTEGRAL, **more)

    assert list(driver.faults("driver[0]"))


def test_a_scene_with_a_law_given_as_a_rate_is_read_back_equal():
    scene = turning(AngleDriver(**ANGLE, law=INTEGRAL))

    assert files.parse(tomllib.loads(files.to_toml(scene))) == scene


def test_a_law_that_no_file_can_say_is_refused_where_it_would_be_written():
    scene = turning(AngleDriver(**ANGLE, law=LAW), offset_law=(INTEGRAL, LAW))

    assert refkin.solve(scene).verdict == "ok"
    with pytest.raises(InvalidRequest, match="Integral"):
        files.to_toml(scene)


@dataclass(frozen=True, kw_only=True)
class PlanarStrut(Distance):
    """A link of the plane, of an element of its own."""

    type: Literal["planar_strut"] = "planar_strut"  # type: ignore[assignment]

    def elements(self) -> Any:
        yield Strut(**ends_of(self), length=self.length)


def test_of_an_element_without_closed_form_that_is_said_and_not_that_the_group_is_large():
    scene = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene(samples=3)
    (pin,) = (j for j in scene.mechanism.joints if {j.body_i, j.body_j} == {"coupler", "rocker"})
    strut = PlanarStrut(name="strut", **ends_of(pin), length=0.5)
    held = XDriver(name="x", body="coupler", law=Polynomial(coefficients=(0.5,)))
    joints = (*(j for j in scene.mechanism.joints if j is not pin), strut)
    m = replace(scene.mechanism, joints=joints, drivers=(*scene.mechanism.drivers, held))
    said = assemblies(compile_system(m, unit=m.unit()), 0.3).message

    assert "no closed form of strut" in said
    assert "triad" not in said


def test_nothing_is_said_of_the_choice_where_there_is_one_assembly():
    scene = turning(AngleDriver(**ANGLE, law=LAW))
    m = replace(scene.mechanism, bodies=(Body(name="b", estimate=(0.0, 0.0, 2.8)),))
    message = refkin.solve(replace(scene, mechanism=m)).message

    assert message == ""


def with_formula(formula: str, changed: Any) -> Scene:
    """Return a four-bar whose pin B is a joint of its own class, one formula of which is changed."""

    @dataclass(frozen=True, kw_only=True)
    class Miscounted(Revolute):
        type: Literal["miscounted"] = "miscounted"  # type: ignore[assignment]

    setattr(Miscounted, formula, staticmethod(lambda *at: changed(getattr(Revolute, formula)(*at))))
    plain = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene(samples=2)
    joints = tuple(
        Miscounted(**{f.name: getattr(j, f.name) for f in fields(j) if f.name != "type"}) if j.name == "B" else j
        for j in plain.mechanism.joints
    )
    return replace(plain, mechanism=replace(plain.mechanism, joints=joints))


@pytest.mark.parametrize("rows", [1, 3])
@pytest.mark.parametrize("formula", ["residual", "nu", "gamma"])
def test_a_joint_with_other_rows_than_it_says_is_refused(formula, rows):
    """Its rows would be those of the joints after it: accelerations that are proved, and wrong."""
    scene = with_formula(formula, lambda own: (*own, 0.0)[:rows])
    with pytest.raises(RefkinError, match=f"^miscounted 'B': expected a formula to have 2 rows, got {rows}$"):
        refkin.solve(scene)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (lambda own: [block[:1] for block in own], "2 rows, got 1"),
        (lambda own: [(*block, (0, 0, 0)) for block in own], "2 rows, got 3"),
        (lambda own: [[row[:2] for row in block] for block in own], "3 columns, got 2"),
        (lambda own: [[(*row, 1) for row in block] for block in own], "3 columns, got 4"),
        (lambda own: own[:1], "2 blocks, got 1"),
    ],
    ids=["row short", "row more", "column short", "column more", "block short"],
)
def test_a_jacobian_of_another_shape_is_refused(changed, told):
    """A column more would be the next body's: velocities that are proved, and wrong."""
    with pytest.raises(RefkinError, match=f"^miscounted 'B': expected a formula to have {told}$"):
        refkin.solve(with_formula("jacobian", changed))


SOLVERS = {
    "solve": refkin.solve,
    "sweep": fast_sweep,
    "solve_many": lambda scene: solve_many(scene, {}),
    "solve_large": solve_large,
    "follow": refkin.follow,
}


@pytest.mark.parametrize("solved", SOLVERS.values(), ids=SOLVERS)
@pytest.mark.parametrize(
    ("formula", "changed", "told"),
    [
        (
            "jacobian",
            lambda own: [[(row[0], row[1], 2 * row[2]) for row in block] for block in own],
            r"jacobian\[0, 2\]",
        ),
        ("nu", lambda own: (own[0], 0.25), r"nu\[1\] to be the derivative of the residual, -?0, got 0.25"),
        ("gamma", lambda own: (own[0], -own[1]), r"gamma\[1\]"),
    ],
    ids=["jacobian", "nu", "gamma"],
)
def test_a_formula_that_is_not_the_derivative_of_the_residual_is_refused(formula, changed, told, solved):
    """A pose is proved by the residual: wrong rates came with a certified radius of 1e-17."""
    with pytest.raises(RefkinError, match=f"^miscounted 'B': expected {told}"):
        solved(with_formula(formula, changed))


def test_a_formula_that_takes_no_complex_number_is_named():
    scene = with_formula("residual", lambda own: (math.sin(own[0]), own[1]))
    with pytest.raises(RefkinError, match=r"^miscounted 'B': formulas add, subtract, .* by refkin.vec"):
        refkin.solve(scene)


def test_rates_that_nobody_calls_for_are_not_asked():
    scene = replace(with_formula("gamma", lambda own: (own[0], -own[1])), effects=frozenset({Effect.VELOCITY}))

    assert refkin.solve(scene).verdict == "ok"


@dataclass(frozen=True, kw_only=True)
class Motor(AngleDriver):
    """A driver of an angle under another name."""

    type: Literal["motor"] = "motor"  # type: ignore[assignment]


class Hasty(Motor):
    """One that says twice the rate of its law."""

    @staticmethod
    def nu(g, f, i, j):
        return (2 * f[0][1],)


class Blunt(Motor):
    """One that forgets how its law bends."""

    @staticmethod
    def gamma(g, f, i, j):
        return (0,)


def test_a_driver_of_ones_own_is_held_to_what_its_law_moves():
    law = Sinusoid(amplitude=0.4, angular_frequency=2.0)

    assert refkin.solve(turning(Motor(**ANGLE, law=law))).verdict == "ok"
    for cls, formula in ((Hasty, "nu"), (Blunt, "gamma")):
        with pytest.raises(RefkinError, match=rf"^motor 'c': expected {formula}\[0\] to be the derivative"):
            refkin.solve(turning(cls(**ANGLE, law=law)))
