"""Answers and timings of all methods on one scene: what the process of a price list does.

Every method answers once, which is judged; then all are timed in turns: for one pose now, one cycle, and in bulk. The
process says what it is at before it begins with it, so that a method that ends it is known by name.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from crosscheck.engines import QUANTITIES, EngineError
from crosscheck.engines.methods import Method, Model, Use, floats, methods
from crosscheck.engines.undisturbed import quiet
from crosscheck.judge.comparison import begun_at
from crosscheck.judge.prices import CONTENDS, STEPS, SUFFIX, settings
from crosscheck.judge.truth import CertifiedTruth, NoTruth
from crosscheck.scenes.names import OURS, order_of
from crosscheck.workers.processes import Failure, FailureKind, told_if_raised
from crosscheck.workers.timing import AT_LEAST, LONG, timed_in_turns, turn
from refkin.model import Scene
from refkin.scenes.files import parse

CYCLE, BULK = 73, 1000
"""Of a scene with more times so many, evenly spread, are one cycle; so many poses over the same time are bulk."""
JUDGED = 9
"""In bulk one pose in so many is judged: the first, the last, and between them some in any part of a block."""
SAMPLED = 4
"""So many poses of the cycle stand for the one pose that is needed now: each starts at the one before it."""
SHARES = {"cycle": 0.3, "one": 0.55, "bulk": 1.0}
"""Until which part of the time that is left after the answers each is done."""
BULK_ANSWERS = 0.5
"""Which part of the time for bulk goes to answers, which are read and judged; the rest to timings."""
CALLS_NEEDED, LONG_CALLS_NEEDED = 8, 4
"""Calls that a timing takes at least: two that say how long one takes, three rounds with a call before each; of `LONG`
ones none before another."""
VERY_LONG = 4.0 * LONG
"""A first call is the only one before the timings if it lasts so long [s]."""
EVERY = 1.0
"""A process says at least this often what it is at [s], as long as that can be interrupted."""
LEAST = 0.05
"""Of what a pose takes in a cycle, so much is left in bulk at least, for who is to be asked there."""
BUILDS = 2
"""How often a model is built to see what that takes."""

Key = tuple[str, str, str]
Digits = dict[str, tuple[float | None, str]]
"""Quantity -> digits, None if there is no answer, and what is to be said of them."""


@dataclass(frozen=True)
class PriceQuestion:
    """The scenes that stand for a number of poses, with their truths; those of methods that step in time apart.

    One configuration in `compared` has a truth.
    """

    scenes: tuple[tuple[Scene, CertifiedTruth], ...]
    stepped: tuple[tuple[Scene, CertifiedTruth], ...]
    compared: int = 1

    def of(self, method: Method) -> tuple[tuple[Scene, CertifiedTruth], ...]:
        """Return the scenes that a method is asked."""
        return self.stepped if method.steps else self.scenes

    def new(self, method: Method) -> int:
        """Return how many configurations are new: what a price is divided by. Whoever steps is given the first ones."""
        return sum(len(scene.times) - method.steps for scene, _ in self.of(method))


def questions(scene: Scene) -> dict[str, PriceQuestion]:
    """Return what is asked for a cycle, for one pose, and in bulk.

    The cycle is the longest run of times with a truth: how long a method looks for poses that there are not is no
    price. Of a single time there is no bulk, no pose is before it, and there is nothing to step.
    """
    scene, truth = _certified(scene, CertifiedTruth(scene))
    cycle, count = ((scene, truth),), len(scene.times)
    if count == 1:
        return dict.fromkeys(("cycle", "one"), PriceQuestion(cycle, ()))
    chosen = np.unique(np.linspace(1, count - 1, SAMPLED + 2).astype(int)[1:-1]).tolist()
    from_last = [_with_truth(begun_at(scene, truth.ref.motion, k - 1, (scene.times[k],))) for k in chosen]
    stepped = [_with_truth(begun_at(scene, truth.ref.motion, k - 1, scene.times[k - 1 : k + 1])) for k in chosen]
    times = np.linspace(scene.times[0], scene.times[-1], BULK).tolist()
    bulk = ((replace(scene, times=tuple(times)), CertifiedTruth(replace(scene, times=tuple(times[::JUDGED])))),)
    return {
        "cycle": PriceQuestion(cycle, cycle),
        "one": PriceQuestion(tuple(from_last), tuple(stepped)),
        "bulk": PriceQuestion(bulk, bulk, JUDGED),
    }


def _certified(scene: Scene, truth: CertifiedTruth) -> tuple[Scene, CertifiedTruth]:
    """Return the scene at the longest run of its times at which there is a truth, and that."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], truth.known, [False]])))
    first, end = max(zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True), key=lambda run: run[1] - run[0])
    times = scene.times[first:end]
    if len(times) == len(scene.times):
        return scene, truth
    return _with_truth(begun_at(scene, truth.ref.motion, first, times) if first else replace(scene, times=times))


