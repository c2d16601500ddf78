"""exudyn: initial accelerations lack what the second derivative of a prescribed coordinate brings.

A body that turns about the origin by the law 0.3 + 0.7 t + 0.5 t^2, prescribed by a CoordinateConstraint with user
functions for the offset and its rate. Its angular acceleration is 1 at all times.

Class: documented limit. Documentation: "NOTE that initial accelerations that are following from user functions in
constraints are not considered for now!" (exudyn 1.13, GeneralizedAlphaSettings.computeInitialAccelerations). Since:
1.13.6; no other version was run.
"""

import sys

import exudyn as exu
from exudyn.itemInterface import (
    CoordinateConstraint,
    MarkerNodeCoordinate,
    NodePointGround,
    NodeRigidBody2D,
    ObjectRigidBody2D,
)  # fmt: skip

exu.config.printToConsole = False


def law(mbs, t, number, offset):
    return 0.3 + 0.7 * t + 0.5 * t * t


def rate(mbs, t, number, offset):
    return 0.7 + t


def main():
    print(f"exudyn {exu.__version__}")
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    places = {"referenceCoordinates": [0, 0, 0], "initialCoordinates": [0, 0, 0.3], "initialVelocities": [0, 0, 0.7]}
    node = mbs.AddNode(NodeRigidBody2D(**places))
    mbs.AddObject(ObjectRigidBody2D(nodeNumber=node, mass=1, inertia=1))
    markers = [
        mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0)),
        mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=2)),
    ]
    functions = {"offsetUserFunction": law, "offsetUserFunction_t": rate}
    mbs.AddObject(CoordinateConstraint(markerNumbers=markers, **functions))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    exu.MainSolverImplicitSecondOrder().InitializeSolver(mbs, settings)
    came = float(mbs.systemData.GetODE2Coordinates_tt()[2])
    print(f"expected: an initial angular acceleration of 1; came: {came:g}")
    return 0 if abs(came - 1.0) > 1e-3 else 1


if __name__ == "__main__":
    sys.exit(main())
