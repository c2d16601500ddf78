"""A cluster's workers give the records that processes of this machine give, also when one of them is killed."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import sys
import time
from dataclasses import replace
from typing import Any

import pytest

from crosscheck.judge.records import read_line
from crosscheck.measure.jobs import CHECK, checkers
from crosscheck.night.campaign import OtherRun, run, seed_of
from crosscheck.night.plan import NightPlan
from crosscheck.workers import cluster
from crosscheck.workers.cluster import ClusterWorkers, NoCluster
from crosscheck.workers.pool import Pool

from .fake_engines import SEGFAULT, crosscheck, drained, engine_file, jobs, key_of_drawn, settled

NIGHT = 11
COUNT = 12
SPECS = {"closed_form": "closed_form"}


def local(engines=SPECS) -> ClusterWorkers:
    return ClusterWorkers(CHECK, "local", 2, engines, cluster.versions_here(tuple(engines.values())))


def digests(records: list[Any]) -> list[str]:
    """Return what stands in records, but for how long things took, as hashes in the order of their keys."""
    whole = {record.key: json.dumps(settled(record), sort_keys=True) for record in records}
    return [hashlib.sha256(whole[key].encode()).hexdigest() for key in sorted(whole)]


def checked(pool: Pool, killed: bool = False) -> list[Any]:
    """Return the records of the first scenes, in batches of two; with one of the workers killed in the middle."""
    records: list[Any] = []
    for record in drained(pool, jobs(NIGHT, COUNT), 2):
        records.append(record)
        if killed:
            assert isinstance(pool, ClusterWorkers)
            os.kill(next(iter(pool.client.run(os.getpid).values())), signal.SIGKILL)
            killed = False
    return records


@pytest.fixture(scope="module")
def embedded():
    with checkers(2, SPECS) as pool:
        return digests(checked(pool))


@pytest.fixture(scope="module")
def two_workers():
    with local() as pool:
        yield pool


def test_two_workers_give_the_records_of_the_embedded_pool(two_workers, embedded):
    assert digests(checked(two_workers)) == embedded


def test_so_they_do_when_one_of_them_is_killed_in_the_middle(embedded):
    with local() as pool:
        assert digests(checked(pool, killed=True)) == embedded


def test_an_engine_that_crashes_is_told_and_costs_neither_its_worker_nor_the_batch(tmp_path):
    crash = f"exec({SEGFAULT!r}) if key == {key_of_drawn(NIGHT, 1)!r} else None"
    with local({**SPECS, "fake": engine_file(tmp_path, before=crash)}) as pool:
        before = set(pool.client.run(os.getpid).values())
        records = checked(pool)
        kinds = [item.name for record in records for item in record.disagreements]

        assert (len(records), kinds) == (COUNT, ["crash (SIGSEGV)"])
        assert set(pool.client.run(os.getpid).values()) == before


def test_batches_that_no_worker_has_begun_with_can_be_dropped(two_workers):
    todo = jobs(NIGHT, 1)
    for _ in range(40):
        two_workers.submit(todo)
    two_workers.drop_waiting()
    records = list(drained(two_workers))

    assert len(records) < 40


def test_a_scheduler_that_does_not_answer_is_no_cluster(monkeypatch):
    monkeypatch.setattr(cluster, "SECONDS_TO_CONNECT", 1.0)
    start = time.monotonic()

    with pytest.raises(NoCluster, match=r"--cluster tcp://127\.0\.0\.1:1: "):
        ClusterWorkers(CHECK, "tcp://127.0.0.1:1", 2, SPECS, {})
    assert time.monotonic() - start < 10.0


def test_a_night_for_which_there_is_no_cluster_leaves_its_folder_to_others(tmp_path, monkeypatch):
    """Else the next night in it is refused for the seed of one that checked nothing."""
    monkeypatch.setattr(cluster, "SECONDS_TO_CONNECT", 0.2)
    plan = NightPlan(seed=1, out=tmp_path, engines=("closed_form",), scenes=1, cluster="tcp://127.0.0.1:1")
    with pytest.raises(NoCluster):
        run(plan)

    assert seed_of(tmp_path, 2) == 2
    assert run(replace(plan, seed=2, cluster=None)).checked == 1
    with pytest.raises(OtherRun):
        seed_of(tmp_path, 3)


def test_without_the_package_distributed_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)

    with pytest.raises(NoCluster, match=r"pip install 'refkin\[cluster\]'"):
        local()


def test_a_night_on_a_cluster_is_the_night_on_this_machine(tmp_path):
    common = ("nightly", "--scenes", 6, "--seed", 3, "--engines", "mujoco", "--workers", 2, "--out")
    rows = [crosscheck(*common, tmp_path / "pool"), crosscheck(*common, tmp_path / "dask", "--cluster", "local")]
    lines = [(tmp_path / name / "records.jsonl").read_text().splitlines() for name in ("pool", "dask")]

    assert [process.returncode for process in rows] == [0, 0]
    assert digests([read_line(line) for line in lines[0]]) == digests([read_line(line) for line in lines[1]])
