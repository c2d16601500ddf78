"""A positions-only engine of your own: the four-bar by two circles, in forty lines.

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
    """Places the coupler pin where the circles about crank pin and rocker pivot meet, left of the line between them."""

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
        bodies = {body.name for body in scene.mechanism.bodies}
        if set(joints) != {"A0", "A", "B", "B0"} or bodies != {"crank", "coupler", "rocker"}:
            raise EngineRefusal(
                f"two_circles refuses {scene.name!r}: it knows the bodies and joints of refkin.FourBar alone"
            )
        q = np.array([self._pose(joints, float(scene.mechanism.drivers[0].laws[0](t))) for t in scene.times]).T
        status = tuple(Status.OK if np.isfinite(column).all() else Status.UNASSEMBLABLE for column in q.T)
        producer = Producer(name=self.name, version=self.version(), route=ROUTE)
        return engine_motion(scene.times, ("crank", "coupler", "rocker"), q, None, None, status, producer)

    def _pose(self, joints, angle):
        crank, coupler, rocker = (
            2 * complex(*point) for point in (joints["A"].point_i, joints["B"].point_i, joints["B"].point_j)
        )
        pivots = [complex(*(j.point_i if j.body_i == "ground" else j.point_j)) for j in (joints["A0"], joints["B0"])]
        pin = pivots[0] + crank * cmath.exp(1j * angle)
        line = pivots[1] - pin
        cosine = (abs(coupler) ** 2 + abs(line) ** 2 - abs(rocker) ** 2) / (2 * abs(coupler) * abs(line))
        if abs(cosine) > 1:
            return [np.nan] * 9
        met = pin + abs(coupler) * cmath.exp(1j * (cmath.phase(line) + np.arccos(cosine)))
        ends = [(pivots[0], pin), (pin, met), (pivots[1], met)]
        return [c for a, b in ends for c in (((a + b) / 2).real, ((a + b) / 2).imag, cmath.phase(b - a))]
