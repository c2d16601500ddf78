"""The hunt for the worst error / allowed: Hypothesis `target()` over scenes in strata of distance to a singular pose.

It begins with the worst scenes of a night, as the night had them, and with what Hypothesis derives from each. Then each
stratum takes its turn: some scenes at random, then such as Hypothesis derives from the worst of them. Every best
method, at every level, is a target of its own. A ratio above 1 is an error of the engine, or a term missing from the
budget.

How far a position lies from the certificate's enclosure is a target, too: it is known where a budget of first order
says nothing, and leads there. It has no limit: its unit, the least error of float64, grants a documented stopping rule
what that leaves in a regular pose, and only a budget knows what a singular one makes of it. So nobody is blamed for it,
neither by the judge nor here. Blamed is what the judge calls a disagreement, as `crosscheck replay` does.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import count, zip_longest
from pathlib import Path

from hypothesis import Phase, given, seed, settings, target

from crosscheck.engines.methods import Use, methods
from crosscheck.errors import UsageError
from crosscheck.judge.records import ENDED, Disagreement, Record, Unreadable, read_records
from crosscheck.measure.check import ANY, ROWS, key_of
from crosscheck.measure.jobs import by_itself, checkers
from crosscheck.scenes.drawing import (
    AnyDrawn,
    OutOfTime,
    climb,
    draw,
    expected_of,
    in_part,
    own_choices_only,
    profile,
    shortened,
)
from crosscheck.strategies import Hardness, drawn_scenes
from crosscheck.workers.pool import Pool
from refkin.model import Scene
from refkin.motion import Status

STRATA = ((1.0, 3.0), (3.0, 6.0), (6.0, 9.0), (9.0, 12.0), (12.0, 15.0))
"""Decades of the distance to a limit position, or of the slack: 10^-k to 10^-k'."""
FINEST_SLACK = 12.0
"""Lengths whose sums are exact have no slack below this many decades; nearer than that only limits are approached."""
SAMPLES = 12
"""Times per scene that is drawn: a hunt wants scenes, not times."""
A_TURN = 40
"""Scenes of a stratum before the next has its turn."""
CERTIFICATE = "certificate"
"""The quantity whose ratio is the distance from the enclosure of the position, in least errors: no error / allowed."""

Target = tuple[str, str, str]
"""Engine, method, quantity."""
Start = tuple[int, int]
"""Seed and number of a night's scene."""
MOST_STARTS = 12
"""Scenes of a night from which a hunt starts; more, if the worst of every target is not among so many."""


@dataclass(frozen=True)
class Catch:
    """The worst that was met for a target: its ratio, in which scene, from where, after how many, and made for what."""

    ratio: float
    scene: Scene
    origin: str
    number: int
    expected: Status = Status.OK


@dataclass(frozen=True)
class Blame:
    """What the judge calls a disagreement of a hunted method, with the record that says so; the rest as `Catch`."""

    disagreement: Disagreement
    record: Record
    scene: Scene
    origin: str
    number: int

    @property
    def expected(self) -> Status:
        """The verdict that its scene was made for."""
        return _expected(self.record)

    @property
    def ratio(self) -> float:
        """Its error / allowed; 0 where it is about something else."""
        return self.disagreement.ratio or 0.0


@dataclass
class Bag:
    """What a hunt brings home: catches by target, how many scenes were checked, what failed, and who is to blame.

    What failed is scenes that could not be checked, engines that crashed or hung, turns that broke off. Of each kind of
    disagreement the worst is kept; of methods that are not hunted it is counted `beside`, in how many scenes.
    """

    catches: dict[Target, Catch] = field(default_factory=dict)
    scenes: int = 0
    failures: list[str] = field(default_factory=list)
    blames: dict[tuple[str, ...], Blame] = field(default_factory=dict)
    beside: Counter[str] = field(default_factory=Counter)

    @property
    def worst(self) -> float:
        """The largest error / allowed so far."""
        ratios_of_errors = (catch.ratio for (*_, quantity), catch in self.catches.items() if quantity != CERTIFICATE)
        return max(ratios_of_errors, default=0.0)

    def add(self, best: Mapping[str, str], record: Record, scene: Scene, origin: str) -> dict[Target, float]:
        """Keep what is worse in a scene than anything before, and return how bad it is.

        `best` has the best method of each engine: the others are not hunted. `origin` says where the scene is from.
        """
        self.scenes += 1
        if record.failure is not None:
            self.failures.append(f"{record.key}: {record.failure}")
            return {}
        self.failures += [f"{record.key}: {d.engine}: {d.name}" for d in record.disagreements if d.kind in ENDED]
        self._blame(best, record, scene, origin)
        met = dict(ratios(record, best))
        for name, ratio in met.items():
            if name not in self.catches or ratio > self.catches[name].ratio:
                self.catches[name] = Catch(ratio, scene, origin, self.scenes, _expected(record))
        return met

    def _blame(self, best: Mapping[str, str], record: Record, scene: Scene, origin: str) -> None:
        beside = set()
        for d in record.disagreements:
            blame, known = Blame(d, record, scene, origin, self.scenes), self.blames.get(d.signature)
            if d.method not in (best.get(d.engine), ANY, ROWS):  # nor of the engine whatever the method
                beside.add(f"{d.engine} ({d.method}), {d.quantity}: {d.name}")
            elif d.kind not in ENDED and (known is None or blame.ratio > known.ratio):
                self.blames[d.signature] = blame
        self.beside.update(beside)


