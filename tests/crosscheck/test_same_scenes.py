"""The first table compares like with like: digits stand side by side only where they are of the same scenes."""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from crosscheck.report.build import coverage, together
from crosscheck.report.first_table import first_table

from .report_records import QUANTITIES, ROUTES, answer, disagreement, floored, of_run, price_row, quantity, record
from .test_report_sections import HARD as HARD_CASES

EASY, HARD = [16.0, 16.1, 16.2, 16.3], [8.0, 8.1, 12.2, 12.3]
SLIGHTLY_WORSE = [digits - 0.5 for digits in EASY]
PRICED = {"engine": "mujoco", "method": "mj_step, as shipped", "setting": "", "microseconds": 9.0}
PRICED = [{**asdict(price_row(**PRICED, quantity=q, digits=3.5)), "scene_class": "regular"} for q in QUANTITIES]


def answered(engine: str, digits: Any, ratio: float = 0.5, method: str = "", **more: Any) -> dict[str, Any]:
    made = answer(engine, {name: quantity({-1: digits}, ratio) for name in QUANTITIES}, **more)
    return {**made, "method": {**made["method"], "name": method or ROUTES[engine]}}


def text(html: str) -> str:
    return " ".join(re.sub("<[^>]*>", " ", html).split())


def blocks(page: str) -> list[tuple[str, dict[str, list[str]]]]:
    """Return the blocks of the first table: head, and by method the cells of its row."""
    found = []
    table = page[page.index('<section id="first"') : page.index("<figure>")]
    for body in re.findall(r"<tbody.*?</tbody>", table, re.DOTALL):
        head, rows = "", {}
        for row in re.findall(r"<tr.*?</tr>", body, re.DOTALL):
            cells = [text(cell) for cell in re.findall(r"<t[dh].*?</t[dh]>", row, re.DOTALL)]
            if 'scope="rowgroup"' in row:
                head = cells[0]
            else:
                rows[" ".join(cells[0].split()[:3])] = [cells[0], *cells[1:]]
        found.append((head, rows))
    return found


def sampled() -> tuple[Any, str]:
    """A run of six scenes, two of them easy: a method is asked for these alone, and is worse there than the others."""
    records = []
    for k in range(6):
        answers = [answered(engine, EASY if k < 2 else HARD) for engine in ("mujoco", "exudyn")]
        records.append(record(f"{k:04x}", *answers, *([answered("pinocchio", SLIGHTLY_WORSE)] if k < 2 else [])))
    with TemporaryDirectory() as folder:
        return of_run(Path(folder), *records)


def test_a_method_that_is_asked_for_easier_scenes_does_not_look_better() -> None:
    """Beside whatever digits its own stand, these are of the same scenes, and more."""
    (head, first), (of_few, few) = blocks(sampled()[1])

    assert {row[1] for row in first.values()} == {"12.2 / 8.0"}
    of_which = "on the 6 scenes (24 poses) that all of these answered; rates where these are called for"
    assert head == f"half of all poses / the worst pose, {of_which}"
    assert [row[1:4] for row in few.values()] == [["15.6 / 15.5"] * 3, ["16.1 / 16.0"] * 3]
    assert list(few) == ["pinocchio · joint", "the best of"]
    assert "on the 2 scenes (8 poses) that these and all of the first block answered" in of_few


def test_report_json_has_the_others_on_the_sample_too_and_says_who_stands_apart() -> None:
    first, few = sampled()[0]["same_scenes"]

    assert [(b["scenes"], b["poses"], b["apart"]) for b in (first, few)] == [
        (6, 24, []),
        (2, 8, [["pinocchio", "joint tree"]]),
    ]
    assert first["engines"].keys() == {"mujoco", "exudyn"}
    assert [few["engines"][e][m]["velocity"]["digits_median"] for e, m in ROUTES.items()] == [15.6, 16.1, 16.1]


def test_digits_of_every_block_are_those_of_the_raw_samples_on_the_scenes_that_all_have(tmp_path: Path) -> None:
    """Five methods, each at random at its share of the scenes, two of them drawn together as a night samples them."""
    draw = np.random.default_rng(7)
    shares = {("mujoco", "a"): 1.0, ("mujoco", "b"): 0.95, ("exudyn", "c"): 0.9}
    raw: list[dict[Any, Any]] = []
    for _ in range(60):
        few = draw.random() < 0.2
        who = [w for w, share in shares.items() if draw.random() < share]
        who += [("pinocchio", "d"), ("pinocchio", "e")] * few
        raw.append({w: {q: draw.uniform(1.0, 17.0, 4) for q in QUANTITIES} for w in who})
    records = []
    for k, scene in enumerate(raw):
        made = [answered(e, EASY, method=m) for e, m in scene]
        for one, digits in zip(made, scene.values(), strict=True):
            one["quantities"] = {q: quantity({-1: digits[q][:2], -4: digits[q][2:]}) for q in QUANTITIES}
        records.append(record(f"{k:04x}", *made))
    first, few = of_run(tmp_path, *records)[0]["same_scenes"]

    assert few["apart"] == [["pinocchio", "d"], ["pinocchio", "e"]]
    for block, names in ((first, list(shares)), (few, [*shares, ("pinocchio", "d"), ("pinocchio", "e")])):
        common = [scene for scene in raw if set(names) <= scene.keys()]
        assert block["scenes"] == len(common) > 3
        for (engine, method), q in ((w, q) for w in names for q in QUANTITIES):
            digits = floored([d for scene in common for d in scene[engine, method][q]])
            median, low = np.quantile(digits, [0.5, 0.01], method="inverted_cdf")
            expected = {"samples": 4 * len(common), "digits_median": median, "digits_p01": low}
            assert block["engines"][engine][method][q] == {**expected, "digits_worst": digits.min()}


