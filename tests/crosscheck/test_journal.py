"""The journal: no kill loses a record or counts one twice, and nothing that is no record is taken for one."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from crosscheck.judge.records import Record, line_of, read_line
from crosscheck.night.plan import Journal, Occupied, replace_file, taken

HOLD = """
import pathlib, sys
from crosscheck.night.plan import taken
with taken(pathlib.Path(sys.argv[1])):
    print("held", flush=True)
    input()
"""


def named(key: str) -> str:
    return key.rjust(16, "0")


def record(key: str, said: str = "", **about: Any) -> Record:
    nothing: dict[str, Any] = {name: [] for name in ("answers", "levels", "refusals", "disagreements")}
    return Record(key=named(key), scene=said, about={"shard": int(key, 16), **about}, failure="none", **nothing)


ESCAPING = line_of(record("a")).decode().replace(named("a"), "../../../escaped")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run" / "records.jsonl"


def written(path: Path, *keys: str) -> list[str]:
    with Journal(path) as journal:
        for key in keys:
            journal.append(record(key))
        return [r.key.lstrip("0") for r in journal]


def test_a_record_is_on_disk_as_soon_as_it_is_appended(path):
    with Journal(path) as journal:
        journal.append(record("a"))

        assert read_line(path.read_text()) == record("a")


def test_the_first_record_of_a_key_counts(path):
    with Journal(path) as journal:
        rows = [journal.append(record("a", said="first")), journal.append(record("a", said="second"))]

        assert (rows, [r.scene for r in journal]) == ([True, False], ["first"])


def test_a_key_that_stands_in_the_file_twice_is_read_once(path):
    written(path, "a")
    path.write_text(path.read_text() * 2)

    assert written(path) == ["a"]


@pytest.mark.parametrize("left", [1, 10, 20, "all but the newline"])
def test_a_line_that_a_kill_cut_short_is_removed_and_its_record_written_anew(path, left):
    written(path, "a", "b")
    first, second = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(first + second[: left if isinstance(left, int) else -1])

    with Journal(path) as journal:
        kept = {key.lstrip("0") for key in journal.keys}

    assert (kept, written(path, "b")) == ({"a"}, ["a", "b"])


def test_a_torn_line_longer_than_what_is_read_at_once_is_removed(path):
    written(path, "a")
    whole = path.read_bytes()
    path.write_bytes(whole + b"x" * 200_000)

    with Journal(path):
        pass

    assert path.read_bytes() == whole


def test_a_file_of_nothing_but_a_torn_line_is_emptied(path):
    path.parent.mkdir()
    path.write_bytes(b'{"key": "a"')

    assert written(path, "b") == ["b"]


@pytest.mark.parametrize("line", ["rubbish", "[1, 2]", '{"no": "key"}', '{"key": 3}', ESCAPING])
def test_a_whole_line_that_is_no_record_stays_for_the_report_and_counts_as_none(path, line):
    written(path, "a")
    path.write_text(f"{line}\n" + path.read_text())

    assert (written(path), path.read_text().splitlines()[0]) == (["a"], line)


def test_a_record_that_json_cannot_hold_is_refused_whole(path):
    with Journal(path) as journal:
        with pytest.raises(ValueError, match="not JSON compliant"):
            journal.append(record("a", ratio=float("nan")))

        assert (path.read_text(), journal.keys) == ("", {})


def test_the_folder_of_a_killed_night_is_free_again(tmp_path):
    command = [sys.executable, "-c", HOLD, tmp_path / "run"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        holder.stdout.readline()
        with pytest.raises(Occupied, match=r"another night or hunt is writing to .*run"), taken(tmp_path / "run"):
            pass
        holder.send_signal(signal.SIGKILL)
        holder.wait()

    with taken(tmp_path / "run"):
        pass


@pytest.fixture
def full(monkeypatch, path):
    """A disk that takes no more than some bytes of a file; the system says so by an error without its name."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


def test_what_a_full_disk_says_names_the_file_and_what_was_whole_is_kept(path, full):
    def filled() -> None:
        with Journal(path) as journal:
            for key in range(100):
                journal.append(record(f"{key:x}"))

    with pytest.raises(OSError, match=r"File too large: .*records\.jsonl'$"):
        filled()
    with pytest.raises(OSError, match=r"File too large: .*run\.json\.part'$"):
        replace_file(path.with_name("run.json"), "x" * 2000)
    with Journal(path) as journal:
        assert 0 < len(list(journal)) == len(journal.keys)
        assert journal.unreadable == []


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "run.json"
    replace_file(path, "old")

    def killed(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.replace", killed)
    with pytest.raises(KeyboardInterrupt):
        replace_file(path, "new")

    assert path.read_text() == "old"