def _expected(record: Record) -> Status:
    """Return the verdict that the scene of a record was made for."""
    return Status(str(record.about.get("expected", Status.OK)))


def hunt(
    engines: Mapping[str, str],
    seconds: float,
    seed_of_hunt: int,
    *,
    scene_seconds: float,
    starts: Sequence[Start] = (),
    bag: Bag | None = None,
    progress: Callable[[Bag], None] = lambda bag: None,
) -> Bag:
    """Hunt for some time.

    Parameters
    ----------
    engines : mapping
        Name -> what `engines.loading.load` takes for it.
    seconds : float
        After this long no further scene is checked, but for those to begin with.
    seed_of_hunt : int
        The same one hunts in the same places, as far as its time goes.
    scene_seconds : float
        How long a scene may take.
    starts : sequence of (seed, number)
        Scenes of nights to begin with: each is checked at the times that its night had, so that nothing less than what
        the night had is called the worst.
    bag : Bag, optional
        Where the catches go: whoever breaks the hunt off still has them.
    progress : callable
        Is shown the bag after each scene.
    """
    bag, end = Bag() if bag is None else bag, time.monotonic() + seconds
    best = hunted(engines)
    with checkers(1, engines, scene_seconds) as pool:
        hunter = _Hunter(pool, best, bag, end, progress)
        for start in starts:
            hunter.look_at_start(*start)
        with suppress(OutOfTime):
            for origin, turn in _turns(hunter.near, seed_of_hunt, starts):
                hunter.try_turn(origin, turn)
                if time.monotonic() > end:
                    break
    return bag


@dataclass
class _Hunter:
    """Checks one scene after the other until a time; what it meets goes into the bag."""

    pool: Pool
    best: Mapping[str, str]
    bag: Bag
    end: float
    progress: Callable[[Bag], None]

    def try_turn(self, origin: str, turn: Callable[[], object]) -> None:
        """Do what a turn asks for; one that breaks off, be it in Hypothesis, is told and costs no other."""
        try:
            turn()
        except Exception as error:
            self.bag.failures.append(f"{origin}: {type(error).__name__}: {error}")

    def look_at_start(self, night: int, number: int) -> None:
        """Check the scene of a night at all times, and as it had it if it knew it well, however late it is."""
        origin = f"scene {number} of night {night}"

        def both() -> None:
            whole = draw(night, number)
            for drawn in {one.scene: one for one in (whole, in_part(whole))}.values():
                self.look(drawn, origin)

        self.try_turn(origin, both)

    def look(self, drawn: AnyDrawn, origin: str) -> dict[Target, float]:
        """Check a scene, keep what is worse than before, and return how bad it is."""
        try:
            record = self.pool.check_one(by_itself(drawn.scene, expected=expected_of(drawn)))
        except Exception as error:  # told here: Hypothesis would try it again, and say that it is flaky
            self.bag.failures.append(f"{origin}: {type(error).__name__}: {error}")
            return {}
        met = self.bag.add(self.best, record, drawn.scene, origin)
        self.progress(self.bag)
        return met

    def near(self, origin: str) -> Callable[[AnyDrawn], None]:
        """Return what checks scenes from one place for Hypothesis, as long as there is time."""

        def check(drawn: AnyDrawn) -> None:
            if time.monotonic() > self.end:
                raise OutOfTime
            for name, ratio in self.look(drawn, origin).items():
                target(math.log10(max(ratio, 1e-30)), label=" ".join(name))

        return check


