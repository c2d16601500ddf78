"""The golden set: a few fixed scenes, the answers of the reference, and the correct digits of each engine.

It is data (`reports/baseline.json`, scenes included) that only an explicit command changes. Scenes that are new every
night cannot tell a loss of accuracy from bad luck; these can, case by case:

* the reference must stay within its proved radius: of two answers whose certified radii do not overlap one is wrong;
* an engine may not lose more than half a digit, in the worst sample or in the median, where its error is larger than
  one evaluation of the formulas in float64 may leave. That is what is allowed without the safety factor
  (`crosscheck.judge.budget`); below it another order of operations, or another start of a Newton iteration, moves a
  worst sample by a digit and more, and says nothing about the engine. What an engine allows itself by a term of its own
  counts as error here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.judge.records import QUANTITIES, By, Cause, Disagreement, NewCase, Record, adapter
from crosscheck.judge.rounding import SAFETY
from crosscheck.night.baseline import read_baseline, scenes_of
from crosscheck.night.disagreements import FOLDER, slug
from crosscheck.night.plan import GOLDEN, Golden, replace_file
from crosscheck.scenes.conformance import questions
from crosscheck.workers.pool import Pool
from refkin.model import Scene
from refkin.motion import Motion
from refkin.motion_laws import Polynomial, Sinusoid
from refkin.scenes.files import parse, to_dict, to_toml
from refkin.scenes.linkages import FourBar, InvertedSliderCrank, SliderCrank
from refkin.solving.solve import solve

LOST = 0.5
"""Digits that an engine may lose in a case."""
PLAIN = (
    *(
        "internal gear",
        "gear on a carrier",
        "rack on the other side",
        "cam: roller on a disc",
        "cam: flat on a profile",
    ),
    *("x of a point driven", "distance driven", "revolute with an offset by a law"),
    *("space: revolute", "space: distance", "space: prismatic", "space: universal", "space: point_on_plane"),
    *("space: screw", "space: gear, bevel wheels", "space: displacement driven", "space: distance driven"),
)
"""Plain mechanisms (`questions`) of all joints and drivers that no linkage has. Where an engine refuses what its table
has, drawn scenes excuse it as long as it answers any: only one that it has answered before tells what it has lost."""
LUCK = 1 / SAFETY
"""The part of what is allowed that one evaluation of the formulas may leave: the budget covers SAFETY of them."""

Case = Mapping[str, Any]
"""Of the baseline, or as `measure` returns it, as plain data."""


def golden_scenes() -> dict[str, Scene]:
    """Return the scenes by name: linkages, both branches, and the hard places on purpose; then the `PLAIN` ones."""
    rocker = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
    toggle = FourBar(ground=90.0, crank=30.0, coupler=60.0, rocker=45.0)
    limit = toggle.input_range()[0][1]
    swing = Sinusoid(offset=0.9 * limit, amplitude=0.1 * limit * (1 - 1e-6), angular_frequency=1.0, phase=0.0)
    slow = Polynomial(coefficients=(0.3, 1.0, 0.25))
    five = (0.0, 0.4, 0.9, 1.5, 2.2)
    return {
        "crank-rocker open": rocker.scene(samples=7),
        "crank-rocker crossed": rocker.scene(samples=7, branch="crossed"),
        "crank-rocker accelerating": rocker.scene(law=slow, times=five),
        "double crank": FourBar(ground=1.0, crank=3.0, coupler=2.5, rocker=2.0).scene(samples=7),
        "near a change point": FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + 1e-6).scene(samples=7),
        "near a limit position": toggle.scene(law=swing, times=(0.0, 0.5, 1.0, 1.5, math.pi / 2)),
        "a billionth of a metre": FourBar(ground=4e-9, crank=1e-9, coupler=3.5e-9, rocker=3e-9).scene(samples=5),
        "slider-crank": SliderCrank(crank=1.0, rod=3.0).scene(samples=7),
        "slider-crank with a large offset": SliderCrank(crank=1.0, rod=3.0, offset=1.9).scene(samples=7),
        "inverted slider-crank": InvertedSliderCrank(ground=2.0, crank=0.75).scene(samples=7),
        **{question.about: question.scene for question in questions() if question.about in PLAIN},
    }


def measure(scenes: Mapping[str, Scene], workers: Pool, engines: Sequence[str]) -> dict[str, Case]:
    """Return scene, reference, the digits that rounding leaves and those of every method, by the name of the case.

    Parameters
    ----------
    scenes : mapping
        Name of the case -> Scene.
    workers : Pool
    engines : sequence of str
        Names.
    """
    for name, scene in scenes.items():
        workers.submit([{"scene": to_dict(scene), "about": {"golden": name}}], engines)
    records: dict[str, Record] = {}
    while workers.pending:
        for record in workers.results():
            records[str(record.about["golden"])] = record
    return {
        name: {"scene": to_dict(scene), "reference": _reference(solve(scene)), **_measured(records[name])}
        for name, scene in scenes.items()
    }


def _reference(motion: Motion) -> dict[str, Any]:
    """Return the reference's answer with its proof, every number as it is."""
    radius = motion.certified_radius
    levels = dict(zip(QUANTITIES, motion.levels, strict=True))
    return {
        "status": [s.value for s in motion.status],
        **{q: None if level is None else _plain(level.T) for q, level in levels.items()},
        "certified_radius": {q: _plain(getattr(radius, q)) for q in QUANTITIES},
    }


def _plain(values: Any) -> Any:
    return [_plain(row) for row in values] if np.ndim(values) else (float(values) if np.isfinite(values) else None)


