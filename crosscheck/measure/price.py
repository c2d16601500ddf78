"""The price list of a scene: all methods, measured in a process of their own, because engines may crash or hang.

A method that ends the process, or does not come back, becomes a row that says so, and a new process goes on without it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from crosscheck.engines import QUANTITIES
from crosscheck.engines.methods import PRICED
from crosscheck.judge.prices import POSES, SUFFIX, PriceRow, with_suspicions
from crosscheck.judge.truth import NoTruth
from crosscheck.measure.check import key_of
from crosscheck.measure.price_process import CYCLE, Key, measure
from crosscheck.scenes.hard import priced_classes
from crosscheck.scenes.names import called_for
from crosscheck.workers.processes import SECONDS_TO_START, start, stop
from crosscheck.workers.timing import seconds_of
from refkin.model import Scene
from refkin.scenes.files import to_dict

WITHIN = 50.0
"""How much of the processor a price list may take in the plane [s], beside the start of a process and the proof of the
truth. In space, where a pose takes several times as long, it is twice that."""
LEAST = 1.0
"""What a process gets at least where another has ended late [s]."""
PATIENCE = 20.0
"""After so much processor time at one method its process is ended [s]: some hundred times what the slowest takes."""
ASLEEP, STARVED = 1e-3, 15.0
"""On a busy machine a process gets a small part of the time: it is given so many times as long on the clock, if it gets
any, and more than a process that sleeps."""


@dataclass
class _Progress:
    """What is known of a scene's methods, as it comes in; times are seconds a configuration."""

    answered: dict[Key, dict[str, Any]] = field(default_factory=dict)
    timed: dict[tuple[Key, str, int], tuple[float, float | None]] = field(default_factory=dict)
    refused: dict[Key, str] = field(default_factory=dict)
    failed: dict[Key, str] = field(default_factory=dict)
    unasked: dict[Key, float] = field(default_factory=dict)
    attainable: dict[str, float] = field(default_factory=dict)
    known: int = 0
    since: float = field(default_factory=time.monotonic)
    spent: float = 0.0
    at: Key | None = None
    newton_by: str = ""
    done: bool = False
    tell: Callable[[int, str], None] = lambda done, method: None
    begun: int = 0

    def take(self, *message: Any) -> None:
        """Take in what the process that measures says."""
        match message:
            case "truth", attainable, known:
                self.attainable, self.known, self.at, self.since = attainable, known, None, time.monotonic()
                self.refused.clear()
                self.unasked.clear()
            case "at", key, newton_by:
                self.at, self.newton_by = key, newton_by
                self.tell(self.begun, ", ".join(filter(None, key)))
                self.begun += 1
            case "refused", key, reason:
                self.refused[key] = reason
            case "answered", key, answer:
                self.answered[key] = answer
            case "digits", key, poses, digits:
                self.answered[key][poses] = digits
            case "unasked", key, seconds:
                self.unasked[key] = seconds
            case "failed", key, answer, why:
                self.answered[key], self.failed[key] = answer, why
            case "timed", key, poses, order, seconds, spread:
                self.timed[key, poses, order] = seconds, spread
            case ("done",):
                self.done = True
            case _:
                raise ValueError(f"a message of another kind: {message}")

    def blame(self, why: str) -> None:
        """Note that a process failed at what it was at; what it had said of that before is no price."""
        if self.at is None:
            raise RuntimeError(f"the process that measures prices ended before it began: {why}")
        self.failed[self.at] = why
        self.answered.setdefault(self.at, {"newton_by": self.newton_by, "note": ""})
        self.at = None
        self.timed = {at: timing for at, timing in self.timed.items() if at[0] not in self.failed}


@dataclass(frozen=True)
class PriceList:
    """The price list of one scene, and the methods (engine, method, reason) that cannot be taken on it.

    `key` says which scene that is, whatever its name (`crosscheck.measure.check.key_of`). `times` are as many of its
    `asked` ones as a cycle has, `known` those of them with a certified truth: these are priced.
    """

    scene: str
    key: str
    rows: list[PriceRow]
    times: int
    known: int
    asked: int
    refused: list[tuple[str, str, str]]


def price(
    scene: Scene,
    producers: Sequence[str] = PRICED,
    within: float | None = None,
    patience: float = PATIENCE,
    tell: Callable[[int, str], None] = lambda done, method: None,
) -> PriceList:
    """Return the price list of a scene; NoTruth if no pose of it is certified.

    Parameters
    ----------
    scene : Scene
    producers : sequence of str
        What `crosscheck.engines.methods.methods` takes.
    within : float
        How much processor time answers and timings may take together [s]; by default `time_for` the scene. What does
        not fit is timed once. On a busy machine that lasts longer.
    patience : float
        After so much processor time at one method it is given up [s], or that on the clock if it sleeps.
    tell : callable
        Is told how many times a method was begun with, and which it is.
    """
    chosen = np.unique(np.linspace(0, len(scene.times) - 1, CYCLE).astype(int)).tolist()
    priced = replace(scene, times=tuple(scene.times[k] for k in chosen), points=(), bodies_wanted=None)
    progress, within = _Progress(tell=tell), time_for(scene) if within is None else within
    while not progress.done:
        left = max(within - progress.spent, within / 4)
        pipe, process = start(measure, to_dict(priced), tuple(producers), {*progress.failed}, left)
        with pipe:
            failure = _listen(pipe, process.pid, progress, patience)
        ended = stop(process)
        progress.spent += time.monotonic() - progress.since
        if failure == "" and not progress.done:
            failure = ended.text
        if failure:
            progress.blame(failure)
    rows = with_suspicions(list(_rows(priced, progress)))
    refused = list(dict.fromkeys((*key[:2], reason) for key, reason in progress.refused.items()))
    return PriceList(scene.name, key_of(scene), rows, len(priced.times), progress.known, len(scene.times), refused)


