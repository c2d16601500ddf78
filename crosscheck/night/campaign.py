"""A night: draw scenes, have workers check them, keep every record, shrink what disagrees, say how it ended."""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from itertools import count
from pathlib import Path
from typing import Any

from crosscheck.engines import load
from crosscheck.errors import UsageError
from crosscheck.judge import known_gaps
from crosscheck.judge.known_gaps import Gap, Tally
from crosscheck.measure.check import key_of
from crosscheck.night.disagreements import SHRINKING_SECONDS, write_disagreements
from crosscheck.night.golden import compare_night
from crosscheck.scenes.drawing import describe, draw, is_chain
from crosscheck.workers.cluster import ClusterWorkers
from crosscheck.workers.journal import Journal, replace_file
from crosscheck.workers.pool import SECONDS_PER_SCENE, Pool, Workers
from crosscheck.workers.processes import Failure, Job, call_each
from refkin.scenes.files import to_dict

ALWAYS = "closed_form"
"""The engine that is always among the sources, and by itself makes no night."""
SAMPLED = ("vector_loop", "refkin-lanes")
"""Sources that are asked for all chains, of which few others know the joints, and for one in `SAMPLED_EVERY` of the
other scenes: vector loops cost as much as the engines; the fast path is no peer, but one more producer of ours."""
SAMPLED_EVERY = 40

Progress = Callable[[int, str], None]


@dataclass(frozen=True, kw_only=True)
class Plan:
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
class Outcome:
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
    new, known : list of dict, int
        Disagreements that no known gap accounts for; how many others there are.
    possibly_closed : list of Gap
        Known gaps that did not show, although many scenes were of the kind in which they do.
    shrinking_seconds : float
        How long the simplifying of disagreements took.
    required : list of str
        What the night could not do without: the required engines, or all if not one was there.
    found_again : list of (Gap, int or None)
        Where another table than our own was chosen: every row of our own, and after how many scenes it showed.
    """

    versions: dict[str, str]
    missing: dict[str, str]
    checked: int = 0
    failed: list[str] = field(default_factory=list)
    new: list[dict[str, Any]] = field(default_factory=list)
    known: int = 0
    possibly_closed: list[Gap] = field(default_factory=list)
    shrinking_seconds: float = 0.0
    required: list[str] = field(default_factory=list)
    found_again: list[tuple[Gap, int | None]] = field(default_factory=list)


class OtherRun(UsageError):
    """The folder holds a run with another seed, other engines or other scenes, whose records would mix with these."""


class SameName(UsageError):
    """Two engines have the same name, so that their answers could not be told apart."""


def run(plan: Plan, progress: Progress = lambda checked, doing: None) -> Outcome:
    """Carry out a plan; records go to `records.jsonl` in its folder, what is already there is not done again.

    If a required engine is missing, or all that were asked for are, nothing is run. `progress` is called about once a
    second or more often, with the number of scenes checked and what is being done.

    Raises
    ------
    OtherRun, Occupied
        If the folder belongs to another run.
    SameName, InvalidGap, NoCluster
        If two engines have the same name; if the table of known gaps makes no sense; if the cluster is not there.
    """
    gaps = known_gaps.table(plan.known_gaps)
    found, missing = find_engines(plan.engines)
    outcome = Outcome({name: told for name, (_, told) in found.items()}, missing)
    names = {spec: name for name, (spec, _) in found.items()}
    alone = missing and set(found) <= {ALWAYS, *SAMPLED}
    outcome.required = list(missing) if alone else [names.get(spec, spec) for spec in plan.required]
    if any(name in missing for name in outcome.required):
        return outcome
    with Journal(plan.out / "records.jsonl") as journal:
        numbers = _numbers(journal)
        _agree_with_what_is_there(plan, outcome, numbers)
        outcome.checked = len(journal.keys)
        with _pool(plan, {name: spec for spec, name in names.items()}, outcome.versions) as workers:
            for record in _records(plan, workers, numbers, lambda: progress(outcome.checked, "checking")):
                journal.append(record)
                outcome.checked = len(journal.keys)
            _judge(journal, gaps, outcome)
            if plan.known_gaps:
                own = known_gaps.read()
                outcome.found_again = list(zip(own, known_gaps.found_again(own, journal), strict=True))
            simplifying = lambda: progress(outcome.checked, "simplifying disagreements")  # noqa: E731
            outcome.shrinking_seconds = write_disagreements(plan, outcome.new, workers, simplifying)
            if plan.baseline is not None:
                progress(outcome.checked, "comparing the golden set")
                outcome.new += compare_night(plan.baseline, plan.out, workers)
            outcome.failed += workers.unexplained
    return outcome


def _pool(plan: Plan, engines: dict[str, str], versions: dict[str, str]) -> Pool:
    if plan.cluster is None:
        return Workers(plan.workers, engines, plan.scene_seconds)
    return ClusterWorkers(plan.cluster, plan.workers, engines, versions, plan.scene_seconds)


def seed_of(out: Path, asked: int | None) -> int:
    """Return the seed of a night: what was asked, what the run in the folder has, or the day's date as a number."""
    made = _made(out)
    if made is not None:
        if asked is not None and asked != made["seed"]:
            raise OtherRun(f"--out {out} holds a run with seed {made['seed']}, not {asked}: choose another folder")
        return int(made["seed"])
    return int(time.strftime("%Y%m%d", time.gmtime())) if asked is None else asked


