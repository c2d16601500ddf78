"""Drawing scenes for a night: Hypothesis under a seed derived from the night's seed and the shard.

The parent draws and shrinks; workers solve. A shard can be drawn again, bit for bit, from (seed, shard): that is how a run is
resumed, and how a failure re-enters Hypothesis as a property to shrink.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings

from crosscheck.strategies import Drawn, drawn_scenes

SHARD = 100
"""Scenes per shard."""


class _Found(Exception):
    """The property's failure: the scene still shows the disagreement."""


def profile(phases: tuple[Phase, ...]) -> settings:
    """Return settings that draw anew whatever the environment.

    Under `CI` Hypothesis loads a profile that derandomizes, and every profile derived from it inherits that: the same
    examples every night. So all that matters is set here.
    """
    return settings(
        settings.get_profile("default"),
        max_examples=SHARD,
        phases=phases,
        derandomize=False,
        database=None,
        deadline=None,
        print_blob=False,
        suppress_health_check=list(HealthCheck),
    )


def shard_seed(night: int, shard: int) -> int:
    """Return the seed of a shard; shards of one night and of different nights differ."""
    return night * 100_003 + shard


def draw(night: int, shard: int) -> list[Drawn]:
    """Return the scenes of a shard."""
    scenes: list[Drawn] = []

    @seed(shard_seed(night, shard))
    @profile((Phase.generate,))
    @given(drawn_scenes())
    def collect(drawn: Drawn) -> None:
        scenes.append(drawn)

    collect()
    return scenes


def shrink(
    night: int, shard: int, failing: Drawn, still_fails: Callable[[Drawn], bool], seconds: float = 60.0
) -> Drawn:
    """Return the simplest scene found that still fails, starting from one that was drawn in this shard.

    Parameters
    ----------
    still_fails : callable
        Whether a scene shows the same disagreement; asked only from the failing scene on.
    seconds : float
        After this long the simplest so far is returned.
    """
    best = failing
    end = time.monotonic() + seconds
    met = False

    @seed(shard_seed(night, shard))
    @profile((Phase.generate, Phase.shrink))
    @given(drawn_scenes())
    def property_to_shrink(drawn: Drawn) -> None:
        nonlocal best, met
        met = met or drawn == failing
        if met and time.monotonic() < end and (drawn == failing or still_fails(drawn)):
            best = drawn
            raise _Found

    try:
        property_to_shrink()
    except _Found:
        pass
    except Exception as error:  # Hypothesis calls a property flaky when the time for shrinking is over
        if type(error).__name__ not in ("Flaky", "FlakyFailure", "FlakyReplay"):
            raise
    return best


def describe(drawn: Drawn) -> dict[str, Any]:
    """Return what the generator knows of a scene, as plain data."""
    return {
        "kind": drawn.kind,
        "grashof": None if drawn.grashof is None else drawn.grashof.value,
        "branch": drawn.branch.value,
        "hardness": drawn.hardness.value,
        "distance": drawn.distance,
    }
