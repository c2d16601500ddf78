"""What the judge makes of made-up answers is what it was: budgets, comparisons, own rows, truths, what is owed.

The answers are the reference's, moved by a thousandth of what they are, so that no number hangs on rounding; what is
another for joints an ulp away is not kept. As with `tests/refkin/test_answers.py`, whoever means a change makes the
file anew, `python -m tests.crosscheck.test_judgements`, and says what changed.
"""

from __future__ import annotations

import json
import random
import sys
from contextlib import suppress
from dataclasses import asdict, replace
from itertools import cycle
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from crosscheck.engines import ELEMENTS, NATIVE, QUANTITIES, Level, Term
from crosscheck.engines.frames import Length, Linear, RowMap, SineRow
from crosscheck.judge import delivery, hard_poses, uncompared
from crosscheck.judge.changes import change
from crosscheck.judge.comparison import Reference, compare, reference
from crosscheck.judge.hard_poses import samples, scene_truths
from crosscheck.judge.levels import Configuration, compare_levels, configurations, missing_rows
from crosscheck.judge.samples import nudged, quantities, reference_row
from crosscheck.judge.truth import CertifiedTruth, NoTruth, attainable_levels
from crosscheck.judge.violations import violations
from crosscheck.measure.check import estimated
from refkin.joints import elements_of
from refkin.model import Scene
from refkin.motion import CertifiedRadius, Motion, Producer, Route, Seeding, Status, engine_motion
from refkin.scenes.files import load
from tests.kept import differences, on_every_processor, plain, read, same, write
from tests.linkages import without_estimates
from tests.refkin.test_answers import files

FILE = Path(__file__).with_name("judgements.json")
SCENES = (
    *("crank-rocker", "slider-crank", "cam", "gear", "rack_and_pinion", "x-driver", "far-from-origin"),
    *("distance-through-zero", "exudyn-shipped-distance-driver", "features-branching-tree", "massless-link-near-limit"),
    *("redundant-16-ulp", "singular-in-the-end", "slider-turned-1e4-rad", "unassemblable-but-assembled"),
    *("rssr", "spatial-screw", "spatial-fixed", "spatial-displacement-driver", "space-stopped-a-correction-early"),
)
AT = 3
"""Times of each scene, at most."""
MOVED = 1e-3
TERMS = (
    (),
    (Term(name="left", level="position", reason="made up", absolute=1e-11, relative=0.5),),
    (
        Term(name="of rates", level="velocity", reason="made up", absolute=1e-10, of_rates=1e-11),
        Term(name="of accelerations", level="acceleration", reason="made up", relative=1e-9, of_rates=1e-12),
        Term(name="of rows", level="drift", reason="made up", absolute=1.0),
    ),
)
IN_FORM = (Term(name="stopping rule", level="position", reason="made up", absolute=1e-9, form="dot"),)
ROUTE = Route(
    name="made up",
    residual_by="a",
    jacobian_by="b",
    newton_by="c",
    linear_solve_by="d",
    drift_by="e",
    seeding=Seeding.NONE,
)
MAKER = Producer(name="made up", version="1", route=ROUTE)
WEIGHTS = np.cos(np.arange(1000.0))


def some(scene: Scene, count: int = AT) -> Scene:
    """Return a scene at some of its times."""
    places = np.unique(np.linspace(0, len(scene.times) - 1, count).round().astype(int))
    return replace(scene, times=tuple(scene.times[k] for k in places))


def known(ref: Reference) -> Reference:
    """Return a reference whose radii hang on no rounding: nothing, none, and a small one."""
    size = np.resize([1e-15, 0.0, np.nan], len(ref.motion.t))
    radius = CertifiedRadius(position=size, velocity=10.0 * size, acceleration=100.0 * size)
    return replace(ref, motion=replace(ref.motion, certified_radius=radius), _budgets={})


def moved(ref: Reference, *, by: float = MOVED, fewer: bool = False) -> Motion:
    """Return the reference's answer with all numbers moved; or with the bodies in another order, one of them away."""
    kind, size = ref.motion.kind, ref.system.unit.size
    bodies = ref.motion.bodies[::-1][: -1 if fewer and len(ref.motion.bodies) > 2 else None]
    length = np.resize([1.0] * kind.dimension + [0.0] * (kind.width - kind.dimension), kind.width * len(bodies)) == 1.0
    levels = []
    for order, name in enumerate(("q", "qd", "qdd")):
        level = np.concatenate([getattr(ref.motion[body], name) for body in bodies])
        there = np.nan_to_num(np.abs(level)).max(axis=0, initial=1.0) if order else 1.0
        scale = np.where(length, size if not order else 1.0, 1.0)[:, None] * there
        k, at = np.indices(level.shape)
        levels.append(np.nan_to_num(level) + by * scale * np.cos(7.0 * k + 3.0 * at + order))
    status = [Status.OK] * len(ref.motion.t)
    if fewer:
        status[-1] = Status.NOT_CONVERGED
        levels[1][0, 0] = np.nan
    return engine_motion(
        ref.motion.t, bodies, *levels[: 2 if fewer else 3], *([None] if fewer else []), tuple(status), MAKER
    )