def time_for(scene: Scene) -> float:
    """Return how much of the processor the price list of a scene may take [s]."""
    return WITHIN * (1 if scene.mechanism.kind.dimension == 2 else 2)


def price_list(within: float = 4 * WITHIN, producers: Sequence[str] = PRICED) -> list[dict[str, Any]]:
    """Return the rows of all classes of priced scenes, each with its class under `scene_class`.

    It may take `within` [s], beside the start of processes and the proof of the truths; `producers` as in `price`.
    """
    end, rows = time.monotonic() + within, list[dict[str, Any]]()
    for done, (name, scene) in enumerate(priced_classes().items()):
        left = (end - time.monotonic()) / (len(priced_classes()) - done)
        prices = price(scene, producers, max(left, LEAST))
        rows += [{"scene_class": name, **asdict(row)} for row in prices.rows]
    return rows


def _listen(pipe: Any, process: int, progress: _Progress, patience: float) -> str:
    """Take in what a process says until it ends; return why it was given up, or nothing."""
    while not progress.done:
        if not _says_something(pipe, process, patience if progress.at else SECONDS_TO_START + patience):
            return f"no answer within {patience:g} s"
        try:
            message = pipe.recv()
        except (EOFError, OSError):
            return ""
        if message[0] == "no truth":
            raise NoTruth(message[1])
        progress.take(*message)
    return ""


def _says_something(pipe: Any, process: int, patience: float) -> bool:
    """Wait for a message of a process, which has so much processor time for it [s]; return whether it came."""
    begun, since = seconds_of(process), time.monotonic()
    while not pipe.poll(min(patience, 1.0)):
        now, passed = seconds_of(process), time.monotonic() - since
        spent = passed if begun is None or now is None else now - begun
        if spent > patience or passed > patience * (1.0 if spent < ASLEEP * passed else STARVED):
            return bool(pipe.poll(0.0))
    return True


def _rows(scene: Scene, progress: _Progress) -> Iterator[PriceRow]:
    for key, answer in progress.answered.items():
        engine, name, setting = key
        for quantity in filter(None, called_for(scene, QUANTITIES)):
            order = QUANTITIES.index(quantity)
            if order > answer.get("highest", 2):
                continue
            failed = progress.failed.get(key, "")
            notes, columns = [answer["note"], failed], dict[str, float | None]()
            for poses in POSES:
                digits, limit = answer.get(poses, {}).get(quantity, (None, ""))
                seconds, spread = (None, None) if failed else _price_of(progress, key, poses, order)
                columns[f"digits{SUFFIX[poses]}"] = None if failed else digits
                columns[f"microseconds{SUFFIX[poses]}"] = None if seconds is None else 1e6 * seconds
                columns[f"spread{SUFFIX[poses]}"] = spread
                notes.append(limit if poses == "cycle" else "")
                if seconds is not None and spread is None:
                    notes.append(f"{POSES[poses]} timed once, all quantities together")
                if spread is not None and (key, poses, order) not in progress.timed:
                    notes.append(f"{POSES[poses]} timed with rates")
                if seconds is not None and (own := _dearer(progress.timed.get((key, poses, order)), seconds)):
                    notes.append(f"{POSES[poses]} {1e6 * own:.3g} us where it ends with {quantity}")
            if key in progress.unasked:
                notes.append(f"{POSES['bulk']} not asked, for want of time")
            build = answer.get("build")
            yield PriceRow(
                engine=engine,
                method=name,
                setting=setting,
                quantity=quantity,
                digits_attainable=progress.attainable[quantity],
                microseconds_to_build=None if build is None else 1e6 * build,
                newton_by=answer["newton_by"],
                unasked_bulk=1e6 * progress.unasked[key] if key in progress.unasked else None,
                note="; ".join(filter(None, notes)),
                **columns,
            )


def _dearer(own: tuple[float, float | None] | None, price: float) -> float | None:
    """Return what a run of its own took [s], where that is more than a price and its spread."""
    if own is None or own[0] * (1.0 - (own[1] or 0.0)) <= price:
        return None
    return own[0]


def _price_of(progress: _Progress, key: Key, poses: str, order: int) -> tuple[float | None, float | None]:
    """Return seconds and spread of what gives this order for least: its own run, or one of a higher order.

    A single call, of the highest order, counts as order -1, and only where nothing else was timed.
    """
    timed = [progress.timed[key, poses, k] for k in range(order, 3) if (key, poses, k) in progress.timed]
    if timed:
        return min(timed, key=lambda timing: timing[0])
    return progress.timed.get((key, poses, -1), (None, None))
