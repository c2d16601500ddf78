"""exudyn: SolveStatic, led on by half a turn, reports success with the crank where it was.

A crank turns on a revolute joint; a generic joint whose frame is turned by the wanted angle at each step prescribes it.
The residual of a rotation about a joint axis is a scalar product of two axes, which is as small half a turn away.

Class: documented limit. Documentation: "relative tolerance of residual for Newton (general goal of Newton is to
decrease the residual by this factor)" (exudyn 1.13, NewtonSettings.relativeTolerance). Since: 1.13.6; no other
version was run.
"""

import math
import sys

import exudyn as exu
from exudyn.itemInterface import (
    MarkerBodyRigid,
    NodeRigidBodyEP,
    ObjectGround,
    ObjectJointGeneric,
    ObjectJointRevoluteZ,
    ObjectRigidBody,
)

exu.config.printToConsole = False


def about_z(angle):
    c, s = math.cos(angle), math.sin(angle)
    return [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]


def crank():
    """A body by Euler parameters on a revolute joint, and the frame on the ground that a generic joint holds it by."""
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    ground = mbs.AddObject(ObjectGround())
    node = mbs.AddNode(NodeRigidBodyEP(referenceCoordinates=[0, 0, 0, 1, 0, 0, 0]))
    body = mbs.AddObject(ObjectRigidBody(nodeNumber=node, mass=0, inertia=[0] * 6))
    at = lambda number: mbs.AddMarker(MarkerBodyRigid(bodyNumber=number, localHT=exu.HT()))
    mbs.AddObject(ObjectJointRevoluteZ(markerNumbers=[at(ground), at(body)]))
    frame = at(ground)
    mbs.AddObject(ObjectJointGeneric(markerNumbers=[at(body), frame], constrainedAxes=[0, 0, 0, 0, 0, 1]))
    mbs.Assemble()
    return system, mbs, frame, node


def solve(mbs, frame, node, angle):
    """Return (success, angle of the crank) of SolveStatic with its default tolerances; it starts at its last answer."""
    mbs.SetMarkerParameter(frame, "localHT", exu.HT(rotation=about_z(angle)))
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    try:
        success = mbs.SolveStatic(settings, updateInitialValues=True)
    except exu.SolverError:
        return False, None
    turned = mbs.GetNodeOutput(node, exu.OutputVariableType.RotationMatrix)
    return success, math.atan2(turned[3], turned[0])


def main():
    print(f"exudyn {exu.__version__}")
    _, mbs, frame, node = crank()
    shown = False
    for wanted in (0.0, 1.0, 1.0 + math.pi):
        success, angle = solve(mbs, frame, node, wanted)
        print(f"wanted {wanted:.6f} rad: " + (f"success, {angle % (2 * math.pi):.6f} rad" if success else "no success"))
        shown |= success and math.cos(angle - wanted) < 0.0
    print("expected: the angles that were wanted, or a failure")
    print("came:     an angle off by half a turn, with success" if shown else "came:     what was expected")
    return 0 if shown else 1


if __name__ == "__main__":
    sys.exit(main())
