"""The joints and drivers: each one's formulas written once, in scalar arithmetic (see `base`)."""

from refkin.joints.base import GROUND, SI, Constraint, Pair, Unit
from refkin.joints.drivers import DRIVER_TYPES, AngleDriver, DistanceDriver, Driver, XDriver, YDriver
from refkin.joints.planar import JOINT_TYPES, Distance, Fixed, PointOnLine, Prismatic, Revolute

__all__ = [
    "DRIVER_TYPES",
    "GROUND",
    "JOINT_TYPES",
    "SI",
    "AngleDriver",
    "Constraint",
    "Distance",
    "DistanceDriver",
    "Driver",
    "Fixed",
    "Pair",
    "PointOnLine",
    "Prismatic",
    "Revolute",
    "Unit",
    "XDriver",
    "YDriver",
]
