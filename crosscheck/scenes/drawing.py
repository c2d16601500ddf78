"""Drawing scenes for a night: Hypothesis under a seed derived from the night's seed and the scene's number.

Workers draw what they check; the parent shrinks. Every scene has a seed of its own, so any one of a night can be drawn
again, bit for bit, from (seed, number): that is how a run is resumed, and how a failure re-enters Hypothesis as a
property to shrink. Were a hundred drawn in one run of Hypothesis, most would be mutations of their neighbours, with a
third as many different linkages.
"""

from __future__ import annotations

import hashlib
import math
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache
from typing import Any
from unittest import mock

import numpy as np
from hypothesis import HealthCheck, Phase, Verbosity, assume, given, seed, settings
from hypothesis import strategies as st
from hypothesis.database import InMemoryExampleDatabase
from hypothesis.internal.cache import LRUCache
from hypothesis.internal.conjecture import junkdrawer, providers
from hypothesis.internal.constants_ast import Constants

from crosscheck.scenes.featured import Featured, featured_scenes
from crosscheck.strategies import (
    Chain,
    Drawn,
    Ended,
    Spatial,
    chains,
    drawn_scenes,
    ended_scenes,
    equal_linkages,
    spatial_scenes,
)
from crosscheck.strategies.spans import Hardness
from refkin.joints import Driver
from refkin.model import Effect, Point, Scene
from refkin.motion import Status
from refkin.motion_laws import Integral
from refkin.scenes.files import to_toml

SAMPLES = 72
"""Times per scene."""
FEWER_SAMPLES = (2, 3, 5, 9, 18, 36)
"""Numbers of times with which a failing scene is tried before it is shrunk."""
CHAINS_EVERY = 7
"""One in so many scenes is no linkage but a geared five-bar, a rack, a cam or a six-bar (`strategies.chains`)."""
UNEVEN, ENDED, FEATURED, EQUAL, SPECIAL_EVERY = 2, 5, 12, 19, 28
"""Of so many scenes, which one has times that are not evenly apart, which ends in a singular pose or in none, which is
for features of engines, and which has equal links: `strategies.verdicts`, `scenes.featured`."""
POINTED = (3, 17, 23)
"""Of `SPECIAL_EVERY` scenes, which want the motion of a point, on the body in the middle: a coupler."""
SPATIAL, MOST_OF_SPACE = (9, 23), 24
"""Of `SPECIAL_EVERY` scenes, which are of space, and how many times they have at most."""
COSTS = {
    **{"Hooke": 14.0, "Bennett": 9.0, "Bricard": 7.0, "RSCR": 4.5, "double Hooke": 4.0, "RSSR chain": 3.0},
    **{"RSSR": 3.0, "RSSP": 3.0, "PSSR": 3.0, "Stewart": 2.5, "geared": 1.5, "screw": 1.5},
    **{"five-bar with two drivers": 3.0, "branching tree": 3.5, "six-bar": 1.5},
}
"""How many times as long as a four-bar a scene of a kind took in a night, about; others take as long. When they were
first counted a night had a seventh more scenes than were all called alike, and as many pairs of features."""
WARM_UP = 210
"""The first turns of a night check whatever is drawn; then one of `CANDIDATES` scenes, which adds most for its time."""
CANDIDATES = 2
WELL_KNOWN, PART = 4, 4
"""A scene every two of whose features a night has met so often is checked at one of so many parts of its times, of
linkages the one that is nearest to a singular pose, or at so many times fewer (`shortened`): the night moves on to what
it knows less of."""
CALLED_FOR = st.sampled_from(
    (*(frozenset(Effect),) * 21, frozenset(), *(frozenset({effect}) for effect in Effect)),
)
"""Of so many scenes, one calls for positions alone, and one for each of the rates without the other."""
TICKETS = st.integers(0, 2**64 - 1)
"""Drawn before a scene. Hypothesis runs the simplest example first and makes the second differ from it in its first
choice: without a ticket no scene but the simplest would be of the first kind. The simplest ticket, 0, has no scene:
it would cost as much as the one that is asked for."""


