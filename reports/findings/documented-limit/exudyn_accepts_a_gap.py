"""exudyn: SolveStatic reports success for a linkage that cannot be put together.

Ground 4, crank 1, coupler 2 - 1e-12, rocker 1 at crank angle 0: the pins to be joined are 3 m apart, the two links
reach 3 m - 1e-12 m. From a start further off the tolerance is relative to its residual, and larger gaps pass.

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


GAPS = (1e-12, 1e-10, 1e-9, 1e-8)
START = [(0.5, 0.0, 0.0), (2.0, 0.05, 0.3), (3.5, 0.05, math.pi + 0.3)]


def main():
    print(f"exudyn {exu.__version__}")
    accepted = []
    for gap in GAPS:
        _, mbs, driver = four_bar(4.0, 1.0, 2.0 - gap, 1.0, START)
        success, _ = solve(mbs, driver, 0.0)
        print(f"{gap:g} m are missing: expected a failure, came {'success' if success else 'a failure'}")
        accepted += [gap] if success else []
    return 0 if accepted else 1


if __name__ == "__main__":
    sys.exit(main())
