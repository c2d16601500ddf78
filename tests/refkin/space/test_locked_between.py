"""Redundant rows that share a pose at two times and none between them: no sweep goes from one to the other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import refkin
from refkin import Scene, Status
from refkin.analysis import sweep
from refkin.proof.path.tracing import TraceEnd
from refkin.scenes.linkages import Bennett

LINKAGE = Bennett(1.0, 0.7, 1.2)


def loop() -> Scene:
    """Return a loop of four revolutes that closes at its first pose alone: three of them have any other axes there."""
    numbers, scene = np.random.default_rng(0), LINKAGE.scene(start=0.4, samples=2)
    first = refkin.solve(replace(scene, times=scene.times[:1]))
    joints: list[Any] = [scene.mechanism.joints[0]]
    for joint in scene.mechanism.joints[1:]:
        axis, other, point = numbers.normal(size=(3, 3))
        axis /= np.linalg.norm(axis)
        zero = np.cross(axis, other) / np.linalg.norm(np.cross(axis, other))
        own = {}
        for side, body in (("i", joint.body_i), ("j", joint.body_j)):  # type: ignore[attr-defined]
            r, a = (np.zeros(3), np.eye(3)) if body == "ground" else (first[body].q[:3, 0], _turned(first[body]))
            for key, of in (("point", a.T @ (point - r)), ("axis", a.T @ axis), ("zero", a.T @ zero)):
                own[f"{key}_{side}"] = tuple(of.tolist())
        joints.append(replace(joint, **own))
    mechanism = replace(scene.mechanism, joints=tuple(joints))
    return replace(scene, mechanism=mechanism, effects=frozenset())


def _turned(body: Any) -> Any:
    return np.asarray(body.rotation).reshape(3, 3)


def test_a_loop_that_cannot_move_is_not_swept_along_least_squares_to_where_it_closes_again() -> None:
    """The driver turns once around: the second pose is the first, and there is none on the way."""
    motion = refkin.solve(loop())

    assert motion.status == (Status.OK, Status.BRANCH_LOST)
    assert sweep(loop()).status == motion.status  # the plain one stepped along them for minutes


def test_a_path_of_a_loop_that_cannot_move_stops_where_it_starts() -> None:
    path = refkin.follow(loop())

    assert path.end is TraceEnd.STOPPED
    assert np.max(path.residual) <= 1e-9
    assert np.max(np.abs(path.t - path.t[0])) < 1e-6
