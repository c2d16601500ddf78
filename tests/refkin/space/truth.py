"""Spatial scenes in 80 digits by formulas of their own: rotation matrices, dot products, central differences.

Nothing of `refkin` is used. A pose is found from a near one by Newton's method with one approximate inverse (chords),
rates by the poses 1e-16 s earlier and later: h^2 = 1e-32 of them is what they lack.
"""

from __future__ import annotations

import numpy as np
from flint import arb, ctx

BITS = 280
STEP = "1e-16"
SAME = 1e-70


def dot(a, b):
    return sum((x * y for x, y in zip(a, b, strict=True)), arb(0))


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def plus(a, b, factor=1):
    return [x + factor * y for x, y in zip(a, b, strict=True)]


def unit(v):
    length = dot(v, v).sqrt()
    return [x / length for x in v]


def product(a, b):
    return [[dot(row, column) for column in zip(*b, strict=True)] for row in a]


def on(matrix, v):
    return [dot(row, v) for row in matrix]


def middle(rows):
    return [[arb(x.mid()) for x in row] for row in rows]


def turn_of(w):
    """Return the rotation by a small vector: I + s W + c W^2, by the series of sin x / x and (1 - cos x) / x^2."""
    square, s, c, term, k = dot(w, w), arb(0), arb(0), arb(1), 1
    while abs(float(term)) > SAME:
        s, c = s + term, c + term / (2 * k)
        term, k = -term * square / (2 * k * (2 * k + 1)), k + 1
    x, y, z = w
    skew = [[arb(0), -z, y], [z, arb(0), -x], [-y, x, arb(0)]]
    twice = product(skew, skew)
    return [[int(i == j) + s * skew[i][j] + c * twice[i][j] for j in range(3)] for i in range(3)]


def vector_of(turn):
    """Return the vector of a small rotation, by the series of arcsin s / s."""
    v = [(turn[i][j] - turn[j][i]) / 2 for i, j in ((2, 1), (0, 2), (1, 0))]
    square, factor, term = dot(v, v), arb(1), arb(1)
    for k in range(1, 20):
        term = term * square * (2 * k - 1) ** 2 / (2 * k * (2 * k + 1))
        factor = factor + term
    return [x * factor for x in v]


