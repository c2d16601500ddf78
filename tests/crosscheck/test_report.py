"""report.json: the numbers against the raw samples by other means, the verdict against planted faults."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tracemalloc
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crosscheck.documents.ledger.page import newton_histories
from crosscheck.judge.records import At, Cause, plain
from crosscheck.measure import check
from crosscheck.night.history import remember
from crosscheck.night.sections import pictures, write_documents
from crosscheck.report.build import plain as plain_data
from crosscheck.report.build import summarized
from crosscheck.report.cells import quantile
from crosscheck.report.first_table import first_table
from crosscheck.report.summary import Summary, verdict
from refkin.scenes.files import to_dict
from tests.linkages import ROCKER
from tests.places import ROOT

from .report_records import (
    QUANTITIES,
    ROUTES,
    WHO,
    answer,
    built,
    case,
    disagreement,
    failed_record,
    floored,
    gap,
    good_answer,
    level,
    outcome,
    quantity,
    record,
    write,
)
from .test_report_sections import EFFECTS, HARD, PRICES


def reported(folder: Path, *arguments: Any, **more: Any) -> Any:
    built(folder, *arguments, **more)
    text = (folder / "report.json").read_text(encoding="utf-8")
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


@pytest.fixture(scope="module")
def sampled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, dict[Any, Any], list[Any]]:
    """A run of 40 scenes with random samples: its report, the raw digits by (engine, quantity, decade), its records."""
    draw = np.random.default_rng(5)
    raw: dict[Any, list[float]] = {}
    records = []
    for k in range(40):
        answers = []
        for engine in ROUTES:
            fields = {}
            for name in QUANTITIES:
                samples = {int(d): draw.uniform(-1.0, 17.0, 7) for d in draw.choice([-6, -3, -1, 0], 2, replace=False)}
                for decade, digits in samples.items():
                    raw.setdefault((engine, name, decade), []).extend(digits)
                fields[name] = quantity(samples, float(draw.uniform(0.0, 0.9)), At("crank.x", float(k)))
            answers.append(answer(engine, fields, compared=14, times=14, seconds=float(draw.uniform(1e-4, 1e-2))))
        levels = [level("mujoco", "drift", draw.uniform(10, 17, 2)), level("mujoco", "jacobian", [15.0, 16.0], 0.75)]
        records.append(record(f"{k:04x}", *answers, levels=levels))
    folder = write(tmp_path_factory.mktemp("run"), *records)
    return reported(folder), raw, records


@pytest.mark.parametrize("engine", ROUTES)
@pytest.mark.parametrize("name", QUANTITIES)
def test_quantiles_are_those_of_the_raw_samples(sampled: Any, engine: str, name: str) -> None:
    report, raw, _ = sampled
    digits = floored([d for (e, q, _), some in raw.items() if (e, q) == (engine, name) for d in some])
    expected = [*np.quantile(digits, [0.5, 0.01], method="inverted_cdf"), digits.min()]

    cell = report["engines"][engine][ROUTES[engine]][name]
    assert expected == [cell["digits_median"], cell["digits_p01"], cell["digits_worst"]]


@pytest.mark.parametrize("name", QUANTITIES)
def test_quantiles_by_decade_are_those_of_the_raw_samples(sampled: Any, name: str) -> None:
    report, raw, _ = sampled
    expected = {}
    for (engine, quantity_name, decade), digits in raw.items():
        if (engine, quantity_name) == ("mujoco", name):
            kept = floored(digits)
            median, low = np.quantile(kept, [0.5, 0.01], method="inverted_cdf")
            numbers = {"digits_median": median, "digits_p01": low, "digits_worst": kept.min()}
            expected[str(decade)] = {"samples": len(kept), **numbers}

    assert expected == report["engines"]["mujoco"]["newton"][name]["digits_by_sigma"]


def test_worst_ratio_is_the_largest_of_the_records_and_names_its_record(sampled: Any) -> None:
    report, _, records = sampled
    worst = max(records, key=lambda r: r["answers"][1]["quantities"]["velocity"]["ratio"])

    cell = report["engines"]["mujoco"]["newton"]["velocity"]
    actual = worst["answers"][1]["quantities"]["velocity"]
    place = {"key": worst["key"], "scene": worst["scene"], "line": records.index(worst) + 1}
    assert {"ratio": actual["ratio"], **place, **actual["worst"]} == cell["worst"]


def test_own_rows_stand_under_the_method_and_were_handed_the_configuration_and_drift_is_called_gamma(
    sampled: Any,
) -> None:
    report, _, records = sampled
    drift = [int(d) / 10 for r in records for d, n in r["levels"][0]["digits"].items() for _ in range(n)]

    cell = report["engines"]["mujoco"]["newton"]["gamma"]
    assert np.quantile(drift, 0.5, method="inverted_cdf") == cell["digits_median"]
    cell = report["engines"]["mujoco"]["newton"]["jacobian"]
    assert (cell["worst_over_allowed"], cell["seeding"], cell["newton_by"]) == (0.75, "configuration", "none")


def test_every_cell_has_every_key_that_is_promised(sampled: Any) -> None:
    digits = {"digits_median", "digits_p01", "digits_worst", "worst_over_allowed", "scenes", "failures", "known_gaps"}
    promised = digits | {"seeding", "newton_by", "linear_solve_by"}

    for methods in sampled[0]["engines"].values():
        for quantities in methods.values():
            for name in (*QUANTITIES, "jacobian", "gamma"):
                assert promised <= quantities[name].keys()


def test_who_did_what_is_what_the_records_say(sampled: Any) -> None:
    """And a quantity that nobody compared has no number at all."""
    cells = sampled[0]["engines"]["pinocchio"]["joint tree"]
    who = {key: WHO[key] for key in ("seeding", "newton_by", "linear_solve_by", "drift_by")}

    assert who.items() <= cells["position"].items()
    numbers = ("digits_median", "digits_p01", "digits_worst", "worst_over_allowed", "worst", "scenes")
    assert [cells["jacobian"][key] for key in numbers] == [None] * 5 + [0]


@given(st.dictionaries(st.integers(-20, 170), st.integers(1, 50), min_size=1), st.sampled_from([1, 50]))
def test_quantile_is_the_sample_of_its_rank(counts: dict[int, int], percent: int) -> None:
    samples = sorted(Counter(counts).elements())
    below = math.ceil(len(samples) * percent / 100)

    assert quantile(counts, percent) == samples[max(below, 1) - 1] / 10


def test_infinite_ratio_stays_the_largest_and_the_file_stays_json(tmp_path: Path) -> None:
    wrong = disagreement(ratio=sys.float_info.max)
    report = reported(write(tmp_path, record("a", good_answer("mujoco"), disagreements=[wrong])))

    assert sys.float_info.max == report["engines"]["mujoco"]["newton"]["velocity"]["worst_over_allowed"]


# The verdict.


GOOD = good_answer("mujoco")
LOST = record("a", GOOD)
LOST["reference"] |= {"verdict": "branch_lost", "statuses": {"ok": 1, "branch_lost": 3}}
NO_ANSWER = disagreement(quantity="status", kind=Cause.NO_ANSWER, ratio=None)
CRASH = {"engine": "mujoco", "method": "any", "quantity": "status", "kind": "crash", "how": "exit code -11"}


def off(ratio, *rows):
    """Return a record whose positions are off by a ratio of what is allowed."""
    return record("a", answer("mujoco", {"position": quantity({-1: [3.0]}, ratio)}), disagreements=rows)


def listed(*rows, answer=GOOD):
    return [record("a", answer, disagreements=rows)]


GAP = [gap(quantity="velocity")]
ONE, TWO = disagreement(), disagreement(quantity="position")
TURNED = disagreement(quantity="position", kind=Cause.REVERSED)
BEYOND = answer("mujoco", {name: quantity({-1: [0.0]}, 1e9) for name in ("position", "velocity")})
VERDICTS = {
    "agreement everywhere": ([record("a", GOOD)], {"run": outcome()}, ("pass", 0, 0)),
    "a disagreement of a record alone": (listed(ONE), {"run": outcome()}, ("new disagreements", 1, 0)),
    "one that the run alone tells": (
        [record("a", GOOD)],
        {"run": outcome(new=[case(ONE, "b")])},
        ("new disagreements", 1, 0),
    ),
    "one that both tell": (listed(ONE), {"run": outcome(new=[case(ONE)])}, ("new disagreements", 1, 0)),
    "a known gap": (listed(ONE), {"run": outcome(known=1), "gaps": GAP}, ("pass", 0, 1)),
    "a known gap and another": (listed(ONE, TWO), {"gaps": GAP}, ("new disagreements", 1, 1)),
    "a joint the wrong way round, once": (listed(TURNED, answer=BEYOND), {}, ("new disagreements", 1, 0)),
    "an answer hardly beyond its budget": ([off(1.0000001)], {}, ("new disagreements", 1, 0)),
    "an answer far beyond its budget": ([off(40.0)], {}, ("new disagreements", 1, 0)),
    "an answer infinitely beyond its budget": ([off(None)], {}, ("new disagreements", 1, 0)),
    "rows beyond what is allowed": (
        [record("a", GOOD, levels=[level("mujoco", "jacobian", ratio=2.0)])],
        {},
        ("new disagreements", 1, 0),
    ),
    "a reference without an answer": ([LOST], {}, ("new disagreements", 1, 0)),
    "a scene without a result": ([record("a", GOOD), failed_record("b")], {"run": outcome()}, ("infrastructure", 0, 0)),
    "a failure that the run alone tells": (
        [record("a", GOOD)],
        {"run": outcome(failed=["x: the pool died"])},
        ("infrastructure", 0, 0),
    ),
}


@pytest.mark.parametrize(("records", "told", "expected"), VERDICTS.values(), ids=VERDICTS)
def test_the_verdict_and_what_it_counts(tmp_path: Path, records: Any, told: Any, expected: Any) -> None:
    report = reported(write(tmp_path, *records), told.get("run"), gaps=told.get("gaps", ()))

    assert (report["verdict"], report["new_disagreements"], report["known_disagreements"]) == expected


def test_a_scene_in_which_many_joints_are_blamed_counts_once(tmp_path: Path) -> None:
    """Each of them is a disagreement; the table of them says in how many scenes there are some."""
    report = reported(write(tmp_path, *listed(TURNED, TURNED, TURNED)))
    (row,) = report["disagreements"]

    assert (report["new_disagreements"], row["scenes"], row["examples"][0].get("again")) == (3, 1, None)


ALL_FAIL = dict.fromkeys(QUANTITIES, (1, 0))
SILENT = good_answer("mujoco", missing=1, compared=3)
CELLS = {
    "one that run and record tell": (listed(ONE), {"run": outcome(new=[case(ONE)])}, {"velocity": (1, 0)}),
    "a known gap": (listed(ONE), {"gaps": GAP}, {"velocity": (0, 1)}),
    "rows beyond what is allowed": (VERDICTS["rows beyond what is allowed"][0], {}, {"jacobian": (1, 0)}),
    "no answer and a wrong one": (listed(ONE, NO_ANSWER, answer=SILENT), {}, {"velocity": (1, 0)}),
    "a crash": ([record("a", GOOD), record("b", disagreements=[CRASH])], {}, ALL_FAIL),
    "no answer": (listed(NO_ANSWER, answer=SILENT), {}, ALL_FAIL),
}


@pytest.mark.parametrize(("records", "told", "expected"), CELLS.values(), ids=CELLS)
def test_what_counts_against_an_engine_in_a_quantity(tmp_path: Path, records: Any, told: Any, expected: Any) -> None:
    report = reported(write(tmp_path, *records), told.get("run"), gaps=told.get("gaps", ()))
    cells = report["engines"]["mujoco"]["newton"]

    assert {name: (cells[name]["failures"], cells[name]["known_gaps"]) for name in expected} == expected


def test_an_engine_that_crashed_on_every_scene_still_has_its_failures(tmp_path: Path) -> None:
    report = reported(write(tmp_path, record("b", disagreements=[{**CRASH, "kind": "hang"}])))

    assert report["engines"]["mujoco"]["any"]["position"]["failures"] == 1


def test_scenes_without_an_answer_and_without_a_result_are_counted_and_no_scene_twice(tmp_path: Path) -> None:
    missing = record("a", SILENT, disagreements=[NO_ANSWER])
    report = reported(write(tmp_path, missing, missing, failed_record("b")))
    cell = report["engines"]["mujoco"]["newton"]["velocity"]

    assert (report["scenes"], report["scenes_without_result"]) == (2, 1)
    assert (cell["scenes"], cell["unanswered"]) == (1, 1)


@pytest.mark.parametrize(
    ("answer", "note"),
    [(good_answer("mujoco", version="0.9"), "0.9"), (good_answer("mujoco", compared=6, times=6), "mujoco position 2")],
    ids=["another version than the run names", "judged without digits"],
)
def test_what_does_not_fit_is_noted(tmp_path: Path, answer: Any, note: str) -> None:
    report = reported(write(tmp_path, record("a", answer)), outcome())

    assert any(note in text for text in report["notes"])


@pytest.mark.parametrize(
    ("required", "missing", "verdict"),
    [
        (("exudyn",), {"exudyn": "no module named exudyn"}, "engine missing"),
        ((), {"exudyn": "no module named exudyn"}, "pass"),
        (("exudyn", "mujoco"), {}, "engine missing"),
    ],
    ids=["required and missing", "missing and not required", "required and answered nothing"],
)
def test_a_required_engine_that_is_missing_is_the_verdict(tmp_path, required, missing, verdict):
    report = reported(write(tmp_path, record("a", GOOD), required=required, missing=missing))

    assert report["verdict"] == verdict
    assert "exudyn" in report["why"]


def test_engines_that_nobody_required_are_not_called_so_where_none_can_be_loaded(tmp_path):
    ended = outcome(versions={"closed_form": "1"}, missing={"exudyn": "engine 'exudyn' is not there"}, checked=0)
    report = reported(tmp_path / "new", ended)

    assert report["verdict"] == "engine missing"
    assert report["why"] == "No engine that was asked for can be loaded: engine 'exudyn' is not there"


def test_a_night_in_which_no_engine_answers_is_no_pass():
    asked = {"required": (), "missing": {}, "new": {}, "failures": 0, "scenes": 5, "peers": ("fake", "other")}

    assert verdict(**asked, answering=("closed_form", "other"))[0] == "pass"
    assert verdict(**asked, answering=("closed_form",)) == ("engine missing", "No engine answered a scene: fake, other")


def test_what_no_finding_explains_at_hard_cases_is_part_of_the_verdict(tmp_path: Path) -> None:
    """An engine that died at every one had a pass, and was "nowhere" wrong."""
    row = {"engine": "mujoco", "method": "newton", "case": "limit", "distance": 1e-8, "of": 87}
    rows = [
        {**row, "verdict": verdict, "class": kind}
        for verdict, kind in (("crash", None), ("wrong", None), ("wrong", "our misuse"))
    ]
    folder = write(tmp_path, record("a", good_answer("mujoco")))
    (folder / "hard_cases.json").write_text(json.dumps(rows), encoding="utf-8")
    report = reported(folder)
    (made,) = (row for row in first_table(report)[0]["rows"] if row["method"] == "newton")

    assert report["verdict"] == "new disagreements"
    assert report["why"] == "No finding explains what is wrong, or ended, at hard cases: mujoco 2"
    assert "no answer, as it crashed or hung, at 1 kinds of hard cases" in made["silent"]
    assert made["silent_class"] == "bad"


def test_torn_line_is_an_infrastructure_failure_with_its_line(tmp_path: Path) -> None:
    folder = write(tmp_path, record("a", good_answer("mujoco")))
    with (folder / "records.jsonl").open("a", encoding="utf-8") as file:
        file.write('{"key": "b", "sce')
    report = reported(folder)

    assert report["verdict"] == "infrastructure"
    assert "line 2" in report["failures"][0]


@pytest.mark.parametrize("part", ["key", "reference", "answers", "levels", "disagreements"])
def test_record_that_lacks_a_part_is_an_infrastructure_failure(tmp_path: Path, part: str) -> None:
    torn = record("b", good_answer("mujoco"))
    folder = write(tmp_path, record("a", good_answer("mujoco")), torn)
    del torn[part]
    lines = (folder / "records.jsonl").read_text().splitlines()
    (folder / "records.jsonl").write_text("\n".join([lines[0], json.dumps(torn)]) + "\n")

    assert reported(folder)["verdict"] == "infrastructure"


WRONG = {
    "a key that leads out of the folder": ("key", "../../../x", "key: '../../../x'; string should match pattern"),
    "a number that is text": ("levels", [{**level("mujoco", "drift"), "ratio": "far"}], "levels.0.ratio: 'far'; input"),
    "a key that nobody knows": ("colour", "red", "colour: 'red'; "),
    "a kind that nobody knows": ("disagreements", [{**disagreement(), "kind": "bad"}], "disagreements.0.kind: 'bad'; "),
    "answers that are none": ("answers", 3, "answers: 3; input should be a valid array"),
    "a number that is infinite": ("reference", {**record("a")["reference"], "seconds": math.inf}, "seconds: inf; "),
}


@pytest.mark.parametrize(("part", "value", "told"), WRONG.values(), ids=WRONG)
def test_a_record_of_a_wrong_shape_is_one_clear_error(tmp_path: Path, part: str, value: Any, told: str) -> None:
    folder = write(tmp_path, record("a", good_answer("mujoco")))
    with (folder / "records.jsonl").open("a", encoding="utf-8") as file:
        file.write(json.dumps({**record("b", good_answer("mujoco")), part: value}) + "\n")
    report = reported(folder)

    assert (report["verdict"], report["scenes"], report["failures_total"]) == ("infrastructure", 1, 1)
    assert report["failures"][0].startswith("records.jsonl, line 2 is no record: ")
    assert told in report["failures"][0]


PURE = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        parts = ("refkin.solving", "refkin.proof", "refkin.fast", "crosscheck.documents", "crosscheck.engines")
        if any(name == part or name.startswith(part + ".") for part in parts):
            raise ImportError(f"{name} is not there while the report is built")

sys.meta_path.insert(0, Blocked())
from pathlib import Path
from crosscheck.report.build import build
build(Path(sys.argv[1]))
"""


