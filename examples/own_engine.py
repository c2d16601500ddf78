"""A positions-only engine of your own: the four-bar by two circles, in fifty lines.

Try it with `crosscheck replay examples/crank-rocker.toml --engines examples/own_engine.py:TwoCircles`.
"""

import cmath

import numpy as np

from crosscheck.engines import NATIVE, EngineRefusal, Level, refused
from refkin.motion import Producer, Route, Seeding, Status, engine_motion

ROUTE = Route(
    name="two circles",
    residual_by="closed form",
    jacobian_by="none",
    newton_by="none",
    linear_solve_by="none",
    drift_by="none",
    seeding=Seeding.INITIAL_GUESS,
)


class TwoCircles:
    """Places the coupler pin where the circles about crank pin and rocker pivot meet, on the side of the estimate."""

    name = "two_circles"
    api = (1, 0)
    delivers = ("position",)

    def version(self):
        return "1"

    def routes(self):
        return [ROUTE]

    def capabilities(self):
        solve = {Level.SOLVE: NATIVE}
        sliding = {Level.SOLVE: refused("two circles make no slider")}
        return {"points coincide": solve, "angle by a law": solve, "point on line": sliding}

    def terms(self, scene, route=None):
        return ()

    def solve(self, scene, route=None):
        joints = {j.name: j for j in scene.mechanism.joints}
        estimates = {body.name: body.estimate for body in scene.mechanism.bodies}
        driver = scene.mechanism.drivers[0]
        known = set(joints) == {"A0", "A", "B", "B0"} and set(estimates) == {"crank", "coupler", "rocker"}
        if not known or (driver.body, driver.relative_to) != ("crank", "ground") or estimates["coupler"] is None:
            raise EngineRefusal(
                f"two_circles refuses {scene.name!r}: it knows refkin.FourBar driven at the crank, by its estimates"
            )
        ends = (("A0", "crank", "A"), ("A", "coupler", "B"), ("B0", "rocker", "B"))
        links = [(_at(joints[start], body), _at(joints[end], body)) for start, body, end in ends]
        pivots = _at(joints["A0"], "ground"), _at(joints["B0"], "ground")
        lengths = sorted([abs(pivots[1] - pivots[0]), *(abs(end - start) for start, end in links)])
        if abs(lengths[0] + lengths[3] - lengths[1] - lengths[2]) < 1e-6 * lengths[3]:
            raise EngineRefusal(f"two_circles refuses {scene.name!r}: where all links may lie in line no side is kept")
        angles = [float(driver.laws[0](t)) for t in scene.times]
        q = np.array([_pose(links, pivots, angle, angles[0], estimates["coupler"][2]) for angle in angles]).T
        status = tuple(Status.OK if np.isfinite(column).all() else Status.UNASSEMBLABLE for column in q.T)
        producer = Producer(name=self.name, version=self.version(), route=ROUTE)
        return engine_motion(scene.times, ("crank", "coupler", "rocker"), q, None, None, status, producer)


def _at(joint, body):
    """Where a joint is in the frame of a body, as a complex number."""
    return complex(*(joint.point_i if joint.body_i == body else joint.point_j))


def _pose(links, pivots, angle, first, turn):
    """x, y, phi of the three bodies at a crank angle; at the first one the coupler is turned by about `turn`."""
    crank, coupler, rocker = (end - start for start, end in links)
    ground = pivots[1] - pivots[0]  # seen from the crank's pivot: far from the origin digits would be lost
    pin, before = (crank * cmath.exp(1j * a) for a in (angle, first))
    line = ground - pin
    side = (coupler * cmath.exp(1j * turn) / (ground - before)).imag
    cosine = (abs(coupler) ** 2 + abs(line) ** 2 - abs(rocker) ** 2) / (2 * abs(coupler) * abs(line))
    if abs(cosine) > 1:
        return [np.nan] * 9
    met = pin + abs(coupler) * cmath.exp(1j * (cmath.phase(line) + np.copysign(np.arccos(cosine), side)))
    pose = []
    for (start, end), (a, b) in zip(links, ((0, pin), (pin, met), (ground, met)), strict=True):
        phi = cmath.phase((b - a) / (end - start))
        origin = pivots[0] + (a - start * cmath.exp(1j * phi))
        pose += [origin.real, origin.imag, phi]
    return pose
