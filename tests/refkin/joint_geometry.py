"""What each element means, in metres and complex numbers: written apart from refkin, to hold its formulas against.

A point u of a body is z + e^(i phi) u, with z = x + i y; a . b is Re(conj(a) b).
"""

from __future__ import annotations

import cmath
from collections.abc import Mapping
from typing import Any

from refkin.joints import (
    Contact,
    Element,
    GuidedPoint,
    PointCoordinate,
    PointDistance,
    PointsCoincide,
    RelativeAngle,
    RollingOnLine,
    RollingWheels,
)

Pose = tuple[complex, float]
"""Place z and angle phi of a body."""
POWERS = {PointsCoincide: (1, 1), RelativeAngle: (0,), Contact: (1, 1)}
"""Per row the power of length that it has, of elements that have not one row of a length."""


def expected_rows(e: Any, pose: Mapping[str, Pose], t: float, s: float) -> list[float]:
    """Return the rows of an element at a pose; `s` is the contact parameter, where there is one."""
    values = [law(t) for law in e.laws]
    if isinstance(e, PointCoordinate):
        at = _point(pose[e.body_j], e.point_j)
        return [_parts(at)[e.axis] - values[0]]
    turned = pose[e.body_j][1] - pose[e.body_i][1]
    if isinstance(e, RelativeAngle):
        return [turned - (values[0] if values else e.angle)]
    if isinstance(e, RollingWheels):
        wheels = (e.radius_i, e.body_i, e.zero_i), (e.radius_j, e.body_j, e.zero_j)
        return [sum(radius * (pose[body][1] - pose[e.carrier][1] - zero) for radius, body, zero in wheels)]
    gap = _point(pose[e.body_j], e.point_j) - _point(pose[e.body_i], e.point_i)
    if isinstance(e, PointsCoincide):
        return _parts(gap - (complex(*values) if values else 0j))
    if isinstance(e, PointDistance):
        length = values[0] if values else e.length
        return [(abs(gap) ** 2 - length**2) / 2 / (1.0 if values else length)]
    if isinstance(e, Contact):
        return _contact(e, gap, pose, s)
    along = _direction(pose[e.body_i], e.axis_i)
    if isinstance(e, RollingOnLine):
        return [_dot(along, gap) - e.s0 - e.radius * (turned - e.phi0)]
    assert isinstance(e, GuidedPoint)
    return [_dot(1j * along, gap) - e.offset]


def powers(e: Element) -> tuple[int, ...]:
    """Return for each row the power of length that it has."""
    return (2,) if isinstance(e, PointDistance) and e.laws else POWERS.get(type(e), (1,))


def _contact(e: Contact, gap: complex, pose: Mapping[str, Pose], s: float) -> list[float]:
    out = cmath.exp(1j * (pose[e.body_i][1] + s))
    d, slope = e.profile(s, 0), e.profile(s, 1)
    missing, tangent = gap - d * out, (slope + 1j * d) * out
    if e.normal_j is not None:
        face = _direction(pose[e.body_j], e.normal_j)
        return [_dot(face, missing), _dot(face, tangent)]
    rho = e.roller_radius
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
