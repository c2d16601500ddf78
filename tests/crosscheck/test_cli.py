"""The command line as a person runs it: how it ends, and what it says; each exit code is produced for real."""

from __future__ import annotations

import gc
import json
import math
import os
import re
import shlex
import signal
import subprocess
import sys
from dataclasses import replace
from functools import partial, reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import crosscheck as crosscheck_library
import refkin
from crosscheck import __main__
from crosscheck.cli import COMMANDS, app
from crosscheck.commands import nightly as nights
from crosscheck.commands import usage
from crosscheck.commands.solve import solve
from crosscheck.commands.usage import shown_progress
from crosscheck.engines import EngineRefusal
from crosscheck.engines.loading import load
from crosscheck.errors import Terminated
from crosscheck.night.plan import SAMPLED
from refkin.scenes.files import load as load_scene
from refkin.scenes.files import to_toml
from refkin.solving.limits import expected_seconds
from tests.linkages import ROCKER
from tests.places import CORPUS, ROOT

from .fake_engines import RAISE, SEGFAULT, SHIFT, crosscheck, engine_file, key_of_drawn, records_of
from .fake_engines import command as command_line

GOOD = ROOT / "examples" / "crank-rocker.toml"
OWN = f"{ROOT / 'examples' / 'own_engine.py'}:TwoCircles"
FRAMES = ROOT / "crosscheck" / "engines" / "frames.py"
NIGHT = 31
THREADS = "OPENBLAS_NUM_THREADS"
ENGINES = "exudyn,pinocchio,mujoco"


@pytest.fixture
def nightly(command):
    """A night with a few scenes."""

    def run(out: Path, *more: Any, scenes: int | None = 3) -> Any:
        return command(*night(out, *more, scenes=scenes))

    return run


@pytest.mark.parametrize("asked", ["solve", "replay", "mobility", "program"])
def test_names_that_look_like_markup_of_a_terminal_are_shown_as_they_are(asked, command, tmp_path):
    scene = tmp_path / "scene.toml"
    text = GOOD.read_text(encoding="utf-8")
    scene.write_text(text.replace('"crank"', '"[/]:a:"').replace('"crank-rocker"', '"[/]:a:"'), encoding="utf-8")
    process = command(asked, scene)

    assert process.returncode == 0, process.stderr
    assert asked in ("mobility", "program") or "[/]:a:" in process.stdout


def night(out: Path, *more: Any, scenes: int | None = 3) -> list[Any]:
    few = [] if scenes is None else ["--scenes", scenes]
    return ["nightly", "--seed", NIGHT, "--workers", 2, "--out", out, *few, *more]


def verdict(out: Path) -> str:
    return str(json.loads((out / "report.json").read_text(encoding="utf-8"))["verdict"])


def without(folder: Path, *packages: str) -> str:
    """Return a folder for PYTHONPATH in which packages cannot be imported."""
    for package in packages:
        (folder / f"{package}.py").write_text(f"raise ImportError('no {package} here')")
    return str(folder)


def test_a_night_on_which_all_engines_agree_ends_with_0(tmp_path):
    process = crosscheck(*night(tmp_path, "--engines", ENGINES, "--require-engines", ENGINES))

    assert (process.returncode, verdict(tmp_path), process.stdout) == (0, "pass", "")
    assert {a["engine"] for r in records_of(tmp_path).values() for a in r["answers"]} == {
        "closed_form",
        *SAMPLED,
        *ENGINES.split(","),
    }


def test_a_new_disagreement_ends_with_1(tmp_path, nightly):
    spec = engine_file(tmp_path, after=SHIFT)
    process = nightly(tmp_path / "out", "--engines", spec, scenes=2)

    assert (process.returncode, verdict(tmp_path / "out")) == (1, "new disagreements")
    assert "new: fake (made up), position: beyond the allowed error, " in process.stderr


