"""An engine's own rows, where two points nearly meet far from the origin: there each side rounds in its own place."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import refkin
from crosscheck.engines import Level
from crosscheck.engines.frames import Linear
from crosscheck.engines.loading import load
from crosscheck.engines.mujoco import engine as mujoco_engine
from crosscheck.judge.levels import (
    LEVELS,
    Configuration,
    _in_common_columns,
    _ours,
    _turning,
    compare_levels,
    configurations,
    missing_rows,
)
from crosscheck.judge.running_error import parts, running
from crosscheck.measure.check import check, key_of
from refkin import AngleDriver, Body, Mechanism, Polynomial, Prismatic, Revolute, Scene, YDriver, compile_system
from refkin.scenes import files
from tests.places import CORPUS

from . import space_scenes

AXES = {"axis": (0.0, 0.0, 1.0), "zero": (1.0, 0.0, 0.0)}

GROUND_POINT = (116.83380688588964, 245.63337161426253)
LEVER_POINT = (-7.402744570506538e-06, 3e-6)


def lever() -> Scene:
    pin = Revolute(name="B0", body_i="lever", point_i=LEVER_POINT, body_j="ground", point_j=GROUND_POINT)
    driver = AngleDriver(name="driver", body="lever", law=Polynomial(coefficients=(0.2, 1.0)))
    return Scene(
        name="lever",
        mechanism=Mechanism((Body(name="lever", estimate=(*GROUND_POINT, 0.2)),), (pin,), (driver,)),
        times=(0.0, 1.0),
    )


def residual_ratio(name: str, fault: float = 0.0) -> float:
    """Return the worst error / allowed of an engine's residual at poses that all but close the joint."""
    return worst_residual(name, lever(), GROUND_POINT, fault)


def worst_residual(name: str, scene: Scene, place: tuple[float, float], fault: float = 0.0) -> float:
    """Return the worst error / allowed of an engine's residual with the only body near a place, at any angle."""
    engine = load(name)
    model = engine.constraints(scene)
    numbers = np.random.default_rng(1)
    at = []
    for _ in range(50):
        off = numbers.uniform(-1e-3, 1e-3, 2)
        q = np.array([*(np.array(place) + off), numbers.uniform(-3.0, 3.0)])
        at.append(Configuration(scene.mechanism, q, np.ones(3), 0.0, np.zeros(0)))
    exact, model.residual = model.residual, lambda q, t: exact(q + np.array([fault, 0.0, 0.0]), t)
    return compare_levels(engine, model, scene.mechanism, at, engine.terms(scene))[Level.RESIDUAL].ratio


@pytest.mark.parametrize("engine", ["exudyn", "pinocchio", "mujoco"])
def test_an_engine_may_round_the_places_of_points_before_it_subtracts_them(engine):
    assert residual_ratio(engine) < 0.5


@pytest.mark.parametrize("engine", ["exudyn", "pinocchio", "mujoco"])
def test_a_point_off_by_1e_11_is_found_all_the_same(engine):
    assert residual_ratio(engine, fault=1e-11) > 1.0


def lift() -> Scene:
    """A body that slides up."""
    origin = (0.0, 0.0)
    guide = Prismatic(name="guide", body_i="ground", point_i=origin, axis_i=(0.0, 1.0), body_j="lift", point_j=origin)
    driver = YDriver(name="driver", body="lift", law=Polynomial(coefficients=(5.4, 1.0)))
    mechanism = Mechanism((Body(name="lift", estimate=(0.0, 5.4, 0.0)),), (guide,), (driver,))
    return Scene(name="lift", mechanism=mechanism, times=(0.0, 1.0))


@pytest.mark.parametrize("engine", ["exudyn", "pinocchio", "mujoco"])
def test_a_frame_turned_by_a_right_angle_may_be_rounded(engine):
    assert worst_residual(engine, lift(), (0.0, 5.4)) < 1.0


def test_without_its_term_the_frame_of_mujoco_would_be_blamed(monkeypatch):
    monkeypatch.setattr(mujoco_engine, "SPATIAL", ())

    assert worst_residual("mujoco", lift(), (0.0, 5.4)) > 1.0


@pytest.mark.parametrize("engine", ["exudyn", "pinocchio", "mujoco"])
@pytest.mark.parametrize("spoil", [lambda rows: [], lambda rows: rows[1:], lambda rows: [rows[0], *rows]])
def test_a_row_that_an_engine_leaves_out_or_has_twice_is_owed(engine, spoil, monkeypatch):
    real, right = load(engine), load(engine).constraints(lever())

    class Model:
        rows = spoil(list(right.rows))

        def __getattr__(self, name):
            return getattr(right, name)

    monkeypatch.setattr(type(real), "constraints", lambda self, scene: Model())
    found = [d for d in check(lever(), [real]).disagreements if d.method == "rows"]

    assert [(d.quantity, d.kind) for d in found] == [("status", "not delivered")]
    assert "of B0" in found[0].message


