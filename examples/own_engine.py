"""An engine of your own, of positions alone: `crosscheck conform examples/own_engine.py:TwoCircles` asks it all."""

import numpy as np

from crosscheck.engines import NATIVE, EngineRefusal, Level
from refkin.motion import Producer, Route, Seeding, Status, engine_motion

ROUTE = Route(name="two circles", residual_by="closed form", seeding=Seeding.INITIAL_GUESS)
LINKS = {"crank": ("A0", "A"), "coupler": ("A", "B"), "rocker": ("B0", "B")}


class TwoCircles:
    """Of a `refkin.FourBar`, B is where circles about A and B0 meet, on the side of the estimate; complex numbers."""

    name, api, delivers = "two_circles", (1, 0), ("position",)

    def version(self):
        return "1"

    def routes(self):
        return [ROUTE]

    def capabilities(self):
        return {"points coincide": {Level.SOLVE: NATIVE}, "angle by a law": {Level.SOLVE: NATIVE}}

    def terms(self, scene, route=None):
        return ()

    def solve(self, scene, route=None):
        at = {(joint.name, body): complex(*point) for joint in scene.mechanism.joints for body, point in joint.points()}
        guess = {body.name: body.estimate for body in scene.mechanism.bodies}.get("coupler")
        driver = scene.mechanism.drivers[0]
        known = {(pin, body) for body, pins in LINKS.items() for pin in pins} | {("A0", "ground"), ("B0", "ground")}
        if set(at) != known or (driver.body, driver.relative_to) != ("crank", "ground") or guess is None:
            raise EngineRefusal("two_circles knows refkin.FourBar driven at the crank, by its estimates")
        base, ground = at["A0", "ground"], at["B0", "ground"] - at["A0", "ground"]
        crank, coupler, rocker = (at[last, body] - at[first, body] for body, (first, last) in LINKS.items())
        short, *middle, long = sorted(abs(link) for link in (ground, crank, coupler, rocker))
        if abs(short + long - sum(middle)) < 1e-6 * long:
            raise EngineRefusal("two_circles refuses a linkage that can be in line: no side is kept there")
        a = crank * np.exp(1j * np.array([float(driver.laws[0](t)) for t in scene.times]))
        line = ground - a
        side = np.sign((coupler * np.exp(1j * guess[2]) / line[0]).imag)
        cosine = (abs(coupler) ** 2 + abs(line) ** 2 - abs(rocker) ** 2) / (2 * abs(coupler) * abs(line))
        met = abs(cosine) <= 1
        b = a + abs(coupler) * np.exp(1j * (np.angle(line) + side * np.arccos(np.where(met, cosine, np.nan))))
        q = []
        for body, start, end in (("crank", 0 * b, a), ("coupler", a, b), ("rocker", ground, b)):
            first, last = (at[pin, body] for pin in LINKS[body])
            phi = np.angle((end - start) / (last - first))
            origin = base + (start - first * np.exp(1j * phi))
            q += [origin.real, origin.imag, phi]
        status = tuple(Status.OK if ok else Status.UNASSEMBLABLE for ok in met)
        producer = Producer(name=self.name, version=self.version(), route=ROUTE)
        return engine_motion(scene.times, tuple(LINKS), np.where(met, q, np.nan), None, None, status, producer)
