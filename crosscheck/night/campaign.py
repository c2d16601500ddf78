"""A night: draw scenes, have workers check them, keep the records, shrink disagreements, decide the verdict."""

from __future__ import annotations

import hashlib
import json
import platform
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from crosscheck.errors import ENGINE_MISSING, CannotRun, UsageError
from crosscheck.judge import known_gaps
from crosscheck.judge.delivery import Unanswered
from crosscheck.judge.known_gaps import KnownGap, Tally
from crosscheck.judge.records import NewCase, Record
from crosscheck.judge.rounding import SAFETY
from crosscheck.measure.check import key_of
from crosscheck.measure.jobs import CHECK, by_itself
from crosscheck.night.disagreements import FOLDER, SCENE_FILE, write_disagreements
from crosscheck.night.golden import compare_night
from crosscheck.night.plan import (
    ALWAYS,
    GOLDEN,
    OUTCOME,
    PICTURES,
    SAMPLED,
    SAMPLED_EVERY,
    TRENDS,
    Journal,
    NightOutcome,
    NightPlan,
    lacking,
    read_outcome,
    replace_file,
    write_outcome,
)
from crosscheck.scenes.conformance import questions
from crosscheck.scenes.drawing import draw, is_chain, numbers_of, shortened, turn_of
from crosscheck.scenes.names import pairs_of
from crosscheck.workers.cluster import ClusterWorkers
from crosscheck.workers.pool import Job, Pool, Workers, find_engines
from crosscheck.workers.source import ROOT, SOURCE, digest, files_of
from crosscheck.workers.timing import machine
from refkin.errors import RefkinError
from refkin.scenes.files import load, to_dict
from refkin.solving.solve import solve

ROUND = 140
"""Turns of a round. What a round prefers to draw is known from the records of all rounds but the one before it, so that
it does not depend on which worker was faster."""

DRAWN_ANEW = 30
"""Of the scenes that a folder holds about so many, and the last, are drawn once more: does this code draw them?"""

Progress = Callable[[int, str], None]


class OtherRun(UsageError):
    """The folder holds a run with another seed, other engines or other scenes, whose records would mix with these."""


class NotHere(CannotRun):
    """An engine is missing without which a night that was begun does not go on."""

    code = ENGINE_MISSING


def run(plan: NightPlan, progress: Progress = lambda checked, doing: None) -> NightOutcome:
    """Carry out a plan; records go to `records.jsonl` in its folder, what is already there is not done again.

    If a required engine is missing, or all that were asked for are, nothing is run. `progress` is called about once a
    second or more often, with the number of scenes checked and what is being done. OtherRun if the folder belongs
    to another run; SameName, InvalidGap, NoCluster if two engines have one name, the table of known gaps makes
    no sense, the cluster is not there.
    """
    gaps = known_gaps.table(plan.known_gaps)
    engines, missing = find_engines(plan.engines)
    outcome = NightOutcome({name: version for name, (_, version) in engines.items()}, missing, gaps=list(gaps))
    outcome.engines = {name: spec for name, (spec, _) in engines.items()}
    names = {spec: name for name, spec in outcome.engines.items()}
    alone = set(engines) <= {ALWAYS, *SAMPLED}
    outcome.required = [names.get(spec, spec) for spec in plan.required]
    absent = lacking(outcome.required, missing, alone=alone)
    if absent and _made(plan.out) is not None:
        raise NotHere(f"{absent}; the night in {plan.out} stays as it is")
    if not absent:
        with Journal(plan.out / "records.jsonl") as journal:
            _carry_out(plan, journal, outcome, progress)
    write_outcome(plan.out, outcome)
    return outcome