def _with_truth(scene: Scene) -> tuple[Scene, CertifiedTruth]:
    return scene, CertifiedTruth(scene)


@quiet()
def measure(scene: dict[str, Any], producers: Sequence[str], failed: set[Key], within: float, pipe: Any) -> None:
    """Send what is found through a pipe.

    Parameters
    ----------
    scene : dict
        As data.
    producers, within
        As for `crosscheck.measure.price.price`.
    failed : set of (engine, method, setting)
        What is left alone.
    pipe : Connection
    """
    read = parse(scene)
    try:
        asked = questions(read)
    except NoTruth as error:
        pipe.send(("no truth", str(error)))
        return
    truth = asked["cycle"].scenes[0][1]
    pipe.send(("truth", truth.attainable, len(truth.known)))
    end = time.process_time() + within
    runs = [run for method in _open(producers, failed, pipe) if (run := _answered(method, asked, order_of(read), pipe))]
    begun = time.process_time()
    for poses, share in SHARES.items():
        if poses in asked:
            _time(runs, poses, asked, begun + share * (end - begun), pipe)
    pipe.send(("done",))


def any_of(producer: str) -> Key:
    """Return what the methods of a producer are called by together, before there are any."""
    return producer, "any", ""


def _open(producers: Sequence[str], failed: set[Key], pipe: Any) -> Iterator[Method]:
    """Yield the methods that are to be tried; say of a producer that is not there why not."""
    for producer in producers:
        if any_of(producer) in failed:
            continue
        pipe.send(("at", any_of(producer), ""))
        try:
            listed = methods(producer, Use.PRICE)
        except EngineError as error:
            pipe.send(("refused", any_of(producer), str(error)))
            continue
        yield from (method for method in listed if method.key not in failed)


@dataclass
class _Run:
    """A method with its models: poses -> one for each scene; how long a call takes for so many [s], and its digits.

    `parts` says what part of a call of a cycle one takes that ends at a lower order; of long ones it is not known.
    """

    method: Method
    order: int
    models: dict[str, list[Model]]
    seconds: dict[str, float]
    digits: dict[str, Digits]
    parts: dict[int, float] = field(default_factory=dict)

    def look(self) -> None:
        """Find what part of a call for a cycle each lower order takes, from a call of each that is not long."""
        if self.seconds["cycle"] < LONG and not self.method.at_once:
            for order in range(self.order):
                took = turn(partial(self.solve, "cycle", order))
                self.parts[order] = min(1.0, took / self.seconds["cycle"])

    def expected(self, poses: str, order: int) -> float:
        """Return how long a call up to an order may take for so many poses [s]: what is not known is not left out."""
        unknown = 1.0 if self.method.at_once else (order + 1) / (self.order + 1)
        return self.seconds[poses] * self.parts.get(order, unknown)

    def solve(self, poses: str, order: int) -> None:
        for model in self.models[poses]:
            model.solve(order)


def _answered(method: Method, asked: Mapping[str, PriceQuestion], order: int, pipe: Any) -> _Run | None:
    """Have a method answer a cycle and one pose, say what came of it; return it if it is to be timed."""
    pipe.send(("at", method.key, method.newton_by))
    answer: dict[str, Any] = {"newton_by": method.newton_by, "note": method.note}
    run = _Run(method, min(order, method.highest), {}, {}, {})
    if not asked["cycle"].of(method):
        pipe.send(("refused", method.key, "it goes from one time to the next, and there is one alone"))
        return None
    took = told_if_raised(_built, method, asked["cycle"])
    if isinstance(took, str):
        pipe.send(("refused", method.key, took))
        return None
    if isinstance(took, Failure):
        pipe.send(("failed", method.key, answer, took.text))
        return None
    answer["build"] = took if method.build else None  # an engine that is asked anew builds in every call
    for poses in ("cycle", "one"):
        if poses in asked:
            digits = told_if_raised(_tried, run, poses, asked[poses])
            if isinstance(digits, Failure):
                pipe.send(("failed", method.key, answer, digits.text))
                return None
            answer[poses] = digits
    run.look()
    pipe.send(("answered", method.key, {**answer, "highest": run.order}))
    return run


