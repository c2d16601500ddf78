"""A problem as a script for exudyn: its bodies, joints and drivers, positions by its own static solver.

The script needs exudyn alone, and prints an answer that the grader reads. `exudyn_model.py.j2` is its text; here is
what each element of the joints adds.
"""

from __future__ import annotations

from importlib.resources import files
from typing import Any

from jinja2 import StrictUndefined, Template

from crosscheck.engines.frames import direction, through_its_point
from crosscheck.engines.spatial.turning import joint_frame
from crosscheck.errors import CannotRun
from crosscheck.problems import adding, formula
from refkin import joints
from refkin.model import Scene

SLACK, ROUNDINGS = 1e-12, 2.0**-49
"""Norm of the residual at which Newton's method stops, relative to the size of the mechanism, or if that is more to the
largest coordinate: sixteen roundings of it, below which it may never come."""


def to_exudyn(scene: Scene, title: str) -> str:
    """Return the text of the script."""
    mechanism, kind = scene.mechanism, scene.mechanism.kind
    text = files("crosscheck.problems").joinpath("exudyn_model.py.j2").read_text(encoding="utf-8")
    template = Template(text, trim_blocks=True, keep_trailing_newline=True, undefined=StrictUndefined)
    script: str = template.render(
        title=f"{scene.name}: {title}",
        name=repr(scene.name),
        times=list(scene.times),
        dimension=kind.dimension,
        estimates=[(body.name, list(body.estimate or kind.still)) for body in mechanism.bodies],
        lines=[(e, adding(ADD, e)(e)) for e in joints.elements_of(mechanism.constraints)],
        tolerance=max(SLACK * mechanism.size(), ROUNDINGS * max(_coordinates(scene))),
        redundant=sum(c.rows for c in mechanism.constraints) > kind.freedoms * len(mechanism.bodies),
        still=[int(x) for x in kind.still],
    )
    return script


def _coordinates(scene: Scene) -> list[float]:
    """Return the sizes of all lengths that say where a body is, and 0."""
    estimates = (body.estimate or () for body in scene.mechanism.bodies)
    return [0.0, *(abs(x) for at in estimates for x in at[: scene.mechanism.kind.dimension])]


def _coincide(e: joints.PointsCoincide) -> str:
    if e.laws:
        raise CannotRun(f"{e.name}: no script for points kept apart by laws")
    return f"mbs.AddObject(RevoluteJoint2D(markerNumbers=[{_place(e, 'i')}, {_place(e, 'j')}]))"


def _guided(e: joints.GuidedPoint) -> str:
    x, y = direction(e.axis_i)
    markers = f"frame{(e.body_j, *e.point_j)!r}, frame{(e.body_i, *through_its_point(e).point_i)!r}"
    normal = f"axisMarker0=[1, 0, 0], normalMarker1={[-y, x, 0.0]}, constrainRotation=False"
    return f"mbs.AddObject(PrismaticJoint2D(markerNumbers=[{markers}], {normal}))"


def _distance(e: joints.PointDistance | joints.SpatialPointDistance) -> str:
    distance = f"({_law(e)})(now)" if e.laws else repr(e.length)
    rod = f"mbs.AddObject(DistanceConstraint(markerNumbers=[{_place(e, 'i')}, {_place(e, 'j')}], distance={distance}))"
    return f"cylinders.append(({rod}, {_law(e)}))" if e.laws else rod


def _coordinate(e: joints.PointCoordinate) -> str:
    axis = [1.0 - e.axis, float(e.axis)]
    return f"driven([still, along('ground', [0, 0], {axis}, {e.body_j!r}, {list(e.point_j)})], {_law(e)})"


def _angle(e: joints.RelativeAngle) -> str:
    markers = f"[angle({e.body_i!r}), angle({e.body_j!r})]"
    if e.laws:
        return f"driven({markers}, {_law(e)})"
    return f"mbs.AddObject(CoordinateConstraint(markerNumbers={markers}, offset={e.angle!r}))"


def _wheels(e: joints.RollingWheels) -> str:
    if e.carrier != joints.GROUND:
        raise CannotRun(f"{e.name}: no script for wheels on a carrier")
    factor = -e.radius_j / e.radius_i  # the row: factor phi_j - phi_i - offset
    markers = f"[angle({e.body_i!r}), angle({e.body_j!r})]"
    offset = factor * e.zero_j - e.zero_i
    return f"mbs.AddObject(CoordinateConstraint(markerNumbers={markers}, factorValue1={factor!r}, offset={offset!r}))"


def _rack(e: joints.RollingOnLine) -> str:
    if e.body_i != joints.GROUND:
        raise CannotRun(f"{e.name}: no script for a rack that moves")
    axis = list(direction(e.axis_i))
    travel = f"along('ground', {list(e.point_i)}, {axis}, {e.body_j!r}, {list(e.point_j)})"
    numbers = f"factorValue1={e.radius!r}, offset={e.radius * e.phi0 - e.s0!r}"  # R phi_j - s = R phi0 - s0
    return f"mbs.AddObject(CoordinateConstraint(markerNumbers=[{travel}, angle({e.body_j!r})], {numbers}))"


ADD: dict[type[joints.Element], Any] = {
    joints.PointsCoincide: _coincide,
    joints.GuidedPoint: _guided,
    joints.PointDistance: _distance,
    joints.PointCoordinate: _coordinate,
    joints.RelativeAngle: _angle,
    joints.RollingWheels: _wheels,
    joints.RollingOnLine: _rack,
    joints.PointsMeet: lambda e: (
        f"mbs.AddObject(ObjectJointSpherical(markerNumbers=[{_place(e, 'i')}, {_place(e, 'j')}]))"
    ),
    joints.SpatialPointDistance: _distance,
    joints.AxesParallel: lambda e: _held(e, [0, 0, 0, 1, 1, 0]),
    joints.AxesPerpendicular: lambda e: _held(e, [0, 0, 0, 0, 0, 1], "hfg", "ghf"),
    joints.TurnAboutAxis: lambda e: _turned(e),
    joints.PointOnAxis: lambda e: _held(e, [1, 1, 0, 0, 0, 0]),
    joints.PointInPlane: lambda e: _held(e, [0, 0, 1, 0, 0, 0]),
}


def _held(e: Any, axes: list[int], columns_i: str = "fgh", columns_j: str = "fgh") -> str:
    return f"hold({_place(e, 'i')}, {_place(e, 'j')}, {axes}, {_frame(e, 'i', columns_i)}, {_frame(e, 'j', columns_j)})"


def _turned(e: Any) -> str:
    if not e.laws:
        return _held(e, [0, 0, 0, 0, 0, 1])
    return f"turned.append(({_held(e, [0, 0, 0, 0, 0, 1])}, {_frame(e, 'i', 'fgh')}, {_law(e)}))"


def _place(e: Any, side: str) -> str:
    """Return a marker on a body at the element's point or, where it has none, at the origin of a body of space."""
    point = getattr(e, f"point_{side}", (0.0, 0.0, 0.0))
    return f"{'point' if len(point) == 2 else 'place'}{(getattr(e, f'body_{side}'), *point)!r}"


def _frame(e: Any, side: str, columns: str) -> str:
    """Return the matrix of an element's frame on a body; the unit matrix where it has no axis there."""
    axis = getattr(e, f"axis_{side}", None)
    if axis is None:
        return "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]"
    own = joint_frame(axis, getattr(e, f"zero_{side}", None))
    return str(own[:, ["fgh".index(column) for column in columns]].tolist())


def _law(e: joints.Element) -> str:
    return f"lambda t: {formula(e.laws[0])}"
