"""exudyn: at a limit position SolveStatic reports success with an angle of 6e12 rad and a joint open by 3 m.

Ground 4, crank 1, coupler 2, rocker 1 at crank angle 0: coupler and rocker are stretched, both angles are 0. The
Jacobian is singular there. From one start the residual falls below its tolerance while the angle is off by the root of
that. From another the first iteration goes 1e13 rad astray; with `adaptInitialResidual`, which is on by default, the
residual there becomes the one that the tolerance is relative to, and 1e-8 of it are metres. With it off: SolverError.

Class: documented limit. Documentation: "True: if initialResidual is very small (or zero), it may increase
significantely in the first Newton iteration; to achieve relativeTolerance, the initialResidual will by updated by a
higher residual within the first Newton iteration" (exudyn 1.13, NewtonSettings.adaptInitialResidual). Since: 1.13.6;
no other version was run.
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
STARTS = {
    "0.1 m and 0.3 rad beside it": [(0.5, 0.0, 0.1), (2.0, 0.1, 0.2), (3.5, 0.1, math.pi + 0.3)],
    "0.05 rad beside it": [(0.5, 0.0, 0.0), (2.0, 0.0, 0.05), (3.5, 0.0, math.pi + 0.05)],
}


def apart(q):
    """Return how far the ends of coupler and rocker are apart that a joint holds together [m]."""
    (x, y, phi), (u, v, psi) = q[3:6], q[6:9]
    ends = [(x + coupler / 2 * math.cos(phi), u + rocker / 2 * math.cos(psi))]
    ends += [(y + coupler / 2 * math.sin(phi), v + rocker / 2 * math.sin(psi))]
    return max(abs(a - b) for a, b in ends)


def main():
    print(f"exudyn {exu.__version__}")
    print("expected: coupler angle 0 to 2e-7 rad, what float64 can tell there, or a failure")
    shown = []
    for where, start in STARTS.items():
        _, mbs, driver = four_bar(*LENGTHS, start)
        success, q = solve(mbs, driver, 0.0)
        outcome = f"success, coupler angle {q[5]:.3g} rad, joint open by {apart(q):.1e} m" if success else "a failure"
        print(f"started {where}, came: {outcome}")
        shown.append(success and abs(q[5]) > 1e-6)
    return 0 if all(shown) else 1


if __name__ == "__main__":
    sys.exit(main())
