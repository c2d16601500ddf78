"""What each joint and driver means, in metres and complex numbers: written apart from refkin, to hold it against.

A point u of a body is z + e^(i phi) u, with z = x + i y; a . b is Re(conj(a) b).
"""

from __future__ import annotations

import cmath
from collections.abc import Mapping
from typing import Any

from refkin.joints import Constraint

Pose = tuple[complex, float]
"""Place z and angle phi of a body."""


def expected_residual(c: Any, pose: Mapping[str, Pose], t: float, s: float) -> list[float]:
    """Return the rows of a constraint at a pose; `s` is the contact parameter, where there is one."""
    if c.type in ("angle", "x", "y"):
        return [_driven(c, pose, c.laws[0](t))]
    if c.type == "gear":
        return [
            sum(
                r * (pose[b][1] - z) for r, b, z in ((c.radius_i, c.body_i, c.phi0_i), (c.radius_j, c.body_j, c.phi0_j))
            )
        ]
    gap = _point(pose[c.body_j], c.point_j) - _point(pose[c.body_i], c.point_i)
    turned = pose[c.body_j][1] - pose[c.body_i][1]
    if c.type == "revolute":
        apart = complex(*(law(t) for law in c.laws)) if c.laws else 0j
        return _parts(gap - apart)
    if c.type == "fixed":
        return [*_parts(gap), turned - c.angle]
    if c.type == "distance":
        length = c.laws[0](t) if c.laws else c.length
        return [(abs(gap) ** 2 - length**2) / 2 / (1.0 if c.laws else length)]
    if c.type == "cam":
        return _contact(c, gap, pose, s)
    along = _direction(pose[c.body_i], c.axis_i)
    if c.type == "rack_and_pinion":
        return [_dot(along, gap) - c.s0 - c.radius * (turned - c.phi0)]
    across = [_dot(1j * along, gap)]
    return [*across, turned - c.angle] if c.type == "prismatic" else across


def dimensions(constraint: Constraint) -> list[int]:
    """Return for each row the power of length that it has."""
    if constraint.type == "distance" and constraint.laws:
        return [2]
    by_type = {"fixed": [1, 1, 0], "prismatic": [1, 0], "angle": [0]}
    return by_type.get(constraint.type, [1] * constraint.rows)


def _driven(c: Any, pose: Mapping[str, Pose], value: float) -> float:
    if c.type == "angle":
        return pose[c.body][1] - pose[c.relative_to][1] - value
    at = _point(pose[c.body], c.point)
    return (at.real if c.type == "x" else at.imag) - value


def _contact(c: Any, gap: complex, pose: Mapping[str, Pose], s: float) -> list[float]:
    rho = c.roller_radius or 0.0
    face = _direction(pose[c.body_j], c.normal_j) if c.normal_j else 0j
    if c.profile.kind == "disc":
        away = c.profile.radius + rho
        return [_dot(face, gap) - away] if face else [(abs(gap) ** 2 - away**2) / (2 * away)]
    out = cmath.exp(1j * (pose[c.body_i][1] + s))
    d, slope = c.profile.law(s, 0), c.profile.law(s, 1)
    missing, tangent = gap - d * out, (slope + 1j * d) * out
    if face:
        return [_dot(face, missing), _dot(face, tangent)]
    return [_dot(missing, tangent) / rho, (abs(missing) ** 2 - rho**2) / (2 * rho)] if rho else _parts(missing)


def _point(body: Pose, u: tuple[float, float]) -> complex:
    return body[0] + cmath.exp(1j * body[1]) * complex(*u)


def _direction(body: Pose, axis: tuple[float, float]) -> complex:
    turned = cmath.exp(1j * body[1]) * complex(*axis)
    return turned / abs(turned)


def _dot(a: complex, b: complex) -> float:
    return (a.conjugate() * b).real


def _parts(z: complex) -> list[float]:
    return [z.real, z.imag]