def test_the_report_solves_nothing_and_recomputes_nothing(tmp_path: Path) -> None:
    """The whole of a night's folder, without solvers, proofs, engines and documents."""
    scene = ROCKER.scene(samples=5)
    real = check.check(scene, ["closed_form"], {"shard": 0})
    write(tmp_path, plain(real), record("a", good_answer("mujoco"), disagreements=[disagreement()]))
    drawn = pictures([real], lambda r: {"scene": to_dict(scene)}, {"closed_form": "closed_form"})
    assert len(drawn["scenes"]) == 1
    for name, rows in {"price": PRICES, "effects": EFFECTS, "hard_cases": HARD, "pictures": drawn}.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(rows))
    write_documents(tmp_path)
    remember(tmp_path / "history.sqlite", summarized(tmp_path), tmp_path)
    built(tmp_path, gaps=[gap(quantity="velocity")])
    before = [(tmp_path / name).read_bytes() for name in ("report.json", "index.html")]
    subprocess.run([sys.executable, "-c", PURE, tmp_path], check=True, cwd=ROOT, timeout=60)

    assert [(tmp_path / name).read_bytes() for name in ("report.json", "index.html")] == before


def test_unreadable_run_file_is_an_infrastructure_failure(tmp_path: Path) -> None:
    folder = write(tmp_path, record("a", good_answer("mujoco")))
    (folder / "run.json").write_text('{"seed": 4')

    assert reported(folder)["verdict"] == "infrastructure"


