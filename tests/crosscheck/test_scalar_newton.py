"""Newton in plain floats and at all times at once, of the two engines that close no loops: right, as cheap as it says,
and red if one lies.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import refkin
from crosscheck.engines import EngineError
from crosscheck.engines.methods import Use, methods
from crosscheck.engines.mujoco import methods as of_mujoco
from crosscheck.engines.mujoco.methods import ConnectRows
from crosscheck.engines.pinocchio import methods as of_pinocchio
from crosscheck.engines.pinocchio.methods import Anchors
from crosscheck.engines.tree import at_once
from crosscheck.engines.tree.scalars import LIMITS
from crosscheck.judge.truth import CertifiedTruth
from crosscheck.measure.price_process import questions
from crosscheck.scenes.workloads import LoopChain
from refkin.joints import AngleDriver, Fixed, Revolute
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Polynomial
from tests.linkages import ROCKER
from tests.places import EXAMPLES, ROOT
from tests.refkin.test_sweep import three_cranks

from .test_planted_faults import FOUR_BAR, INVERTED, LAW, ROD, SLIDER, TIMES

SCENES_OF_JOINTS = ROOT / "docs/scenes"
NAME = "Newton on free coordinates"
AT_ONCE = {"mujoco": "mujoco.batch, all times at once", "pinocchio": "all times at once"}
ROWS = {"mujoco": ConnectRows, "pinocchio": Anchors}
MANY = {"mujoco": of_mujoco.SampledLoops, "pinocchio": of_pinocchio.PlacedLoops}

CLOSED = {
    "four-bar, driven back and forth": FOUR_BAR,
    "crank at several turns": ROCKER.scene(speed=2.0, turns=3, samples=91),
    "crank that begins turns away": ROCKER.scene(law=Polynomial(coefficients=(40.0, -3.0)), times=TIMES),
    "rocker driven": ROCKER.scene(driven="rocker", law=replace(LAW, offset=2.0, amplitude=0.2), times=TIMES),
    "slider-crank": SLIDER,
    "prismatic joint": refkin.load(SCENES_OF_JOINTS / "prismatic.toml"),
    "massless coupler": ROD,
    "two loops": replace(LoopChain("two", 2).scene, times=TIMES),
    "one time": replace(FOUR_BAR, times=TIMES[:1]),
}
"""Scenes whose loops revolute joints close, or distances."""


def settings(producer, name=NAME):
    listed = [one for one in methods(producer, Use.PRICE) if one.name == name]
    assert len(listed) == len(LIMITS)
    return listed


def digits(producer, scene, order=2, name=NAME):
    """Return the digits of its tightest setting by quantity."""
    return digits_of(settings(producer, name)[-1], scene, order)


def digits_of(one, scene, order=2):
    model, truth = one.model(scene), CertifiedTruth(scene)
    levels = model.read(model.solve(order))
    assert len(levels) == order + 1
    return [truth.digits(level, k, levels[:k])[0] for k, level in enumerate(levels)]


def counted(producer, monkeypatch):
    """Return what counts how often an engine is asked."""
    asked = []
    for name in ("closure", "drift"):
        right = getattr(ROWS[producer], name)
        counting = lambda *given, right=right, name=name: asked.append(name) or right(*given)  # noqa: E731
        monkeypatch.setattr(ROWS[producer], name, counting)
    return asked


@pytest.mark.parametrize("scene", CLOSED.values(), ids=CLOSED)
@pytest.mark.parametrize("producer", ROWS)
def test_every_level_is_as_right_as_double_precision_allows(producer, scene):
    for name in (NAME, AT_ONCE[producer]):
        assert min(digits(producer, scene, name=name)) > 13.0


ON_ITS_ROWS = "Newton on its rows, all times at once"
ANY_CLOSED = {**CLOSED, "inverted slider-crank": INVERTED, "RSSR": refkin.load(EXAMPLES / "rssr.toml")}
"""Scenes that Newton on an engine's rows takes, whatever closes their loops."""


