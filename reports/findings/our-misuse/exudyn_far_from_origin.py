"""exudyn: a linkage of 4 m that stands 4e8 m from the origin, modelled there: success, with angles off by 1e-8 rad.

The same linkage at the origin is the truth: angles do not depend on where it stands.

Class: our misuse. Documentation: "absolute tolerance of residual for Newton (needed e.g. if residual is fulfilled
right at beginning); condition: sqrt(q*q)/numberOfCoordinates <= absoluteTolerance" (exudyn 1.13,
NewtonSettings.absoluteTolerance). Since: 1.13.6; no other version was run.
"""

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


LENGTHS = 4.0, 1.0, 3.5, 3.0
FAR = 4.0e8


def start(at):
    poses = [(0.44, 0.24, 0.5), (2.43, 1.33, 0.53), (4.1, 1.4, 1.9)]
    return [(x + at[0], y + at[1], phi) for x, y, phi in poses]


def main():
    print(f"exudyn {exu.__version__}")
    angles = []
    for at in ((0.0, 0.0), (FAR, -FAR)):
        _, mbs, driver = four_bar(*LENGTHS, start(at), at)
        success, q = solve(mbs, driver, 0.5)
        if not success:
            print(f"at {at}: refused")
            return 1
        angles.append(q[5])
    off = abs(angles[1] - angles[0])
    print("expected: one coupler angle, to round-off, or a failure")
    print(f"came:     success twice, angles {off:.1e} rad apart")
    return 0 if off > 1e-9 else 1


if __name__ == "__main__":
    sys.exit(main())