def test_run_that_stopped_before_its_first_scene_for_want_of_an_engine_says_so(tmp_path: Path) -> None:
    ended = outcome(versions={}, missing={"exudyn": "no module"}, required=["exudyn"], checked=0)

    assert reported(tmp_path / "new", ended)["verdict"] == "engine missing"


def test_engine_that_answered_nothing_has_cells_without_numbers(tmp_path: Path) -> None:
    ended = outcome(versions={"mujoco": "1.0", "exudyn": "1.13"})
    report = reported(write(tmp_path, record("a", good_answer("mujoco"))), ended)

    (quantities,) = report["engines"]["exudyn"].values()
    assert (quantities["position"]["digits_median"], quantities["position"]["scenes"]) == (None, 0)


@pytest.mark.parametrize("text", [None, ""])
def test_folder_without_records_is_nothing_ran(tmp_path: Path, text: str | None) -> None:
    if text is not None:
        (tmp_path / "records.jsonl").write_text(text)

    assert reported(tmp_path, outcome(checked=0))["verdict"] == "nothing ran"


def test_coverage_counts_scenes_by_property_and_decade(tmp_path: Path) -> None:
    second = record("b", good_answer("mujoco"))
    second["about"] |= {"kind": "slider_crank", "grashof": None, "distance": 8e-7}
    coverage = reported(write(tmp_path, record("a", good_answer("mujoco")), second))["coverage"]

    expected = ({"four_bar": 1, "slider_crank": 1}, {"crank-rocker": 1, "not applicable": 1}, {"-7": 1, "-2": 1})
    assert expected == (coverage["kind"], coverage["grashof"], coverage["distance_decade"])