def _built(method: Method, question: PriceQuestion) -> float | str:
    """Return how long a model takes to be built [s], or why the method refuses it."""
    try:
        return min(turn(partial(method.model, question.of(method)[0][0])) for _ in range(BUILDS))
    except EngineError as error:
        return str(error)


def _tried(run: _Run, poses: str, question: PriceQuestion) -> Digits | Failure:
    """Return the digits of a method, as `_digits` does, or why it says that it has none."""
    try:
        return _digits(run, poses, question)
    except EngineError as error:
        return Failure(FailureKind.ERROR, str(error))


def _digits(run: _Run, poses: str, question: PriceQuestion) -> Digits:
    """Have a method answer for so many poses; return its digits, and what is to be said of them, by quantity.

    A model is asked twice: its first call may compile what the others find. The second is that which is timed, so it is
    judged. A very long first one is not much longer for that, and is the only one.
    """
    models, fewest = list[Model](), Digits()
    took = 0.0
    for scene, truth in question.of(run.method):
        models.append(run.method.model(scene))
        once, answer = _second_call(models[-1], run.order)
        took += once
        levels = list(models[-1].read(answer))
        run.order = min(run.order, len(levels) - 1)
        shape = (scene.mechanism.kind.width * len(truth.bodies), len(scene.times))
        nothing = [np.full(shape, np.nan)] * (run.order + 1 - len(levels))
        levels = [floats(x)[:, :: question.compared] for x in (*levels[: run.order + 1], *nothing)]
        for k, level in enumerate(levels):
            fewest[QUANTITIES[k]] = _fewer(fewest.get(QUANTITIES[k]), truth.digits(level, k, levels[:k]))
    run.models[poses], run.seconds[poses], run.digits[poses] = models, took, fewest
    return fewest


def _second_call(model: Model, order: int) -> tuple[float, Any]:
    """Return what the second call of a model takes [s], the first if that is very long; and its answer."""
    answers = list[Any]()
    once = turn(partial(_keep, answers, model, order))
    return (once if once > VERY_LONG else turn(partial(_keep, answers, model, order))), answers[-1]


def _keep(answers: list[Any], model: Model, order: int) -> None:
    answers.append(model.solve(order))


def _fewer(one: tuple[float | None, str] | None, other: tuple[float | None, str]) -> tuple[float | None, str]:
    """Return the fewer digits of two; none at all are the fewest."""
    if one is None or one[0] is None:
        return other if one is None else one
    return other if other[0] is None or other[0] < one[0] else one


def _time(runs: Sequence[_Run], poses: str, asked: Mapping[str, PriceQuestion], end: float, pipe: Any) -> None:
    """Time in turns what may be the cheapest; others, and what has no time, are left with the call that answered."""
    question = asked[poses]
    if poses == "bulk":
        runs = list(_in_bulk(runs, asked, end, pipe))
    calls: dict[tuple[Key, int], Callable[[], Any]] = {}
    known: dict[tuple[Key, int], float] = {}
    cost, announcer = 0.0, _Announcer(pipe)
    for run in runs:
        pipe.send(("timed", run.method.key, poses, -1, run.seconds[poses] / question.new(run.method), None))
    for away, run in nearest_first(runs, poses):
        key, short = run.method.key, run.seconds[poses] < LONG
        near = [order for order, far in away.items() if far <= CONTENDS]
        orders = [run.order] if run.method.at_once and near else near
        if not orders:
            break
        once = sum(max(run.expected(poses, order), AT_LEAST) for order in orders)
        own = (CALLS_NEEDED - 2 if short else LONG_CALLS_NEEDED - 1) * once
        if cost + own <= end - time.process_time():
            cost += own
            for order in orders:
                calls[key, order] = partial(announcer.solve, run, poses, order)
                if short:
                    calls[key, order]()
                known[key, order] = turn(calls[key, order])
    names = {str(k): at for k, at in enumerate(calls)}
    counts = {run.method.key: question.new(run.method) for run in runs}
    timed = timed_in_turns(
        {name: calls[at] for name, at in names.items()},
        within=max(0.0, end - time.process_time()),
        clock=time.process_time,
        known={name: known[at] for name, at in names.items()},
    )
    for name, timing in timed.items():
        key, order = names[name]
        spread = timing.spread if len(timing.turns) > 1 else None
        pipe.send(("timed", key, poses, order, timing.seconds / counts[key], spread))


