"""The book: every example runs, every joint has its picture, equations that are cited exist, and it builds."""

from __future__ import annotations

import importlib
import json
import re
import shutil
import subprocess
import sys

import pytest

import crosscheck
from crosscheck import strategies
from crosscheck.cli import main
from crosscheck.measure.check import SHARPNESS, TURNED_ROUND
from crosscheck.scenes import drawing
from refkin import SpatialAngleDriver, SpatialRevolute
from refkin.joints import DRIVER_TYPES, JOINT_TYPES, SPATIAL_DRIVER_TYPES, SPATIAL_JOINT_TYPES
from refkin.scenes.files import load
from refkin.solving.solve import solve
from tests.houseplan import ROOT, sources

DOCS = ROOT / "docs"
PAGES = sorted(page for page in DOCS.rglob("*.md") if not {"_made", "_build"} & set(page.parts))
BLOCK = re.compile(r"(?:`([\w-]+\.toml)`:\n\n)?^```(python|console|toml)\n(.*?)^```", re.MULTILINE | re.DOTALL)
"""A block that is run; a scene file is named in the line before it. Blocks of `sh` are for a reader alone."""


def blocks(page):
    return BLOCK.findall(page.read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)], ids=lambda page: page.stem)
def test_the_examples_of_a_page_run_one_after_the_other(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    names: dict[str, object] = {"__name__": "book"}
    for file, kind, text in blocks(page):
        if kind == "python":
            exec(compile(text, str(page), "exec", dont_inherit=True), names)
        elif kind == "toml" and file:
            (tmp_path / file).write_text(text, encoding="utf-8")
        elif kind == "console":
            for line in text.splitlines():
                assert line.startswith("$ crosscheck "), line
                with pytest.raises(SystemExit) as end:
                    main(line.partition("  #")[0].split()[2:])
                assert end.value.code == 0, (line, capsys.readouterr().err)


def test_pages_have_examples():
    """The pattern finds them: a page whose blocks nobody sees would pass unread."""
    fences = {page.stem: len(re.findall(r"^```(?:python|console)$", page.read_text(), re.MULTILINE)) for page in PAGES}

    assert sum(fences.values()) >= 15
    assert fences == {page.stem: sum(kind != "toml" for _, kind, _ in blocks(page)) for page in PAGES}


@pytest.mark.parametrize("file", sorted((DOCS / "scenes").glob("*.toml")), ids=lambda file: file.stem)
def test_the_scenes_of_the_book_are_solved(file):
    assert solve(load(file)).verdict == "ok"


def test_every_joint_and_driver_has_a_scene_that_shows_it():
    joints = [("", cls) for cls in JOINT_TYPES] + [("spatial-", cls) for cls in SPATIAL_JOINT_TYPES]
    drivers = [("", cls) for cls in DRIVER_TYPES] + [("spatial-", cls) for cls in SPATIAL_DRIVER_TYPES]
    for kind, types in (("joint", joints), ("driver", drivers)):
        for prefix, cls in types:
            name = prefix + cls.__dataclass_fields__["type"].default
            scene = load(DOCS / "scenes" / (f"{name}.toml" if kind == "joint" else f"{name}-driver.toml"))

            assert cls in {type(c) for c in getattr(scene.mechanism, f"{kind}s")}


def test_the_forms_that_the_book_tells_of_a_driver_of_space_are_those_that_it_may_have(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    key_rows = importlib.import_module("made").key_rows
    told = {cls: row for cls in (SpatialRevolute, SpatialAngleDriver) for row in key_rows(cls) if "`form`" in row}

    assert '`"half"` or `"dot"` or `"printed"` (' in told[SpatialRevolute]
    assert 'it: `"half"` or `"dot"` (' in told[SpatialAngleDriver]


def test_digits_beyond_the_attainable_ones_that_the_book_tells_are_those_of_the_sample_report():
    prices = json.loads((ROOT / "reports/sample/report.json").read_text(encoding="utf-8"))["price"]
    rows = [
        r for r in prices if (r["scene_class"], r["quantity"]) == ("regular", "position") and r["digits"] is not None
    ]
    told = re.search(r"position ([\d.]+) where ([\d.]+)\s+are\s+attainable", (DOCS / "howto" / "cost.md").read_text())

    best = max(rows, key=lambda row: row["digits"])
    assert told
    assert [*told.groups()] == [f"{best[key]:.1f}" for key in ("digits", "digits_attainable")]


def test_the_reference_has_every_function_of_crosscheck_and_every_strategy():
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    (members,) = re.findall(r"automodule:: crosscheck\.strategies\n   :members: (.*)", text)

    assert {f"crosscheck.{name}" for name in crosscheck.__all__} <= set(re.findall(r"autofunction:: (\S+)", text))
    assert {name for name in strategies.__all__ if name.islower()} == set(members.split(", "))


def test_the_shares_of_a_night_that_the_book_tells_are_those_of_the_code():
    told = re.findall(r"one in (\d+)", (DOCS / "howto" / "cluster.md").read_text(encoding="utf-8"))
    of_space = drawing.SPECIAL_EVERY // len(drawing.SPATIAL)

    assert [*map(int, told)] == [drawing.CHAINS_EVERY, of_space, drawing.SPECIAL_EVERY, TURNED_ROUND, SHARPNESS]
    numbers = range(4 * drawing.SPECIAL_EVERY)
    assert sum(map(drawing.is_chain, numbers)) * drawing.CHAINS_EVERY == len(numbers)


def test_equations_that_docstrings_cite_exist():
    theory = (DOCS / "theory.md").read_text(encoding="utf-8")
    numbers = re.findall(r"\(([KJCBSM]\d+)\)", theory)
    texts = [path.read_text(encoding="utf-8") for package in ("refkin", "crosscheck") for path in sources(package)]
    cited = {number for text in texts for number in re.findall(r"\(([KJCBM]\d+)\)", text)}

    assert cited >= {f"J{k}" for k in range(1, 17)}
    assert cited <= set(numbers)


def test_the_book_builds_without_a_warning_and_can_be_searched(tmp_path):
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "-d", str(tmp_path / "trees")]
    built = subprocess.run([*command, str(DOCS), str(tmp_path / "html")], capture_output=True, text=True, cwd=ROOT)
    pages = [page.relative_to(DOCS).with_suffix(".html") for page in PAGES]

    assert (built.returncode, built.stderr) == (0, "")
    assert [page for page in pages if not (tmp_path / "html" / page).is_file()] == []
    assert "baumgart" in (tmp_path / "html" / "searchindex.js").read_text(encoding="utf-8").lower()
    html = (tmp_path / "html" / "theory.html").read_text(encoding="utf-8")
    assert "<math" in html
    assert not re.findall(r'(?:src|href)="https?://[^"]*\.(?:js|css)', html)