def test_refusals_are_counted_by_joint_type_not_by_joint(tmp_path: Path) -> None:
    fields = {"engine": "mujoco", "joint": "gear", "level": "solve", "reason": "no such joint in this engine"}
    rows = [{**fields, "name": name} for name in ("A", "B", "it's")]
    refusals = reported(write(tmp_path, record("a", good_answer("mujoco"), refusals=rows)))["refusals"]

    assert [{**fields, "scenes": 1, "joints": 3}] == refusals


def test_same_records_give_the_same_bytes(tmp_path: Path) -> None:
    folder = write(tmp_path, record("a", good_answer("mujoco"), disagreements=[disagreement()]))
    first, second = (built(folder).read_bytes() for _ in range(2))

    assert first == second


def test_memory_does_not_grow_with_the_number_of_samples(tmp_path: Path) -> None:
    peaks = []
    for count in (200, 1600):
        records = [record(f"{k:04x}", *(good_answer(e) for e in ROUTES)) for k in range(count)]
        folder = write(tmp_path / str(count), *records)
        tracemalloc.start()
        Summary(folder)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()

    # A scene leaves its key behind: a string of 65 bytes, and in a set that grows by four at a time up to 7 slots of 16
    # bytes and the 2 of the table it came from: 210 bytes. Its digits, as objects, are thousands.
    assert peaks[1] - peaks[0] < 1400 * 300


