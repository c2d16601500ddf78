"""How processes and the workers of a cluster are led, with processes and a cluster made up: what fails is told once."""

from __future__ import annotations

import signal
from collections import Counter
from itertools import product
from types import SimpleNamespace
from typing import Any

import pytest

from crosscheck.workers import cluster, pool, processes
from crosscheck.workers.cluster import ClusterWorkers, NoCluster
from crosscheck.workers.pool import MOST_KILLS, SameName, Work, Workers, find_engines
from crosscheck.workers.processes import Child, Failure, FailureKind, Message, call_each, call_in_turn, serve, stop
from crosscheck.workers.source import digest

from .fake_engines import drained

CRASH = Failure(FailureKind.CRASH, "its process ended: SIGSEGV", "SIGSEGV")
HANG = Failure(FailureKind.HANG, "no answer within 7 s")


class Pipe:
    """Our end of a pipe, or a child's: what comes in, and what is sent; at the end of what comes in it is closed."""

    def __init__(self, *coming: Any, there: bool = True) -> None:
        self.coming, self.sent, self.there, self.closed = list(coming), [], there, False
        self.waited: list[float] = []

    def send(self, message: Any) -> None:
        if not self.there:
            raise BrokenPipeError
        self.sent.append(message)

    def recv(self) -> Any:
        if not self.coming:
            raise EOFError
        return self.coming.pop(0)

    def poll(self, seconds: float) -> bool:
        self.waited.append(seconds)
        return self.there

    def close(self) -> None:
        self.closed = True


def failing(job: Any) -> Any:
    if job == "bad":
        raise ZeroDivisionError("planted")
    return f"{job} done"


def test_a_child_is_ready_once_for_some_arguments_and_says_what_came_of_each():
    prepared, pipe = [], Pipe(("a", "bad", "b"), ("c",))
    serve(failing, prepared.append, pipe)
    kinds = [message[0] for message in pipe.sent]
    answers = [message[1] for message in pipe.sent if message[0] is Message.DONE]

    assert prepared == ["a", "c"]
    assert kinds == [Message.READY, *[Message.DONE] * 3, Message.READY, Message.DONE]
    assert [answers[k] for k in (0, 2, 3)] == ["a done", "b done", "c done"]
    assert (answers[1].kind, answers[1].how) == (FailureKind.ERROR, "ZeroDivisionError")
    assert answers[1].text.startswith("ZeroDivisionError: planted (failing, test_processes_made_up.py:")


class Wordless(ValueError):
    def __str__(self) -> str:
        raise self


@pytest.mark.parametrize(
    ("raised", "text"),
    [
        (KeyboardInterrupt("own"), "own"),
        (SystemExit(0), "0"),
        (BaseExceptionGroup("some", [SystemExit()]), "some ("),
        (Wordless(), " ("),
    ],
)
def test_what_an_engine_raises_to_end_its_process_or_without_words_is_told_as_all_that_it_raises(raised, text):
    def ending(argument: Any) -> Any:
        raise raised

    pipe = Pipe(("a", "b"))
    serve(ending, None, pipe)
    failures = [message[1] for message in pipe.sent[1:]]

    assert [failure.kind for failure in failures] == [FailureKind.ERROR] * 2
    assert failures[0].text.startswith(f"{type(raised).__name__}: {text}")


def test_what_cannot_be_prepared_is_the_result_of_all_arguments():
    def unprepared(argument: Any) -> None:
        raise OSError(f"no {argument}")

    pipe = Pipe(("a", "b"))
    serve(failing, unprepared, pipe)

    assert [message[1].text.partition(" (")[0] for message in pipe.sent[1:]] == ["OSError: no a"] * 2


