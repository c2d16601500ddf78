"""Records of a run as the tests of the report plant them, with the raw samples beside their histograms; priced rows."""

from __future__ import annotations

import datetime
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.judge.known_gaps import KnownGap
from crosscheck.judge.prices import EffectRow, PriceRow
from crosscheck.judge.records import At, Cause, Disagreement, NewCase, Record, plain, read_file, read_line
from crosscheck.night.plan import NightOutcome, write_outcome
from crosscheck.report.build import build

ROUTES = {"pinocchio": "joint tree", "mujoco": "newton", "exudyn": "static newton"}
WHO = {
    "residual_by": "the engine",
    "jacobian_by": "the engine",
    "newton_by": "adapter",
    "linear_solve_by": "numpy",
    "drift_by": "the engine",
    "seeding": "initial_guess",
}
QUANTITIES = ("position", "velocity", "acceleration")


def floored(digits: Any) -> Any:
    """Return digits rounded down to a tenth, by decimal text: what a record's histogram keeps of them."""
    return np.array([float(f"{math.floor(d * 10) / 10:.1f}") for d in digits])


def histogram(digits: Any) -> dict[str, int]:
    counts: dict[str, int] = {}
    for value in floored(digits):
        counts[f"{value * 10:.0f}"] = counts.get(f"{value * 10:.0f}", 0) + 1
    return counts


AT = At("rocker.phi", 1.25)


def quantity(samples: Mapping[int, Any], ratio: float | None = 0.5, worst: At | None = AT) -> Any:
    """Return a quantity from samples of digits by decade of sigma_min."""
    digits = {str(d): histogram(v) for d, v in samples.items()}
    return {"ratio": ratio, "worst": plain(worst) if worst else None, "digits_by_sigma": digits}


def key(name: str) -> str:
    """Return a key that is told from others by a name."""
    return name.encode().hex().rjust(16, "0")[-16:]


def answer(engine: str, quantities: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    fields = {
        "engine": engine,
        "version": "1.0",
        "method": {"name": ROUTES[engine], **WHO},
        "quantities": quantities,
        "missing": 0,
        "compared": 4,
        "times": 4,
        "seconds": 0.0004,
    }
    return {**fields, **more}


def good_answer(engine: str, **more: Any) -> dict[str, Any]:
    return answer(engine, {name: quantity({-1: [15.0, 15.5, 16.0, 14.0]}) for name in QUANTITIES}, **more)


def level(engine: str, name: str, digits: Any = (15.0, 15.5), ratio: float = 0.25) -> dict[str, Any]:
    return {"engine": engine, "level": name, "ratio": ratio, "digits": histogram(digits), "rows": 8}


def record(name: str, *answers: Any, **more: Any) -> dict[str, Any]:
    fields = {
        "key": key(name),
        "scene": f"scene {name}",
        "about": {"kind": "four_bar", "grashof": "crank-rocker", "branch": "open", "distance": 0.02, "shard": 0},
        "reference": {
            "verdict": "ok",
            "message": "",
            "statuses": {"ok": 4},
            "sigma_min": 0.2,
            "residual": 1e-16,
            "certified_radius": {"position": None, "velocity": None, "acceleration": None},
            "seconds": 0.002,
        },
        "answers": list(answers),
        "levels": [],
        "refusals": [],
        "disagreements": [],
    }
    return {**fields, **more}


def typed(data: Mapping[str, Any]) -> Record:
    """Return a planted record as it is read back."""
    return read_line(json.dumps(data))


def failed_record(name: str) -> dict[str, Any]:
    """Return the record of a scene that no worker brought to an end, as the workers write it."""
    bare = record(name)
    return {**{k: v for k, v in bare.items() if k != "reference"}, "failure": "the reference itself: hang"}


def disagreement(engine: str = "mujoco", quantity: str = "velocity", **more: Any) -> dict[str, Any]:
    """Return a disagreement as a record holds it."""
    fields = {"engine": engine, "method": ROUTES[engine], "quantity": quantity, "kind": Cause.BEYOND, "ratio": 3.5}
    return plain(Disagreement(**{**fields, "at": At("rocker.phi", 0.5), **more}))


def case(wrong: Mapping[str, Any], name: str = "a", **more: Any) -> NewCase:
    """Return what a run calls new of a planted disagreement."""
    at = At(**wrong["at"]) if wrong["at"] else None
    return NewCase(
        disagreement=Disagreement(**{**wrong, "kind": Cause(wrong["kind"]), "at": at}), key=key(name), **more
    )


def built(folder: Path, ended: NightOutcome | None = None, gaps: Sequence[KnownGap] = ()) -> Path:
    """Write how a run ended, and its report."""
    value = ended or NightOutcome(**versions_of(folder))
    write_outcome(folder, replace(value, gaps=list(gaps)))
    return build(folder)


def versions_of(folder: Path) -> Any:
    """Return which engines the run in a folder had, and lacked, and which it required."""
    run = read_file(folder / "run.json", dict[str, Any])[0] or {}
    return {name: run.get(name, empty) for name, empty in (("versions", {}), ("missing", {}), ("required", []))}


def write(
    folder: Path, *records: Any, required: tuple[str, ...] = (), missing: Mapping[str, str] | None = None
) -> Path:
    """Write a run's folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "records.jsonl").write_text("".join(json.dumps(r) + "\n" for r in records), encoding="utf-8")
    engines = sorted({a["engine"] for r in records for a in r["answers"]})
    run = {
        "seed": 42,
        "engines": engines,
        "required": list(required),
        "scenes": len(records),
        "minutes": None,
        "versions": dict.fromkeys(engines, "1.0"),
        "missing": dict(missing or {}),
        "date": "2026-11-21 02:17",
    }
    (folder / "run.json").write_text(json.dumps(run), encoding="utf-8")
    return folder


def outcome(**more: Any) -> NightOutcome:
    return NightOutcome(**{"versions": {"mujoco": "1.0"}, "missing": {}, "checked": 1, **more})


def gap(**match: str) -> KnownGap:
    fields = {
        "engine": "mujoco",
        "predicate": "anywhere",
        "reason": "soft constraints",
        "kind_of_gap": "documented limit",
    }
    return KnownGap(**fields, date=datetime.date(2026, 11, 20), reproduction="tests/corpus/a.toml", **match)


def of_run(folder: Path, *records: Any, **files: Any) -> tuple[Any, str]:
    """Return the report and the page of a run with files beside its records."""
    write(folder, *records)
    for name, rows in files.items():
        (folder / f"{name}.json").write_text(json.dumps(rows), encoding="utf-8")
    page = build(folder).read_text(encoding="utf-8")
    return json.loads((folder / "report.json").read_text(encoding="utf-8")), page


def price_row(**more: Any) -> PriceRow:
    """Return a row of a price list."""
    who = {"engine": "made up", "method": "newton", "setting": "-", "quantity": "position", "newton_by": "nobody"}
    return PriceRow(**{**who, "digits": 9.0, "digits_attainable": 15.0, "microseconds": 5.0, "spread": 0.1, **more})


def effect_row(effect: str, **more: Any) -> EffectRow:
    """Return a row of a ledger of effects."""
    who: Any = {"engine": "made up", "method": "newton", "setting": "", "effect": effect, "called_for": False}
    return EffectRow(**{**who, "microseconds": 3.0, "without": 10.0, "spread": 1.0, "inert": True, **more})
