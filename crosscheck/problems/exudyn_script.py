"""A problem as a script for exudyn: its bodies, joints and drivers, positions by its own static solver.

The script needs exudyn alone, and prints an answer that the grader reads. It is written from the elements of joints.
"""

from __future__ import annotations

import math
from typing import Any

from crosscheck.engines.spatial.turning import joint_frame
from crosscheck.errors import CannotRun
from crosscheck.problems import formula
from refkin import joints
from refkin.model import Scene

HEAD = '''"""{title}: positions by exudyn's static solver. Prints an answer for grade.py."""

import json
from math import cos, sin

import exudyn as exu
from exudyn.itemInterface import *

exu.config.printToConsole = False  # standard output is the answer's
exu.config.suppressWarnings = True
system = exu.SystemContainer()
mbs = system.AddSystem()
t = now = {t!r}
ground = mbs.AddObject(ObjectGround())
still = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0))
nodes, bodies = {{}}, {{"ground": ground}}
{bodies}

def point(body, x, y):
    return mbs.AddMarker(MarkerBodyPosition(bodyNumber=bodies[body], localPosition=[x, y, 0]))


def frame(body, x, y):
    return mbs.AddMarker(MarkerBodyRigid(bodyNumber=bodies[body], localPosition=[x, y, 0]))


def angle(body):
    return mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=nodes[body], coordinate=2)) if body in nodes else still


def along(body_i, p, axis, body_j, q):
    return mbs.AddMarker(
        MarkerBodiesRelativeTranslationCoordinate(
            bodyNumbers=[bodies[body_i], bodies[body_j]],
            localPosition0=[*p, 0],
            localPosition1=[*q, 0],
            axis0=[*axis, 0],
        )
    )


def driven(markers, law):
    value = lambda mbs, time, number, offset: law(now)
    mbs.AddObject(CoordinateConstraint(markerNumbers=markers, offsetUserFunction=value))


cylinders, turned = [], []
'''
BODIES = """for name, estimate in {estimates}:
    nodes[name] = mbs.AddNode(NodeRigidBody2D(initialCoordinates=estimate))
    bodies[name] = mbs.AddObject(ObjectRigidBody2D(nodeNumber=nodes[name], physicsMass=0, physicsInertia=0))
"""
SPATIAL_BODIES = '''still_at = [0, 0, 0, 1, 0, 0, 0]
for name, estimate in {estimates}:  # x, y, z, Euler parameters: exudyn's coordinates are what is beyond its reference
    beyond = [x - at for x, at in zip(estimate, still_at)]
    nodes[name] = mbs.AddNode(NodeRigidBodyEP(referenceCoordinates=still_at, initialCoordinates=beyond))
    bodies[name] = mbs.AddObject(ObjectRigidBody(nodeNumber=nodes[name], physicsMass=0, physicsInertia=[0] * 6))


def place(body, x, y, z):
    return mbs.AddMarker(MarkerBodyRigid(bodyNumber=bodies[body], localPosition=[x, y, z]))


def hold(i, j, axes, frame_i, frame_j):
    """Hold translations along and rotations about axes of the frame on i; columns of frames are their axes."""
    markers = {{"markerNumbers": [i, j], "rotationMarker0": frame_i, "rotationMarker1": frame_j}}
    return mbs.AddObject(ObjectJointGeneric(**markers, constrainedAxes=axes))


def about_z(frame, angle):
    """Turn the frame's first two columns about the third."""
    c, s = cos(angle), sin(angle)
    return [[f * c + g * s, g * c - f * s, h] for f, g, h in frame]

'''
TAIL = """
mbs.Assemble()
settings = exu.SimulationSettings()
settings.solution.file.write = False
settings.staticSolver.newton.relativeTolerance = 0
settings.staticSolver.newton.absoluteTolerance = {tolerance!r}
{redundant}poses = []
for now in {times}:
    for rod, law in cylinders:
        mbs.SetObjectParameter(rod, "distance", law(now))
    for joint, frame, law in turned:
        mbs.SetObjectParameter(joint, "rotationMarker0", about_z(frame, law(now)))
    try:
        mbs.SolveStatic(settings, updateInitialValues=True)
    except Exception:
        break
    beyond = [mbs.GetNodeOutput(n, exu.OutputVariableType.Coordinates).tolist() for n in nodes.values()]
    poses.append([[x + at for x, at in zip(q, {still})] for q in beyond])
rows = poses + [[[None] * {width}] * len(nodes)] * ({count} - len(poses))
answer = {{name: {{"q": [row[k] for row in rows]}} for k, name in enumerate(nodes)}}
print(json.dumps({{"problems": {{{name!r}: {{"bodies": answer}}}}}}))
"""
SLACK = 1e-12
"""Norm of the residual at which Newton's method stops, relative to the size of the mechanism."""