def profile(phases: tuple[Phase, ...]) -> settings:
    """Return settings that draw anew whatever the environment.

    Under `CI` Hypothesis loads a profile that derandomizes, and every profile derived from it inherits that: the same
    examples every night. So all that matters is set here. Two examples are run: the simplest and the one drawn.
    """
    return settings(
        settings.get_profile("default"),
        max_examples=2,
        phases=phases,
        derandomize=False,
        database=None,
        deadline=None,
        print_blob=False,
        report_multiple_bugs=False,
        verbosity=Verbosity.quiet,
        backend="hypothesis",
        suppress_health_check=list(HealthCheck),
    )


def seed_of_scene(night: int, number: int) -> int:
    """Return the seed of one scene; it has nothing in common with that of its neighbours or of other nights."""
    return int.from_bytes(hashlib.sha256(f"{night} {number}".encode()).digest()[:8], "big")


AnyDrawn = Drawn | Chain | Ended | Spatial | Featured


def is_chain(number: int) -> bool:
    """Whether the scene of that number is one of `strategies.chains`."""
    return number % CHAINS_EVERY == CHAINS_EVERY - 1


def numbers_of(turn: int) -> tuple[int, ...]:
    """Return the numbers of the scenes of which a night checks one in its turn 0, 1, 2 ...: all chains, or none."""
    if turn < WARM_UP:
        return (turn,)
    block, place = divmod(turn - WARM_UP, CHAINS_EVERY)
    first = WARM_UP + CANDIDATES * CHAINS_EVERY * block + place
    return tuple(first + CHAINS_EVERY * k for k in range(CANDIDATES))


def turn_of(number: int) -> int:
    """Return the turn of a night in which the scene of that number may be checked."""
    if number < WARM_UP:
        return number
    block, place = divmod(number - WARM_UP, CANDIDATES * CHAINS_EVERY)
    return WARM_UP + CHAINS_EVERY * block + place % CHAINS_EVERY


def draw(night: int, number: int, samples: int = SAMPLES) -> AnyDrawn:
    """Return the scene of a number in a night.

    Parameters
    ----------
    night, number : int
        Seed of the night, and 0, 1, 2 ... in it.
    samples : int
        Times of the scene: linkage and motion are the same for any.
    """
    scenes: list[AnyDrawn] = []
    _run(night, number, samples, (Phase.generate,), scenes.append)
    return scenes[-1]


def shrink(
    night: int, number: int, still_fails: Callable[[AnyDrawn], bool], seconds: float, *, part: bool = False
) -> tuple[AnyDrawn | None, int]:
    """Return the simplest scene found that fails as the one drawn under this number did, and how many were tried.

    The motion is first sampled at fewer times, as few as show the failure, then Hypothesis simplifies what it drew. The
    scene is None if not even the one as it was drawn fails again.

    Parameters
    ----------
    night, number : int
        As for `draw`.
    still_fails : callable
        Whether a scene shows the same disagreement.
    seconds : float
        After this long the simplest so far is returned.
    part : bool
        Whether a scene is asked as a night asks one that it knows well (`in_part`).
    """
    end = time.monotonic() + seconds
    checked, times_drawn = (in_part, PART) if part else (lambda drawn: drawn, 1)
    best, samples = checked(draw(night, number)), SAMPLES
    fails = {best.scene: still_fails(best)}  # asked once per scene, so that Hypothesis never sees it waver
    if not fails[best.scene]:
        return None, 1

    def property_to_shrink(drawn: AnyDrawn) -> None:
        nonlocal best
        drawn = checked(drawn)
        if drawn.scene not in fails:
            if time.monotonic() > end:
                raise OutOfTime
            fails[drawn.scene] = still_fails(drawn)
        if fails[drawn.scene]:
            best = min(drawn, best, key=lambda one: effort(one.scene))
            raise _FailingScene

    try:
        for fewer in FEWER_SAMPLES:
            with suppress(_FailingScene):
                property_to_shrink(draw(night, number, times_drawn * fewer))
            if len(best.scene.times) == fewer:
                samples = times_drawn * fewer
                break
        _run(night, number, samples, (Phase.generate, Phase.shrink), property_to_shrink)
    except (_FailingScene, OutOfTime):
        pass
    return best, len(fails)


