"""The plan of a night, its verdict, and its records on disk: JSON lines, appended as they come."""

from __future__ import annotations

import os
import shlex
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from crosscheck.errors import UsageError, naming, printable
from crosscheck.judge.known_gaps import KnownGap
from crosscheck.judge.records import NewCase, Record, Strict, Unreadable, adapter, line_of, read_file, read_records
from crosscheck.scenes.names import PEERS
from crosscheck.workers.pool import SECONDS_PER_SCENE
from refkin.model import Scene
from refkin.motion import Status
from refkin.scenes.files import to_toml

try:
    import fcntl
except ImportError:  # Windows, where the lock is not taken
    fcntl = None  # type: ignore[assignment]


LOCK = ".lock"
"""A file in the folder of a night that holds nothing: who has it open has the folder."""


class Occupied(UsageError):
    """Another night is writing to the same folder."""


@contextmanager
def taken(folder: Path) -> Iterator[None]:
    """Take a folder for this process, until its night is over; Occupied if another has it.

    The system gives it back however the process ends.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / LOCK).open("ab") as file:
        if fcntl is not None:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise Occupied(f"another night or hunt is writing to {folder}") from error
        yield


class Journal:
    """An append-only file of records. Of equal scenes the one with the least number counts, whichever came first.

    A line that a kill cut short is removed when the file is opened again; its scene is then checked anew. A whole line
    that is no record stays where it is, for the report to complain of, and is `unreadable`. `keys` are the records',
    with the numbers of their scenes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.keys: dict[str, int | None] = {}
        self.unreadable: list[Unreadable] = []
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("ab")
        try:
            with path.open("rb") as file:
                whole = sum(len(line) for line in file if line.endswith(b"\n"))
            if whole != path.stat().st_size:
                self._file.truncate(whole)
            self.keys = {record.key: _number(record) for record in self}
        except BaseException:
            self._file.close()
            raise

    def append(self, record: Record) -> bool:
        """Write a record and hand it to the system; return whether it counts.

        ValueError if the record holds a number that is not finite: JSON has none.
        """
        number = _number(record)
        if record.key in self.keys:
            kept = self.keys[record.key]
            if number is None or kept is None or number >= kept:
                return False
        with naming(self.path):
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

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Bring what was written to the disk."""
        with naming(self.path):
            os.fsync(self._file.fileno())
            self._file.close()


def _number(record: Record) -> int | None:
    number = record.about.get("shard")
    return number if isinstance(number, int) else None


def replace_file(path: Path, text: str) -> None:
    """Write a file so that whoever reads it, also after a kill, finds the old or the new one, never a part."""
    part = path.with_name(path.name + ".part")
    with naming(part):
        part.write_text(text, encoding="utf-8")
    os.replace(part, path)


ALWAYS = "closed_form"
"""The engine that is always among the sources, and by itself makes no night."""
SAMPLED = ("vector_loop", "refkin-batch")
"""Sources that are asked for all chains, of which few others know the joints, and for one in `SAMPLED_EVERY` of the
other scenes: vector loops cost as much as the engines; the fast path is no peer, but one more producer of ours."""
SAMPLED_EVERY = 40
SHRINKING_SECONDS = 90.0
"""How long all the simplifying of a night may take."""
AGAIN = "# Show it again: crosscheck replay "
"""How the line of a scene file begins that says how to see again what it shows."""
OUTCOME, GOLDEN, PICTURES, TRENDS = "outcome.json", "golden.json", "pictures.json", "trends.json"


@dataclass(frozen=True, kw_only=True)
class NightPlan:
    """What a night is asked to do; `minutes` and `scenes` end it, whichever comes first.

    `engines` and `required` are names, or what else `engines.loading.load` takes; `cluster` is where the workers are
    if they are not processes of this run (see `crosscheck.workers.cluster`); `scene_seconds` is after how long on one
    scene a worker is ended, `shrinking_seconds` how long the simplifying of disagreements may take in all;
    `known_gaps` chooses the table of `crosscheck.judge.known_gaps.table`; `baseline` is the file of the golden set,
    not looked at if None.
    """

    seed: int
    out: Path
    engines: tuple[str, ...]
    required: tuple[str, ...] = ()
    minutes: float | None = None
    scenes: int | None = None
    workers: int = 2
    cluster: str | None = None
    scene_seconds: float = SECONDS_PER_SCENE
    shrinking_seconds: float = SHRINKING_SECONDS
    baseline: Path | None = None
    known_gaps: str = ""


@dataclass
class NightOutcome(Strict):
    """How a night ended.

    `versions` has the engines that could be loaded, `engines` what `engines.loading.load` takes for each, `missing`
    why the others could not; `required` are those without which it was not to run. `checked` counts scenes with a
    record, those of an earlier part of a resumed run included; `failed` says what went wrong with the run itself, `new`
    are the disagreements that no known gap accounts for. `gaps` are the known gaps that the night was held against,
    `possibly_closed` those that did not show in so many scenes of their kind, nor in their own; `found_again` (if
    another table was used) are all of ours, and after how many scenes each was.
    """

    versions: dict[str, str]
    missing: dict[str, str]
    checked: int = 0
    failed: list[str] = field(default_factory=list)
    new: list[NewCase] = field(default_factory=list)
    known: int = 0
    possibly_closed: list[tuple[KnownGap, int]] = field(default_factory=list)
    shrinking_seconds: float = 0.0
    required: list[str] = field(default_factory=list)
    found_again: list[tuple[KnownGap, int | None]] = field(default_factory=list)
    gaps: list[KnownGap] = field(default_factory=list)
    engines: dict[str, str] = field(default_factory=dict)


def lacking(required: Collection[str], missing: Mapping[str, str], *, alone: bool) -> str:
    """Return for want of which engines a night does not run; "" if it does.

    Parameters
    ----------
    required : collection of str
        Those without which it is worth nothing.
    missing : mapping
        Engines that could not be loaded -> why.
    alone : bool
        Whether no engine but our own sources could be loaded.
    """
    absent = [f"{name} is required and missing: {missing[name]}" for name in required if name in missing]
    if absent or not (alone and missing):
        return "; ".join(absent)
    return f"No engine that was asked for can be loaded: {'; '.join(missing.values())}"


@dataclass(frozen=True, kw_only=True)
class Golden(Strict):
    """The golden set of a night against the baseline: cases, engines, those that it lacks, what is worse."""

    cases: int
    versions: dict[str, str]
    engines: list[str]
    without: list[str]
    worse: list[NewCase]


def write_outcome(folder: Path, outcome: NightOutcome) -> None:
    """Write how a night ended into its folder."""
    folder.mkdir(parents=True, exist_ok=True)
    written = adapter(NightOutcome).dump_json(outcome, indent=1, by_alias=True)
    replace_file(folder / OUTCOME, written.decode() + "\n")


def read_outcome(folder: Path) -> tuple[NightOutcome | None, list[str]]:
    """Return how the night of a folder ended, None if nobody wrote it; and what is wrong with the file."""
    return read_file(folder / OUTCOME, NightOutcome)


def write_scene(
    path: Path,
    notes: Iterable[str],
    scene: Scene,
    engines: Sequence[str],
    *,
    features: bool = False,
    expected: Status = Status.OK,
) -> None:
    """Write a scene that shows something, under notes and the command that shows it again.

    Parameters
    ----------
    path, notes : Path, iterable of str
        The file, and what stands above, in lines of its own.
    scene, engines : Scene, sequence of str
    features, expected : bool, Status
        As for `crosscheck replay`.
    """
    comments = "".join(f"# {line}\n" for text in notes for line in printable(text).splitlines())
    options = [engines_option(engines), " --features" * features]
    options.append("" if expected is Status.OK else f" --expected {expected.value.replace('_', '-')}")
    again = f"{AGAIN}{path.name}{''.join(options)}"
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, f"{comments}{again}\n\n{to_toml(scene)}")


def engines_option(engines: Sequence[str]) -> str:
    """Return what has to follow `crosscheck replay FILE` so that all of these engines are asked; empty if nothing."""
    named = [name for name in engines if name not in (ALWAYS, *SAMPLED)]
    return f" --engines {shlex.quote(','.join(named))}" if set(named) - set(PEERS) else ""
