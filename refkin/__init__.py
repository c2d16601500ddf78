"""The reference implementation of absolute-coordinate kinematics, written to be read in one sitting.

In this order:

========================= ==============================================================================================
`vec`                     vectors and the values of one body, in any arithmetic
`motion_laws`             f, f', f'': polynomial, sinusoid, table; as a value or as a rate
`joints`                  every joint and driver: residual, Jacobian, nu, gamma, each written once
`model`                   Body, Mechanism, Scene: what is asked
`system`                  phi(q, t) = 0, phi_q qd = nu, phi_q qdd = gamma
`differences`             forward, central, complex-step Jacobians
`newton`                  Newton's method on callables, with its history
`contacts`, `starts`      the first pose: where cams are touched, which assembly is meant
`turnings`                where laws turn back between two times
`sweep`                   from one pose to the next on one branch
`motion`, `points`        what is answered
`analysis`                position, velocity, acceleration: a Scene becomes a Motion
`linkages`                four-bar and slider-cranks by their lengths
`scene_files`             scenes as TOML
`proof`                   how sure we are: certificates, assemblies, singularities (`diagnose`), paths (`follow`)
========================= ==============================================================================================

Symbols (Haug, Nikravesh, Shabana; SI units, right-handed, angles counter-clockwise in rad):

========= ======================================= ==============================================================
`q`       coordinates, (x, y, phi) per body,      `qd`, `qdd` their rates
          then contact parameters
`phi`     constraint residual, Shabana's C        phi(q, t) = 0
`phi_q`   constraint Jacobian
`nu`      velocity right side                     nu = -phi_t,  phi_q qd = nu
`gamma`   acceleration right side                 gamma = -(phi_q qd)_q qd - 2 phi_qt qd - phi_tt,  phi_q qdd = gamma
`size`    power of two nearest the largest distance of two joint points on one body; every solve is scaled by it
========= ======================================= ==============================================================
"""

from refkin.errors import Fault, InvalidRequest, InvalidScene, RefkinError
from refkin.joints import (
    AngleDriver,
    Cam,
    Disc,
    Distance,
    DistanceDriver,
    Fixed,
    Gear,
    PointOnLine,
    Polar,
    Prismatic,
    RackAndPinion,
    Revolute,
    Unit,
    XDriver,
    YDriver,
)
from refkin.model import Body, Effect, Evidence, Mechanism, Point, Scene
from refkin.motion import Motion, Seeding, Status
from refkin.motion_laws import Integral, Polynomial, Sinusoid, Table
from refkin.newton import NewtonResult, NewtonStatus, newton
from refkin.proof.pose.singularity import diagnose
from refkin.scenes.files import load
from refkin.scenes.linkages import FourBar, InvertedSliderCrank, SliderCrank
from refkin.solving.follow import follow
from refkin.solving.solve import acceleration, position, solve, velocity
from refkin.system import System, compile_system

__all__ = [
    "AngleDriver",
    "Body",
    "Cam",
    "Disc",
    "Distance",
    "DistanceDriver",
    "Effect",
    "Evidence",
    "Fault",
    "Fixed",
    "FourBar",
    "Gear",
    "Integral",
    "InvalidRequest",
    "InvalidScene",
    "InvertedSliderCrank",
    "Mechanism",
    "Motion",
    "NewtonResult",
    "NewtonStatus",
    "Point",
    "PointOnLine",
    "Polar",
    "Polynomial",
    "Prismatic",
    "RackAndPinion",
    "RefkinError",
    "Revolute",
    "Scene",
    "Seeding",
    "Sinusoid",
    "SliderCrank",
    "Status",
    "System",
    "Table",
    "Unit",
    "XDriver",
    "YDriver",
    "acceleration",
    "compile_system",
    "diagnose",
    "follow",
    "load",
    "newton",
    "position",
    "solve",
    "velocity",
]
