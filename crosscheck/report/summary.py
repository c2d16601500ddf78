"""A run in one pass over its records: the whole content of `report.json`. Memory does not grow with the samples.

The verdict of a night follows from its counts; the worst comes first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from crosscheck.judge.known_gaps import unexplained
from crosscheck.judge.records import QUANTITIES as SOLVED
from crosscheck.judge.records import Disagreement, Record, Unreadable, plain, read_file, read_records
from crosscheck.night.plan import ALWAYS, GOLDEN, OUTCOME, SAMPLED, Golden, NightOutcome, lacking
from crosscheck.report.alike import SameScenes
from crosscheck.report.cells import Cell, MethodTotals, RecordLine
from crosscheck.report.disagreements import Disagreements, Features
from crosscheck.report.measured import PICTURES, Documents, Pictures, Trends, measured
from crosscheck.report.totals import Coverage, Peers, ReferenceTotals, Refusals, Silent, Together
from crosscheck.scenes.names import decade

OWN_ROWS = ("residual", "jacobian", "constraint_velocity", "gamma")
ROWS, ANY = "rows", "any"
REFERENCE = "refkin"
MOST_FAILURES = 50
NO_DOCUMENTS: dict[str, Any] = {"newton_histories": [], "slopes": [], "documents": None, "iterations": []}
ROWS_MADE = {"seeding": "configuration", "newton_by": "none", "linear_solve_by": "none", "drift_by": "none"}
"""An engine's own rows are evaluated at a configuration that it is handed; nothing is solved."""