NO_FOLDER = "expected a file in a folder that exists, got /no/x"
HARD = ROOT / "tests" / "crosscheck" / "hard_engines.py"
NONSENSE = {
    "nightly": [
        ("--engines exodyn", "no engine is called 'exodyn'; there are: closed_form, exudyn, mujoco, pinocchio"),
        ("--require-engines mojoco", "no engine is called 'mojoco'; there are: closed_form, exudyn"),
        *(
            (f"--minutes {x}", f"--minutes: expected a number above 0, got {float(x)}")
            for x in ("0", "-3", "nan", "inf")
        ),
        ("--scenes 0", "--scenes: expected a number above 0, got 0"),
        ("--workers -1", "--workers: expected a number above 0, got -1"),
        ("--scene-seconds 0", "--scene-seconds: expected a number above 0, got 0.0"),
        ("--sections-seconds nan", "--sections-seconds: expected a number from 0 on, got nan"),
        (f"--out {GOOD}", f"--out: expected a folder, got the file {GOOD}"),
        ("--out ''", "--out: expected a path, got ''"),
        ("--out=", "--out: expected a path, got ''"),
        (f"--known-gaps {FRAMES}", f"{FRAMES}: no TOML: "),
        ("--known-gaps 'no such table'", "no such table: No such file or directory"),
        ("--engines closed_form --baseline b.json", "b.json: "),
        (
            "--cluster somewhere",
            "--cluster: expected 'local' or a scheduler's address like tcp://host:8786, got 'somewhere'",
        ),
    ],
    "replay": [
        ("schema.toml", "schema.toml: "),
        ("no.toml", "no.toml: "),
        ("gone.toml", "gone.toml: "),
        (f"{GOOD} --engines ' ,'", "--engines: expected names of engines, separated by commas, got ' ,'"),
    ],
    "draw": [
        (f"{GOOD} --time nan", "--time: expected a finite number [s], got nan"),
        (f"{GOOD} --out /no/x.svg", f"--out: {NO_FOLDER}.svg"),
        (f"{GOOD} --out picture.xyz", "picture.xyz: expected a file of "),
    ],
    "animate": [
        (f"{GOOD} --out picture.xyz", "picture.xyz: expected a file of "),
        (f"{GOOD} --seconds nan", "--seconds: expected a number above 0, got nan"),
    ],
    "solve": [
        (f"{GOOD} --csv /", "--csv: expected a file, got the folder /"),
        (f"{GOOD} --csv /no/x.csv", f"--csv: {NO_FOLDER}.csv"),
    ],
    "follow": [
        (f"{GOOD} --csv /no/x.csv", f"--csv: {NO_FOLDER}.csv"),
        (f"{GOOD} --until nan 1", "--until: expected two different finite values, got nan and 1.0"),
        (
            f"{GOOD} --until 80 90",
            "--until: expected two values that t = 0, where the path begins, is between, got (80.0, 90.0)",
        ),
        (f"{GOOD} --most-points -3", "--most-points: expected a number above 0, got -3"),
        (f"{GOOD} --driver wheel", "no driver is called 'wheel'; there are: "),
        (f"{GOOD} --driver ''", "no driver is called ''; there are: "),
    ],
    "history": [("--history gone.sqlite", "gone.sqlite: ")],
    "hard": [
        ("--case nothing", "no hard scene is called 'nothing'; there are: toggle; dead centre; "),
        ("--engines nobody", "no engine is called 'nobody'; there are: closed_form"),
        ("--engines ,", "--engines: expected names of engines, separated by commas, got ','"),
    ],
    "hunt": [
        ("--engines nobody", "no engine is called 'nobody'"),
        (f"--engines {HARD}:NoMethods --minutes 0.01", "a method to compare, got 'nomethods'"),
        (f"--engines {'x' * 100_000}", "'... (100000 characters); there are: closed_form"),
        ("--minutes 0", "--minutes: expected a number above 0"),
    ],
    "conform": [
        ("' '", "ENGINE: expected a name, or `file.py:Class`, got ' '"),
        ("mujoco,exudyn", "ENGINE: expected one name, or `file.py:Class`, got 'mujoco,exudyn'"),
    ],
    "program": [("schema.toml", "schema.toml: ")],
    "ledger": [("Z9", "'Z9'")],
    "bench": [("--only sweep-12", "no workload is called 'sweep-12'; there are: sweep-1000, many-10000x360")],
    "problems": [
        ("export set --only zzz", "--only: expected a part of the name of a family, got 'zzz'; there are: "),
        ("export no.toml --only guided", "--folder: expected a folder that can be written to, got"),
    ],
    "price": [
        (f"{GOOD} --again .", ". is no file"),
        (f"{GOOD} --again gone.json", "gone.json is no file"),
        ("gone.toml", "gone.toml: "),
        (f"{GOOD} --page gone/page.html", "gone/page.html"),
        (f"{GOOD} --page /proc/page.html", "--page: expected a file that can be written, got /proc/page.html"),
        (f"{GOOD} --page {'x' * 300}", "--page: expected a file that can be written, got xxx"),
    ],
    "effects": [
        (f"{GOOD} --engines nobody", "no engine is called 'nobody'; there are: closed_form, "),
        ("schema.toml", "schema.toml: "),
        ("no.toml", "no.toml: "),
    ],
    "baseline": [
        ("--engines closed_form --file b.json", "crosscheck baseline --accept makes one"),
        ("--engines nobody", "no engine is called 'nobody'; there are: closed_form, "),
    ],
}


@pytest.mark.parametrize(
    ("asked", "words", "said"),
    [(asked, *row) for asked, rows in NONSENSE.items() for row in rows],
    ids=lambda words: words[:60],
)
def test_a_request_that_makes_no_sense_is_told_in_one_line_and_ends_with_2(
    asked, words, said, command, tmp_path, monkeypatch
):
    """Before anything is computed or written."""
    files = {"schema.toml": 'schema = 1\nname = "no bodies"\n', "no.toml": "schema = "}
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    told = command(asked, *shlex.split(words))

    assert (told.returncode, told.stdout) == (2, "")
    assert told.stderr.count("\n") == 1 + (words == "schema.toml")
    assert said in told.stderr
    assert {path.name for path in tmp_path.rglob("*") if path.is_file()} == {*files}


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (("nightly", "--scenes", "2.5"), "scenes"),
        (("nightly", "--minutes", "long"), "minutes"),
        (("nightly", "--seed", "first"), "seed"),
        (("nightly", "--colour", "red"), "colour"),
        (("nightly", "--engines"), "engines"),
        (("nigthly",), "nigthly"),
        (("replay",), "scene"),
        (("follow", GOOD, "--most-points", "2.5"), "expected a whole number, got '2.5'"),
        (("history", "--last", "2.5"), "expected a whole number, got '2.5'"),
    ],
    ids=lambda value: " ".join(map(str, value)) if isinstance(value, tuple) else "",
)
def test_a_command_line_that_cannot_be_read_ends_with_2_and_names_the_key(arguments, key, command):
    process = command(*arguments)

    assert (process.returncode, key in (process.stderr + process.stdout).lower()) == (2, True)
    assert "Traceback" not in process.stderr


