"""The estimates of a scene of the plane, in the turns in which its drivers begin."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from crosscheck.engines import in_space
from refkin.joints import GROUND, RelativeAngle, RollingWheels, elements_of
from refkin.model import Body, Mechanism, Scene


def as_driven(scene: Scene) -> Mechanism:
    """Return a scene's mechanism with whole turns added to estimates, as drivers, fixed angles and gears ask for.

    A law may begin whole turns from where an estimate shows the same pose: from there Newton would go anywhere. Bodies
    whose angles nothing gives stay as they are, and so does a mechanism of space, whose estimates have no turns.
    """
    m, t = scene.mechanism, scene.times[0]
    if in_space(m):
        return m
    shown = {body.name: body.estimate[2] for body in m.bodies if body.estimate is not None}
    angles = {GROUND: 0.0}
    kinds = (RelativeAngle, RollingWheels)
    sums = [_sum(e, t) for e in elements_of(m.constraints) if isinstance(e, kinds) and {*e.bodies} <= {GROUND, *shown}]
    while sums:
        weights, total = min(sums, key=lambda s: len(s[0].keys() - angles.keys()))  # the first of those with the fewest
        sums.remove((weights, total))
        *free, last = [body for body in weights if body not in angles] or [GROUND]
        angles |= {body: shown[body] for body in free}
        if last not in angles:
            others = sum(weight * angles[body] for body, weight in weights.items() if body != last)
            turns = ((total - others) / weights[last] - shown[last]) / math.tau
            angles[last] = shown[last] + math.tau * round(turns)
    moved = {name: angle for name, angle in angles.items() if name != GROUND and angle != shown[name]}
    if not moved:
        return m

    def turned(body: Body) -> Body:
        kept = (body.estimate or ())[:2]
        return replace(body, estimate=(*kept, moved[body.name])) if body.name in moved else body

    return replace(m, bodies=tuple(map(turned, m.bodies)))


def _sum(e: Any, t: float) -> tuple[dict[str, float], float]:
    """Return the weights of the bodies' angles in what an element says of them at a time, and what their sum is."""
    if isinstance(e, RollingWheels):
        wheels = {e.body_i: 1.0, e.body_j: e.radius_j / e.radius_i}
        carried = {e.carrier: -sum(wheels.values())} if e.carrier != GROUND else {}
        return wheels | {body: w for body, w in carried.items() if w}, e.zero_i + wheels[e.body_j] * e.zero_j
    return {e.body_i: -1.0, e.body_j: 1.0}, float(e.laws[0](t, 0)) if e.laws else e.angle