def climb(night: int, number: int, check: Callable[[AnyDrawn], None], examples: int, samples: int) -> None:
    """Check scenes that Hypothesis derives from the one drawn under this number, at fewer times.

    The choices that drew the scene are kept as those of a failure, which is where Hypothesis begins.

    Parameters
    ----------
    night, number : int
        As for `draw`.
    check : callable
        Says by `hypothesis.target` what makes a scene worse.
    examples : int
        How many scenes are checked at most.
    samples : int
        Times of each.
    """
    start = draw(night, number, samples).scene
    kept = InMemoryExampleDatabase()
    drawing = True

    def scene_property(drawn: AnyDrawn | None) -> None:
        if drawn is None:
            return
        if not drawing:
            check(drawn)
        elif drawn.scene == start:
            raise _FailingScene

    scenes = _scenes_at(number % SPECIAL_EVERY, samples)
    seeded = seed(seed_of_scene(night, number))  # a seed forgets a database
    first = settings(profile((Phase.generate,)), database=kept)
    then = settings(profile((Phase.reuse, Phase.generate, Phase.target)), database=kept, max_examples=examples)
    with own_choices_only():
        with suppress(_FailingScene):
            first(seeded(given(scenes)(scene_property)))()
        drawing = False
        then(seeded(given(scenes)(scene_property)))()


@st.composite
def _with_ticket(draw: st.DrawFn, scenes: st.SearchStrategy[Any], refused: bool) -> Any:
    if draw(TICKETS):
        drawn = draw(scenes)
        scene = drawn.scene if refused else replace(drawn.scene, effects=draw(CALLED_FOR, label="effects"))
        return replace(drawn, scene=scene)
    assume(not refused)
    return None


@cache  # Hypothesis looks through a strategy that it has not met for as long as it draws from it
def _scenes_at(place: int, samples: int) -> st.SearchStrategy[Any]:
    """Return the scenes of the kind that a place of `SPECIAL_EVERY` has; None for the simplest ticket.

    Of equal links and for features, that is refused, as their simplest scenes are: so two more are drawn, and a number
    has the scene that it always had.
    """
    kind = _kind_at(place, samples)
    return _with_ticket(kind.map(_pointed) if place in POINTED else kind, place in (EQUAL, FEATURED))


def _kind_at(place: int, samples: int) -> st.SearchStrategy[Any]:
    if is_chain(place):  # `CHAINS_EVERY` divides `SPECIAL_EVERY`
        return chains(samples=samples)
    if place in SPATIAL:
        return spatial_scenes(samples=min(samples, MOST_OF_SPACE))
    if place == ENDED:
        return ended_scenes(samples=samples)
    if place == FEATURED:
        return featured_scenes(samples=samples)
    if place == UNEVEN:
        return drawn_scenes(samples=samples).map(_unevenly)
    return equal_linkages(samples) if place == EQUAL else drawn_scenes(samples=samples)


