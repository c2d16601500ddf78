"""exudyn: SolveStatic, started with a joint's axis turned by more than a right angle, ends with the axis reversed.

A body on a revolute joint about z, its angle held at 0.5 rad by a generic joint about the same axis, from a start that
is turned about x. The rows of both joints are dot products of axes, which are zero on a reversed axis as well.

Class: documented limit. Documentation: "relative tolerance of residual for Newton (general goal of Newton is to
decrease the residual by this factor)" (exudyn 1.13, NewtonSettings.relativeTolerance). Since: 1.13.6; no other
version was run.
"""

import math
import sys

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    MarkerBodyRigid,
    NodeRigidBodyEP,
    ObjectGround,
    ObjectJointGeneric,
    ObjectJointRevoluteZ,
    ObjectRigidBody,
)  # fmt: skip

exu.config.printToConsole = False
ANGLE = 0.5


def solved(turned):
    """Return (success, z component of the body's z axis) of SolveStatic, from a start turned about x by an angle."""
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    base = mbs.AddObject(ObjectGround())
    start = [0, 0, 0, math.cos(turned / 2) - 1, math.sin(turned / 2), 0, 0]
    node = mbs.AddNode(NodeRigidBodyEP(referenceCoordinates=[0, 0, 0, 1, 0, 0, 0], initialCoordinates=start))
    body = mbs.AddObject(ObjectRigidBody(nodeNumber=node, mass=0, inertia=[0] * 6))
    ends = [mbs.AddMarker(MarkerBodyRigid(bodyNumber=b, localPosition=[0, 0, 0])) for b in (base, body)]
    mbs.AddObject(ObjectJointRevoluteZ(markerNumbers=ends))
    c, s = math.cos(ANGLE), math.sin(ANGLE)
    at = exu.HT(rotation=np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), translation=[0, 0, 0])
    held = mbs.AddMarker(MarkerBodyRigid(bodyNumber=base, localHT=at))
    mbs.AddObject(ObjectJointGeneric(markerNumbers=[held, ends[1]], constrainedAxes=[0, 0, 0, 0, 0, 1]))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.linearSolver.solverType = exu.LinearSolverType.EigenDense
    settings.linearSolver.ignoreSingularJacobian = True  # the generic joint's free axes
    try:
        success = mbs.SolveStatic(settings)
    except exu.SolverError:
        return False, None
    return success, mbs.GetObjectOutputBody(body, exu.OutputVariableType.RotationMatrix, [0, 0, 0])[8]


def main():
    print(f"exudyn {exu.__version__}")
    axes = []
    for turned in (0.5, 1.0, 2.0, 2.5, 3.0):
        success, axis = solved(turned)
        print(f"started {turned} rad off: {f'success, z of the axis {axis:+.6f}' if success else 'no success'}")
        axes += [axis] if success else []
    shown = bool(axes) and min(axes) < 0
    print("expected: the axis along z, or a failure")
    print("came:     the axis reversed, with success" if shown else "came:     what was expected")
    return 0 if shown else 1


if __name__ == "__main__":
    sys.exit(main())
