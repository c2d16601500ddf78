"""Chains: they assemble, every kind and form is drawn, and each is checked by a method that shares nothing."""

from __future__ import annotations

from collections import Counter
from functools import cache

import pytest
from hypothesis import HealthCheck, Phase, given, seed, settings

from crosscheck.measure.check import check
from crosscheck.night.campaign import Turns, _by_engines, is_sampled
from crosscheck.night.plan import SAMPLED, SAMPLED_EVERY, Journal
from crosscheck.scenes.drawing import CHAINS_EVERY, draw, is_chain
from crosscheck.strategies import Chain, cams, chains, geared_linkages, planets, racks, six_bars
from refkin.motion import Status

from .loop_scenes import general_cam

KINDS = {
    "geared five-bar": geared_linkages,
    "planet five-bar": planets,
    "rack and pinion": racks,
    "disc cam": cams,
    "six-bar": six_bars,
}


def sample(strategy, count):
    rows = []

    @seed(20261121)
    @settings(
        max_examples=count,
        database=None,
        derandomize=False,
        deadline=None,
        phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
    )
    @given(strategy)
    def collect(drawn):
        rows.append(drawn)

    collect()
    return rows


@cache
def drawn(kind) -> tuple[Chain, ...]:
    return tuple(sample(KINDS[kind](samples=24), 10))


@cache
def checked(kind):
    return [check(d.scene, ["vector_loop"]) for d in drawn(kind)]


@pytest.mark.parametrize("kind", KINDS)
def test_every_chain_assembles_at_every_time_on_one_branch(kind):
    assert {record.reference.verdict for record in checked(kind)} == {Status.OK.value}


@pytest.mark.parametrize("kind", KINDS)
def test_vector_loops_answer_every_chain_and_agree(kind):
    assert [record.disagreements for record in checked(kind)] == [[]] * len(drawn(kind))
    assert {len(record.answers) for record in checked(kind)} == {1}


def test_of_five_bars_some_have_a_second_driver_that_no_other_says():
    five_bars = [d.scene.mechanism for d in drawn("geared five-bar")]
    motors = [mechanism.drivers for mechanism in five_bars if len(mechanism.drivers) == 2]

    assert 2 <= len(motors) <= len(five_bars) - 2
    assert all(len(m.drivers) == 1 + all(joint.type != "gear" for joint in m.joints) for m in five_bars)
    assert {driver.body for _, driver in motors} == {"second"}


@pytest.mark.parametrize("kind", KINDS)
def test_closures_keep_the_margin_that_is_reported(kind):
    assert min(d.distance for d in drawn(kind)) > 1e-3


def test_every_form_of_follower_and_mounting_is_drawn():
    forms = Counter(
        (joint.follower, "guide" in [other.name for other in d.scene.mechanism.joints])
        for d in (draw(3, number, 2) for number in range(CHAINS_EVERY - 1, 100 * CHAINS_EVERY, CHAINS_EVERY))
        for joint in d.scene.mechanism.joints
        if joint.type == "cam"
    )

    assert len(forms) == 6


@pytest.mark.parametrize(
    ("kind", "engine"), [("geared five-bar", "exudyn"), ("planet five-bar", "mujoco"), ("six-bar", "exudyn")]
)
def test_an_engine_that_knows_the_joints_agrees(kind, engine):
    records = [check(d.scene, [engine]) for d in sample(KINDS[kind](), 6)]

    assert [record.disagreements for record in records] == [[]] * 6
    assert all(record.answers for record in records)


@pytest.mark.parametrize(
    ("build", "joint"), [(lambda: drawn("rack and pinion")[0].scene, "rack_and_pinion"), (general_cam, "cam")]
)
def test_an_engine_that_does_not_know_a_joint_refuses_it_by_name_and_does_not_fail(build, joint):
    record = check(build(), ["closed_form"])

    assert (record.answers, record.disagreements) == ([], [])
    assert ("closed_form", joint) in {(row.engine, row.joint) for row in record.refusals}


@pytest.mark.parametrize(("kinds", "samples"), [(["six-bar"], 0), (["gears"], 5)])
def test_impossible_bounds_are_an_error(kinds, samples):
    with pytest.raises(ValueError, match=r"kinds: expected some of|samples: expected a whole number"):
        chains(kinds=kinds, samples=samples)


@pytest.fixture
def turns(tmp_path):
    with Journal(tmp_path / "records.jsonl") as journal:
        yield Turns(journal)


def test_the_costly_source_is_asked_for_every_chain_and_few_others(turns):
    batches = _by_engines(1, list(range(140)), turns, ("closed_form", *SAMPLED))
    asked = {number for names, jobs in batches if SAMPLED[0] in names for job in jobs for number in job["shards"]}

    assert asked == {k for k in range(140) if is_chain(k) or k % SAMPLED_EVERY == 0}
    assert sum(is_chain(k) for k in range(140)) == 20
    assert all(is_sampled(k) for k in asked)


def test_no_scene_is_lost_where_engines_differ(turns):
    batches = _by_engines(1, list(range(3, 8)), turns, ("a", *SAMPLED))
    values = [(names, [number for job in jobs for number in job["shards"]]) for names, jobs in batches]

    assert values == [(("a", *SAMPLED), [6]), (("a",), [3, 4, 5, 7])]
