"""A night whose workers are this process: what it counts, keeps and calls new is what was planted in its records."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import pytest

from crosscheck.commands.engines import outcome_lines
from crosscheck.engines.closed_form.engine import ClosedForm
from crosscheck.judge import known_gaps
from crosscheck.judge.records import At, Cause, Disagreement, NewCase, Record, RefusalRow, read_records
from crosscheck.measure.check import check, key_of
from crosscheck.measure.jobs import joined
from crosscheck.night import campaign
from crosscheck.night.campaign import OtherRun, run
from crosscheck.night.plan import ALWAYS, SAMPLED, SAMPLED_EVERY, NightPlan, read_outcome
from crosscheck.report.build import summarized
from crosscheck.scenes.conformance import Question, questions
from crosscheck.scenes.drawing import draw, in_part, is_chain
from crosscheck.workers.processes import Failure, FailureKind
from refkin.scenes.files import to_dict
from tests.linkages import ROCKER

from .fake_engines import settled
from .report_records import failed_record, good_answer, record, typed

SEED = 33
GAP = """[[gap]]
engine = "mujoco"
quantity = "velocity"
predicate = "anywhere"
reason = "planted"
class = "documented limit"
date = 2026-11-21
reproduction = "none"
"""


def wrong(quantity: str) -> Disagreement:
    who: Any = {"engine": "mujoco", "method": "newton", "quantity": quantity}
    return Disagreement(**who, kind=Cause.BEYOND, ratio=2.0, at=At("rocker.phi", 0.0), message=f"planted {quantity}")


JUMP = Disagreement(engine="exudyn", method="shipped", quantity="position", kind=Cause.OTHER_ASSEMBLY, ratio=2.0)
PLANTED = {1: ("velocity",), 2: ("velocity", "position"), 8: ("acceleration", "velocity")}
"""Number of a scene -> in what mujoco is wrong there; the velocity is a known gap."""
TWICE, LOST, GONE_OVER, IN_PART = {5: 3}, 4, 7, 2
"""A scene that is the same as an earlier one; one without a record of its own; one that our own table knows; one that
is checked at a part of its times."""


@cache
def key(number: int) -> str:
    """The key of a scene that is drawn; of later ones any that is none of these."""
    if number >= 10:
        return f"{number:016x}"
    drawn = draw(SEED, TWICE.get(number, number))
    return key_of((in_part(drawn) if number == IN_PART else drawn).scene)


class InThisProcess:
    """Workers that answer at once with what was planted; a scene that is asked about by itself is right."""

    made: list[InThisProcess] = []  # noqa: RUF012
    refusing: dict[str, str] = {}  # noqa: RUF012
    planted = PLANTED
    answered: tuple[str, ...] = ()

    def __init__(self, work: Any, count: int, engines: Any, seconds: float) -> None:
        self.engines, self.asked_for = dict(engines), (count, seconds)
        self.unexplained = ["a process that ended"]
        self.waiting: list[tuple[Any, tuple[str, ...]]] = []
        self.asked: dict[int, tuple[str, ...]] = {}
        self.alone: list[Any] = []
        self.dropped = 0
        self.made.append(self)

    def __enter__(self) -> InThisProcess:
        return self

    def __exit__(self, *_: object) -> None: ...

    def batch(self, scenes: int) -> int:
        return 4

    @property
    def hungry(self) -> bool:
        return len(self.waiting) < 2

    @property
    def pending(self) -> bool:
        return bool(self.waiting)

    def submit(self, jobs: Any, engines: Any) -> None:
        self.waiting += [(job, tuple(engines)) for job in jobs]

    def drop_waiting(self) -> None:
        self.dropped += len(self.waiting)
        self.waiting = []

    def check_one(self, job: Any, engines: Any) -> Record:
        self.alone.append((job, tuple(engines)))
        plain = self.refusing and job["scene"].get("name") in self.answered
        return typed(record("right", good_answer("mujoco")) if plain else record("right"))

    def results(self) -> Any:
        job, engines = self.waiting.pop(0)
        (number,) = job["shards"]
        assert (job["night"], job["seen"]) == (SEED, {})
        self.asked[number] = engines
        met = typed(failed_record("x") if number == LOST else record("x"))
        rows = [wrong(quantity) for quantity in self.planted.get(number, ())] + [JUMP] * (
            number == GONE_OVER and bool(self.planted)
        )
        about = {**met.about, "shard": number} | ({"shortened": True} if number == IN_PART else {})
        if self.refusing:
            met = replace(met, refusals=[RefusalRow(engine="mujoco", reason="not today", **self.refusing)])
        yield replace(met, key=key(number), about=about, disagreements=rows, scene=f"scene {number}")


@pytest.fixture
def night(monkeypatch, tmp_path):
    """Have a night of so many scenes in a folder: how it ended, its workers, and what it said meanwhile."""
    versions = {name: (f"{name}.py", "1.0") for name in (ALWAYS, *SAMPLED, "mujoco")}
    gaps = tmp_path / "gaps.toml"
    gaps.write_text(GAP, encoding="utf-8")
    monkeypatch.setattr(campaign, "Workers", InThisProcess)
    monkeypatch.setattr(campaign, "ClusterWorkers", lambda *_: pytest.fail("there is no cluster"))

    def night(scenes: int | None = 9, **more: Any) -> Any:
        there = {name: found for name, found in versions.items() if name in more.get("there", versions)}
        missing = {spec: "not installed" for spec in ("exudyn.py",)}
        monkeypatch.setattr(campaign, "find_engines", lambda specs: (there, missing))
        plan: dict[str, Any] = {"seed": SEED, "out": tmp_path / "out", "scenes": scenes, "shrinking_seconds": 0.0}
        plan |= {"engines": ("any",), "workers": 3, "scene_seconds": 5.0, "known_gaps": str(gaps)}
        said: list[tuple[int, str]] = []
        outcome = run(
            NightPlan(**plan | {k: v for k, v in more.items() if k != "there"}), lambda *words: said.append(words)
        )
        return outcome, InThisProcess.made[-1] if InThisProcess.made else None, said

    InThisProcess.made.clear()
    return night


@pytest.mark.parametrize("shown", [True, False])
def test_a_gap_whose_own_scene_shows_it_is_not_told_as_possibly_closed(night, monkeypatch, shown):
    missed = [(known_gaps.read(GAP)[0], 40)]
    monkeypatch.setattr(campaign.Tally, "possibly_closed", lambda tally: missed)
    monkeypatch.setattr(campaign, "still_shows", lambda workers, gap: shown)

    assert night()[0].possibly_closed == ([] if shown else missed)


def test_a_night_counts_keeps_and_calls_new_what_its_records_hold(night, tmp_path):
    outcome, workers, said = night()
    records = [met for _, met in read_records(tmp_path / "out" / "records.jsonl")]
    new = [(case.key, case.shard, case.disagreement) for case in outcome.new]
    assert [case.shard for case in outcome.new if case.shortened] == [IN_PART]

    assert sorted(met.scene for met in records) == [f"scene {number}" for number in range(10) if number not in TWICE]
    assert outcome.checked == len(records) == 9
    assert sorted(new, key=lambda each: each[1]) == [
        (key(2), 2, wrong("position")),
        (key(GONE_OVER), GONE_OVER, JUMP),
        (key(8), 8, wrong("acceleration")),
    ]
    assert outcome.known == 3
    assert outcome.failed == [f"{key(LOST)}: {failed_record('x')['failure']}", "a process that ended"]
    assert (outcome.missing, outcome.required) == ({"exudyn.py": "not installed"}, [])
    assert outcome.engines == {name: f"{name}.py" for name in (ALWAYS, *SAMPLED, "mujoco")} == workers.engines
    assert set(outcome.versions.values()) == {"1.0"}
    assert workers.asked_for == (3, 5.0)
    counted = [done for done, doing in said if doing == "checking"]
    assert sorted({*counted}) == list(range(1, 10))
    assert counted == sorted(counted)
    assert len(counted) == 10
    assert {words for words in said if words[1] != "checking"} == {(9, "simplifying disagreements")}
    assert read_outcome(tmp_path / "out") == (outcome, [])
    for case in outcome.new:
        assert (tmp_path / "out" / case.file).read_text(encoding="utf-8").count("# message: ") == len(
            [other for other in outcome.new if other.key == case.key and other.disagreement.message]
        )
        assert case.note == "it did not show again when its scene was checked by itself"
    assert sorted(engines for _, engines in workers.alone) == [(), ("mujoco",), ("mujoco",)]


def test_our_own_gaps_are_looked_for_where_another_table_was_chosen(night, tmp_path):
    outcome, *_ = night()
    own = [gap for gap in known_gaps.read() if gap.engine == "mujoco"]
    met = replace(typed(record("x")), disagreements=[JUMP])
    number = 1 + [d.scene for _, d in read_records(tmp_path / "out" / "records.jsonl")].index(f"scene {GONE_OVER}")

    assert [gap.engine for gap in outcome.gaps] == ["mujoco"]
    assert outcome.found_again == [(gap, number if gap.covers(met, JUMP) else None) for gap in own]


def test_what_costs_more_is_asked_for_chains_and_for_one_other_scene_in_so_many(night):
    _, workers, _ = night(45)
    few = (ALWAYS, "mujoco")

    assert workers.asked == {
        number: (ALWAYS, *SAMPLED, "mujoco") if is_chain(number) or number % SAMPLED_EVERY == 0 else few
        for number in range(46)
    }


def test_a_night_that_goes_on_does_the_rest_and_counts_the_whole(night, tmp_path):
    first, *_ = night(3)
    again, workers, said = night(9)
    whole = [met for _, met in read_records(tmp_path / "out" / "records.jsonl")]

    assert (first.checked, first.known, [case.shard for case in first.new]) == (3, 2, [2])
    assert sorted(workers.asked) == list(range(3, 10))
    assert (again.checked, again.known, sorted(case.shard for case in again.new)) == (9, 3, [2, 7, 8])
    assert {met.key for met in whole} == {key(number) for number in range(10)}
    assert said[0] == (4, "checking")


@pytest.mark.parametrize(
    ("own", "foreign"),
    [('"key":"' + key(1), '"key":"0123456789abcdef'), ('"shard":1}', '"shard":-1}'), ('"shard":1}', '"shard":true}')],
    ids=["key", "number", "no number"],
)
def test_records_of_another_night_between_its_own_are_refused(night, tmp_path, own, foreign):
    night(3)
    path = tmp_path / "out" / "records.jsonl"
    text = path.read_text(encoding="utf-8")
    assert own in text
    path.write_text(text.replace(own, foreign), encoding="utf-8")

    with pytest.raises(OtherRun, match="choose another folder"):
        night(9)


def test_one_record_of_another_run_is_refused_wherever_it_stands(night, tmp_path, monkeypatch):
    monkeypatch.setattr(campaign, "DRAWN_ANEW", 1)
    night(9)
    path = tmp_path / "out" / "records.jsonl"
    *before, foreign, last = path.read_text(encoding="utf-8").splitlines(keepends=True)
    runs = [campaign.of_run(SEED + k, read_outcome(tmp_path / "out")[0].versions) for k in (0, 1)]
    assert all(runs[0] in line for line in before)
    path.write_text("".join([*before, foreign.replace(*runs), last]), encoding="utf-8")

    with pytest.raises(OtherRun, match="holds records of another run: choose another folder"):
        night(12)


def test_a_night_whose_time_is_over_begins_with_no_other_scene(night, monkeypatch):
    passed = iter(range(0, 10**6, 7))
    clock = SimpleNamespace(monotonic=lambda: float(next(passed)), strftime=time.strftime, gmtime=time.gmtime)
    monkeypatch.setattr(campaign, "time", clock)
    outcome, workers, _ = night(None, minutes=1.0)

    assert 0 < outcome.checked == len(workers.asked) <= 9
    assert workers.dropped > 0
    assert not workers.pending


@pytest.mark.parametrize(
    ("more", "required"),
    [({"required": ("mujoco.py", "exudyn.py")}, ["mujoco", "exudyn.py"]), ({"there": (ALWAYS, *SAMPLED)}, [])],
    ids=["one that is required is missing", "all that were asked for are"],
)
def test_without_the_engines_that_it_needs_a_night_checks_nothing_and_says_which(night, tmp_path, more, required):
    outcome, *_ = night(**more)

    assert outcome.required == required
    assert (outcome.checked, InThisProcess.made) == (0, [])
    assert not (tmp_path / "out" / "records.jsonl").exists()
    assert read_outcome(tmp_path / "out")[0] == outcome


def test_a_required_engine_that_is_there_is_called_by_its_name(night):
    assert night(1, required=("mujoco.py",))[0].required == ["mujoco"]


@pytest.mark.parametrize(
    ("refusing", "answered", "fails"),
    [({"joint": ""}, (), True), ({"joint": ""}, ("fixed",), False), ({"joint": "gear", "level": "solve"}, (), False)],
    ids=["silent", "answers a plain mechanism", "refused by its table"],
)
def test_an_engine_that_was_asked_and_answered_nothing_fails_the_night_unless_plain_mechanisms_are_answered(
    night, tmp_path, monkeypatch, refusing, answered, fails
):
    plain = {question.about: question.scene for question in questions()}
    monkeypatch.setattr(campaign, "questions", lambda: [Question("any", replace(s, name=n)) for n, s in plain.items()])
    monkeypatch.setattr(InThisProcess, "refusing", refusing)
    monkeypatch.setattr(InThisProcess, "answered", answered)
    monkeypatch.setattr(InThisProcess, "planted", {})
    outcome, *_ = night(3)
    report = summarized(tmp_path / "out")
    said = "mujoco (any), status: not delivered; answered none of 3 scenes whose joints its table has, and no plain "
    lines = [line for line in outcome_lines(outcome) if "not delivered" in line]

    assert lines == [f"new: {said}mechanism; the first: not today"] * fails
    assert "mujoco answered no scene" in report["notes"]
    assert (report["verdict"], report["engines"]["mujoco"]["any"]["position"]["failures"]) == (
        ("new disagreements", 1) if fails else ("infrastructure", 0)
    )


def test_what_the_golden_set_lost_is_new_too(night, monkeypatch, tmp_path):
    lost = NewCase(disagreement=wrong("position"), key="golden-a", case="a")
    asked = []
    monkeypatch.setattr(campaign, "compare_night", lambda *some: asked.append(some) or [lost])
    outcome, workers, said = night(2, baseline=tmp_path / "b.json")

    assert outcome.new == [lost]
    assert asked == [(tmp_path / "b.json", tmp_path / "out", workers)]
    assert said[-1] == (2, "comparing the golden set")


class Shifted(ClosedForm):
    """An engine with a planted error."""

    name = "shifted"

    def solve(self, scene, route=None):
        motion = super().solve(scene, route)
        return replace(motion, q=motion.q + 1e-6, producer=replace(motion.producer, name=self.name))


def test_a_scene_that_was_taken_apart_is_joined_to_the_record_that_it_has_as_a_whole():
    scene = ROCKER.scene(samples=5)
    about = {"expected": "singular"}  # so that the reference has a disagreement, which every part has
    engines = {"closed_form": ClosedForm(), "shifted": Shifted()}
    whole = check(scene, list(engines.values()), about)
    parts: dict[str, Any] = {"": check(scene, [], about)}
    parts |= {name: check(scene, [engine], about) for name, engine in engines.items()}
    job = {"scene": to_dict(scene), "about": about}
    crash = Failure(FailureKind.CRASH, "its process ended: SIGSEGV", "SIGSEGV")
    lost = joined(job, list(engines), {**parts, "closed_form": crash})
    bare = joined(job, list(engines), {"": crash})

    assert settled(joined(job, list(engines), parts)) == settled(whole)
    assert whole.reference is not None
    assert 0.0 < whole.reference.seconds < 60.0
    assert {d.engine for d in whole.disagreements} == {"refkin", "shifted"}
    assert [answer.engine for answer in lost.answers] == ["shifted"]
    assert [(d.engine, d.name) for d in lost.disagreements if d.engine != "shifted"] == [
        ("refkin", whole.disagreements[0].name),
        ("closed_form", "crash (SIGSEGV)"),
    ]
    assert (bare.key, bare.about, bare.failure) == (
        whole.key,
        about,
        "the reference itself: crash (SIGSEGV); its process ended: SIGSEGV",
    )
    assert (bare.answers, bare.disagreements, bare.reference) == ([], [], None)
