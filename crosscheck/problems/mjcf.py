"""A problem as MJCF, MuJoCo's model file: plain text, written from the elements of the joints.

Each body of the plane stands on the ground by two slides and a hinge, so that its three entries of qpos are x, y [m],
phi [rad]; one of space is free, and has x, y, z and its Euler parameters. Each element is an equality. MuJoCo has none
that keeps a point on a line: a carriage is added there, a body of its own that slides on body i, along the line and,
where the line is a rack, across it. So it is with elements of space: a carriage slides and turns on body i as the
element lets body j, to which it is welded. The model is at rest in qpos = 0, where all frames lie on the ground's; the
key `start` has the estimates. MuJoCo takes a site within 1e-6 of the origin of its body for one that is there: a model
of a small mechanism is in units of its size, and says so in `metres per unit`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree as ET

from crosscheck.engines.frames import through_its_point
from crosscheck.engines.spatial.turning import joint_frame, parameters
from crosscheck.errors import CannotRun
from crosscheck.problems import adding, formula
from refkin import joints
from refkin.model import Scene

INERTIA = {"pos": "0 0 0", "mass": "1", "diaginertia": "1 1 1"}
"""MuJoCo wants one on whatever moves; kinematics does not depend on it."""
AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
ORIGIN = (0.0, 0.0, 0.0)
SMALL = 1e-3
"""The size below which a model is in units of it [m]."""


def to_mjcf(scene: Scene) -> str:
    """Return the text of the model, at the first time of the scene."""
    model = _Model(scene).root
    ET.indent(model)
    return ET.tostring(model, encoding="unicode") + "\n"


class _Model:
    """The model in the making; `carriages` counts the bodies that are not the scene's."""

    def __init__(self, scene: Scene) -> None:
        plane = scene.mechanism.kind is joints.PLANE
        self.t, size = scene.times[0], scene.mechanism.unit().size
        self.unit = size if size < SMALL else 1.0
        self.root = ET.Element("mujoco", {"model": scene.name})
        ET.SubElement(self.root, "compiler", {"angle": "radian"})
        option = ET.SubElement(self.root, "option", {"gravity": "0 0 0", "jacobian": "dense"})
        ET.SubElement(option, "flag", {"contact": "disable"})
        numeric = {"name": "metres per unit", "data": repr(self.unit)}
        ET.SubElement(ET.SubElement(self.root, "custom"), "numeric", numeric)
        world = ET.SubElement(self.root, "worldbody")
        self.bodies = {joints.GROUND: world}
        self.tendons, self.equalities = ET.Element("tendon"), ET.Element("equality")
        self.carriages = 0
        for body in scene.mechanism.bodies:
            if plane:
                self._body(joints.GROUND, body.name, "xyh", (0.0, 0.0))
            else:
                free = self.bodies[body.name] = ET.SubElement(world, "body", {"name": body.name})
                ET.SubElement(free, "inertial", INERTIA)
                ET.SubElement(free, "freejoint", {"name": body.name})
        for element in joints.elements_of(scene.mechanism.constraints):
            name = element.name if not element.row else f"{element.name} {element.kind}"
            adding(ADD, element)(self, name, element)
        self.root.extend(part for part in (self.tendons, self.equalities) if len(part))
        dimension = scene.mechanism.kind.dimension
        estimates = [body.estimate or scene.mechanism.kind.still for body in scene.mechanism.bodies]
        places = [x / (self.unit if k < dimension else 1.0) for q in estimates for k, x in enumerate(q)]
        key = ET.SubElement(self.root, "keyframe")
        # Carriages are children of bodies, so their coordinates stand among those of bodies: by name, not by place.
        own = [(body.name, axis) for body in scene.mechanism.bodies for axis in scene.mechanism.kind.coordinates]
        known = {f"{body}.{axis}": x for (body, axis), x in zip(own, places, strict=True)}
        order = [name for joint in world.iter() for name in self._coordinates_of(joint)]
        ET.SubElement(key, "key", {"name": "start", "qpos": " ".join(repr(known.get(name, 0.0)) for name in order)})

    def _body(self, parent: str, name: str, freedoms: str, at: joints.Pair, turned: float = 0.0) -> None:
        where = {"name": name, "pos": self.place(at), "euler": _numbers(0, 0, turned)}
        body = self.bodies[name] = ET.SubElement(self.bodies[parent], "body", where)
        ET.SubElement(body, "inertial", INERTIA)
        for key, suffix, axis in (("x", "x", "1 0 0"), ("y", "y", "0 1 0"), ("h", "phi", "0 0 1")):
            if key in freedoms:
                kind = "hinge" if key == "h" else "slide"
                ET.SubElement(body, "joint", {"name": f"{name}.{suffix}", "type": kind, "axis": axis})

    def _coordinates_of(self, joint: ET.Element) -> Sequence[str]:
        """Return the names of a joint's entries in qpos."""
        if joint.tag == "freejoint":
            return [f"{joint.get('name')}.{axis}" for axis in joints.SPACE.coordinates]
        return [joint.get("name", "")] if joint.tag == "joint" else []

    def place(self, point: Sequence[float]) -> str:
        return _numbers(*(x / self.unit for x in (*point, 0.0)[:3]))

    def welded(self, name: str, e: Any, slides: str, hinges: str, columns: str = "fgh", law: Any = None) -> None:
        """Add a carriage in the frame of the element on body i that slides and turns, and weld it to that on body j.

        Parameters
        ----------
        slides, hinges : str
            Along and about which axes of the frame, "x", "y", "z", one after the other; z is the element's axis.
        columns : str
            Which axes of the element's frame on body j are x, y and z of the site there.
        law : float, optional
            The angle of the first hinge.
        """
        carriage = self.moving(e, slides, hinges)
        on_j = parameters(joint_frame(e.axis_j, getattr(e, "zero_j", None))[:, ["fgh".index(c) for c in columns]])
        at = {"name": f"{name} j", "pos": self.place(getattr(e, "point_j", ORIGIN)), "quat": _numbers(*on_j)}
        ET.SubElement(self.bodies[e.body_j], "site", at)
        ET.SubElement(self.bodies[carriage], "site", {"name": f"{name} i"})
        ET.SubElement(self.equalities, "weld", {"name": f"{name} weld", "site1": f"{name} j", "site2": f"{name} i"})
        if law is not None:
            self.couple(name, f"{carriage}.hinge {hinges[0]}", law)

    def carriage(self, e: Any, freedoms: str, at: joints.Pair) -> str:
        """Add a body that slides on body i along the element's axis, and across it if "xy", and return its name."""
        self.carriages += 1
        name = f"carriage {self.carriages}"
        self._body(e.body_i, name, freedoms, at, math.atan2(e.axis_i[1], e.axis_i[0]))
        return name

    def tied(self, name: str, e: Any, carriage: str) -> None:
        """Tie point j of the element to the origin of a carriage."""
        self.connect(name, self.site(f"{name} i", carriage, ORIGIN), self.site(f"{name} j", e.body_j, e.point_j))

    def moving(self, e: Any, slides: str, hinges: str = "") -> str:
        """Add a carriage in the frame of the element on body i and return its name."""
        self.carriages += 1
        name = f"carriage {self.carriages}"
        frame = parameters(joint_frame(e.axis_i, getattr(e, "zero_i", None)))
        where = {"name": name, "pos": self.place(getattr(e, "point_i", ORIGIN)), "quat": _numbers(*frame)}
        body = self.bodies[name] = ET.SubElement(self.bodies[e.body_i], "body", where)
        ET.SubElement(body, "inertial", INERTIA)
        for kind, axis in (*(("slide", axis) for axis in slides), *(("hinge", axis) for axis in hinges)):
            ET.SubElement(body, "joint", {"name": f"{name}.{kind} {axis}", "type": kind, "axis": AXES[axis]})
        return name

    def site(self, name: str, body: str, point: Sequence[float]) -> str:
        ET.SubElement(self.bodies[body], "site", {"name": name, "pos": self.place(point)})
        return name

    def sites(self, name: str, e: Any) -> tuple[str, str]:
        """Add the sites at an element's points, i first."""
        return self.site(f"{name} i", e.body_i, e.point_i), self.site(f"{name} j", e.body_j, e.point_j)

    def connect(self, name: str, i: str, j: str) -> None:
        ET.SubElement(self.equalities, "connect", {"name": name, "site1": j, "site2": i})

    def couple(self, name: str, first: str, *polynomial: float, second: str = "") -> None:
        """Hold joint `first` at a polynomial of joint `second`, or at a number."""
        more = {"joint2": second} if second else {}
        coefficients = _numbers(*polynomial, *(0.0,) * (5 - len(polynomial)))
        ET.SubElement(self.equalities, "joint", {"name": name, "joint1": first, **more, "polycoef": coefficients})

    def hold(self, name: str, tendon: str, length: float) -> None:
        """Hold a tendon at a length above the one it has in qpos = 0."""
        row = {"name": name, "tendon1": tendon, "polycoef": _numbers(length, 0, 0, 0, 0)}
        ET.SubElement(self.equalities, "tendon", row)

    def said(self, e: joints.Element, unit: float = 1.0, shift: float = 0.0) -> float:
        """Note in the file what a law prescribes, f / unit - shift, and return that at the first time."""
        (law,) = e.laws
        whole = formula(law) if unit == 1.0 else f"({formula(law)}) / {unit!r}"
        self.equalities.append(ET.Comment(f" {e.name}: data[0] = {whole}{f' - {shift!r}' if shift else ''} "))
        return float(law(self.t)) / unit - shift


