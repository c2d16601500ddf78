"""The golden set: the same again is no difference, and every planted loss is one, by case."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crosscheck.engines import Level, Support
from crosscheck.engines.loading import load
from crosscheck.measure.check import key_of
from crosscheck.measure.jobs import checkers
from crosscheck.night import golden
from crosscheck.night.baseline import DEFAULT, NoBaseline, read_baseline, scenes_of, write_baseline
from crosscheck.night.campaign import run
from crosscheck.night.golden import differences
from crosscheck.night.plan import ALWAYS, SAMPLED, NightPlan
from crosscheck.report.build import build
from crosscheck.scenes.conformance import questions
from crosscheck.scenes.names import PEERS
from refkin.joints import elements_of
from refkin.motion import Status
from refkin.scenes.files import parse, to_dict

from .fake_engines import engine_file

FEW = ("crank-rocker open", "slider-crank", "near a limit position")
HARD = "near a limit position"
ENGINES = {"closed_form": "closed_form"}


@pytest.fixture(scope="module")
def cases() -> dict[str, Any]:
    scenes = {name: scene for name, scene in golden.golden_scenes().items() if name in FEW}
    with checkers(1, ENGINES) as workers:
        return golden.measure(scenes, workers, list(ENGINES))


@pytest.fixture
def again(cases: Any) -> Any:
    return copy.deepcopy(cases)


@pytest.fixture
def file(tmp_path: Path, cases: Any) -> Path:
    write_baseline(tmp_path / "baseline.json", cases, {"closed_form": "0.1.0"})
    return tmp_path / "baseline.json"


def told(actual: Any) -> list[tuple[str, ...]]:
    cases = [(case.case, case.disagreement) for case in actual]
    return [(case, d.engine, d.quantity, d.name.removeprefix("golden set: ")) for case, d in cases]


ROUTE = ("closed_form", "float")


def test_the_same_again_is_no_difference(cases: Any, again: Any) -> None:
    assert differences(cases, again, ENGINES) == []


def test_a_baseline_comes_back_from_its_file_as_it_was(cases: Any, file: Path) -> None:
    assert json.loads(json.dumps(cases)) == read_baseline(file)["cases"]


@pytest.mark.parametrize("which", [0, 1], ids=["median", "worst"])
@pytest.mark.parametrize(
    ("lost", "beyond", "ratio", "red"),
    [
        (0.6, 0.1, 0.0, True),  # fewer digits than rounding leaves, whatever the route allows itself
        (0.4, 0.1, 0.0, False),
        (0.6, -0.1, 0.2, False),  # luck in rounding: a worst sample may move by digits
        (4.0, -0.1, 0.2, False),
        (0.6, -0.1, 0.3, True),  # a sample that is easier than the hardest one, and worse than luck makes it
        (0.4, -0.1, 0.3, False),
    ],
)
def test_a_method_that_loses_more_than_half_a_digit_and_more_than_luck_is_named(
    cases: Any, again: Any, which: int, lost: float, beyond: float, ratio: float, red: bool
) -> None:
    cases = copy.deepcopy(cases)
    left = cases["slider-crank"]["rounding"]["velocity"][which] - beyond
    cases["slider-crank"]["methods"]["closed_form"]["float"]["velocity"][which] = left + lost
    again["slider-crank"]["methods"]["closed_form"]["float"]["velocity"][which] = left
    again["slider-crank"]["methods"]["closed_form"]["float"]["ratio"]["velocity"] = ratio

    expected = [("slider-crank", "closed_form", "velocity", "digits lost")] if red else []
    assert told(differences(cases, again, ENGINES)) == expected


def test_a_method_that_does_not_answer_any_more_is_named(cases: Any, again: Any) -> None:
    del again["slider-crank"]["methods"]["closed_form"]["float"]
    again["crank-rocker open"]["methods"]["closed_form"]["float"]["missing"] = 1

    gone = [(case, "closed_form", "status", "digits lost") for case in FEW[:2]]
    assert told(differences(cases, again, ENGINES)) == gone


def test_an_engine_that_was_not_asked_is_not_missed(cases: Any, again: Any) -> None:
    del again["slider-crank"]["methods"]["closed_form"]["float"]

    assert differences(cases, again, ()) == []


@pytest.mark.parametrize("quantity", ["position", "velocity", "acceleration"])
@pytest.mark.parametrize(("radii", "red"), [(0.9, False), (1.1, True)])
@pytest.mark.parametrize(("row", "unit"), [(3, 4.0), (5, 1.0)], ids=["x", "angle"])
def test_a_reference_outside_both_proofs_is_named(
    cases: Any, again: Any, quantity: str, radii: float, red: bool, row: int, unit: float
) -> None:
    """Radii of lengths are in units of the size, the power of two nearest the longest link."""
    cases = copy.deepcopy(cases)
    old, new = (some["crank-rocker open"]["reference"] for some in (cases, again))
    old["certified_radius"][quantity] = new["certified_radius"][quantity] = [1e-6] * 7
    new[quantity][2][row] += radii * unit * 2e-6

    expected = [("crank-rocker open", "refkin", quantity, "the reference has left its proof")] if red else []
    assert told(differences(cases, again, ENGINES)) == expected


@pytest.mark.parametrize(("steps", "red"), [(3.0, False), (4.0, True), (np.nan, True)])
def test_a_number_may_be_rounded_once_more_on_each_side(cases: Any, again: Any, steps: float, red: bool) -> None:
    """Without radii 3.4 steps of float64 are allowed at 1.7, and no number that is gone."""
    cases = copy.deepcopy(cases)
    old, new = (some["crank-rocker open"]["reference"] for some in (cases, again))
    old["certified_radius"]["position"] = new["certified_radius"]["position"] = [0.0] * 7
    old["position"][2][3], new["position"][2][3] = 1.7, 1.7 + steps * 2.0**-52

    assert bool(differences(cases, again, ENGINES)) is red


def test_digits_are_kept_in_tenths_the_median_and_the_worst_of_all_samples() -> None:
    assert golden._digits({0: {153: 2, 120: 1}, 1: {147: 1, 130: 1}}) == [14.7, 12.0]
    assert golden._digits({0: {}}) is None


def test_a_status_that_changed_is_named(cases: Any, again: Any) -> None:
    again["slider-crank"]["reference"]["status"][3] = "singular"

    expected = [("slider-crank", "refkin", "status", "the reference has left its proof")]
    assert told(differences(cases, again, ENGINES)) == expected


def test_a_folder_is_no_baseline(tmp_path: Path) -> None:
    with pytest.raises(NoBaseline, match="is no baseline: Is a directory"):
        read_baseline(tmp_path)


def night(out: Path, file: Path | None, *specs: str) -> tuple[Any, Any, str]:
    plan = NightPlan(seed=1, out=out, engines=("closed_form", *specs), scenes=1, workers=1, baseline=file)
    outcome = run(plan)
    page = build(out).read_text(encoding="utf-8")
    return outcome, json.loads((out / "report.json").read_text(encoding="utf-8")), page


def test_a_night_without_losses_passes_and_says_that_the_set_was_compared(tmp_path: Path, file: Path) -> None:
    _, report, page = night(tmp_path / "out", file)

    assert (report["verdict"], report["golden"]["cases"], report["golden"]["worse"]) == ("pass", 3, [])
    assert "golden set of 3 scenes: nothing worse" in page


def expect_digits(file: Path, route: tuple[str, str], rounding: bool) -> None:
    """Write a baseline in which a route had 15 digits of the rates, and perhaps rounding left as many."""
    held = read_baseline(file)
    case, digits = held["cases"][HARD], {"velocity": [15.0, 15.0], "acceleration": [15.0, 15.0]}
    case["methods"].setdefault(route[0], {})[route[1]] = {**case["methods"]["closed_form"]["float"], **digits}
    case["rounding"] |= digits if rounding else {}
    file.write_text(json.dumps(held))


LOSS = "motion = replace(motion, qd=motion.qd * (1 + 1e-9), qdd=motion.qdd * (1 + 1e-9))"


def test_a_planted_loss_fails_the_night_with_its_scene_and_still_does_when_the_page_is_made_again(
    tmp_path: Path, file: Path
) -> None:
    key = key_of(golden.golden_scenes()[HARD])
    spec = engine_file(tmp_path, after=f"if key == {key!r}: {LOSS}")
    expect_digits(file, ("fake", "made up"), rounding=False)
    outcome, report, page = night(tmp_path / "out", file, spec)
    lost = {d["quantity"] for d in report["disagreements"] if d["kind"] == "golden set: digits lost"}

    assert report["verdict"] == "new disagreements"
    assert lost == {case.disagreement.quantity for case in outcome.new} == {"velocity", "acceleration"}
    assert "crosscheck replay disagreements/golden-near-a-limit-position.toml" in page
    build(tmp_path / "out")
    assert json.loads((tmp_path / "out" / "report.json").read_text())["verdict"] == "new disagreements"


def test_digits_that_are_fewer_by_luck_in_rounding_do_not_fail_the_night(tmp_path: Path, file: Path) -> None:
    expect_digits(file, ROUTE, rounding=False)  # closed_form has ten of them, and 0.003 of what is allowed
    _, report, _ = night(tmp_path / "out", file)

    assert (report["verdict"], report["golden"]["worse"]) == ("pass", [])


def test_a_night_that_does_not_compare_the_set_says_so(tmp_path: Path) -> None:
    _, report, page = night(tmp_path / "out", None)

    assert report["golden"] is None
    assert "the golden set was not compared in this run" in page


@pytest.fixture(scope="module")
def accepted() -> Any:
    return read_baseline(DEFAULT)


def test_the_accepted_baseline_holds_the_golden_scenes_and_every_engine(accepted: Any) -> None:
    held = {name: case["scene"] for name, case in accepted["cases"].items()}
    engines = {engine for case in accepted["cases"].values() for engine in case["methods"]}

    assert held == {name: json.loads(json.dumps(to_dict(s))) for name, s in golden.golden_scenes().items()}
    assert engines == set(accepted["versions"]) == {ALWAYS, *SAMPLED, *PEERS}


def keys(scenes: Any) -> set[str]:
    return {element.key for scene in scenes for element in elements_of(scene.mechanism.constraints)}


@pytest.mark.parametrize("name", PEERS)
def test_the_accepted_baseline_has_an_answer_with_whatever_the_table_of_an_engine_has(accepted: Any, name: str) -> None:
    answered = keys(parse(case["scene"]) for case in accepted["cases"].values() if name in case["methods"])
    table = load(name).capabilities()
    able = {key for key, levels in table.items() if levels[Level.SOLVE].support is not Support.REFUSED}

    assert able & keys(question.scene for question in questions()) <= answered


def test_the_accepted_reference_is_proved_at_every_time(accepted: Any) -> None:
    for case in accepted["cases"].values():
        assert set(case["reference"]["status"]) == {Status.OK.value}
        assert np.all(np.isfinite(np.array(case["reference"]["certified_radius"]["acceleration"], float)))


def test_the_reference_is_still_within_the_accepted_proof(accepted: Any) -> None:
    scenes = scenes_of(accepted["cases"])
    with checkers(1, {}) as workers:
        now = golden.measure(scenes, workers, [])

    assert differences(accepted["cases"], now, ()) == []


def test_a_loss_ends_the_command_with_1_and_leaves_the_baseline(file: Path, command: Any) -> None:
    expect_digits(file, ROUTE, rounding=True)
    before = file.read_bytes()

    code, out, _ = command("baseline", "--engines", "closed_form", "--file", file)

    assert code == 1
    assert f"{HARD}: closed_form (float), velocity: golden set: digits lost" in out
    assert file.read_bytes() == before


def test_accepting_tells_what_is_worse_and_then_nothing_is(file: Path, command: Any) -> None:
    expect_digits(file, ROUTE, rounding=True)

    code, out, _ = command("baseline", "--accept", "--engines", "closed_form", "--file", file)

    assert (code, "digits lost" in out) == (0, True)
    assert command("baseline", "--engines", "closed_form", "--file", file).returncode == 0


@pytest.mark.parametrize("accept", [(), ("--accept",)])
def test_an_engine_that_answers_nothing_is_never_taken_for_one_that_is_not_worse(file, tmp_path, command, accept):
    spec, before = engine_file(tmp_path, before="raise EngineRefusal('it takes nothing')"), file.read_bytes()
    code, _, err = command("baseline", *accept, "--engines", f"closed_form,{spec}", "--file", file)

    assert (code, err) == (1, "no answer to any case of the golden set: fake\n")
    assert file.read_bytes() == before


def test_an_engine_that_the_baseline_does_not_have_is_named(file: Path, command: Any) -> None:
    both, alone = (
        command("baseline", "--engines", asked, "--file", file)
        for asked in ("closed_form,refkin-batch", "refkin-batch")
    )

    assert (both.returncode, alone.returncode) == (0, 2)
    assert "not compared, as the baseline does not have them: refkin-batch" in both.stdout
    accepted = command("baseline", "--accept", "--engines", "refkin-batch", "--file", file)
    assert "no longer in the baseline: closed_form" in accepted.stdout


def test_an_engine_that_is_missing_ends_the_command_with_3(file: Path, tmp_path: Path, command: Any) -> None:
    assert command("baseline", "--engines", f"{tmp_path / 'gone.py'}:Gone", "--file", file).returncode == 3