class Nothing:
    def __call__(self, x, order):
        return 0.0 * x


class Loose(Linear):
    rounding = 1.0


@pytest.mark.parametrize(
    ("change", "spoilt", "kind"),
    [
        ({"factor": 0.0}, 0.0, "not delivered"),
        ({"form": Nothing()}, 0.0, "not delivered"),
        ({"form": Loose()}, 1.001, "model translated wrongly"),
    ],
)
def test_no_map_of_rows_makes_a_wrong_one_right(change, spoilt, kind, monkeypatch):
    real, right = load("pinocchio"), load("pinocchio").constraints(lever())

    class Model:
        rows = [replace(row, **change) for row in right.rows]  # noqa: RUF012

        def __getattr__(self, name):
            value = getattr(right, name)
            return (lambda *at: spoilt * value(*at)) if name in LEVELS else value

    monkeypatch.setattr(type(real), "constraints", lambda self, scene: Model())
    found = [d for d in check(lever(), [real]).disagreements if d.method == "rows"]

    assert {d.kind for d in found} == {kind}


def test_a_refused_joint_and_what_drives_it_are_not_owed():
    mechanism = space_scenes.screw_jack().mechanism
    model = load("exudyn").constraints(Scene(mechanism=mechanism, times=(0.0,)))

    assert [joint.type for joint in mechanism.joints if joint.type == "screw"]
    assert missing_rows(load("exudyn"), model, mechanism) == []


def test_a_row_that_states_one_number_is_allowed_what_its_rates_cost():
    """Rates are given as v and w = 2 E p', sums of four products: 1.6 times what was allowed of a row of p' alone."""
    mechanism = space_scenes.rssr().mechanism
    near = np.concatenate([body.estimate for body in mechanism.bodies])[:, None]
    at = configurations(mechanism, near, np.zeros(1), "rates", 40)
    engine = load("mujoco")
    model = engine.constraints(Scene(mechanism=mechanism, times=(0.0,)))

    assert compare_levels(engine, model, mechanism, at)[Level.CONSTRAINT_VELOCITY].ratio < 0.25


def test_turns_of_space_multiply_what_is_lost_of_a_place_far_from_the_origin():
    """Planted: the Jacobian of a row was allowed what it would be at the origin, and exudyn's was called wrong."""
    record = check(refkin.load(CORPUS / "space-turns-far-from-origin.toml"), ["exudyn", "pinocchio", "mujoco"])

    assert [d for d in record.disagreements if d.method not in {"shipped"}] == []
    assert {level.level for level in record.levels} == set(Level) - {Level.SOLVE}


def test_rows_of_turns_have_no_lengths():
    """Planted: in a linkage of 4 mm the drift of a turn was allowed millimetres times its rates, and MuJoCo blamed."""
    record = check(refkin.load(CORPUS / "space-turns-of-a-tiny-linkage.toml"), ["mujoco"])

    assert [d for d in record.disagreements if d.engine == "mujoco"] == []
    assert 0.0 < max(row.ratio for row in record.levels) < 0.25


def test_of_a_place_in_space_digits_are_lost_and_of_a_turn_none():
    """Bodies at the origin have none to lose, however they are turned."""
    m = space_scenes.rssr().mechanism
    system, count = compile_system(m), len(m.bodies)
    q, qd = np.tile([0.0, 0.0, 0.0, 0.5, 0.5, -0.5, 0.5], count), np.ones(7 * count)
    at = Configuration(m, q, qd, 0.0, np.zeros(0))
    exact = running(q, 0.0)
    slope, _ = _in_common_columns(system.phi_q(exact, 0.0), system.gamma(exact, running(qd), 0.0), at)

    assert np.array_equal(_ours(system, at)[Level.JACOBIAN][1], parts(slope)[1])


def test_the_bound_of_a_turning_is_the_same_about_every_axis():
    """Of w = 2 E p', each entry of E being a half."""
    q, qd = np.array([0.0, 0.0, 0.0, 0.5, 0.5, -0.5, 0.5]), np.array([1.0, -2.0, 3.0, 0.3, -0.2, 0.4, 0.1])
    bound = _turning(Configuration(space_scenes.rssr().mechanism, q, qd, 0.0, np.zeros(0)))

    np.testing.assert_allclose(bound, [1.0, 2.0, 3.0, 1.0, 1.0, 1.0], rtol=1e-15)


