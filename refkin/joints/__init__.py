"""The joints and drivers: each one's formulas written once, in scalar arithmetic (see `base`)."""

from refkin.joints.base import GROUND, SI, Constraint, Pair, Unit
from refkin.joints.contact import CONTACT_TYPES, Cam, Disc, Gear, Polar, RackAndPinion
from refkin.joints.drivers import DRIVER_TYPES, AngleDriver, DistanceDriver, Driver, XDriver, YDriver
from refkin.joints.planar import PLANAR_TYPES, Distance, Fixed, PointOnLine, Prismatic, Revolute

JOINT_TYPES: tuple[type[Constraint], ...] = (*PLANAR_TYPES, *CONTACT_TYPES)

__all__ = [
    "DRIVER_TYPES",
    "GROUND",
    "JOINT_TYPES",
    "SI",
    "AngleDriver",
    "Cam",
    "Constraint",
    "Disc",
    "Distance",
    "DistanceDriver",
    "Driver",
    "Fixed",
    "Gear",
    "Pair",
    "PointOnLine",
    "Polar",
    "Prismatic",
    "RackAndPinion",
    "Revolute",
    "Unit",
    "XDriver",
    "YDriver",
]