def test_records_as_they_are_really_written_are_understood(tmp_path: Path) -> None:
    scene = ROCKER.scene(samples=5)
    real = check.check(scene, ["closed_form"], {"kind": "four_bar", "distance": 1.0})
    report = reported(write(tmp_path, plain(real)))

    (result, *_) = plain(real)["answers"]
    cell = report["engines"]["closed_form"][result["method"]["name"]]["position"]
    assert (result["quantities"]["position"]["ratio"], result["compared"]) == (
        cell["worst_over_allowed"],
        cell["samples"],
    )


# Newton histories.


def test_a_regular_history_converges_with_order_two_and_one_at_a_fold_halves_its_corrections() -> None:
    histories = newton_histories()

    assert histories[0]["last_order"] == pytest.approx(2.0, abs=0.15)
    assert histories[-1]["typical_ratio"] == pytest.approx(0.5, abs=0.01)
    for history in histories:
        assert len(history["residual"]) == len(history["correction"]) + 1 == history["iterations"] + 1


def test_the_page_says_how_many_pairs_of_features_were_met_and_the_report_which_were_not(tmp_path: Path) -> None:
    common = {"class": "none", "hardness": "ordinary", "distance": None}
    scenes = [("revolute", "angle", "table"), ("revolute", "y", "table"), ("cam", "angle", "sinusoid")]
    about = [{**common, "joints": j, "driver": d, "law": law, "shard": k} for k, (j, d, law) in enumerate(scenes)]
    records = [{**record(str(k), good_answer("mujoco")), "about": drawn} for k, drawn in enumerate(about)]
    report = reported(write(tmp_path, *records))

    pairs = {" · ".join(row.pop("features")): row for row in report["together"]["pairs"]}
    assert pairs["driver · joints"] == {"met": 3, "of": 4, "once": 3, "missing": [["y", "cam"]]}
    without = [["cam", "table"], ["revolute", "sinusoid"]]
    assert pairs["joints · law"] == {"met": 2, "of": 4, "once": 1, "missing": without}


