"""Features of engines as their users use them: what the adapters make safe elsewhere is left as it is.

A feature is a method of its own (`Use.FEATURE`). A night asks it of the scenes that are drawn for it
(`crosscheck.scenes.featured`), and its answers are judged like any other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from crosscheck.engines import Array, EngineRefusal
from refkin.joints import GROUND, Pair, PointsCoincide, RelativeAngle, Unit, elements_of
from refkin.model import Scene
from refkin.motion import Motion, Route, Status


@dataclass(frozen=True)
class Pins:
    """What features are asked about: pins, and angles that laws drive.

    Attributes
    ----------
    ends : sequence of ((body i, point), (body j, point))
        Of each pin, in sizes; on the ground from the mechanism's first ground point.
    """

    bodies: tuple[str, ...]
    times: Sequence[float]
    unit: Unit
    ends: Sequence[tuple[tuple[str, Pair], ...]]
    driven: Sequence[RelativeAngle]


def pins_of(scene: Scene, route: Route) -> Pins:
    """Return the pins and driven angles of a scene.

    Raises
    ------
    EngineRefusal
        If it has anything else.
    """
    unit, ends, driven = scene.mechanism.unit(), [], []
    for e in elements_of(scene.mechanism.constraints):
        if isinstance(e, PointsCoincide) and not e.laws:
            ends.append(tuple((body, _scaled(unit, body, point)) for body, point in e.ends))
        elif isinstance(e, RelativeAngle) and e.laws:
            driven.append(e)
        else:
            raise EngineRefusal(f"the feature {route.name!r} is asked for pins and driven angles, not for {e.key}")
    return Pins(tuple(body.name for body in scene.mechanism.bodies), scene.times, unit, ends, driven)


def _scaled(unit: Unit, body: str, point: Pair) -> Pair:
    x, y = unit.origin if body == GROUND else (0.0, 0.0)
    return (point[0] - x) / unit.size, (point[1] - y) / unit.size


def with_rates(
    motion: Motion, pins: Pins, route: Route, jacobian: Callable[[Array], Array], drift: Callable[[Array, Array], Array]
) -> Motion:
    """Return a motion with velocity and acceleration from a feature's rows of the pins.

    Parameters
    ----------
    motion : Motion
        Positions of all bodies, by another method of the same engine.
    jacobian, drift : callable
        q (3 bodies,) -> rows of the pins (m, 3 bodies); q and qd -> gamma (m,); in sizes and rad.
    """
    columns = {name: 3 * k + 2 for k, name in enumerate(pins.bodies)}
    turning = np.zeros((len(pins.driven), 3 * len(pins.bodies)))
    for row, e in zip(turning, pins.driven, strict=True):
        for body, sign in ((e.body_i, -1.0), (e.body_j, 1.0)):
            if body != GROUND:
                row[columns[body]] += sign
    scale = np.tile([pins.unit.size, pins.unit.size, 1.0], len(pins.bodies))
    shift = np.tile([*pins.unit.origin, 0.0], len(pins.bodies))
    qd, qdd = np.full((2, *motion.q.shape), np.nan)
    for k in [k for k, status in enumerate(motion.status) if status is Status.OK]:
        q, t = (motion.q[:, k] - shift) / scale, pins.times[k]
        rate, bend = ([float(e.laws[0](t, order)) for e in pins.driven] for order in (1, 2))
        rows = np.vstack([jacobian(q), turning])
        still = np.zeros(len(rows) - len(pins.driven))
        speed = _solved(rows, np.append(still, rate))
        qd[:, k] = speed * scale
        qdd[:, k] = _solved(rows, np.append(drift(q, speed), bend)) * scale
    return replace(motion, qd=qd, qdd=qdd, producer=replace(motion.producer, route=route))


def _solved(rows: Array, right: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(rows, right), float)
    except np.linalg.LinAlgError:  # rows that are no derivatives may be dependent where the motion is regular
        return np.asarray(np.linalg.lstsq(rows, right, rcond=None)[0], float)