def _measured(record: Record) -> dict[str, Any]:
    """Return the digits {quantity: [median, worst]} that rounding leaves to one evaluation, and those of each method.

    A quantity without a digit is None; a method has its largest error / allowed as well.
    """
    left = record.reference.rounding_by_sigma if record.reference else {}
    methods: dict[str, dict[str, Any]] = {}
    for answer in record.answers:
        methods.setdefault(answer.engine, {})[answer.method.name] = {
            "missing": answer.missing,
            "ratio": {name: q.ratio for name, q in answer.quantities.items()},
            **{name: _digits(q.digits_by_sigma) for name, q in answer.quantities.items()},
        }
    return {"rounding": {name: _digits(left.get(name, {})) for name in QUANTITIES}, "methods": methods}


def _digits(by_sigma: By) -> list[float] | None:
    kept = sorted(d / 10 for histogram in by_sigma.values() for d, count in histogram.items() for _ in range(count))
    return [kept[(len(kept) - 1) // 2], kept[0]] if kept else None


def differences(before: Mapping[str, Case], now: Mapping[str, Case], engines: Iterable[str]) -> list[NewCase]:
    """Return what is worse now, one entry per case and quantity, as a disagreement of a night.

    Parameters
    ----------
    before, now : mapping
        Name -> case, as `measure` returns them.
    engines : iterable of str
        Those that were asked now; what others did before is not compared.
    """
    worse = []
    for name, case in before.items():
        lost = [*_reference_changed(case, now[name])]
        for engine, methods in case["methods"].items():
            there = now[name]["methods"].get(engine, {})
            for method, digits in methods.items() if engine in engines else ():
                lost += _digits_lost(engine, method, digits, there.get(method), case["rounding"])
        worse += [NewCase(disagreement=disagreement, key=f"golden-{slug(name)}", case=name) for disagreement in lost]
    return worse


def _reference_changed(before: Case, now: Case) -> Iterator[Disagreement]:
    """Yield where two answers of the reference prove each other wrong."""
    who: dict[str, Any] = {"engine": "refkin", "method": "newton", "kind": Cause.LEFT_PROOF}
    old, new = before["reference"], now["reference"]
    if old["status"] != new["status"]:
        became = f"{' '.join(old['status'])} became {' '.join(new['status'])}"
        yield Disagreement(**who, quantity="status", message=became)
        return
    mechanism = parse(dict(before["scene"])).mechanism
    units = [mechanism.size() if k < mechanism.kind.dimension else 1.0 for k in range(mechanism.kind.width)]
    for quantity in QUANTITIES:
        a, b = (np.array(case[quantity] or [], float) for case in (old, new))
        if a.shape != b.shape:
            yield Disagreement(**who, quantity=quantity, message=f"{a.shape} numbers became {b.shape}")
        elif a.size:
            radius = sum(np.array(case["certified_radius"][quantity], float)[:, None] for case in (old, new))
            scale = np.tile(units, a.shape[1] // len(units))
            allowed = scale * radius + 4 * 2.0**-53 * np.abs(a)  # handed over in metres: rounded once more on each side
            if not np.all((np.abs(a - b) <= allowed) | (a == b) | (np.isnan(a) & np.isnan(b))):
                apart = f"apart by up to {np.nanmax(np.abs(a - b)):.2g}"
                yield Disagreement(**who, quantity=quantity, message=apart)


def _digits_lost(
    engine: str, method: str, before: Case, now: Case | None, rounding: Mapping[str, Sequence[float] | None]
) -> Iterator[Disagreement]:
    """Yield the quantities in which a method is worse than it was, and than rounding alone may make it."""
    who: dict[str, Any] = {"engine": engine, "method": method, "kind": Cause.DIGITS_LOST}
    if now is None or now["missing"] > before["missing"]:
        yield Disagreement(**who, quantity="status", message="no answer any more")
        return
    for quantity in QUANTITIES:
        old, new = before.get(quantity), now.get(quantity)
        if old is None:
            continue
        # The digits of a case hold an engine to rounding, whatever terms of its own it has. Its ratio is taken sample
        # by sample, and also tells where the digits of the sample that is hardest would hide the others.
        beyond = (now["ratio"].get(quantity) or 0.0) > LUCK
        if new is None or any(
            a - b > LOST and (beyond or b < least)
            for a, b, least in zip(old, new, rounding[quantity] or new, strict=True)
        ):
            digits_now = "none" if new is None else f"{new[0]:.1f} / {new[1]:.1f}"
            became = f"digits {old[0]:.1f} / {old[1]:.1f} became {digits_now}"
            yield Disagreement(**who, quantity=quantity, message=became)


def compare_night(path: Path, out: Path, workers: Pool) -> list[NewCase]:
    """Compare the golden set, leave `golden.json` and scene files in `out`, return what is worse.

    Parameters
    ----------
    path : Path
        The baseline.
    out : Path
        Folder of the night.
    workers : Pool
    """
    baseline = read_baseline(path)
    cases = baseline["cases"]
    known, scenes = {engine for case in cases.values() for engine in case["methods"]}, scenes_of(cases)
    engines = [name for name in workers.engines if name in known]
    comparison = Golden(
        cases=len(scenes),
        versions=baseline["versions"],
        engines=engines,
        without=[name for name in workers.engines if name not in known],
        worse=differences(cases, measure(scenes, workers, engines), engines),
    )
    for worse in comparison.worse:
        worse.file = f"{FOLDER}/{worse.key}.toml"
        (out / FOLDER).mkdir(parents=True, exist_ok=True)
        replace_file(out / worse.file, to_toml(parse(dict(cases[worse.case]["scene"]))))
    replace_file(out / GOLDEN, adapter(Golden).dump_json(comparison, indent=1).decode() + "\n")
    return comparison.worse
