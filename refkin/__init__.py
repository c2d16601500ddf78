"""Kinematics of planar and spatial mechanisms in absolute coordinates, to be read in one sitting.

In this order:

================= ==================================================================================
`vec`             vectors and the values of one body, in any arithmetic (of space: `joints.spatial_vectors`)
`motion_laws`     f, f', f'': polynomial, sinusoid, table; given by values or by rates
`joints`          every joint and driver: residual, Jacobian, nu, gamma, each written once (of space: `spatial...`)
`model`           Body, Mechanism, Scene: what is asked
`system`          phi(q, t) = 0, phi_q qd = nu, phi_q qdd = gamma
`differences`     Jacobians by forward and central differences and by complex steps
`newton`          Newton's method on callables, with its history
`motion`          Motion: what is answered; how a point of a body moves
`analysis`        position, velocity, acceleration; `sweep`: a Scene becomes a Motion
================= ==================================================================================

That is the reference, which runs alone. What stands above it is imported when it is asked for:

================= ==================================================================================
`refkin.scenes`   scene files (`load`), four-bars and slider-cranks by their lengths
`refkin.proof`    certificates, enclosures, singularities, paths, assemblies
`refkin.solving`  `solve`: the sweep that finds its start, keeps its branch and proves each pose; `follow`, `diagnose`
`refkin.fast`     the same answers in microseconds; `refkin.output` draws them, and writes tables
================= ==================================================================================

Symbols (Haug, Nikravesh, Shabana; SI units, right-handed, angles counter-clockwise in rad):

========= ======================================= ==============================================================
`q`       coordinates                             (x, y, phi) per body, in space (x, y, z, e0 to e3); then those of cams
`qd`      velocities                              `qdd`: accelerations
`phi`     constraint residual, Shabana's C        phi(q, t) = 0; of a body `phi` is its angle
`phi_q`   constraint Jacobian
`nu`      velocity right side                     nu = -phi_t,  phi_q qd = nu
`gamma`   acceleration right side                 gamma = -(phi_q qd)_q qd - 2 phi_qt qd - phi_tt,  phi_q qdd = gamma
`size`    unit of length of every solve           power of two nearest the largest distance of two points on a body
========= ======================================= ==============================================================
"""

from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

from refkin.analysis import acceleration, position, velocity
from refkin.errors import Fault, InvalidRequest, InvalidScene, RefkinError
from refkin.joints.base import Unit
from refkin.joints.cams import Cam, Disc, Polar
from refkin.joints.drivers import AngleDriver, DistanceDriver, XDriver, YDriver
from refkin.joints.planar import Distance, Fixed, PointOnLine, Prismatic, Revolute
from refkin.joints.rolling import Gear, RackAndPinion

from refkin.joints.spatial import (  # isort: skip
    Cylindrical, Parallel, Perpendicular, PointOnPlane, Screw, SpatialDistance, SpatialFixed, SpatialGear,
    SpatialPointOnLine, SpatialPrismatic, SpatialRevolute, Spherical, Universal,
)  # fmt: skip
from refkin.joints.spatial_drivers import DisplacementDriver, SpatialAngleDriver, SpatialDistanceDriver
from refkin.model import Body, Effect, Evidence, Mechanism, Point, Scene
from refkin.motion import Motion, Seeding, Status, __version__
from refkin.motion_laws import Integral, Polynomial, Sinusoid, Table
from refkin.newton import NewtonResult, NewtonStatus, newton
from refkin.system import System, compile_system

if TYPE_CHECKING:
    from refkin.scenes.files import load
    from refkin.scenes.linkages import FourBar, InvertedSliderCrank, SliderCrank
    from refkin.solving.follow import follow
    from refkin.solving.solve import solve
    from refkin.solving.starts import diagnose

# fmt: off
__all__ = [
    "AngleDriver", "Body", "Cam", "Cylindrical", "Disc", "DisplacementDriver", "Distance", "DistanceDriver", "Effect",
    "Evidence", "Fault", "Fixed", "FourBar", "Gear", "Integral", "InvalidRequest", "InvalidScene",
    "InvertedSliderCrank", "Mechanism", "Motion", "NewtonResult", "NewtonStatus", "Parallel", "Perpendicular", "Point",
    "PointOnLine", "PointOnPlane", "Polar", "Polynomial", "Prismatic", "RackAndPinion", "RefkinError", "Revolute",
    "Scene", "Screw", "Seeding", "Sinusoid", "SliderCrank", "SpatialAngleDriver", "SpatialDistance",
    "SpatialDistanceDriver", "SpatialFixed", "SpatialGear", "SpatialPointOnLine", "SpatialPrismatic", "SpatialRevolute",
    "Spherical", "Status", "System", "Table", "Unit", "Universal", "XDriver", "YDriver", "__version__", "acceleration",
    "compile_system", "diagnose", "follow", "load", "newton", "position", "solve", "velocity",
]
# fmt: on

ABOVE = {"diagnose": "solving.starts", "follow": "solving.follow", "load": "scenes.files", "solve": "solving.solve"}
ABOVE |= dict.fromkeys(("FourBar", "InvertedSliderCrank", "SliderCrank"), "scenes.linkages")


def __getattr__(name: str) -> Any:
    if name not in ABOVE:
        raise AttributeError(f"module 'refkin' has no attribute {name!r}")
    return getattr(import_module(f"refkin.{ABOVE[name]}"), name)


def __dir__() -> list[str]:
    return [*globals(), *ABOVE]


Scene._repr_svg_ = lambda scene: __getattr__("solve")(replace(scene, times=scene.times[:1]))._repr_svg_()  # type: ignore