def test_the_folder_of_another_night_ends_with_2(tmp_path, command, nightly):
    nightly(tmp_path, "--engines", "closed_form", scenes=1)
    process = command("nightly", "--out", tmp_path, "--seed", NIGHT + 1, "--engines", "closed_form", "--scenes", 1)

    line = f"--out {tmp_path} holds a run with seed {NIGHT}, not {NIGHT + 1}: "
    assert (process.returncode, process.stderr) == (2, f"{line}choose another folder, or begin anew with --fresh\n")


def test_a_required_engine_that_is_not_installed_ends_with_3_before_anything_runs(tmp_path):
    path = without(tmp_path, "exudyn")
    process = crosscheck(*night(tmp_path / "out", "--require-engines", "exudyn"), env={"PYTHONPATH": path})

    assert (process.returncode, verdict(tmp_path / "out")) == (3, "engine missing")
    assert not (tmp_path / "out" / "records.jsonl").exists()
    assert "missing: exudyn: engine 'exudyn' cannot be imported: no exudyn here" in process.stderr


def test_a_night_has_its_folder_until_its_report_is_written(tmp_path, monkeypatch, command):
    """A second one went on with its records while the first one measured prices."""
    asked, second = ["nightly", "--out", tmp_path, "--scenes", 1, "--engines", "closed_form"], []
    monkeypatch.setattr(nights, "write_sections", lambda *_: second.append(command(*asked)))
    first = command(*asked)

    assert (first.returncode, second[0].returncode, second[0].stderr.count("\n")) == (0, 2, 1)
    assert f"another night or hunt is writing to {tmp_path}" in second[0].stderr


def test_a_required_engine_need_not_be_among_the_engines_to_be_run(tmp_path, nightly):
    process = nightly(tmp_path, "--engines", "mujoco", "--require-engines", "exudyn", scenes=1)

    assert process.returncode == 0
    assert {a["engine"] for r in records_of(tmp_path).values() for a in r["answers"]} >= {"mujoco", "exudyn"}


def test_an_engine_that_is_missing_and_not_required_is_told_and_the_others_run(tmp_path):
    path = without(tmp_path, "exudyn")
    process = crosscheck(*night(tmp_path / "out", "--engines", "exudyn,mujoco", scenes=1), env={"PYTHONPATH": path})

    assert process.returncode == 0
    assert "missing: exudyn: " in process.stderr
    assert {a["engine"] for r in records_of(tmp_path / "out").values() for a in r["answers"]} == {
        "closed_form",
        *SAMPLED,
        "mujoco",
    }


def test_a_night_that_was_carried_out_stays_as_it_is_where_a_required_engine_is_missing_now(tmp_path, nightly):
    """Its verdict, its report and its row of the history were those of a night of no scene."""
    out, spec = tmp_path / "out", engine_file(tmp_path, after=SHIFT)
    asked = (out, "--engines", spec, "--require-engines", spec)
    nightly(*asked, scenes=1)
    kept = {path: path.read_bytes() for path in (*out.rglob("*.*"), tmp_path / "history.sqlite")}
    Path(spec.rpartition(":")[0]).unlink()
    process = nightly(*asked, scenes=1)

    assert (process.returncode, process.stderr.count("\n")) == (3, 1)
    assert process.stderr.endswith(f"the night in {out} stays as it is\n")
    assert {path: path.read_bytes() for path in kept} == kept


def test_two_nights_of_one_minute_and_seed_are_both_in_the_history(tmp_path, nightly, command):
    """The second one took the place of the first, which was red."""
    nightly(tmp_path / "one", "--engines", engine_file(tmp_path, after=SHIFT), scenes=1)
    nightly(tmp_path / "two", "--engines", "closed_form", scenes=1)
    said = json.loads(command("history", "--history", tmp_path / "history.sqlite", "--json").stdout)

    assert [night["verdict"] for night in said["nights"]] == ["new disagreements", "pass"]


def test_a_night_without_engines_says_that_it_compares_nothing_but_our_own(tmp_path, nightly):
    process = nightly(tmp_path, "--engines", "", scenes=1)

    assert process.returncode == 0
    assert "note: no engine was asked: compared are our own sources alone" in process.stderr


def unheard(stream: str, *arguments: Any) -> int:
    """Return how the command line ends with a stream that nobody reads any more."""
    ends = os.pipe()
    os.close(ends[0])
    streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL} | {stream: ends[1]}
    try:
        return subprocess.run(command_line(*arguments), timeout=100, check=False, **streams).returncode
    finally:
        os.close(ends[1])


def test_a_night_whose_log_nobody_reads_goes_on_to_its_end(tmp_path):
    """It ended at its first line, with 0, and without a report."""
    asked = night(tmp_path / "out", "--engines", engine_file(tmp_path, after=SHIFT), scenes=1)

    assert unheard("stderr", *asked) == 1
    assert verdict(tmp_path / "out") == "new disagreements"


