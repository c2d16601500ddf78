"""The motion of a scene from an engine's joint tree: the same steps for every engine that has no loop solver."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import hypot, sqrt
from typing import Any

import numpy as np

from crosscheck.engines import Term
from crosscheck.engines.march import March, march
from crosscheck.engines.tree.joint_tree import Array
from crosscheck.engines.tree.tree_system import TreeEngine, TreeSystem
from crosscheck.scenes.names import called_for, order_of
from refkin.joints import GROUND, PointDistance, elements_of
from refkin.model import Mechanism, Scene
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


def link_terms(mechanism: Mechanism) -> tuple[Term, ...]:
    """Return what massless links in the place of distance joints cost: rates that no other formulation knows.

    A link of length L between points at |u_i| and |u_j| on their bodies turns at up to w = (v_i + v_j) / L, with
    v <= (sqrt(2) + |u|) max|qd|, however small its row d . v of the reference is. It stands in two columns, its own
    and that of the body that hangs on it, with an arm of L and 3/2 for every body below it. Each product costs two
    roundings for every frame of the chain, and the solve of n equations n more; all lengths in sizes. Likewise its
    angular acceleration, with a <= (sqrt(2) + 2 |u|) max(|qdd| + |qd|^2), and w^2.
    """
    unit, chain = mechanism.unit(), len(mechanism.bodies)
    velocity = acceleration = 0.0
    for e in elements_of(mechanism.constraints):
        if isinstance(e, PointDistance) and not e.laws:
            length = e.length / unit.size
            arms = [hypot(*u) / unit.size for body, u in e.ends if body != GROUND]
            turning = sum(sqrt(2.0) + arm for arm in arms) / length
            bending = sum(sqrt(2.0) + 2.0 * arm for arm in arms) / length
            roundings = 2.0 * 3.0 * (chain + 1) * (length + 1.5 * chain) * 2.0**-53
            velocity += roundings * turning
            acceleration += roundings * (bending + turning**2)
    why = "a massless link turns fast where its distance joint hardly moves, and every body below turns back"
    return tuple(
        Term(name="massless links", level=level, reason=why, of_rates=size)
        for level, size in (("velocity", velocity), ("acceleration", acceleration))
        if size
    )


def tree_motion(
    engine: TreeEngine,
    scene: Scene,
    producer: Producer,
    accelerations: Accelerations | None = None,
    departing: Accelerations | None = None,
) -> Motion:
    """Return the motion of the bodies and points that a scene wants, at the levels it calls for.

    Parameters
    ----------
    accelerations : callable, optional
        What gives qdd (n,) from q, qd and t, instead of the constraints' own equations.
    departing : callable, optional
        What is added to qdd, likewise.

    Raises
    ------
    EngineError
        If a body of the scene has no estimate.
    """
    order = order_of(scene)
    poses = march(TreeSystem(engine, scene.times), engine.tree.start(), scene.times, order)
    if (accelerations or departing) and order == 2:
        q, qd, qdd = poses.levels
        for k in np.flatnonzero(np.isfinite(qdd).all(axis=0)):
            at = q[:, k], qd[:, k], scene.times[k]
            qdd[:, k] = accelerations(*at) if accelerations else qdd[:, k] + departing(*at)  # type: ignore[misc]
    return marched_motion(engine, scene, poses, producer)


def marched_motion(engine: TreeEngine, scene: Scene, poses: March, producer: Producer) -> Motion:
    """Return what a scene wants of tree coordinates that were found in whatever way, at the levels they have."""
    places = point_levels(engine, poses, [(p.body, p.position) for p in scene.points])
    points = {p.name: called_for(scene, [level[:, k] for level in places]) for k, p in enumerate(scene.points)}
    return engine_motion(
        scene.times,
        scene.wanted,
        *called_for(scene, body_levels(engine, poses, scene.wanted)),
        poses.status,
        producer,
        residual=poses.residual,
        points={name: PointMotion(r=r, v=v, a=a) for name, (r, v, a) in points.items()},
    )


def body_levels(engine: TreeEngine, march: March, bodies: Sequence[str]) -> list[Array]:
    """Return per level (x [m], y [m], phi [rad]) of the bodies in the ground frame, or its derivative, (3 n, T).

    phi is the sum of the joint angles, with its turns; x and y are the engine's own.
    """
    origins = point_levels(engine, march, [(body, (0.0, 0.0)) for body in bodies])
    levels = [np.empty((3 * len(bodies), q.shape[1])) for q in march.levels]
    for order, (rows, origin, q) in enumerate(zip(levels, origins, march.levels, strict=True)):
        rows[0::3], rows[1::3] = origin
        for k, body in enumerate(bodies):
            rows[3 * k + 2] = engine.tree.angle(body, q) if order == 0 else engine.tree.angle_rows[body] @ q
    return levels


def point_levels(engine: TreeEngine, march: March, places: Sequence[tuple[str, Any]]) -> list[Array]:
    """Return per level position [m] of P points of bodies (each [m] in its body's frame), or its derivative, (2, P, T).

    NaN where there is none.
    """
    tree = engine.tree
    levels = [np.full((2, len(places), q.shape[1]), np.nan) for q in march.levels]
    scaled = [(body, tree.scaled(body, u)) for body, u in places]
    there = np.isfinite(march.levels[0]).all(axis=0)
    q, qd, qdd = ([level[:, there].T for level in march.levels] + [None, None])[:3]
    if places and there.any():
        assert q is not None
        for order, level in enumerate(engine.motion(q, qd, qdd, scaled)):
            shift = tree.origin if order == 0 else (0.0, 0.0)
            levels[order][:, :, there] = np.transpose(level * tree.size + shift, (2, 1, 0))
    return levels
