"""MuJoCo's model of a joint tree: bodies, sites, equalities and sensors, straight from the numbers of the scene.

================ ======================================================== ==========================
joint or driver  in MuJoCo                                                row
================ ======================================================== ==========================
revolute         `connect` of two sites                                   d = r_j - r_i
fixed            `connect` of two sites;                                  d
                 equality of a fixed tendon over the hinges               delta
prismatic        `framepos` of a site in the frame of one on the guide;   n . d
                 equality of a fixed tendon over the hinges               delta
point_on_line    `framepos` of a site in the frame of one on the guide    n . d
distance         equality of a spatial tendon between two sites           |d| - length
gear             equality of a fixed tendon over the hinges, weighted     ours
                 by the radii
angle            equality of a fixed tendon over the hinges               delta
x, y             `connect` with a ground site that the law moves          one component of d
distance driver  equality of a spatial tendon between two sites           |d| - f(t)
================ ======================================================== ==========================

delta is the angle between the bodies minus the one that is wanted. MuJoCo has no equality that holds a point on a line
of a moving body, but sensors that state position and velocity of a site in the frame of another; a `connect` beside
them, whose rows are no constraint of the scene, serves for the drift term. A `weld` would hold sin(delta / 2), which is
blind to whole turns and rounded like a quaternion.

Three habits of MuJoCo shape the model. A site within 1e-6 of the origin of its body counts as being there: lengths come
in units of the mechanism's size, and `site_sameframe` is reset. An equality holds a tendon at its length in the pose of
the specification: that length is set to zero and the wanted one written to `eq_data`. With solref = (0, 0) the
stabilisation vanishes, and efc_aref is -Jdot qd.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from typing import Any

import numpy as np

from crosscheck.engines import EngineError
from crosscheck.engines.frames import Length
from crosscheck.engines.mujoco.parts import LINEAR, Driven, Guide, Source
from crosscheck.engines.tree.joint_tree import Edge, Freedom, JointTree
from refkin.joints import (
    GROUND,
    AngleDriver,
    Constraint,
    Distance,
    DistanceDriver,
    Driver,
    Fixed,
    Gear,
    Pair,
    PointOnLine,
    Prismatic,
    Revolute,
    XDriver,
    YDriver,
)

os.environ.setdefault("MUJOCO_GL", "disable")  # before the import: nothing is drawn, and there may be no display
import mujoco as mujoco  # re-exported, so that whoever imports it gets it this way

OFF = "CONTACT GRAVITY SPRING DAMPER ACTUATION SENSOR LIMIT FRICTIONLOSS WARMSTART ISLAND AUTORESET"
"""What is not kinematics (`mjtDisableBit`); sensors are on in a model that reads a guide by them."""
MASSES: dict[bool, dict[str, Any]] = {
    True: {"explicitinertial": True, "mass": 1.0, "inertia": [1.0, 1.0, 1.0]},
    False: {"explicitinertial": True, "mass": 0.0, "inertia": [0.0, 0.0, 0.0]},
}
"""Whether a body has joints -> its inertia: MuJoCo wants one on whatever moves; kinematics does not depend on it."""


class Plan:
    """A model in the making.

    Parameters
    ----------
    tree : JointTree
        The bodies, and how they hang on each other; with each one free on the ground, qpos is (x, y, phi) per body.
    constraints : iterable of Constraint
        The joints and drivers that become rows.
    """

    def __init__(self, tree: JointTree, constraints: Iterable[Constraint]) -> None:
        self.tree = tree
        self.spec = _kinematic_spec()
        self.bodies: dict[str, Any] = {GROUND: self.spec.worldbody}
        self.pins: dict[str, Pair] = {GROUND: (0.0, 0.0)}
        self.owners: list[int] = []
        self.sources: list[Source] = []
        self.guides: list[Guide] = []
        self.spatial: list[int] = []
        self.driven: list[Driven] = []
        for k, edge in enumerate(tree.edges):
            self._hang(k, edge)
        for k, constraint in enumerate(constraints):
            self._constrain(f"c{k}", constraint)

    def compile(self) -> Any:
        """Return the compiled model; from then on MuJoCo writes no log, neither to the console nor to a file.

        Raises
        ------
        EngineError
            If MuJoCo does not take the numbers.
        """
        log = mujoco.MjLogConfig.get()
        log.logto_file = log.logto_console = False
        log.set()
        if self.guides:
            switch_on(self.spec, "SENSOR")
        try:
            model = self.spec.compile()
        except ValueError as error:
            raise EngineError(f"MuJoCo does not compile this scene: {error}") from error
        model.site_sameframe[:] = 0
        model.tendon_length0[:] = 0.0
        return model

    def place(self, body: str, point: Pair) -> list[float]:
        """Return a point of the scene's body (in units of the size) in MuJoCo's, whose origin is the joint."""
        pin = self.pins[body]
        return [point[0] - pin[0], point[1] - pin[1], 0.0]

    def _hang(self, k: int, edge: Edge) -> None:
        """Add a body at its joint, so that nothing is computed at the origin of its frame, which may be far off."""
        moves = edge.freedom is not Freedom.NONE
        place = self.place(edge.parent, edge.point)
        body = self.bodies[edge.parent].add_body(name=f"b{k}", pos=place, **MASSES[moves])
        _turn(body, edge.angle)
        hinge, slide = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
        axes: dict[Freedom, list[tuple[Any, list[float]]]] = {
            Freedom.NONE: [],
            Freedom.TURN: [(hinge, [0.0, 0.0, 1.0])],
            Freedom.SLIDE: [(slide, [*edge.axis, 0.0])],
            Freedom.FREE: [(slide, [1.0, 0.0, 0.0]), (slide, [0.0, 1.0, 0.0]), (hinge, [0.0, 0.0, 1.0])],
        }
        for column, (kind, axis) in enumerate(axes[edge.freedom], edge.first):
            body.add_joint(name=f"q{column}", type=kind, axis=axis)
        self.bodies[edge.body], self.pins[edge.body] = body, edge.pin

    def _constrain(self, name: str, c: Constraint) -> None:
        if isinstance(c, Revolute | Fixed):
            first = self._connect(*self._ends(name, c))
            self.sources += [Source(constraint=c, row=k, equality=first + k) for k in range(2)]
        elif isinstance(c, PointOnLine | Prismatic):
            self._guide(name, c)
        elif isinstance(c, Distance | DistanceDriver):
            self._distance(name, c)
        elif isinstance(c, XDriver | YDriver):
            self._coordinate(name, c)
        elif isinstance(c, Gear):
            self._gear(name, c)
        elif not isinstance(c, AngleDriver):
            raise EngineError(f"mujoco refuses {c.type} {c.name!r}: it is not written for this type")
        if isinstance(c, Fixed | Prismatic | AngleDriver):
            self._angle(name, c)

    def _ends(self, name: str, c: Any) -> tuple[str, str]:
        """Add the sites at a joint's points and return their names, that on body j first: rows are j minus i."""
        for side in "ij":
            self._site(f"{name} {side}", getattr(c, f"body_{side}"), getattr(c, f"point_{side}"))
        return f"{name} j", f"{name} i"

    def _site(self, name: str, body: str, point: Pair) -> Any:
        return self.bodies[body].add_site(name=name, pos=self.place(body, self.tree.scaled(body, point)))

    def _equality(self, kind: Any, rows: int, *names: str) -> int:
        """Add an equality and return the first of its rows."""
        first, between = len(self.owners), mujoco.mjtObj.mjOBJ_TENDON if len(names) == 1 else mujoco.mjtObj.mjOBJ_SITE
        index = len(self.spec.equalities)
        equality = self.spec.add_equality(name=f"e{index}", type=kind, objtype=between, solref=[0.0, 0.0])
        equality.name1, equality.name2 = (*names, "")[:2]
        self.owners += [index] * rows
        return first

    def _connect(self, j: str, i: str) -> int:
        return self._equality(mujoco.mjtEq.mjEQ_CONNECT, 3, j, i)

    def _guide(self, name: str, c: Any) -> None:
        """Read a point on a line from sensors, in the frame of a site whose x axis is the line."""
        point, line = self._ends(name, c)
        ax, ay = _of_order_one(c.axis_i)
        site = self.spec.site(line)
        site.alt.type, site.alt.xyaxes = mujoco.mjtOrientation.mjORIENTATION_XYAXES, [ax, ay, 0.0, -ay, ax, 0.0]
        frame = {"objtype": mujoco.mjtObj.mjOBJ_SITE, "reftype": mujoco.mjtObj.mjOBJ_SITE}
        for kind in (mujoco.mjtSensor.mjSENS_FRAMEPOS, mujoco.mjtSensor.mjSENS_FRAMELINVEL):
            self.spec.add_sensor(name=f"{name} {int(kind)}", type=kind, objname=point, refname=line, **frame)
        self.sources.append(Source(constraint=c, row=0, guide=len(self.guides)))
        self.guides.append(Guide(line, point, self._connect(point, line)))

    def _angle(self, name: str, c: Any) -> None:
        """Hold the angle between two bodies by a tendon over the hinges of one and, backwards, of the other."""
        i, j = c.bodies
        turns = self.tree.angle_rows[j] - self.tree.angle_rows[i]
        offset = self.tree.angle_offsets[j] - self.tree.angle_offsets[i]
        row = c.rows - 1
        if not turns.any():  # nothing turns one against the other: MuJoCo holds no such tendon, and none is needed
            self.sources.append(Source(constraint=c, row=row, constant=offset - c.angle, unit=0))
            return
        first = self._turning(f"{name} angle", turns)
        self.sources.append(Source(constraint=c, row=row, equality=first, unit=0))
        if isinstance(c, Driver):
            self.driven.append(Driven(c, len(self.sources) - 1, self.owners[first], shift=offset))
        else:
            self.spec.equalities[-1].data[0] = c.angle - offset

    def _turning(self, name: str, weights: Any) -> int:
        """Hold a sum of hinge angles by a fixed tendon, and return its row."""
        tendon = self.spec.add_tendon(name=name)
        for column in weights.nonzero()[0]:
            tendon.wrap_joint(f"q{column}", float(weights[column]))
        return self._equality(mujoco.mjtEq.mjEQ_TENDON, 1, tendon.name)

    def _gear(self, name: str, c: Gear) -> None:
        """Hold the turns of two bodies, each times its radius, at a sum of zero."""
        radii = {c.body_i: c.radius_i / self.tree.size, c.body_j: c.radius_j / self.tree.size}
        turns = sum(radius * self.tree.angle_rows[body] for body, radius in radii.items())
        zeros = {c.body_i: c.phi0_i, c.body_j: c.phi0_j}
        wanted = sum(radius * (zeros[body] - self.tree.angle_offsets[body]) for body, radius in radii.items())
        if not np.any(turns):
            self.sources.append(Source(constraint=c, row=0, constant=-wanted))
            return
        self.sources.append(Source(constraint=c, row=0, equality=self._turning(f"{name} gear", turns)))
        self.spec.equalities[-1].data[0] = wanted

    def _distance(self, name: str, c: Any) -> None:
        tendon = self.spec.add_tendon(name=f"{name} length")
        for site in self._ends(name, c):
            tendon.wrap_site(site)
        first = self._equality(mujoco.mjtEq.mjEQ_TENDON, 1, tendon.name)
        self.spatial.append(first)
        form = LINEAR if isinstance(c, Driver) else Length(c.length)
        self.sources.append(Source(constraint=c, row=0, equality=first, form=form))
        if isinstance(c, Driver):
            self.driven.append(Driven(c, len(self.sources) - 1, self.owners[first], size=self.tree.size))
        else:
            self.spec.equalities[-1].data[0] = c.length / self.tree.size

    def _coordinate(self, name: str, c: Any) -> None:
        """Tie a point to a ground site that the law moves along x or y; the other row of the `connect` is not read."""
        axis = 1 if isinstance(c, YDriver) else 0
        self._site(name, c.body, c.point)
        target = f"{name} target"
        self.spec.worldbody.add_site(name=target)
        row = self._connect(name, target) + axis
        self.sources.append(Source(constraint=c, row=0, equality=row))
        shift, size = self.tree.origin[axis], self.tree.size
        self.driven.append(Driven(c, len(self.sources) - 1, self.owners[row], target, axis, shift, size))


def _kinematic_spec() -> Any:
    """Return an empty specification with everything switched off that is not kinematics.

    The Jacobian is dense: it is read entry by entry, and the sparse solver of MuJoCo 4.0.0 errs.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.disableflags = sum(_bit(effect) for effect in OFF.split())
    return spec


def switch_on(spec: Any, *effects: str) -> None:
    """Take the bits of some effects (`mjtDisableBit`) from those that are disabled."""
    for effect in effects:
        spec.option.disableflags &= ~_bit(effect)


def _bit(effect: str) -> int:
    return int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{effect}"))


def _turn(item: Any, angle: float) -> None:
    """Turn a body or a site by an angle [rad] against what it is on."""
    item.alt.type, item.alt.axisangle = mujoco.mjtOrientation.mjORIENTATION_AXISANGLE, [0.0, 0.0, 1.0, angle]


def _of_order_one(axis: Pair) -> Pair:
    """Return the axis times a power of two: MuJoCo scales it to length 1, but takes none below 1e-14."""
    exponent = max(math.frexp(a)[1] for a in axis if a != 0.0)
    return math.ldexp(axis[0], -exponent), math.ldexp(axis[1], -exponent)
