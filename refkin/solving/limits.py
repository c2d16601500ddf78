"""What a solve would take, before it is begun: one of a million joints is refused with a number, not run in silence."""

from __future__ import annotations

import os
from itertools import pairwise

from refkin.errors import Fault, InvalidScene
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
    """
    mechanism, times = scene.mechanism, len(scene.times)
    kind, bodies = mechanism.kind, mechanism.bodies
    rows = sum(c.rows for c in (*mechanism.constraints, *kind.own_rows(bodies, mechanism.constraints)))
    columns = kind.width * len(bodies) + sum(c.parameters for c in mechanism.constraints)
    size, seconds = 8.0 * rows * columns * times, FLOPS * SECONDS_PER_FLOP * rows * columns**2 * times
    factor = float(os.environ.get(VARIABLE, "1"))
    if size > factor * MOST_BYTES or seconds > factor * MOST_SECONDS:
        needed = max(size / MOST_BYTES, seconds / MOST_SECONDS)
        expected = (
            f"a scene that a dense solve can take: this one, of {columns} coordinates at {times} times, would take "
            f"about {size / 1e9:.3g} GB and {seconds / 3600:.3g} h; set {VARIABLE}={1.05 * needed:.2g} to try, or ask "
            "for fewer times"
        )
        raise InvalidScene([Fault("body", len(mechanism.bodies), expected)], scene.name)