@pytest.mark.parametrize(
    ("code", "name"),
    [(-11, "SIGSEGV"), (-9, "SIGKILL"), (7, "exit code 7"), (0, "exit code 0"), (-200, "exit code -200")],
)
def test_the_end_of_a_process_is_its_signal_or_its_exit_code_and_one_that_runs_is_ended(code, name):
    killed = []
    ended = SimpleNamespace(exitcode=code, join=lambda seconds: None, kill=lambda: killed.append(True))
    failure = stop(ended)

    assert (failure.kind, failure.how, failure.text) == (FailureKind.CRASH, name, f"its process ended: {name}")
    assert failure.from_outside is (name == "SIGKILL")
    assert killed == []
    stop(SimpleNamespace(**{**vars(ended), "exitcode": None}))
    assert killed == [True]


def test_a_process_is_begun_while_interrupts_are_held_back_and_they_are_let_through_after():
    with processes._interrupts_held_back():
        held = signal.pthread_sigmask(signal.SIG_BLOCK, [])

    assert signal.SIGINT in held
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


@pytest.fixture
def child(monkeypatch):
    """A child at the other end of a made-up pipe, at a time that stands still."""

    def child(*coming: Any, there: bool = True) -> Any:
        pipe = Pipe(*coming, there=there)
        ended = SimpleNamespace(exitcode=-11, join=lambda seconds: None, kill=lambda: None)
        monkeypatch.setattr(processes, "start", lambda *_: (pipe, ended))
        monkeypatch.setattr(processes, "time", SimpleNamespace(monotonic=lambda: 100.0))
        return Child(failing)

    return child


def test_a_child_has_its_time_to_start_and_then_that_of_each_argument(child):
    one = child((Message.READY, None), (Message.DONE, "well"))
    assert one.give(["a", "b"], to_start=30.0)
    assert (one.pipe.sent, one.deadline) == ([("a", "b")], 130.0)
    assert one.result(7.0) == "well"
    assert (one.deadline, one.pipe.waited) == (107.0, [30.0, 7.0])
    assert (one.result(7.0), one.pipe.closed) == (CRASH, True)  # nothing more comes in


def test_a_child_that_does_not_answer_hangs_and_one_that_is_gone_takes_nothing(child):
    gone = child(there=False)

    assert gone.give(["a"]) is False
    assert (gone.result(7.0), gone.pipe.closed) == (HANG, True)


class Called:
    """A child of which every answer is planted: by its argument."""

    made: list[Called] = []  # noqa: RUF012

    def __init__(self, function: Any) -> None:
        self.taken, self.ended, self.deadline = [], 0, 0.0
        self.made.append(self)

    def give(self, arguments: Any, to_start: float = 0.0) -> bool:
        gone = arguments == ["after a kill"] and bool(self.taken)
        self.taken += [] if gone else [(*arguments, to_start)]
        return not gone

    def result(self, seconds: float) -> Any:
        assert seconds == 7.0
        return ANSWERS.get(self.taken[-1][0], "well")

    def end(self) -> None:
        self.ended += 1


ERROR = Failure(FailureKind.ERROR, "ValueError: no", "ValueError")
ANSWERS = {"crashes": CRASH, "hangs": HANG, "raises": ERROR}


@pytest.fixture
def called(monkeypatch):
    Called.made.clear()
    monkeypatch.setattr(processes, "Child", Called)
    return Called.made


def test_one_process_does_as_many_arguments_as_it_can_and_is_replaced_where_it_ended(called):
    arguments = ["a", "raises", "b", "crashes", "c", "hangs", "d", "after a kill"]
    answers = list(call_in_turn(failing, arguments, 7.0))

    assert answers == [ANSWERS.get(argument, "well") for argument in arguments]
    taken = [[argument for argument, *_ in one.taken] for one in called]
    assert taken == [["a", "raises", "b", "crashes"], ["c", "hangs"], ["d"], ["after a kill"]]
    assert [one.ended for one in called] == [1, 1, 0, 1]


def test_two_processes_take_turns_and_the_answers_come_in_order(called):
    answers = list(call_in_turn(failing, ["a", "crashes", "b", "raises", "c"], 7.0, 2))

    assert answers == ["well", CRASH, "well", ERROR, "well"]
    assert [[argument for argument, *_ in one.taken] for one in called] == [["a", "b", "c"], ["crashes"], ["raises"]]
    assert [one.ended for one in called] == [1, 1, 1]