@pytest.mark.parametrize(
    "asked",
    [
        *[("replay", GOOD, "--engines", "closed_form"), ("solve", GOOD), ("solve", GOOD, "--json")],
        *[("--help",), ("solve", "--help"), ("problems",), ("--version",)],
    ],
)
def test_what_nobody_reads_is_neither_a_pass_nor_a_disagreement(asked):
    assert unheard("stdout", *asked) == 141


def test_a_night_of_which_every_engine_is_missing_ends_with_3(tmp_path):
    path = without(tmp_path, "exudyn", "mujoco")
    process = crosscheck(*night(tmp_path / "out", "--engines", "exudyn,mujoco"), env={"PYTHONPATH": path})

    assert (process.returncode, verdict(tmp_path / "out")) == (3, "engine missing")


@pytest.mark.parametrize(
    ("spec", "reason"),
    [
        ("nowhere.py:Engine", "there is no file nowhere.py"),
        (f"{FRAMES}:Engine", f"there is no 'Engine' in {FRAMES}"),
        (
            "no_such_module:Engine",
            "engine 'no_such_module:Engine' cannot be imported: No module named 'no_such_module'",
        ),
        (f"{FRAMES}:Linear", "lacks: name, api, version, routes, solve, capabilities, terms"),
        (f"{FRAMES}:np", f"engine '{FRAMES}:np': expected a class, got a module"),
        ("./frames:Engine", "engine './frames:Engine': expected a file .py or a module before the colon"),
    ],
    ids=["no file", "no class", "no module", "no engine", "a module", "no suffix"],
)
def test_an_engine_of_ones_own_that_cannot_be_loaded_is_missing_with_its_reason(tmp_path, spec, reason, nightly):
    process = nightly(tmp_path, "--engines", spec, "--require-engines", spec)

    assert (process.returncode, reason in process.stderr, "Traceback" in process.stderr) == (3, True, False)


OWN_FAULTS = {
    "price": ("raise ValueError('no licence')", "cannot be loaded: ValueError: no licence (<module>, own.py:1)"),
    "replay": ("open('data')", "cannot be loaded: FileNotFoundError: [Errno 2] No such file or directory: 'data' (<"),
    "conform": ("def x(:", "cannot be imported: invalid syntax (own.py, line 1)"),
}


@pytest.mark.parametrize("asked", OWN_FAULTS)
def test_a_fault_in_the_file_of_an_engine_is_told_with_the_engine_before_anything_is_asked(asked, tmp_path, command):
    """A price list of a minute was of all others, and said that a process had ended."""
    (own := tmp_path / "own.py").write_text(OWN_FAULTS[asked][0], encoding="utf-8")
    spec = f"{own}:Own"
    process = command(asked, *([spec] if asked == "conform" else [GOOD, "--engines", spec]))

    assert process.returncode == 3
    assert f"engine {spec!r} {OWN_FAULTS[asked][1]}" in process.stdout + process.stderr


def test_a_crash_that_does_not_happen_again_ends_with_4(tmp_path, nightly):
    once = f"Path({str(tmp_path / 'done')!r})"
    before = f'({once}.exists() or ({once}.touch(), {SEGFAULT})) if key == "{key_of_drawn(NIGHT, 1, 72)}" else None'
    spec = engine_file(tmp_path, before=before)
    process = nightly(tmp_path / "out", "--engines", spec)

    assert (process.returncode, verdict(tmp_path / "out")) == (4, "infrastructure")
    assert f"failed: {key_of_drawn(NIGHT, 1, 72)}: crash (SIGSEGV), but not when it was done again" in process.stderr


def test_a_spoilt_record_ends_with_4_and_its_scene_is_checked_anew(tmp_path, nightly):
    nightly(tmp_path, "--engines", "closed_form", scenes=2)
    records = tmp_path / "records.jsonl"
    first, second = records.read_text(encoding="utf-8").splitlines(keepends=True)
    records.write_text(first[:100] + "\n" + second, encoding="utf-8")
    process = nightly(tmp_path, "--engines", "closed_form", scenes=2)

    assert (process.returncode, verdict(tmp_path)) == (4, "infrastructure")
    assert json.loads(records.read_text(encoding="utf-8").splitlines()[-1])["key"] == json.loads(first)["key"]


def test_a_folder_that_cannot_be_made_ends_with_4_and_one_line(nightly):
    process = nightly(Path("/proc/nobody/can/write/here"), "--engines", "closed_form")

    assert (process.returncode, process.stderr.count("\n"), "/proc/nobody" in process.stderr) == (4, 1, True)


def test_a_night_without_time_for_a_scene_ends_with_5(tmp_path, nightly):
    process = nightly(
        tmp_path, "--engines", "closed_form", "--minutes", "1e-12", scenes=None
    )  # over before any worker has begun

    assert (process.returncode, verdict(tmp_path)) == (5, "nothing ran")


