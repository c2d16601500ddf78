"""A night: kills lose and double-count nothing, bounds are kept, disagreements come with scenes that show them."""

from __future__ import annotations

import json
import math
import os
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import refkin
from crosscheck.judge.records import At, Cause, Disagreement, NewCase, Record, line_of, read_records
from crosscheck.measure import jobs
from crosscheck.measure.check import key_of
from crosscheck.night import campaign, disagreements, sections
from crosscheck.night.campaign import ROUND, OtherRun, Turns, run, seed_of
from crosscheck.night.disagreements import write_disagreements
from crosscheck.night.hunting import drawn_again
from crosscheck.night.plan import SAMPLED, Journal, NightPlan
from crosscheck.night.sections import job_of, write_sections
from crosscheck.scenes.drawing import (
    CHAINS_EVERY,
    COSTS,
    WARM_UP,
    WELL_KNOWN,
    describe,
    draw,
    effort,
    in_part,
    is_chain,
    numbers_of,
    turn_of,
)
from crosscheck.scenes.names import FEATURES, pairs_of
from crosscheck.strategies.chain_kinds import KINDS as CHAIN_KINDS
from crosscheck.strategies.space_kinds import KINDS as SPACE_KINDS
from crosscheck.workers import source
from crosscheck.workers.pool import find_engines
from refkin.scenes.files import load, parse

from .fake_engines import EXIT, HANG, SHIFT, alive, crosscheck, engine_file, records_of, start
from .report_records import record, typed

NIGHT = 21
SHRINKING = 60.0
"""How long simplifying may take: some fifty scenes are enough, and a busy machine checks no more than two a second."""
SLOW = "Path({folder!r}, str(os.getpid())).touch(); time.sleep(0.1)"


def plan(out: Path, *specs: str, **more: Any) -> NightPlan:
    fields = {"seed": NIGHT, "out": out, "engines": ("closed_form", *SAMPLED, *specs), "workers": 2, "scenes": 12}
    return NightPlan(**{**fields, **more})


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """An engine that takes its time and notes the processes it runs in: what loads it, and the folder of the notes."""
    folder = tmp_path_factory.mktemp("slow")
    pids = folder / "pids"
    pids.mkdir()
    return engine_file(folder, before=SLOW.format(folder=str(pids))), pids


@pytest.fixture(scope="module")
def undisturbed(slow, tmp_path_factory):
    out = tmp_path_factory.mktemp("undisturbed")
    run(plan(out, slow[0]))
    return records_of(out)


def arguments(spec: str, out: Path, scenes: int = 12) -> list[Any]:
    night = ["nightly", "--scenes", scenes, "--seed", NIGHT, "--workers", 2]
    return [*night, "--engines", spec, "--out", out]