def matrix_of(p):
    a, b, c, d = unit([arb(float(x)) for x in p])
    return [
        [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
        [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
        [2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d],
    ]


def value_of(law, t):
    if law["kind"] == "polynomial":
        return sum((arb(c) * t**k for k, c in enumerate(law["coefficients"])), arb(0))
    angle = arb(law["angular_frequency"]) * t + arb(law.get("phase", 0.0))
    return arb(law.get("offset", 0.0)) + arb(law["amplitude"]) * angle.sin()


class Truth:
    """The equations of a scene file, read as TOML."""

    def __init__(self, document):
        self.joints, self.drivers = document.get("joint", []), document.get("driver", [])
        self.names = [body["name"] for body in document["body"]]
        self.by_name = {joint["name"]: joint for joint in self.joints}
        self.wrong = set()

    def rows(self, pose, t):
        """Return all residuals at a pose; what is closed, but no assembly, is noted in `wrong`."""
        one = [[arb(int(i == j)) for j in range(3)] for i in range(3)]
        self.pose, self.t = {"ground": ([arb(0)] * 3, one), **pose}, t
        rows = [row for joint in self.joints for row in self._joint(joint)]
        return [arb(x.mid()) for x in (*rows, *map(self._driver, self.drivers))]

    def _at(self, joint, end):
        r, a = self.pose[joint[f"body_{end}"]]
        return plus(r, on(a, [arb(x) for x in joint[f"point_{end}"]]))

    def _axis(self, joint, end):
        return on(self.pose[joint[f"body_{end}"]][1], unit([arb(x) for x in joint[f"axis_{end}"]]))

    def _frame(self, joint, end):
        axis = joint[f"axis_{end}"]
        h = unit([arb(x) for x in axis])
        least = min(range(3), key=lambda k: abs(axis[k]))
        zero = [arb(x) for x in joint.get(f"zero_{end}", [float(k == least) for k in range(3)])]
        f = unit(plus(zero, h, -dot(h, zero)))
        a = self.pose[joint[f"body_{end}"]][1]
        return [on(a, v) for v in (f, cross(h, f), h)]

    def _gap(self, joint):
        return plus(self._at(joint, "j"), self._at(joint, "i"), -1)

    def _angle(self, joint):
        (f, g, _), (f_j, g_j, _) = self._frame(joint, "i"), self._frame(joint, "j")
        return arb.atan2(dot(g, f_j) - dot(f, g_j), dot(f, f_j) + dot(g, g_j))

    def _shift(self, joint):
        return dot(self._axis(joint, "i"), self._gap(joint))

    def _counted(self, joint):
        """Return the angle of a screw with the turns that its shift makes of it."""
        by_shift = (self._shift(joint) - arb(joint.get("shift", 0.0))) / arb(joint["pitch"])
        turns = round(float((by_shift - self._angle(joint)) / (2 * arb.pi())))
        return self._angle(joint) + 2 * turns * arb.pi()

    def _joint(self, joint):
        kind = joint["type"]
        if kind in ("spherical", "universal", "revolute", "fixed"):
            yield from self._gap(joint)
        if kind in ("revolute", "fixed", "cylindrical", "prismatic", "screw", "parallel"):
            f, g, h = self._frame(joint, "i")
            other = self._axis(joint, "j")
            self._demand(dot(h, other), f"{joint['name']}: its axes are reversed")
            yield from (dot(f, other), dot(g, other))
        if kind in ("cylindrical", "prismatic", "screw", "point_on_line"):
            f, g, _ = self._frame(joint, "i")
            yield from (dot(f, self._gap(joint)), dot(g, self._gap(joint)))
        if kind in ("fixed", "prismatic"):
            (f, g, _), (f_j, _, _) = self._frame(joint, "i"), self._frame(joint, "j")
            self._demand(dot(f, f_j), f"{joint['name']}: it is half a turn off")
            yield dot(g, f_j)
        if kind in ("universal", "perpendicular"):
            yield dot(self._axis(joint, "i"), self._axis(joint, "j"))
        if kind == "point_on_plane":
            yield self._shift(joint)
        if kind == "distance":
            yield dot(self._gap(joint), self._gap(joint)).sqrt() - arb(joint["length"])
        if kind == "screw":
            yield self._shift(joint) - arb(joint.get("shift", 0.0)) - arb(joint["pitch"]) * self._counted(joint)

    def _driver(self, driver):
        value = value_of(driver["law"], self.t)
        if driver["type"] == "distance":
            return dot(self._gap(driver), self._gap(driver)).sqrt() - value
        joint = self.by_name[driver["joint"]]
        if driver["type"] == "displacement":
            return self._shift(joint) - value
        if joint["type"] == "screw":
            return self._counted(joint) - value
        off = self._angle(joint) - value
        off = off - 2 * round(float(off / (2 * arb.pi()))) * arb.pi()
        self._demand(off.cos(), f"{driver['name']}: the angle is half a turn off")
        return off

    def _demand(self, number, words):
        if float(number) < 0.5:
            self.wrong.add(words)

    def near(self, q, t):
        """Return, per body, r, A, v, omega, a, alpha of the pose near coordinates (7 bodies,) at a time."""
        with ctx.workprec(BITS):
            bodies = zip(self.names, np.reshape(q, (-1, 7)), strict=True)
            start = {name: ([arb(float(x)) for x in own[:3]], matrix_of(own[3:])) for name, own in bodies}
            t, h = arb(float(t)), arb(STEP)
            inverse = self._inverse(start, t)
            here = self._solved(start, t, inverse)
            self.wrong = set()
            self.rows(here, t)
            wrong = set(self.wrong)
            after, before = (self._solved(here, t + s * h, inverse) for s in (1, -1))
            assert not wrong, wrong
            return {name: _motion(here[name], before[name], after[name], h) for name in self.names}

    def _inverse(self, pose, t):
        """Return the pseudo-inverse of the derivatives by shifts and turns of the bodies, by differences."""
        small, n = arb("1e-40"), 6 * len(self.names)
        base = self.rows(pose, t)
        columns = []
        for k in range(n):
            moved = self.rows(self._moved(pose, [small if k == m else arb(0) for m in range(n)]), t)
            columns.append([float((a - b) / small) for a, b in zip(moved, base, strict=True)])
        slopes = np.array(columns).T
        sizes = np.linalg.svd(slopes, compute_uv=False)
        self.condition = sizes[0] / sizes[n - 1]
        return [[arb(x) for x in row] for row in np.linalg.pinv(slopes).tolist()]

    def _moved(self, pose, x):
        moved = {}
        for k, name in enumerate(self.names):
            (r, a), (shift, turn) = pose[name], (x[6 * k : 6 * k + 3], x[6 * k + 3 : 6 * k + 6])
            moved[name] = (middle([plus(r, shift)])[0], middle(product(turn_of(turn), a)))
        return moved

    def _solved(self, pose, t, inverse):
        for _ in range(60):
            rows = self.rows(pose, t)
            x = [arb((-dot(row, rows)).mid()) for row in inverse]
            pose = self._moved(pose, x)
            if max(abs(float(number)) for number in x) < SAME:
                return pose
        raise AssertionError("the truth was not found")


def _motion(here, before, after, h):
    (r, a), (r_1, a_1), (r_2, a_2) = here, before, after
    back = [list(column) for column in zip(*a, strict=True)]
    one, two = vector_of(product(a_1, back)), vector_of(product(a_2, back))
    v, omega = ([x / (2 * h) for x in plus(y, z, -1)] for y, z in ((r_2, r_1), (two, one)))
    acceleration = [x / (h * h) for x in plus(plus(r_2, r_1), r, -2)]
    alpha = [x / (h * h) for x in plus(two, one)]
    return tuple(np.array(x, float) for x in (r, a, v, omega, acceleration, alpha))


def off(truth, motion, k, size):
    """Return the largest error of position, velocity and acceleration of a motion at its k-th time [sizes, rad].

    Rounding the truth to numbers is at most an ulp of them.
    """
    errors, rates = np.zeros(3), np.zeros(3)
    for name, exact in truth.items():
        body = motion[name]
        ours = (body.q[:3], body.rotation, body.qd[:3], body.omega, body.qdd[:3], body.alpha)
        for place, (x, y) in enumerate(zip((each[..., k] for each in ours), exact, strict=True)):
            scale = 1.0 if place % 2 else size
            errors[place // 2] = max(errors[place // 2], np.max(np.abs(x - y)) / scale)
            rates[place // 2] = max(rates[place // 2], np.max(np.abs(y)) / scale)
    return errors, np.maximum(1.0, rates)
