"""Rotations of space in float64: Euler parameters p = (e0, e1, e2, e3), matrices, angular rates; nothing of refkin's.

w and alpha are the angular velocity and acceleration in the ground frame (Haug 1989, section 9.3):

    w = 2 E p',   alpha = 2 E p'',   p' = E^T w / 2,   p'' = E^T alpha / 2 - |w|^2 p / 4,   E = [-e, e0 I + e~].
"""

from __future__ import annotations

from typing import Any

import numpy as np

from crosscheck.engines import Array

Rows = Any
SKEW = [[0, 2, 1], [2, 0, 0], [1, 0, 0]], np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]])
"""Which component of a vector stands where in its matrix, and times what."""


def skew(a: Array) -> Array:
    """Return the matrices (..., 3, 3) by which vectors (..., 3) are multiplied: skew(a) b = a x b."""
    which, factors = SKEW
    out: Array = a.take(which, -1) * factors
    return out


def cross(a: Array, b: Array) -> Array:
    """Return the vector product (..., 3) of (..., 3) and (..., 3): NumPy's own takes ten times as long for a few."""
    out: Array = (skew(a) @ b[..., None])[..., 0]
    return out


def product(a: Rows, b: Rows) -> Array:
    """Return the quaternion product of (..., 4) and (..., 4)."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    scalar = a[..., :1] * b[..., :1] - np.sum(a[..., 1:] * b[..., 1:], axis=-1, keepdims=True)
    vector = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + cross(a[..., 1:], b[..., 1:])
    return np.concatenate([scalar, vector], axis=-1)


def conjugate(p: Rows) -> Array:
    """Return the quaternion (..., 4) of the inverse rotation."""
    return np.asarray(p, float) * [1.0, -1.0, -1.0, -1.0]


def matrix(p: Rows) -> Array:
    """Return the rotation matrices (..., 3, 3) of Euler parameters (..., 4) that need not be of length 1."""
    p = np.asarray(p, float)
    e0, e1, e2, e3 = np.moveaxis(p / length(p), -1, 0)
    out = np.empty((*p.shape[:-1], 3, 3))
    out[..., 0, 0] = e0 * e0 + e1 * e1 - e2 * e2 - e3 * e3
    out[..., 1, 1] = e0 * e0 - e1 * e1 + e2 * e2 - e3 * e3
    out[..., 2, 2] = e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3
    out[..., 0, 1], out[..., 1, 0] = 2 * (e1 * e2 - e0 * e3), 2 * (e1 * e2 + e0 * e3)
    out[..., 0, 2], out[..., 2, 0] = 2 * (e1 * e3 + e0 * e2), 2 * (e1 * e3 - e0 * e2)
    out[..., 1, 2], out[..., 2, 1] = 2 * (e2 * e3 - e0 * e1), 2 * (e2 * e3 + e0 * e1)
    return out


def about_z(angle: Any) -> Array:
    """Return the rotations (..., 3, 3) about the third axis by angles (...)."""
    out = np.zeros((*np.shape(angle), 3, 3))
    out[..., 0, 0] = out[..., 1, 1] = np.cos(angle)
    out[..., 1, 0] = np.sin(angle)
    out[..., 0, 1] = -out[..., 1, 0]
    out[..., 2, 2] = 1.0
    return out


def parameters(rotation: Array) -> Array:
    """Return Euler parameters (..., 4) of rotation matrices, the largest of them positive (Shepperd 1978)."""
    a = np.asarray(rotation, float)
    turned, x, y, z = a.swapaxes(-1, -2), a[..., 0, 0], a[..., 1, 1], a[..., 2, 2]
    odd, even = a - turned, a + turned
    fourfold = np.empty((*a.shape[:-2], 4, 4))  # four times p p^T
    for k, diagonal in enumerate((x + y + z, x - y - z, y - x - z, z - x - y)):
        fourfold[..., k, k] = 1.0 + diagonal
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        fourfold[..., 0, 1 + i] = fourfold[..., 1 + i, 0] = odd[..., k, j]
        fourfold[..., 1 + j, 1 + k] = fourfold[..., 1 + k, 1 + j] = even[..., j, k]
    largest = np.argmax(np.stack([x + y + z, x, y, z], axis=-1), axis=-1)
    p: Array = np.take_along_axis(fourfold, largest[..., None, None], axis=-2)[..., 0, :]
    return p / length(p)


def length(p: Array) -> Array:
    """Return the lengths (..., 1) of (..., k)."""
    out: Array = np.sqrt(np.add.reduce(p * p, axis=-1, keepdims=True))
    return out


def continuous(p: Array) -> Array:
    """Return rows (T, 4) with signs so that each is on the side of the one before it; NaN rows are passed over."""
    p = np.array(p)
    known = np.isfinite(p).all(axis=1)
    rows = p[known]
    turned = np.sum(rows[1:] * rows[:-1], axis=1) < 0.0
    rows[1:][np.cumsum(turned) % 2 == 1] *= -1.0
    p[known] = rows
    return p


def rates(p: Rows, w: Rows) -> Array:
    """Return p' (..., 4) from the angular velocity (..., 3): half the product (0, w) p."""
    return 0.5 * product(_pure(w), p)