class Summary:
    """Adds up records; `described` gives the report."""

    def __init__(self, folder: Path) -> None:
        self.failures: list[str] = []
        self.run: dict[str, Any] = self._read(folder, "run.json", dict[str, Any]) or {}
        self.measured, faults = measured(folder)
        self.failures += faults
        self.outcome: NightOutcome | None = self._read(folder, OUTCOME, NightOutcome)
        self.golden: Golden | None = self._read(folder, GOLDEN, Golden)
        self.documents: Documents | None = self._read(folder, "documents.json", Documents)
        self.pictures: Pictures | None = self._read(folder, "pictures.json", Pictures)
        self.trends: Trends | None = self._read(folder, "trends.json", Trends)
        self.gaps = self.outcome.gaps if self.outcome else []
        self.keys: set[str] = set()
        self.runs: Counter[str] = Counter()
        self.repeated = self.configurations = self.without_result = self.reference_failures = 0
        self.cells: dict[tuple[str, str, str], Cell] = {}
        self.methods: dict[tuple[str, str], MethodTotals] = {}
        self.versions: dict[str, Counter[str]] = {}
        self.reference = ReferenceTotals()
        self.coverage, self.together, self.refusals = Coverage(), Together(), Refusals()
        self.peers, self.silent, self.features = Peers(), Silent(), Features()
        self.same_scenes = SameScenes()
        called_new = [*(self.golden.worse if self.golden else ()), *(self.outcome.new if self.outcome else ())]
        self.disagreements = Disagreements(folder, self.gaps, called_new)
        for line, record in read_records(folder / "records.jsonl"):
            self._add(line, record)
        for disagreement in self.disagreements.finish():
            self._blame({_blamed(disagreement): True})
        if len(self.runs) > 1:
            listed = ", ".join(f"{run!r} ({n})" for run, n in self.runs.most_common())
            self.failures.append(f"records.jsonl holds records of {len(self.runs)} runs: {listed}")
        held = set(self.failures)
        self.failures += [text for text in (self.outcome.failed if self.outcome else ()) if text not in held]

    def _read(self, folder: Path, name: str, kind: Any) -> Any:
        content, faults = read_file(folder / name, kind)
        self.failures += faults
        return content

    def _add(self, line: int, record: Record | Unreadable) -> None:
        if isinstance(record, Unreadable):
            self.failures.append(f"records.jsonl, line {line} is no record: {record.reason}")
            return
        if record.key in self.keys:
            self.repeated += 1
            return
        self.keys.add(record.key)
        self.runs[record.run] += 1
        place = RecordLine(record.key, record.scene, line)
        self.coverage.add(record.about, record.reference)
        self.together.add(record.about)
        self.features.add(record, place)
        of_methods = self.features.blame(self.disagreements.add(place, record))
        record = replace(record, answers=[answer for answer in record.answers if not answer.feature])
        if record.failure is not None:
            self.without_result += 1
            self.failures.append(f"{record.key}: {record.failure}")
        if record.reference is not None:
            self.reference.add(record.reference, place)
            self._add_answers(record, place, decade(record.reference.sigma_min))
        self.peers.add(record)
        self.refusals.add(record.refusals)
        blamed: dict[tuple[str, str, str], bool] = {}
        for disagreement, is_new in of_methods:
            who = _blamed(disagreement)
            blamed[who] = blamed.get(who, False) or is_new
            if disagreement.engine != REFERENCE and disagreement.quantity != "status":
                self._cell(*who).meet(disagreement.ratio, place, disagreement.at)
            self.silent.add(place, disagreement)
        self._blame(blamed)

    def _add_answers(self, record: Record, place: RecordLine, sigma_decade: int | None) -> None:
        self.same_scenes.add(record.answers)
        for answer in record.answers:
            engine, method = answer.engine, answer.method.name
            self.versions.setdefault(engine, Counter())[answer.version] += 1
            self.methods.setdefault((engine, method), MethodTotals(answer.method, answer.version)).add(
                answer, sigma_decade
            )
            for name, compared in answer.quantities.items():
                cell = self._cell(engine, method, name)
                cell.add(compared.digits_by_sigma, place)
                cell.compared += answer.compared
                cell.meet(compared.ratio, place, compared.worst)
        for row in record.levels:
            cell = self._cell(row.engine, ROWS, _quantity(row.level))
            cell.add({None: row.digits}, place)
            cell.meet(row.ratio, place, row.worst)

    def _cell(self, engine: str, method: str, quantity: str) -> Cell:
        return self.cells.setdefault((engine, method, quantity), Cell())

    def _blame(self, blamed: Mapping[tuple[str, str, str], bool]) -> None:
        """Count one scene's disagreements, each cell once, as new where one is; no answer counts in every cell."""
        counted: dict[tuple[str, str, str], bool] = {}
        for (engine, method, quantity), is_new in blamed.items():
            everywhere = quantity == "status" and method != ANY and engine != REFERENCE
            for name in SOLVED if everywhere else (quantity,):
                counted[engine, method, name] = counted.get((engine, method, name), False) or is_new
        for (engine, method, quantity), is_new in counted.items():
            if engine == REFERENCE:
                self.reference_failures += is_new
            else:
                cell = self._cell(engine, method, quantity)
                cell.failures += is_new
                cell.known_gaps += not is_new

    def described(self) -> dict[str, Any]:
        """Return the whole report.

        Digits under `engines` are of all scenes that a method answered; those to be set side by side are under
        `same_scenes`, since schema 3 (`crosscheck.report.alike`).
        """
        run = self.run
        versions = dict(self.outcome.versions if self.outcome else run.get("versions", {}))
        missing = dict(self.outcome.missing if self.outcome else run.get("missing", {}))
        engines = sorted({*versions, *(engine for engine, *_ in self.cells)} - {REFERENCE})
        answering = {engine for engine, _ in self.methods}
        met = {engine: ", ".join(sorted(seen)) for engine, seen in sorted(self.versions.items())}
        required = list(self.outcome.required if self.outcome else run.get("required", ()))
        asked: dict[str, Any] = {"required": required, "missing": missing, "answering": answering}
        new, hard = self.disagreements.new, Counter(r["engine"] for r in unexplained(self.measured["hard_cases"] or ()))
        peers = {*versions} - {REFERENCE, ALWAYS, *SAMPLED}
        how, why = verdict(**asked, peers=peers, new=new, hard=hard, failures=len(self.failures), scenes=len(self.keys))
        return {
            "schema": 3,
            "verdict": how,
            "why": why,
            "date": run.get("date"),
            "seed": run.get("seed"),
            "versions": {"refkin": run.get("refkin", "not known"), **met, **versions},
            "missing": missing,
            "required": required,
            "scenes": len(self.keys),
            "scenes_without_result": self.without_result,
            "configurations": self.reference.configurations,
            "new_disagreements": self.disagreements.new.total(),
            "known_disagreements": self.disagreements.known,
            "failures": self.failures[:MOST_FAILURES],
            "failures_total": len(self.failures),
            "notes": self._notes(versions, engines, answering),
            "reference": {**self.reference.described(), "failures": self.reference_failures},
            "rounding": {quantity: d.described_by_sigma() for quantity, d in self.peers.rounding.items()},
            "agreement": self.peers.agreement_described(),
            "poses": self._poses(),
            "engines": {engine: self._engine(engine) for engine in engines},
            "same_scenes": self.same_scenes.described(),
            "methods": [
                {"engine": e, "method": r, **t.described(), "silent": self.silent.of(e, r)}
                for (e, r), t in sorted(self.methods.items())
            ],
            "features": self.features.described(self.gaps),
            "golden": plain(self.golden) if self.golden else None,
            **self.measured,
            **(self.documents.model_dump() if self.documents else NO_DOCUMENTS),
            "trends": self.trends.model_dump() if self.trends else None,
            "disagreements": self.disagreements.described(),
            "known_gaps": [
                {
                    **{key: getattr(gap, key) for key in ("engine", "match", "predicate", "reason")},
                    "class": gap.kind_of_gap,
                    "date": gap.date.isoformat(),
                    "reproduction": gap.reproduction,
                    "disagreements": covered,
                }
                for gap, covered in zip(self.gaps, self.disagreements.covered, strict=True)
            ],
            "coverage": self.coverage.described(),
            "together": self.together.described(),
            "refusals": self.refusals.described(),
            "safety_factor": run.get("safety_factor"),
            "run": dict(run),
        }

    def _poses(self) -> dict[str, Any]:
        """Return the pictures of methods that have answers: of others the records were lost since they were drawn."""
        poses: dict[str, Any] = self.pictures.model_dump() if self.pictures else {**PICTURES}
        return {**poses, "marks": [m for m in poses["marks"] if (m["engine"], m["method"]) in self.methods]}

    def _engine(self, engine: str) -> dict[str, Any]:
        """Return {method: {quantity: numbers}}: every quantity under every method; what nobody answered is None."""
        seen = {r for e, r in self.methods if e == engine} | {r for e, r, _ in self.cells if e == engine}
        methods = sorted(seen - {ROWS, ANY}) or [ANY]
        of_methods: dict[str, Any] = {}
        for method in methods:
            made = self.methods.get((engine, method))
            who = {key: getattr(made.made, key) for key in ROWS_MADE} if made else dict.fromkeys(ROWS_MADE)
            speed = made.microseconds if made else {"microseconds_mean": None, "microseconds_median": None}
            unanswered = made.unanswered if made else 0
            of_methods[method] = {
                quantity: {**self._solved(engine, method, quantity), **who, "unanswered": unanswered, **speed}
                for quantity in SOLVED
            }
            for quantity in OWN_ROWS:
                cell = self.cells.get((engine, ROWS, quantity), Cell())
                of_methods[method][quantity] = {**cell.described(), **ROWS_MADE}
        return of_methods

    def _solved(self, engine: str, method: str, quantity: str) -> dict[str, Any]:
        """Return a cell, with the crashes and hangs, which count against every method of the engine."""
        cell = self.cells.get((engine, method, quantity), Cell()).described()
        everywhere = self.cells.get((engine, ANY, "status"), Cell())
        cell["failures"] += everywhere.failures
        cell["known_gaps"] += everywhere.known_gaps
        return cell

    def _notes(self, versions: Mapping[str, str], engines: Sequence[str], answering: set[str]) -> list[str]:
        notes = [f"{name} answered no scene" for name in engines if name not in answering]
        if answering and not {*engines} - {ALWAYS, *SAMPLED}:
            notes.append("no engine was asked: compared are our own sources alone")
        for engine, seen in sorted(self.versions.items()):
            if engine in versions and set(seen) != {versions[engine]}:
                listed = ", ".join(f"{v} ({n} answers)" for v, n in sorted(seen.items()))
                notes.append(f"{engine}: the run names version {versions[engine]}, its answers come from {listed}")
        if not self.run:
            notes.append("there is no run.json: seed, date and requirements are not known")
        if self.repeated:
            notes.append(f"{self.repeated} records of scenes that had one already were not counted")
        if self.outcome and self.outcome.known != self.disagreements.known:
            notes.append(
                f"the run counted {self.outcome.known} known disagreements, its records hold {self.disagreements.known}"
            )
        bare: Counter[str] = Counter()
        for (engine, _, quantity), cell in self.cells.items():
            bare[f"{engine} {quantity}"] += max(0, cell.compared - cell.digits.samples) if quantity in SOLVED else 0
        if bare.total():
            listed = ", ".join(f"{name} {count}" for name, count in sorted(bare.items()) if count)
            notes.append(f"compared configurations without a finite number of digits: {listed}")
        return notes