@pytest.mark.parametrize("scene", ANY_CLOSED.values(), ids=ANY_CLOSED)
@pytest.mark.parametrize("producer", ROWS)
def test_so_it_is_on_rows_at_all_times_at_once_whatever_closes_a_loop(producer, scene):
    two = [one for one in methods(producer, Use.PRICE) if one.name == ON_ITS_ROWS]
    fewest = [min(digits_of(one, scene)) for one in two]

    assert [one.setting for one in two] == ["|dq| < 0.0001", "|dq| < 1e-08"]
    assert fewest[0] > 6.0
    assert fewest[1] > 13.0


@pytest.mark.parametrize("producer", ROWS)
def test_one_pose_now_is_found_from_the_pose_before(producer):
    """As a price list asks it."""
    scene = ROCKER.scene(speed=2.0, turns=1, samples=73)

    assert min(min(digits(producer, one)) for one, _ in questions(scene)["one"].scenes) > 13.5


@pytest.mark.parametrize("producer", ROWS)
def test_positions_alone_ask_an_engine_no_more_than_positions_with_rates(producer, monkeypatch):
    for scene in (FOUR_BAR, CLOSED["one time"], CLOSED["two loops"]):
        for one in settings(producer):
            model, calls = one.model(scene), []
            for order in range(3):
                asked = counted(producer, monkeypatch)
                model.solve(order)
                calls.append((asked.count("closure"), asked.count("drift")))
                monkeypatch.undo()
            times = len(scene.times)

            assert [drifts for _, drifts in calls] == [0, 0, times]
            assert calls[0][0] < calls[1][0]
            if times == 1:
                assert calls[1][0] == calls[2][0] == calls[0][0] + 1


@pytest.mark.parametrize("producer", ROWS)
@pytest.mark.parametrize("scene", [FOUR_BAR, SLIDER, CLOSED["two loops"]], ids=["four-bar", "slider", "two loops"])
def test_a_model_answers_each_time_as_if_it_were_the_first(producer, scene):
    one = settings(producer)[-1]
    own = {order: one.model(scene).solve(order) for order in range(3)}
    model = one.model(scene)

    for order in (2, 2, 0, 1, 2):
        answer = model.solve(order)
        assert answer == own[order]
        model.read(answer)  # moves the engine's bodies


REFUSED = {
    "a slide that closes a loop": (INVERTED, "joint 'A' closes a loop"),
    "redundant": (three_cranks(0.0), "4 equations of loops for 3 coordinates"),
    "no loop": (refkin.load(SCENES_OF_JOINTS / "revolute.toml"), "no joint closes a loop"),
    "space": (refkin.load(SCENES_OF_JOINTS / "spatial-revolute.toml"), "its joint tree for the plane alone"),
    "driven coupler": (
        ROCKER.scene(driven="coupler", law=replace(LAW, offset=0.9, amplitude=0.1), times=TIMES),
        "does not hold one coordinate",
    ),
}


@pytest.mark.parametrize(("scene", "why"), REFUSED.values(), ids=REFUSED)
@pytest.mark.parametrize("producer", ROWS)
def test_what_it_cannot_take_is_refused_with_the_reason(producer, scene, why):
    for one in settings(producer):
        with pytest.raises(EngineError, match=why):
            one.model(scene)


def test_a_loop_of_what_does_not_move_has_no_rows_in_mujoco():
    """Two fixed plates with a pin between them beside a pendulum of two links: as many equations as coordinates."""
    bodies = [Body(name=name, estimate=(0.0, 0.0, 0.0)) for name in ("plate", "other", "motor", "upper", "lower")]
    at = {"body_i": "ground", "point_i": (0.0, 0.0), "point_j": (0.0, 0.0)}
    joints = [Fixed(name=f"to {body}", body_j=body, **at) for body in ("plate", "other")]
    ends = {"point_i": (1.0, 0.0), "point_j": (0.0, 0.0)}
    for name, i, j in (("a", "ground", "motor"), ("b", "motor", "upper"), ("c", "upper", "lower")):
        joints.append(Revolute(name=name, body_i=i, body_j=j, **ends))
    joints.append(Revolute(name="pin", body_i="plate", point_i=(1.0, 0.0), body_j="other", point_j=(1.0, 0.0)))
    driver = AngleDriver(name="driver", body="motor", law=LAW)
    scene = Scene(mechanism=Mechanism(tuple(bodies), tuple(joints), (driver,)), times=TIMES)

    with pytest.raises(EngineError, match="MuJoCo has no rows of a joint that closes a loop and that nothing moves"):
        settings("mujoco")[-1].model(scene)