def bends(p: Rows, w: Rows, alpha: Rows) -> Array:
    """Return p'' (..., 4) of a body that turns.

    Parameters
    ----------
    p, w, alpha : (..., 4), (..., 3), (..., 3) array
        Euler parameters, angular velocity and acceleration in the ground frame.
    """
    return 0.5 * product(_pure(alpha), p) - 0.25 * np.sum(np.square(w), axis=-1, keepdims=True) * np.asarray(p)


def spin(p: Rows, rate: Rows) -> Array:
    """Return w = 2 E p' (..., 3); alpha, with p'' in the place of p'."""
    return 2.0 * product(rate, conjugate(p))[..., 1:]


OF_BODY = [[1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]], np.array([[-2.0, 2, 2, -2], [-2, -2, 2, 2], [-2, 2, -2, 2]])
OF_GROUND = (
    [[1, 2, 3], [0, 3, 2], [3, 0, 1], [2, 1, 0]],
    0.5 * np.array([[-1, -1, -1], [1, 1, -1], [-1, 1, 1], [1, -1, 1]]),
)
"""Which component of p stands where in a matrix, and times what."""


def body_columns(p: Rows) -> Array:
    """Return 2 L (..., 3, 4): angular velocity in the body's own axes from p', for p that turns as p/|p|."""
    p, (which, factors) = np.asarray(p, float), OF_BODY
    out: Array = p.take(which, -1) * factors / np.sum(p * p, axis=-1)[..., None, None]
    return out


def ground_columns(p: Rows) -> Array:
    """Return E^T / 2 (..., 4, 3): p' from the angular velocity in the ground frame."""
    which, factors = OF_GROUND
    out: Array = np.asarray(p, float).take(which, -1) * factors
    return out


def common_columns(q: Array) -> Array:
    """Return the matrices (..., 7 b, 6 b) that make rates of coordinates of (v, w) per body, where p is of length 1."""
    count = q.shape[-1] // 7
    out = np.zeros((*q.shape[:-1], 7 * count, 6 * count))
    for k in range(count):
        out[..., 7 * k : 7 * k + 3, 6 * k : 6 * k + 3] = np.eye(3)
        out[..., 7 * k + 3 : 7 * k + 7, 6 * k + 3 : 6 * k + 6] = ground_columns(q[..., 7 * k + 3 : 7 * k + 7])
    return out


def joint_frame(axis: Rows, zero: Rows | None) -> Array:
    """Return the matrix of columns f, g, h: h along the axis, f the part of `zero` across it, g = h x f.

    Without a zero, which rows of an angle alone need, f is the part across h of an axis of the frame: of the first one
    whose component along h is at most 1 / 0.7 of the smallest, as in the rows of a joint without one.
    """
    h = _near_one(axis)
    h = h / np.linalg.norm(h)
    if zero is None:
        sizes = np.abs(np.asarray(axis, float))
        zero = np.eye(3)[int(np.argmax(sizes <= np.min(sizes) / 0.7))]
    f = _near_one(zero)
    f = f - h * (h @ f)
    f = f / np.linalg.norm(f)
    f = f - h * (h @ f)
    f = f / np.linalg.norm(f)
    return np.stack([f, np.cross(h, f), h], axis=1)


def _near_one(v: Rows) -> Array:
    """Return a vector (3,) times a power of two, which rounds nothing: no square of it over- or underflows."""
    v = np.asarray(v, float)
    return np.ldexp(v, -np.frexp(np.max(np.abs(v)))[1])


def _pure(v: Rows) -> Array:
    v = np.asarray(v, float)
    return np.concatenate([np.zeros((*v.shape[:-1], 1)), v], axis=-1)