def test_a_disagreement_is_worse_than_a_failure_of_the_run(tmp_path, nightly):
    asked = (tmp_path / "out", "--engines", engine_file(tmp_path, after=SHIFT))
    nightly(*asked, scenes=1)
    with (tmp_path / "out" / "records.jsonl").open("a", encoding="utf-8") as records:
        records.write("rubbish\n")
    process = nightly(*asked, scenes=1)

    assert process.returncode == 1
    assert "failed: records.jsonl, line 2 is no record: " in process.stderr


def test_what_a_night_counts_is_what_its_report_counts(tmp_path, nightly):
    """Also where a record lists nothing of what its numbers say: 0 new disagreements stood beside a list of them."""
    asked = (tmp_path / "out", "--engines", engine_file(tmp_path, after=SHIFT))
    nightly(*asked, scenes=1)
    path = tmp_path / "out" / "records.jsonl"
    path.write_text(json.dumps({**json.loads(path.read_text(encoding="utf-8")), "disagreements": []}) + "\n")
    process = nightly(*asked, scenes=1)
    report = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))

    assert (process.returncode, report["new_disagreements"] > 0) == (1, True)
    assert f"1 scenes checked, {report['new_disagreements']} new and 0 known disagreements" in process.stderr


def test_a_log_shows_no_bar(tmp_path, nightly):
    process = nightly(tmp_path / "out", "--engines", "closed_form", scenes=2)

    assert process.stderr.splitlines() == [
        "measuring pictures and documents",
        "2 scenes checked, 0 new and 0 known disagreements",
        "note: no engine was asked: compared are our own sources alone",
        "pass: Every compared answer is within its derived budget, known gaps aside",
        f"report: {tmp_path / 'out' / 'index.html'}",
    ]


def test_a_log_gets_a_line_every_ten_seconds(monkeypatch, capsys):
    now = iter([0.0, 3.0, 11.0, 12.0, 20.9, 21.5])
    monkeypatch.setattr(usage, "time", type("Clock", (), {"monotonic": lambda: next(now)}))
    with shown_progress(10, None) as show:
        for checked in range(5):
            show(checked, "checking")

    assert capsys.readouterr().err.splitlines() == ["11 s, checking: 1 of 10 scenes", "22 s, checking: 4 of 10 scenes"]


REPLAYS = {
    "an engine that errs": ({"after": SHIFT}, "fake (made up), position: beyond the allowed error"),
    "an engine that raises": ({"before": RAISE}, "error (ZeroDivisionError); ZeroDivisionError: by the test"),
    "an engine that hangs": ({"before": "time.sleep(60)"}, "fake (any), status: hang; no answer within 1 s"),
}


@pytest.mark.parametrize(("does", "said"), REPLAYS.values(), ids=REPLAYS)
def test_a_scene_on_which_an_engine_fails_is_replayed_with_1(tmp_path, command, does, said):
    seconds = ("--scene-seconds", 1) if "sleep" in str(does) else ()
    process = command("replay", GOOD, "--engines", engine_file(tmp_path, **does), *seconds)

    assert (process.returncode, said in process.stdout) == (1, True)


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ((GOOD,), 0, ("exudyn", "pinocchio", "mujoco", "closed_form")),
        ((GOOD, "--engines", OWN), 0, ("two circles",)),
        ((CORPUS / "exudyn-shipped-changes-assembly.toml",), 1, ("[known since 2026-11-21: ",)),
    ],
    ids=["all agree", "an engine of one's own, without a package", "a known gap"],
)
def test_a_scene_is_replayed_with_what_it_shows(command, words, code, said):
    process = command("replay", *words)

    assert (process.returncode, process.stderr) == (code, "")
    assert all(text in process.stdout for text in said)


@pytest.mark.parametrize(("others", "code"), [("", 5), (",mujoco", 0)])
def test_a_scene_that_all_who_are_asked_refuse_is_not_replayed_with_0(command, others, code):
    """The closed form has answered it, which nobody had asked for."""
    process = command("replay", "examples/slider-crank.toml", "--engines", f"{OWN}{others}")
    said = "nothing was compared: no answer of two_circles\n" if code else ""

    assert (process.returncode, process.stderr) == (code, said)
    assert "two_circles refuses" in process.stdout


@pytest.mark.parametrize("branch", ["open", "crossed"])
def test_the_example_of_an_engine_stays_on_the_assembly_of_the_estimates(branch):
    scene = ROCKER.scene(samples=5, branch=branch)
    result, truth = load(OWN).solve(scene), refkin.solve(scene)

    assert result.q == pytest.approx(truth.q + 2 * np.pi * np.round((result.q - truth.q) / (2 * np.pi)))


def test_the_example_of_an_engine_refuses_another_driver():
    scene = ROCKER.scene(samples=5)
    driver = replace(scene.mechanism.drivers[0], body="rocker")
    with pytest.raises(EngineRefusal, match="driven at the crank"):
        load(OWN).solve(replace(scene, mechanism=replace(scene.mechanism, drivers=(driver,))))


def test_replaying_with_a_missing_engine_ends_with_3(tmp_path):
    process = crosscheck("replay", GOOD, "--engines", "exudyn", env={"PYTHONPATH": without(tmp_path, "exudyn")})

    assert (process.returncode, "engine 'exudyn' cannot be imported: no exudyn here" in process.stdout) == (3, True)


def test_what_engines_can_do_is_printed(command):
    ran = command("engines")

    assert (ran.returncode, "What engines can do" in ran.stdout, "mujoco 4" in ran.stdout) == (0, True, True)


