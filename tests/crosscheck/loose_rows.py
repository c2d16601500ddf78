"""An engine's own rows beside refkin's, of bodies that each kind of joint and driver holds; nothing is assembled."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from crosscheck.engines import Level
from crosscheck.engines.loading import load
from refkin import joints
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Sinusoid
from refkin.system import compile_system

U = 2.0**-53
ROWS = (Level.RESIDUAL, Level.JACOBIAN, Level.CONSTRAINT_VELOCITY, Level.DRIFT)
LENGTH = 1.25
KINDS = {
    "exudyn": (
        *("revolute", "fixed", "prismatic", "point_on_line", "distance", "gear", "angle", "x", "y", "cylinder"),
        *("disc", "face on disc"),
    ),
    "pinocchio": ("revolute", "fixed", "prismatic", "point_on_line"),
}
KINDS["mujoco"] = (*KINDS["exudyn"][:6], "planet")
"""What each has rows of."""


def constraint(kind: str, k: int, i: str, j: str, u: Callable[[], Any], size: float = 1.0) -> joints.Constraint:
    """Return the k-th constraint of a kind between two bodies, its numbers drawn by `u`."""
    law = Sinusoid(offset=2.0 * size, amplitude=0.5 * size, angular_frequency=2.0, phase=0.3)
    turn = Sinusoid(offset=0.2, amplitude=0.5, angular_frequency=2.0, phase=0.3)
    name, axis, moving = f"{kind} {k}", ((0.6, -0.8), (-3.0, 2.0), (0.0, 1e-20))[k], i if j == "ground" else j
    if kind == "angle":
        return joints.AngleDriver(name=name, body=j, relative_to=i, law=turn)
    if kind in ("gear", "planet"):
        (radius_i, radius_j), (phi0_i, phi0_j) = u(), u()
        carrier = next(body for body in ("a", "b", "ground") if body not in (i, j)) if kind == "planet" else "ground"
        zeros = {"phi0_i": phi0_i / size, "phi0_j": phi0_j / size, "carrier": carrier}
        return joints.Gear(name=name, body_i=i, radius_i=radius_i, body_j=j, radius_j=radius_j, **zeros)
    if kind in "xy":
        return {"x": joints.XDriver, "y": joints.YDriver}[kind](name=name, body=moving, point=u(), law=law)
    ends: dict[str, Any] = {"name": name, "body_i": i, "point_i": u(), "body_j": j, "point_j": u()}
    disc = joints.Disc(radius=0.8 * size)
    made: dict[str, Callable[[], joints.Constraint]] = {
        "revolute": lambda: joints.Revolute(**ends),
        "fixed": lambda: joints.Fixed(angle=0.7, **ends),
        "prismatic": lambda: joints.Prismatic(axis_i=axis, angle=-2.3, **ends),
        "point_on_line": lambda: joints.PointOnLine(axis_i=axis, **ends),
        "distance": lambda: joints.Distance(length=LENGTH * size, **ends),
        "cylinder": lambda: joints.DistanceDriver(law=law, **ends),
        "disc": lambda: joints.Cam(profile=disc, follower="roller", roller_radius=0.3 * size, **ends),
        "face on disc": lambda: joints.Cam(profile=disc, follower="flat", normal_j=axis, **ends),
    }
    return made[kind]()


def loose_scene(*kinds: str, size: float = 1.0) -> Scene:
    """Return two bodies, held together by each kind against the ground, each other, and the ground again."""
    draw = np.random.default_rng(7)

    def u() -> Any:
        return tuple((size * draw.uniform(-1.0, 1.0, 2)).tolist())

    between = (("ground", "a"), ("a", "b"), ("b", "ground"))
    wanted = dict.fromkeys((*kinds, "revolute"))  # the revolute joints make it a mechanism: six rows at least
    values = [constraint(kind, k, i, j, u, size) for kind in wanted for k, (i, j) in enumerate(between)]
    drivers = tuple(c for c in values if isinstance(c, joints.DRIVER_TYPES))
    bodies = tuple(Body(name=name, estimate=(0.0, 0.0, 0.0)) for name in "ab")
    return Scene(mechanism=Mechanism(bodies, tuple(c for c in values if c not in drivers), drivers), times=(0.0,))


def configurations(count: int = 40) -> Iterator[tuple[Any, Any, float]]:
    """Yield q, qd, t at random: places within 3, angles within 7 (more than a turn), rates within 3."""
    draw = np.random.default_rng(11)
    for _ in range(count):
        q = draw.uniform(-1.0, 1.0, 6) * [3.0, 3.0, 7.0, 3.0, 3.0, 7.0]
        yield q, draw.uniform(-3.0, 3.0, 6), float(draw.uniform(0.0, 3.0))


def rows_of(model: Any, level: Level, q: Any, qd: Any, t: float) -> Any:
    """Return an engine's rows at a level."""
    return getattr(model, level.value)(*((q, t) if level in ROWS[:2] else (q, qd, t)))


