"""Mechanisms with gears, racks, cams, offset pins and moving slots, each with its closed form.

Every closed form is geometry written down anew: nothing of refkin's formulas enters it. It gives, for each body,
(x, y, phi) at a time, in the precision of `mpmath`. Numbers of a scene are the floats that stand there: mixed with
`mpf`, they are exact.
"""

from __future__ import annotations

import mpmath
import numpy as np
from mpmath import acos, asin, atan2, cos, mpf, sin, sqrt

from refkin import (
    AngleDriver,
    Body,
    Cam,
    Disc,
    Distance,
    Gear,
    Mechanism,
    PointOnLine,
    Polar,
    Polynomial,
    Prismatic,
    RackAndPinion,
    Revolute,
    Scene,
    Sinusoid,
    XDriver,
)

TIMES = tuple(np.linspace(0.0, 2.0, 6).tolist())
MOTOR = Polynomial(coefficients=(0.2, 1.5, -0.25))
SHIFT = (Sinusoid(amplitude=0.25, angular_frequency=2.0, offset=0.125), Polynomial(coefficients=(0.0, 0.25, -0.125)))
RATE = Sinusoid(offset=1.5, amplitude=0.75, angular_frequency=2.0, phase=0.25)
LOBES = Sinusoid(offset=1.0, amplitude=0.0625, angular_frequency=3.0, phase=0.375)


def motor(t):
    return 0.2 + 1.5 * t - 0.25 * t**2


def shift(t):
    return 0.125 + 0.25 * sin(2 * t), 0.25 * t - 0.125 * t**2


def lobes(s):
    """d(s), d'(s) and w = sqrt(d^2 + d'^2) of the profile with three lobes."""
    d, slope = 1 + 0.0625 * sin(3 * s + 0.375), 3 * 0.0625 * cos(3 * s + 0.375)
    return d, slope, sqrt(d * d + slope * slope)


def pin(body, at=(0.0, 0.0), point=(0.0, 0.0)):
    return Revolute(name=f"pin of {body}", body_i="ground", point_i=at, body_j=body, point_j=point)


def guide(body, at=(0.0, 0.0), axis=(0.0, 1.0)):
    ends = {"body_i": "ground", "point_i": at, "body_j": body, "point_j": (0.0, 0.0)}
    return Prismatic(name=f"guide of {body}", **ends, axis_i=axis)


def turning(body, law=MOTOR):
    return AngleDriver(name=f"motor of {body}", body=body, law=law)


def cam(profile, follower, held, centre=(0.0, 0.0), point=(0.0, 0.0), **more):
    ends = {"body_i": "cam", "point_i": centre, "body_j": "follower", "point_j": point}
    return (pin("cam"), held, Cam(name="contact", **ends, profile=profile, follower=follower, **more)), (
        turning("cam"),
    )


def touched(angle, start):
    """The contact parameter as a function of time, if the cam's angle is `angle(s)`; `start` is s where it is 0."""
    return lambda t: mpmath.findroot(lambda s: angle(s) - motor(t), start - motor(t))


def circles(centre, radius, other, length, side):
    """The point at a distance from each of two centres, left (1) or right (-1) of the line between them."""
    (x, y), (u, v) = centre, other
    apart = sqrt((u - x) ** 2 + (v - y) ** 2)
    along = (radius**2 - length**2 + apart**2) / (2 * apart)
    across = side * sqrt(radius**2 - along**2)
    e, f = (u - x) / apart, (v - y) / apart
    return x + along * e - across * f, y + along * f + across * e


# Discs: the centre runs on a circle of radius 0.375 around the pivot of the cam.


def centre_of_disc(t):
    return 0.375 * cos(motor(t)), 0.375 * sin(motor(t))


def disc_under_plate(t):
    return {"cam": (0, 0, motor(t)), "follower": (0, centre_of_disc(t)[1] + 1.25, 0)}


def disc_under_wedge(t):
    """The face has the normal (0.6, 0.8) and goes through (0.5, y + 0.25)."""
    x, y = centre_of_disc(t)
    return {"cam": (0, 0, motor(t)), "follower": (0, y - 0.25 + (1.25 - mpf(3) / 5 * (0.5 - x)) * 5 / 4, 0)}


def disc_under_lever(t):
    """A plate 0.25 beside its pivot (3, 0): its normal, a quarter turn from its angle, sees the pivot 1 away."""
    x, y = centre_of_disc(t)
    to_pivot = atan2(-y, 3 - x)
    return {"cam": (0, 0, motor(t)), "follower": (3, 0, to_pivot - asin(1 / sqrt((3 - x) ** 2 + y**2)))}


