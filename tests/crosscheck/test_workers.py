"""Workers: an engine that crashes, hangs or raises on one scene is named, and costs nothing else; nor does a kill."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from functools import partial
from multiprocessing import forkserver
from pathlib import Path
from typing import Any

import pytest

from crosscheck.judge.records import plain
from crosscheck.measure.jobs import checkers, joined
from crosscheck.workers.pool import Workers
from crosscheck.workers.processes import LAST_PRINTED, MOST_PRINTED, call_each, hang

from .fake_engines import (
    EXIT,
    HANG,
    RAISE,
    SEGFAULT,
    SHIFT,
    alive,
    drained,
    engine_file,
    jobs,
    key_of_drawn,
    kinds,
    settled,
)

NIGHT = 11
COUNT = 6


def checked(workers: Workers, count: int = COUNT, batch: int = 3) -> dict[str, dict[str, Any]]:
    """Return the records of the first scenes by key, none twice."""
    records = list(drained(workers, jobs(NIGHT, count), batch))
    by_key = {record.key: settled(record) for record in records}
    assert len(by_key) == len(records)
    return by_key


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """What an engine that does nothing wrong gives, beside the closed form."""
    spec = engine_file(tmp_path_factory.mktemp("undisturbed"))
    with checkers(2, {"closed_form": "closed_form", "fake": spec}) as workers:
        return checked(workers)


def run_with(tmp_path: Path, before: str, seconds: float = 30.0) -> tuple[dict[str, Any], Workers]:
    spec = engine_file(tmp_path, before=before)
    with checkers(2, {"closed_form": "closed_form", "fake": spec}, seconds) as workers:
        return checked(workers), workers


def on_scene(number: int, what: str) -> str:
    return f'{what} if key == "{key_of_drawn(NIGHT, number)}" else None'


FAULTS = {
    "crash (SIGSEGV)": SEGFAULT,
    "crash (SIGABRT)": "os.abort()",
    "crash (exit code 7)": EXIT,
    "hang": HANG,
    "error (ZeroDivisionError)": RAISE,
}


@pytest.fixture(scope="module", params=FAULTS)
def faulty(request, tmp_path_factory):
    """A run in which one engine does one of the faults on the scene number 1: its kind, and the records."""
    folder = tmp_path_factory.mktemp("faulty")
    before = on_scene(1, f"exec({FAULTS[request.param].split('  #')[0]!r})")
    records, workers = run_with(folder, before, seconds=6.0 if request.param == "hang" else 30.0)
    return request.param, records, workers


def test_every_scene_has_a_record_although_a_process_failed_on_one(faulty, undisturbed):
    assert faulty[1].keys() == undisturbed.keys()


def test_only_the_scene_on_which_a_process_failed_is_affected(faulty, undisturbed):
    _, records, _ = faulty

    assert [key for key in records if records[key] != undisturbed[key]] == [key_of_drawn(NIGHT, 1)]


def test_the_engine_that_failed_is_named_with_how(faulty):
    kind, records, _ = faulty
    value = records[key_of_drawn(NIGHT, 1)]["disagreements"]

    assert [(d["engine"], d["method"], d["quantity"]) for d in value] == [("fake", "any", "status")]
    assert kinds(value) == [kind]


def test_what_the_other_engines_answered_is_kept(faulty, undisturbed):
    _, records, _ = faulty
    ours, theirs = (group[key_of_drawn(NIGHT, 1)] for group in (records, undisturbed))

    assert (ours["answers"], ours["reference"]) == (
        [a for a in theirs["answers"] if a["engine"] != "fake"],
        theirs["reference"],
    )


def test_a_failure_that_is_told_as_a_disagreement_is_not_told_twice(faulty):
    assert faulty[2].unexplained == []


def test_a_disagreement_of_an_engine_stays_when_another_crashes_on_the_scene(tmp_path):
    crashing = engine_file(tmp_path, name="crashing", before=on_scene(0, SEGFAULT))
    wrong = engine_file(tmp_path, name="wrong", after=SHIFT)
    with checkers(1, {"crashing": crashing, "wrong": wrong}) as workers:
        value = checked(workers, 1)[key_of_drawn(NIGHT, 0)]["disagreements"]

    assert {(d["engine"], d["quantity"]) for d in value} == {("crashing", "status"), ("wrong", "position")}


def test_workers_killed_one_after_the_other_change_nothing(tmp_path, undisturbed):
    spec = engine_file(tmp_path, before="time.sleep(0.4)")
    records = []
    with checkers(2, {"closed_form": "closed_form", "fake": spec}) as workers:
        todo = jobs(NIGHT, COUNT)
        workers.submit(todo[:3])
        workers.submit(todo[3:])
        kills, last = 0, time.monotonic()
        while workers.pending:
            records += list(workers.results())
            if kills < 4 and time.monotonic() - last > 0.3 and workers.busy:
                os.kill(next(iter(workers.busy)).process.pid, signal.SIGKILL)
                kills, last = kills + 1, time.monotonic()
            time.sleep(0.02)

    # How many fit in before the work is done is the machine's affair; one after the other needs two.
    assert kills >= 2
    assert {r.key: settled(r) for r in records} == undisturbed
    assert (len(records), workers.unexplained) == (COUNT, [])


def test_the_server_that_forks_workers_may_be_killed_with_them(tmp_path, undisturbed):
    spec = engine_file(tmp_path, before="time.sleep(0.1)")
    records = []
    with checkers(2, {"closed_form": "closed_form", "fake": spec}) as workers:
        workers.submit(jobs(NIGHT, COUNT))
        while not records:
            records += list(workers.results())
        os.kill(forkserver._forkserver._forkserver_pid, signal.SIGKILL)
        for process in workers.busy:
            os.kill(process.process.pid, signal.SIGKILL)
        records += drained(workers)

    assert {r.key: settled(r) for r in records} == undisturbed
    assert (len(records), workers.unexplained) == (COUNT, [])


def test_an_idle_worker_that_was_killed_is_replaced(tmp_path, undisturbed):
    spec = engine_file(tmp_path)
    with checkers(1, {"closed_form": "closed_form", "fake": spec}) as workers:
        first = workers.check_one(jobs(NIGHT, 1)[0])
        workers.idle[0].process.kill()
        workers.idle[0].process.join()
        again = workers.check_one(jobs(NIGHT, 1)[0])

    assert settled(first) == settled(again) == undisturbed[first.key]


def test_no_worker_is_left_when_the_work_is_done(tmp_path):
    with checkers(2, {"closed_form": "closed_form"}) as workers:
        checked(workers)
        pids = [process.process.pid for process in workers.idle]

    assert (len(pids), alive(pids)) == (2, [])


def test_no_worker_is_left_when_the_work_is_broken_off(tmp_path):
    spec = engine_file(tmp_path, before=HANG)
    with suppress(KeyboardInterrupt), checkers(2, {"fake": spec}) as workers:
        workers.submit(jobs(NIGHT, 1))
        workers.submit(jobs(NIGHT, 1))
        list(workers.results())
        pids = [process.process.pid for process in workers.busy]
        raise KeyboardInterrupt

    assert (len(pids), alive(pids)) == (2, [])


def test_scenes_that_nobody_has_begun_with_can_be_dropped():
    with checkers(1, {"closed_form": "closed_form"}) as workers:
        for job in jobs(NIGHT, 4):
            workers.submit([job])
        first = list(workers.results())
        workers.drop_waiting()
        first += drained(workers)

    assert len(first) == 1


def test_a_scene_whose_reference_fails_is_a_failure_of_the_run_and_no_disagreement():
    (job,) = jobs(NIGHT, 1)
    record = plain(joined(job, ("fake",), {"": hang(2.0)}))

    assert (record["failure"], record["disagreements"], record["key"]) == (
        "the reference itself: hang; no answer within 2 s",
        [],
        key_of_drawn(NIGHT, 0),
    )


SCRIPT = """
import json, sys
print("begun")
from crosscheck.measure.jobs import checkers
with checkers(1, {"closed_form": "closed_form"}) as workers:
    print(workers.check_one(json.loads(sys.argv[1])).key)
