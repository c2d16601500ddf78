"""A motion as the object that `crosscheck solve --json` prints; numbers that nobody delivered are null."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from refkin.model import Scene
from refkin.motion import Motion

SCHEMA = 1


def to_json(scene: Scene, motion: Motion) -> dict[str, Any]:
    """Return the answer to a scene as plain data; levels that were not called for are absent."""
    radius = motion.certified_radius
    return {
        "schema": SCHEMA,
        "scene": scene.name,
        "verdict": motion.verdict.value,
        "message": motion.message,
        "t": numbers(motion.t),
        "status": [s.value for s in motion.status],
        "bodies": {
            body: _called_for(q=motion[body].q, qd=motion[body].qd, qdd=motion[body].qdd) for body in motion.bodies
        },
        "points": {name: _called_for(r=p.r, v=p.v, a=p.a) for name, p in motion.points.items()},
        "residual": numbers(motion.residual),
        "sigma_min": numbers(motion.sigma_min),
        "condition": numbers(motion.condition),
        "certified_radius": {
            "position": numbers(radius.position),
            "velocity": numbers(radius.velocity),
            "acceleration": numbers(radius.acceleration),
        },
    }


def numbers(values: Iterable[float]) -> list[float | None]:
    """Return floats with None for what is not finite."""
    return [float(v) if np.isfinite(v) else None for v in values]


def _called_for(**levels: Any) -> dict[str, Any]:
    """Return each level that was called for as one row of components per time."""
    return {key: [numbers(row) for row in level.T] for key, level in levels.items() if level is not None}
