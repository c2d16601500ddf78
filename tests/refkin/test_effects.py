"""Only what a scene calls for is computed: evaluations are counted; an effect taken away leaves the rest as it was."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

import refkin
from refkin import Effect, Evidence, FourBar, Point, Polynomial, Sinusoid, Status
from refkin.joints import DRIVER_TYPES, JOINT_TYPES
from refkin.proof.pose import isolate as isolating
from tests.linkages import ROCKER
from tests.mutation.change import mutated
from tests.places import ROOT

STEADY = Polynomial(coefficients=(0.0, 2.0))
SCENE = ROCKER.scene(law=STEADY, times=tuple(np.linspace(0.0, 0.4, 11)))
STATIC = ROCKER.scene(law=Polynomial(coefficients=(0.7,)), times=(0.0, 1.0, 2.0))
LEVELS = {
    "position": frozenset(),
    "velocity": frozenset({Effect.VELOCITY}),
    "acceleration": frozenset({Effect.ACCELERATION}),
}
ALL, NONE = frozenset(Evidence), frozenset()


@pytest.fixture
def counted(monkeypatch):
    """Evaluations by name: the right sides of every joint and driver, laws by order, singular values, proofs."""
    counts = Counter()

    def spy(owner, name, label):
        plain = getattr(owner, name)

        def counting(*arguments, **more):
            counts[label(*arguments)] += 1
            return plain(*arguments, **more)

        is_formula = owner in (*JOINT_TYPES, *DRIVER_TYPES)
        monkeypatch.setattr(owner, name, staticmethod(counting) if is_formula else counting)

    for kind in (*JOINT_TYPES, *DRIVER_TYPES):
        for name in ("nu", "gamma"):
            spy(kind, name, lambda *_, name=name: name)
    for law in (Polynomial, Sinusoid):
        spy(law, "__call__", lambda law, t, order=0: f"law, order {order}")
    spy(np.linalg, "svd", lambda *_: "singular values")
    spy(isolating, "certify", lambda system, q, *_: "proof")
    return counts


@pytest.mark.parametrize("evidence", [ALL, NONE], ids=["with evidence", "without"])
@pytest.mark.parametrize("scene", [SCENE, STATIC], ids=["moving", "static"])
def test_a_position_only_scene_evaluates_no_right_side_of_a_rate(scene, evidence, counted):
    refkin.solve(replace(scene, effects=frozenset(), evidence=evidence))

    assert not {"nu", "gamma"} & set(counted)


@pytest.mark.parametrize("evidence", [ALL, NONE], ids=["with evidence", "without"])
def test_a_velocity_scene_evaluates_no_gamma(evidence, counted):
    refkin.solve(replace(SCENE, effects=LEVELS["velocity"], evidence=evidence))

    assert "gamma" not in counted
    assert "nu" in counted


@pytest.mark.parametrize("evidence", [ALL, NONE], ids=["with evidence", "without"])
@pytest.mark.parametrize("scene", [SCENE, STATIC], ids=["moving", "static"])
@pytest.mark.parametrize(("level", "highest"), [("position", 0), ("velocity", 1), ("acceleration", 2)])
def test_no_derivative_of_a_law_is_evaluated_beyond_the_level_called_for(scene, level, highest, evidence, counted):
    refkin.solve(replace(scene, effects=LEVELS[level], evidence=evidence))
    orders = {int(name.rsplit(" ", 1)[1]) for name in counted if name.startswith("law")}

    assert orders == set(range(highest + 1))


def test_a_law_is_evaluated_for_many_times_together_and_seldom_again(counted):
    """Poses come as one batch, and Newton's iterations share the values: one by one each time would ask on its own.

    Three times more, for all times together: does the law have any digits, and where do determinants go to?
    """
    refkin.solve(replace(SCENE, effects=frozenset(), evidence=NONE))

    assert counted["law, order 0"] <= len(SCENE.times) + 3


def test_radii_are_given_of_what_is_called_for_alone():
    """An acceleration needs the velocity, and a cam is proved in any case: their bounds were handed out unasked."""
    given = refkin.solve(replace(SCENE, effects=frozenset({Effect.ACCELERATION}))).certified_radius
    cam = replace(refkin.load(ROOT / "docs/scenes/cam.toml"), evidence=NONE)

    assert [np.isfinite(radius).all() for radius in (given.position, given.velocity, given.acceleration)] == [1, 0, 1]
    assert np.isnan([*vars(refkin.solve(cam).certified_radius).values()]).all()


@pytest.mark.parametrize("level", LEVELS)
def test_without_evidence_there_are_no_singular_values_and_no_proofs(level, counted):
    motion = refkin.solve(replace(SCENE, effects=LEVELS[level], evidence=NONE))

    assert motion.verdict is Status.OK
    assert not {"singular values", "proof"} & set(counted)


@pytest.mark.parametrize(("evidence", "batches"), [(Evidence.CONDITION, (1, 0)), (Evidence.CERTIFICATE, (0, 1))])
def test_a_condition_is_one_batch_of_singular_values_and_a_certificate_one_of_proofs(evidence, batches, counted):
    refkin.solve(replace(SCENE, evidence=frozenset({evidence})))

    assert (counted["singular values"], counted["proof"]) == batches


def test_a_gamma_in_a_position_only_scene_would_be_seen(counted):
    """The planted fault: an analysis that computes what nobody called for."""
    called_for, all_levels = "self._rates(samples[solvable])", "compile_system(self.scene.mechanism).gamma"
    more = f"{called_for}; {all_levels}(self.q[:, samples], 0.0 * self.q[:, samples], self.t[samples])"
    with mutated("refkin.solving.solve:_Answer.judge", called_for, more):
        refkin.solve(replace(SCENE, effects=frozenset(), evidence=NONE))

    assert "gamma" in counted
    assert "law, order 2" in counted


@pytest.mark.parametrize("crank", [1.0, 1.5 - 1e-9, 1.5 - 1e-15], ids=["regular", "near a change point", "at one"])
def test_statuses_do_not_depend_on_whether_a_condition_is_asked_for(crank):
    scene = FourBar(ground=4.0, crank=crank, coupler=3.5, rocker=2.0 + crank - 0.5).scene(samples=9)
    with_it, without = (
        refkin.solve(replace(scene, effects=frozenset(), evidence=asked))
        for asked in (frozenset({Evidence.CONDITION}), NONE)
    )

    assert with_it.status == without.status
    assert np.array_equal(with_it.q, without.q, equal_nan=True)


WHOLE = replace(SCENE, points=(Point(name="P", body="coupler", position=(0.3, 0.2)),))
LESS = {
    "no velocity": {"effects": LEVELS["acceleration"]},
    "no acceleration": {"effects": LEVELS["velocity"]},
    "no condition": {"evidence": frozenset({Evidence.CERTIFICATE})},
    "no certificate": {"evidence": frozenset({Evidence.CONDITION})},
    "no points": {"points": ()},
    "one body": {"bodies_wanted": ("rocker",)},
}


@pytest.mark.parametrize("less", LESS)
def test_what_is_not_called_for_is_absent_and_changes_no_bit_of_the_rest(less):
    whole, part = refkin.solve(WHOLE), refkin.solve(replace(WHOLE, **LESS[less]))
    kept = [(k, a, b) for k, (a, b) in enumerate(zip(part.levels, whole.levels, strict=True)) if a is not None]

    assert part.status == whole.status
    assert part.bodies == LESS[less].get("bodies_wanted", whole.bodies)
    assert set(part.points) == ({"P"} if less != "no points" else set())
    assert (part.qd is None, part.qdd is None) == (less == "no velocity", less == "no acceleration")
    for order, _, _ in kept:
        for body in part.bodies:
            name = ("q", "qd", "qdd")[order]
            assert np.array_equal(getattr(part[body], name), getattr(whole[body], name))


@pytest.mark.parametrize("level", LEVELS)
def test_a_point_reports_the_levels_called_for_and_no_other(level):
    point = refkin.solve(replace(WHOLE, effects=LEVELS[level])).points["P"]

    assert (point.v is not None, point.a is not None) == (level == "velocity", level == "acceleration")


def test_velocities_are_there_for_who_asks_for_accelerations():
    """They are what accelerations are made of."""
    mechanism = ROCKER.scene(samples=2).mechanism
    system = refkin.compile_system(mechanism, frozenset({Effect.ACCELERATION}))

    assert system.effects == {Effect.VELOCITY, Effect.ACCELERATION}
    assert system.nu(np.zeros(system.n), 0.0).shape == (system.m,)
