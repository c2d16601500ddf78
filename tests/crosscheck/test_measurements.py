"""What is made of made-up measurements is what it was: prices, tables of hard cases, effects, records, sentences.

As in `test_judgements.py`, whose way of keeping this is: timings are those of a clock that made-up methods set forward,
answers are the reference's, moved; what is another for joints an ulp away is not kept. Whoever means a change makes the
file anew, `python -m tests.crosscheck.test_measurements`, and says what changed.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crosscheck.engines import Term
from crosscheck.judge.agreement import assert_agrees
from crosscheck.judge.comparison import reference
from crosscheck.judge.hard_poses import samples, truths
from crosscheck.judge.records import line_of
from crosscheck.measure import check, conform
from crosscheck.scenes.hard import hard_cases
from refkin.errors import RefkinError
from refkin.model import Scene
from refkin.motion import Motion, Status, engine_motion
from refkin.scenes.files import load
from tests.crosscheck.made_up_engines import PARTS, Made, by, made, on_record, without
from tests.crosscheck.made_up_tables import (
    Shake,
    classes_of_answers,
    conforming,
    handed,
    of_effects,
    of_workloads,
    prices,
    ranking,
)
from tests.crosscheck.test_judgements import MAKER, MOVED, differences, moved, plain, same, shaken, some
from tests.kept import on_every_processor, read, write
from tests.refkin.test_answers import files

FILE = Path(__file__).with_name("measurements.json")
CHECKED = ("crank-rocker", "rssr", "singular-in-the-end", "unassemblable-but-assembled")
HARD = {case.case: case for case in reversed(hard_cases())}


def hard(shake: Shake, name: str) -> Any:
    """Return the least error in a hard case, and what is said of answers that are near it and that are not."""
    case = HARD[name]
    case = replace(case, scene=replace(shake(case.scene), times=case.scene.times[:2]))
    system, truth = truths(case)
    said: list[Any] = [[len(t.roots), t.gap, [radius for _, radius in t.roots][:2]] for t in truth]
    middle = [[float(x) for x in t.roots[0][0]] if t.roots else np.full(system.n, 0.5) for t in truth]
    q = system.to_physical(np.array(middle).T)[: system.of_bodies]
    for part, term in product((0.0, 1e-9, MOVED), (0.0, 1e-7)):
        off = part * np.cos(np.arange(q.size)).reshape(q.shape)
        terms = [Term(name="", level=level, reason="", absolute=term) for level in ("position", "velocity")]
        status = (Status.OK, Status.SINGULAR) if part else (Status.OK, Status.OK)
        answer = _motion(case.scene, q + off, status)
        found = samples(system, truth, case.scene, answer, terms)
        said.append([[s.called_ok, s.note, s.none, s.judgement and asdict(s.judgement)] for s in found])
    return said


def _motion(scene: Scene, q: Any, status: tuple[Status, ...]) -> Motion:
    bodies = tuple(body.name for body in scene.mechanism.bodies)
    return engine_motion(np.array(scene.times), bodies, q, None, None, status, MAKER)


def checked(shake: Shake, name: str, part: int) -> Any:
    """Return the record of a scene and of some engines, each wrong in a way of its own."""
    scene = shake(some(load(files()[name]), 4))
    with on_record():
        record = check.check(
            scene, list(made())[part::PARTS], {"expected": "ok", "of_features": True}, arbiter=part == 1
        )
        plainly = check.check(replace(scene, evidence=frozenset()), [Made("positions", by(1e-6))] if not part else [])
    back = json.loads(line_of(record))
    for answer in back["answers"]:
        del answer["seconds"]
    del back["reference"]["seconds"]
    shown = [str(d) for d in (*record.disagreements, *record.refusals)]
    faults = [asdict(fault) for fault in conform._faults_of(record, scene)]
    return [back, shown, [d.signature for d in plainly.disagreements], faults]


def asserted(shake: Shake, name: str) -> Any:
    """Return what a test of an own solver is told of answers that are off."""
    scene = shake(some(load(files()[name])))
    ref = reference(scene)
    body = ref.motion[ref.motion.bodies[-1]]
    first, rate = ref.motion.kind.coordinates[0], ref.motion.kind.coordinates[1] + "d"
    told = []
    answers: list[Any] = [moved(ref), moved(ref, fewer=True), by(1e-6, "qdd")(ref.motion), without(ref.motion), {}]
    answers += [{ref.motion.bodies[-1]: {first: body.q[0] + x, rate: body.qd[1]}} for x in (0.0, 1e-6, np.nan)]
    answers += [{ref.motion.bodies[-1]: {"no": body.q[0]}}, {ref.motion.bodies[-1]: {first: body.q[0][1:]}}]
    for answer, residual in product(answers, (0.0, 1e-5)):
        try:
            assert_agrees(answer, scene, residual=residual)
            told.append("")
        except (AssertionError, RefkinError) as error:
            told.append(f"{type(error).__name__}: {error}")
    return told


def answered(part: int) -> Any:
    """Return what is said of some engines that are asked a question."""
    question = list(conform._asked().values())[2 * part]
    with on_record():
        replies = [conform.ask(engine, question) for engine in list(made())[part::PARTS]]
    return [[asdict(reply), reply.answered] for reply in replies]


OF_SCENES: dict[str, tuple[Callable[[Shake, str], Any], Any]] = {
    "assert": (asserted, ("crank-rocker", "rssr", "singular-in-the-end")),
    "hard": (hard, HARD),
    "effects": (of_effects, ("crank-rocker",)),
}
MEASURED: dict[str, Callable[[Shake], Any]] = {
    **{
        f"{kind}: {name}": partial(function, name=name)
        for kind, (function, names) in OF_SCENES.items()
        for name in names
    },
    **{
        f"prices within {x:g}": partial(prices, within=x, unlike=y)
        for x, y in ((1e6, 1.0), (80.0, 3.0), (40.0, 2.0), (20.0, 1.0))
    },
    **{f"check: {x}, {k}": partial(checked, name=x, part=k) for x, k in product(CHECKED, range(PARTS))},
    **{f"conform: {k}": lambda shake, k=k: answered(k) for k in range(PARTS)},
    "workloads": of_workloads,
    "ranking": lambda shake: ranking(),
    "classes": lambda shake: classes_of_answers(),
    "conform": lambda shake: conforming(),
    "handed": handed,
}
KEPT = read(FILE)


@pytest.mark.parametrize("name", KEPT)
def test_what_is_measured_is_what_it_was(name: str) -> None:
    assert sorted(differences(plain(MEASURED[name](lambda scene: scene)), KEPT[name])) == []


if __name__ == "__main__":
    if "--print" in sys.argv:
        shakes = (lambda scene: scene, shaken)
        print(json.dumps({name: same(*(plain(one(shake)) for shake in shakes)) for name, one in MEASURED.items()}))
    else:
        write(FILE, on_every_processor("tests.crosscheck.test_measurements"))
