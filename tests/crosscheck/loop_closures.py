"""Loop closures of a scene in complex numbers, at position, velocity and acceleration; not a test itself.

The identities are meant for truth rounded to float: then each entry carries one rounding, whatever the conditioning,
and the bound is a count of roundings of the terms that stand in the identity (`Defect`), not a condition number.
"""

import numpy as np

from refkin.joints import GROUND

U = 2.0**-53
TINY = 2.0**-1022  # below it a rounding is no longer relative


class Defect:
    """What is left of identities, and the sum of the sizes of their terms."""

    def __init__(self, parts, sizes):
        self.parts, self.sizes = parts, sizes

    def within(self, roundings):
        return all(np.all(abs(p) <= roundings * U * s + TINY) for p, s in zip(self.parts, self.sizes, strict=True))


class Carried:
    """A body's motion, or the ground's, with point positions, velocities and accelerations."""

    def __init__(self, motion, name):
        if name == GROUND:
            self.r = self.v = self.a = self.w = self.e = self.phi = np.zeros(len(motion.t))
            return
        b = motion[name]
        self.r, self.v, self.a = b.x + 1j * b.y, b.xd + 1j * b.yd, b.xdd + 1j * b.ydd
        self.phi, self.w, self.e = b.phi, b.phid, b.phidd

    def vector(self, u):
        """A body-fixed vector and its two derivatives."""
        s = np.exp(1j * self.phi) * complex(*u)
        return s, 1j * self.w * s, (1j * self.e - self.w**2) * s

    def point(self, u):
        s = self.vector(u)
        return tuple(x + y for x, y in zip((self.r, self.v, self.a), s, strict=True))

    def size(self, u):
        """Sizes of the terms of `point`, an angle's rounding included."""
        s = abs(complex(*u)) * (1 + abs(self.phi))
        spin = abs(self.w) * (1 + abs(self.w)) + abs(self.e)
        return abs(self.r) + s, abs(self.v) + (abs(self.w)) * s, abs(self.a) + spin * s


def law_rows(driver, t):
    law = driver.laws[0]
    return tuple(np.broadcast_to(law(t, k), t.shape) for k in range(3))


def defects(scene, motion):
    """Yield (name, level 0..2, Defect) for every joint and driver."""
    for c in scene.mechanism.constraints:
        i, j = (Carried(motion, name) for name in c.bodies)
        result = {
            "revolute": _pinned,
            "fixed": _welded,
            "prismatic": _slides,
            "point_on_line": _aligned,
            "distance": _apart,
            "angle": _turned,
            "x": _driven_x,
            "y": _driven_y,
        }[c.type](c, i, j, motion.t)
        for level in range(3):
            yield c.name, level, Defect(*zip(*[(part[level], size[level]) for part, size in result], strict=True))


def _gap(c, i, j):
    d = tuple(q - p for p, q in zip(i.point(c.point_i), j.point(c.point_j), strict=True))
    return d, tuple(a + b for a, b in zip(i.size(c.point_i), j.size(c.point_j), strict=True))


def _pinned(c, i, j, t):
    d, size = _gap(c, i, j)
    return [(d, size)]


def _angles(i, j, f):
    """An angle near zero is a sum of angles that are not, and its ball has the width of those: 2^-113 of them."""
    pairs = ((i.phi, j.phi), (i.w, j.w), (i.e, j.e))
    rows = tuple(b - a - x for (a, b), x in zip(pairs, f, strict=True))
    return rows, tuple(abs(b) + abs(a) + abs(x) + 2.0**-40 for (a, b), x in zip(pairs, f, strict=True))


def _welded(c, i, j, t):
    return [*_pinned(c, i, j, t), _angles(i, j, (c.angle, 0, 0))]


def _aligned(c, i, j, t):
    """Im(conj(axis) d) = 0 and twice differentiated."""
    (d, dd, ddd), (s, sd, sdd) = _gap(c, i, j)
    a, ad, add = (np.conj(x) for x in i.vector(c.axis_i))
    turn = 1 + abs(i.phi)
    rows = ((a * d).imag, (ad * d + a * dd).imag, (add * d + 2 * ad * dd + a * ddd).imag)
    sizes = (
        abs(a) * turn * s,
        turn * (abs(ad) * s + abs(a) * sd),
        turn * (abs(add) * s + 2 * abs(ad) * sd + abs(a) * sdd),
    )
    return [(rows, sizes)]


def _slides(c, i, j, t):
    return [*_aligned(c, i, j, t), _angles(i, j, (c.angle, 0, 0))]


def _apart(c, i, j, t):
    (d, dd, ddd), (s, sd, sdd) = _gap(c, i, j)
    f = law_rows(c, t) if hasattr(c, "law") else (c.length + 0 * t, 0 * t, 0 * t)
    rows = (
        abs(d) ** 2 - f[0] ** 2,
        (d.conj() * dd).real - f[0] * f[1],
        abs(dd) ** 2 + (d.conj() * ddd).real - f[1] ** 2 - f[0] * f[2],
    )
    sizes = (s**2 + f[0] ** 2, s * sd + abs(f[0] * f[1]), sd**2 + s * sdd + f[1] ** 2 + abs(f[0] * f[2]))
    return [(rows, sizes)]


def _turned(c, i, j, t):
    return [_angles(i, j, law_rows(c, t))]


def _driven(c, j, t, part):
    p, f = j.point(c.point), law_rows(c, t)
    sizes = tuple(s + abs(x) for s, x in zip(j.size(c.point), f, strict=True))
    return [(tuple(part(x) - y for x, y in zip(p, f, strict=True)), sizes)]


def _driven_x(c, i, j, t):
    return _driven(c, j, t, np.real)


def _driven_y(c, i, j, t):
    return _driven(c, j, t, np.imag)


ROUNDINGS = 64
"""Roundings per term: at most eight operations on each, in numbers that carry one, squared at worst; and 2 to spare."""


def open_rows(scene, motion):
    return [(name, level) for name, level, defect in defects(scene, motion) if not defect.within(ROUNDINGS)]