SOLVING = """
import sys
from crosscheck.cli import COMMANDS, app, main
try:
    main(["solve", "examples/crank-rocker.toml", "--json"])
except SystemExit as end:
    assert end.code == 0
print(*sorted({name.split(".")[0] for name in sys.modules}))
"""


def test_solving_waits_for_nothing_that_it_does_not_use():
    """No engine, no drawn scenes, no report, no table: what an import costs, a small scene would pay."""
    printed = subprocess.run([sys.executable, "-c", SOLVING], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = set(printed.stdout.splitlines()[-1].split())

    assert "refkin" in loaded
    assert not loaded & {"hypothesis", "scipy", "jinja2", "exudyn", "pinocchio", "mujoco", "rich"}


@pytest.mark.parametrize("asked", sorted(COMMANDS))
def test_every_command_in_the_list_is_there(asked, command):
    told = command(*asked.split(), "--help")

    assert told.returncode == 0
    assert f"crosscheck {asked}" in told.stdout


@pytest.mark.parametrize("asked", ["draw", "animate"])
def test_a_scene_becomes_a_picture(asked, tmp_path, command):
    told = command(asked, ROOT / "examples" / "slider-crank.toml", "--out", tmp_path / "picture.svg")

    assert told.returncode == 0
    assert "offset slider-crank" in told.stdout
    assert (tmp_path / "picture.svg").read_text(encoding="utf-8").startswith("<svg")


@pytest.mark.parametrize("rates", [("--acceleration",), ("--velocity", "--acceleration")], ids=" ".join)
def test_arrows_are_drawn_of_each_rate_that_is_asked_for_alone(rates, command, tmp_path):
    process = command("draw", GOOD, *rates, "--out", tmp_path / "picture.svg")
    picture = (tmp_path / "picture.svg").read_text(encoding="utf-8")

    assert (process.returncode, process.stderr) == (0, "")
    assert [colour in picture for colour in ("#009E73", "#D55E00")] == [len(rates) == 2, True]


def test_a_refusal_is_one_line_for_all_joints_that_it_is_about(command):
    process = command("replay", GOOD, "--engines", "exudyn")
    line = "closed_form refuses revolute 'A0', revolute 'A', revolute 'B', revolute 'B0', angle 'driver' at jacobian: "

    assert process.stdout.count("closed_form refuses ") == 1
    assert line in " ".join(process.stdout.split())


def test_a_table_in_a_file_and_one_object_are_had_at_once(command, tmp_path):
    process = command("solve", GOOD, "--json", "--csv", tmp_path / "answer.csv")

    assert json.loads(process.stdout)["verdict"] == "ok"
    assert (tmp_path / "answer.csv").read_text(encoding="utf-8").startswith("t [s],status,crank.x [m],")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="/dev/full is of Linux")
@pytest.mark.parametrize("arguments", [("solve", "--csv"), ("follow", "--csv"), ("draw", "--out")])
def test_a_full_disk_is_told_with_the_file_that_was_written(arguments, command, tmp_path):
    asked, option = arguments
    full = tmp_path / "out.svg"
    full.symlink_to("/dev/full")
    process = command(asked, GOOD, option, full)

    assert process.returncode == 4
    assert process.stderr.splitlines()[-1] == f"{full}: No space left on device"


@pytest.mark.parametrize(
    "arguments", [("solve", "--csv"), ("follow", "--csv"), ("draw", "--out"), ("animate", "--out"), ("price", "--page")]
)
@pytest.mark.parametrize("linked", [False, True])
def test_a_scene_is_not_written_over_by_what_is_made_of_it(arguments, linked, command, tmp_path):
    """`solve slider.toml --csv slider.toml` left the table, and no scene; so did a link to it."""
    (scene := tmp_path / "scene.toml").write_bytes(GOOD.read_bytes())
    (link := tmp_path / "link.toml").symlink_to(scene)
    asked, option = arguments
    process = command(asked, scene, option, link if linked else scene)

    assert (process.returncode, process.stdout) == (2, "")
    assert f"{option}: expected another file than the one that is read, got {tmp_path}" in process.stderr
    assert scene.read_bytes() == GOOD.read_bytes()


def test_ctrl_c_while_commands_are_loaded_leaves_no_traceback(monkeypatch):
    class Loading:
        def __getattr__(self, name):
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "crosscheck.cli", Loading())
    with pytest.raises(SystemExit) as ended:
        __main__.main()

    assert ended.value.code == 130


def test_what_no_night_has_written_is_not_written_over(tmp_path, nightly):
    (page := tmp_path / "index.html").write_text("somebody's own", encoding="utf-8")
    process = nightly(tmp_path, "--engines", "closed_form", scenes=1)

    assert (process.returncode, process.stderr.count("\n")) == (2, 1)
    assert "holds index.html that no night has written: choose another folder" in process.stderr
    assert page.read_text(encoding="utf-8") == "somebody's own"


def test_a_program_that_asks_for_no_scene_or_for_engines_by_one_string_is_told_what_was_expected():
    with pytest.raises(TypeError, match="scene: expected a Scene, got a NoneType"):
        crosscheck_library.compare(None)
    with pytest.raises(TypeError, match="engines: expected a list or tuple or NoneType, got a str"):
        crosscheck_library.compare(load_scene(GOOD), engines="mujoco")
    with pytest.raises(TypeError, match="engines: expected a str, got a int"):
        crosscheck_library.compare(load_scene(GOOD), engines=[3])


