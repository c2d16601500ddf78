"""What a night is asked to do, and how it ended: what its parts hand each other, and the report reads."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from crosscheck.judge.known_gaps import KnownGap
from crosscheck.judge.records import STRICT, NewCase, fault
from crosscheck.night.journal import replace_file
from crosscheck.scenes.names import PEERS
from crosscheck.workers.pool import SECONDS_PER_SCENE

ALWAYS = "closed_form"
"""The engine that is always among the sources, and by itself makes no night."""
SAMPLED = ("vector_loop", "refkin-lanes")
"""Sources that are asked for all chains, of which few others know the joints, and for one in `SAMPLED_EVERY` of the
other scenes: vector loops cost as much as the engines; the fast path is no peer, but one more producer of ours."""
SAMPLED_EVERY = 40
SHRINKING_SECONDS = 90.0
"""How long all the simplifying of a night may take."""
OUTCOME, GOLDEN, PICTURES, TRENDS = "outcome.json", "golden.json", "pictures.json", "trends.json"


@dataclass(frozen=True, kw_only=True)
class NightPlan:
    """What a night is asked to do; `minutes` and `scenes` end it, whichever comes first.

    `engines` and `required` are names, or what else `crosscheck.engines.load` takes; `cluster` is where the workers are
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
class NightOutcome:
    """How a night ended.

    Attributes
    ----------
    versions : dict
        Name of each engine that is there -> version.
    missing : dict
        What was asked for and cannot be loaded -> why.
    checked : int
        Scenes with a record, those of an earlier part of a resumed run included.
    failed : list of str
        What went wrong with the run itself.
    new, known : list of NewCase, int
        Disagreements that no known gap accounts for; how many others there are.
    possibly_closed : list of (Gap, int)
        Known gaps that did not show, although many scenes, and how many, were of the kind in which they do.
    shrinking_seconds : float
        How long the simplifying of disagreements took.
    required : list of str
        What the night could not do without: the required engines, or all if not one was there.
    found_again : list of (Gap, int or None)
        Where another table than our own was chosen: every row of our own, and after how many scenes it showed.
    gaps : list of Gap
        The table that the night was held against.
    engines : dict
        Name of each engine that is there -> what `crosscheck.engines.load` takes for it.
    """

    __pydantic_config__ = STRICT

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


@dataclass(frozen=True, kw_only=True)
class Golden:
    """The golden set of a night against the baseline: cases, engines, those that it lacks, what is worse."""

    __pydantic_config__ = STRICT

    cases: int
    versions: dict[str, str]
    engines: list[str]
    without: list[str]
    worse: list[NewCase]


def write_outcome(folder: Path, outcome: NightOutcome) -> None:
    """Write how a night ended into its folder."""
    folder.mkdir(parents=True, exist_ok=True)
    replace_file(folder / OUTCOME, TypeAdapter(NightOutcome).dump_json(outcome, indent=1).decode() + "\n")


def read_outcome(folder: Path) -> tuple[NightOutcome | None, list[str]]:
    """Return how the night of a folder ended, None if nobody wrote it; and what is wrong with the file."""
    path = folder / OUTCOME
    if not path.exists():
        return None, []
    try:
        return TypeAdapter(NightOutcome).validate_json(path.read_bytes()), []
    except ValidationError as error:
        return None, [f"{OUTCOME} cannot be read: {fault(error)}"]


def engines_option(engines: Sequence[str]) -> str:
    """Return what has to follow `crosscheck replay FILE` so that all of these engines are asked; empty if nothing."""
    named = [name for name in engines if name not in (ALWAYS, *SAMPLED)]
    return f" --engines {shlex.quote(','.join(named))}" if set(named) - set(PEERS) else ""
