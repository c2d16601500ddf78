"""Folders of strangers, names that act on a terminal or a file system, hunts that are cut short: nothing is lost."""

from __future__ import annotations

import json
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import pytest

import refkin
from crosscheck.commands import hunt as hunting_command
from crosscheck.commands.replay import replay
from crosscheck.commands.usage import Printable, printable
from crosscheck.errors import UsageError
from crosscheck.judge.records import Cause, EnclosedTimes
from crosscheck.measure.check import key_of
from crosscheck.night import hunting
from crosscheck.night.campaign import OtherRun, make_room, seed_of
from crosscheck.night.disagreements import LONGEST_NAME, slug
from crosscheck.night.golden import differences
from crosscheck.night.hunting import CERTIFICATE, MOST_STARTS, Bag, Catch, hunt, worst_of_night
from crosscheck.night.plan import engines_option
from crosscheck.scenes.drawing import MOST_OF_SPACE, SAMPLES, climb, draw, shortened
from refkin.scenes.files import parse
from tests.places import ROOT

from .report_records import answer, disagreement, good_answer, outcome, quantity, record, typed, write
from .report_records import built as report_of

SCENE = refkin.load(ROOT / "examples" / "crank-rocker.toml")
EVIL = "\x1b]0;owned\x07\x1b[2J"


def test_a_new_night_removes_what_the_finished_one_wrote_and_nothing_else(tmp_path):
    report_of(write(tmp_path, record("a", good_answer("mujoco"))), outcome())
    (tmp_path / "disagreements").mkdir()
    (tmp_path / "disagreements" / "0123456789abcdef.toml").write_text("")
    kept = [tmp_path / "thesis.txt", tmp_path / "disagreements" / "mine.toml"]
    for path in kept:
        path.write_text("years of work")
    make_room(tmp_path)

    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == sorted(kept)


def test_the_night_of_another_version_makes_room_too(tmp_path):
    report_of(write(tmp_path, record("a", good_answer("mujoco"))), outcome())
    (tmp_path / "run.json").write_text('{"seed": 31, "versions": {}}')
    (tmp_path / "outcome.json").write_text('{"possibly_closed": [{"engine": "exudyn"}]}')
    make_room(tmp_path)

    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("ended", [True, False])
def test_beside_a_report_a_run_file_cut_short_asks_for_a_fresh_night_where_that_is_possible(tmp_path, ended):
    """It said only to choose another folder, though --fresh took this one."""
    report_of(write(tmp_path, record("a", good_answer("mujoco"))), outcome())
    (tmp_path / "run.json").write_text('{"seed": 31, "ver')
    if not ended:
        (tmp_path / "outcome.json").unlink()
    with pytest.raises(OtherRun) as told:
        seed_of(tmp_path, None)

    assert str(told.value).endswith("choose another folder, or begin anew with --fresh" if ended else "another folder")
    with nullcontext() if ended else pytest.raises(OtherRun, match=r"choose another folder$"):
        make_room(tmp_path)
    assert any(tmp_path.iterdir()) is not ended


@pytest.mark.parametrize("text", ['{"sales": 3}', '{"verdict": "guilty"}', "[]", "no report at all", "3"])
def test_a_folder_with_a_report_that_no_night_wrote_is_refused_and_left_as_it_is(tmp_path, text):
    (tmp_path / "report.json").write_text(text)
    (tmp_path / "thesis.txt").write_text("years of work")

    with pytest.raises(OtherRun, match=r"holds a report.json that no night has written: choose another folder"):
        make_room(tmp_path)
    assert len(list(tmp_path.iterdir())) == 2


def test_the_makefile_removes_no_folder_of_a_night():
    text = (ROOT / "Makefile").read_text(encoding="utf-8")

    assert "rm -rf $(OUT)" not in text
    assert "crosscheck nightly --fresh" in text


@pytest.mark.parametrize("asked", ["solve", "mobility", "replay"])
def test_names_with_escape_sequences_reach_no_terminal(tmp_path, command, asked):
    text = (ROOT / "examples" / "crank-rocker.toml").read_text(encoding="utf-8")
    name = EVIL.replace("\x1b", "\\u001b").replace("\x07", "\\u0007")
    scene = tmp_path / "scene.toml"
    scene.write_text(text.replace('"crank"', f'"{name}"').replace('"crank-rocker"', f'"{name}"'), encoding="utf-8")
    told = command(asked, scene, *(("--engines", "closed_form") if asked == "replay" else ()))

    assert not {"\x1b", "\x07"} & {*told.stdout, *told.stderr}


