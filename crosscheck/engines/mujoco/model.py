"""MuJoCo's model of a joint tree: bodies, sites, equalities and sensors, straight from the numbers of the scene.

=================== ======================================================== ==========================
element             in MuJoCo                                                row
=================== ======================================================== ==========================
points coincide     `connect` of two sites                                   d = r_j - r_i
point on line       `framepos` of a site in the frame of one on the guide    n . d
distance            equality of a spatial tendon between two sites           |d| - length
distance by a law   equality of a spatial tendon between two sites           |d| - f(t)
angle               equality of a fixed tendon over the hinges               delta
rolling wheels      equality of a fixed tendon over the hinges, weighted     ours
                    by the radii
coordinate by a law `connect` with a ground site that the law moves          one component of d
=================== ======================================================== ==========================

delta is the angle between the bodies minus the one that is wanted. MuJoCo has no equality that holds a point on a line
of a moving body, but sensors that state position and velocity of a site in the frame of another; a `connect` beside
them, whose rows are no constraint of the scene, serves for the Jacobian and the drift term. A `weld` would hold
sin(delta / 2), which is blind to whole turns and rounded like a quaternion.

Three habits of MuJoCo shape the model. A site within 1e-6 of the origin of its body counts as being there: lengths come
in units of the mechanism's size, and `site_sameframe` is reset. An equality holds a tendon at its length in the pose of
the specification: that length is set to zero and the wanted one written to `eq_data`. With solref = (0, 0) the
stabilisation vanishes, and efc_aref is -Jdot qd.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from crosscheck.engines import EngineError, EngineRefusal
from crosscheck.engines.frames import Form, Length, Linear, through_its_point
from crosscheck.engines.tree.joint_tree import Edge, Freedom, JointTree
from refkin import joints
from refkin.joints import Element

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
    """A model in the making, of a tree of bodies and the elements that become rows.

    With each body free on the ground, qpos is (x, y, phi) per body.
    """

    def __init__(self, tree: JointTree, elements: Iterable[joints.Element]) -> None:
        self.tree = tree
        self.spec = kinematic_spec()
        self.bodies: dict[str, Any] = {joints.GROUND: self.spec.worldbody}
        self.pins: dict[str, joints.Pair] = {joints.GROUND: (0.0, 0.0)}
        self.owners: list[int] = []
        self.sources: list[Source] = []
        self.guides: list[LineGuide] = []
        self.spatial: list[int] = []
        self.driven: list[Driven] = []
        for k, edge in enumerate(tree.edges):
            self._hang(k, edge)
        for k, element in enumerate(elements):
            self._constrain(f"c{k}", element)

    def compile(self) -> Any:
        """Return the compiled model; raises as `compiled`."""
        if self.guides:
            switch_on(self.spec, "SENSOR")
        return compiled(self.spec)

    def place(self, body: str, point: joints.Pair) -> list[float]:
        """Return a point of the scene's body (in units of the size) in MuJoCo's, whose origin is the joint."""
        pin = self.pins[body]
        return [point[0] - pin[0], point[1] - pin[1], 0.0]

    def _hang(self, k: int, edge: Edge) -> None:
        """Add a body at its joint, so that nothing is computed at the origin of its frame, which may be far off."""
        moves = edge.freedom is not Freedom.NONE
        place = self.place(edge.parent, edge.point)
        body = self.bodies[edge.parent].add_body(name=f"b{k}", pos=place, **MASSES[moves])
        body.alt.type = mujoco.mjtOrientation.mjORIENTATION_AXISANGLE
        body.alt.axisangle = [0.0, 0.0, 1.0, edge.angle]
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

    def _constrain(self, name: str, e: joints.Element) -> None:
        if isinstance(e, joints.PointsCoincide) and not e.laws:
            first = self._connect(*self._ends(name, e))
            self.sources += [Source(element=e, row=k, equality=first + k) for k in range(2)]
        elif isinstance(e, joints.GuidedPoint):
            self._guide(name, through_its_point(e))
        elif isinstance(e, joints.PointDistance):
            self._distance(name, e)
        elif isinstance(e, joints.PointCoordinate):
            self._coordinate(name, e)
        elif isinstance(e, joints.RollingWheels):
            self._wheels(name, e)
        elif isinstance(e, joints.RelativeAngle):
            self._angle(name, e)
        else:
            raise EngineRefusal(f"mujoco refuses {e.key} of {e.name!r}: it is not written for this element")

    def _ends(self, name: str, e: Any) -> tuple[str, str]:
        """Add the sites at an element's points and return their names, that on body j first: rows are j minus i."""
        for side, (body, point) in zip("ij", e.ends, strict=True):
            self._site(f"{name} {side}", body, point)
        return f"{name} j", f"{name} i"

    def _site(self, name: str, body: str, point: joints.Pair) -> Any:
        return self.bodies[body].add_site(name=name, pos=self.place(body, self.tree.scaled(body, point)))

    def _equality(self, kind: Any, rows: int, *names: str) -> int:
        """Add an equality and return the first of its rows."""
        first, between = len(self.owners), mujoco.mjtObj.mjOBJ_TENDON if len(names) == 1 else mujoco.mjtObj.mjOBJ_SITE
        self.owners += [len(self.spec.equalities)] * rows
        add_equality(self.spec, kind, between, *names, solref=[0.0, 0.0])
        return first

    def _connect(self, j: str, i: str) -> int:
        return self._equality(mujoco.mjtEq.mjEQ_CONNECT, 3, j, i)

    def _guide(self, name: str, e: joints.GuidedPoint) -> None:
        """Read a point on a line from sensors, in the frame of a site whose x axis is the line."""
        point, line = self._ends(name, e)
        ax, ay = _of_order_one(e.axis_i)
        site = self.spec.site(line)
        site.alt.type, site.alt.xyaxes = mujoco.mjtOrientation.mjORIENTATION_XYAXES, [ax, ay, 0.0, -ay, ax, 0.0]
        frame = {"objtype": mujoco.mjtObj.mjOBJ_SITE, "reftype": mujoco.mjtObj.mjOBJ_SITE}
        for kind in (mujoco.mjtSensor.mjSENS_FRAMEPOS, mujoco.mjtSensor.mjSENS_FRAMELINVEL):
            self.spec.add_sensor(name=f"{name} {int(kind)}", type=kind, objname=point, refname=line, **frame)
        self.sources.append(Source(element=e, guide=len(self.guides)))
        self.guides.append(LineGuide(e.body_i, line, point, self._connect(point, line)))

    def _angle(self, name: str, e: joints.RelativeAngle) -> None:
        """Hold the angle between two bodies by a tendon over the hinges of one and, backwards, of the other."""
        turns, offset = self.tree.turn(e)
        if not turns.any():  # nothing turns one against the other: MuJoCo holds no such tendon, and none is needed
            if e.laws:
                raise EngineRefusal(f"mujoco refuses {e.key} of {e.name!r}: no joint of the tree turns its bodies")
            self.sources.append(Source(element=e, constant=offset - e.angle, unit=0))
            return
        first = self._turning(f"{name} angle", turns)
        self.sources.append(Source(element=e, equality=first, unit=0))
        if e.laws:
            self.driven.append(Driven(e, self.owners[first], shift=offset))
        else:
            self.spec.equalities[-1].data[0] = e.angle - offset

    def _turning(self, name: str, weights: Any) -> int:
        """Hold a sum of hinge angles by a fixed tendon, and return its row."""
        tendon = self.spec.add_tendon(name=name)
        for column in weights.nonzero()[0]:
            tendon.wrap_joint(f"q{column}", float(weights[column]))
        return self._equality(mujoco.mjtEq.mjEQ_TENDON, 1, tendon.name)

    def _wheels(self, name: str, e: joints.RollingWheels) -> None:
        """Hold the turns of two bodies against a third, each times its radius, at a sum of zero."""
        rows, offsets, size = self.tree.angle_rows, self.tree.angle_offsets, self.tree.size
        wheels = ((e.body_i, e.radius_i / size, e.zero_i), (e.body_j, e.radius_j / size, e.zero_j))
        turns = sum(radius * (rows[body] - rows[e.carrier]) for body, radius, _ in wheels)
        wanted = sum(radius * (zero - offsets[body] + offsets[e.carrier]) for body, radius, zero in wheels)
        if not np.any(turns):
            self.sources.append(Source(element=e, constant=-wanted))
            return
        self.sources.append(Source(element=e, equality=self._turning(f"{name} wheels", turns)))
        self.spec.equalities[-1].data[0] = wanted

    def _distance(self, name: str, e: joints.PointDistance) -> None:
        tendon = self.spec.add_tendon(name=f"{name} length")
        for site in self._ends(name, e):
            tendon.wrap_site(site)
        first = self._equality(mujoco.mjtEq.mjEQ_TENDON, 1, tendon.name)
        self.spatial.append(first)
        self.sources.append(Source(element=e, equality=first, form=LINEAR if e.laws else Length(e.length)))
        if e.laws:
            self.driven.append(Driven(e, self.owners[first], size=self.tree.size))
        else:
            self.spec.equalities[-1].data[0] = e.length / self.tree.size

    def _coordinate(self, name: str, e: joints.PointCoordinate) -> None:
        """Tie a point to a ground site that the law moves along x or y; the other row of the `connect` is not read."""
        self._site(name, e.body_j, e.point_j)
        target = f"{name} target"
        self.spec.worldbody.add_site(name=target)
        row = self._connect(name, target) + e.axis
        self.sources.append(Source(element=e, equality=row))
        shift, size = self.tree.origin[e.axis], self.tree.size
        self.driven.append(Driven(e, self.owners[row], target, e.axis, shift, size))


