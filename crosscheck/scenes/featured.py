"""Small scenes of pins and one driven crank, for the features of engines (`Use.FEATURE`).

A four-bar whose body frames stand beside their pins, by less than a thousandth of a millimetre; and dyads hung on any
bodies, a branching tree with a loop each. The crank's law bends: its second derivative is nowhere zero.
"""

from __future__ import annotations

import math

from hypothesis import assume
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn

from crosscheck.scenes.hard_case import dyads, pin
from crosscheck.strategies.spans import Binned
from refkin.joints import GROUND, AngleDriver, Revolute
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import FourBar, Pose

MOST_TIMES = 3
"""Times of a scene: what a feature gets wrong it gets wrong at any."""
TURN = 0.3
"""How far the crank turns [rad]."""
BENDS = st.floats(0.25, 1.0)
"""Second derivative of the crank's angle [rad/s^2], either way."""


class Featured(Binned):
    """A drawn scene for the features of engines."""


@st.composite
def featured_scenes(draw: DrawFn, *, samples: int = 72) -> Featured:
    """Return four-bars with frames beside their pins, and branching trees.

    Examples from this strategy shrink towards a four-bar with a crank of an eighth of a metre.
    """
    kind = draw(st.sampled_from(("frames beside pins", "branching tree", "branching tree")), label="kind")
    bend = draw(BENDS, label="bend") * draw(st.sampled_from((1.0, -1.0)), label="side")
    times = tuple(k / 2.0 for k in range(min(samples, MOST_TIMES)))
    begin = draw(st.floats(0.5, 1.5), label="angle at first")
    law = Polynomial(coefficients=(begin, TURN, bend * TURN / 2.0))
    if kind == "frames beside pins":
        joints, pose = _beside(draw, begin)
    else:
        count, seed = draw(st.integers(5, 6), label="dyads"), draw(st.integers(0, 2**20), label="which")
        pinned, poses = dyads(count, seed, [float(law(t)) for t in (0.0, 0.5, 1.0)])
        joints, pose = tuple(pinned), poses[begin]
    driver = AngleDriver(name="driver", body="crank", law=law)
    bodies = tuple(Body(name=name, estimate=place) for name, place in pose.items())
    return Featured(Scene(mechanism=Mechanism(bodies, joints, (driver,)), times=times, name=kind), kind)


def _beside(draw: DrawFn, begin: float) -> tuple[tuple[Revolute, ...], Pose]:
    size, beside = (math.ldexp(1.0, draw(st.integers(*span))) for span in ((-3, 3), (-30, -20)))
    ground, coupler, rocker = (size * draw(st.floats(2.0, 3.0), label=key) for key in ("ground", "coupler", "rocker"))
    assume(min(abs(ground - coupler), abs(ground - rocker), abs(coupler - rocker)) > size / 64.0)
    linkage = FourBar(ground=ground, crank=size, coupler=coupler, rocker=rocker)
    pose = {
        body: (x - beside * math.cos(phi), y - beside * math.sin(phi), phi)
        for body, (x, y, phi) in linkage.assemble(begin).items()
    }
    joints = (
        pin("A0", GROUND, (0.0, 0.0), "crank", (beside, 0.0)),
        pin("A", "crank", (size + beside, 0.0), "coupler", (beside, 0.0)),
        pin("B", "coupler", (coupler + beside, 0.0), "rocker", (rocker + beside, 0.0)),
        pin("B0", GROUND, (ground, 0.0), "rocker", (beside, 0.0)),
    )
    return joints, pose