def test_what_is_printed_keeps_lines_and_letters():
    assert printable("a\tb\nä ü\u202e") == "a\tb\nä ü\\u202e"


class Terminal:
    """A stream that says it is a terminal."""

    def __init__(self) -> None:
        self.text = ""

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> None:
        self.text += text


def test_a_terminal_gets_colours_and_nothing_that_moves_its_cursor():
    stream = Terminal()
    Printable(stream).write(f"\x1b[31mred\x1b[0m {EVIL}")  # type: ignore[arg-type]

    assert stream.text == "\x1b[31mred\x1b[0m \\x1b]0;owned\\x07\\x1b[2J"


def test_an_exception_of_our_own_ends_with_4_and_one_line(monkeypatch, command):
    monkeypatch.setattr("crosscheck.commands.solve.load", lambda path: 1 / 0)
    code, _, value = command("solve", "scene.toml")

    assert (code, value.count("\n"), "Traceback" in value) == (4, 1, False)
    assert value.startswith("crosscheck itself failed: ZeroDivisionError: division by zero (")


def test_a_long_name_makes_a_name_of_bounded_length_that_no_other_has():
    one, other = slug("e" * 5000, "a"), slug("e" * 5000, "b")

    assert max(len(one), len(other)) <= LONGEST_NAME
    assert one != other
    assert slug("../../x", "Newton") == "x-newton"


def test_a_case_of_a_baseline_names_no_file_outside_of_the_folder():
    fields = {"status": ["ok"], "certified_radius": {}}
    case = {"scene": {}, "reference": fields, "methods": {}}
    now = {**case, "reference": {**fields, "status": ["singular"]}}
    (worse,) = differences({"../../x": case}, {"../../x": now}, ())

    assert worse.key == "golden-x"


def test_a_line_to_replay_names_the_engines_that_are_not_asked_anyway():
    assert engines_option(("closed_form", "exudyn", "mujoco")) == ""
    assert engines_option(("closed_form", "exudyn", "my own.py:A")) == " --engines 'exudyn,my own.py:A'"


class Pool:
    """Workers that answer every scene the same way, or fail at the first one; `jobs` are what they were asked."""

    def __init__(self, fails: bool = False, ratio: float = 0.5, radii: float = 0.1, *wrong: Any) -> None:
        self.fails, self.ratio, self.radii, self.wrong = fails, ratio, radii, wrong
        self.jobs, self.unexplained = list[Any](), ()

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def check_one(self, job: Any) -> Any:
        self.jobs.append(job)
        if self.fails and len(self.jobs) == 1:
            raise RuntimeError("planted")
        places = EnclosedTimes(inside=1, outside=0, undecidable=0, no_answer=0, radii=self.radii)
        position = {"position": quantity({-1: [15.0]}, self.ratio)}
        met = typed(record("a", answer("mujoco", position), disagreements=list(self.wrong)))
        return replace(met, answers=[replace(met.answers[0], certificate=places)])


@pytest.fixture
def hunted(monkeypatch):
    """A hunt of some seconds with workers that are none."""

    def run(pool: Pool, seconds: float = 3.0, **more: Any) -> Bag:
        monkeypatch.setattr(hunting, "hunted", lambda engines: {"mujoco": "newton"})
        monkeypatch.setattr(hunting, "checkers", lambda *_: pool)
        return hunt({"mujoco": "mujoco"}, seconds, 1, scene_seconds=1.0, **more)

    return run


def test_a_hunt_that_is_out_of_time_in_the_middle_of_a_turn_keeps_its_catches_and_fails_in_nothing(hunted):
    bag = hunted(Pool())

    assert bag.scenes > 0
    assert ({name for _, _, name in bag.catches}, bag.failures) == ({"position", "certificate"}, [])


def test_a_turn_that_breaks_off_is_told_and_costs_no_other(hunted):
    bag = hunted(Pool(fails=True))

    assert bag.scenes > 0
    assert len(bag.failures) == 1
    assert "planted" in bag.failures[0]