def test_a_wide_table_stays_whole_in_a_pipe(command):
    lines = command("solve", GOOD).stdout.splitlines()
    rows = [line for line in lines if line.startswith("│")]

    assert len(rows) == 73
    assert {len(line) for line in rows} == {len(lines[0])}
    assert lines[1].count("[m]") == 6
    assert lines[1].count("[rad/s^2]") == 3


def test_times_without_a_pose_are_told_once_and_not_as_rows_of_nan(command, tmp_path):
    far = GOOD.read_text(encoding="utf-8").replace("point_i = [4.0, 0.0]", "point_i = [40.0, 0.0]")
    (tmp_path / "far.toml").write_text(far, encoding="utf-8")
    apart = command("solve", tmp_path / "far.toml")
    linkage = refkin.FourBar(ground=4.0, crank=3.0, coupler=2.0, rocker=2.5)
    scene = linkage.scene(law=refkin.Polynomial(coefficients=(0.0, 0.1)), times=[0.0, 1.0, 2.0])
    (tmp_path / "part.toml").write_text(to_toml(replace(scene, times=(0.0, 1.0, 50.0, 51.0))), encoding="utf-8")
    part = command("solve", tmp_path / "part.toml").stdout.splitlines()

    assert "nan" not in apart.stdout
    assert apart.stdout.startswith("no pose at any of 73 times: ")
    assert len([line for line in part if line.startswith("│")]) == 3
    assert any("50 ... 51" in line and "(2 times)" in line for line in part)


def test_contacts_are_printed_with_the_poses(command):
    scene = ROOT / "docs" / "scenes" / "cam.toml"
    printed = json.loads(command("solve", scene, "--json").stdout)

    assert printed["contacts"]["touch"] == {"s": refkin.solve(refkin.load(scene)).contacts["touch"].s.tolist()}


def test_every_command_that_takes_engines_takes_them_by_one_option():
    """A list of names separated by commas, or `file.py:Class`; whatever is always asked besides."""
    taken = {}
    for name in COMMANDS:
        result = reduce(lambda group, part: group[part], name.split(), app).assemble_argument_collection()
        taken[name] = {option for argument in result for option in argument.names if "engine" in option}

    assert {option for options in taken.values() for option in options} == {
        "--engines",
        "--require-engines",
        "--engine",
    }
    assert [name for name, options in taken.items() if "--engine" in options] == ["conform"]  # one, and by its place
    assert {"replay", "nightly", "hunt", "hard", "price", "effects"} <= {
        n for n, o in taken.items() if "--engines" in o
    }


def test_the_shell_can_complete_commands_and_options():
    script = app.generate_completion(prog_name="crosscheck", shell="bash")

    assert all(name in script for name in COMMANDS)
    assert "--install-completion" in script


@pytest.mark.parametrize("asked", ["price", "effects", "hard", "hunt"])
def test_long_work_shows_how_far_it_is(asked, command, tmp_path, monkeypatch):
    """A line after every call instead of one in ten seconds."""
    monkeypatch.setattr(usage, "SECONDS_BETWEEN_LINES", 0.0)
    monkeypatch.setattr("crosscheck.measure.price.WITHIN", 1.0)
    monkeypatch.setattr("crosscheck.measure.effects.WITHIN", 1.0)
    few = {
        "price": (GOOD, "--engines", "closed_form"),
        "effects": (GOOD, "--engines", "closed_form"),
        "hard": ("--engines", "closed_form", "--case", "far start"),
        "hunt": ("--engines", "closed_form", "--minutes", "0.03", "--out", tmp_path),
    }
    process = command(asked, *few[asked])
    expected = {
        "price": r"^\d+ s, refkin, .*: 0 measurements$",
        "effects": r"^\d+ s, refkin: 0 of 2 producers$",
        "hard": r"^\d+ s, far start.*: 0 of \d+ cases$",
        "hunt": r"^\d+ s, hunting, worst [\d.e+-]+: 1 scenes$",
    }

    assert re.search(expected[asked], process.stderr, re.MULTILINE), process.stderr


def test_a_sweep_of_20000_times_says_what_it_takes_before_it_is_begun(monkeypatch, tmp_path, capsys):
    short, said = refkin.solve(ROCKER.scene(samples=3)), []

    def begun(scene):
        said.append(capsys.readouterr().err)
        return short

    monkeypatch.setattr("crosscheck.commands.solve.solving.solve", begun)
    for samples in (20_000, 73):
        path = tmp_path / f"{samples}.toml"
        path.write_text(to_toml(ROCKER.scene(samples=samples)), encoding="utf-8")
        assert solve(path, as_json=True) == 0

    assert said == ["20000 times: this takes about 12 s\n", ""]