def _carry_out(plan: NightPlan, journal: Journal, outcome: NightOutcome, progress: Progress) -> None:
    turns = Turns(journal)
    begun = _agree_with_what_is_there(plan, outcome, turns)
    outcome.checked = len(journal.keys)
    made: dict[str, Any] = {"count": plan.workers, "engines": outcome.engines, "seconds": plan.scene_seconds}
    if plan.cluster is not None:
        versions = {SOURCE: digest(), **_engines_of(outcome)}
        pool: Pool = ClusterWorkers(CHECK, plan.cluster, versions=versions, **made)
    else:
        pool = Workers(CHECK, **made)
    with pool as workers:
        _write_how(plan, outcome, begun)
        run = of_run(plan.seed, _engines_of(outcome))
        for record in _records(plan, workers, turns, journal, lambda: progress(outcome.checked, "checking")):
            journal.append(replace(record, run=run))
            outcome.checked = len(journal.keys)
        mute = _sort(journal, outcome)
        outcome.possibly_closed = [row for row in outcome.possibly_closed if not still_shows(workers, row[0])]
        if plan.known_gaps:
            own = [gap for gap in known_gaps.read() if gap.engine in outcome.engines]
            outcome.found_again = list(zip(own, known_gaps.found_again(own, journal), strict=True))
        simplifying = lambda: progress(outcome.checked, "simplifying disagreements")  # noqa: E731
        outcome.shrinking_seconds = write_disagreements(plan, outcome.new, workers, simplifying)
        if plan.baseline is not None:
            progress(outcome.checked, "comparing the golden set")
            outcome.new += compare_night(plan.baseline, plan.out, workers)
        outcome.new += mute.new(partial(_answers_plain_ones, workers))
        outcome.failed += workers.unexplained


FILES = (
    *("records.jsonl", "run.json", "report.json", "index.html", OUTCOME, GOLDEN, PICTURES, TRENDS, "documents.json"),
    *("hard_cases.json", "price.json", "effects.json"),
)
"""What a night writes into its folder, beside the scenes of disagreements."""


def refuse_others(out: Path) -> None:
    """Raise OtherRun if something else stands where a night writes a file: what is read from a pipe never ends.

    So it does where no night has written what is there.
    """
    for path in (out / name for name in FILES):
        if path.exists() and not path.is_file():
            raise OtherRun(f"{path}: expected a file, got a folder, a pipe or a device: choose another folder")
    others = [name for name in FILES if (out / name).exists()]
    if others and not {"run.json", "records.jsonl", OUTCOME} & {*others}:
        raise OtherRun(f"--out {out} holds {', '.join(others)} that no night has written: choose another folder")


def make_room(out: Path) -> None:
    """Remove what a finished night has written into a folder, and nothing else; one that was killed stays.

    OtherRun if the folder holds a report that is none of a night.
    """
    report = out / "report.json"
    if not report.exists():
        return
    ended, _ = read_outcome(out)  # one that an older version wrote in its own words leaves the run itself
    try:
        ours = "verdict" in json.loads(report.read_text(encoding="utf-8"))
    except (ValueError, TypeError):
        ours = False
    if not ours or (ended is None and _made(out) is None):
        raise OtherRun(f"--out {out} holds a report.json that no night has written: choose another folder")
    scenes = [path for path in (out / FOLDER).glob("*.toml") if SCENE_FILE.fullmatch(path.name)]
    for path in (*(out / name for name in FILES), *scenes):
        path.unlink(missing_ok=True)
    with suppress(OSError):  # no such folder, or something else is in it
        (out / FOLDER).rmdir()


def _instead(out: Path) -> str:
    """Return what to do about a folder that holds another run: `make_room` takes away one that is finished."""
    return f"choose another folder{', or begin anew with --fresh' if (out / 'report.json').exists() else ''}"


def seed_of(out: Path, asked: int | None) -> int:
    """Return the seed of a night: what was asked, what the run in the folder has, or the day's date as a number."""
    made = _made(out)
    if made is not None:
        if asked is not None and asked != made["seed"]:
            raise OtherRun(f"--out {out} holds a run with seed {made['seed']}, not {asked}: {_instead(out)}")
        return int(made["seed"])
    return int(time.strftime("%Y%m%d", time.gmtime())) if asked is None else asked