@pytest.mark.parametrize("producer", ROWS)
def test_where_the_links_do_not_meet_there_is_no_answer_and_none_after(producer):
    """Coupler and rocker reach as far as 4.123 together, and the crank's tip is that far away at pi / 2."""
    short = refkin.FourBar(ground=4.0, crank=1.0, coupler=2.0, rocker=2.123)
    law = Polynomial(coefficients=(0.3, 1.0))
    scene = replace(short.scene(law=law, times=[0.0]), times=tuple(np.linspace(0.0, 3.0, 13).tolist()))
    together = [next(one for one in methods(producer) if one.name == name) for name in (ON_ITS_ROWS, AT_ONCE[producer])]
    for one in (settings(producer)[-1], *together):
        model = one.model(scene)
        levels = model.read(model.solve(2))
        there = np.isfinite(levels[0]).all(axis=0)

        assert there[0]
        assert not there[6:8].any()
        assert all((np.isfinite(level).all(axis=0) == there).all() for level in levels)
        assert one in together or list(there) == sorted(there, reverse=True)


def off(numbers):
    return [numbers[0], numbers[1] + 1e-7, *numbers[2:]]


FAULTS = {
    "gap": ("closure", lambda answer: (off(answer[0]), answer[1]), [0, 1, 2]),
    "slope": ("closure", lambda answer: (answer[0], off(answer[1])), [1, 2]),
    "drift": ("drift", off, [2]),
    "sign of the drift": ("drift", lambda answer: [-x for x in answer], [2]),
}


@pytest.mark.parametrize(("name", "wrong", "reds"), FAULTS.values(), ids=FAULTS)
@pytest.mark.parametrize("producer", ROWS)
def test_a_wrong_number_of_an_engine_is_seen_in_what_it_spoils(producer, name, wrong, reds, monkeypatch):
    right = getattr(ROWS[producer], name)
    monkeypatch.setattr(ROWS[producer], name, lambda *given: wrong(right(*given)))
    found = digits(producer, FOUR_BAR)

    assert [k for k in range(3) if not found[k] > 12.0] == reds


@pytest.mark.parametrize(("name", "reds"), [("gaps", [0, 1, 2]), ("slopes", [1, 2]), ("drift", [2])])
@pytest.mark.parametrize("producer", MANY)
def test_so_is_one_of_many_poses(producer, name, reds, monkeypatch):
    right = getattr(MANY[producer], name)
    monkeypatch.setattr(MANY[producer], name, lambda *given: right(*given) + 1e-7)
    found = digits(producer, FOUR_BAR, name=AT_ONCE[producer])

    assert [k for k in range(3) if not found[k] > 12.0] == reds


@pytest.mark.parametrize("producer", MANY)
def test_a_pose_of_many_at_which_newton_does_not_end_is_none(producer, monkeypatch):
    monkeypatch.setattr(at_once, "MOST_NEWTON", 1)
    scene = replace(FOUR_BAR, times=tuple(np.linspace(*np.array(FOUR_BAR.times)[[0, -1]], 200).tolist()))
    levels = settings(producer, AT_ONCE[producer])[-1].model(scene).solve(2)

    assert np.isnan(levels[0]).any()
    assert all(np.array_equal(np.isnan(level).any(axis=0), np.isnan(levels[0]).any(axis=0)) for level in levels)
