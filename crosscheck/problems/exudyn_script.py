"""A problem as a script for exudyn: its bodies, joints and drivers, positions by its own static solver.

The script needs exudyn alone, and prints an answer that the grader reads. It is written from the elements of joints.
"""

from __future__ import annotations

import math
from typing import Any

from crosscheck.errors import CannotRun
from crosscheck.problems.laws import formula
from refkin.joints import (
    GROUND,
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
from refkin.model import Scene

HEAD = '''"""{title}: positions by exudyn's static solver. Prints an answer for grade.py."""

import json
from math import cos, sin

import exudyn as exu
from exudyn.itemInterface import *

system = exu.SystemContainer()
mbs = system.AddSystem()
t = now = {t!r}
ground = mbs.AddObject(ObjectGround())
still = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0))
nodes, bodies = {{}}, {{"ground": ground}}
for name, estimate in {estimates}:
    nodes[name] = mbs.AddNode(NodeRigidBody2D(initialCoordinates=estimate))
    bodies[name] = mbs.AddObject(ObjectRigidBody2D(nodeNumber=nodes[name], physicsMass=0, physicsInertia=0))


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


cylinders = []
'''
TAIL = """
mbs.Assemble()
settings = exu.SimulationSettings()
settings.solutionSettings.writeSolutionToFile = False
settings.staticSolver.newton.relativeTolerance = 0
settings.staticSolver.newton.absoluteTolerance = {tolerance!r}
{redundant}poses = []
for now in {times}:
    for rod, law in cylinders:
        mbs.SetObjectParameter(rod, "distance", law(now))
    try:
        mbs.SolveStatic(settings, updateInitialValues=True)
        poses.append([mbs.GetNodeOutput(n, exu.OutputVariableType.Coordinates).tolist() for n in nodes.values()])
    except Exception:
        break
rows = poses + [[[None] * 3] * len(nodes)] * ({count} - len(poses))
answer = {{name: {{"q": [row[k] for row in rows]}} for k, name in enumerate(nodes)}}
print(json.dumps({{"problems": {{{name!r}: {{"bodies": answer}}}}}}))
"""
SLACK = 1e-12
"""Norm of the residual at which Newton's method stops, relative to the size of the mechanism."""


def to_exudyn(scene: Scene, title: str) -> str:
    """Return the text of the script."""
    mechanism = scene.mechanism
    estimates = [(body.name, list(body.estimate or (0.0, 0.0, 0.0))) for body in mechanism.bodies]
    lines = [line for e in elements_of(mechanism.constraints) for line in (f"# {e.name}: {e.kind}", ADD[type(e)](e))]
    surplus = sum(c.rows for c in mechanism.constraints) > 3 * len(mechanism.bodies)
    head = HEAD.format(title=f"{scene.name}: {title}", t=scene.times[0], estimates=estimates)
    tail = TAIL.format(
        tolerance=SLACK * mechanism.size(),
        redundant=REDUNDANT if surplus else "",
        times=list(scene.times),
        count=len(scene.times),
        name=scene.name,
    )
    return head + "\n".join(lines) + "\n" + tail


REDUNDANT = """settings.linearSolverType = exu.LinearSolverType.EigenDense
settings.linearSolverSettings.ignoreSingularJacobian = True
"""


def _coincide(e: PointsCoincide) -> str:
    if e.laws:
        raise CannotRun(f"{e.name}: no script for points kept apart by laws")
    return f"mbs.AddObject(RevoluteJoint2D(markerNumbers=[{_point(e, 'i')}, {_point(e, 'j')}]))"


def _guided(e: GuidedPoint) -> str:
    x, y = _direction(e.axis_i)
    line = (e.body_i, e.point_i[0] - y * e.offset, e.point_i[1] + x * e.offset)
    markers = f"frame{(e.body_j, *e.point_j)!r}, frame{line!r}"
    normal = f"axisMarker0=[1, 0, 0], normalMarker1={[-y, x, 0.0]}, constrainRotation=False"
    return f"mbs.AddObject(PrismaticJoint2D(markerNumbers=[{markers}], {normal}))"


def _distance(e: PointDistance) -> str:
    length = f"({_law(e)})({{now}})" if e.laws else repr(e.length)
    distance = length.replace("{now}", "now")
    rod = f"mbs.AddObject(DistanceConstraint(markerNumbers=[{_point(e, 'i')}, {_point(e, 'j')}], distance={distance}))"
    return f"cylinders.append(({rod}, {_law(e)}))" if e.laws else rod


def _coordinate(e: PointCoordinate) -> str:
    axis = [1.0 - e.axis, float(e.axis)]
    return f"driven([still, along('ground', [0, 0], {axis}, {e.body_j!r}, {list(e.point_j)})], {_law(e)})"


def _angle(e: RelativeAngle) -> str:
    markers = f"[angle({e.body_i!r}), angle({e.body_j!r})]"
    if e.laws:
        return f"driven({markers}, {_law(e)})"
    return f"mbs.AddObject(CoordinateConstraint(markerNumbers={markers}, offset={e.angle!r}))"


def _wheels(e: RollingWheels) -> str:
    factor = -e.radius_j / e.radius_i  # the row: factor phi_j - phi_i - offset
    markers = f"[angle({e.body_i!r}), angle({e.body_j!r})]"
    offset = factor * e.zero_j - e.zero_i
    return f"mbs.AddObject(CoordinateConstraint(markerNumbers={markers}, factorValue1={factor!r}, offset={offset!r}))"


def _rack(e: RollingOnLine) -> str:
    if e.body_i != GROUND:
        raise CannotRun(f"{e.name}: no script for a rack that moves")
    axis = list(_direction(e.axis_i))
    travel = f"along('ground', {list(e.point_i)}, {axis}, {e.body_j!r}, {list(e.point_j)})"
    numbers = f"factorValue1={e.radius!r}, offset={e.radius * e.phi0 - e.s0!r}"  # R phi_j - s = R phi0 - s0
    return f"mbs.AddObject(CoordinateConstraint(markerNumbers=[{travel}, angle({e.body_j!r})], {numbers}))"


ADD: dict[type[Element], Any] = {
    PointsCoincide: _coincide,
    GuidedPoint: _guided,
    PointDistance: _distance,
    PointCoordinate: _coordinate,
    RelativeAngle: _angle,
    RollingWheels: _wheels,
    RollingOnLine: _rack,
}


def _point(e: Any, side: str) -> str:
    return f"point{(getattr(e, f'body_{side}'), *getattr(e, f'point_{side}'))!r}"


def _law(e: Element) -> str:
    return f"lambda t: {formula(e.laws[0])}"


def _direction(axis: Pair) -> Pair:
    length = math.hypot(*axis)
    return axis[0] / length, axis[1] / length
