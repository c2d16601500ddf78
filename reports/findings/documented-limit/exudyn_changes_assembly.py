"""exudyn: SolveStatic, led in steps of 1 rad, goes over to the mirror assembly and reports success.

A crank-rocker with ground 4, crank 1, coupler 3.99, rocker 1.02 has two assemblies at every crank angle. On each of
them the sign of the cross product of coupler and rocker stays what it is.

Class: documented limit. Documentation: "relative tolerance of residual for Newton (general goal of Newton is to
decrease the residual by this factor)" (exudyn 1.13, NewtonSettings.relativeTolerance). Since: 1.13.6; no other
version was run.
"""

import math
import sys

import exudyn as exu
from exudyn.itemInterface import (
    CoordinateConstraint,
    MarkerBodyPosition,
    MarkerNodeCoordinate,
    NodePointGround,
    NodeRigidBody2D,
    ObjectGround,
    ObjectRigidBody2D,
    RevoluteJoint2D,
)  # fmt: skip

exu.config.printToConsole = False


def four_bar(ground, crank, coupler, rocker, start, at=(0.0, 0.0)):
    """Bodies with their frames in the middle of the links, pinned to each other; the crank's angle is prescribed."""
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    base = mbs.AddObject(ObjectGround())
    pin = lambda body, x, y=0.0: mbs.AddMarker(MarkerBodyPosition(bodyNumber=body, localPosition=[x, y, 0]))
    bodies, nodes = [], []
    for q in start:
        nodes.append(mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[0, 0, 0], initialCoordinates=list(q))))
        bodies.append(mbs.AddObject(ObjectRigidBody2D(nodeNumber=nodes[-1], mass=0, inertia=0)))
    a, b, c = bodies
    for ends in (
        (pin(base, *at), pin(a, -crank / 2)),
        (pin(a, crank / 2), pin(b, -coupler / 2)),
        (pin(b, coupler / 2), pin(c, rocker / 2)),
        (pin(base, at[0] + ground, at[1]), pin(c, -rocker / 2)),
    ):
        mbs.AddObject(RevoluteJoint2D(markerNumbers=list(ends)))
    fixed = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0))
    angle = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=2))
    driver = mbs.AddObject(CoordinateConstraint(markerNumbers=[fixed, angle], offset=0))
    mbs.Assemble()
    return system, mbs, driver


def solve(mbs, driver, angle):
    """Return (success, coordinates) of SolveStatic with its default tolerances; it starts at its last answer."""
    mbs.SetObjectParameter(driver, "offset", angle)
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    try:
        success = mbs.SolveStatic(settings, updateInitialValues=True)
    except exu.SolverError:
        return False, None
    return success, mbs.systemData.GetODE2Coordinates()


LENGTHS = ground, crank, coupler, rocker = 4.0, 1.0, 3.99, 1.02
START = [(-0.4, -0.3, -2.5), (1.13, 0.17, 0.39), (3.48, 0.45, 2.08)]


def side(q):
    """Return the sine of the angle from coupler to rocker; a motion without a jump keeps its sign."""
    return math.sin(q[8] - q[5])


def main():
    print(f"exudyn {exu.__version__}")
    _, mbs, driver = four_bar(*LENGTHS, START)
    sides = []
    for k in range(6):
        success, q = solve(mbs, driver, -2.5 + k)
        outcome = f"success, sine of coupler to rocker {side(q):+.6f}" if success else "no success"
        print(f"crank {-2.5 + k:5.2f} rad: {outcome}")
        sides += [side(q)] if success else []
    shown = min(sides) < 0 < max(sides)
    print("expected: one sign throughout, or a failure")
    print("came:     both signs, with success" if shown else "came:     what was expected")
    return 0 if shown else 1


if __name__ == "__main__":
    sys.exit(main())
