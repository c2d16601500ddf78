"""The joints and drivers: each one's formulas written once, in scalar arithmetic (see `base`)."""

from refkin.joints.base import SI, Constraint, Unit
from refkin.joints.cams import Cam, Disc, Polar, initial_contacts, polar_cams
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
from refkin.joints.planar import Distance, Fixed, PointOnLine, Prismatic, Revolute
from refkin.joints.rolling import Gear, RackAndPinion

JOINT_TYPES: tuple[type[Constraint], ...]
JOINT_TYPES = (Revolute, Fixed, PointOnLine, Prismatic, Distance, Gear, RackAndPinion, Cam)

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
    "initial_contacts",
    "polar_cams",
]