def test_what_json_cannot_hold_is_none_or_the_largest_double_however_deep() -> None:
    most = sys.float_info.max
    given = {"a": [math.nan, math.inf, {"b": (-math.inf, 1.5, None)}], 1: "text"}

    assert plain_data(given) == {"a": [None, most, {"b": [-most, 1.5, None]}], "1": "text"}


def test_the_extremes_of_the_reference_name_the_records_that_they_were_met_at(tmp_path: Path) -> None:
    met = {"a": (1e-16, 0.3, 2e-15), "b": (4e-16, 0.1, None), "c": (None, 0.2, 3e-15), "d": (2e-16, 0.25, 1e-15)}
    records = []
    for name, (residual, sigma, radius) in met.items():
        planted = record(name, GOOD)
        planted["reference"] |= {"residual": residual, "sigma_min": sigma, "certified_radius": {"velocity": radius}}
        records.append(planted)
    told = reported(write(tmp_path, *records))["reference"]
    extremes = (told["largest_residual"], told["smallest_sigma_min"], told["largest_certified_radius"]["velocity"])

    assert [(extreme["value"], extreme["scene"]) for extreme in extremes] == [
        (4e-16, "scene b"),
        (0.1, "scene b"),
        (3e-15, "scene c"),
    ]
    assert told["microseconds_mean"] == pytest.approx(1e6 * 4 * 0.002 / 16)
    assert (told["verdicts"], told["statuses"]) == ({"ok": 4}, {"ok": 16})
