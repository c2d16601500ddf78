"""Answers and timings of all routes on one scene, in a process of their own: engines may crash or hang.

Every route answers once, which is judged; then all are timed in turns. The process says what it is at before it begins
with it. So a route that ends the process, or does not come back, is known by name: it becomes a row that says so, and
a new process goes on without it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from crosscheck.engines.price_route import PRODUCERS, QUANTITIES, PricedRoute, Refused, order_of, quantities, routes_of
from crosscheck.judge.truth import NoTruth, Truth, levels_or_nothing
from crosscheck.measure.price_rows import Row, with_suspicions
from crosscheck.workers.processes import SECONDS_TO_START, Failure, start, stop, told_if_raised
from crosscheck.workers.timing import timed_in_turns
from refkin.model import Scene
from refkin.scenes.files import parse, to_dict

WITHIN = 40.0
"""How long a price list may take [s], beside what a process takes to start and the truth to be proved."""
LEAST = 1.0
"""What a process gets at least where another has ended late [s]."""
PATIENCE = 20.0
"""After this long at one route its process is ended [s]: some hundred times what the slowest takes."""
MOST_TIMES, MOST_TIMED = 361, 73
"""Of a scene with more times the first so many are answered, and judged; the first so many of these are timed."""
CALLS_NEEDED = 4
"""Calls of each work that a timing takes at least: one that warms it, one that says how long it takes, two rounds."""
EVERY = 1.0
"""A process says at least this often what it is at [s], as long as that can be interrupted."""
SHARE = 0.6
"""The part of the time that is left for rounds; the rest goes to the calls before them."""

Key = tuple[str, str, str]


@dataclass
class _Found:
    """What is known of a scene's routes, as it comes in."""

    answered: dict[Key, dict[str, Any]] = field(default_factory=dict)
    timed: dict[tuple[Key, int], tuple[float, float | None]] = field(default_factory=dict)
    refused: list[Refused] = field(default_factory=list)
    failed: dict[Key, str] = field(default_factory=dict)
    attainable: dict[str, float] = field(default_factory=dict)
    known: int = 0
    at: Key | None = None
    newton_by: str = ""
    done: bool = False


@dataclass(frozen=True)
class PriceList:
    """The price list of one scene.

    Attributes
    ----------
    rows : list of Row
    times, known, asked : int
        Configurations that were priced, those of them with a certified truth, and those of the scene.
    refused : list of Refused
        Routes that cannot be taken on this scene.
    """

    scene: str
    rows: list[Row]
    times: int
    known: int
    asked: int
    refused: list[Refused]


def price(
    scene: Scene, producers: Sequence[str] = tuple(PRODUCERS), within: float = WITHIN, patience: float = PATIENCE
) -> PriceList:
    """Return the price list of a scene.

    Parameters
    ----------
    producers : sequence of str
        Names of `PRODUCERS`, or modules with a function `routes`.
    within : float
        How long answers and timings may take together [s]; what does not fit is timed once.
    patience : float
        After this long at one route it is given up [s].

    Raises
    ------
    NoTruth
        If no pose of the scene is certified.
    """
    priced = replace(scene, times=scene.times[:MOST_TIMES], points=())
    found, end = _Found(), time.monotonic() + within
    while not found.done:
        left = max(end - time.monotonic(), LEAST)
        settled = ({*found.answered}, {*found.failed})
        pipe, process = start(measure, to_dict(priced), tuple(producers), *settled, left)
        with pipe:
            failure = _listen(pipe, found, patience)
        ended = stop(process)
        if failure == "" and not found.done:
            failure = ended.text
        if failure:
            _blame(found, failure)
    rows = with_suspicions(list(_rows(priced, found)))
    return PriceList(scene.name, rows, len(priced.times), found.known, len(scene.times), found.refused)


