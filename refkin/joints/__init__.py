"""The joints and drivers: each one's formulas written once, in scalar arithmetic (see `base`)."""

from refkin.joints.base import SI, Constraint, Unit
from refkin.joints.contact import CONTACT_TYPES, Cam, Disc, Gear, Polar, RackAndPinion
from refkin.joints.drivers import DRIVER_TYPES, AngleDriver, DistanceDriver, Driver, XDriver, YDriver
from refkin.joints.elements import (
    GROUND,
    Contact,
    Element,
    GuidedPoint,
    Pair,
    PointCoordinate,
    PointDistance,
    PointsCoincide,
    RelativeAngle,
    RollingOnLine,
    RollingWheels,
    elements_of,
)
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
    "Contact",
    "Disc",
    "Distance",
    "DistanceDriver",
    "Driver",
    "Element",
    "Fixed",
    "Gear",
    "GuidedPoint",
    "Pair",
    "PointCoordinate",
    "PointDistance",
    "PointOnLine",
    "PointsCoincide",
    "Polar",
    "Prismatic",
    "RackAndPinion",
    "RelativeAngle",
    "Revolute",
    "RollingOnLine",
    "RollingWheels",
    "Unit",
    "XDriver",
    "YDriver",
    "elements_of",
]