def _turns(
    near: Callable[[str], Callable[[AnyDrawn], None]], seed_of_hunt: int, starts: Sequence[Start]
) -> Iterator[tuple[str, Callable[[], None]]]:
    """Yield where is hunted, and how: near scenes of nights, then strata without end."""
    for night, number in starts:
        origin = f"near scene {number} of night {night}"
        yield origin, partial(climb, night, number, near(origin), A_TURN, SAMPLES)
    for turn in count():
        stratum = STRATA[turn % len(STRATA)]
        origin = f"1e-{stratum[0]:g} .. 1e-{stratum[1]:g}"
        yield origin, partial(turn_of, near(origin), stratum, seed_of_hunt * 1000 + turn)


def hunted(engines: Mapping[str, str]) -> dict[str, str]:
    """Return the name of each engine -> its best method; UsageError if one has none that is compared."""
    compared = {name: methods(spec, Use.COMPARE) for name, spec in engines.items()}
    for name, listed in compared.items():
        if not listed:
            raise UsageError(f"--engines: expected engines with a method to compare, got {name!r}: it has none")
    return {name: best.called for name, (best, *_) in compared.items()}


def worst_of_night(folder: Path, best: Mapping[str, str], seed_of_night: int) -> tuple[dict[Start, str], int]:
    """Return the scenes of a night with the largest error / allowed, the worst of each target first, with their keys.

    With them comes how many lines of its records cannot be read.

    Parameters
    ----------
    folder : Path
        The night's.
    best : mapping
        Name of each engine -> its best method: the others are not hunted.
    seed_of_night : int
        By which its scenes were drawn.
    """
    worst: dict[Target, list[tuple[float, int]]] = {}
    keys: dict[int, str] = {}
    unread = 0
    for _, record in read_records(folder / "records.jsonl"):
        unread += isinstance(record, Unreadable)
        if isinstance(record, Unreadable) or not isinstance(record.about.get("shard"), int):
            continue
        number = int(record.about["shard"] or 0)
        keys[number] = record.key
        for name, ratio in ratios(record, best):
            worst.setdefault(name, []).append((ratio, number))
    ranked = [sorted(scenes, reverse=True) for scenes in worst.values()]
    in_turn = [place[1] for places in zip_longest(*ranked) for place in sorted(filter(None, places), reverse=True)]
    most = max(MOST_STARTS, len(worst))
    return {(seed_of_night, number): keys[number] for number in list(dict.fromkeys(in_turn))[:most]}, unread


def drawn_again(starts: Mapping[Start, str]) -> list[Start]:
    """Return those that are drawn as they were, at all times or a part: another version draws other scenes."""
    drawn = {start: draw(*start) for start in starts}
    ways = {start: (one.scene, shortened(one)) for start, one in drawn.items()}
    return [start for start, scenes in ways.items() if starts[start] in (key_of(s) for s in scenes if s is not None)]


def turn_of(check: Callable[[AnyDrawn], None], stratum: tuple[float, float], number: int) -> None:
    """Run Hypothesis once on scenes of a stratum: half of them at random, half near the worst of those.

    Parameters
    ----------
    check : callable
        Says by `hypothesis.target` what makes a scene worse.
    stratum : (low, high)
        As for `hunt`.
    number : int
        Seed of the turn.
    """
    hardness = (Hardness.LIMIT,) if stratum[1] > FINEST_SLACK else (Hardness.LIMIT, Hardness.CHANGE_POINT)
    hard = drawn_scenes(hardness=hardness, decades=stratum, samples=SAMPLES)
    made = settings(profile((Phase.generate, Phase.target)), max_examples=A_TURN)
    with own_choices_only():
        seed(number)(made(given(hard)(check)))()


def ratios(record: Record, best: Mapping[str, str]) -> Iterator[tuple[Target, float]]:
    """Yield the largest error / allowed of each best method at each level, and its distance from the certificate."""
    for answer in record.answers:
        engine, method = answer.engine, answer.method.name
        if best.get(engine) != method:
            continue
        for quantity, compared in answer.quantities.items():
            if compared.ratio is not None:
                yield (engine, method, quantity), compared.ratio
        if answer.certificate is not None and answer.certificate.radii is not None:
            yield (engine, method, CERTIFICATE), answer.certificate.radii
