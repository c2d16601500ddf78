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
    given = [e for e in elements_of(m.constraints) if isinstance(e, kinds) and {*e.bodies} <= {GROUND, *shown}]
    while given:
        e = next((e for e in given if not angles.keys().isdisjoint(e.bodies)), given[0])
        given.remove(e)
        (i, j), (ratio, shift) = e.bodies, _given(e, t)
        if i not in angles and j in angles:
            i, j, ratio, shift = j, i, 1.0 / ratio, -shift / ratio
        angles.setdefault(i, shown.get(i, 0.0))
        if j not in angles:
            angles[j] = shown[j] + math.tau * round((ratio * angles[i] + shift - shown[j]) / math.tau)
    moved = {name: angle for name, angle in angles.items() if name != GROUND and angle != shown[name]}
    if not moved:
        return m

    def turned(body: Body) -> Body:
        kept = (body.estimate or ())[:2]
        return replace(body, estimate=(*kept, moved[body.name])) if body.name in moved else body

    return replace(m, bodies=tuple(map(turned, m.bodies)))


def _given(e: Any, t: float) -> tuple[float, float]:
    """Return the angle of body j at a time as so many times that of body i, and so much."""
    if isinstance(e, RollingWheels):
        ratio = -e.radius_i / e.radius_j
        return ratio, e.zero_j - ratio * e.zero_i
    return 1.0, float(e.laws[0](t, 0)) if e.laws else e.angle
