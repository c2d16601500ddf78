"""The motion of a scene from an engine's joint tree: the same steps for every engine that has no loop solver."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from crosscheck.engines import Term
from crosscheck.joint_tree import Array
from crosscheck.loop_closing import body_levels, march, point_levels
from crosscheck.tree_system import TreeEngine, TreeSystem
from refkin.model import Effect, Scene
from refkin.motion import Motion, PointMotion, Producer, engine_motion

Accelerations = Callable[[Array, Array, float], Array]

CHAIN = (
    Term(
        name="chain of frames",
        level="position",
        reason="a loop is closed by a chain of up to four frames where the reference composes one: twice the roundings",
        relative=1.0,
    ),
    *(
        Term(
            name="rates down a chain",
            level=level,
            reason="rates are composed down the same chain: two roundings for each of four frames, at both ends",
            relative=16.0 * 2.0**-53,
        )
        for level in ("velocity", "acceleration")
    ),
)


def tree_motion(
    engine: TreeEngine, scene: Scene, producer: Producer, accelerations: Accelerations | None = None
) -> Motion:
    """Return the motion of the bodies and points that a scene wants, at the levels it calls for.

    Parameters
    ----------
    accelerations : callable, optional
        What gives qdd (n,) from q, qd and t, instead of the constraints' own equations.

    Raises
    ------
    EngineError
        If a body of the scene has no estimate.
    """
    order = 2 if Effect.ACCELERATION in scene.effects else 1 if Effect.VELOCITY in scene.effects else 0
    found = march(TreeSystem(engine, scene.mechanism.drivers), scene.times, order)
    if accelerations is not None and order == 2:
        q, qd, qdd = found.levels
        for k in np.flatnonzero(np.isfinite(qdd).all(axis=0)):
            qdd[:, k] = accelerations(q[:, k], qd[:, k], scene.times[k])
    points = {p.name: _reported(scene, point_levels(engine, found, p.body, p.position)) for p in scene.points}
    return engine_motion(
        scene.times,
        scene.wanted,
        *_reported(scene, body_levels(engine, found, scene.wanted)),
        found.status,
        producer,
        residual=found.residual,
        points={name: PointMotion(r=r, v=v, a=a) for name, (r, v, a) in points.items()},
    )


def _reported(scene: Scene, levels: list[Array]) -> tuple[Array, Array | None, Array | None]:
    """Return position, velocity and acceleration; None for what was computed on the way but not called for."""
    velocity = levels[1] if Effect.VELOCITY in scene.effects else None
    return levels[0], velocity, levels[2] if Effect.ACCELERATION in scene.effects else None
