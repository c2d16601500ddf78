"""The records of a run on disk: JSON lines, appended as they come, so that a killed run loses nothing."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from crosscheck.errors import UsageError
from crosscheck.judge.records import Record, Unreadable, line_of, read_records

try:
    import fcntl
except ImportError:  # Windows, where the lock is not taken
    fcntl = None  # type: ignore[assignment]

BLOCK = 1 << 16
"""Bytes read at once while the end of the last whole line is looked for."""


class Occupied(UsageError):
    """Another run is writing to the same file."""


class Journal:
    """An append-only file of records. Of equal scenes the one with the least number counts, whichever came first.

    A line that a kill cut short is removed when the file is opened again; its scene is then checked anew. A whole line
    that is no record stays where it is, for the report to complain of, and counts as none.

    Attributes
    ----------
    keys : dict of str to int or None
        Of the records, with the numbers of their scenes.
    unreadable : list of Unreadable
        The whole lines that are no records.

    Raises
    ------
    Occupied
        If another process has the file open as a journal.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.keys: dict[str, int | None] = {}
        self.unreadable: list[Unreadable] = []
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("ab")
        try:
            self._lock()
            self._cut_torn_line()
            self.keys = {record.key: _number(record) for record in self}
        except BaseException:
            self._file.close()
            raise

    def append(self, record: Record) -> bool:
        """Write a record and hand it to the system; return whether it counts.

        Raises
        ------
        ValueError
            If the record holds a number that is not finite: JSON has none.
        """
        number = _number(record)
        if record.key in self.keys:
            kept = self.keys[record.key]
            if number is None or kept is None or number >= kept:
                return False
        self._file.write(line_of(record) + b"\n")
        self._file.flush()
        self.keys[record.key] = number
        return True

    def __iter__(self) -> Iterator[Record]:
        seen: set[str] = set()
        self.unreadable = []
        for _, record in read_records(self.path):
            if isinstance(record, Unreadable):
                self.unreadable.append(record)
            elif record.key not in seen:
                seen.add(record.key)
                yield record

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Bring what was written to the disk."""
        os.fsync(self._file.fileno())
        self._file.close()

    def _lock(self) -> None:
        """Take the file for this process; the system gives it back however the process ends."""
        if fcntl is None:
            return
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise Occupied(f"another run is writing to {self.path}") from error

    def _cut_torn_line(self) -> None:
        with self.path.open("rb") as file:
            end = file.seek(0, os.SEEK_END)
            whole = end
            while whole:
                start = max(0, whole - BLOCK)
                file.seek(start)
                newline = file.read(whole - start).rfind(b"\n")
                if newline >= 0:
                    whole = start + newline + 1
                    break
                whole = start
        if whole != end:
            self._file.truncate(whole)


def _number(record: Record) -> int | None:
    number = record.about.get("shard")
    return number if isinstance(number, int) else None


def replace_file(path: Path, text: str) -> None:
    """Write a file so that whoever reads it, also after a kill, finds the old or the new one, never a part."""
    part = path.with_name(path.name + ".part")
    part.write_text(text, encoding="utf-8")
    os.replace(part, path)