def roller_over_disc(t):
    x, y = centre_of_disc(t)
    return {"cam": (0, 0, motor(t)), "follower": (0.25, y + sqrt(mpf(1.5) ** 2 - (0.25 - x) ** 2), 0)}


def tip_on_disc(t):
    """A lever of length 2.5 on the pivot (3, 0), its tip on the disc: a four-bar with a coupler of 1.25."""
    x, y = circles((3, 0), 2.5, centre_of_disc(t), mpf(1.25), -1)
    return {"cam": (0, 0, motor(t)), "follower": (3, 0, atan2(y, x - 3))}


# Polar profiles: psi is the direction of the touched point, phi + s.


def point_over_lobes(t):
    return {"cam": (0, 0, motor(t)), "follower": (0, lobes(mpmath.pi / 2 - motor(t))[0], 0)}


def tip_direction(s):
    """The direction in which the profile's point s is on the circle of a tip (pivot (3, 0), length 2.875)."""
    d = lobes(s)[0]
    return acos((d * d + 9 - mpf(2.875) ** 2) / (6 * d))


def tip_contact(t):
    return touched(lambda s: tip_direction(s) - s, mpf(1.4))(t)


def tip_on_lobes(t):
    s = tip_contact(t)
    d, psi = lobes(s)[0], tip_direction(s)
    return {"cam": (0, 0, motor(t)), "follower": (3, 0, atan2(d * sin(psi), d * cos(psi) - 3))}


def plate_contact(t):
    """The highest point of the profile: d' sin psi + d cos psi = 0."""
    return touched(lambda s: atan2(lobes(s)[0], -lobes(s)[1]) - s, mpmath.pi / 2)(t)


def plate_over_lobes(t):
    d, _, w = lobes(plate_contact(t))
    return {"cam": (0, 0, motor(t)), "follower": (0, d * d / w, 0)}


def normal_from(s):
    """The angle from the radius to the outward normal."""
    d, slope, _ = lobes(s)
    return atan2(-slope, d)


def lever_contact(t):
    """A face through its pivot (3, 0), its normal at the angle a: 3 cos a is the height d^2 / w of the tangent."""
    return touched(lambda s: acos(lobes(s)[0] ** 2 / lobes(s)[2] / 3) - s - normal_from(s), mpf(1.25))(t)


def lever_over_lobes(t):
    d, _, w = lobes(lever_contact(t))
    return {"cam": (0, 0, motor(t)), "follower": (3, 0, acos(d * d / w / 3) - mpmath.pi / 2)}


def centre_of_roller(s):
    """The roller's centre along and across the radius to the touched point: 0.25 out along the normal."""
    d, slope, w = lobes(s)
    return d + 0.25 * d / w, -0.25 * slope / w


def roller_contact(t):
    def angle(s):
        along, across = centre_of_roller(s)
        return mpmath.pi / 2 - s - atan2(across, along)

    return touched(angle, mpmath.pi / 2)(t)


def roller_over_lobes(t):
    along, across = centre_of_roller(roller_contact(t))
    return {"cam": (0, 0, motor(t)), "follower": (0, sqrt(along**2 + across**2), 0)}


# Gears and racks.


def train(t):
    """Two wheels of radii 0.5 and 0.75 roll on each other's outside, the third of 2 has the second inside."""
    second = 0.25 - 0.5 / mpf(0.75) * (motor(t) - 0.125)
    return {"first": (0, 0, motor(t)), "second": (1.25, 0, second), "ring": (0, 0, 0.75 / mpf(2) * (second - 0.5))}


def rack_above(t):
    """A rack that lies on a wheel moves against the wheel's turn: its points move as the top of the wheel."""
    return {"wheel": (0, 0, motor(t)), "rack": (-0.5 - 0.75 * (motor(t) - 0.125), 0.75, 0)}


def rack_below(t):
    """A rack under a wheel that it drives: the wheel turns as far as the rack's points have gone."""
    return {"wheel": (0, 0, motor(t) / 0.75), "rack": (motor(t), -0.75, 0)}


def wheel_on_road(t):
    """Rolling to the right is turning clockwise."""
    return {"wheel": (-0.75 * motor(t), 0.75, motor(t))}