def _coincide(m: _Model, name: str, e: joints.PointsCoincide) -> None:
    if e.laws:
        raise CannotRun(f"{name}: MJCF has no points kept apart by laws")
    m.connect(name, *m.sites(name, e))


def _guided(m: _Model, name: str, e: joints.GuidedPoint) -> None:
    m.tied(name, e, m.carriage(e, "x", through_its_point(e).point_i))


def _distance(m: _Model, name: str, e: joints.PointDistance) -> None:
    tendon = ET.SubElement(m.tendons, "spatial", {"name": f"{name} length"})
    for site in m.sites(name, e):
        ET.SubElement(tendon, "site", {"site": site})
    at_rest = math.dist(e.point_i, e.point_j) / m.unit
    m.hold(name, f"{name} length", m.said(e, m.unit, at_rest) if e.laws else e.length / m.unit - at_rest)


def _coordinate(m: _Model, name: str, e: joints.PointCoordinate) -> None:
    if e.point_j != (0.0, 0.0):
        raise CannotRun(f"{name}: MJCF drives coordinates of a body's origin alone")
    m.couple(name, f"{e.body_j}.{'xy'[e.axis]}", m.said(e, m.unit))


def _angle(m: _Model, name: str, e: joints.RelativeAngle) -> None:
    value = m.said(e) if e.laws else e.angle
    if joints.GROUND in e.bodies:
        turned, sign = (e.body_j, 1.0) if e.body_i == joints.GROUND else (e.body_i, -1.0)
        m.couple(name, f"{turned}.phi", sign * value)
    else:
        m.couple(name, f"{e.body_j}.phi", value, 1.0, second=f"{e.body_i}.phi")