def _listen(pipe: Any, found: _Found, patience: float) -> str:
    """Take in what a process says until it ends; return why it was given up, or nothing."""
    while not found.done:
        if not pipe.poll(patience if found.at else SECONDS_TO_START + patience):
            return f"no answer within {patience:g} s"
        try:
            kind, *told = pipe.recv()
        except (EOFError, OSError):
            return ""
        if kind == "no truth":
            raise NoTruth(told[0])
        _HANDLERS[kind](found, *told)
    return ""


def _blame(found: _Found, why: str) -> None:
    """Note that a process failed at what it was at; what it had found of that before is no price."""
    if found.at is None:
        raise RuntimeError(f"the process that measures prices ended before it began: {why}")
    found.failed[found.at] = why
    found.answered.setdefault(found.at, {"digits": {}, "newton_by": found.newton_by, "note": ""})
    found.at = None
    found.timed = {at: timing for at, timing in found.timed.items() if at[0] not in found.failed}


def _set_truth(found: _Found, attainable: dict[str, float], known: int) -> None:
    found.attainable, found.known, found.at = attainable, known, None
    found.refused.clear()


def _set_at(found: _Found, key: Key, newton_by: str = "") -> None:
    found.at, found.newton_by = key, newton_by


def _set_answer(found: _Found, key: Key, answer: dict[str, Any]) -> None:
    found.answered[key] = answer


def _set_failed(found: _Found, key: Key, answer: dict[str, Any], why: str) -> None:
    found.answered[key], found.failed[key] = answer, why


def _set_timing(found: _Found, key: Key, order: int, seconds: float, spread: float | None) -> None:
    found.timed[key, order] = seconds, spread


def _set_done(found: _Found) -> None:
    found.done = True


_HANDLERS: dict[str, Callable[..., None]] = {
    "truth": _set_truth,
    "refused": lambda found, refused: found.refused.append(refused),
    "at": _set_at,
    "answered": _set_answer,
    "failed": _set_failed,
    "timed": _set_timing,
    "done": _set_done,
}


def measure(
    scene: dict[str, Any], producers: Sequence[str], answered: set[Key], failed: set[Key], within: float, pipe: Any
) -> None:
    """Send what is found through a pipe; this is what the process does. Parameters as in `price`.

    `answered` need not answer again, and `failed` are left alone.
    """
    read = parse(scene)
    try:
        truth = Truth(read)
    except NoTruth as error:
        pipe.send(("no truth", str(error)))
        return
    end = time.monotonic() + within
    pipe.send(("truth", truth.attainable, int(truth.known.sum())))
    left = [name for name in producers if _all_of(name) not in failed]
    fit = {
        route.key
        for route in _open_routes(left, read, pipe)
        if route.key not in failed and (route.key in answered or _answer(route, truth, order_of(read), pipe))
    }
    stretch = replace(read, times=read.times[:MOST_TIMED])
    _time([route for route in _again(left, stretch, pipe) if route.key in fit], order_of(read), end, pipe)
    pipe.send(("done",))


def _all_of(producer: str) -> Key:
    """Return what the routes of a producer are called by together, before there are any."""
    return producer, "any", ""


def _open_routes(producers: Sequence[str], scene: Scene, pipe: Any) -> Iterator[PricedRoute]:
    """Yield the routes that can be taken; say of the others why not."""
    for producer in producers:
        pipe.send(("at", _all_of(producer)))
        for route in routes_of(producer, scene):
            if isinstance(route, Refused):
                pipe.send(("refused", route))
            else:
                yield route


def _again(producers: Sequence[str], scene: Scene, pipe: Any) -> Iterator[PricedRoute]:
    """Yield the routes that can be taken, once more and for other times; their refusals have been told."""
    for producer in producers:
        pipe.send(("at", _all_of(producer)))
        yield from (route for route in routes_of(producer, scene) if isinstance(route, PricedRoute))