def nearest_first(runs: Iterable[_Run], poses: str) -> list[tuple[dict[int, float], _Run]]:
    """Return settings with how many times the cheapest one each costs, by order, where it is nearest to that.

    Those that are nearest in any come first. Each is held against others with as many of the digits that are asked for:
    all, the engines', its own engine's. What is the cheapest there, or the cheapest of another method, stands in a
    table: nothing is nearer. What has too few digits is infinitely far away. A single call tells little of two settings
    that are near: so both are taken.
    """
    by_key, rows = {run.method.key: run for run in runs}, list[dict[str, Any]]()
    for (engine, method, setting), run in by_key.items():
        who = {"engine": engine, "method": method, "setting": setting, "newton_by": run.method.newton_by}
        for quantity, (digits, _) in run.digits[poses].items():
            price = run.expected(poses, QUANTITIES.index(quantity))
            of = {"quantity": quantity, f"digits{SUFFIX[poses]}": digits, f"microseconds{SUFFIX[poses]}": price}
            rows.append({**who, **of})
    engines = [row for row in rows if row["engine"] not in OURS]
    own = ([row for row in rows if row["engine"] == engine] for engine in {engine for engine, *_ in by_key})
    away = {key: dict.fromkeys(range(run.order + 1), math.inf) for key, run in by_key.items()}
    for group in (rows, engines, *own):
        for (order, quantity), digits in product(enumerate(QUANTITIES), STEPS):
            ranked = settings(group, poses, quantity, digits)
            shown = [*ranked[:1], *[offer for offer in ranked if offer.name != ranked[0].name][:1]]
            for offer in ranked:
                key = *offer.name, offer.setting
                ratio = 1.0 if offer in shown else offer.microseconds / ranked[0].microseconds
                away[key][order] = min(away[key][order], ratio)
    return sorted(
        ((away[key], run) for key, run in by_key.items()),
        key=lambda pair: (min(pair[0].values()), pair[1].seconds[poses]),
    )


def _in_bulk(runs: Sequence[_Run], asked: Mapping[str, PriceQuestion], end: float, pipe: Any) -> Iterator[_Run]:
    """Yield the methods that have answered in bulk, as long as there is time; say who had none and may be the cheapest.

    What bulk will take of each is told by what more poses have taken so far: a cycle, less one pose. Who finds them
    together is asked before others, whatever that says.
    """
    until = end - (1.0 - BULK_ANSWERS) * (end - time.process_time())
    for run in runs:
        cycle, new = run.seconds["cycle"], asked["cycle"].new(run.method)
        more = (cycle - run.seconds["one"] / asked["one"].new(run.method)) / max(new - 1, 1)
        run.seconds["bulk"], run.digits["bulk"] = BULK * max(more, LEAST * cycle / new), run.digits["cycle"]
    for away, run in sorted(nearest_first(runs, "bulk"), key=lambda pair: not pair[1].method.together):
        if min(away.values()) > CONTENDS and not run.method.together:
            continue
        if time.process_time() > until:
            pipe.send(("unasked", run.method.key, run.seconds["bulk"] / BULK))
            continue
        pipe.send(("at", run.method.key, run.method.newton_by))
        digits = told_if_raised(_tried, run, "bulk", asked["bulk"])
        if isinstance(digits, Failure):
            digits = dict.fromkeys(QUANTITIES, (None, f"in bulk: {digits.text}"))
        elif all(fewest is not None for fewest, _ in digits.values()):
            yield run
        pipe.send(("digits", run.method.key, "bulk", digits))


class _Announcer:
    """Says which method is at work, if another was or some time has passed: a thousandth of a turn."""

    def __init__(self, pipe: Any) -> None:
        self.pipe, self.last, self.next = pipe, ("", "", ""), 0.0

    def solve(self, run: _Run, poses: str, order: int) -> None:
        """Solve, and say so before."""
        if self.last != run.method.key or time.monotonic() > self.next:
            self.last, self.next = run.method.key, time.monotonic() + EVERY
            self.pipe.send(("at", run.method.key, run.method.newton_by))
        run.solve(poses, order)
