"""A joint that exists nowhere but here, made of known elements: everybody solves, proves, reads and draws it."""

from __future__ import annotations

import importlib
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pytest

import refkin
from crosscheck.judge.levels import without_form
from crosscheck.measure.check import ROWS, check
from crosscheck.night.moving_parts import SceneDrawing
from refkin import AngleDriver, Body, Mechanism, Revolute, Scene, Status
from refkin.fast import attempt
from refkin.joints import AxesParallel, Element, GuidedPoint, Pair, PointInPlane, PointOnLine, RelativeAngle
from refkin.joints.base import Blocks, Constraint, Rows
from refkin.joints.planar import ends_of, unit_normal
from refkin.joints.spatial import PARALLEL, OfLines
from refkin.joints.spatial_terms import Guide
from refkin.motion_laws import Polynomial
from refkin.proof.assembly.rows import read_rows
from refkin.scenes import files, keys
from refkin.solving.mobility import count
from refkin.system import compile_system

ENGINES = ("exudyn", "mujoco", "pinocchio", "closed_form", "vector_loop")
OWN_ROWS = ("exudyn", "mujoco", "pinocchio")


@dataclass(frozen=True, kw_only=True)
class BesideSlider(Constraint):
    """Body j slides along a line to the left of an axis of body i: n . d = offset [m], phi_j - phi_i = angle."""

    rows = 2
    body_i: str
    point_i: Pair
    axis_i: Pair
    offset: float
    body_j: str
    point_j: Pair
    angle: float = 0.0
    type: Literal["beside_slider"] = "beside_slider"

    def elements(self) -> Iterator[Element]:
        yield GuidedPoint(**ends_of(self), axis_i=self.axis_i, offset=self.offset)
        yield RelativeAngle(body_i=self.body_i, body_j=self.body_j, angle=self.angle)

    def constants(self, unit: Any) -> tuple[float, ...]:
        return (*super().constants(unit), *unit_normal(self.axis_i), self.offset / unit.size, self.angle)

    @staticmethod
    def residual(g: Any, f: Any, i: Any, j: Any) -> Rows:
        (across,) = PointOnLine.residual(g, f, i, j)
        return across - g[6], j.phi - i.phi - g[7]

    @staticmethod
    def jacobian(g: Any, f: Any, i: Any, j: Any) -> Blocks:
        block_i, block_j = PointOnLine.jacobian(g, f, i, j)
        return (*block_i, (0, 0, -1)), (*block_j, (0, 0, 1))

    @staticmethod
    def gamma(g: Any, f: Any, i: Any, j: Any) -> Rows:
        return (*PointOnLine.gamma(g, f, i, j), 0)


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Scene files, with the joint named in `JOINT_TYPES`."""
    monkeypatch.setattr("refkin.joints.JOINT_TYPES", (*refkin.joints.JOINT_TYPES, BesideSlider))
    importlib.reload(keys)
    yield files
    monkeypatch.undo()
    importlib.reload(keys)


def slider_crank(joint: Any = BesideSlider, *, first: bool = False) -> Scene:
    """Return a crank of 0.5 m, a rod of 1.5 m and a slider at y = 0.2 m, turned by 0.3 rad; its guide first or last."""
    bodies = (
        Body(name="crank", estimate=(0.0, 0.0, 0.4)),
        Body(name="rod", estimate=(0.46, 0.19, 0.0)),
        Body(name="slider", estimate=(1.96, 0.2, 0.3)),
    )

    def pin(name: str, i: str, x: float, j: str) -> Revolute:
        return Revolute(name=name, body_i=i, point_i=(x, 0.0), body_j=j, point_j=(0.0, 0.0))

    pins = (pin("O", "ground", 0.0, "crank"), pin("A", "crank", 0.5, "rod"), pin("B", "rod", 1.5, "slider"))
    guide = joint(
        name="guide", body_i="ground", point_i=(-0.1, -0.1), axis_i=(2.0, 0.0), offset=0.3,
        body_j="slider", point_j=(0.0, 0.0), angle=0.3,
    )  # fmt: skip
    motor = AngleDriver(name="motor", body="crank", law=Polynomial(coefficients=(0.4, 1.0)))
    joints = (guide, *pins) if first else (*pins, guide)
    return Scene(
        mechanism=Mechanism(bodies, joints, (motor,)),
        times=tuple(np.linspace(0.0, 1.5, 7).tolist()),
        effects=frozenset({"velocity", "acceleration"}),
    )


def test_it_is_solved_and_certified():
    motion = refkin.solve(slider_crank())

    assert motion.verdict is Status.OK
    assert np.max(motion.certified_radius.position) < 1e-14
    assert np.allclose(motion.q[7:], np.array([[0.2], [0.3]]), rtol=0, atol=1e-15)


def test_the_fast_path_takes_it():
    scene = replace(slider_crank(), evidence=frozenset())

    assert np.allclose(attempt(scene).q, refkin.solve(scene).q, rtol=0, atol=1e-14)


def test_it_is_counted_and_all_of_it_stands_in_closed_form():
    mechanism = slider_crank().mechanism

    assert count(mechanism).mobility == 1
    assert read_rows(compile_system(mechanism, unit=mechanism.unit()), 0.0).foreign == ()


@dataclass(frozen=True, kw_only=True)
class HalfReadSlider(BesideSlider):
    """The same formulas; but of its second row its elements say nothing that a closed form reads."""

    def elements(self) -> Iterator[Element]:
        yield next(super().elements())
        yield AxesParallel(body_i=self.body_i, body_j=self.body_j, axis_i=(0, 0, 1), axis_j=(0, 0, 1))


def test_a_joint_that_is_read_by_halves_stands_in_no_closed_form():
    mechanism = slider_crank(HalfReadSlider).mechanism

    assert read_rows(compile_system(mechanism, unit=mechanism.unit()), 0.0).foreign == ("guide",)


def test_it_goes_through_a_scene_file(registered):
    scene = slider_crank()

    assert registered.parse(tomllib.loads(registered.to_toml(scene))) == scene


def test_its_guide_is_drawn():
    scene = slider_crank()
    drawing = SceneDrawing(scene, refkin.solve(scene))
    (_, y), _ = drawing.view.pixels(0.0, 0.2), None

    assert drawing.described("scene", "key")["guide"].count(f" {y:.1f}") == 2


@pytest.mark.parametrize("first", [True, False], ids=["as an edge of the tree", "closing the loop"])
@pytest.mark.parametrize("engine", ENGINES)
def test_every_engine_that_has_its_elements_answers_and_agrees(engine, first):
    record = check(slider_crank(first=first), [engine])

    assert list(record.disagreements) == []
    assert {answer.compared for answer in record.answers} == {7}
    assert bool(record.levels) == (engine in OWN_ROWS)


@dataclass(frozen=True, kw_only=True)
class SliderOnTwoPins(BesideSlider):
    """The same formulas; its elements hold two points of it on the line, the second a metre on, in its own frame."""

    def elements(self) -> Iterator[Element]:
        first, _ = super().elements()
        yield from (first, replace(first, point_j=(float(np.cos(self.angle)), -float(np.sin(self.angle)))))


def test_two_elements_of_a_kind_in_one_joint_have_unknowns_of_their_own_in_vector_loops():
    record = check(slider_crank(SliderOnTwoPins), ["vector_loop"])

    assert list(record.disagreements) == []
    assert {answer.compared for answer in record.answers} == {7}


@dataclass(frozen=True, kw_only=True)
class ElsewhereSlider(BesideSlider):
    """The same formulas; but its elements have the line a millimetre off."""

    def elements(self) -> Iterator[Element]:
        first, second = super().elements()
        yield from (replace(first, offset=self.offset + 1e-3), second)


@pytest.mark.parametrize("engine", ENGINES)
def test_an_element_that_is_not_what_the_formulas_say_is_seen_in_every_engine(engine):
    seen = {d.quantity for d in check(slider_crank(ElsewhereSlider), [engine]).disagreements}

    assert "position" in seen
    assert ("residual" in seen) == (engine in OWN_ROWS)


@dataclass(frozen=True, kw_only=True)
class Plate(OfLines):
    """In space: body j slides on a plane of body i, and turns about what stands upright on it."""

    type: Literal["plate"] = "plate"
    formulas = (PARALLEL, Guide("hi"))
    consists_of = (AxesParallel, PointInPlane)


@dataclass(frozen=True, kw_only=True)
class PlateOfOneForm(OfLines):
    """The same, by half angles alone."""

    type: Literal["plate of one form"] = "plate of one form"
    formulas = (PARALLEL["half"], Guide("hi"))
    consists_of = Plate.consists_of


def plate_on_a_crank(plate: Any = Plate) -> Scene:
    """Return a crank that draws a plate over a plane, which a rod holds too."""
    x, z, at_0 = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    axes: dict[str, Any] = {"axis_i": z, "zero_i": x, "axis_j": z, "zero_j": x}
    ground: dict[str, Any] = {"body_i": "ground", "point_i": at_0}
    joints = (
        refkin.SpatialRevolute(name="R", **ground, body_j="crank", point_j=at_0, **axes),
        refkin.Spherical(name="S", body_i="crank", point_i=x, body_j="plate", point_j=at_0),
        plate(name="P", **ground, body_j="plate", point_j=(0.0, 1.0, 0.0), **axes),
        refkin.SpatialDistance(
            name="D", body_i="ground", point_i=(4.0, 0.0, 0.0), body_j="plate", point_j=(3.0, 0.0, 0.0), length=1.5
        ),
    )
    motor = refkin.SpatialAngleDriver(name="motor", joint="R", law=Polynomial(coefficients=(0.4, 1.0)))
    bodies = (
        Body(name="crank", estimate=(0, 0, 0, 1, 0, 0, 0.2)),
        Body(name="plate", estimate=(1, 0.3, 0, 1, 0, 0, 0.1)),
    )
    return Scene(mechanism=Mechanism(bodies, joints, (motor,)), times=(0.0, 0.1, 0.2), name="plate")


def test_in_space_engines_read_it_element_by_element():
    record = check(plate_on_a_crank(), OWN_ROWS)

    assert record.reference.verdict == Status.OK
    assert [str(seen) for seen in record.disagreements] == []
    assert {answer.engine for answer in record.answers} == set(OWN_ROWS)
    assert {row.engine for row in record.levels} == {"exudyn", "mujoco", "pinocchio"}


@pytest.mark.parametrize("wrong", [False, True])
def test_rows_that_exudyn_has_in_a_form_which_the_formulas_have_not_are_not_compared_and_said(wrong):
    """The rest of them is: a plane elsewhere is seen."""
    scene = plate_on_a_crank(ElsewherePlate if wrong else PlateOfOneForm)
    record = check(scene, ["exudyn"])
    said = [str(refusal) for refusal in record.refusals if refusal.name == "P"]

    assert len(said) == 1
    assert "its rows are in the form 'dot', which the formulas have not" in said[0]
    assert [d.quantity for d in record.disagreements if d.method == ROWS] == ["residual"] * wrong
    assert {row.rows for row in record.levels} == {11}  # of 13
    assert len(check(plate_on_a_crank(), ["exudyn"]).refusals) == 0


@dataclass(frozen=True, kw_only=True)
class ElsewherePlate(PlateOfOneForm):
    """Its elements have the plane a millimetre off."""

    def elements(self) -> Iterator[Element]:
        first, second = super().elements()
        yield from (first, replace(second, point_i=(0.0, 0.0, 1e-3)))


@dataclass(frozen=True, kw_only=True)
class PlateOfItsOwn(PlateOfOneForm):
    """Its formulas are written out, without terms of space."""

    terms = property(lambda self: self.none)


def test_a_joint_whose_formulas_are_written_out_has_them_in_one_form():
    mechanism = plate_on_a_crank(PlateOfItsOwn).mechanism

    assert [c.name for c in without_form(mechanism, "dot")] == ["P"]
    assert without_form(mechanism, "half") == []
