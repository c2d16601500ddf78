"""A night: draw scenes, have workers check them, keep every record, shrink what disagrees, say how it ended."""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

from crosscheck.check import key_of
from crosscheck.drawing import describe, draw, shrink
from crosscheck.engines import EngineError, load
from crosscheck.journal import Journal
from crosscheck.known_gaps import Gap, new_disagreements, read
from crosscheck.strategies import Drawn
from crosscheck.workers import Task, Workers
from refkin.scene_files import to_dict, to_toml

PASS, DISAGREEMENT, USAGE, ENGINE_MISSING, INFRASTRUCTURE, NOTHING_RAN = range(6)
BATCH = 10
MOST_SHRUNK = 5


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What a night is asked to do; one of `minutes` and `scenes` ends it."""

    seed: int
    out: Path
    engines: tuple[str, ...]
    required: tuple[str, ...] = ()
    minutes: float | None = None
    scenes: int | None = None
    workers: int = 2


@dataclass
class Outcome:
    """How a night ended."""

    versions: dict[str, str]
    missing: dict[str, str]
    checked: int = 0
    failed: list[str] = field(default_factory=list)
    new: list[dict[str, Any]] = field(default_factory=list)
    known: int = 0

    def exit_code(self, required: tuple[str, ...]) -> int:
        """Return 0 pass, 1 new disagreement, 3 engine missing, 4 infrastructure, 5 nothing ran; the worst first."""
        if any(name in self.missing for name in required):
            return ENGINE_MISSING
        if self.new:
            return DISAGREEMENT
        if self.failed:
            return INFRASTRUCTURE
        return PASS if self.checked else NOTHING_RAN


def run(plan: Plan, progress: Callable[[int], None] = lambda checked: None) -> Outcome:
    """Carry out a plan; records go to `records.jsonl` in its folder, what is already there is not done again."""
    versions, missing = find_engines(plan.engines)
    outcome = Outcome(versions, missing)
    if any(name in missing for name in plan.required):
        return outcome
    gaps = read()
    journal = Journal(plan.out / "records.jsonl")
    _write_plan(plan, outcome)
    where: dict[str, tuple[int, Drawn]] = {}
    try:
        with Workers(plan.workers) as workers:
            for record in _records(plan, tuple(versions), workers, journal, where):
                journal.append(record)
                outcome.checked = len(journal.keys)
                progress(outcome.checked)
            _judge(journal, gaps, outcome)
            _write_disagreements(plan, outcome, where, workers, tuple(versions))
    finally:
        journal.close()
    return outcome


class OtherRun(Exception):
    """The folder holds a run with another seed or other engines; its records would be mixed with this one's."""


def seed_of(out: Path, asked: int | None) -> int:
    """Return the seed of a night: what was asked, what the run in the folder has, or the day's date as a number."""
    made = _made(out)
    if made is not None:
        if asked is not None and asked != made["seed"]:
            raise OtherRun(f"--out {out} holds a run with seed {made['seed']}, not {asked}: choose another folder")
        return int(made["seed"])
    return int(time.strftime("%Y%m%d", time.gmtime())) if asked is None else asked


def _made(out: Path) -> dict[str, Any] | None:
    """Return what is written about the run that a folder holds."""
    path = out / "run.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


def find_engines(names: tuple[str, ...]) -> tuple[dict[str, str], dict[str, str]]:
    """Return the versions of the engines that can be loaded, and for the others why not."""
    versions, missing = {}, {}
    for name in names:
        try:
            versions[name] = load(name).version()
        except EngineError as error:
            missing[name] = str(error)
    return versions, missing


def _records(
    plan: Plan, engines: tuple[str, ...], workers: Workers, journal: Journal, where: dict[str, tuple[int, Drawn]]
) -> Iterator[dict[str, Any]]:
    """Yield records as they come in, while there is time or scenes are left."""
    end = time.monotonic() + 60.0 * plan.minutes if plan.minutes is not None else None
    batches = _batches(plan, journal, where)
    going = True
    while going or workers.pending:
        while going and workers.hungry:
            batch = next(batches, None)
            going = batch is not None and (end is None or time.monotonic() < end)
            if going and batch:
                workers.submit(Task(batch, engines))
        if workers.pending:
            yield from workers.results()


