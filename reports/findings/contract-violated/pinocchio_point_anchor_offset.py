"""Pinocchio: with an offset, the Jacobian of a PointAnchorConstraintModel is not the derivative of its own error.

Two bodies that turn about parallel axes; a point of the second is to stay at an offset from the frame of the first. The
position error is c1Mc2.translation - offset, but the lever arm of omega_1 in `jacobian` (and in the velocity and
acceleration errors) is that error, not c1Mc2.translation: omega_1 x offset is missing.

Class: contract violated. Documentation: "Compute the constraint jacobian." (Pinocchio 4.1.0, docstring of
PointAnchorConstraintModel.jacobian). Since: 4.1.0; 3.7.0 has no such class.
"""

import sys

import numpy as np
import pinocchio as pin

Q, STEP = np.array([0.3, 1.1]), 1e-6


def anchored(offset):
    """Return a model of two turning bodies and the constraint between them."""
    model = pin.Model()
    first = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "first")
    second = model.addJoint(0, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([4.0, 0.0, 0.0])), "second")
    arm = pin.SE3(np.eye(3), np.array([3.0, 0.0, 0.0]))
    constraint = pin.PointAnchorConstraintModel(model, first, pin.SE3.Identity(), second, arm)
    constraint.desired_constraint_offset = np.array([offset, 0.0, 0.0])
    return model, constraint


def error(model, constraint, q):
    data, state = model.createData(), constraint.createData()
    pin.computeJointJacobians(model, data, q)
    constraint.calc(model, data, state)
    return np.array(state.constraint_position_error), constraint.jacobian(model, data, state)


def main():
    print(f"pinocchio {pin.__version__}")
    off = {}
    for offset in (0.0, 1.0):
        model, constraint = anchored(offset)
        differences = [
            (error(model, constraint, Q + step)[0] - error(model, constraint, Q - step)[0]) / (2.0 * STEP)
            for step in STEP * np.eye(2)
        ]
        expected, came = np.array(differences).T[:2], error(model, constraint, Q)[1][:2]
        off[offset] = np.max(np.abs(came - expected))
        shown = (np.round(matrix, 6).tolist() for matrix in (expected, came))
        print("offset {}: expected the derivative of the position error, {}; came {}".format(offset, *shown))
    return 0 if off[1.0] > 1e-3 and off[0.0] < 1e-8 else 1


if __name__ == "__main__":
    sys.exit(main())