def test_two_laws_that_turn_back_1400_times_are_said_to_take_long():
    wave = refkin.Sinusoid(offset=1.0, amplitude=0.2, angular_frequency=1400.0 * math.pi)
    scene = ROCKER.scene(law=wave, times=(0.0, 1.0))
    second = replace(scene.mechanism.drivers[0], name="second")
    both = replace(scene, mechanism=replace(scene.mechanism, drivers=(*scene.mechanism.drivers, second)))

    assert expected_seconds(scene) < 1.0  # the range of one law alone is gone through once
    assert 5.0 < expected_seconds(both) < 30.0


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
def test_what_an_encoding_cannot_say_is_written_out_and_bars_are_drawn_with_what_it_has(tmp_path, encoding):
    """The command itself was said to have failed, and the answer was lost."""
    path = tmp_path / "named.toml"
    path.write_text(
        re.sub('name = ".*"', 'name = "\u2192"', GOOD.read_text(encoding="utf-8"), count=1), encoding="utf-8"
    )
    asked = [("draw", path, "--out", tmp_path / "p.svg"), ("solve", path)]
    drawn, solved = (crosscheck(*words, env={"PYTHONIOENCODING": encoding}) for words in asked)

    assert (drawn.returncode, drawn.stderr, "\\u2192" in drawn.stdout) == (0, "", True)
    assert (solved.returncode, solved.stderr, solved.stdout[:3]) == (0, "", "+--")


def test_a_terminal_of_no_size_and_a_full_disk_are_no_fault_of_the_command():
    assert crosscheck("--help", env={"COLUMNS": "0"}).returncode == 0
    if Path("/dev/full").exists():
        with open("/dev/full", "w", encoding="utf-8") as full:
            told = subprocess.run(command_line("schema"), stdout=full, stderr=subprocess.PIPE, text=True, check=False)
        assert (told.returncode, told.stderr) == (4, "No space left on device\n")


def test_limits_that_are_no_number_are_told_as_what_was_asked_wrongly(monkeypatch, command):
    monkeypatch.setenv("REFKIN_LIMIT", "much")

    assert command("solve", GOOD) == (2, "", "REFKIN_LIMIT: expected a number above 0, got 'much'\n")


@pytest.mark.skipif(os.name != "posix", reason="of a shell's >&-")
@pytest.mark.parametrize(
    ("closed", "words", "code", "left"),
    [
        ((1,), ("solve", GOOD), 0, ("", "")),
        ((1,), ("solve", "no file"), 2, ("", "no file: file: expected a readable file")),
        ((2,), ("solve", "no file"), 2, ("", "")),
        ((1, 2), ("engines",), 0, ("", "")),
    ],
)
def test_a_stream_that_the_shell_has_closed_is_not_written_to(closed, words, code, left):
    """It ended with 4 and an attribute of None; and what was said to a closed standard error came out as an answer."""
    closing = lambda: [os.close(number) for number in closed]  # noqa: E731
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "timeout": 60.0}
    process = subprocess.run(command_line(*words), **pipes, preexec_fn=closing, check=False)

    assert process.returncode == code
    assert (process.stdout, process.stderr[: len(left[1])]) == left
    assert left[1] or not process.stderr


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_command_that_a_signal_ends_says_so_in_one_line(number, code, tmp_path):
    """By SIGTERM a batch system ends what runs too long: there was no word of it in the log."""
    path = tmp_path / "long.toml"
    text = GOOD.read_text(encoding="utf-8")
    path.write_text(re.sub("count *= *[0-9]+", "count = 1000000", text), encoding="utf-8")
    asked = [sys.executable, "-m", "crosscheck", "solve", str(path)]
    heard = partial(signal.signal, number, signal.SIG_DFL)  # the suite may run where it is ignored, as under `nohup`
    pipes: dict[str, Any] = {"stderr": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(asked, **pipes, preexec_fn=heard) as process:
        assert "1000000 times: this takes about" in process.stderr.readline()
        process.send_signal(number)
        answer, said = process.communicate(timeout=60.0)

    assert (process.returncode, answer, said) == (code, "", "terminated\n")


def test_a_signal_that_the_shell_ignores_stays_ignored(monkeypatch):
    """`nohup` has it so."""
    kept: dict[int, Any] = {signal.SIGHUP: signal.SIG_IGN, signal.SIGTERM: signal.SIG_DFL}
    monkeypatch.setattr(signal, "getsignal", kept.get)
    monkeypatch.setattr(signal, "signal", kept.__setitem__)
    monkeypatch.setattr("crosscheck.cli.main", lambda: None)
    before = gc.get_threshold()
    __main__.main()
    gc.set_threshold(*before)

    assert kept[signal.SIGHUP] is signal.SIG_IGN
    with pytest.raises(Terminated):
        kept[signal.SIGTERM](signal.SIGTERM, None)
    assert kept[signal.SIGTERM] is signal.SIG_DFL  # a second one ends it wherever it is


@pytest.mark.parametrize(
    ("asked", "threads"),
    [({}, "1"), ({"OMP_NUM_THREADS": "3"}, "3"), ({"OMP_NUM_THREADS": ""}, "1"), ({THREADS: "2"}, "2")],
)
def test_a_command_calculates_on_one_thread_unless_it_is_told_otherwise(monkeypatch, asked, threads):
    """A path took five times as long on two busy processors."""
    monkeypatch.setattr(os, "environ", asked)
    monkeypatch.setattr("crosscheck.cli.main", lambda: None)
    before = gc.get_threshold()
    __main__.main()
    gc.set_threshold(*before)

    assert asked[THREADS] == threads
