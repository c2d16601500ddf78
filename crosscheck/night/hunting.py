"""The hunt for the worst error / allowed: Hypothesis `target()` over scenes in strata of distance to a singular pose.

Each stratum takes its turn: some scenes at random, then such as Hypothesis derives from the worst of them. Every best
route, at every level, is a target of its own, and so is its distance from the certificate's enclosure in attainable
radii, which is known where a budget of first order says nothing. A ratio above 1 is a finding, or a budget that forgot
something.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from hypothesis import HealthCheck, Phase, Verbosity, given, seed, settings, target

from crosscheck.engines import load
from crosscheck.scenes.drawing import describe
from crosscheck.strategies import Drawn, Hardness, drawn_scenes
from crosscheck.workers.pool import Workers
from refkin.model import Scene
from refkin.scenes.files import to_dict

STRATA = ((1.0, 3.0), (3.0, 6.0), (6.0, 9.0), (9.0, 12.0), (12.0, 15.0))
"""Decades of the distance to a limit position, or of the slack: 10^-k to 10^-k'."""
FINEST_SLACK = 12.0
"""Lengths whose sums are exact have no slack below this many decades; nearer than that only limits are approached."""
SAMPLES = 12
"""Times per scene: a hunt wants scenes, not times."""
A_TURN = 40
"""Scenes of a stratum before the next has its turn."""
CERTIFICATE = "certificate"
"""The quantity whose ratio is the distance from the enclosure of the position, in attainable radii."""

Target = tuple[str, str, str]
"""Engine, route, quantity."""


@dataclass(frozen=True)
class Catch:
    """The worst that was found for a target: its ratio, in which scene of which stratum, after how many scenes."""

    ratio: float
    scene: Scene
    stratum: tuple[float, float]
    number: int


@dataclass
class Bag:
    """What a hunt brings home.

    Attributes
    ----------
    catches : dict
        By target.
    scenes : int
        How many were checked.
    failures : list of str
        Scenes that could not be checked, engines that crashed or hung.
    """

    catches: dict[Target, Catch]
    scenes: int
    failures: list[str]

    def above(self, limit: float = 1.0) -> list[tuple[Target, Catch]]:
        """Return the catches with a ratio above a limit, the worst first."""
        found = [(name, catch) for name, catch in self.catches.items() if catch.ratio > limit]
        return sorted(found, key=lambda pair: -pair[1].ratio)


def hunt(
    engines: Mapping[str, str],
    seconds: float,
    night: int,
    *,
    scene_seconds: float,
    strata: Sequence[tuple[float, float]] = STRATA,
    progress: Callable[[Bag], None] = lambda bag: None,
) -> Bag:
    """Hunt for some time.

    Parameters
    ----------
    engines : mapping
        Name -> what `crosscheck.engines.load` takes for it.
    seconds : float
        After this long no further scene is checked.
    night : int
        The seed; the same one hunts in the same places, as far as its time goes.
    """
    bag, end = Bag({}, 0, []), time.monotonic() + seconds
    best = {name: load(spec).routes()[0].name for name, spec in engines.items()}
    with Workers(1, engines, scene_seconds) as pool:
        turn = 0
        while time.monotonic() < end:
            stratum = strata[turn % len(strata)]

            def check(drawn: Drawn) -> None:
                if time.monotonic() > end:
                    raise _OutOfTime
                record = pool.check_one({"scene": to_dict(drawn.scene), "about": describe(drawn), "arbiter": True})
                _weigh(bag, best, record, drawn.scene, stratum)  # noqa: B023 - it is done with before the next turn
                progress(bag)

            with suppress(_OutOfTime):
                turn_of(check, stratum, night * 1000 + turn)
            turn += 1
    return bag


class _OutOfTime(Exception):
    """Ends a turn."""


def turn_of(check: Callable[[Drawn], None], stratum: tuple[float, float], number: int) -> None:
    """Run Hypothesis once on scenes of a stratum: half of them at random, half near the worst of those."""
    hardness = (Hardness.LIMIT,) if stratum[1] > FINEST_SLACK else (Hardness.LIMIT, Hardness.CHANGE_POINT)
    hard = drawn_scenes(hardness=hardness, decades=stratum, samples=SAMPLES)
    made = settings(
        settings.get_profile("default"),
        max_examples=A_TURN,
        phases=(Phase.generate, Phase.target),
        derandomize=False,
        database=None,
        deadline=None,
        print_blob=False,
        report_multiple_bugs=False,
        verbosity=Verbosity.quiet,
        suppress_health_check=list(HealthCheck),
    )
    seed(number)(made(given(hard)(check)))()


def ratios(record: Mapping[str, Any], best: Mapping[str, str]) -> Iterator[tuple[Target, float]]:
    """Yield the largest error / allowed of each best route at each level, and its distance from the certificate."""
    for answer in record["answers"]:
        engine, route = answer["engine"], answer["route"]["name"]
        if best.get(engine) != route:
            continue
        for quantity, told in answer["quantities"].items():
            if told["ratio"] is not None:
                yield (engine, route, quantity), told["ratio"]
        told = answer.get("certificate")
        if told is not None and told["radii"] is not None:
            yield (engine, route, CERTIFICATE), told["radii"]


def _weigh(
    bag: Bag, best: Mapping[str, str], record: Mapping[str, Any], scene: Scene, stratum: tuple[float, float]
) -> None:
    """Tell Hypothesis how bad a scene is, and keep what is worse than anything before."""
    bag.scenes += 1
    if "failure" in record:
        bag.failures.append(f"{record['key']}: {record['failure']}")
        return
    gone = [told for told in record["disagreements"] if told["kind"].startswith(("crash", "hang", "error"))]
    bag.failures += [f"{record['key']}: {told['engine']}: {told['kind']}" for told in gone]
    for name, ratio in ratios(record, best):
        target(math.log10(max(ratio, 1e-30)), label=" ".join(name))
        if name not in bag.catches or ratio > bag.catches[name].ratio:
            bag.catches[name] = Catch(ratio, scene, stratum, bag.scenes)
