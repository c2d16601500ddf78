"""One scene of the real night: the command as the nightly job runs it, with the engines that are installed."""

from __future__ import annotations

import json

import pytest

from crosscheck.night import sections
from crosscheck.night.sections import write_sections

from .fake_engines import crosscheck

ENGINES = ("exudyn", "pinocchio", "mujoco")


def test_a_real_night_of_one_scene_passes_with_answers_of_every_engine(tmp_path):
    out = tmp_path / "night"
    seed = ("--seed", 1, "--scenes", 1, "--workers", 1, "--sections-seconds", 0)
    process = crosscheck("nightly", *seed, "--require-engines", ",".join(ENGINES), "--out", out)
    assert process.returncode == 0, process.stdout + process.stderr

    (line,) = (out / "records.jsonl").read_text(encoding="utf-8").splitlines()
    record = json.loads(line)
    assert {answer["engine"] for answer in record["answers"]} >= set(ENGINES)
    assert (record["reference"]["verdict"], record["disagreements"]) == ("ok", [])
    assert (out / "index.html").exists()
    assert json.loads((out / "golden.json").read_text(encoding="utf-8"))["worse"] == []


@pytest.mark.parametrize("seconds", [0.0, 1e-9, 7.9, float("nan")])
def test_without_time_for_them_nothing_is_measured_beside_the_scenes(tmp_path, seconds):
    rows = []
    write_sections(tmp_path, {name: name for name in ENGINES}, (), seconds, rows.append)

    assert (rows, list(tmp_path.iterdir())) == ([], [])


def test_what_is_measured_beside_the_scenes_asks_engines_of_ones_own_too(tmp_path, monkeypatch):
    """By what loads them, which for those that nobody registered is `file.py:Class`."""
    asked = {}
    monkeypatch.setattr(sections, "hard_case_rows", lambda engines, seconds: asked.update(hard=engines) or [])
    monkeypatch.setattr(sections, "price_list", lambda seconds, producers: asked.update(price=producers) or [])
    monkeypatch.setattr(sections, "effects_ledger", lambda scene, engines, seconds: asked.update(effects=engines) or [])
    engines = {"mine": "own.py:Mine", "mujoco": "mujoco", "closed_form": "closed_form"}
    write_sections(tmp_path, engines, {"closed_form"}, 60.0)

    assert asked["hard"] == ["refkin", "own.py:Mine", "mujoco"]
    assert asked["price"][-2:] == ("own.py:Mine", "mujoco")
    assert asked["effects"] == ["own.py:Mine", "mujoco"]