def to_exudyn(scene: Scene, title: str) -> str:
    """Return the text of the script."""
    mechanism, kind = scene.mechanism, scene.mechanism.kind
    estimates = [(body.name, list(body.estimate or kind.still)) for body in mechanism.bodies]
    lines = [
        line for e in joints.elements_of(mechanism.constraints) for line in (f"# {e.name}: {e.kind}", ADD[type(e)](e))
    ]
    surplus = sum(c.rows for c in mechanism.constraints) > kind.freedoms * len(mechanism.bodies)
    bodies = (BODIES if kind is joints.PLANE else SPATIAL_BODIES).format(estimates=estimates)
    head = HEAD.format(title=f"{scene.name}: {title}", t=scene.times[0], bodies=bodies)
    tail = TAIL.format(
        tolerance=SLACK * mechanism.size(),
        redundant=REDUNDANT if surplus else "",
        times=list(scene.times),
        count=len(scene.times),
        width=kind.width,
        still=[int(x) for x in kind.still],
        name=scene.name,
    )
    return head + "\n".join(lines) + "\n" + tail


REDUNDANT = """settings.linearSolver.solverType = exu.LinearSolverType.EigenDense
settings.linearSolver.ignoreSingularJacobian = True
"""


def _coincide(e: joints.PointsCoincide) -> str:
    if e.laws:
        raise CannotRun(f"{e.name}: no script for points kept apart by laws")
    return f"mbs.AddObject(RevoluteJoint2D(markerNumbers=[{_point(e, 'i')}, {_point(e, 'j')}]))"


def _guided(e: joints.GuidedPoint) -> str:
    x, y = _direction(e.axis_i)
    line = (e.body_i, e.point_i[0] - y * e.offset, e.point_i[1] + x * e.offset)
    markers = f"frame{(e.body_j, *e.point_j)!r}, frame{line!r}"
    normal = f"axisMarker0=[1, 0, 0], normalMarker1={[-y, x, 0.0]}, constrainRotation=False"
    return f"mbs.AddObject(PrismaticJoint2D(markerNumbers=[{markers}], {normal}))"


def _distance(e: joints.PointDistance | joints.SpatialPointDistance) -> str:
    marker = _point if isinstance(e, joints.PointDistance) else _place
    distance = f"({_law(e)})(now)" if e.laws else repr(e.length)
    rod = f"mbs.AddObject(DistanceConstraint(markerNumbers=[{marker(e, 'i')}, {marker(e, 'j')}], distance={distance}))"
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
    factor = -e.radius_j / e.radius_i  # the row: factor phi_j - phi_i - offset
    markers = f"[angle({e.body_i!r}), angle({e.body_j!r})]"
    offset = factor * e.zero_j - e.zero_i
    return f"mbs.AddObject(CoordinateConstraint(markerNumbers={markers}, factorValue1={factor!r}, offset={offset!r}))"


def _rack(e: joints.RollingOnLine) -> str:
    if e.body_i != joints.GROUND:
        raise CannotRun(f"{e.name}: no script for a rack that moves")
    axis = list(_direction(e.axis_i))
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
    """Return a marker on a body of space, at the element's point or, where it has none, at the origin."""
    return f"place{(getattr(e, f'body_{side}'), *getattr(e, f'point_{side}', (0.0, 0.0, 0.0)))!r}"


def _frame(e: Any, side: str, columns: str) -> str:
    """Return the matrix of an element's frame on a body; the unit matrix where it has no axis there."""
    axis = getattr(e, f"axis_{side}", None)
    if axis is None:
        return "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]"
    own = joint_frame(axis, getattr(e, f"zero_{side}", None))
    return str(own[:, ["fgh".index(column) for column in columns]].tolist())


def _point(e: Any, side: str) -> str:
    return f"point{(getattr(e, f'body_{side}'), *getattr(e, f'point_{side}'))!r}"


def _law(e: joints.Element) -> str:
    return f"lambda t: {formula(e.laws[0])}"


def _direction(axis: joints.Pair) -> joints.Pair:
    length = math.hypot(*axis)
    return axis[0] / length, axis[1] / length
