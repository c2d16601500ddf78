"""The joints and drivers: each one's formulas written once, in scalar arithmetic (see `base`)."""

from refkin.joints.base import PLANE, SI, Constraint, Kind, Unit
from refkin.joints.cams import Cam, Disc, Polar, polar_cams
from refkin.joints.drivers import DRIVER_TYPES, AngleDriver, DistanceDriver, Driver, XDriver, YDriver
from refkin.joints.own_coordinates import initial_contacts
from refkin.joints.planar import PLANAR_TYPES, Distance, Fixed, PointOnLine, Prismatic, Revolute
from refkin.joints.rolling import Gear, RackAndPinion

# fmt: off
# isort: off
from refkin.joints.elements import (
    GROUND, Contact, Element, GuidedPoint, Pair, PointCoordinate, PointDistance, PointsCoincide, RelativeAngle,
    RollingOnLine, RollingWheels, Triple, elements_of,
)
from refkin.joints.spatial import (
    SPATIAL_JOINT_TYPES, Cylindrical, Parallel, Perpendicular, PointOnPlane, Screw, SpatialDistance,
    SpatialFixed, SpatialGear, SpatialPointOnLine, SpatialPrismatic, SpatialRevolute, Spherical, Universal,
)
from refkin.joints.spatial_base import Counted
from refkin.joints.spatial_bodies import SPACE, with_unit_length
from refkin.joints.spatial_drivers import (
    SPATIAL_DRIVER_TYPES, DisplacementDriver, SpatialAngleDriver, SpatialDistanceDriver,
)
from refkin.joints.spatial_elements import (
    AxesParallel, AxesPerpendicular, GearedTurns, PointInPlane, PointOnAxis, PointsMeet, ScrewMotion, ShiftAlongAxis,
    SpatialPointDistance, TurnAboutAxis,
)
from refkin.joints.spatial_passive import passive_spins
# isort: on

JOINT_TYPES: tuple[type[Constraint], ...] = (*PLANAR_TYPES, Gear, RackAndPinion, Cam)

KINDS = {kind.name: kind for kind in (PLANE, SPACE)}
"""Bodies are of the plane or of space, all those of a mechanism alike."""

__all__ = [
    "DRIVER_TYPES", "GROUND", "JOINT_TYPES", "KINDS", "PLANE", "SI", "SPACE", "SPATIAL_DRIVER_TYPES",
    "SPATIAL_JOINT_TYPES", "AngleDriver", "AxesParallel", "AxesPerpendicular", "Cam", "Constraint", "Contact",
    "Counted", "Cylindrical", "Disc", "DisplacementDriver", "Distance", "DistanceDriver", "Driver", "Element", "Fixed",
    "Gear", "GearedTurns", "GuidedPoint", "Kind", "Pair", "Parallel", "Perpendicular", "PointCoordinate",
    "PointDistance", "PointInPlane", "PointOnAxis", "PointOnLine", "PointOnPlane", "PointsCoincide", "PointsMeet",
    "Polar", "Prismatic", "RackAndPinion", "RelativeAngle", "Revolute", "RollingOnLine", "RollingWheels", "Screw",
    "ScrewMotion", "ShiftAlongAxis", "SpatialAngleDriver", "SpatialDistance", "SpatialDistanceDriver", "SpatialFixed",
    "SpatialGear", "SpatialPointDistance", "SpatialPointOnLine", "SpatialPrismatic", "SpatialRevolute", "Spherical",
    "Triple", "TurnAboutAxis", "Unit", "Universal", "XDriver", "YDriver", "elements_of", "initial_contacts",
    "passive_spins", "polar_cams", "with_unit_length",
]
# fmt: on
