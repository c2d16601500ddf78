"""exudyn 1.13: at a limit position SolveStatic reports success with a pose that may be anywhere: an angle of 6e12 rad.

Ground 4, crank 1, coupler 2, rocker 1 at crank angle 0: coupler and rocker are stretched, both angles are 0. The
residual grows with the square of the angle's error there: a residual of 1e-8 hides 1e-4 rad. The Jacobian is singular
there, and from a start 0.05 rad beside the pose an angle of 6e12 rad comes back with success. A documented limit: what
is promised is a residual ("condition: sqrt(q*q)/numberOfCoordinates <= absoluteTolerance"), not a pose.
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


LENGTHS = ground, crank, coupler, rocker = 4.0, 1.0, 2.0, 1.0
START = [(0.5, 0.0, 0.0), (2.0, 0.0, 0.05), (3.5, 0.0, math.pi + 0.05)]


def main():
    _, mbs, driver = four_bar(*LENGTHS, START)
    success, q = solve(mbs, driver, 0.0)
    if not success:
        print("came: a failure, as expected")
        return 1
    off = abs(math.remainder(q[5], math.tau))
    shown = off > 1e-6
    print("expected: coupler angle 0 to 2e-7 rad, what float64 can tell there, or a failure")
    print(f"came:     success, coupler angle {q[5]:.6g} rad; without its full turns still off by {off:.1e} rad")
    return 0 if shown else 1


if __name__ == "__main__":
    sys.exit(main())