def _wheels(m: _Model, name: str, e: joints.RollingWheels) -> None:
    if e.carrier != joints.GROUND:
        raise CannotRun(f"{name}: no model for wheels on a carrier")
    ratio = -e.radius_i / e.radius_j
    m.couple(name, f"{e.body_j}.phi", e.zero_j - ratio * e.zero_i, ratio, second=f"{e.body_i}.phi")


def _rack(m: _Model, name: str, e: joints.RollingOnLine) -> None:
    carriage = m.carriage(e, "xy", e.point_i)
    m.tied(f"{name} centre", e, carriage)
    radius = e.radius / m.unit
    weights = {f"{carriage}.x": 1.0, f"{e.body_j}.phi": -radius}
    weights |= {} if e.body_i == joints.GROUND else {f"{e.body_i}.phi": radius}
    arc = ET.SubElement(m.tendons, "fixed", {"name": f"{name} arc"})
    for joint, weight in weights.items():
        ET.SubElement(arc, "joint", {"joint": joint, "coef": repr(float(weight))})
    m.hold(name, f"{name} arc", e.s0 / m.unit - radius * e.phi0)


ADD: dict[type[joints.Element], Any] = {
    joints.PointsCoincide: _coincide,
    joints.GuidedPoint: _guided,
    joints.PointDistance: _distance,
    joints.PointCoordinate: _coordinate,
    joints.RelativeAngle: _angle,
    joints.RollingWheels: _wheels,
    joints.RollingOnLine: _rack,
    joints.PointsMeet: _coincide,
    joints.SpatialPointDistance: _distance,
    joints.AxesParallel: lambda m, name, e: m.welded(name, e, "xyz", "z"),
    joints.AxesPerpendicular: lambda m, name, e: m.welded(name, e, "xyz", "zx", columns="hfg"),
    joints.TurnAboutAxis: lambda m, name, e: m.welded(name, e, "xyz", "zxy", law=m.said(e) if e.laws else e.angle),
    joints.PointOnAxis: lambda m, name, e: m.tied(name, e, m.moving(e, "z")),
    joints.PointInPlane: lambda m, name, e: m.tied(name, e, m.moving(e, "xy")),
}


def _numbers(*values: float) -> str:
    return " ".join(repr(float(x)) for x in values)
