"""`crosscheck hard` and `crosscheck hunt` on the command line, and the rows of hard cases in a night's report."""

from __future__ import annotations

import json
import math
import shlex
from pathlib import Path
from types import SimpleNamespace as Plain

import pytest

import refkin
from crosscheck.judge.records import Cause, Disagreement
from crosscheck.measure.hard_table import hard_case_rows, spread
from crosscheck.night import hunting
from crosscheck.night.hunting import CERTIFICATE, STRATA, Bag, hunt, ratios, turn_of
from crosscheck.night.plan import write_scene
from crosscheck.report.measured import measured
from crosscheck.scenes.drawing import draw, expected_of
from tests.places import EXAMPLES

from .fake_engines import engine_file

ENGINES = Path(__file__).parent / "hard_engines.py"
SCENE = refkin.load(EXAMPLES / "crank-rocker.toml")


def test_rows_are_printed_as_json(command):
    code, out, _ = command("hard", "--engines", f"{ENGINES}:Right", "--case", "large offset", "--json")
    (schema, rows) = json.loads(out).values()

    assert (code, schema) == (0, 1)
    keys = ("engine", "method", "setting", "case", "distance", "of", "verdict", "class", "quote", "note")
    assert [tuple(row) for row in rows] == [keys] * 8
    assert {row["engine"] for row in rows} == {"refkin", "right"}
    assert {row["verdict"] for row in rows} == {"correct"}


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("hard", "--engines", f"{ENGINES}:Wrong", "--case", "large offset"), 1, "no finding explains this"),
        (("hard", "--engines", f"{ENGINES}:Refuses", "--case", "far start"), 0, "all: refused"),
        (("hard", "--engines", "nowhere.py:Engine"), 3, "there is no file nowhere.py"),
        (("replay", "examples/crank-rocker.toml", "--engines", "nowhere.py:X"), 3, "there is no file nowhere.py"),
    ],
)
def test_a_wrong_answer_a_refusal_and_an_engine_that_is_not_there_have_their_codes(words, code, said, command):
    told = command(*words)

    assert told.returncode == code
    assert said in (told.stdout if code < 2 else told.stderr)
    assert told.stdout == "" or code < 2


@pytest.mark.parametrize("wrong", [("--engines", "nowhere.py:X"), ("--night", "nowhere")])
def test_a_hunt_that_is_refused_makes_no_folder(wrong, tmp_path, command):
    told = command("hunt", *wrong, "--out", tmp_path / "hunt")

    assert told.returncode in (2, 3)
    assert not (tmp_path / "hunt").exists()


def test_the_rows_of_a_night_are_read_by_the_report(tmp_path):
    rows = hard_case_rows(["refkin"], 2.0)
    (tmp_path / "hard_cases.json").write_text(json.dumps(rows, allow_nan=False), encoding="utf-8")
    result, faults = measured(tmp_path)

    assert faults == []
    assert [row["method"] for row in result["hard_cases"]] == ["solve"] * len(rows)


SLOW = """
from hard_engines import *


class Slow(Right):
    def change(self, motion):
        time.sleep(0.4)
        return motion
"""


def test_where_time_is_up_all_engines_have_been_asked_the_same_cases(tmp_path):
    """Planted: of an engine that answers slowly, a share of the time left fewer cases than of the others."""
    slow = tmp_path / "slow_engine.py"
    slow.write_text(f"import sys\n\nsys.path.insert(0, {str(ENGINES.parent)!r})\n{SLOW}", encoding="utf-8")
    rows = hard_case_rows([f"{ENGINES}:Right", f"{slow}:Slow"], within=6.0)
    asked = [{(r["case"], r["distance"]) for r in rows if r["engine"] == name} for name in ("right", "slow")]

    assert asked[0] == asked[1]
    assert 0 < len(asked[0]) < rows[0]["of"]


def test_rows_in_the_time_there_is_are_of_every_kind_first():
    rows = hard_case_rows(["refkin"], within=3.0)
    counts = {case: sum(row["case"] == case for row in rows) for case in {row["case"] for row in rows}}

    assert max(counts.values()) - min(counts.values()) <= 6


@pytest.mark.parametrize(
    ("count", "order"), [(0, []), (1, [0]), (2, [1, 0]), (3, [2, 0, 1]), (5, [4, 0, 2, 1, 3]), (6, [5, 0, 2, 3, 1, 4])]
)
def test_of_a_kind_the_nearest_and_the_farthest_are_asked_before_what_lies_between(count, order):
    """The nearest came last: what a short night left out were the hardest cases of all."""
    assert spread(count) == order


def test_a_hunt_finds_a_planted_error_and_in_which_scene(monkeypatch):
    monkeypatch.setattr("crosscheck.night.hunting.STRATA", ((1.0, 3.0),))
    bag = hunt({"wrong": f"{ENGINES}:Wrong"}, 6.0, 1, scene_seconds=20.0)

    assert bag.scenes > 3
    assert bag.failures == []
    assert ("wrong", "planted", "position", "beyond the allowed error") in bag.blames
    assert all(math.isfinite(catch.ratio) for catch in bag.catches.values())