def _pointed(drawn: Any) -> Any:
    """Return the same scene with a point that is wanted: beside the line of the joints, and out of their plane."""
    m = drawn.scene.mechanism
    place = tuple(m.size() * part for part in (0.75, -0.375, 0.5))[: m.kind.dimension]
    point = Point(name="P", body=m.bodies[len(m.bodies) // 2].name, position=place)
    return replace(drawn, scene=replace(drawn.scene, points=(point,)))


def _unevenly(drawn: Drawn) -> Drawn:
    """Return the same motion at times of which the last are three times as far apart as the first."""
    times = drawn.scene.times
    first, whole = times[0], times[-1] - times[0]
    moved = (t if t in (first, times[-1]) else first + (t - first) * (1.0 + (t - first) / whole) / 2.0 for t in times)
    return replace(drawn, scene=replace(drawn.scene, times=tuple(moved)))


def shortened(drawn: AnyDrawn) -> Scene | None:
    """Return a scene at a part of its times; None if no part will do.

    A linkage, whose poses are known in closed form, begins at another of them: it is checked where it is nearest to a
    singular pose. What ends on purpose goes all the way to its end, in longer steps. Of other scenes that keep away
    from singular poses it is the first part.
    """
    scene, few = drawn.scene, math.ceil(len(drawn.scene.times) / PART)
    if isinstance(drawn, Ended):
        return replace(scene, times=tuple(np.linspace(scene.times[0], scene.times[-1], few).tolist()))
    if isinstance(drawn, Drawn):
        return drawn.nearest(few)
    plain = drawn.hardness == Hardness.REGULAR and not isinstance(drawn, Featured)
    return replace(scene, times=scene.times[:few]) if plain else None


def in_part(drawn: AnyDrawn) -> AnyDrawn:
    """Return a scene at the part of its times at which a night checks it that knows it well, if there is one."""
    return replace(drawn, scene=shortened(drawn) or drawn.scene)


def effort(scene: Scene) -> int:
    """Return how much there is to read in a scene, which shrinking makes less: the digits of all its numbers."""
    return sum(len(digits) for digits in re.findall(r"\d+", to_toml(scene)))


def describe(drawn: AnyDrawn) -> dict[str, Any]:
    """Return what the generator knows of a scene, as plain data: `crosscheck.scenes.names.FEATURES` among it."""
    mechanism = drawn.scene.mechanism
    grashof = None if drawn.grashof is None else drawn.grashof.value
    return {
        "kind": drawn.kind,
        "grashof": grashof,
        "class": grashof or drawn.kind,
        "branch": drawn.branch.value,
        "hardness": drawn.hardness.value,
        "distance": drawn.distance,
        "expected": expected_of(drawn).value,
        "joints": ", ".join(sorted({joint.type for joint in mechanism.joints})),
        "driver": ", ".join(driver.type for driver in mechanism.drivers),
        "law": ", ".join(_law_of(driver) for driver in mechanism.drivers),
        "of_features": isinstance(drawn, Featured),
    }


def expected_of(drawn: AnyDrawn) -> Status:
    """Return the verdict that a scene was made for."""
    return drawn.expected if isinstance(drawn, Ended) else Status.OK


def _law_of(driver: Driver) -> str:
    """Return the type of a driver's law, and whether it is given as a rate."""
    law = driver.laws[0]
    name = type(law.rate if isinstance(law, Integral) else law).__name__.lower()
    return f"rate {name}" if isinstance(law, Integral) else name


_permitted_constants: LRUCache[Any, Any] = LRUCache(1024)


class _FailingScene(Exception):
    """The property's failure: the scene still shows the disagreement."""


class OutOfTime(BaseException):
    """Ends a run of Hypothesis at once: no Exception, which it would take for one more failure."""


def _run(night: int, number: int, samples: int, phases: tuple[Phase, ...], do: Callable[[AnyDrawn], None]) -> None:
    """Run Hypothesis on one scene of a night and, with `Phase.shrink`, on simpler ones."""

    @seed(seed_of_scene(night, number))
    @profile(phases)
    @given(_scenes_at(number % SPECIAL_EVERY, samples))
    def scene_property(drawn: AnyDrawn | None) -> None:
        if drawn is not None:
            do(drawn)

    # Without a database no key is needed, which would be a digest of this source: a tenth of what a scene takes.
    scene_property._hypothesis_internal_database_key = b""  # type: ignore[attr-defined]
    with own_choices_only():
        scene_property()


@contextmanager
def own_choices_only() -> Iterator[None]:
    """Keep Hypothesis from mixing into its choices the numbers that stand in the source of imported local modules.

    With them, what is drawn would depend on which modules happen to be loaded and on where the package is installed.
    Hypothesis offers no setting for it (6.131 and later, which pyproject.toml asks for, up to the next that was tried).
    """
    with (
        mock.patch.object(providers, "_get_local_constants", Constants),
        mock.patch.object(providers, "CONSTANTS_CACHE", _permitted_constants),
        # Nor does it time garbage collections: what a signal raises in that would be told, and lost.
        mock.patch.object(junkdrawer, "_gc_initialized", True),
    ):
        yield
