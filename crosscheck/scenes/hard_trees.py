"""Branching mechanisms of many loops: a crank, and dyads hung on any two bodies that are there already."""

from __future__ import annotations

import cmath
import random
from collections.abc import Sequence

from refkin.joints import GROUND, Pair, Revolute
from refkin.scenes.linkages import Pose

Place = tuple[str, Pair]
"""A body and a point of it."""


def dyads(count: int, seed: int, angles: Sequence[float]) -> tuple[list[Revolute], dict[float, Pose]]:
    """Return the joints of a crank with dyads, and the poses at some angles of the crank, right to round-off.

    A dyad is two links pinned to each other and each to a body drawn among those before it, so that loops run through
    all of a branching tree. Lengths are such that at no angle the dyad is near being stretched or folded.
    """
    draw = random.Random(seed)
    joints = [Revolute(name="pivot", body_i=GROUND, point_i=(0.0, 0.0), body_j="crank", point_j=(0.0, 0.0))]
    poses: dict[float, Pose] = {angle: {"crank": (0.0, 0.0, angle)} for angle in angles}
    names = [GROUND, "crank"]
    for n in range(count):
        ends, first, second = _fitting(draw, names, poses)
        a, b = f"a{n}", f"b{n}"
        for pose in poses.values():
            x, y = (_where(pose, end) for end in ends)
            pin = x + _arm(y - x, first, second)
            pose[a] = (x.real, x.imag, cmath.phase(pin - x))
            pose[b] = (y.real, y.imag, cmath.phase(pin - y))
        for link, (body, point) in zip((a, b), ends, strict=True):
            joints.append(Revolute(name=f"foot {link}", body_i=body, point_i=point, body_j=link, point_j=(0.0, 0.0)))
        knee = {"body_i": a, "point_i": (first, 0.0), "body_j": b, "point_j": (second, 0.0)}
        joints.append(Revolute(name=f"knee {n}", **knee))  # type: ignore[arg-type]
        names += [a, b]
    return joints, poses


def _fitting(
    draw: random.Random, names: Sequence[str], poses: dict[float, Pose]
) -> tuple[tuple[Place, Place], float, float]:
    """Return two places and two lengths that join them at every angle."""
    while True:
        i, j = draw.sample(list(names), 2)
        ends = tuple((body, (draw.uniform(-1.0, 1.0), draw.uniform(-1.0, 1.0))) for body in (i, j))
        gaps = [abs(_where(pose, ends[0]) - _where(pose, ends[1])) for pose in poses.values()]
        first, second = (gaps[0] * draw.uniform(0.7, 0.9) for _ in range(2))
        reach = first + second
        if 0.5 < gaps[0] < 4.0 and all(max(0.35 * reach, 1.2 * abs(first - second)) < g < 0.95 * reach for g in gaps):
            return (ends[0], ends[1]), first, second


def _where(pose: Pose, place: Place) -> complex:
    body, point = place
    x, y, phi = pose.get(body, (0.0, 0.0, 0.0))
    return complex(x, y) + complex(*point) * cmath.rect(1.0, phi)


def _arm(base: complex, first: float, second: float) -> complex:
    """Return the first side of a triangle over its base, left of it."""
    d = abs(base)
    return cmath.rect(first, cmath.phase(base) + cmath.acos((d * d + first**2 - second**2) / (2 * first * d)).real)