class Turns:
    """Whose turn it is: which scenes a night has checked, which come next, and what they should add.

    It begins with the journal of an earlier part of the run; OtherRun if that holds anything but records of drawn
    scenes.
    """

    def __init__(self, journal: Journal) -> None:
        self.done: dict[int, str] = {}
        self.drawn: dict[int, tuple[str, bool]] = {}
        self.pairs: dict[int, Counter[str]] = {}
        self._seen: dict[int, dict[str, int]] = {}
        self.pending: set[int] = set()
        self.runs: set[str] = set()
        self.next = 0
        for record in journal:
            number = record.about.get("shard")
            if type(number) is not int or number < 0:  # JSON's true is an int, too
                raise OtherRun(f"{journal.path} holds records of another kind: choose another folder")
            self.runs.add(record.run)
            self.settle(record)
        if journal.unreadable and not self.done:
            first = journal.unreadable[0]
            where = f"{journal.path}, line {first.line}: {first.reason}"
            raise OtherRun(f"{where}; it holds no records of ours: choose another folder")

    def settle(self, record: Record) -> None:
        """Note that a scene has its record."""
        number = int(record.about["shard"] or 0)
        turn = turn_of(number)
        self.drawn[number] = record.key, bool(record.about.get("shortened"))
        self.done[turn] = record.key
        self.pending.discard(turn)
        self.pairs.setdefault(turn // ROUND, Counter()).update(pairs_of(record.about))

    def take(self, most: int) -> list[int]:
        """Return the next turns, at most so many: fewer, or none, if what they should add is not known yet."""
        taken: list[int] = []
        while len(taken) < most:
            while self.next in self.done:
                self.next += 1
            if any(turn // ROUND < self.next // ROUND - 1 for turn in self.pending):
                break
            taken.append(self.next)
            self.pending.add(self.next)
            self.next += 1
        return taken

    def seen(self, turn: int) -> dict[str, int]:
        """Return how often two features were met at once in all rounds but that of the turn and the one before it."""
        present = turn // ROUND
        if present not in self._seen:
            rounds = [pairs for number, pairs in self.pairs.items() if number < present - 1]
            self._seen[present] = dict(sum(rounds, Counter()))
        return self._seen[present]


def _records(
    plan: NightPlan, workers: Pool, turns: Turns, journal: Journal, tick: Callable[[], None]
) -> Iterator[Record]:
    """Yield records as they come in, while there is time or scenes are left.

    A scene that comes twice counts once, and one more is drawn for it.
    """
    end = time.monotonic() + 60.0 * plan.minutes if plan.minutes is not None else float("inf")
    size = workers.batch(min(plan.scenes or 2 * ROUND, 2 * ROUND))
    while True:
        while workers.hungry and time.monotonic() < end:
            left = size if plan.scenes is None else plan.scenes - len(journal.keys) - len(turns.pending)
            batch = turns.take(min(size, left))
            if not batch:
                break
            for names, jobs in _by_engines(plan.seed, batch, turns, tuple(workers.engines)):
                workers.submit(jobs, names)
        if time.monotonic() >= end:
            workers.drop_waiting()
        if not workers.pending:
            return
        for record in workers.results():
            turns.settle(record)
            yield record
        tick()


def _by_engines(
    seed: int, batch: list[int], turns: Turns, engines: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], list[Job]]]:
    """Yield the jobs of a batch that are done on the same engines, with those."""
    fewer = tuple(name for name in engines if name not in SAMPLED)
    for names, wanted in ((engines, True), (fewer, False)):
        jobs: list[Job] = []
        for turn in (turn for turn in batch if is_sampled(turn) is wanted):
            numbers = numbers_of(turn)
            jobs.append({"night": seed, "shards": numbers, "seen": turns.seen(turn) if len(numbers) > 1 else {}})
        if jobs:
            yield names, jobs


def is_sampled(turn: int) -> bool:
    """Whether the scene of that turn is checked on the sources that are not asked for all."""
    return is_chain(numbers_of(turn)[0]) or turn % SAMPLED_EVERY == 0


def _sort(journal: Journal, outcome: NightOutcome) -> Unanswered:
    """Sort the disagreements of all records, those of an earlier part of a resumed run included.

    Returned is who answered nothing: a disagreement of no one scene, so none that a simpler scene shows.
    """
    tally, mute = Tally(outcome.gaps), Unanswered()
    for record in journal:
        new = tally.add(record)
        mute.add(record)
        outcome.known += len(record.disagreements) - len(new)
        where: Any = {"key": record.key, "shard": int(record.about["shard"] or 0)}
        where["shortened"] = bool(record.about.get("shortened"))
        outcome.new += [NewCase(disagreement=disagreement, **where) for disagreement in new]
        if record.failure is not None:
            outcome.failed.append(f"{record.key}: {record.failure}")
    outcome.possibly_closed = tally.possibly_closed()
    return mute


def still_shows(workers: Pool, gap: KnownGap) -> bool:
    """Return whether the scene of a known gap, if it is here, shows it now: a night may miss one that is rare."""
    try:
        scene = load(ROOT / gap.reproduction)
        expected = solve(scene).verdict  # the one that it was made for
    except RefkinError:  # a table of somebody's own may name what is no scene, or not there
        return False
    record = workers.check_one(by_itself(scene, features=True, expected=expected), [gap.engine])
    return any(gap.covers(record, disagreement) for disagreement in record.disagreements)


