"""Loops with a joint that slides along an axis, or that rounding opens: what is proved not to close is not closed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flint import ctx

import refkin
from refkin.joints import (
    Cylindrical,
    DisplacementDriver,
    Screw,
    SpatialAngleDriver,
    SpatialDistance,
    SpatialPrismatic,
    SpatialRevolute,
    Spherical,
    Unit,
)
from refkin.model import Body, Mechanism
from refkin.motion import Status
from refkin.proof.assembly.assembly import assemblies
from refkin.proof.assembly.spatial import _SpatialReader, certain_miss, point_rows
from refkin.system import compile_system
from tests.linkages import system_of
from tests.passive import SPINNING, loop, sliding

WIDE = np.linspace(0.0, 2.5, 11)


@pytest.mark.parametrize("cls", [Cylindrical, Screw])
def test_a_rod_is_proved_not_to_reach_a_cylinder_exactly_where_the_distances_across_its_axis_say_so(cls):
    proved, true = [], []
    for seed in range(6):
        for wide in WIDE:
            scene, (far, rho, rod, _) = sliding(cls, seed, wide)
            proved.append(certain_miss(system_of(scene), 0.0) is not None)
            true.append(abs(far - rho) > rod)

    assert proved == true
    assert set(true) == {False, True}


@pytest.mark.parametrize("wide", [0.0, 3.0])
def test_a_screw_too_far_off_is_unassemblable_although_nothing_stands(wide):
    """The crank is free, the screw driven: the loop across its axis is wider than crank, rod and arm are long."""
    scene, (far, rho, rod, crank) = sliding(Screw, 2, wide, driven="screw")
    answer, beyond = refkin.solve(scene), far - rho > rod + crank

    assert beyond == (wide > 0.0)
    assert answer.status[0] is (Status.UNASSEMBLABLE if beyond else Status.OK)
    assert ("no shift closes it" in answer.message) == beyond


def test_no_loop_that_closes_is_proved_open():
    closing = [loop(coupler, seed, off=0.0)[0] for coupler in SPINNING for seed in range(3)]
    closing += [sliding(c, s, 0.0, d)[0] for c in (Cylindrical, Screw) for s in range(6) for d in ("crank", "axis")]
    closing += [sliding(SpatialPrismatic, seed, 0.0)[0] for seed in range(6)]
    for scene in closing:
        assert assemblies(system_of(scene), 0.0, trying=False).gap is None, scene.name


@pytest.mark.parametrize("shift", [0.7, -0.3])
def test_a_body_on_a_driven_slide_of_the_ground_stands_where_the_pose_has_it(shift):
    """That it stands is what links of space are measured from."""
    slide = {"point_i": (0.5, -0.25, 1.0), "axis_i": (1.0, 2.0, 2.0), "zero_i": (2.0, 1.0, -2.0)}
    own = {"point_j": (0.25, 0.5, 0.0), "axis_j": (0.0, 3.0, 4.0), "zero_j": (1.0, 0.0, 0.0)}
    joint = SpatialPrismatic(name="slide", body_i="ground", body_j="b", **slide, **own)
    body = Body(name="b", estimate=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    driver = DisplacementDriver(name="push", joint="slide", law=refkin.Polynomial(coefficients=(shift,)))
    mechanism, u = Mechanism((body,), (joint,), (driver,)), (1.0, -0.5, 2.0)
    scene = refkin.Scene(mechanism=mechanism, times=(0.0,), points=(refkin.Point(name="P", body="b", position=u),))
    place = refkin.solve(scene).points["P"].r[:, 0]
    with ctx.workprec(120):
        stands = _SpatialReader(compile_system(mechanism, unit=Unit(4.0)), 0.0).places["b"](u)

    assert [4.0 * float(x) for x in stands.parts] == pytest.approx(place, abs=1e-14)


@pytest.mark.parametrize("shift", [0.7, -0.7])
def test_a_slide_that_is_driven_along_its_axis_keeps_its_points_as_far_apart_as_the_driver_says(shift):
    ends = {
        f"{key}_{k}": at for k in "ij" for key, at in (("point", (0, 0, 0)), ("axis", (0, 0, 1)), ("zero", (1, 0, 0)))
    }
    joint = SpatialPrismatic(name="slide", body_i="ground", body_j="b", **ends)
    body = Body(name="b", estimate=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    driver = DisplacementDriver(name="leg", joint="slide", law=refkin.Polynomial(coefficients=(shift,)))
    rows = point_rows(compile_system(Mechanism((body,), (joint,), (driver,))), 0.0)

    assert [(row.name, float(row.distance)) for row in rows if row.distance is not None] == [("leg", 0.7)]


def door(on, high, short, estimate=None):
    """Return a door at a height that is held twice, its own numbers rounded near 1, those of the ground at the height.

    What is written the second time is too short by `short`.
    """
    first, second = ({"name": name, "body_i": "ground", "body_j": "door"} for name in "HT")
    foot = {"point_i": (0.1, 0.2, high + 0.1), "point_j": (0.0, 0.0, 0.1)}
    top = {"point_i": (0.1, 0.2, high + 1.8), "point_j": (0.0, 0.0, 1.8 - short)}
    axis, zero = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))[:: 1 if on == "a slide and a point" else -1]
    frames = {"axis_i": axis, "axis_j": axis, "zero_i": zero, "zero_j": zero}
    motor = SpatialAngleDriver(name="motor", joint="H", law=refkin.Polynomial(coefficients=(0.1, 1.0)))
    hinge, drivers = SpatialRevolute(**first, **foot, **frames), (motor,)
    if on == "a slide and a point":
        joints, drivers = (SpatialPrismatic(**first, **foot, **frames), Spherical(**second, **top)), ()
    elif on == "a hinge and a link":
        ends = {**top, "point_j": (0.0, 0.0, 0.1)}
        joints = (hinge, SpatialDistance(**second, **ends, length=1.7 - short))
    else:
        joints = (hinge, SpatialRevolute(**second, **top, **frames))
    body = Body(name="door", estimate=estimate)
    return refkin.Scene(mechanism=Mechanism((body,), joints, drivers), times=(0.0, 0.5))


@pytest.mark.parametrize(
    ("on", "high"),
    [("two hinges", 100.0), ("two hinges", 1e4), ("a hinge and a link", 100.0), ("a slide and a point", 1e3)],
)
def test_redundant_loops_that_rounding_opens_are_assembled_and_wider_ones_are_not(on, high):
    """Whatever the estimate is: eight half-ulps of every number may be missing, of the ground's at its height."""
    for estimate in (None, (0.1, 0.2, high, 1.0, 0.0, 0.0, 0.0)):
        motion = refkin.solve(door(on, high, 0.0, estimate))
        assert motion.status == (Status.OK,) * 2, motion.message
        wide = refkin.solve(door(on, high, 1e-8, estimate))
        assert wide.status == (Status.UNASSEMBLABLE,) * 2, wide.message


@pytest.mark.parametrize(("ulps", "missed"), [(4, False), (400, True)])
def test_a_redundant_link_misses_by_what_rounding_of_a_late_time_does_not_explain(ulps, missed):
    """A link as long as a fast door makes it a few ulps of the time later: a radian has few digits by then."""
    t, law = 1000.1, refkin.Sinusoid(amplitude=0.5, angular_frequency=1e3)
    scene = door("a hinge and a link", 0.0, 0.0)
    hinge, link = scene.mechanism.joints
    angle = law(t + ulps * np.spacing(t))
    length = float(np.hypot(2.0 - np.cos(angle), np.sin(angle)))
    link = replace(link, point_i=(2.1, 0.2, 0.0), point_j=(1.0, 0.0, 0.0), length=length)
    motor = replace(scene.mechanism.drivers[0], law=law)
    mechanism = replace(scene.mechanism, joints=(hinge, link), drivers=(motor,))

    assert (certain_miss(system_of(replace(scene, mechanism=mechanism)), t) is not None) == missed