def test_each_argument_has_a_process_of_its_own_and_time_to_start(called):
    answers = call_each(failing, ["a", "crashes", "b"], 7.0)

    assert answers == ["well", CRASH, "well"]
    assert [one.taken for one in called] == [[("a", 7.0)], [("crashes", 7.0)], [("b", 7.0)]]
    assert [one.ended for one in called] == [1, 1, 1]


def test_engines_are_named_by_themselves_and_the_others_missing_with_their_reason(monkeypatch):
    answers = {"a.py": ("alpha", "1"), "b.py": CRASH, "c.py": "there is none", "d.py": ("delta", "4")}
    monkeypatch.setattr(pool, "call_each", lambda function, specs: [answers.get(s, ("alpha", "2")) for s in specs])

    assert find_engines(tuple(answers)) == (
        {"alpha": ("a.py", "1"), "delta": ("d.py", "4")},
        {"b.py": f"engine 'b.py' cannot be loaded: {CRASH.text}", "c.py": "there is none"},
    )
    with pytest.raises(SameName, match=r"engines 'a.py' and 'e.py' are both called 'alpha'"):
        find_engines(("a.py", "e.py"))


class Future:
    """A batch on the cluster: how it stands, and what came of it."""

    def __init__(self, key: str, status: str, answer: Any = None) -> None:
        self.key, self.status, self.answer, self.cancelled = key, status, answer, False

    def done(self) -> bool:
        return self.status != "pending"

    def result(self) -> Any:
        return self.answer

    def exception(self) -> str:
        return "killed"

    def cancel(self) -> None:
        self.cancelled = True


class Client:
    """A cluster of three workers whose batches end as they are planted to."""

    def __init__(self, fates: Any = (), versions: Any = None) -> None:
        self.fates, self.submitted, self.status = iter(fates), [], "running"
        there = {f"worker {k}": {"fake": "1"} for k in range(3)}
        self.versions = there if versions is None else {**there, "worker 1": versions}

    def run(self, function: Any, specs: Any) -> Any:
        assert (function, specs) == (cluster.versions_here, ("fake.py",))
        return self.versions

    def submit(self, function: Any, *arguments: Any, pure: bool) -> Future:
        assert (function, pure) == (cluster.check_batch, False)  # the same scene again is no answer that is known
        self.submitted.append(arguments)
        return next(self.fates)

    def processing(self) -> dict[str, list[str]]:
        return {"worker 0": ["begun"], "worker 1": []}


@pytest.fixture
def workers(monkeypatch):
    def workers(client: Client) -> ClusterWorkers:
        monkeypatch.setattr(ClusterWorkers, "_connected", lambda self, address, count: client)
        work = Work(None, None, None)  # type: ignore[arg-type]
        return ClusterWorkers(work, "tcp://any", 9, {"fake": "fake.py"}, {"fake": "1"}, 7.0)

    return workers


def test_batches_of_a_cluster_are_done_again_where_their_worker_was_lost(workers):
    lost = [Future("lost", "lost") for _ in range(MOST_KILLS)]
    client = Client([*lost, Future("well", "finished", (["one", "two"], ["a failure"]))])
    pool = workers(client)
    pool.submit([{"key": "a"}, {"key": "b"}])
    records = list(drained(pool))

    assert (records, pool.unexplained) == (["one", "two"], ["a failure"])
    assert client.submitted == [(pool.work, ({"key": "a"}, {"key": "b"}), {"fake": "fake.py"}, 7.0)] * (MOST_KILLS + 1)
    pool = workers(Client(Future("lost", "lost") for _ in range(MOST_KILLS + 1)))
    pool.submit([{"key": "a"}])
    for _ in range(MOST_KILLS):
        assert list(pool.results()) == []
    with pytest.raises(NoCluster, match=rf"a batch of 1 scenes was lost {MOST_KILLS + 1} times: killed"):
        list(pool.results())