def _answers_plain_ones(workers: Pool, engine: str) -> bool:
    """Return whether an engine answers any of the plain mechanisms that `crosscheck conform` asks about."""
    plain = ({"scene": to_dict(question.scene)} for question in questions())
    return any(workers.check_one(job, [engine]).answers for job in plain)


def _made(out: Path) -> dict[str, Any] | None:
    """Return what is written about the run that a folder holds."""
    path = out / "run.json"
    if not path.exists():
        return None
    try:
        made = dict(json.loads(path.read_text(encoding="utf-8")))
        engines = {**made["versions"], **made.get("files", {})}
        made_by = _made_by(made.get("refkin"), made.get("source"), made.get("scene_seconds"), engines)
        return {"seed": int(made["seed"]), "made_by": made_by, "date": made.get("date")}
    except (OSError, ValueError, KeyError, TypeError, ArithmeticError, RecursionError) as error:
        instead = "choose another folder" if read_outcome(out)[0] is None else _instead(out)  # of what `make_room` can
        raise OtherRun(f"{path} does not say what run it belongs to: {instead}") from error


def _made_by(refkin: Any, source: Any, seconds: Any, engines: Mapping[str, str]) -> dict[str, Any]:
    """Return what must not change while a run goes on: by what, and how long, each scene is checked."""
    return {"refkin": refkin, SOURCE: source, "seconds per scene": seconds, **engines}


def _engines_of(outcome: NightOutcome) -> dict[str, str]:
    """Return by what engines scenes are checked: their versions, and the digests of their files."""
    return {**outcome.versions, **files_of(outcome.engines)}


def of_run(seed: int, engines: Mapping[str, str]) -> str:
    """Return the digest, 16 hex digits, of what all records of a run have in common: seed, source, all engines.

    One that is mixed in, out of another run, is told by it wherever it stands. It is no signature.
    """
    same = json.dumps([seed, version("refkin"), digest(), engines], sort_keys=True)
    return hashlib.sha256(same.encode()).hexdigest()[:16]


def _agree_with_what_is_there(plan: NightPlan, outcome: NightOutcome, turns: Turns) -> str | None:
    """Return when the run in the folder was begun, None if there is none; OtherRun if it is made otherwise.

    That is, from other source, with other versions or engines, or of other scenes.
    """
    engines = _engines_of(outcome)
    before, now = _made(plan.out), _made_by(version("refkin"), digest(), plan.scene_seconds, engines)
    if before is not None and (there := before["made_by"]) != now:
        keys = [key for key in {**there, **now} if there.get(key) != now.get(key)]
        others = "; ".join(f"{key} {there.get(key, 'none')}, not {now.get(key, 'none')}" for key in keys)
        raise OtherRun(f"{plan.out} holds a run with {others}: {_instead(plan.out)}")
    if turns.runs - {of_run(plan.seed, engines)}:
        raise OtherRun(f"{plan.out} holds records of another run: {_instead(plan.out)}")
    numbers = sorted(turns.drawn)
    for number in (*numbers[:: max(1, len(numbers) // DRAWN_ANEW)], *numbers[-1:]):
        (key, few), drawn = turns.drawn[number], draw(plan.seed, number)
        scene = shortened(drawn) if few else drawn.scene
        if scene is None or key_of(scene) != key:
            raise OtherRun(f"{plan.out} holds a run whose scenes are not drawn any more: {_instead(plan.out)}")
    return (before or {}).get("date")


def _write_how(plan: NightPlan, outcome: NightOutcome, begun: str | None) -> None:
    """Write how the run is made, once there is who carries it out: a folder without a run is anybody's."""
    made = {
        **{k: v for k, v in asdict(plan).items() if k not in ("out", "baseline")},
        "required": outcome.required,
        "versions": outcome.versions,
        "files": files_of(outcome.engines),
        "missing": outcome.missing,
        "safety_factor": SAFETY,
        "refkin": version("refkin"),
        "source": digest(),
        "hypothesis": version("hypothesis"),
        "python": platform.python_version(),
        "machine": "{processor}, {system}, {cores} cores".format(**machine()),
        "date": begun or time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime()),
    }
    replace_file(plan.out / "run.json", json.dumps(made, indent=1) + "\n")
