"""exudyn: SolveStatic, led on by nearly half a turn, reports success with the crank half a turn off.

A crank turns on a revolute joint; a generic joint whose frame is turned by the wanted angle at each step prescribes it.
The residual of a rotation about a joint axis is a scalar product of two axes, which is as small half a turn away. A
coordinate constraint on the relative rotation of the two bodies, which counts turns and may be about any axis, has the
angle itself for a residual, and comes to it over less than half a turn; over exactly half a turn it says no success.

Class: our misuse. Documentation: "relative tolerance of residual for Newton (general goal of Newton is to
decrease the residual by this factor)" (exudyn 1.13, NewtonSettings.relativeTolerance). Since: 1.13.6; no other
version was run.
"""

import math
import sys

import exudyn as exu
from exudyn.itemInterface import (
    CoordinateConstraint,
    MarkerBodiesRelativeRotationCoordinate,
    MarkerBodyRigid,
    MarkerNodeCoordinate,
    NodeGenericData,
    NodePointGround,
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


def crank(by_coordinate):
    """A body by Euler parameters on a revolute joint, and what sets the angle that is prescribed."""
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    ground = mbs.AddObject(ObjectGround())
    node = mbs.AddNode(NodeRigidBodyEP(referenceCoordinates=[0, 0, 0, 1, 0, 0, 0]))
    body = mbs.AddObject(ObjectRigidBody(nodeNumber=node, mass=0, inertia=[0] * 6))
    at = lambda number: mbs.AddMarker(MarkerBodyRigid(bodyNumber=number, localHT=exu.HT()))
    mbs.AddObject(ObjectJointRevoluteZ(markerNumbers=[at(ground), at(body)]))
    if by_coordinate:
        still = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0))
        turns = mbs.AddNode(NodeGenericData(initialCoordinates=[0.0], numberOfDataCoordinates=1))
        both = {"bodyNumbers": [ground, body], "axis0": [0, 0, 1], "nodeNumber": turns}
        turned = mbs.AddMarker(MarkerBodiesRelativeRotationCoordinate(**both))
        held = mbs.AddObject(CoordinateConstraint(markerNumbers=[still, turned], offset=0.0))
        put = lambda angle: mbs.SetObjectParameter(held, "offset", angle)
    else:
        frame = at(ground)
        mbs.AddObject(ObjectJointGeneric(markerNumbers=[at(body), frame], constrainedAxes=[0, 0, 0, 0, 0, 1]))
        put = lambda angle: mbs.SetMarkerParameter(frame, "localHT", exu.HT(rotation=about_z(angle)))
    mbs.Assemble()
    return system, mbs, put, node


def solve(mbs, put, node, angle):
    """Return (success, angle of the crank) of SolveStatic with its default tolerances; it starts at its last answer."""
    put(angle)
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
    off = {}
    for by_coordinate in (False, True):
        print("coordinate constraint" if by_coordinate else "generic joint")
        _, mbs, put, node = crank(by_coordinate)
        off[by_coordinate] = False
        for wanted in (0.0, 1.0, 4.0):
            success, angle = solve(mbs, put, node, wanted)
            told = f"success, {angle % (2 * math.pi):.6f} rad" if success else "no success"
            print(f"wanted {wanted:.6f} rad: {told}")
            off[by_coordinate] |= success and math.cos(angle - wanted) < 0.0
    shown = off[False] and not off[True]
    print("expected: the angles that were wanted, or a failure")
    came = "by a generic joint alone, an angle off by half a turn, with success" if shown else "what was expected"
    print(f"came:     {came}")
    return 0 if shown else 1


if __name__ == "__main__":
    sys.exit(main())