def find_engines(specs: tuple[str, ...]) -> tuple[dict[str, tuple[str, str]], dict[str, str]]:
    """Return the engines that can be loaded, as name -> (what loads it, version), and for the others why not.

    Each is loaded in a process of its own: one that crashes is missing, no more.

    Raises
    ------
    SameName
        If two have the same name.
    """
    found: dict[str, tuple[str, str]] = {}
    missing = {}
    for spec, told in zip(specs, call_each(name_and_version, specs), strict=True):
        if isinstance(told, Failure):
            missing[spec] = told.text.removeprefix("EngineError: ")
        elif told[0] in found:
            raise SameName(f"engines {found[told[0]][0]!r} and {spec!r} are both called {told[0]!r}")
        else:
            found[told[0]] = (spec, told[1])
    return found, missing


def name_and_version(spec: str) -> tuple[str, str]:
    """Return what an engine calls itself, and its version."""
    engine = load(spec)
    return engine.name, engine.version()


def _numbers(journal: Journal) -> dict[int, str]:
    """Return the numbers of the scenes that have a record, each with its key."""
    try:
        return {int(record["about"]["shard"]): record["key"] for record in journal}
    except (KeyError, TypeError) as error:
        raise OtherRun(f"{journal.path} holds records of another kind: choose another folder") from error


def _records(plan: Plan, workers: Pool, numbers: dict[int, str], tick: Callable[[], None]) -> Iterator[dict[str, Any]]:
    """Yield records as they come in, while there is time or scenes are left."""
    end = time.monotonic() + 60.0 * plan.minutes if plan.minutes is not None else float("inf")
    batches = _batches(plan, numbers, workers.batch(plan.scenes))
    going = True
    while going or workers.pending:
        while going and workers.hungry:
            batch = next(batches, None) if time.monotonic() < end else None
            going = batch is not None
            for names, jobs in _by_engines(batch or [], tuple(workers.engines)):
                workers.submit(jobs, names)
        if time.monotonic() >= end:
            workers.drop_waiting()
        yield from workers.results()
        tick()


def _by_engines(batch: list[Job], engines: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], list[Job]]]:
    """Yield the scenes of a batch that are checked on the same engines, with those."""
    fewer = tuple(name for name in engines if name not in SAMPLED)
    for names, wanted in ((engines, True), (fewer, False)):
        jobs = [job for job in batch if is_sampled(job["about"]["shard"]) is wanted]
        if jobs:
            yield names, jobs


def is_sampled(number: int) -> bool:
    """Whether the scene of that number is checked on the sources that are not asked for all."""
    return is_chain(number) or number % SAMPLED_EVERY == 0


def _batches(plan: Plan, numbers: dict[int, str], size: int) -> Iterator[list[Job]]:
    """Yield batches of scenes that have no record yet; scenes that were drawn before count once."""
    seen: set[str] = set()
    batch: list[Job] = []
    for number in count():
        if plan.scenes is not None and len(seen) >= plan.scenes:
            break
        if number in numbers:
            seen.add(numbers[number])
            continue
        drawn = draw(plan.seed, number)
        key = key_of(drawn.scene)
        if key not in seen:
            seen.add(key)
            batch.append({"scene": to_dict(drawn.scene), "about": {**describe(drawn), "shard": number}})
        if len(batch) == size:
            yield batch
            batch = []
    if batch:
        yield batch


def _judge(journal: Journal, gaps: tuple[Gap, ...], outcome: Outcome) -> None:
    """Sort the disagreements of all records, those of an earlier part of a resumed run included."""
    tally = Tally(gaps)
    for record in journal:
        fresh = tally.add(record)
        outcome.known += len(record["disagreements"]) - len(fresh)
        outcome.new += [{**told, "key": record["key"], "shard": record["about"]["shard"]} for told in fresh]
        if "failure" in record:
            outcome.failed.append(f"{record['key']}: {record['failure']}")
    outcome.possibly_closed = tally.possibly_closed()


def _made(out: Path) -> dict[str, Any] | None:
    """Return what is written about the run that a folder holds."""
    path = out / "run.json"
    if not path.exists():
        return None
    try:
        made = json.loads(path.read_text(encoding="utf-8"))
        return {"seed": int(made["seed"]), "versions": dict(made["versions"]), "date": made.get("date")}
    except (ValueError, KeyError, TypeError) as error:
        raise OtherRun(f"{path} does not say what run it belongs to: choose another folder") from error


def _agree_with_what_is_there(plan: Plan, outcome: Outcome, numbers: dict[int, str]) -> None:
    """Write how the run is made, unless the folder holds one with other engines or other scenes."""
    before = _made(plan.out)
    if before is not None and before["versions"] != outcome.versions:
        raise OtherRun(
            f"{plan.out} holds a run with {before['versions']}, not {outcome.versions}: choose another folder"
        )
    for number in sorted(numbers)[-1:]:
        if key_of(draw(plan.seed, number).scene) != numbers[number]:
            raise OtherRun(f"{plan.out} holds a run whose scenes are not drawn any more: choose another folder")
    made = {
        **{k: v for k, v in asdict(plan).items() if k not in ("out", "baseline")},
        "required": outcome.required,
        "versions": outcome.versions,
        "missing": outcome.missing,
        "hypothesis": version("hypothesis"),
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "date": (before or {}).get("date") or time.strftime("%Y-%m-%d %H:%M", time.gmtime()),
    }
    replace_file(plan.out / "run.json", json.dumps(made, indent=1) + "\n")