@pytest.mark.parametrize("scene", ["space-parameters-from-still.toml", "space-rates-from-still.toml"])
def test_what_exudyn_loses_of_parameters_far_from_still_is_not_called_a_wrong_model(scene):
    record = check(files.load(CORPUS / scene), ["exudyn"])

    assert [d for d in record.disagreements if d.method in ("rows", "static")] == []
    assert 0.0 < max(row.ratio for row in record.levels) < 0.5


def test_a_row_is_held_against_that_of_its_driver_though_a_body_with_a_row_has_the_same_name():
    scene = space_scenes.rssr()
    (crank, *_), (motor,) = scene.mechanism.bodies, scene.mechanism.drivers
    named = replace(scene, mechanism=replace(scene.mechanism, drivers=(replace(motor, name=crank.name),)))
    record = check(named, ["exudyn"])

    assert [d for d in record.disagreements if d.method == "rows"] == []


def test_the_shift_of_a_joint_in_gear_is_a_row_that_exudyn_has():
    """It has none of its turn: that is counted by a coordinate which no engine has."""
    at, along = (0.0, 0.0, 0.0), {f"{key}_{end}": v for key, v in AXES.items() for end in "ij"}
    ends = [{"body_i": "ground", "point_i": at, "body_j": body, "point_j": at, **along} for body in "ab"]
    sleeves = [refkin.Cylindrical(name=name, **own) for name, own in zip("AB", ends, strict=True)]
    gear = refkin.SpatialGear(name="G", joint_i="A", radius_i=0.5, joint_j="B", radius_j=0.25)
    shifts = [
        refkin.DisplacementDriver(name=f"shift {name}", joint=name, law=Polynomial(coefficients=(0.1, 0.2)))
        for name in "AB"
    ]
    turn = refkin.SpatialAngleDriver(name="turn", joint="A", law=Polynomial(coefficients=(0.2, 1.0)))
    mechanism = Mechanism((Body(name="a"), Body(name="b")), (*sleeves, gear), (turn, *shifts))
    record = check(Scene(mechanism=mechanism, times=(0.0, 1.0)), ["exudyn"])

    assert record.disagreements == []


def test_of_scenes_that_a_night_knows_well_rows_are_compared_in_one_of_four_and_else_always():
    scenes = [replace(lever(), times=(0.0, 1.0 + k / 64)) for k in range(32)]
    known = [bool(check(scene, ["pinocchio"], {"well_known": True}).levels) for scene in scenes]

    assert known == [int(key_of(scene), 16) % 4 == 0 for scene in scenes]
    assert 2 < sum(known) < 16
    assert check(scenes[known.index(False)], ["pinocchio"], {}).levels


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda rows: None, "got a NoneType without rows, owns_driver, residual, jacobian, constraint_velocity, drift"),
        (lambda rows: vars(rows).pop("owns_driver") and rows, "got a SimpleNamespace without owns_driver"),
        (lambda rows: rows.change(residual=lambda q, t: [0.0]), "own rows, residual: expected an array of shape (2,)"),
        (lambda rows: rows.change(jacobian=lambda q, t: np.zeros((2, 2))), "or with more rows, got (2, 2)"),
        (
            lambda rows: rows.change(drift=lambda q, qd, t: np.zeros(1)),
            "own rows, drift: expected an array of shape (2,)",
        ),
        (lambda rows: rows.change(drift=lambda q, qd, t: np.array(["0"] * 2)), "expected an array of shape (2,) "),
        (lambda rows: rows.change(rows=None), "rows: expected a list of RowMap"),
        (lambda rows: rows.change(rows=iter(rows.rows)), "rows: expected a list of RowMap"),
        (
            lambda rows: rows.change(rows=[replace(m, engine_row=1.0) for m in rows.rows]),
            "rows: expected of a RowMap a whole engine_row from 0 on, a real factor",
        ),
        (
            lambda rows: rows.change(rows=[replace(m, factor="2") for m in rows.rows]),
            "rows: expected of a RowMap a whole engine_row from 0 on, a real factor",
        ),
        (
            lambda rows: rows.change(rows=[replace(m, constraint="pin") for m in rows.rows]),
            "the scene has no row 0 of pin, row 1 of pin",
        ),
    ],
)
def test_rows_of_another_form_are_named_by_what_they_are(monkeypatch, spoil, said):
    engine = load("mujoco")
    model = engine.constraints(lever())
    rows = SimpleNamespace(owns_driver=True, rows=model.rows, **{k: getattr(model, k) for k in LEVELS})
    rows.change = lambda **new: vars(rows).update(new) or rows
    monkeypatch.setattr(engine, "constraints", lambda scene: spoil(rows))
    told = [fault.message for fault in check(lever(), [engine]).disagreements if fault.method == "rows"]

    assert len(told) == 1
    assert said in told[0]