"""


def test_workers_do_not_run_the_program_that_starts_them_again(tmp_path):
    script = tmp_path / "program.py"
    script.write_text(SCRIPT)
    line = [sys.executable, script, json.dumps(jobs(NIGHT, 1)[0])]
    process = subprocess.run(line, capture_output=True, text=True, timeout=60, check=True)

    assert process.stdout.split() == ["begun", key_of_drawn(NIGHT, 0)]


def test_starting_workers_leaves_the_environment_as_it_was(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    before = dict(os.environ)
    with checkers(1, {"closed_form": "closed_form"}) as workers:
        workers.check_one(jobs(NIGHT, 1)[0])

    assert dict(os.environ) == before


def test_what_an_engine_prints_is_shown_up_to_a_bound_the_rest_is_counted_and_its_end_is_shown(tmp_path, capfd):
    long = r"os.write(1, b'\x1b[2Jfirst' + b'x' * 300_000); os.write(2, b'y' * 299_994 + b'at end')"
    with checkers(1, {"fake": engine_file(tmp_path, before=long)}) as workers:
        checked(workers, 1)
    out, err = capfd.readouterr()

    assert r"\x1b[2Jfirst" in err
    assert "\x1b" not in err  # no terminal acts on it
    assert (out, MOST_PRINTED < len(err) < MOST_PRINTED + LAST_PRINTED + 100) == ("", True)
    more = re.search(r"\n\.\.\. a process of engines printed ([0-9,]+) bytes more, at last:\ny+at end\n$", err)
    assert more is not None
    assert (int(more[1].replace(",", "")) + MOST_PRINTED) % 600_009 == 0  # once for each time it was asked


STARTING = """
        import multiprocessing
        with multiprocessing.get_context("fork").Pool(1) as pool:
            assert pool.map(abs, [-1.0]) == [1.0]
        other = multiprocessing.get_context("fork").Process(target=time.sleep, args=(1000.0,))
        other.start()
        Path({note!r}).write_text(str(other.pid))
