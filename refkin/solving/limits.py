"""What a solve would take, before it is begun, and what it takes meanwhile: nothing that is long runs in silence.

One of a million joints is refused with a number. What decides elsewhere, a limit nearly touched, is not seen
beforehand: what takes long says so while it is under way.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise

from refkin.errors import Fault, InvalidScene
from refkin.joints.annotations import check
from refkin.model import Scene
from refkin.proof.numbers.extrema import extrema_of
from refkin.solving.passages import OFTEN

MOST_BYTES, MOST_SECONDS = 8e9, 3600.0
"""What a solve may take; `VARIABLE` multiplies both."""
VARIABLE = "REFKIN_LIMIT"
POSES_PER_TURNING = 9
"""What the way to a pose at which a law turns back costs, in poses at asked times, which are found many at once."""
SECONDS_PER_FLOP, FLOPS = 1e-9, 8.0
"""Of dense elimination; a pose takes some eight: Newton's steps, singular values, the inverse, its proof."""
LONG = 5.0
"""Seconds of silence: what takes longer says so, and again after twice as long."""
LOOK = 0.5
"""Seconds between two looks."""


def expected_seconds(scene: Scene) -> float:
    """Return about how long a solve of the scene takes [s], from some that were measured on one core.

    It goes by way of the poses where laws turn back, but where one law alone turns back often.
    """
    constraints, columns = scene.mechanism.constraints, scene.mechanism.kind.width * len(scene.mechanism.bodies)
    turning = [len(extrema_of(constraints, a, b)) for a, b in pairwise(scene.times)]
    alone = sum(bool(c.laws) for c in constraints) == 1
    passed = sum(3 if alone and count > OFTEN else count for count in turning)
    return (len(scene.times) + POSES_PER_TURNING * passed) * (5e-6 * columns**2 + 2e-5 * columns)


def check_size(scene: Scene) -> None:
    """Raise if a dense solve of the scene would take more memory or time than the limits.

    Raises
    ------
    InvalidScene
        With what it would take, and how the limits are raised.
    InvalidRequest
        If they are raised by what is no number above 0.
    """
    mechanism, times = scene.mechanism, len(scene.times)
    kind, bodies = mechanism.kind, mechanism.bodies
    rows = sum(c.rows for c in (*mechanism.constraints, *kind.own_rows(bodies, mechanism.constraints)))
    columns = kind.width * len(bodies) + sum(c.parameters for c in mechanism.constraints)
    size, seconds = 8.0 * rows * columns * times, FLOPS * SECONDS_PER_FLOP * rows * columns**2 * times
    factor = _factor()
    if size > factor * MOST_BYTES or seconds > factor * MOST_SECONDS:
        needed = max(size / MOST_BYTES, seconds / MOST_SECONDS)
        expected = (
            f"a scene that a dense solve can take: this one, of {columns} coordinates at {times} times, would take "
            f"about {size / 1e9:.3g} GB and {seconds / 3600:.3g} h; set {VARIABLE}={1.05 * needed:.2g} to try, or ask "
            "for fewer times"
        )
        raise InvalidScene([Fault("body", len(mechanism.bodies), expected)], scene.name)


def _factor() -> float:
    """Return by how much the limits are raised."""
    given = os.environ.get(VARIABLE, "1")
    try:
        factor = float(given)
    except ValueError:
        factor = math.nan
    check(VARIABLE, "a number above 0", given, factor > 0.0)
    return factor


@dataclass
class _Begun:
    """What is under way, when it began, and after how long it is to be said next [s]."""

    what: str
    start: float = field(default_factory=time.monotonic)
    due: float = field(default_factory=lambda: LONG)


class _Watch:
    """One thread looks after all that is under way, and ends where nothing is.

    A thread for each would cost as much as a tenth of the solve of one pose. There is no lock: first the thread says
    that it is gone, then it looks a last time; what begins does it the other way round.
    """

    def __init__(self) -> None:
        self.begun: dict[int, _Begun] = {}
        self.thread: threading.Thread | None = None

    def look_after(self, begun: _Begun) -> None:
        self.begun[id(begun)] = begun
        if self.thread is None or not self.thread.is_alive():  # a process that was forked has none
            self.thread = threading.Thread(target=self._look, name="refkin-patience", daemon=True)
            self.thread.start()

    def _look(self) -> None:
        while True:
            time.sleep(LOOK)
            for begun in list(self.begun.values()):
                taken = time.monotonic() - begun.start
                if taken >= begun.due:
                    begun.due = 2.0 * taken
                    import logging  # what takes no time loads nothing for it

                    logging.getLogger("refkin").warning(f"{begun.what}: {taken:.0f} s so far")
            self.thread = None
            if not self.begun:
                return
            self.thread = threading.current_thread()


_WATCH = _Watch()


@contextmanager
def said_if_long(what: str) -> Iterator[None]:
    """Say by the log "refkin", as a warning, that what is done meanwhile takes long, as soon as it does."""
    begun = _Begun(what)
    _WATCH.look_after(begun)
    try:
        yield
    finally:
        del _WATCH.begun[id(begun)]