def test_a_hunt_starts_from_the_worst_scenes_of_a_night(tmp_path, hunted):
    met = [
        {**record(str(k), answer("mujoco", {"position": quantity({-1: [9.0]}, ratio)})), "about": {"shard": k}}
        for k, ratio in enumerate((0.1, 0.9, 0.5))
    ]
    starts = [*worst_of_night(write(tmp_path, *met), {"mujoco": "newton"}, 5)[0]]
    bag = hunted(Pool(), seconds=2.0, starts=starts)

    assert starts == [(5, 1), (5, 2), (5, 0)]
    assert {catch.origin for catch in bag.catches.values()} == {"scene 1 of night 5"}


def test_the_scenes_of_a_night_come_first_at_its_times_whatever_time_there_is(hunted):
    """Drawn anew at fewer times a scene had less than the night had seen in it, and time ended before the last ones.

    A part of a scene begins elsewhere: it may be worse than the whole.
    """
    pool, starts = Pool(), [(5, 1), (5, 9), (5, 6)]
    bag = hunted(pool, seconds=0.0, starts=starts)
    asked = [parse(job["scene"]) for job in pool.jobs]

    assert asked == [
        scene for one in map(draw, *zip(*starts, strict=True)) for scene in (one.scene, shortened(one)) if scene
    ]
    assert [len(scene.times) for scene in asked] == [SAMPLES, SAMPLES // 4, MOST_OF_SPACE, SAMPLES, SAMPLES // 4]
    assert (bag.scenes, bag.failures) == (len(asked), [])


def test_the_worst_of_every_target_of_a_night_is_among_the_scenes_to_start_from(tmp_path):
    """Of more targets than `MOST_STARTS`, too: own engines add some."""
    count = MOST_STARTS + 3
    met = [
        {**record(str(k), answer("mujoco", {f"quantity {k}": quantity({}, 1.0 / (1 + k))})), "about": {"shard": k}}
        for k in range(count)
    ]

    assert [*worst_of_night(write(tmp_path, *met), {"mujoco": "newton"}, 5)[0]] == [(5, k) for k in range(count)]


def test_a_scene_that_another_version_drew_under_its_number_is_left_out_and_that_is_said(tmp_path, hunt_of):
    """It would be taken for the night's, and has nothing to do with it."""
    keys = [*(key_of(draw(42, k).scene) for k in range(2)), "0" * 16]
    position = answer("mujoco", {"position": quantity({}, 0.5)})
    met = [{**record("", position), "about": {"shard": k}, "key": key} for k, key in enumerate(keys)]
    night, pool = write(tmp_path / "night", *met), Pool()
    with (night / "records.jsonl").open("a", encoding="utf-8") as lines:
        lines.write("{}\n")
    code, said = hunt_of(pool, night=night)

    assert (code, [key_of(parse(job["scene"])) for job in pool.jobs[:4:2]]) == (0, keys[1::-1])
    assert "scene 2 of night" not in said
    assert (
        f"starting from 2 scenes of {night}; left out are 1 that this version draws otherwise and 1 whose records"
        in said
    )


@pytest.fixture
def hunt_of(tmp_path, monkeypatch, capsys):
    """The command with workers that are none: its exit code and what it prints; scenes go to `tmp_path`."""

    def run(pool: Pool, **more: Any) -> tuple[int, str]:
        monkeypatch.chdir(tmp_path)
        for module in (hunting, hunting_command):
            monkeypatch.setattr(module, "hunted", lambda engines: {"mujoco": "newton"})
        monkeypatch.setattr(hunting, "checkers", lambda *_: pool)
        more = {"minutes": 0.02, "seed": 1, "out": tmp_path, "engines": "mujoco", **more}
        code, told = hunting_command.hunt_worst(**more), capsys.readouterr()
        return code, told.out + told.err

    return run


def test_a_distance_from_the_certificate_is_no_error_and_nobody_is_blamed_for_it(tmp_path, hunt_of):
    """18.5 least errors were called 18.5 times the allowed error, and were a disagreement that no replay showed."""
    code, said = hunt_of(Pool(False, 0.03, 18.5))
    files = {path.name: path.read_text(encoding="utf-8") for path in tmp_path.glob("*.toml")}

    assert code == 0
    assert [line.replace("│", " ").split()[:5] for line in said.splitlines() if " newton " in line] == [
        ["mujoco", "newton", "position", "0.03", "-"],
        ["mujoco", "newton", "certificate", "-", "18.5"],
    ]
    assert "to blame" not in said
    assert "# mujoco newton certificate: 18.5 least errors (radii) from" in files["mujoco-newton-certificate.toml"]
    assert "# mujoco newton position: 0.03 times the allowed error" in files["mujoco-newton-position.toml"]
    assert len(files) == 2


def test_a_hunt_leaves_what_an_earlier_one_has_caught(tmp_path, hunt_of):
    """A short one replaced a scene of 0.244 by one of 0.0992, without a word."""
    for ratio in (0.3, 0.2, 0.1):
        hunt_of(Pool(False, ratio))
    names = ("mujoco-newton-position", "mujoco-newton-position-2", "mujoco-newton-position-3")

    for name, ratio in zip(names, (0.3, 0.2, 0.1), strict=True):
        assert f"position: {ratio} times" in (tmp_path / f"{name}.toml").read_text(encoding="utf-8")


def test_how_far_a_hunt_is_it_says_in_errors_alone():
    catches = {("e", "m", name): Catch(ratio, SCENE, "", 1) for name, ratio in (("position", 0.5), (CERTIFICATE, 18.5))}

    assert (Bag(catches).worst, Bag().worst) == (0.5, 0.0)


@pytest.mark.parametrize(
    ("who", "code"),
    [
        ({}, 1),
        ({"quantity": "status", "kind": Cause.NO_ANSWER, "ratio": None, "at": None}, 1),
        ({"method": "any", "quantity": "status", "kind": Cause.CHANGED}, 1),
        ({"method": "rows", "quantity": "residual", "kind": Cause.TRANSLATED}, 1),
        ({"method": "any", "quantity": "status", "kind": Cause.CRASH}, 4),
        ({"method": "sparse Newton"}, 0),
        ({"engine": "refkin", "method": "newton", "quantity": "status", "kind": Cause.REFERENCE}, 0),
    ],
)
def test_a_hunt_blames_whom_it_hunts_for_what_the_judge_says(tmp_path, hunt_of, who, code):
    """And a method that it does not hunt is named as that: replay blames it, too."""
    wrong = {**disagreement(method="newton"), **who}
    actual, said = hunt_of(Pool(False, 3.5, 0.1, wrong))
    met = typed(record("a", disagreements=[wrong])).disagreements[0]
    written = [path.name for path in tmp_path.glob("*.toml") if f"# {met}" in path.read_text(encoding="utf-8")]

    assert actual == code
    assert (f"to blame: {met}" in said.replace("\n", " ")) == (code == 1)
    assert written == [f"{slug(*met.signature)}.toml"] * (code == 1)
    assert (
        f"not hunted, though replay blames it: {met.engine} ({met.method}), {met.quantity}: {met.name}, in " in said
    ) == (code == 0)


def test_a_hunt_asks_as_replay_does(tmp_path, hunt_of, monkeypatch):
    """Of the same scene they say the same then: what else is known of a drawn one would change who is blamed."""
    pool, replayed = Pool(), Pool()
    hunt_of(pool)
    monkeypatch.setattr("crosscheck.commands.replay.checkers", lambda *_: replayed)
    replay(tmp_path / "mujoco-newton-position.toml", engines="mujoco")

    assert replayed.jobs == pool.jobs[:1]


def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_hunted_for(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(hunting_command, "hunt", lambda *_, **__: pytest.fail("hunted"))

    with pytest.raises(UsageError, match="--out: expected a folder that can be written to"):
        hunting_command.hunt_worst(out=tmp_path / "file", engines="closed_form")


def test_climbing_begins_at_the_scene_that_was_drawn():
    seen: list[Any] = []
    climb(5, 3, lambda drawn: seen.append(drawn.scene), 4, 6)

    assert seen[0] == draw(5, 3, 6).scene
    assert len(set(seen)) > 1


def test_every_command_of_the_line_has_a_reason_for_a_bad_end(tmp_path, command):
    (tmp_path / "records.jsonl").write_text(json.dumps({"key": "../x"}) + "\n")
    code, _, value = command("nightly", "--scenes", 1, "--engines", "closed_form", "--out", tmp_path)

    assert code == 2
    assert "records.jsonl, line 1: key: '../x'; string should match pattern" in value