# What rounding allows, in units of U = 2^-53, at these configurations. An arm (a joint point in its body's frame) is
# at most sqrt 2 long, two joint points are less than 11 apart, their relative velocity is below 17, the drift part of
# their relative acceleration below 26. refkin turns an arm by a cosine and a sine; MuJoCo by the quaternion of half
# the angle (2 roundings), its product with that of the site (4), the matrix of it (6) and the product with the arm
# (4): with what refkin spends, below 18 roundings of each arm, and 10 of the sums. A line has a normal that is turned
# so too, over levers of 11; with its rates it multiplies 17, 2 * 3 * 17 and 3^2 * 11. Squares: d . err(d) and so on
# for d . d / 2, d . d', d' . d' + d . d''. Lengths: err(d), err(d') + |d'| err(d) / |d|, 2 |d'| err(d') / |d| +
# |d'|^2 err(d) / |d|^2 at |d| = LENGTH; for shorter ones see `allowed_error`. The others turn an arm as refkin does.
ROUNDINGS = {
    "points": (100.0, 100.0, 350.0, 750.0),
    "lines": (300.0, 300.0, 1400.0, 6400.0),
    "squares": (1400.0, 1300.0, 5600.0, 23000.0),
    "lengths": (100.0, 212.0, 1700.0, 28000.0),
}


def allowed_error(c: joints.Constraint, level: Level, row: float) -> float:
    """Return what rounding allows a row of a constraint to differ.

    A distance joint is mapped by |d| = sqrt(L^2 + 2 L x), x = (d . d - L^2) / (2 L). Where |d| is below L the root
    cancels and magnifies its rounding by L / |d|; its derivatives L / |d| and -L^2 / |d|^3 do so once more each.
    """
    k = ROWS.index(level)
    family = {
        joints.PointOnLine: "lines",
        joints.Prismatic: "lines",
        joints.DistanceDriver: "squares",
        joints.Distance: "lengths",
    }
    bound = U * ROUNDINGS[family.get(type(c), "lines" if isinstance(c, joints.Cam) else "points")][k]
    return bound * max(1.0, c.length / (c.length + row)) ** (1, 2, 2, 3)[k] if isinstance(c, joints.Distance) else bound


def disagreement(engine: str, scene: Scene, level: Level) -> float:
    """Return the largest error of a level, over its allowed error, through the row maps that an engine declares.

    Who owns no driver gives phi_q qd alone as a velocity: the law's rate stands in x' of the drift term only.
    """
    model, system = load(engine).constraints(scene), compile_system(scene.mechanism)
    placed = {p.constraint.name: p for p in system.placed}
    worst = []
    for q, qd, t in configurations():
        x, x_q, gamma = system.phi(q, t), system.phi_q(q, t), system.gamma(q, qd, t)
        rate = x_q @ qd - (system.nu(q, t) if model.owns_driver else 0.0)
        theirs = rows_of(model, level, q, qd, t)
        for m in model.rows:
            k = placed[m.constraint].row + m.row
            f0, slope, bend = (float(m.factor * m.form(x[k], order)) for order in range(3))
            ours = {
                Level.RESIDUAL: f0,
                Level.JACOBIAN: slope * x_q[k],
                Level.CONSTRAINT_VELOCITY: slope * rate[k],
                Level.DRIFT: slope * gamma[k] - bend * rate[k] ** 2,
            }[level]
            allowed = allowed_error(placed[m.constraint].constraint, level, float(m.form(x[k], 0)))
            worst.append(float(np.max(np.abs(theirs[m.engine_row] - ours))) / allowed)
    return max(worst)