def wheel_on_swing(t):
    """A wheel under a rack that swings about the origin; its centre is 0.5 to the right of the rack, at a given x."""
    swing, x = motor(t) / 4, 2 + 0.25 * t
    along = (x - 0.5 * sin(swing)) / cos(swing)
    y = along * sin(swing) - 0.5 * cos(swing)
    return {"rack": (0, 0, swing), "wheel": (x, y, swing + (along - 2) / 0.5)}


# Pins with an offset, slots that move, and motion given at a point or as a rate.


def shifted_platform(t):
    x, y = shift(t)
    return {"crank": (0, 0, motor(t)), "platform": (2 * cos(motor(t)) + x, 2 * sin(motor(t)) + y, 0)}


def shifted_rocker(t):
    """A four-bar without a coupler's mass: crank 1, link 3, rocker 3; the pivot of the rocker moves about (4, 0)."""
    (x, y), angle = shift(t), motor(t)
    tip = circles((4 + x, y), 3, (cos(angle), sin(angle)), 3, -1)
    return {"crank": (0, 0, angle), "rocker": (4 + x, y, atan2(tip[1] - y, tip[0] - 4 - x))}


def slotted_rocker(t):
    """A pin on the crank, 1 from the origin, in a slot of the rocker through its pivot (-2, 0)."""
    angle = motor(t)
    return {"crank": (0, 0, angle), "rocker": (-2, 0, atan2(sin(angle), cos(angle) + 2))}


def crank_by_its_tip(t):
    """A crank of length 2 whose tip is at a given x."""
    return {"crank": (0, 0, acos((1.0 - 0.5 * t) / 2))}


def crank_by_its_rate(t):
    """phi' = 1.5 + 0.75 sin(2 t + 0.25), from 0.375 at t = 0."""
    return {"crank": (0, 0, 0.375 + 1.5 * t - 0.375 * (cos(2 * t + 0.25) - cos(mpf(0.25))))}


def rack(name, other, radius, **more):
    ends = {"body_i": name, "point_i": (0.0, 0.0), "axis_i": (2.0, 0.0), "body_j": other, "point_j": (0.0, 0.0)}
    return RackAndPinion(name="teeth", **ends, radius=radius, **more)


def between(kind, i, at_i, j, at_j, **more):
    return kind(name=f"{i} and {j}", body_i=i, point_i=at_i, body_j=j, point_j=at_j, **more)