def test_replay_of_what_a_hunt_has_written_blames_the_same(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)  # where there is no night
    wrong = ("--engines", f"{ENGINES}:Wrong")
    hunted, said, _ = command("hunt", *wrong, "--minutes", "0.05", "--seed", "1", "--out", tmp_path / "hunt")
    (file,) = (tmp_path / "hunt").glob("wrong-planted-position-beyond-*.toml")
    replayed, again, _ = command("replay", file, *wrong)
    blamed = file.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")

    assert (hunted, replayed) == (1, 1)
    assert blamed.startswith("wrong (planted), position: beyond the allowed error")
    assert " ".join(blamed.split()) in " ".join(again.split())
    assert f"to blame: {blamed.partition(';')[0]}" in " ".join(said.split())


@pytest.mark.parametrize(("engine", "minutes"), [("refusing", "0.1"), ("right", "1e-9")])
def test_a_hunt_in_which_nobody_asked_for_has_answered_does_not_pass(engine, minutes, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    before = {"refusing": "from crosscheck.engines import EngineRefusal; raise EngineRefusal"}.get(engine, "pass")
    spec = engine_file(tmp_path, name=engine, before=before)
    code, _, said = command("hunt", "--engines", spec, "--minutes", minutes, "--out", tmp_path / "hunt")

    assert code == 5
    assert f"nothing was compared: no answer of {engine}" in said


def test_a_scene_that_was_made_to_end_is_replayed_as_such(tmp_path, monkeypatch, command):
    """The reference was blamed for its end, and the engine that sees none was not; what that said made no TOML."""
    monkeypatch.chdir(tmp_path)
    believer = engine_file(tmp_path, after="motion = replace(motion, status=(Status.OK,) * len(motion.t))")
    scenes = (draw(3, number, 4) for number in range(400))
    drawn = next(one for one in scenes if expected_of(one) is refkin.Status.UNASSEMBLABLE)
    said = "two\nlines, \r\x1b[31m"
    write_scene(tmp_path / "end.toml", [said], drawn.scene, (believer,), expected=expected_of(drawn))
    again = (tmp_path / "end.toml").read_text(encoding="utf-8").splitlines()[2]
    code, said, _ = command(*shlex.split(again.partition(": crosscheck ")[2]))

    assert code == 1
    assert "fake (made up), position: ok where there is no assembly" in " ".join(said.split())
    assert "refkin (newton)" not in said


@pytest.mark.parametrize("stratum", STRATA)
def test_every_stratum_has_scenes_in_its_decades(stratum):
    distances = []

    def look(drawn):
        distances.append(drawn.distance)
        if len(distances) >= 8:
            raise Enough

    with pytest.raises(Enough):
        turn_of(look, stratum, 1)

    # A limit is approached by 10^-k rad or lengths; what the margin is there depends on the linkage.
    assert min(distances) < 10.0 ** (1.5 - stratum[0])


class Enough(Exception):
    pass


def test_of_each_kind_of_disagreement_the_worst_is_kept():
    bag, who = Bag(), {"engine": "e", "method": "m", "quantity": "position", "kind": Cause.BEYOND}
    for ratio in (2.0, 9.0, 3.0):
        record = Plain(failure=None, about={}, answers=(), disagreements=[Disagreement(**who, ratio=ratio)])
        bag.add({"e": "m"}, record, SCENE, "")

    assert [(blame.ratio, blame.number) for blame in bag.blames.values()] == [(9.0, 2)]


def test_only_best_methods_are_hunted():
    quantities = {"position": Plain(ratio=3.0), "velocity": Plain(ratio=None)}
    answers = [
        Plain(engine="e", method=Plain(name=name), quantities=quantities, certificate=Plain(radii=2.0))
        for name in ("best", "shipped")
    ]

    result = dict(ratios(Plain(answers=answers), {"e": "best"}))

    assert result == {("e", "best", "position"): 3.0, ("e", "best", CERTIFICATE): 2.0}


def test_hypothesis_is_told_how_bad_a_scene_is_and_what_is_worse_than_before_is_kept(monkeypatch):
    told, bag, now = [], Bag(), {("a", "m", "position"): 0.02, ("a", "m", "velocity"): 0.0}
    monkeypatch.setattr(hunting, "target", lambda value, label: told.append((label, value)))
    monkeypatch.setattr(hunting, "ratios", lambda record, best: now.items())
    pool = Plain(check_one=lambda job: Plain(failure=None, disagreements=(), about={}))
    monkeypatch.setattr(hunting, "by_itself", lambda scene, expected: {})
    hunter = hunting._Hunter(pool, {}, bag, math.inf, lambda bag: None)
    for scene in ("first", "second", "third"):
        hunter.near("")(Plain(scene=scene))
        now["a", "m", "position"] = {"first": 0.5, "second": 0.1}.get(scene)

    assert told[:2] == [("a m position", pytest.approx(math.log10(0.02))), ("a m velocity", -30.0)]
    assert [(name[2], catch.ratio, catch.scene, catch.number) for name, catch in bag.catches.items()] == [
        ("position", 0.5, "second", 2),
        ("velocity", 0.0, "first", 1),
    ]
