"""The programs of the README run as they stand, and its commands name files and options that exist."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from crosscheck.judge.prices import POSES, offers

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
PROGRAMS = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)


def test_the_library_programs_run_one_after_the_other(capsys):
    names: dict[str, object] = {}
    for program in PROGRAMS:
        exec(program, names)
    shown = capsys.readouterr().out.splitlines()

    assert shown[0] == "ok"
    assert float(shown[2]) < 1e-13
    assert "agreement with refkin" in "\n".join(shown)


def test_the_record_of_the_readme_has_no_disagreement():
    names: dict[str, object] = {}
    for program in PROGRAMS:
        exec(program, names)

    assert names["record"]["disagreements"] == []
    assert {answer["engine"] for answer in names["record"]["answers"]} == {"exudyn", "pinocchio", "mujoco"}


def test_the_prices_of_the_readme_are_those_of_the_sample_report():
    rows = json.loads((ROOT / "reports/sample/report.json").read_text(encoding="utf-8"))["price"]
    regular = [row for row in rows if row["scene_class"] == "regular"]
    table = re.findall(r"^\| (exudyn|Pinocchio|MuJoCo) \| (.+) \| (.+) \| (.+) \|$", TEXT, re.MULTILINE)

    def prices(engine):
        for poses in POSES:
            best = offers([row for row in regular if row["engine"] == engine], poses, "acceleration", 9)[:1]
            yield f"{best[0].microseconds:.{0 if best[0].microseconds >= 10 else 1}f}" if best else "not timed"

    assert [(name, *prices(name.lower())) for name in ("exudyn", "Pinocchio", "MuJoCo")] == table


NAMED = sorted(set(re.findall(r"(?:examples|reports|crosscheck|refkin|docs)/[\w./-]*\w", TEXT)))


@pytest.mark.parametrize("path", NAMED)
def test_files_that_are_named_exist(path):
    assert path.startswith("reports/latest") or (ROOT / path).exists()


def test_the_targets_of_make_that_are_named_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    named = set(re.findall(r"`?make (\w+)", TEXT))

    assert named
    assert all(re.search(rf"^{target}:", makefile, re.MULTILINE) for target in named)