def kinematic_spec() -> Any:
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


def compiled(spec: Any) -> Any:
    """Return the model of a specification; from then on MuJoCo writes no log. EngineError for numbers it refuses."""
    log = mujoco.MjLogConfig.get()
    log.logto_file = log.logto_console = False
    log.set()
    try:
        model = spec.compile()
    except ValueError as error:
        raise EngineError(f"MuJoCo does not compile this scene: {error}") from error
    model.site_sameframe[:] = 0
    model.tendon_length0[:] = 0.0
    return model


def add_equality(spec: Any, kind: Any, between: Any, *names: str, **more: Any) -> Any:
    """Add an equality between two things of a kind, or of one alone.

    Parameters
    ----------
    spec, kind : mujoco.MjSpec, mujoco.mjtEq
    between, *names, **more
        What kind of things it is between (mujoco.mjtObj), the names of one or two, further attributes of the equality.
    """
    added = spec.add_equality(name=f"e{len(spec.equalities)}", type=kind, objtype=between, **more)
    added.name1, added.name2 = (*names, "")[:2]
    return added


def switch_on(spec: Any, *effects: str) -> None:
    """Take the bits of some effects (`mjtDisableBit`) from those that are disabled."""
    for effect in effects:
        spec.option.disableflags &= ~_bit(effect)