def _batches(plan: Plan, journal: Journal, where: dict[str, tuple[int, Drawn]]) -> Iterator[tuple[dict[str, Any], ...]]:
    """Yield batches of scenes that have no record yet, shard after shard."""
    drawn_before: set[str] = set()
    batch: list[dict[str, Any]] = []
    for shard in count():
        for drawn in draw(plan.seed, shard):
            if plan.scenes is not None and len(drawn_before) >= plan.scenes:
                break
            key = key_of(drawn.scene)
            if key in drawn_before:
                continue
            drawn_before.add(key)
            where[key] = (shard, drawn)
            if key not in journal.keys:
                batch.append({"scene": to_dict(drawn.scene), "about": {**describe(drawn), "shard": shard}})
            if len(batch) == BATCH:
                yield tuple(batch)
                batch = []
        if plan.scenes is not None and len(drawn_before) >= plan.scenes:
            break
    if batch:
        yield tuple(batch)


def _judge(journal: Journal, gaps: tuple[Gap, ...], outcome: Outcome) -> None:
    """Sort the disagreements of all records, those of an earlier part of a resumed run included."""
    for record in journal:
        fresh = new_disagreements(record, gaps)
        outcome.known += len(record["disagreements"]) - len(fresh)
        outcome.new += [{**d, "key": record["key"]} for d in fresh]
        if "failure" in record:
            outcome.failed.append(f"{record['key']}: {record['failure']}")


def _write_disagreements(
    plan: Plan, outcome: Outcome, where: Mapping[str, tuple[int, Drawn]], workers: Workers, engines: tuple[str, ...]
) -> None:
    """Write each disagreement's scene as TOML; the first of each kind is shrunk to a minimal one."""
    folder = plan.out / "disagreements"
    seen: set[tuple[str, ...]] = set()
    for disagreement in outcome.new:
        key = disagreement["key"]
        if key not in where:
            continue
        shard, drawn = where[key]
        signature = tuple(disagreement[k] for k in ("engine", "route", "quantity", "kind"))
        if signature not in seen and len(seen) < MOST_SHRUNK:
            seen.add(signature)
            drawn = shrink(plan.seed, shard, drawn, _still(signature, workers, engines))
            disagreement["shrunk"] = True
        folder.mkdir(parents=True, exist_ok=True)
        name = f"{key}-{'-'.join(signature[:3])}.toml"
        (folder / name).write_text(_commented(disagreement, to_toml(drawn.scene)), encoding="utf-8")
        disagreement["file"] = f"disagreements/{name}"


def _still(signature: tuple[str, ...], workers: Workers, engines: tuple[str, ...]) -> Callable[[Drawn], bool]:
    """Return the property to shrink by: the scene shows a disagreement of the same engine, route, quantity and kind."""

    def still_fails(drawn: Drawn) -> bool:
        job = {"scene": to_dict(drawn.scene), "about": describe(drawn)}
        record = workers.check_alone(job, tuple(e for e in engines if e == signature[0]))
        same = (tuple(d[k] for k in ("engine", "route", "quantity", "kind")) for d in record["disagreements"])
        return signature in same

    return still_fails


def _commented(disagreement: Mapping[str, Any], text: str) -> str:
    told = "\n".join(f"# {key}: {value}" for key, value in disagreement.items())
    return f"{told}\n# Show it again: crosscheck replay THIS_FILE\n\n{text}"


def _write_plan(plan: Plan, outcome: Outcome) -> None:
    """Write what the report says about how it was made, unless the folder holds a run with other engines."""
    before = _made(plan.out)
    if before is not None and before["versions"] != outcome.versions:
        raise OtherRun(f"{plan.out} holds a run with {before['versions']}, not {outcome.versions}: choose another folder")
    made = {
        **{k: str(v) if isinstance(v, Path) else v for k, v in asdict(plan).items() if k != "out"},
        "versions": outcome.versions,
        "missing": outcome.missing,
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "date": time.strftime("%Y-%m-%d %H:%M", time.gmtime()),
    }
    (plan.out / "run.json").write_text(json.dumps(made, indent=1), encoding="utf-8")
