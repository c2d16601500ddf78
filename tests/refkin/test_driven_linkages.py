"""Checks of linkages as scenes: what input they accept, how a slider is driven, where a scene starts."""

from __future__ import annotations

import math

import numpy as np

from refkin.errors import InvalidScene
from refkin.motion import Status
from refkin.motion_laws import Polynomial, Sinusoid
from refkin.scenes.linkages import Branch, FourBar, SliderCrank
from refkin.solving.solve import solve
from tests.claims import assert_near
from tests.refkin.test_linkage_closures import LINKAGES, ROUNDING


def test_laws_beyond_the_range_are_refused():
    """A linkage that cannot follow a law says so; one that can is driven by it, whole turns away as well."""
    four = FourBar(ground=0.9, crank=0.3, coupler=0.6, rocker=0.45)
    for offset, amplitude, fits in (
        (0.0, 1.9, True),
        (0.0, 2.1, False),
        (math.tau, 1.9, True),
        (-4 * math.pi, 1.9, True),
        (1.0, 1.2, False),
        (-1.0, 1.2, False),
    ):
        law = Sinusoid(offset=offset, amplitude=amplitude, angular_frequency=1.0)
        times = tuple(np.linspace(0.0, math.tau, 41).tolist())
        try:
            four.scene(law=law, times=times)
        except InvalidScene:
            assert not fits, f"{law} was refused"
        else:
            assert fits, f"{law} was not refused"


def test_sliders_are_driven_by_their_own_coordinate():
    """A slider follows x of its wrist pin in the ground frame, or y where the guide is steep, wherever it is placed."""
    law = Polynomial(coefficients=(0.0, 1.0))
    for angle, along in ((0.4, "x"), (1.3, "y"), (0.0, "x")):
        linkage = SliderCrank(crank=1.0, rod=3.0, offset=0.4, origin=(0.3, -0.2), angle=angle)
        slides = [3.0, 3.3]
        wrists = [linkage.place(complex(s, 0.4))["xy".index(along)] for s in slides]
        scene = linkage.scene(law=law, times=tuple(wrists), driven="slider")
        motion = solve(scene)
        assert motion.verdict is Status.OK, f"guide at {angle}: {motion.verdict}"
        assert_near(getattr(motion["slider"], along), wrists, ROUNDING, f"guide at {angle}: {along}")
        for k, slide in enumerate(slides):
            expected = linkage.assemble(slide, driven="slider")
            found = motion["crank"].phi[k]
            assert_near(math.remainder(found - expected["crank"][2], math.tau), 0.0, 1e-13, f"guide at {angle}: crank")


def test_slides_beyond_the_range_are_refused():
    """A slider may be driven to the very end of its range, wherever its guide lies, and not beyond."""
    for angle, along in ((0.4, 0), (1.3, 1)):
        linkage = SliderCrank(crank=1.0, rod=3.0, offset=0.4, origin=(0.3, -0.2), angle=angle)
        low, high = linkage.input_range("slider")[0]
        for first, last, fits in (
            (low + 1e-6, high - 1e-6, True),
            (low - 1e-3, high, False),
            (low, high + 1e-3, False),
        ):
            ends = [linkage.place(complex(s, 0.4))[along] for s in (first, last)]
            law = Polynomial(coefficients=(ends[0], ends[1] - ends[0]))
            try:
                linkage.scene(law=law, times=(0.0, 1.0), driven="slider")
            except InvalidScene:
                assert not fits, f"guide at {angle}: {first} to {last} was refused"
            else:
                assert fits, f"guide at {angle}: {first} to {last} was not refused"


def test_scenes_start_near_their_pose():
    """A scene's estimate is its first pose, rounded; its times are those of the turns it is to make."""
    for linkage in LINKAGES[:1] + LINKAGES[2:3]:
        for branch in Branch:
            scene = linkage.scene(speed=-3.0, turns=2, samples=5, start=0.7, branch=branch)
            assert_near(scene.times, np.linspace(0.0, 4 * math.pi / 3, 5), ROUNDING, f"times of {linkage}")
            pose = linkage.assemble(0.7, branch)
            for body in scene.mechanism.bodies:
                off = np.abs(np.subtract(body.estimate or (math.nan,) * 3, pose[body.name]))
                assert (off < 0.06).all(), f"{linkage} {branch}: {body.name} is off by {off}"
                assert (off > 0.0).any(), f"{linkage} {branch}: {body.name} is off by {off}"
    slider = SliderCrank(crank=1.0, rod=3.0, offset=0.4, origin=(0.3, -0.2), angle=1.3)
    wrist = slider.place(complex(3.1, 0.4))[1]
    scene = slider.scene(law=Polynomial(coefficients=(wrist,)), times=(0.0,), driven="slider")
    for body in scene.mechanism.bodies:
        off = np.abs(np.subtract(body.estimate or (math.nan,) * 3, slider.assemble(3.1, driven="slider")[body.name]))
        assert (off < 0.06).all(), f"{slider} by its slider: {body.name} is off by {off}"
