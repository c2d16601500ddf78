"""Gears of space: the turns of two joints are in proportion (Shabana, Computational Dynamics, section 3.9).

Each joint is between a wheel and the carrier, on which both centres are at rest. Whether their axes are parallel (spur,
helical), meet (bevel) or cross (worm, crossed helical), only the radii that roll count: of a bevel gear those at which
its cones touch, of a helical one the radius times the cosine of the angle of its helix.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from refkin.errors import Fault
from refkin.joints.base import Constraint
from refkin.joints.elements import GROUND, names_of
from refkin.joints.spatial_base import SpatialConstraint
from refkin.joints.spatial_elements import GearedTurns
from refkin.joints.spatial_turns import InGear


@dataclass(frozen=True, kw_only=True)
class SpatialGear(SpatialConstraint):
    """Two joints turn in proportion: radius_i (theta_i - phi0_i) + radius_j (theta_j - phi0_j) = 0.

    The angle theta of a joint is that which its driver counts, from zero i to zero j about its axis, turns included.
    Nothing asks where axes are: opposite signs are an internal gear, a belt, or a joint that is written the other way
    round. Source: (theta^i - theta^i_o) a^i + (theta^j - theta^j_o) a^j = 0.
    """

    joint_i: str
    radius_i: float
    joint_j: str
    radius_j: float
    phi0_i: float = 0.0
    phi0_j: float = 0.0
    type: Literal["gear"] = "gear"
    formulas = (InGear(),)

    @property
    def bodies(self) -> tuple[str, ...]:
        return GROUND, "", GROUND

    @property
    def shares(self) -> tuple[str, str]:
        return self.joint_i, self.joint_j

    def among(self, joints: Sequence[Constraint]) -> Constraint:
        """Return the gear with the wheels and the carrier of its joints; itself if there are none."""
        turning = {joint.name: {*joint.bodies} for joint in joints if "angle" in getattr(joint, "moves", ())}
        i, j = (turning.get(name, set()) for name in self.shares)
        if len(i) != 2 or len(j) != 2 or len(common := i & j) != 1:
            return self
        (wheel_i,), (wheel_j,), (carrier,) = i - common, j - common, common
        own = {key: getattr(self, key) for key in names_of(SpatialGear)}
        return WheelsInGear(**own, body_i=wheel_i, body_j=wheel_j, carrier=carrier)

    def faults(self, path: str) -> Iterator[Fault]:
        for key in ("radius_i", "radius_j"):
            if getattr(self, key) == 0.0:
                yield Fault(f"{path}.{key}", 0.0, "a radius that is not zero")
        if not isinstance(self, WheelsInGear):
            what = "two joints of the scene, revolute, cylindrical or screw, with one body in common, the carrier"
            yield Fault(f"{path}.joint_i", self.joint_i, f"{what} (joint_j is {self.joint_j!r})")


@dataclass(frozen=True, kw_only=True)
class WheelsInGear(SpatialGear):
    """What a gear becomes, with the bodies of its joints."""

    body_i: str
    body_j: str
    carrier: str
    consists_of = (GearedTurns,)

    @property
    def bodies(self) -> tuple[str, str, str]:
        return self.body_i, self.body_j, self.carrier
