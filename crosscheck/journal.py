"""The records of a run on disk: JSON lines, appended as they come, so that a killed run is resumed with nothing lost."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

Record = dict[str, Any]


class Journal:
    """An append-only file of records; the first record of a key counts, later ones are not written.

    A line that a kill cut short is removed when the file is opened again; its scene is then checked anew.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.keys: set[str] = set()
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            self._cut_torn_line()
            self.keys = {record["key"] for record in self}
        self._file = path.open("a", encoding="utf-8")

    def append(self, record: Mapping[str, Any]) -> bool:
        """Write a record and flush it; return whether it was new."""
        if record["key"] in self.keys:
            return False
        self._file.write(json.dumps(record) + "\n")
        self._file.flush()
        self.keys.add(record["key"])
        return True

    def __iter__(self) -> Iterator[Record]:
        with self.path.open(encoding="utf-8") as lines:
            for line in lines:
                yield json.loads(line)

    def close(self) -> None:
        """Bring what was written to the disk."""
        os.fsync(self._file.fileno())
        self._file.close()

    def _cut_torn_line(self) -> None:
        whole = self.path.read_bytes()
        end = whole.rfind(b"\n") + 1
        if end != len(whole):
            with self.path.open("r+b") as file:
                file.truncate(end)