def _answer(route: PricedRoute, truth: Truth, order: int, pipe: Any) -> bool:
    """Have a route answer, judge it, say what came of it; return whether it is to be timed."""
    pipe.send(("at", route.key, route.newton_by))
    told: dict[str, Any] = {"digits": {}, "newton_by": route.newton_by, "note": route.note, "highest": route.highest}
    found = told_if_raised(route.solve, min(order, route.highest))
    levels = found if isinstance(found, Failure) else told_if_raised(route.read, found)
    if isinstance(levels, Failure):
        pipe.send(("failed", route.key, told, levels.text))
        return False
    shape = (3 * len(truth.bodies), len(truth.known))
    for k, level in enumerate(levels_or_nothing(levels, shape, min(order, route.highest))):
        told["digits"][QUANTITIES[k]] = truth.digits(level, k)
    pipe.send(("answered", route.key, told))
    return True


def _time(routes: Sequence[PricedRoute], order: int, end: float, pipe: Any) -> None:
    """Time the routes in turns; each is timed once beforehand, and the slowest are left so if time is short."""
    slow = {route.key: _once(route, min(order, route.highest), pipe) for route in routes}
    works: dict[tuple[Key, int], Callable[[], Any]] = {}
    cost, announcer = 0.0, _Announcer(pipe)
    for route in sorted(routes, key=lambda r: slow[r.key]):
        highest = min(order, route.highest)
        orders = [highest] if route.at_once else range(highest + 1)
        cost += CALLS_NEEDED * len(orders) * slow[route.key]
        if cost <= end - time.monotonic():
            works.update({(route.key, k): partial(announcer.solve, route, k) for k in orders})
    names = {str(k): name for k, name in enumerate(works)}
    timed = timed_in_turns(
        dict(zip(names, works.values(), strict=True)), within=max(0.0, SHARE * (end - time.monotonic()))
    )
    for name, timing in timed.items():
        pipe.send(("timed", *names[name], timing.seconds, timing.spread))


def _once(route: PricedRoute, order: int, pipe: Any) -> float:
    """Time one call of a route, and say how long it took [s]: order -1 is this one."""
    pipe.send(("at", route.key))
    began = time.perf_counter()
    route.solve(order)
    took = time.perf_counter() - began
    pipe.send(("timed", route.key, -1, took, None))
    return took


class _Announcer:
    """Says which route is at work, if another was or some time has passed: a thousandth of a turn."""

    def __init__(self, pipe: Any) -> None:
        self.pipe, self.last, self.next = pipe, ("", "", ""), 0.0

    def solve(self, route: PricedRoute, order: int) -> Any:
        """Solve, and say so before."""
        if self.last != route.key or time.monotonic() > self.next:
            self.last, self.next = route.key, time.monotonic() + EVERY
            self.pipe.send(("at", route.key))
        return route.solve(order)


def _rows(scene: Scene, found: _Found) -> Iterator[Row]:
    """Yield a row per route, setting and quantity, then one per refusal and quantity."""
    for key, answer in found.answered.items():
        engine, route, knob = key
        who = {"engine": engine, "route": route, "knob": knob, "newton_by": answer["newton_by"]}
        for quantity in quantities(scene):
            order = QUANTITIES.index(quantity)
            if order > answer.get("highest", 2):
                continue
            digits, limit = answer["digits"].get(quantity, (None, ""))
            notes = [answer["note"], limit, found.failed.get(key, "")]
            seconds, spread = (None, None) if key in found.failed else _price_of(found, key, order)
            if seconds is not None and spread is None:
                notes.append("timed once")
            yield Row(
                **who,
                quantity=quantity,
                digits=None if key in found.failed else digits,
                digits_attainable=found.attainable[quantity],
                microseconds=None if seconds is None else 1e6 * seconds / min(len(scene.times), MOST_TIMED),
                spread=spread,
                note="; ".join(filter(None, notes)),
            )


def _price_of(found: _Found, key: Key, order: int) -> tuple[float | None, float | None]:
    """Return seconds and spread of what gives this order for least: its own run, one of a higher order, or the first.

    Order -1 is a single call, of the highest order.
    """
    for k in (*range(order, 3), -1):
        if (key, k) in found.timed:
            return found.timed[key, k]
    return None, None
