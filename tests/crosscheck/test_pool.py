"""What becomes of jobs whose processes end: every order of ends that a few jobs may meet, with processes made up."""

from __future__ import annotations

from collections import Counter
from itertools import product
from types import SimpleNamespace

import pytest

from crosscheck.workers import pool
from crosscheck.workers.pool import MOST_KILLS, Work, Workers
from crosscheck.workers.processes import Failure, FailureKind, Message

ENGINES = ("one", "other")
CRASH = Failure(FailureKind.CRASH, "its process ended: SIGSEGV", "SIGSEGV")
ERROR = Failure(FailureKind.ERROR, "ValueError: no", "ValueError")
KILLED = Failure(FailureKind.CRASH, "its process ended: SIGKILL", "SIGKILL")
SECONDS = 7.0
HANG = Failure(FailureKind.HANG, "no answer within 7 s")
FATES = {
    "well": lambda engines, before: "well",
    "crashes once": lambda engines, before: CRASH if engines == ENGINES else "well",
    "raises once": lambda engines, before: ERROR if engines == ENGINES else "well",
    "crashes with one engine": lambda engines, before: CRASH if "one" in engines else "well",
    "raises with the other": lambda engines, before: ERROR if "other" in engines else "well",
    "hangs with the other": lambda engines, before: HANG if "other" in engines else "well",
    "hangs without any": lambda engines, before: HANG,
    "killed as often as may be": lambda engines, before: KILLED if before < MOST_KILLS else "well",
    "killed by one engine": lambda engines, before: KILLED if "one" in engines else "well",
}
"""With which engines a job is asked, and how often it was before with these -> what comes of it."""
PARTS = {
    "crashes once": {"": "well", "one": "well", "other": "well"},
    "raises once": {"": "well", "one": "well", "other": "well"},
    "crashes with one engine": {"": "well", "one": CRASH, "other": "well"},
    "raises with the other": {"": "well", "one": "well", "other": ERROR},
    "hangs with the other": {"": "well", "one": "well", "other": HANG},
    "hangs without any": {"": HANG},
    "killed by one engine": {"": "well", "one": KILLED, "other": "well"},
}
"""What a job is joined from in the end; of the others nothing has to be joined."""

ONCE = {"crashes once": "crash (SIGSEGV)", "raises once": ERROR.text}
"""What is said of a job on which a process failed once: of an exception where it was raised, which is the engine."""

SPOILS = "spoils its process"
"""A job after which all others in its process raise; so they do after one that raised."""


class MadeUp:
    """A process as its parent sees it; `asked` counts how often any has begun with a job."""

    def __init__(self, clock, asked):
        self.clock, self.asked, self.todo, self.ended, self.answer = clock, asked, [], False, None
        self.spoilt = False
        self.pipe, self.process = self, SimpleNamespace(kill=self.end)

    def give(self, jobs):
        self.todo, self.deadline = list(jobs), self.clock.now + 7.0
        return not self.ended

    def next(self):
        key, engines = self.todo[0]["key"], self.todo[0]["engines"]
        if self.spoilt:
            return ERROR
        return FATES[key.partition(": ")[2]](engines, self.asked[key, engines])

    def take(self, seconds):
        job, answer = self.todo[0], self.next()
        self.asked[job["key"], job["engines"]] += 1
        self.todo, self.deadline = self.todo[1:], self.clock.now + seconds
        self.ended, self.answer = answer in (CRASH, KILLED), answer
        self.spoilt = self.spoilt or answer == ERROR or job["key"].endswith(SPOILS)
        return None if self.ended else (Message.DONE, job["key"] if answer == "well" else answer)

    def end(self):
        self.ended = True
        return self.answer


class Time:
    """Time that passes while all that are waited for hang."""

    now = 0.0

    def monotonic(self):
        return self.now

    def wait(self, processes, timeout):
        ready = [process for process in processes if process.next() != HANG]
        if not ready:
            self.now += SECONDS + 1.0
            for process in processes:
                process.asked[process.todo[0]["key"], process.todo[0]["engines"]] += 1
        return ready


@pytest.fixture
def run(monkeypatch):
    """Have jobs done in batches by so many processes: results by key, workers, how often each was begun with."""

    def run(fates, batch, count):
        clock, asked, made = Time(), Counter(), []
        monkeypatch.setattr(pool, "time", clock)
        monkeypatch.setattr(pool, "connection", clock)
        monkeypatch.setattr(pool, "Child", lambda *_: made.append(MadeUp(clock, asked)) or made[-1])
        work = Work(None, None, lambda job, engines, parts: SimpleNamespace(key=job["key"], parts=parts))
        results = []
        with Workers(work, count, {name: name for name in ENGINES}, SECONDS) as workers:
            jobs = [{"key": f"{k}: {fate}"} for k, fate in enumerate(fates)]
            for k in range(0, len(jobs), batch):
                workers.submit(jobs[k : k + batch])
            rounds = 0
            while workers.pending:
                results, rounds = [*results, *workers.results()], rounds + 1
                assert rounds < 100, fates
        assert all(process.ended for process in made)
        return results, workers, asked

    return run


@pytest.mark.parametrize(("batch", "count"), [(1, 1), (2, 1), (2, 2), (1, 3)])
def test_every_job_has_one_result_and_pays_for_no_other(run, batch, count):
    """A failure is told of the engine with which it comes again; what others do in the same process is kept."""
    for fates in product(FATES, repeat=1 + batch):
        results, workers, asked = run(fates, batch, count)
        keys = [getattr(result, "key", result) for result in results]
        joined = {result.key: result.parts for result in results if not isinstance(result, str)}
        parts = {
            key: {engine: "well" if part == key else part for engine, part in parts.items()}
            for key, parts in joined.items()
        }
        all_of = Counter({key: n for (key, engines), n in asked.items() if engines == ENGINES})

        assert sorted(keys) == [f"{k}: {fate}" for k, fate in enumerate(fates)], fates
        assert parts == {f"{k}: {fate}": PARTS[fate] for k, fate in enumerate(fates) if fate in PARTS}, fates
        assert all_of == {f"{k}: {fate}": 1 + MOST_KILLS * fate.startswith("killed") for k, fate in enumerate(fates)}, (
            fates
        )
        assert sorted(workers.unexplained) == [
            f"{k}: {fate}: {ONCE[fate]}, but not when it was done again" for k, fate in enumerate(fates) if fate in ONCE
        ], fates


def test_what_raised_is_taken_apart_in_processes_that_no_engine_has_had_before(run, monkeypatch):
    """An engine bound `json.dumps` anew: the reference, and engines after it, were blamed for what they raised then."""
    monkeypatch.setitem(FATES, SPOILS, FATES["well"])
    for fates, batch, count in product(product([SPOILS, "well", "raises with the other"], repeat=3), (1, 3), (1, 2)):
        results, workers, _ = run(fates, batch, count)
        parts = {result.key: [*result.parts.values()] for result in results if not isinstance(result, str)}

        assert {key for key, of in parts.items() if ERROR in of} == {
            f"{k}: {fate}" for k, fate in enumerate(fates) if fate.startswith("raises")
        }, fates
        assert all(of[:2] == [key, key] for key, of in parts.items()), fates
        assert all("but not when it was done again" in line for line in workers.unexplained)


def test_more_is_asked_for_until_as_many_tasks_wait_as_there_are_processes():
    with Workers(Work(None, None, None), 2, {}) as workers:
        asked = []
        for _ in range(3):
            asked.append((workers.hungry, workers.pending))
            workers.submit([{"key": "a"}])

    assert asked == [(True, False), (True, True), (False, True)]