def wait_until(done: Callable[[], bool], seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end
        time.sleep(0.01)


def wait_for_records(out: Path, count: int) -> None:
    path = out / "records.jsonl"
    wait_until(lambda: path.exists() and path.read_bytes().count(b"\n") >= count)


def pids_in(folder: Path) -> list[int]:
    return [int(path.name) for path in folder.iterdir()]


def forgotten(folder: Path) -> None:
    for path in folder.iterdir():
        path.unlink()


def test_records_are_the_same_whatever_the_number_of_workers(slow, undisturbed, tmp_path):
    run(plan(tmp_path, slow[0], workers=1))

    assert records_of(tmp_path) == undisturbed


def test_a_killed_run_is_resumed_with_nothing_lost_or_counted_twice(slow, undisturbed, tmp_path):
    spec, pids = slow
    forgotten(pids)
    with start(*arguments(spec, tmp_path)) as first:
        wait_for_records(tmp_path, 4)
        first.send_signal(signal.SIGKILL)
    done = len(records_of(tmp_path))
    second = crosscheck(*arguments(spec, tmp_path))

    assert 4 <= done < 12
    assert (second.returncode, records_of(tmp_path)) == (0, undisturbed)


@pytest.mark.parametrize("signalled", [signal.SIGKILL, signal.SIGHUP])
def test_no_worker_outlives_a_killed_run_though_it_hangs_where_no_python_runs(tmp_path, signalled):
    pids = tmp_path / "pids"
    pids.mkdir()
    spec = engine_file(tmp_path, before=f"Path({str(pids)!r}, str(os.getpid())).touch(); {HANG}")
    with start(*arguments(spec, tmp_path / "night")) as night:
        wait_until(lambda: len(pids_in(pids)) >= 2)
        os.killpg(night.pid, signalled)  # as a terminal that is closed, or a batch system, does
    wait_until(lambda: not alive(pids_in(pids)), seconds=10.0)


@pytest.mark.parametrize(
    ("signalled", "code", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_an_interrupted_run_says_so_in_one_line_keeps_its_records_and_leaves_no_worker(
    signalled, code, word, slow, undisturbed, tmp_path
):
    spec, pids = slow
    forgotten(pids)
    with start(*arguments(spec, tmp_path)) as night:
        wait_for_records(tmp_path, 3)
        os.killpg(night.pid, signalled)  # as a terminal does: to all of the group
        _, result = night.communicate(timeout=30)
    kept = records_of(tmp_path)
    resumed = crosscheck(*arguments(spec, tmp_path))

    assert night.returncode == code
    line = f"{word}; what was checked is kept in {tmp_path}, and the same command goes on from there\n"
    last = result.splitlines(keepends=True)[-1]  # a slow machine has said how far it is before
    assert (last, alive(pids_in(pids))) == (line, [])
    assert 3 <= len(kept) < 12
    assert (resumed.returncode, records_of(tmp_path)) == (0, undisturbed)


@pytest.mark.parametrize("order", [(3, 8), (8, 3)])
def test_of_equal_scenes_that_with_the_least_number_counts_whichever_worker_was_faster(order, tmp_path):
    path = tmp_path / "records.jsonl"
    with Journal(path) as journal:
        for number in order:
            journal.append(replace(typed(record("a")), about={"shard": number}))
    with Journal(path) as journal:
        assert [met.about["shard"] for met in journal] == [3]
        assert not journal.append(replace(typed(record("a")), about={"shard": 5}))
        assert journal.append(replace(typed(record("a")), about={"shard": 1}))

    assert [met.about["shard"] for _, met in read_records(path)] == [1]


def test_of_two_scenes_that_with_more_pairs_of_features_not_met_yet_is_checked(monkeypatch):
    """And of a slider-crank and an RSSR that is new in as much, the one that takes less time."""
    drawn = {0: ("angle", "table"), 7: ("y", "polynomial"), 14: ("x", "sine")}
    kept = {"joints": "revolute", "class": "double-rocker", "hardness": "ordinary", "distance": 0.02}
    monkeypatch.setattr(jobs, "draw", lambda night, number: SimpleNamespace(scene=SimpleNamespace(number=number)))
    told = lambda one: dict(zip(("driver", "law"), drawn[one.scene.number], strict=True))  # noqa: E731
    kinds = {number: "RSSR" if number == 14 else "slider-crank" for number in drawn}
    monkeypatch.setattr(jobs, "describe", lambda one: {**kept, **told(one), "kind": kinds[one.scene.number]})

    def chosen(seen, *numbers):
        scene, about = jobs.scene_of({"night": 1, "shards": numbers, "seen": seen})
        return scene.number, about

    number, about = chosen({}, 0, 7)
    seen = dict.fromkeys(pairs_of(about), 5)

    assert number == 0
    assert "driver angle & law table" in seen
    assert chosen(seen, 0, 7)[0] == 7
    assert chosen({}, 14, 7)[0] == 7
    assert chosen(dict.fromkeys(pairs_of(chosen({}, 7)[1]), 5), 14, 7)[0] == 14


def test_kinds_that_take_longer_are_kinds_that_are_drawn():
    assert {*COSTS} <= {*SPACE_KINDS, *CHAIN_KINDS, "five-bar with two drivers", "branching tree"}


def test_a_scene_of_which_nothing_is_new_is_checked_at_a_quarter_of_its_times_and_drawn_so_again():
    """And one that is for features of engines never."""
    told = {k: describe(draw(3, k)) for k in range(40)}
    plain = next(k for k in told if told[k]["hardness"] == "regular")
    near = next(k for k in told if told[k]["of_features"])
    seen = dict.fromkeys([pair for about in told.values() for pair in pairs_of(about)], WELL_KNOWN)
    asked = {k: {"night": 3, "shards": (k,), "seen": seen} for k in (plain, near)}
    scene, about = jobs.scene_of(asked[plain])
    once, _ = jobs.scene_of({**asked[plain], "seen": {**seen, pairs_of(told[plain])[0]: WELL_KNOWN - 1}})

    assert {*scene.times} < {*once.times}
    assert 4 * len(scene.times) == len(once.times) == 72
    assert about == {**told[plain], "shard": plain, "well_known": True, "shortened": True}
    assert jobs.scene_of(asked[near])[0] == draw(3, near).scene
    assert jobs.scene_of(job_of(3, replace(typed(record("a")), about=about)))[0] == scene
    assert drawn_again({(3, plain): key_of(scene), (3, near): key_of(scene)}) == [(3, plain)]


def test_a_run_with_a_scene_at_fewer_times_is_resumed_and_one_that_only_says_so_is_not(tmp_path):
    run(plan(tmp_path, scenes=2))
    path = tmp_path / "records.jsonl"
    with Journal(path) as journal:
        records = list(journal)
    few = [jobs.scene_of({"night": NIGHT, "shards": [r.about["shard"]], "shortened": True}) for r in records]
    said = [replace(r, about=about) for r, (_, about) in zip(records, few, strict=True)]
    right = [replace(r, key=key_of(scene)) for r, (scene, _) in zip(said, few, strict=True)]
    path.write_bytes(b"".join(line_of(r) + b"\n" for r in right))
    assert run(plan(tmp_path, scenes=2)).checked == 2

    path.write_bytes(b"".join(line_of(r) + b"\n" for r in said))
    with pytest.raises(OtherRun, match="whose scenes are not drawn any more"):
        run(plan(tmp_path, scenes=2))


def test_what_is_drawn_does_not_depend_on_which_records_of_the_last_rounds_came_first(tmp_path):
    with Journal(tmp_path / "records.jsonl") as journal:
        turns = Turns(journal)
        assert turns.take(3 * ROUND) == list(range(2 * ROUND))
        seen = dict(turns.seen(2 * ROUND - 1))
        for number in range(ROUND):
            turns.settle(replace(typed(record(str(number))), about={"shard": number, **dict.fromkeys(FEATURES, "a")}))

        assert (seen, turns.take(3 * ROUND)) == ({}, list(range(2 * ROUND, 3 * ROUND)))
        met = turns.seen(2 * ROUND)
        assert len(met) == math.comb(len(FEATURES) + 1, 2)
        assert met["class a & driver a"] == met["decade of the distance none & law a"] == ROUND


def test_every_number_has_one_turn_and_chains_have_turns_of_their_own():
    turns = range(WARM_UP + 40 * CHAINS_EVERY)
    numbers = [number for turn in turns for number in numbers_of(turn)]

    assert sorted(numbers) == list(range(len(numbers)))
    assert all(turn_of(number) == turn for turn in turns for number in numbers_of(turn))
    assert all(len({is_chain(number) for number in numbers_of(turn)}) == 1 for turn in turns)


def test_a_folder_that_holds_a_run_gives_its_seed_and_refuses_another(tmp_path):
    run(plan(tmp_path, scenes=1))

    assert seed_of(tmp_path, None) == NIGHT
    with pytest.raises(OtherRun, match=f"holds a run with seed {NIGHT}, not 1: choose another folder"):
        seed_of(tmp_path, 1)


def of_another_version(path, monkeypatch):
    path.write_text(json.dumps({**json.loads(path.read_text()), "refkin": "9.9"}))
    return {}


def of_another_source(path, monkeypatch):
    """A constant was changed between a kill and its resumption: one version, and the records of two programs."""
    assert json.loads(path.read_text())["source"] == source.digest()
    monkeypatch.setattr(campaign, "digest", lambda: "another")
    return {}


def of_another_source_untold(path, monkeypatch):
    """They are told apart without what stands beside them as well."""
    path.unlink()
    monkeypatch.setattr(campaign, "digest", lambda: "another")
    return {}


def with_other_time(path, monkeypatch):
    """What hangs at 5 s may answer at 30 s: the same engine would be told to do both."""
    return {"scene_seconds": 5.0}


def with_other_engines(path, monkeypatch):
    return {"engines": ("closed_form", *SAMPLED, engine_file(path.parent.parent))}


OTHERS = [
    (of_another_version, f"a run with refkin 9.9, not {refkin.__version__}"),
    (of_another_source, f"a run with source code {source.digest()}, not another"),
    (of_another_source_untold, "records of another run"),
    (with_other_time, r"a run with seconds per scene 30\.0, not 5\.0"),
    (with_other_engines, r"a run with .*fake none, not 1; file of fake none, not [0-9a-f]{16}"),
]


@pytest.mark.parametrize(("change", "said"), OTHERS, ids=[change.__name__ for change, _ in OTHERS])
def test_a_folder_of_another_run_is_refused_and_left_as_it_is(change, said, tmp_path, monkeypatch):
    out = tmp_path / "out"
    run(plan(out, scenes=1))
    asked = change(out / "run.json", monkeypatch)
    before = {file: file.read_bytes() for file in out.iterdir()}

    with pytest.raises(OtherRun, match=f"holds {said}: choose another folder"):
        run(plan(out, scenes=2, **asked))

    assert {file: file.read_bytes() for file in out.iterdir()} == before


@pytest.mark.parametrize("told", [True, False])
def test_a_folder_of_an_engine_whose_file_was_changed_is_refused(tmp_path, told):
    """Its version is what its file says: the records of two engines would stand under one name."""
    spec, out = engine_file(tmp_path), tmp_path / "out"
    run(plan(out, spec, scenes=1))
    engine_file(tmp_path, after=SHIFT)
    if not told:
        (out / "run.json").unlink()
    said = "a run with file of fake [0-9a-f]{16}, not [0-9a-f]{16}" if told else "records of another run"

    with pytest.raises(OtherRun, match=f"holds {said}: choose another folder"):
        run(plan(out, spec, scenes=2))

    engine_file(tmp_path)
    if told:
        assert run(plan(out, spec, scenes=2)).checked == 2


@pytest.mark.parametrize(
    ("name", "content", "same"),
    [
        ("refkin/newton.py", b"LIMIT = 1\r\nx = 2\r\n", True),
        ("refkin/newton.py", b"LIMIT = 2\nx = 2\n", False),
        ("crosscheck/newton.py", b"LIMIT = 1\nx = 2\n", False),
    ],
    ids=["as Windows ends lines", "a constant", "another place"],
)
def test_the_digest_of_the_source_follows_its_content_and_not_where_it_is(tmp_path, name, content, same):
    digests = []
    for folder, where, text in (("a", "refkin/newton.py", b"LIMIT = 1\nx = 2\n"), ("b", name, content)):
        file = tmp_path / folder / where
        file.parent.mkdir(parents=True)
        file.write_bytes(text)
        file.with_suffix(".pyc").write_bytes(folder.encode())
        digests.append(source.digest(tmp_path / folder))

    assert (digests[0] == digests[1]) is same


@pytest.mark.parametrize(
    "text", ['{"seed": 1', "[]", '{"seed": 1e400, "versions": {}}', '{"seed": "x", "versions": {}}', "{}", "[" * 10**5]
)
def test_a_folder_whose_run_cannot_be_told_is_refused(tmp_path, text):
    (tmp_path / "run.json").write_text(text)

    with pytest.raises(OtherRun, match=r"run.json does not say what run it belongs to: choose another folder"):
        seed_of(tmp_path, None)


@pytest.mark.parametrize(
    "put", [os.mkdir, os.mkfifo, partial(os.symlink, "/dev/full")], ids=["folder", "pipe", "device"]
)
@pytest.mark.parametrize("name", ["run.json", "records.jsonl", "report.json"])
def test_what_is_no_file_where_a_night_writes_one_is_one_clear_line(tmp_path, command, name, put):
    """A pipe that nobody writes to, or a device that never ends, hung it; a folder ended the night after its scenes."""
    put(tmp_path / name)
    told = command("nightly", "--out", tmp_path, "--scenes", 1)

    said = f"{tmp_path / name}: expected a file, got a folder, a pipe or a device: choose another folder\n"
    assert (told.returncode, told.stderr) == (2, said)


@pytest.mark.parametrize("text", [b'{"key": "a"}\n', b"\x8f\x00 no text\n"])
def test_a_folder_with_records_of_another_kind_is_refused(tmp_path, text):
    (tmp_path / "records.jsonl").write_bytes(text)

    with pytest.raises(
        OtherRun, match=r"records.jsonl, line 1: .*; it holds no records of ours: choose another folder"
    ):
        run(plan(tmp_path, scenes=1))


def test_scenes_end_a_night_that_has_minutes_left(tmp_path):
    began = time.monotonic()
    outcome = run(plan(tmp_path, scenes=2, minutes=5))

    assert (outcome.checked, time.monotonic() - began < 30) == (2, True)


def test_an_engine_that_crashes_when_it_is_loaded_is_missing_and_ends_nothing_else(tmp_path):
    spec = engine_file(tmp_path)
    path = Path(spec.removesuffix(":Fake"))
    path.write_text(f"import os; {EXIT}")
    result, missing = find_engines(("closed_form", spec))

    assert (list(result), missing) == (
        ["closed_form"],
        {spec: f"engine {spec!r} cannot be loaded: its process ended: exit code 7"},
    )


LONG_COUPLER = """
        points = {}
        for joint in scene.mechanism.joints:
            for body, point in joint.points():
                points.setdefault(body, []).append(point)
        def length(body):
            own = points.get(body, [(0, 0)])
            return max(np.hypot(a[0] - b[0], a[1] - b[1]) for a in own for b in own)
        if len(motion.q) == 3 * len(scene.mechanism.bodies) and length("coupler") > 2 * length("crank") > 0:
            motion = replace(motion, q=motion.q * (1 + 1e-6))
"""


@pytest.fixture(scope="module")
def disagreeing(tmp_path_factory):
    """A night with an engine that is wrong where, in the plane, the coupler is more than twice as long as the crank."""
    folder = tmp_path_factory.mktemp("disagreeing")
    spec = engine_file(folder, after=LONG_COUPLER.strip())
    outcome = run(plan(folder / "out", spec, scenes=40, shrinking_seconds=SHRINKING))
    return spec, folder / "out", outcome


def length(scene: refkin.Scene, body: str) -> float:
    points = [p for joint in scene.mechanism.joints for b, p in joint.points() if b == body]
    return max(((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) ** 0.5 for a in points for b in points)


def test_every_disagreement_of_a_wrong_engine_is_found_new_and_told_with_its_scene(disagreeing):
    _, out, outcome = disagreeing
    wrong = {key for key, record in records_of(out).items() if record["disagreements"]}

    assert len(wrong) >= 3
    assert {case.key for case in outcome.new} == wrong
    assert {(d.engine, d.quantity, d.kind) for d in (case.disagreement for case in outcome.new)} == {
        ("fake", "position", Cause.BEYOND)
    }
    assert all((out / c.file).is_file() and (out / f"disagreements/{c.key}.toml").is_file() for c in outcome.new)


def test_of_many_disagreements_of_a_kind_only_the_first_is_simplified(disagreeing):
    _, _, outcome = disagreeing

    assert [case.shrunk for case in outcome.new] == [True] + [False] * (len(outcome.new) - 1)


def test_a_disagreement_becomes_a_minimal_scene_that_still_has_its_cause(disagreeing):
    _, out, outcome = disagreeing
    value = outcome.new[0]
    scene, minimal = refkin.load(out / f"disagreements/{value.key}.toml"), refkin.load(out / value.file)

    assert length(minimal, "coupler") > 2 * length(minimal, "crank")
    # By the digits of all numbers in the file; one time or two are enough, and lengths become round.
    assert effort(minimal) < min(200, effort(scene) / 3)
    assert len(minimal.times) <= 2


def test_the_time_for_simplifying_is_bounded_and_told(disagreeing):
    assert 0.0 < disagreeing[2].shrinking_seconds < SHRINKING + 5.0


def test_a_minimal_scene_shows_the_disagreement_again_when_it_is_replayed(disagreeing):
    spec, out, outcome = disagreeing
    process = crosscheck("replay", out / outcome.new[0].file, "--engines", spec)

    assert (process.returncode, "fake (made up), position: beyond the allowed error" in process.stdout) == (1, True)


def test_a_scene_as_it_was_drawn_is_the_scene_of_the_record(disagreeing):
    _, out, outcome = disagreeing
    last = outcome.new[-1]

    assert refkin.load(out / last.file) == draw(NIGHT, last.shard).scene


def test_a_resumed_run_simplifies_nothing_again(disagreeing):
    spec, out, outcome = disagreeing
    before = {path: path.stat().st_mtime_ns for path in (out / "disagreements").iterdir()}
    again = run(plan(out, spec, scenes=40))

    assert {path: path.stat().st_mtime_ns for path in (out / "disagreements").iterdir()} == before
    assert [case.file for case in again.new] == [case.file for case in outcome.new]


def test_scenes_of_a_run_that_was_killed_before_it_told_its_disagreements_are_written_on_resumption(
    disagreeing, tmp_path
):
    spec, out, outcome = disagreeing
    for name in ("records.jsonl", "run.json"):
        (tmp_path / name).write_bytes((out / name).read_bytes())
    again = run(plan(tmp_path, spec, scenes=1, shrinking_seconds=0.0))

    assert [case.key for case in again.new] == [case.key for case in outcome.new]
    assert all((tmp_path / case.file).is_file() for case in again.new)


JUMP = Disagreement(
    engine="exudyn", method="shipped", quantity="position", kind=Cause.OTHER_ASSEMBLY, ratio=2.0, at=At("a.x", 0.0)
)


class Checking:
    """Workers whose only scene has a disagreement of a kind that is a known gap, or is none."""

    def __init__(self, sigma_per_step: float) -> None:
        self.engines = {"exudyn": "exudyn"}
        scene = typed(record("a"))
        assert scene.reference is not None
        row = replace(scene.reference, sigma_per_step=sigma_per_step)
        self.record = replace(scene, reference=row, disagreements=[JUMP])
        self.calls = 0

    def check_one(self, job: Any, engines: Any) -> Record:
        self.calls += 1
        return self.record


def jump() -> NewCase:
    return NewCase(disagreement=JUMP, key="0123456789abcdef", shard=0)


@pytest.mark.parametrize(("sigma_per_step", "shrunk"), [(0.1, False), (10.0, True)])
def test_a_new_disagreement_is_not_simplified_into_a_known_one(tmp_path, sigma_per_step, shrunk):
    new = [jump()]
    write_disagreements(plan(tmp_path), new, Checking(sigma_per_step=sigma_per_step))  # type: ignore[arg-type]

    assert (new[0].shrunk, bool(new[0].note)) == (shrunk, not shrunk)


def test_a_disagreement_is_not_simplified_into_one_of_another_root(tmp_path):
    """Wrong accelerations alone do not become those of a wrong position."""
    workers, rates = Checking(sigma_per_step=10.0), replace(JUMP, quantity="acceleration", kind=Cause.BEYOND)
    new = [replace(jump(), disagreement=rates)]
    workers.record = replace(workers.record, disagreements=[rates])
    write_disagreements(plan(tmp_path / "alone"), new, workers)  # type: ignore[arg-type]
    assert new[0].shrunk

    new = [replace(jump(), disagreement=rates)]
    workers.record = replace(workers.record, disagreements=[JUMP, rates])
    write_disagreements(plan(tmp_path / "of a wrong position"), new, workers)  # type: ignore[arg-type]
    assert not new[0].shrunk


def test_what_shows_in_the_part_of_a_scene_alone_is_written_and_simplified_there(tmp_path):
    """A night began where the whole scene does not, and wrote that instead: it showed nothing, and was left so."""
    whole = draw(NIGHT, 0)
    part, workers = in_part(whole), Checking(sigma_per_step=10.0)

    def check_one(job, engines):
        bodies, start = parse(job["scene"]).mechanism.bodies, parse(job["scene"]).times[0]
        return replace(workers.record, disagreements=[JUMP] if start > 0.0 and bodies else [])

    workers.check_one = check_one
    new = [replace(jump(), key=key_of(part.scene), shortened=True)]
    write_disagreements(plan(tmp_path, shrinking_seconds=5.0), new, workers)

    assert (whole.scene.times[0], new[0].shrunk, new[0].note) == (0.0, True, "")
    assert load(tmp_path / "disagreements" / f"{new[0].key}.toml") == part.scene
    assert effort(load(tmp_path / new[0].file)) < 200 < effort(part.scene)


def test_simplifying_ends_when_its_time_is_over(tmp_path):
    workers = Checking(sigma_per_step=10.0)
    write_disagreements(plan(tmp_path, shrinking_seconds=0.0), [jump()], workers)  # type: ignore[arg-type]

    # Once whether it shows again, once at the time of its worst sample alone.
    assert workers.calls == 2


def test_kinds_that_are_still_to_be_simplified_share_the_time_that_is_left(tmp_path, monkeypatch):
    now, given = iter((0.0, 0.0, 50.0, 50.0, 50.0, 80.0)), []
    monkeypatch.setattr(
        disagreements, "shrink", lambda seed, number, fails, seconds, **_: given.append((number, seconds)) or (None, 1)
    )
    monkeypatch.setattr(disagreements, "time", SimpleNamespace(monotonic=lambda: next(now)))
    other = replace(JUMP, quantity="velocity")
    new = [jump(), jump(), replace(jump(), disagreement=other, key="f" * 16, shard=3)]
    took = write_disagreements(plan(tmp_path, shrinking_seconds=60.0), new, Checking(10.0))  # type: ignore[arg-type]

    assert given == [(0, 30.0), (3, 10.0)]  # one of each kind
    assert took == 80.0


def test_the_report_and_the_run_agree_on_what_is_new(disagreeing, tmp_path):
    spec, out, outcome = disagreeing
    process = crosscheck(*arguments(spec, out, 40))
    report = json.loads((out / "report.json").read_text())

    assert (process.returncode, report["verdict"], report["new_disagreements"]) == (
        1,
        "new disagreements",
        len(outcome.new),
    )


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
