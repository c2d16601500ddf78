"""One scene of the real night: the command as the nightly job runs it, with the engines that are installed."""

from __future__ import annotations

import json

from .fake_engines import crosscheck

ENGINES = ("exudyn", "pinocchio", "mujoco")


def test_a_real_night_of_one_scene_passes_with_answers_of_every_engine(tmp_path):
    out = tmp_path / "night"
    seed = ("--seed", 1, "--scenes", 1, "--workers", 1, "--sections-seconds", 0)
    told = crosscheck("nightly", *seed, "--require-engines", ",".join(ENGINES), "--out", out)
    assert told.returncode == 0, told.stdout + told.stderr

    (line,) = (out / "records.jsonl").read_text(encoding="utf-8").splitlines()
    record = json.loads(line)
    assert {answer["engine"] for answer in record["answers"]} >= set(ENGINES)
    assert (record["reference"]["verdict"], record["disagreements"]) == ("ok", [])
    assert (out / "index.html").exists()
    assert json.loads((out / "golden.json").read_text(encoding="utf-8"))["found"] == []