def _quantity(level: str) -> str:
    return "gamma" if level == "drift" else level


def _blamed(disagreement: Disagreement) -> tuple[str, str, str]:
    return disagreement.engine, disagreement.method, _quantity(disagreement.quantity)


def _by_engine(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in sorted(counts.items(), key=lambda item: (-item[1], item[0])))


PASS = "pass"
NEW_DISAGREEMENTS = "new disagreements"
INFRASTRUCTURE = "infrastructure"
ENGINE_MISSING = "engine missing"
NOTHING_RAN = "nothing ran"


def verdict(
    *,
    required: Collection[str],
    missing: Mapping[str, str],
    answering: Collection[str],
    peers: Collection[str] = (),
    new: Mapping[str, int],
    hard: Mapping[str, int] | None = None,
    failures: int,
    scenes: int,
) -> tuple[str, str]:
    """Return the verdict and the sentence that gives its reason.

    Parameters
    ----------
    required : collection of str
        Engines without which the night is worth nothing.
    missing : mapping
        Engines that could not be loaded -> why.
    answering : collection of str
        Engines that answered at least one scene.
    peers : collection of str
        Engines that were asked, our own sources aside.
    new, hard : mapping
        New disagreements, and what no finding explains at hard cases, by engine.
    failures, scenes : int
        Scenes without a result and other failures of the run; scenes with a record.
    """
    absent = lacking(required, missing, alone=not (peers or scenes))
    if absent:
        return ENGINE_MISSING, absent
    if new or hard:
        told = ["No known gap accounts for them. By engine: " + _by_engine(new)] if new else []
        told += ["No finding explains what is wrong, or ended, at hard cases: " + _by_engine(hard)] if hard else []
        return NEW_DISAGREEMENTS, "; ".join(told)
    if failures:
        return (
            INFRASTRUCTURE,
            f"{failures} failure{'s' * (failures > 1)} of the run itself; nothing new in what it checked",
        )
    if not scenes:
        return NOTHING_RAN, "There is no record of any scene"
    mute = [name for name in required if name not in answering]
    if mute:
        return ENGINE_MISSING, f"Required, and without an answer to any scene: {', '.join(mute)}"
    if peers and not {*peers} & {*answering}:
        return ENGINE_MISSING, f"No engine answered a scene: {', '.join(sorted(peers))}"
    without = f"; not compared, because missing: {', '.join(missing)}" if missing else ""
    return PASS, f"Every compared answer is within its derived budget, known gaps aside{without}"