def test_who_waits_for_a_cluster_waits_a_second_and_not_longer_than_for_the_first_batch(workers, monkeypatch):
    now, slept = [0.0], []
    clock = SimpleNamespace(
        monotonic=lambda: now[0], sleep=lambda s: (slept.append(s), now.__setitem__(0, now[0] + 0.3))
    )
    monkeypatch.setattr(cluster, "time", clock)
    pool = workers(Client([Future("slow", "pending"), Future("done", "finished", (["one"], []))]))
    pool.submit([{"key": "a"}])

    assert list(pool.results()) == []
    assert len(slept) == 4
    pool.submit([{"key": "b"}])
    assert list(pool.results()) == ["one"]
    assert len(slept) == 4
    pool.client.status = "closed"
    with pytest.raises(NoCluster, match="the cluster was lost; 1 batches were still to come"):
        list(pool.results())


def test_what_no_worker_has_begun_with_is_forgotten_and_every_worker_gets_some(workers):
    batches = [Future("begun", "pending"), Future("done", "finished"), *(Future("waits", "pending") for _ in range(4))]
    pool = workers(Client(batches))
    hungry = []
    for _ in batches:
        hungry.append(pool.hungry)
        pool.submit([{"key": "a"}])
    full = pool.hungry
    pool.drop_waiting()

    assert (hungry, full) == ([True] * 6, False)
    assert [future.cancelled for future in batches] == [False, False, True, True, True, True]
    assert set(pool._waiting) == set(batches[:2])
    assert [pool.batch(scenes) for scenes in (None, 1, 60, 10_000)] == [cluster.BATCH, 1, 10, cluster.BATCH]


@pytest.mark.parametrize(
    ("there", "said"),
    [
        ({"fake": "2"}, r"worker 1 has \{'fake': '2'\}, this machine \{'fake': '1'\}"),
        ("no engine", "worker 1: no engine"),
    ],
)
def test_a_worker_without_the_engines_of_this_machine_is_no_worker(workers, there, said):
    with pytest.raises(NoCluster, match=said):
        workers(Client(versions=there))


def test_a_worker_says_which_engines_it_has_or_why_it_is_of_no_use(monkeypatch):
    answers = [("fake", "1"), ("other", "2")]
    monkeypatch.setattr(cluster, "call_each", lambda function, specs: answers[: len(specs)])

    assert cluster.versions_here(("a.py", "b.py")) == {cluster.SOURCE: digest(), "fake": "1", "other": "2"}
    answers[1] = CRASH
    assert cluster.versions_here(("a.py", "b.py")) == CRASH.text
    monkeypatch.setattr("multiprocessing.current_process", lambda: SimpleNamespace(daemon=True))
    hint = "start it with DASK_DISTRIBUTED__WORKER__DAEMON=False"
    assert cluster.versions_here(("a.py",)) == f"is a daemon and may have no children: {hint}"


def test_a_batch_is_done_by_one_child_of_the_worker_that_does_the_next_one_too(monkeypatch):
    made = []

    class Few:
        def __init__(self, work: Any, count: int, engines: Any, seconds: float) -> None:
            self.asked, self.waiting, self.unexplained = (count, engines, seconds), [], []
            made.append(self)

        def submit(self, jobs: Any) -> None:
            self.waiting += jobs

        @property
        def pending(self) -> bool:
            return bool(self.waiting)

        def results(self) -> list[Any]:
            self.unexplained.append(f"{self.waiting[0]} failed once")
            return [self.waiting.pop(0)]

    monkeypatch.setattr(cluster, "Workers", Few)
    work = Work(None, None, None)  # type: ignore[arg-type]
    batches = [cluster.check_batch(work, jobs, {"fake": "fake.py"}, 7.0) for jobs in (["a", "b"], ["c"])]

    assert batches == [(["a", "b"], ["a failed once", "b failed once"]), (["c"], ["c failed once"])]
    assert [one.asked for one in made] == [(1, {"fake": "fake.py"}, 7.0)]


ENGINES = ("one", "other")
KILLED = Failure(FailureKind.CRASH, "its process ended: SIGKILL", "SIGKILL")
SECONDS = 7.0
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