def test_a_fault_at_a_scene_that_another_did_not_answer_is_not_hidden(tmp_path: Path) -> None:
    wrong = record("b", answered("mujoco", [1.0] * 4, ratio=9.0), disagreements=[disagreement(quantity="velocity")])
    shared = [record(name, *(answered(e, EASY) for e in ("mujoco", "exudyn"))) for name in ("a", "c")]
    report, page = of_run(tmp_path, *shared, wrong)
    ((_, rows),) = blocks(page)

    assert rows["mujoco · newton"][1:4] == ["16.1 / 16.0"] * 3
    assert "3 scenes in all" in rows["mujoco · newton"][0]
    assert rows["mujoco · newton"][5] == "beyond the allowed error: 1 scene"
    assert first_table(report)[0]["rows"][1]["cells"][1]["class"] == "bad"
    assert report["engines"]["mujoco"]["newton"]["velocity"]["digits_worst"] == 1.0


@pytest.mark.parametrize(("fewer", "said"), [(1, "; 1 pose fewer"), (2, "; 2 poses fewer")])
def test_a_method_that_is_compared_at_fewer_poses_of_a_scene_says_so(tmp_path: Path, fewer: int, said: str) -> None:
    looser = answered("exudyn", HARD[fewer:], compared=4 - fewer)
    _, page = of_run(tmp_path, record("a", answered("mujoco", HARD), looser))
    ((_, rows),) = blocks(page)

    assert [row[0].rpartition("in all")[2] for row in rows.values()] == [said, ""]


def test_a_scene_at_which_nothing_was_compared_is_none_that_was_answered(tmp_path: Path) -> None:
    none = answer("exudyn", {"position": quantity({}, None, None)}, compared=0, missing=4)
    both = record("b", answered("mujoco", EASY), answered("exudyn", EASY))
    report, _ = of_run(tmp_path, record("a", answered("mujoco", HARD), none), both)

    assert (report["same_scenes"][0]["scenes"], len(report["same_scenes"])) == (1, 1)


def test_methods_without_a_scene_in_common_are_not_compared(tmp_path: Path) -> None:
    """Each of the two that answer few has a block of its own: they have no scene in common either."""
    records = [record(f"{k}", answered("mujoco", HARD)) for k in range(5)]
    records[0]["answers"] += [answered("exudyn", EASY)]
    report, page = of_run(tmp_path, *records, record("b", answered("pinocchio", EASY)))
    found = blocks(page)

    assert [block["scenes"] for block in report["same_scenes"]] == [5, 1, 0]
    assert found[1][1]["the best of"][1] == "8.1 / 8.0"
    assert found[2][1]["pinocchio · joint"][1:4] == ["at no scene in common"] * 3


def test_digits_of_the_price_list_stand_under_a_head_that_says_so(tmp_path: Path) -> None:
    """Under the head of medians and worst poses stood the most digits of another list of scenes."""
    hard = [{**HARD_CASES[0], "method": "mj_step"}]
    _, page = of_run(tmp_path, record("a", answered("mujoco", EASY)), price=PRICED, hard_cases=hard)
    (_, first), (head, rows) = blocks(page)

    assert list(first) == ["mujoco · newton"]
    assert head.endswith("the most digits of any setting on any scene of the price list")
    assert rows["mujoco · mj_step,"][1:4] == ["at most 3.5"] * 3
    assert "median / worst" not in text(page[page.index("<thead") : page.index("</thead>")])


@pytest.mark.parametrize(
    ("cases", "said"),
    [
        (None, "nowhere; hard cases were not asked"),
        ([{**HARD_CASES[0], "of": 87, "distance": d} for d in (1e-3, 1e-6)], "asked at 2 of 87 hard cases"),
        ([{**HARD_CASES[0], "of": 1}], "nowhere"),
        ([{**HARD_CASES[0], "engine": "exudyn"}], "nowhere; not asked at hard cases"),
    ],
)
def test_that_it_was_nowhere_wrong_says_at_how_many_hard_cases_that_was_looked_for(
    tmp_path: Path, cases: Any, said: str
) -> None:
    _, page = of_run(tmp_path, record("a", answered("mujoco", EASY)), **({"hard_cases": cases} if cases else {}))

    assert blocks(page)[0][1]["mujoco · newton"][5].endswith(said)


def test_a_mechanism_without_a_joint_has_a_name_in_every_table_of_coverage(tmp_path: Path) -> None:
    features = {"joints": "", "driver": "distance", "law": "table", "class": "Stewart", "hardness": "regular"}
    report, _ = of_run(tmp_path, record("a", answered("mujoco", EASY), about=features))
    tables = {table["title"]: table["rows"] for table in coverage(report)}

    assert tables["Joints"] == [("no joint, drivers alone", 1, 1.0)]
    assert [name for name, _ in together(report["together"])["by_joints"]] == ["no joint, drivers alone"]
