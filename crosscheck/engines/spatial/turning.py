"""Rotations of space in float64: Euler parameters p = (e0, e1, e2, e3), matrices, angular rates; nothing of refkin's.

w and alpha are the angular velocity and acceleration in the ground frame (Haug 1989, section 9.3):

    w = 2 E p',   alpha = 2 E p'',   p' = E^T w / 2,   p'' = E^T alpha / 2 - |w|^2 p / 4,   E = [-e, e0 I + e~].
"""

from __future__ import annotations

from typing import Any

import numpy as np

from crosscheck.engines import Array

Rows = Any


def product(a: Rows, b: Rows) -> Array:
    """Return the quaternion product of (..., 4) and (..., 4)."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    scalar = a[..., :1] * b[..., :1] - np.sum(a[..., 1:] * b[..., 1:], axis=-1, keepdims=True)
    vector = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + np.cross(a[..., 1:], b[..., 1:])
    return np.concatenate([scalar, vector], axis=-1)


def conjugate(p: Rows) -> Array:
    """Return the quaternion (..., 4) of the inverse rotation."""
    return np.asarray(p, float) * [1.0, -1.0, -1.0, -1.0]


def matrix(p: Rows) -> Array:
    """Return the rotation matrix (3, 3) of Euler parameters that need not be of length 1."""
    e0, e1, e2, e3 = np.asarray(p, float) / np.linalg.norm(p)
    return np.array(
        [
            [e0 * e0 + e1 * e1 - e2 * e2 - e3 * e3, 2 * (e1 * e2 - e0 * e3), 2 * (e1 * e3 + e0 * e2)],
            [2 * (e1 * e2 + e0 * e3), e0 * e0 - e1 * e1 + e2 * e2 - e3 * e3, 2 * (e2 * e3 - e0 * e1)],
            [2 * (e1 * e3 - e0 * e2), 2 * (e2 * e3 + e0 * e1), e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3],
        ]
    )


def about_z(angle: float) -> Array:
    """Return the rotation about the third axis."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def parameters(rotation: Array) -> Array:
    """Return Euler parameters (4,) of a rotation matrix, the largest of them positive (Shepperd 1978)."""
    a = np.asarray(rotation, float)
    squares = np.array([np.trace(a), a[0, 0], a[1, 1], a[2, 2]])
    k = int(np.argmax(squares))
    if k == 0:
        p = np.array([1.0 + squares[0], a[2, 1] - a[1, 2], a[0, 2] - a[2, 0], a[1, 0] - a[0, 1]])
    else:
        i, j, l = k - 1, k % 3, (k + 1) % 3  # noqa: E741
        p = np.empty(4)
        p[0] = a[l, j] - a[j, l]
        p[1 + i] = 1.0 + a[i, i] - a[j, j] - a[l, l]
        p[1 + j], p[1 + l] = a[j, i] + a[i, j], a[l, i] + a[i, l]
    return p / np.linalg.norm(p)


def continuous(p: Array) -> Array:
    """Return rows (T, 4) with signs so that each is on the side of the one before it; NaN rows are passed over."""
    p, last = np.array(p), None
    for k, row in enumerate(p):
        if np.isfinite(row).all():
            if last is not None and row @ last < 0.0:
                p[k] = -row
            last = p[k]
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


def body_columns(p: Rows) -> Array:
    """Return 2 L (3, 4): angular velocity in the body's own axes from p', for p of any length that turns as p/|p|."""
    e0, e1, e2, e3 = np.asarray(p, float)
    rows = np.array([[-e1, e0, e3, -e2], [-e2, -e3, e0, e1], [-e3, e2, -e1, e0]])
    return 2.0 * rows / (e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)


def ground_columns(p: Rows) -> Array:
    """Return E^T / 2 (4, 3): p' from the angular velocity in the ground frame."""
    e0, e1, e2, e3 = np.asarray(p, float)
    return 0.5 * np.array([[-e1, -e2, -e3], [e0, e3, -e2], [-e3, e0, e1], [e2, -e1, e0]])


def common_columns(q: Array) -> Array:
    """Return the matrix (7 b, 6 b) that makes rates of coordinates of (v, w) per body, where p is of length 1."""
    count = len(q) // 7
    out = np.zeros((7 * count, 6 * count))
    for k in range(count):
        out[7 * k : 7 * k + 3, 6 * k : 6 * k + 3] = np.eye(3)
        out[7 * k + 3 : 7 * k + 7, 6 * k + 3 : 6 * k + 6] = ground_columns(q[7 * k + 3 : 7 * k + 7])
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
