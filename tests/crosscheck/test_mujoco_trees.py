"""MuJoCo in joint trees: each kind of joint as an edge and as the one that closes, each kind of driver."""

from __future__ import annotations

import cmath

import numpy as np
import pytest

from crosscheck.engines import OF_SPACE
from crosscheck.engines.mujoco.engine import Mujoco
from refkin.joints import Gear, elements_of
from refkin.model import Scene
from refkin.motion import Status
from refkin.motion_laws import Sinusoid
from refkin.system import compile_system
from tests.drawn import Drawing

U = 2.0**-53
TIMES = tuple(np.linspace(0.0, 1.0, 11).tolist())


class Builder(Drawing):
    """A mechanism that is assembled at random poses: each constraint gets what the poses make of it."""

    def __init__(self, *bodies: str) -> None:
        draw = np.random.default_rng(4)
        self.u = lambda: complex(*draw.uniform(-1.0, 1.0, 2))
        super().__init__({b: (2.0 * self.u(), float(draw.uniform(-2.0, 2.0))) for b in bodies})

    def hold(self, kind: str, i: str, j: str) -> Builder:
        """Add a joint between two bodies where they are."""
        p, axis = self.place(i, self.u()), self.u() * cmath.exp(1j * self.pose[i][1])
        {
            "revolute": lambda: self.pin(i, j, p),
            "fixed": lambda: self.weld(i, j, p),
            "prismatic": lambda: self.slide(i, j, p, p + 1.3 * axis, axis),
            "point_on_line": lambda: self.slide(i, j, p, p + 1.3 * axis, axis, turning=True),
            "distance": lambda: self.link(i, j, p, p + 1.5),
        }[kind]()
        return self

    def mesh(self, i: str, j: str, carrier: str = "ground") -> Builder:
        """Add a gear between two bodies as they are turned."""
        zeros = {f"phi0_{key}": self.pose[body][1] - self.pose[carrier][1] for key, body in (("i", i), ("j", j))}
        wheels = {"body_i": i, "radius_i": 0.7, "body_j": j, "radius_j": -0.4, "carrier": carrier}
        self.joints.append(Gear(**self.named(), **wheels, **zeros))
        return self

    def law(self, value: float) -> Sinusoid:
        """Return a law that starts where the bodies are and swings a little."""
        return Sinusoid(offset=value, amplitude=0.1, angular_frequency=1.5)

    def drive(self, kind: str, body: str, other: str = "ground") -> Builder:
        p, q = self.place(body, self.u()), self.place(other, self.u())
        {
            "angle": lambda: self.drive_angle(body, other),
            "x": lambda: self.drive_x(body, p),
            "y": lambda: self.drive_y(body, p),
            "distance": lambda: self.drive_distance(other, body, q, p),
        }[kind]()
        return self

    def scene(self, times: tuple[float, ...] = TIMES) -> Scene:
        return super().scene(times)


def trees() -> dict[str, Builder]:
    """Return mechanisms in which each kind of joint is met as an edge of the tree and as the one that closes it."""
    rr = lambda *bodies: Builder(*bodies).hold("revolute", "ground", "a").hold("revolute", "ground", "b")  # noqa: E731
    return {
        "revolute closes": rr("a", "b", "c").hold("revolute", "a", "c").hold("revolute", "c", "b").drive("angle", "a"),
        "prismatic closes, guide moves": rr("a", "b", "c")
        .hold("revolute", "a", "c")
        .hold("prismatic", "b", "c")
        .drive("angle", "a"),
        "prismatic closes, guide is the coupler": rr("a", "b", "c")
        .hold("revolute", "a", "c")
        .hold("prismatic", "c", "b")
        .drive("angle", "b"),
        "prismatic joints alone": Builder("a", "b")
        .hold("prismatic", "ground", "a")
        .hold("prismatic", "a", "b")
        .hold("prismatic", "b", "ground")
        .drive("x", "a"),
        "fixed closes": rr("a", "b", "c", "e")
        .hold("revolute", "a", "c")
        .hold("revolute", "e", "b")
        .hold("fixed", "c", "e")
        .drive("angle", "a"),
        "fixed is an edge": rr("a", "b", "c").hold("fixed", "c", "a").hold("distance", "c", "b").drive("angle", "a"),
        "fixed twice to the ground": Builder("a").hold("fixed", "ground", "a").hold("fixed", "a", "ground"),
        "point_on_line closes, line moves": rr("a", "b").hold("point_on_line", "a", "b").drive("angle", "a"),
        "point_on_line on the ground": Builder("a", "b")
        .hold("revolute", "ground", "a")
        .hold("revolute", "a", "b")
        .hold("point_on_line", "ground", "b")
        .drive("angle", "a"),
        "trammel: a body on two lines": Builder("a")
        .hold("point_on_line", "ground", "a")
        .hold("point_on_line", "ground", "a")
        .drive("angle", "a"),
        "distance closes": rr("a", "b").hold("distance", "b", "a").drive("y", "a"),
        "gear closes": rr("a", "b").mesh("a", "b").drive("angle", "a"),
        "gear on an arm": Builder("a", "b")
        .hold("revolute", "ground", "a")
        .hold("revolute", "a", "b")
        .mesh("b", "a")
        .drive("x", "a"),
        "gear against the ground": Builder("a", "b")
        .hold("revolute", "ground", "a")
        .hold("revolute", "a", "b")
        .mesh("ground", "b")
        .drive("angle", "a"),
        "gear on a carrier": rr("a", "b", "c")
        .hold("revolute", "a", "c")
        .mesh("b", "c", "a")
        .drive("angle", "a")
        .drive("angle", "b"),
        "gear that nothing turns": Builder("a", "b")
        .hold("fixed", "ground", "a")
        .hold("prismatic", "ground", "b")
        .mesh("a", "b")
        .drive("x", "b"),
        "distance driver": rr("a", "b").hold("distance", "a", "b").drive("distance", "a"),
        "distance driver between bodies": rr("a", "b").drive("distance", "a", "b").drive("angle", "b"),
        "relative angle driver": rr("a", "b", "c")
        .hold("revolute", "a", "c")
        .hold("revolute", "b", "c")
        .drive("angle", "c", "a"),
    }


TREES = trees()


def test_every_type_in_the_table_is_solved_here() -> None:
    solved = [c for tree in TREES.values() for c in tree.scene().mechanism.constraints]

    assert set(Mujoco().capabilities()) - set(OF_SPACE) == {element.key for element in elements_of(solved)}


# A solved motion is put into refkin's equations. Arms are up to 1.5 long and joint points up to 5 apart, at the end
# of two links, with rates below 3; refkin's own rounding and what the solve leaves are each below 2 * 18 roundings of
# two arms and 10 of the sums: 300 U, and for the rows of a line, whose normal is turned too, with rates 1400 U and
# 6400 U.
@pytest.mark.parametrize("name", TREES)
def test_motion_is_found_at_every_time_and_satisfies_refkin_s_equations(name: str) -> None:
    scene = TREES[name].scene()
    system = compile_system(scene.mechanism)
    motion = Mujoco().solve(scene)
    t, (q, qd, qdd) = motion.t, motion.levels
    assert qd is not None
    assert qdd is not None
    rate, rate_of_rate = (np.einsum("mnt,nt->mt", system.phi_q(q, t), v) for v in (qd, qdd))
    left = (system.phi(q, t), rate - system.nu(q, t), rate_of_rate - system.gamma(q, qd, t))

    assert {Status.OK} == set(motion.status)
    assert np.all([np.abs(rows).max() for rows in left] <= 2.0 * U * np.array([300.0, 1400.0, 6400.0]))
