"""The programs of the README run as they stand, and its commands name files and options that exist."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from crosscheck.judge.prices import POSES, offers
from crosscheck.judge.records import QUANTITIES
from crosscheck.report.first_table import first_table

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
PROGRAMS = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)


def test_the_programs_run_one_after_the_other_and_engines_agree(capsys):
    names: dict[str, object] = {}
    for program in PROGRAMS:
        exec(program, names)
    shown = capsys.readouterr().out.splitlines()

    assert shown[0] == "ok"
    assert float(shown[2]) < 1e-13
    assert "agreement with refkin" in "\n".join(shown)
    assert names["record"]["disagreements"] == []
    assert {answer["engine"] for answer in names["record"]["answers"]} == {"exudyn", "pinocchio", "mujoco"}


SAMPLE = json.loads((ROOT / "reports/sample/report.json").read_text(encoding="utf-8"))
ROWS_OF_ANSWERS = {
    "exudyn, its static solver, tight tolerance": ("exudyn", "static"),
    "exudyn, default tolerances": ("exudyn", "shipped"),
    "Pinocchio's equations, our Newton iteration": ("pinocchio", "joint tree"),
    "MuJoCo's equations, our Newton iteration": ("mujoco", "newton"),
    "formulas without iteration (no engine)": ("closed_form", "float"),
}
AS_SHIPPED = ("mj_step, as shipped", "closed-chain example")


def test_the_digits_of_the_readme_are_those_of_the_sample_report():
    """Its table has a row for every method of the page's first block, in the cells' own numbers."""
    first = first_table(SAMPLE)[0]["rows"]
    lines = re.findall(r"^\| ([^|]+) \| (.+) \| (.+) \| (.+) \| ([\de.+]+) \| (.+) \|$", TEXT, re.MULTILINE)
    shown = {ROWS_OF_ANSWERS[who]: (cells, float(worst), silent) for who, *cells, worst, silent in lines}

    assert shown.keys() == {(row["engine"], row["method"]) for row in first}
    for row in first:
        cells, worst, silent = shown[row["engine"], row["method"]]
        levels = SAMPLE["engines"][row["engine"]][row["method"]]
        largest = max(levels[quantity]["worst_over_allowed"] for quantity in QUANTITIES)
        digits = [
            f"{c['median']:.1f} / {c['worst']:.1f}" if c["worst"] > 0 else f"{c['median']:.1f} / **none**"
            for c in row["cells"]
        ]
        assert (cells, float(f"{largest:.1g}" if largest > 1.0 else f"{largest:.2f}")) == (digits, worst)
        kinds = re.search(r"\d+ of \d+ kinds of hard cases", row["silent"])
        assert kinds[0] in silent if kinds else silent.startswith("nowhere")


def test_what_the_readme_counts_is_what_the_sample_report_counts():
    reference, common = SAMPLE["reference"], SAMPLE["same_scenes"][0]["scenes"]
    cases = {(row["case"], row["distance"]) for row in SAMPLE["hard_cases"]}
    silent = {row["method"]: row["silent"] for block in first_table(SAMPLE) for row in block["rows"] if "method" in row}
    stepped, example = (re.match(r"\d+ of \d+", silent[method])[0] for method in AS_SHIPPED)

    poses = sum(reference["statuses"].values())
    assert f"SEED={SAMPLE['seed']}`: {SAMPLE['scenes']:,} mechanisms, {poses:,} poses" in TEXT
    assert f"those on the {common:,} mechanisms" in TEXT
    assert f"a fixed list of {SAMPLE['hard_cases'][0]['of']}" in TEXT
    assert f"This night had time for {len(cases)}:" in TEXT
    assert f"at {stepped} and {example} of the kinds" in TEXT
    assert all(SAMPLE["versions"][name] in TEXT for name in ("exudyn", "pinocchio", "mujoco"))


def test_the_prices_of_the_readme_are_those_of_the_sample_report():
    regular = [row for row in SAMPLE["price"] if row["scene_class"] == "regular"]
    table = re.findall(r"^\| (exudyn|Pinocchio|MuJoCo) \| (.+) \| (.+) \| (.+) \|$", TEXT, re.MULTILINE)

    def prices(engine):
        for poses in POSES:
            best = offers([row for row in regular if row["engine"] == engine], poses, "acceleration", 9)[:1]
            yield f"{best[0].microseconds:.{0 if best[0].microseconds >= 10 else 1}f}" if best else "not timed"

    assert [(name, *prices(name.lower())) for name in ("exudyn", "Pinocchio", "MuJoCo")] == table


BENCH = {
    (row["workload"], row["engine"], row["method"], row["setting"]): row["nanoseconds_per_configuration"]
    for path in sorted((ROOT / "reports").glob("bench-*.json"))
    for row in json.loads(path.read_text(encoding="utf-8"))["rows"]
    if len(row["computes"]) == (3 if row["unit"] == "configuration" else 1)
}
BATCH, PROVED = (
    ("refkin-batch", "all times at once", "no evidence"),
    ("refkin-batch", "all times at once", "certificate"),
)
SPARSE, SAME, DENSE = ("refkin-batch", "sparse", ""), ("c", "same program", ""), ("c", "dense Newton", "")
SOLVE, NEWTON = ("refkin", "solve", "no evidence"), "Newton on its rows, all times at once"
EXUDYN = ("exudyn", "MainSolverStatic.Newton, extrapolated", "absoluteTolerance 2e-15")
MUJOCO = ("mujoco", "mujoco.batch, all times at once", "|dq| < 1e-08")
PLANE, SPACE = ("sweep-1000", "many-10000x360"), ("rssr-1000", "rssrs-100x72")
CHAINS = ("chain-10", "chain-100", "chain-1000", "chain-10000")
FIGURES = [
    ("`refkin-batch`", PLANE, BATCH, None),
    ("`refkin-batch`, with a certificate for every pose", PLANE, PROVED, None),
    ("`refkin-batch` / the same operations compiled as C", PLANE, BATCH, SAME),
    ("`refkin-batch` / dense Newton in C", PLANE, BATCH, DENSE),
    ("`refkin-batch` / NumPy's closed form, the limit", PLANE, BATCH, ("numpy", "closed form", "")),
    ("fastest engine (MuJoCo, a batch by the adapter's Newton) / `refkin-batch`", PLANE, MUJOCO, BATCH),
    ("`refkin.solve` / `refkin-batch`", PLANE, SOLVE, BATCH),
    ("`refkin-batch`, sparse", CHAINS, SPARSE, None),
    ("/ the same operations compiled as C", CHAINS, SPARSE, SAME),
    ("/ dense Newton in C that passes over zeros", CHAINS, SPARSE, DENSE),
    ("/ exudyn's Newton, sparse", CHAINS, SPARSE, EXUDYN),
    ("`refkin-batch`", SPACE, BATCH, None),
    ("certificates of every pose as well", SPACE, PROVED, None),
    ("Pinocchio / `refkin-batch`", SPACE, ("pinocchio", NEWTON, "|dq| < 1e-08"), BATCH),
    ("MuJoCo / `refkin-batch`", SPACE, ("mujoco", NEWTON, "|dq| < 1e-08"), BATCH),
    ("exudyn / `refkin-batch`", SPACE, EXUDYN, BATCH),
    ("`refkin.solve` / `refkin-batch`", SPACE, SOLVE, BATCH),
]
UNITS = {"ns": 1.0, "us": 1e3, "ms": 1e6}


def test_the_figures_of_the_benchmark_are_those_of_its_records():
    """To the digits that are written; no table has a line that is not held against them."""
    text = (ROOT / "reports/README.md").read_text(encoding="utf-8").split("## The benchmark")[1]
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in re.findall(r"^\|.*\|$", text, re.MULTILINE)
    ]
    lines = [line for line in lines if re.match(r"[\d.]+(?: [num]s)?$", line[1])]

    assert [label for label, *_ in lines] == [label for label, *_ in FIGURES]
    for (_, *cells), (_, columns, who, other) in zip(lines, FIGURES, strict=True):
        for cell, column in zip(cells, columns, strict=True):
            written, unit = re.fullmatch(r"([\d.]+)?(?: ([num]s))?.*", cell).groups()
            if written is None:
                assert (column, *other) not in BENCH
                continue
            measured = BENCH[column, *who] / (BENCH[column, *other] if other else UNITS[unit])
            digits = len(written.partition(".")[2])
            assert abs(float(written) - measured) <= 0.5001 * 10.0**-digits, (cell, measured)


def test_the_winners_that_are_said_to_repeat_are_those_of_the_record():
    record = json.loads((ROOT / "reports/price-again-2026-11-29.json").read_text(encoding="utf-8"))
    text = (ROOT / "docs/howto/cost.md").read_text(encoding="utf-8")

    same, pairs, same_cells, cells = (
        sum(one[key] for one in record) for key in ("same", "pairs", "same_cells", "cells")
    )
    assert f"{same} of {pairs} winners\n  won again, in {same_cells} of {cells} cells" in text
    assert [one["busy_loops_beside"] for one in record].count(3) == 2  # "two of them"


NAMED = sorted(set(re.findall(r"(?:examples|reports|crosscheck|refkin|docs)/[\w./-]*\w", TEXT)))


@pytest.mark.parametrize("path", NAMED)
def test_files_that_are_named_exist(path):
    assert path.startswith("reports/latest") or (ROOT / path).exists()


def test_the_targets_of_make_that_are_named_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    named = set(re.findall(r"`?make (\w+)", TEXT))

    assert named
    assert all(re.search(rf"^{target}:", makefile, re.MULTILINE) for target in named)
