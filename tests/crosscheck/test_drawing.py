"""Drawing: new scenes for every night and number, the same ones for the same, whatever the environment."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

from crosscheck.measure.check import key_of
from crosscheck.night.disagreements import _at_its_time
from crosscheck.scenes import drawing
from crosscheck.scenes.drawing import OutOfTime, draw, effort, in_part, seed_of_scene, shortened, shrink
from crosscheck.strategies import Chain, Drawn, Ended, Hardness
from crosscheck.strategies.linkages import longest
from refkin.model import Effect
from refkin.motion import Status
from refkin.solving.solve import solve

DRAW = """
import sys
from hypothesis import settings
{before}
from crosscheck.measure.check import key_of
from crosscheck.scenes.drawing import draw
print(*(key_of(draw(5, number).scene) for number in range(8)))
"""
CIRCUMSTANCES = {
    "by itself": "",
    "beside other modules with numbers in them": "import crosscheck.cli, crosscheck.report, refkin.proof.pose.krawczyk",
    "after other draws": "from crosscheck.scenes.drawing import draw; draw(9, 1)",
    "under a profile that derandomizes": (
        "settings.register_profile('mine', derandomize=True, max_examples=1, database=None, phases=())\n"
        "settings.load_profile('mine')"
    ),
}


def drawn_elsewhere(before: str, **env: str) -> list[str]:
    process = subprocess.run(
        [sys.executable, "-c", DRAW.format(before=before)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, **env},
        timeout=60,
    )
    return process.stdout.split()


@pytest.mark.parametrize("ci", [{}, {"CI": "true"}, {"CI": "1", "HYPOTHESIS_PROFILE": "ci"}], ids=["", "CI", "CI=1"])
@pytest.mark.parametrize("before", CIRCUMSTANCES.values(), ids=CIRCUMSTANCES)
def test_what_is_drawn_depends_on_night_and_number_alone(before, ci):
    assert drawn_elsewhere(before, **ci) == [key_of(draw(5, number).scene) for number in range(8)]


def test_nights_and_numbers_have_no_scene_in_common():
    keys = [key_of(draw(night, number).scene) for night in (0, 1, 20261121) for number in range(40)]

    assert len(set(keys)) == len(keys)


def test_seeds_of_neighbouring_nights_and_numbers_differ():
    seeds = {seed_of_scene(night, number) for night in range(-5, 200) for number in range(200)}

    assert len(seeds) == 205 * 200


def test_no_kind_of_scene_is_left_out():
    drawn = [draw(3, number) for number in range(315)]
    counts = Counter((d.kind, d.hardness) for d in drawn if isinstance(d, Drawn))
    chains = Counter(d.kind for d in drawn if isinstance(d, Chain))
    ended = Counter(d.expected for d in drawn if isinstance(d, Ended))

    # 24 of each are expected, with a standard deviation of 4.6; of the kinds of chains 9, with one of 2.7, of
    # which five-bars are of two kinds, with a geared mesh or a second driver.
    assert counts.pop(("equal four-bar", Hardness.REGULAR)) == 11
    assert (ended.total(), set(ended)) == (12, {Status.SINGULAR, Status.UNASSEMBLABLE})
    assert len(counts) == 9
    assert min(counts.values()) >= 13  # 2.4 of them below
    assert (len(chains), chains.total()) == (6, 45)
    assert min(chains.values()) >= 3


def test_what_a_scene_calls_for_is_drawn_too():
    """Of 24 scenes one calls for positions alone, and two for one rate without the other."""
    counts = Counter(draw(3, number, 4).scene.effects for number in range(112) if number % 28 not in (12, 19))

    assert counts.keys() == {frozenset(), *(frozenset({effect}) for effect in Effect), frozenset(Effect)}
    assert counts[frozenset(Effect)] >= 80


def test_scenes_are_no_variations_of_one_another():
    drawn = [draw(3, number) for number in range(70)]
    linkages = [d for d in drawn if isinstance(d, Drawn)]

    assert len({d.linkage for d in linkages}) == len({d.law for d in linkages}) == 49
    assert len({d.scene.mechanism for d in drawn}) == 70


def test_a_scene_at_fewer_times_is_the_same_motion():
    whole, few = draw(3, 7), draw(3, 7, samples=4)

    assert (few.linkage, few.law, few.variant, len(few.scene.times)) == (whole.linkage, whole.law, whole.variant, 4)
    assert (few.scene.times[0], few.scene.times[-1]) == (whole.scene.times[0], whole.scene.times[-1])


def test_a_failing_scene_becomes_a_simple_one_that_still_fails():
    def large(drawn):
        return isinstance(drawn, Drawn) and longest(drawn.linkage) > 3.0

    number = next(k for k in range(100) if large(draw(3, k)))
    result, _ = shrink(3, number, large, 20.0)

    assert large(result)
    assert len(result.scene.times) == 2
    # The simplest scene of all has 84 digits; a drawn one 1000 to 3000.
    assert effort(result.scene) < 150 < effort(draw(3, number).scene)


def test_a_scene_that_does_not_fail_again_is_not_shrunk():
    assert shrink(3, 0, lambda drawn: False, 20.0) == (None, 1)


def test_a_failure_that_comes_and_goes_is_asked_for_once_per_scene_and_shrunk_all_the_same():
    asked = Counter()

    def only_once(drawn):
        asked[drawn.scene] += 1
        return asked[drawn.scene] == 1

    result, tried = shrink(3, 0, only_once, 20.0)

    assert (set(asked.values()), sum(asked.values())) == ({1}, tried)
    assert effort(result.scene) < effort(draw(3, 0).scene)


def test_shrinking_without_time_leaves_the_scene_as_it_was_drawn():
    result, tried = shrink(3, 0, lambda drawn: True, 0.0)

    assert (result.scene, tried) == (draw(3, 0).scene, 1)


def test_shrinking_ends_when_its_time_is_over_with_the_simplest_so_far(monkeypatch):
    asked = []
    monkeypatch.setattr(drawing, "time", SimpleNamespace(monotonic=lambda: 0.4 * len(asked)))

    def slow(drawn):
        asked.append(drawn)
        return True

    result, tried = shrink(3, 0, slow, 0.6)

    assert (result.scene, tried) == (asked[1].scene, 2)


def test_only_the_end_of_the_time_ends_a_run_of_hypothesis_at_once():
    assert not issubclass(OutOfTime, Exception)


def test_a_failing_chain_becomes_a_simple_one_of_its_kind():
    def is_cam(drawn):
        return drawn.kind == "disc cam" and len(drawn.scene.times) > 1

    number = next(k for k in range(6, 200, 7) if is_cam(draw(3, k)))
    result, _ = shrink(3, number, is_cam, 20.0)

    assert is_cam(result)
    assert effort(result.scene) < effort(draw(3, number).scene)


def test_the_quarter_of_a_linkages_times_is_the_one_that_is_nearest_to_a_singular_pose_in_the_same_assembly():
    drawn = [one for one in (draw(3, k) for k in range(40)) if isinstance(one, Drawn)]
    for one in drawn:
        part, times = shortened(one), one.scene.times
        first = times.index(part.times[0])
        whole, few = solve(one.scene), solve(part)

        assert part.times == times[first : first + len(times) // 4]
        assert min(abs(one.margin(t)) for t in part.times) == min(abs(one.margin(t)) for t in times)
        assert few.status == whole.status[first : first + len(part.times)]
        gap = (few.q - whole.q[:, first : first + len(part.times)]) / one.scene.mechanism.size()
        assert np.abs(gap.reshape(-1, 3, len(part.times))[:, :2]).max() < 1e-6
        estimates = np.array([body.estimate[:2] for body in part.mechanism.bodies])
        assert np.abs(estimates - few.q[:, 0].reshape(-1, 3)[:, :2]).max() < 0.0051 * longest(one.linkage)
    assert {one.scene.times.index(shortened(one).times[0]) for one in drawn} > {54}


def test_what_ends_on_purpose_is_checked_at_a_quarter_as_many_times_up_to_its_end():
    for one in (draw(3, 28 * k + 5) for k in range(8)):
        part, times = shortened(one), one.scene.times

        assert (part.times[0], part.times[-1], len(part.times)) == (times[0], times[-1], len(times) // 4)
        assert solve(part).verdict is one.expected


def test_a_minimal_scene_of_what_ends_on_purpose_has_its_end():
    """Without it a replay blamed the reference, that says ok at the two times that were left."""
    one = in_part(draw(77, 5))
    times = one.scene.times
    shorter = _at_its_time(one, SimpleNamespace(at=SimpleNamespace(time=times[8])))

    assert shorter.scene.times == (times[0], times[8], times[-1])
    assert solve(shorter.scene).verdict is one.expected