def summed(level: Any) -> Any:
    """Return sums over the rows with weights that nothing cancels, time by time."""
    return WEIGHTS[: len(level)] @ level


class Rows:
    """Rows that are ours in another form, order and sign, all of them moved by a thousandth."""

    form, owns_driver = "", True

    def __init__(self, at: Configuration) -> None:
        self.ours = at.in_form("")[1]
        far = 4.0 * max(1.0, *np.abs(self.ours[Level.RESIDUAL][0]).tolist())
        forms, factors = cycle((Linear(), Length(length=far), SineRow())), cycle((1.0, -2.0, 0.5, 3.0))
        first, last = {p.constraint.name: p.row for p in at.in_form("")[0].placed}, at.in_form("")[0].m - 1
        places = [(e.name, e.row + k) for e in elements_of(at.mechanism.constraints) for k in range(e.rows)]
        of_places = ({"constraint": name, "row": k, "engine_row": last - first[name] - k} for name, k in places)
        self.rows = [RowMap(**place, form=next(forms), factor=next(factors)) for place in of_places][1:]

    def _moved(self, values: Any) -> Any:
        return 1.001 * np.asarray(values, float)[::-1] + MOVED

    def residual(self, q: Any, t: float) -> Any:
        return self._moved(self.ours[Level.RESIDUAL][0])

    def jacobian(self, q: Any, t: float) -> Any:
        return self._moved(self.ours[Level.JACOBIAN][0])

    def constraint_velocity(self, q: Any, qd: Any, t: float) -> Any:
        return self._moved(self.ours[Level.CONSTRAINT_VELOCITY][0])

    def drift(self, q: Any, qd: Any, t: float) -> Any:
        return self._moved(self.ours[Level.DRIFT][0])


def judged(scene: Scene) -> dict[str, Any]:
    """Return what the judge says of a scene and of made-up answers to it."""
    scene = some(scene)
    truth = None
    with suppress(NoTruth):
        truth = CertifiedTruth(scene)
    ref = known(reference(scene) if truth is None else truth.ref)
    off, few = moved(ref), moved(ref, fewer=True)
    said: dict[str, Any] = {
        "estimates": [body.estimate for body in estimated(without_estimates(scene), ref).mechanism.bodies],
        "common": ref.common and asdict(ref.common),
        "decades": ref.decades,
        "row": [reference_row(ref, 0.0).sigma_per_step, reference_row(ref, 0.0).rounding_by_sigma],
        "budgets": [budget(ref, terms) for terms in (*TERMS, *([IN_FORM] if ref.motion.kind.width == 7 else []))],
        "compared": [compared(ref, motion, terms) for motion in (off, few) for terms in TERMS[:2]],
        "part": compared(
            ref,
            engine_motion(off.t[-1:], off.bodies, *(x[:, -1:] for x in off.levels), off.status[-1:], MAKER),
            (),
            [-1],
        ),
        "owed": owed(ref, scene, off, few),
        "changed": [
            asdict(change(ref, ref.motion, motion, TERMS[1], exact=exact))
            for motion, exact in ((off, True), (few, False))
        ],
    }
    if truth is not None:
        truth.ref = ref
        levels = [np.concatenate([getattr(off[body], name) for body in truth.bodies]) for name in ("q", "qd", "qdd")]
        said["attainable"] = [truth.attainable, [summed(move) for move, _ in attainable_levels(ref, truth.known)]]
        wide = np.full(len(ref.motion.t), 1e-5)
        radius = CertifiedRadius(position=wide, velocity=wide, acceleration=wide)
        less = CertifiedTruth.__new__(CertifiedTruth)
        vars(less).update(vars(truth), ref=replace(ref, motion=replace(ref.motion, certified_radius=radius)))
        exact = [
            np.concatenate([getattr(ref.motion[body], name) for body in truth.bodies]) for name in ("q", "qd", "qdd")
        ]
        said["digits"] = [
            [x.digits(level, order, of[:order]) for order, level in enumerate(of)]
            for x, of in ((truth, levels), (less, exact))
        ]
        with patch.object(hard_poses, "residual_error", lambda system, *_: np.full(system.m, MOVED)):
            poses = zip(ref.levels[0].T[truth.known], ref.motion.t[truth.known], strict=True)
            said["least"] = [summed(hard_poses.least_error(ref.system, q, t)) for q, t in poses]
        said["held"] = [
            (s.called_ok, s.note, s.judgement and asdict(s.judgement))
            for s in samples(ref.system, scene_truths(ref), ref.scene, off, TERMS[1])
        ]
        near = ref.system.to_physical(ref.levels[0][:, truth.known])
        at = configurations(scene.mechanism, near, ref.motion.t[truth.known], scene.name, 2)
        said["rows"] = own_rows(scene, at)
    return plain(said)