def _bit(effect: str) -> int:
    return int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{effect}"))


def _of_order_one(axis: joints.Pair) -> joints.Pair:
    """Return the axis times a power of two: MuJoCo scales it to length 1, but takes none as short as 1e-7."""
    exponent = max(math.frexp(a)[1] for a in axis if a != 0.0)
    return math.ldexp(axis[0], -exponent), math.ldexp(axis[1], -exponent)


LINEAR = Linear()


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where MuJoCo holds row `row` of an element: in a row of the equalities, or with a guide, or as a constant.

    `equality` is the row among those of all equalities, `guide` the index of the guide; without both the row is
    `constant`. `unit` is the power of length in its unit, 0 for an angle; `form` what it is of ours, both in metres and
    radians (`crosscheck.engines.frames`).
    """

    element: Element
    row: int = 0
    equality: int | None = None
    guide: int | None = None
    constant: float = 0.0
    unit: int = 1
    form: Form = LINEAR


@dataclass(frozen=True)
class LineGuide:
    """A line along the x axis of site `line` on a body, the site `point`, and the first row of a `connect` of both."""

    body: str
    line: str
    point: str
    connect: int


@dataclass(frozen=True)
class Driven:
    """Where the value of an element's law goes: `eq_data` of an equality, or coordinate `axis` of a ground site.

    (law - shift) / size is the law in the model's unit.
    """

    element: Element
    equality: int
    site: str = ""
    axis: int = 0
    shift: float = 0.0
    size: float = 1.0

    def value(self, t: float, order: int) -> float:
        """Return the law's value or derivative in the model's unit."""
        law = float(self.element.laws[0](t, order))
        return (law - (0.0 if order else self.shift)) / self.size