"""


def test_an_engine_may_start_processes_and_none_outlives_its_worker(tmp_path, undisturbed):
    note = tmp_path / "pid"
    spec = engine_file(tmp_path, before=STARTING.format(note=str(note)).strip())
    with checkers(1, {"closed_form": "closed_form", "fake": spec}) as workers:
        records = checked(workers, 1)
    end = time.monotonic() + 60.0
    while alive([int(note.read_text())]) and time.monotonic() < end:
        time.sleep(0.01)

    assert records == {key: undisturbed[key] for key in records}
    assert alive([int(note.read_text())]) == []


FORKING = """
        from multiprocessing.util import Finalize
        Finalize(None, os.write, (2, b"ended as itself"), exitpriority=0)
        os.fork()
"""


def test_the_copy_of_an_engine_that_forks_answers_to_nobody(tmp_path, undisturbed, capfd):
    records, _ = run_with(tmp_path, FORKING.strip())

    assert records == undisturbed
    assert "ended" not in capfd.readouterr().err


MEDDLING = """
        import builtins, math, sys
        sys.stdout.close(), sys.stderr.close()
        os.environ.clear()
        np.linalg.norm, np.max, math.sin, builtins.open = [lambda *given, **named: 1.0 / 0.0] * 4
"""
PRINTING = """
        os.environ["PATH"]
        print("first"), os.write(1, b"second"), np.linalg.norm(np.ones(3))
"""


def test_an_engine_that_closes_streams_and_binds_names_of_numpy_anew_spoils_no_other(tmp_path, undisturbed, capfd):
    specs = {"fake": engine_file(tmp_path, before=PRINTING.strip())}
    specs = {"meddling": engine_file(tmp_path, name="meddling", after=MEDDLING.strip()), **specs}
    with checkers(1, {"closed_form": "closed_form", **specs}) as workers:
        records = checked(workers, 3)

    for key, record in records.items():
        of_others = {k: [row for row in record[k] if row["engine"] != "meddling"] for k in ("answers", "disagreements")}
        assert of_others == {k: undisturbed[key][k] for k in of_others}
    assert capfd.readouterr().err.count("second") >= 3


def test_what_a_process_started_ends_with_it_although_it_ended_well():
    (pid,) = call_each(partial(os.spawnlp, os.P_NOWAIT, "sleep", "sleep"), ["100"])
    end = time.monotonic() + 20.0
    while alive([pid]) and time.monotonic() < end:
        time.sleep(0.01)

    assert alive([pid]) == []