PLATE, WEDGE, LEVER = {"normal_j": (0.0, 1.0)}, {"normal_j": (3.0, 4.0), "point": (0.5, 0.25)}, {"normal_j": (0.0, 0.5)}
ECCENTRIC, WAVY = {"profile": Disc(radius=1.25), "centre": (0.375, 0.0)}, {"profile": Polar(law=LOBES)}
FAR = (3.0, 0.0)
CASES = {
    "disc under plate": (disc_under_plate, cam(**ECCENTRIC, follower="flat", held=guide("follower"), **PLATE)),
    "disc under wedge": (disc_under_wedge, cam(**ECCENTRIC, follower="flat", held=guide("follower"), **WEDGE)),
    "disc under lever": (
        disc_under_lever,
        cam(**ECCENTRIC, follower="flat", held=pin("follower", FAR), point=(0.0, 0.25), **LEVER),
    ),
    "roller over disc": (
        roller_over_disc,
        cam(**ECCENTRIC, follower="roller", roller_radius=0.25, held=guide("follower", (0.25, 0.0))),
    ),
    "tip on disc": (tip_on_disc, cam(**ECCENTRIC, follower="point", held=pin("follower", FAR), point=(2.5, 0.0))),
    "point over lobes": (point_over_lobes, cam(**WAVY, follower="point", held=guide("follower"))),
    "tip on lobes": (tip_on_lobes, cam(**WAVY, follower="point", held=pin("follower", FAR), point=(2.875, 0.0))),
    "plate over lobes": (plate_over_lobes, cam(**WAVY, follower="flat", held=guide("follower"), **PLATE)),
    "lever over lobes": (lever_over_lobes, cam(**WAVY, follower="flat", held=pin("follower", FAR), **LEVER)),
    "roller over lobes": (
        roller_over_lobes,
        cam(**WAVY, follower="roller", roller_radius=0.25, held=guide("follower")),
    ),
    "gear train": (
        train,
        (
            (
                *(pin(body, at) for body, at in (("first", (0.0, 0.0)), ("second", (1.25, 0.0)), ("ring", (0.0, 0.0)))),
                Gear(
                    name="g1", body_i="first", radius_i=0.5, phi0_i=0.125, body_j="second", radius_j=0.75, phi0_j=0.25
                ),
                Gear(name="g2", body_i="ring", radius_i=-2.0, body_j="second", radius_j=0.75, phi0_j=0.5),
            ),
            (turning("first"),),
        ),
    ),
    "rack above": (
        rack_above,
        (
            (pin("wheel"), guide("rack", (0.0, 0.75), (1.0, 0.0)), rack("rack", "wheel", 0.75, phi0=0.125, s0=0.5)),
            (turning("wheel"),),
        ),
    ),
    "rack below": (
        rack_below,
        (
            (pin("wheel"), guide("rack", (0.0, -0.75), (1.0, 0.0)), rack("rack", "wheel", -0.75)),
            (XDriver(name="push", body="rack", law=MOTOR),),
        ),
    ),
    "wheel on road": (
        wheel_on_road,
        (
            (
                between(PointOnLine, "ground", (0.0, 0.75), "wheel", (0.0, 0.0), axis_i=(1.0, 0.0)),
                rack("ground", "wheel", -0.75),
            ),
            (turning("wheel"),),
        ),
    ),
    "wheel on swing": (
        wheel_on_swing,
        (
            (
                pin("rack"),
                between(PointOnLine, "rack", (0.0, -0.5), "wheel", (0.0, 0.0), axis_i=(1.0, 0.0)),
                rack("rack", "wheel", 0.5, s0=2.0),
            ),
            (
                turning("rack", Polynomial(coefficients=(0.05, 0.375, -0.0625))),
                XDriver(name="push", body="wheel", law=Polynomial(coefficients=(2.0, 0.25))),
            ),
        ),
    ),
    "shifted platform": (
        shifted_platform,
        (
            (pin("crank"), between(Revolute, "crank", (2.0, 0.0), "platform", (0.0, 0.0), offset_law=SHIFT)),
            (turning("crank"), turning("platform", Polynomial(coefficients=(0.0,)))),
        ),
    ),
    "shifted rocker": (
        shifted_rocker,
        (
            (
                pin("crank"),
                between(Revolute, "ground", (4.0, 0.0), "rocker", (0.0, 0.0), offset_law=SHIFT),
                between(Distance, "crank", (1.0, 0.0), "rocker", (3.0, 0.0), length=3.0),
            ),
            (turning("crank"),),
        ),
    ),
    "crank by its tip": (
        crank_by_its_tip,
        (
            (pin("crank"),),
            (XDriver(name="push", body="crank", point=(2.0, 0.0), law=Polynomial(coefficients=(1.0, -0.5))),),
        ),
    ),
    "crank by its rate": (
        crank_by_its_rate,
        ((pin("crank"),), (AngleDriver(name="motor", body="crank", rate_law=RATE, initial=0.375),)),
    ),
    "slotted rocker": (
        slotted_rocker,
        (
            (
                pin("crank"),
                pin("rocker", (-2.0, 0.0)),
                between(PointOnLine, "rocker", (0.0, 0.0), "crank", (1.0, 0.0), axis_i=(1.0, 0.0)),
            ),
            (turning("crank"),),
        ),
    ),
}
CONTACTS = {
    "point over lobes": lambda t: mpmath.pi / 2 - motor(t),
    "tip on lobes": tip_contact,
    "plate over lobes": plate_contact,
    "lever over lobes": lever_contact,
    "roller over lobes": roller_contact,
}


def scene(name, off=0.015):
    """The scene of a case, with estimates that are off, as if read from a drawing."""
    pose, (joints, drivers) = CASES[name]
    estimates = {body: tuple(float(x) + off for x in at) for body, at in pose(mpf(TIMES[0])).items()}
    bodies = tuple(Body(name=body, estimate=at) for body, at in estimates.items())
    return Scene(mechanism=Mechanism(bodies, tuple(joints), tuple(drivers)), times=TIMES, name=name)


FOLLOWERS = {"point": {}, "flat": {"normal_j": (0.0, 1.0)}, "roller": {"roller_radius": 0.25}}


def over_profile(law, follower="point", times=TIMES, estimates=((0.0, 0.0, 0.2), (0.0, 1.0, 0.0))):
    """A follower that slides up and down over a polar profile."""
    joints, drivers = cam(profile=Polar(law=law), follower=follower, held=guide("follower"), **FOLLOWERS[follower])
    bodies = tuple(Body(name=n, estimate=e) for n, e in zip(("cam", "follower"), estimates, strict=True))
    return Scene(mechanism=Mechanism(bodies, joints, drivers), times=times)
