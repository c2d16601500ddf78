"""What is made of made-up timings, answers and replies: prices, workloads, effects, sentences, parts of records."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, replace
from functools import partial
from itertools import combinations_with_replacement, product
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.methods import Batch, Method, Use, of_routes
from crosscheck.judge import known_gaps, workloads
from crosscheck.judge.hard_poses import PoseSample
from crosscheck.judge.known_gaps import unexplained
from crosscheck.judge.prices import EffectRow, PriceRow, cheapest, repeated, with_suspicions
from crosscheck.judge.records import Cause, Disagreement, Record
from crosscheck.measure import bench, check, conform, effects, hard_table, jobs, price_process
from crosscheck.measure import price as pricing
from crosscheck.scenes import workloads as works
from crosscheck.scenes.four_bar_answers import four_bar
from crosscheck.scenes.hard import hard_cases
from crosscheck.scenes.names import PHYSICAL
from crosscheck.scenes.workloads_space import many_rssrs
from crosscheck.workers import timing
from crosscheck.workers.processes import Failure, FailureKind, hang
from crosscheck.workers.timing import Timing
from refkin.model import Scene
from refkin.proof.pose.krawczyk import Judgement, Verdict
from refkin.scenes.files import load, to_dict
from tests.crosscheck.made_up_engines import Felt, Made, by, on_record, raises, without
from tests.crosscheck.test_judgements import MOVED, moved, shaken, some
from tests.crosscheck.test_price import Clock
from tests.linkages import ROCKER
from tests.refkin.test_answers import files

Shake = Callable[[Scene], Scene]


def prices(shake: Shake, within: float = 1e6, unlike: float = 1.0) -> Any:
    """Return what a process says of methods whose cost is known, and the list that is made of it."""
    scene = shake(ROCKER.scene(speed=2.0, turns=0.1, samples=5))
    clock, sent = Clock([]), list[Any]()
    methods = [
        clock.method("plain", 1e-2, 1e-4, off=1e-6, setting="a"),
        clock.method("plain", 1.1e-2, 1e-4, off=1e-9, setting="b"),
        clock.method("steps", 2e-2, 5e-3 * unlike, off=1e-9, steps=True),
        clock.method("at once", 3e-2, 2e-4, off=1e-4, at_once=True),
        clock.method("cycles alone", 1e-2 * unlike, 3e-4, off=1e-7, most=price_process.CYCLE),
        clock.method("of positions", 4e-3, 1e-5, off=1e-2, highest=0),
        clock.method("dear", 9e-2, 9e-4, off=1e-3),
        clock.method("very long", 0.3, 9e-4 * unlike, off=1e-5),
        clock.method("without", 1e-2, 1e-3, off=1e-5, most=0),
    ]
    refuses = replace(methods[0], name="refuses", build=_refused)
    asks_anew = replace(methods[0], name="asks anew", build=None)
    vars(asks_anew)["model"] = methods[0].model
    listed = patch.multiple(price_process, time=clock, methods=lambda *_: [*methods, refuses, asks_anew])
    with listed, patch.object(timing, "time", clock):
        pipe = SimpleNamespace(send=sent.append)
        price_process.measure(to_dict(scene), ["made up"], {("made up", "dear", "")}, within, pipe)
    progress = pricing._Progress()
    for message in sent:
        progress.take(*message)
    progress.at = ("made up", "steps", "")
    progress.blame("it ended")
    told = [message for message in sent if message[0] != "at"]
    return [told, progress.begun, [asdict(row) for row in with_suspicions(list(pricing._rows(scene, progress)))]]


def _refused(scene: Scene) -> Any:
    raise EngineError("refuses")


def ranking() -> Any:
    """Return the cheapest of made-up prices, and how far a second list repeats the first."""
    numbers = random.Random(1)
    lists = []
    for _ in range(2):
        rows = []
        for engine, method, setting, quantity in product("ab", "xyz", ("", "-"), ("position", "velocity")):
            cost = {f"microseconds{s}": 10.0 ** numbers.uniform(0.0, 1.0) for s in ("", "_one", "_bulk")}
            digits = {f"digits{s}": numbers.choice([None, 3.0, 6.5, 9.0, 14.5]) for s in ("", "_one", "_bulk")}
            spread = {f"spread{s}": numbers.choice([None, 0.0, 0.1]) for s in ("", "_one", "_bulk")}
            who = {"engine": engine, "method": method, "setting": setting, "quantity": quantity, "newton_by": engine}
            rows.append(
                PriceRow(**who, digits_attainable=numbers.choice([None, 9.0, 15.0]), **cost, **digits, **spread)
            )
        lists.append(rows)
    cells = [cheapest([asdict(row) for row in rows]) for rows in lists]
    noise = [
        EffectRow(engine="", method="", setting="", effect="", called_for=True, microseconds=x, spread=y).within_noise
        for x, y in product((None, -1.0, 0.0, 1.0), (None, 0.5, 1.0))
    ]
    again = [{"cheapest": cell, "cheapest_engine": cells[0]} for cell in cells]
    return [
        *cells,
        *(asdict(repeated(again[0], other)) for other in again),
        [r.note for r in with_suspicions(rows)],
        noise,
    ]


def classes_of_answers() -> Any:
    """Return how answers at three times are classed, of every kind at each."""
    verdicts = [None, *(Judgement(v, r) for v, r in ((Verdict.INSIDE, 0.5), (Verdict.OUTSIDE, 30.0)))]
    verdicts += [Judgement(Verdict.UNDECIDABLE, 2.0), Judgement(Verdict.OUTSIDE, 7e3)]
    kinds = [(j, ok, none) for j in verdicts for ok in (True, False) for none in (True, False)]
    made = []
    for three in combinations_with_replacement(kinds[::-1], 3):
        poses = [PoseSample(0.5 * k, j, ok, "noted" if none else "", none) for k, (j, ok, none) in enumerate(three)]
        made.append(": ".join(hard_table.classed(poses[1:], "it said so" if len({*three}) == 2 else "")))
        made.append(": ".join(hard_table.classed(poses)))
    return made[::7]


def of_workloads(shake: Shake) -> Any:
    """Return how right answers to workloads are that are off by a known amount, and the rows of a bench."""
    ulp = math.nextafter(1.0, 2.0) if shake is shaken else 1.0
    bars = works.many("bars", 5, 24, works.MARGIN)
    bars = replace(bars, lengths=bars.lengths * ulp)
    loops, chain = many_rssrs("loops", 2, 5), works.LoopChain("chain", 3)
    exact = [np.array(level, float) for level in four_bar(bars.lengths[:, :, None], works.SPEED * bars.t)]
    wave = np.cos(np.arange(exact[0].size)).reshape(exact[0].shape)
    off = chain.truth()[0] + MOVED * np.cos(np.arange(len(chain.start)))
    said: list[Any] = [asdict(workloads.of_chain(chain, x)) for x in (off * ulp, off + 2.0 * math.pi * np.nan)]
    pieces = []
    for level, rows in product(range(3), (range(9), (2, 5, 8), (6, 7))):
        levels = [x + (MOVED * (level + 1) * wave if k == level else 0.0) for k, x in enumerate(exact)]
        levels[0][8] += 2.0 * math.pi
        pieces.append([works.whole(bars, [m], [x[list(rows), m] for x in levels[: level + 1]], rows) for m in range(5)])
    levels[1][4, 3, 2] = np.nan
    pieces.append([works.whole(bars, np.arange(5), levels)])
    for limits in ({"SAMPLE": 20, "WORST": 3, "SAMPLES": 7}, {"SAMPLE": workloads.SAMPLE}):
        with patch.multiple(workloads, **limits):
            said += [asdict(workloads.of_four_bars(bars, some * 5)) for some in pieces]
    answers = []
    for m in range(2):
        ref = workloads._certified(loops, m)
        motion = moved(ref, by=MOVED * (m + 1))
        answers.append(works.whole(loops, np.array([m]), list(motion.levels), range(len(motion.q))))
        said.append(asdict(workloads.of_spatial_loops(loops, answers)))
    answers[0].levels[1][3, 2] = np.nan
    said += [
        asdict(workloads.of_spatial_loops(loops, some))
        for some in ([replace(answers[1], levels=answers[1].levels[:1])], answers)
    ]
    return [
        said,
        [x.ranked for x in (workloads.Accuracy(0.0, r, 1, n) for r in (0.5, 1.0, 2.0) for n in (0, 1))],
        benched(bars, pieces),
    ]


def benched(bars: Any, pieces: Any) -> Any:
    """Return the rows of a bench whose timings are made up."""

    def batch(work: Any, order: int, most: int = 2, count: int = 40) -> Batch:
        if order > most or isinstance(work, works.LoopChain):
            raise EngineError(f"it takes no more than {most}")
        return Batch(lambda: None, count, lambda: pieces[3 * order], "" if order else "positions")

    who = {"engine": "made up", "newton_by": "nobody", "uses": frozenset({Use.BENCH})}
    listed = [
        Method(name="whole", batch=batch, note="noted", **who),
        Method(name="at once", batch=partial(batch, count=7), at_once=True, setting="-", **who),
        Method(name="positions", batch=batch, highest=0, **who),
        Method(name="less", batch=partial(batch, most=1), highest=1, **who),
        Method(name="refuses", batch=partial(batch, most=1), **who),
    ]
    timed = lambda runs, **_: {name: Timing(1e-3 * (k + 1), 0.1 * k) for k, name in enumerate(runs)}  # noqa: E731
    with patch.object(bench, "timed_in_turns", timed):
        parts = [bench.measured(work, listed=listed) for work in (bars, works.LoopChain("chain", 3))]
    whole = bench.merged(parts)
    return [whole["rows"], whole["absent"], [bench.key_of(row) for row in whole["rows"]], sorted(whole["machine"])]


def of_effects(shake: Shake, name: str) -> Any:
    """Return the ledger of effects of an engine, with timings made up."""
    scene = shake(some(load(files()[name]), 3))
    listed = [
        *of_routes(Felt("felt", lambda motion: replace(motion, points={}))),
        *of_routes(Made("alone", by(0.0), delivers=("position",))),
    ]
    listed += of_routes(Made("ends", raises(EngineError("no answer"))))
    numbers = random.Random(2)

    def timed(runs: Any, **_: Any) -> Any:
        return {
            x: Timing(1e-3 * k, 0.1, tuple(numbers.uniform(1.0, 2.0) for _ in range(8)))
            for k, x in enumerate(sorted(runs))
        }

    with ExitStack() as stack:
        stack.enter_context(patch.multiple(effects, timed_in_turns=timed, methods=lambda *_: listed))
        told = [effects.measured((to_dict(scene), "", 1.0, e)) for e in ("", "velocity", PHYSICAL[1], "certificate")]
        for ends in (hang(1.0), Failure(FailureKind.CRASH, "it ended", "SIGSEGV"), told[0][:4]):
            answers = {"": [ends], "each": [ends, told[1], *[hang(2.0)] * 5, told[2], *told[3:] * 9]}
            asked = lambda _, j, seconds, a=answers: (x for x in a["" if len(j) == 1 else "each"])  # noqa: E731
            stack.enter_context(patch.object(effects, "call_in_turn", asked))
            told.append(effects.effects_ledger(scene, ["felt"]))
    few = [numbers.choice([1.0, 1.1, 1.5]) for _ in range(7)]
    noises = [effects.noise(few[:k], few[7 - k :], 10.0) for k in range(1, 8)]
    return [[[asdict(row) for row in rows] for rows in told], noises, [row.within_noise for row in told[0][:3]]]


def conforming() -> Any:
    """Return what is said of replies, of hard cases, and of what engines get wrong."""
    scene = ROCKER.scene(samples=4)
    who = {"engine": "made up", "method": "a", "key": "0" * 16, "scene": "", "about": {}}
    names = [c.name for c in scene.mechanism.constraints]
    numbers = random.Random(3)
    told: list[Any] = []
    places = (("position", names[:1]), ("velocity", names[1:3]), ("status", []), ("drift", names[:2]))
    for ratio, (quantity, violated) in zip((None, 3.25, 1e9, None), places, strict=True):
        some_of = [
            Disagreement(
                engine="made up",
                method=numbers.choice("ab"),
                quantity=quantity,
                kind=kind,
                ratio=ratio,
                how=numbers.choice(["", "how"]),
                message="said",
                violated=violated,
            )
            for kind in Cause
        ]
        record = Record(key=who["key"], scene="", about={}, answers=[], levels=[], refusals=[], disagreements=some_of)
        faults = [*conform._faults_of(record, scene)]
        told += [
            [str(d) for d in some_of],
            [asdict(f) for f in faults],
            conform.summary([conform.Reply("", tuple(faults))]),
        ]
    rows = [
        {
            "case": f"{verdict}",
            "verdict": verdict,
            "class": kind,
            "method": "a",
            "setting": "",
            "note": f"{verdict} x at solve: no; it",
        }
        for verdict, kind in product(hard_table.HardOutcome, (None, "documented limit"))
    ]
    with patch.object(conform, "hard_case_rows", lambda *_, cases: [{**rows[0], "case": len(cases)}, *rows]):
        told += [asdict(reply) for reply in conform.hard_replies("")]
    in_turn = [hang(1.0), *["asked"] * (len(conform._asked()) - 1)]
    with patch.object(conform, "call_in_turn", lambda *_: (reply for reply in in_turn)):
        told += [asdict(r) if isinstance(r, conform.Reply) else r for r in conform.replies("")][:3]
    turn = hard_table._in_turn_by_kind(hard_cases())
    known = [
        SimpleNamespace(engine="a", method="b", verdict=v, cases=(turn[0].case,), kind="k", quote="q", source="s")
        for v in ("wrong", "correct", "hang")
    ]
    answers = [*product(hard_table.HardOutcome, ["note"]), hang(1.0), Failure(FailureKind.ERROR, "text", "how")]
    made_rows = [
        hard_table._row(("a", m, ""), case, answer, 7, known) for m in "bc" for case in turn[:2] for answer in answers
    ]
    return [told, [case.key for case in turn], made_rows, len(unexplained(made_rows))]


def handed(shake: Shake) -> Any:
    """Return what jobs are, how parts of a record are joined, and what of it the table of known gaps accounts for."""
    scene = shake(ROCKER.scene(samples=4))
    drawn = {k: SimpleNamespace(scene=replace(scene, name=str(k))) for k in range(4)}
    about = lambda d: {"kind": "abab"[int(d.scene.name)], "law": "ppqq"[int(d.scene.name)]}  # noqa: E731
    with patch.multiple(jobs, draw=lambda night, k: drawn[k], describe=about):
        seen = [
            {},
            {pair: 2 for pair in jobs.pairs_of(about(drawn[0]))},
            {pair: 1 for k in (0, 1, 3) for pair in jobs.pairs_of(about(drawn[k]))},
        ]
        told: list[Any] = [jobs.scene_of({"night": 1, "shards": [*drawn], "seen": s})[1] for s in seen]
    told.append(jobs.scene_of({"scene": to_dict(scene), "about": {"x": 1}})[1])
    with on_record():
        parts: dict[str, Any] = {x.name: check.check(scene, [x]) for x in (Made("one", by(1e-6)), Made("two", without))}
        parts |= {"": check.check(scene, []), "three": Failure(FailureKind.CRASH, "it ended", "SIGSEGV")}
    whole = jobs.joined({"scene": to_dict(scene)}, ["one", "two", "three"], parts)
    lost = jobs.joined({"scene": to_dict(scene), "about": {"x": 1}}, ["one"], {**parts, "": hang(3.0)})
    for record in (whole, lost):
        told.append([[str(d) for d in record.disagreements], len(record.answers), record.about, record.failure])
    gaps = [
        known_gaps.KnownGap(
            engine=e, predicate=p, reason="", date="", reproduction="", kind_of_gap="", method=m, quantity=q, kind=k
        )  # type: ignore[arg-type]
        for e, p, m, q, k in product(
            ("one", "three"),
            known_gaps.PREDICATES,
            ("", "planted", "any"),
            ("", "position"),
            ("", Cause.BEYOND, "crash (SIGSEGV)"),
        )
    ]
    records = (
        [whole]
        + [
            replace(
                whole,
                about={"dimension": d, "expected": x},
                reference=whole.reference and replace(whole.reference, sigma_per_step=s),
            )
            for d, x, s in (("spatial", "ok", 1.9), ("planar", "singular", 2.1), ("spatial", "singular", None))
        ]
        + [lost]
    )
    tally = known_gaps.Tally(gaps)
    new = [len(tally.add(record)) for record in records * 10]
    return [
        told,
        tally.chances,
        tally.covered,
        new,
        known_gaps.found_again(gaps, records[1:]),
        [(g.match, n) for g, n in tally.possibly_closed()],
    ]
