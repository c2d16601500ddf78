"""What is said of assemblies and of singular poses: each sentence where it holds, and not where it does not."""

from __future__ import annotations

import math

import pytest

import refkin
from refkin.joints import AngleDriver, Perpendicular, SpatialFixed, SpatialPrismatic
from refkin.model import Body, Mechanism
from refkin.proof.singularity.diagnosis import PoseKind
from refkin.solving.mobility import mobility
from tests.linkages import with_law
from tests.refkin.test_sweep import three_cranks

from .assembly_cases import bodies, constant, four_bar, pin, solved, turned
from .test_diagnose import CHANGE_POINT, LIMITED, ONE, at, beside, dead_centre, held_by_height, links, reaching


def of_angle(*angles):
    """A crank whose angle is driven more than once."""
    drivers = (AngleDriver(name=f"driver {k}", body="a", law=constant(angle)) for k, angle in enumerate(angles))
    return Mechanism(bodies("a"), (pin("O", "ground", (0.0, 0.0), "a", (0.0, 0.0)),), tuple(drivers))


def linked(*lengths, angle=0.0):
    return four_bar(*lengths, turned("crank", constant(angle)))


ASSEMBLED = {
    "a dyad is at the limit of its reach: its assemblies coincide, or just miss": (
        linked(4.0, 1.0, 2.0, 1.0),
        linked(4.0, 1.0, 2.0, 1.0, angle=0.5),
    ),
    "their pins are 3 m apart, their lengths reach 2.5 m; 0.5 m are missing": (
        linked(4.0, 1.0, 1.5, 1.0),
        linked(4.0, 1.0, 2.5, 1.0),
    ),
    "their pins are 3 m apart, their lengths cannot come closer than 4 m; 1 m are missing": (
        linked(4.0, 1.0, 5.0, 1.0),
        linked(4.0, 1.0, 3.5, 1.0),
    ),
    "driver 1 asks for an angle of a that is 0.3 rad off": (of_angle(0.2, 0.5), of_angle(0.2, 0.2)),
}
"""What is said of the assemblies of a mechanism, and one where it is not."""


@pytest.mark.parametrize("sentence", ASSEMBLED)
def test_what_is_said_of_assemblies_holds(sentence):
    true, false = (solved(mechanism)[1] for mechanism in ASSEMBLED[sentence])

    assert sentence in true.message
    assert sentence not in false.message


SHORT_OF_CROSSING = refkin.FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 - 1e-9)
DIAGNOSED = {
    "the pose is proved to be alone": ((at(LIMITED, 0.5),), (at(CHANGE_POINT, math.pi),)),
    "; it is nearly singular (sigma ": ((at(CHANGE_POINT, math.pi - 1e-7),), (at(CHANGE_POINT, 0.5),)),
    "beside a pose of this kind: bifurcation: ": (
        (at(CHANGE_POINT, math.pi - 1e-7),),
        (at(LIMITED, LIMITED.input_range()[0][1] - 1e-7),),
    ),
    "the joints alone hold every body: no driver can move it": ((links(2.0, 1.5),), (links(2.0, 1.0),)),
    "1 motion to first order, to second order none: the pose is alone, and shaky": (
        (links(2.0, 1.0),),
        (links(2.0, 1.5),),
    ),
    "the equation of cylinder has no gradient here: points that it holds apart coincide, or a tangent is zero": (
        ONE[PoseKind.FORMULATION](),
        (reaching(0.5),),
    ),
    "crank and connecting_rod can still move to first order, and driver turns back": (
        (dead_centre(),),
        (beside(dead_centre(), dead_centre()),),
    ),
    "coupler and rocker can still move to first order, and driver turns back": (
        (at(SHORT_OF_CROSSING, SHORT_OF_CROSSING.input_range()[0][1] - 1e-9),),
        (at(CHANGE_POINT, math.pi),),
    ),
    "driven by the angle of crank the same pose is regular": ((dead_centre(),), (at(CHANGE_POINT, math.pi),)),
    "with the drivers held crank, connecting_rod and slider can still move on and on": (
        (held_by_height(),),
        (dead_centre(),),
    ),
    "no driver holds wheel": (ONE[PoseKind.IDLE](), (three_cranks(0.0),)),
    "last 0 and last 1 depend on each other, and agree": ((three_cranks(0.0),), (at(LIMITED, 0.5),)),
    "2 motions to first order; to second order 2 of them go on, and the path may take any": (
        (at(CHANGE_POINT, math.pi),),
        (dead_centre(),),
    ),
}
"""What is said of a pose, and one of which it is not said: what `refkin.diagnose` takes."""


@pytest.mark.parametrize("sentence", DIAGNOSED)
def test_what_is_said_of_a_pose_holds(sentence):
    true, false = (refkin.diagnose(*given) for given in DIAGNOSED[sentence])

    assert sentence in true.message
    assert sentence not in false.message


def test_what_cannot_be_diagnosed_or_followed_says_why():
    scene = at(LIMITED, 0.5)
    system = refkin.compile_system(scene.mechanism)

    with pytest.raises(ValueError, match=r"q is no pose at t = 0: its largest scaled residual is \d"):
        refkin.diagnose(scene, [0.0] * 9, 0.0)
    table = refkin.Table(argument=(0.0, 1.0), value=(0.5, 1.0))
    with pytest.raises(ValueError, match="t: expected a time in the table of driver, got 2"):
        refkin.diagnose(with_law(scene, table), t=2.0)
    with pytest.raises(ValueError, match="t: expected q as well, or the scene's first time, got 2"):
        refkin.diagnose(scene, t=2.0)
    with pytest.raises(ValueError, match="a system alone has no pose: give q and t"):
        refkin.diagnose(system)
    with pytest.raises(ValueError, match=r"start: expected \(q, t\), as a system alone does not say where to start"):
        refkin.follow(system)
    assert refkin.diagnose(scene).kind is PoseKind.REGULAR


def test_a_body_of_space_that_slides_alone_is_said_to_slide_and_not_to_spin():
    z, x, at = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    ends = {"body_i": "ground", "point_i": at, "axis_i": z, "point_j": at, "axis_j": z, "zero_i": x, "zero_j": x}
    again = Perpendicular(name="again", body_i="ground", axis_i=z, body_j="still", axis_j=x)
    joints = (SpatialFixed(name="f", body_j="still", **ends), SpatialPrismatic(name="p", body_j="slide", **ends), again)
    pose = (*at, 1.0, 0.0, 0.0, 0.0)
    both = Mechanism(tuple(Body(name=name, estimate=pose) for name in ("still", "slide")), joints, ())

    assert mobility(both, [*pose, *pose]).passive == ("slide slides along (0, 0, 1) of its own",)