def budget(ref: Reference, terms: Any) -> Any:
    allowed = ref.budget(terms)
    return [allowed.compared, [summed(level) for level in allowed.levels]]


def compared(ref: Reference, motion: Motion, terms: Any, at: Any = slice(None)) -> Any:
    result = compare(ref, motion, terms, at)
    numbers = {
        name: [q.error, q.ratio, q.digits, q.worst and asdict(q.worst), np.nansum(q.difference), q.agrees]
        for name, q in result.quantities.items()
    }
    kept = (
        {name: [q.ratio, q.digits_by_sigma, q.common] for name, q in quantities(ref, result).items()}
        if isinstance(at, slice)
        else {}
    )
    return [numbers, kept, result.missing, result.compared, result.other_assembly, result.first_missing, result.agrees]


def owed(ref: Reference, scene: Scene, off: Motion, few: Motion) -> Any:
    """Return what is said of answers that are not what was asked for, and which joints they violate."""
    wrong_way, at = uncompared.put_together_wrongly(scene, off)
    faults = [
        *delivery.undelivered(QUANTITIES, scene, few),
        *uncompared.believed(ref, off),
        *uncompared.Uncompared(ref, off, TERMS[1]).unclosed(),
        *wrong_way,
    ]
    terms = (*TERMS[1], *TERMS[2], Term(name="stopping rule", level="position", reason="", absolute=1e-8), *IN_FORM)
    judged = np.flatnonzero(ref.budget().compared)
    broken = [violations(ref, off, order, off.t[k]) for k in judged[:1] for order in range(3)]
    allowed, undocumented = delivery.granted("exudyn", scene, terms)
    cut = replace(few, t=few.t + 1.0, status=few.status[1:], q=few.q[1:], bodies=("nobody", *few.bodies[1:]))
    shape = [*delivery.misshapen(scene, off), *delivery.misshapen(scene, cut), *delivery.misshapen(scene, 1)]
    pose = delivery.excuse(ref, float(off.t[-1]), 100.0) if judged.size else None
    return [faults, at, [asdict(v) for v in broken], [term.name for term in allowed], undocumented, shape, pose]


def own_rows(scene: Scene, at: list[Configuration]) -> Any:
    """Return the comparison of made-up rows at each configuration, and which are missing."""
    engine = SimpleNamespace(
        name="made up", capabilities=lambda: {key: {level: NATIVE for level in Level} for key in ELEMENTS}
    )
    rows, terms = [], [Term(name="", level="drift", reason="", absolute=0.25, relative=0.5)]
    for where in at:
        model = Rows(where)
        levels = compare_levels(engine, model, scene.mechanism, [where], terms)
        numbers = {level.value: [c.ratio, c.digits, c.rows, asdict(c.worst)] for level, c in levels.items()}
        rows.append([summed(where.q), summed(where.qd), where.t, numbers, missing_rows(engine, model, scene.mechanism)])
    return rows


KEPT = read(FILE)


@pytest.mark.parametrize("name", KEPT)
def test_a_judgement_is_what_it_was(name: str) -> None:
    assert sorted(differences(judged(load(files()[name])), KEPT[name])) == []


def shaken(scene: Scene) -> Scene:
    m, numbers = scene.mechanism, random.Random(1)
    return replace(scene, mechanism=replace(m, joints=nudged(m.joints, numbers)))


if __name__ == "__main__":
    if "--print" in sys.argv:
        scenes = {name: load(files()[name]) for name in SCENES}
        print(json.dumps({name: same(judged(scene), judged(shaken(scene))) for name, scene in scenes.items()}))
    else:
        write(FILE, on_every_processor("tests.crosscheck.test_judgements"))
