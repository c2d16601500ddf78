"""Engines through features of their own: a night with the table of known gaps emptied sees each that is known."""

from __future__ import annotations

from dataclasses import replace
from html import unescape

import numpy as np
import pinocchio as pin
import pytest

import refkin
from crosscheck.engines import PEERS
from crosscheck.engines.loading import load
from crosscheck.engines.methods import Use, methods
from crosscheck.engines.mujoco.features import Sites
from crosscheck.engines.pinocchio import features as of_pinocchio
from crosscheck.engines.pinocchio.model import shift
from crosscheck.judge.known_gaps import Tally, read
from crosscheck.measure.check import check
from crosscheck.night.campaign import run
from crosscheck.night.plan import Journal, NightPlan
from crosscheck.report.build import build, summarized
from crosscheck.scenes.drawing import FEATURED, SPECIAL_EVERY, describe, draw

FEATURES = {(name, method.name) for name in PEERS for method in methods(load(name), Use.FEATURE)}
BESIDE = "tests/corpus/features-frames-beside-pins.toml"
SCENES = 10
"""Scenes for features, as a night of 280 scenes has them: half a minute of it."""


def methods_of(disagreements) -> set[tuple[str, str]]:
    return {(item.engine, item.method) for item in disagreements}


def test_with_the_table_emptied_a_night_sees_every_feature_that_is_known_to_be_wrong():
    numbers = range(FEATURED, FEATURED + SCENES * SPECIAL_EVERY, SPECIAL_EVERY)
    drawn = [draw(20261122, number) for number in numbers]
    records = [check(d.scene, PEERS, describe(d)) for d in drawn]
    empty, own = Tally([]), Tally(read())
    new = [item for record in records for item in empty.add(record)]

    assert methods_of(new) == FEATURES
    assert [item for record in records for item in own.add(record)] == []


def test_a_night_asks_features_of_the_scenes_drawn_for_them_and_shows_them_by_themselves(tmp_path):
    plan = NightPlan(seed=3, out=tmp_path, engines=PEERS, scenes=FEATURED + 1, workers=1, shrinking_seconds=0.0)
    outcome = run(plan)
    report, page = summarized(tmp_path), build(tmp_path).read_text(encoding="utf-8")
    with Journal(tmp_path / "records.jsonl") as journal:
        asked = [(r.about["shard"], a.engine, a.method.name) for r in journal for a in r.answers if a.feature]
    empty = run(replace(plan, known_gaps="none"))

    assert (outcome.new, report["verdict"]) == ([], "pass")
    assert set(asked) == {(FEATURED, *feature) for feature in FEATURES}
    assert {(row["engine"], row["feature"]) for row in report["features"]} == FEATURES
    assert not {(row["engine"], row["method"]) for row in report["methods"]} & FEATURES
    assert all(row["reason"] in unescape(page) for row in report["features"] if row["wrong"])
    wrong = {(row["engine"], row["feature"]) for row in report["features"] if row["wrong"]}
    assert methods_of(case.disagreement for case in empty.new) == wrong | {("exudyn", "shipped")}  # in space


def agrees(engine: str, feature: str) -> bool:
    """Whether a feature of an engine disagrees with nothing on the scene with frames beside pins."""
    record = check(refkin.load(BESIDE), [engine], {"of_features": True})
    assert feature in {answer.method.name for answer in record.answers}
    return (engine, feature) not in methods_of(record.disagreements)


def test_sites_that_the_compiler_leaves_where_they_are_agree(monkeypatch):
    made = Sites.__init__

    def as_written(self, tree):
        made(self, tree)
        self.model.site_sameframe[:] = 0

    assert not agrees("mujoco", "sites")
    monkeypatch.setattr(Sites, "__init__", as_written)
    assert agrees("mujoco", "sites")


def test_joints_whose_time_variation_is_right_agree(monkeypatch):
    """The three joints that the composite is made of, one after the other."""

    def chained(self):
        self.model = pin.Model()
        ends = {"ground": 0}
        for body in self.bodies:
            joint = 0
            for kind in (pin.JointModelPX, pin.JointModelPY, pin.JointModelRZ):
                joint = self.model.addJoint(joint, kind(), pin.SE3.Identity(), f"{body}{kind.__name__}")
            ends[body] = joint
        frames = [
            [pin.Frame(f"{k}{b}", ends[b], 0, shift(u), pin.OP_FRAME) for b, u in p] for k, p in enumerate(self.ends)
        ]
        self.frames = [[self.model.addFrame(frame) for frame in pair] for pair in frames]
        self.data = self.model.createData()

    assert not agrees("pinocchio", "composite joints")
    monkeypatch.setattr(of_pinocchio._Composite, "build", chained)
    assert agrees("pinocchio", "composite joints")


def test_point_anchors_whose_frames_stand_at_the_pins_agree(monkeypatch):
    def at_the_pins(self, frames, ends):
        (i, u), (j, v) = ends
        return pin.PointAnchorConstraintModel(self.model, frames[i].joint, shift(u), frames[j].joint, shift(v))

    assert not agrees("pinocchio", "point anchors with an offset")
    monkeypatch.setattr(of_pinocchio._Anchors, "_anchor", at_the_pins)
    assert agrees("pinocchio", "point anchors with an offset")


def test_initial_accelerations_lack_what_the_second_derivative_of_the_law_brings():
    scene, engine = refkin.load(BESIDE), load("exudyn")
    (method,) = methods(engine, Use.FEATURE)
    right, law = engine.solve(scene), scene.mechanism.drivers[0].law
    missing = right.qd / law(np.array(scene.times), 1) * law(np.array(scene.times), 2)
    off = method.solve(scene).qdd - right.qdd

    assert np.max(np.abs(off + missing)) < 1e-4 * np.max(np.abs(missing))


@pytest.mark.parametrize("feature", sorted(FEATURES - {("exudyn", "initial accelerations")}))
def test_a_feature_refuses_by_name_what_it_is_not_written_for(feature):
    record = check(refkin.load("examples/slider-crank.toml"), [feature[0]], {"of_features": True})

    assert any(feature[1] in row.reason for row in record.refusals)
    assert record.disagreements == []


def test_exudyn_refuses_initial_accelerations_at_times_below_zero():
    scene = refkin.FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene(times=(-0.5, 0.0))
    record = check(scene, ["exudyn"], {"of_features": True})

    assert [row.reason for row in record.refusals if "below zero" in row.reason]
    assert record.disagreements == []
