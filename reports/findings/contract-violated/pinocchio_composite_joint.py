"""Pinocchio: dJ/dt of joints whose subspace depends on q is wrong, and with it the drift of what hangs on them.

A body in the plane on one joint composed of PX, PY and RZ. The origin of its frame moves straight while no joint
accelerates: dJ/dt v is zero there, as forwardKinematics says. The same three joints one after the other are right. A
composite joint's subspace depends on q, and the pass takes it for constant in the joint's frame; so it does with the
three turns of a JointModelSphericalZYX, whose drift is an angular acceleration.

Class: contract violated. Documentation: "Computes the full model Jacobian variations with respect to time. It
corresponds to dJ/dt which depends both on q and v." (Pinocchio 4.1.0, docstring of
computeJointJacobiansTimeVariation). Since: 4.1.0; no other version was run.
"""

import sys

import numpy as np
import pinocchio as pin

Q, V = np.array([0.3, 0.2, 0.5]), np.array([0.7, -0.4, 1.3])
KINDS = (pin.JointModelPX, pin.JointModelPY, pin.JointModelRZ)


def composite():
    model, joint = pin.Model(), pin.JointModelComposite()
    for kind in KINDS:
        joint.addJoint(kind())
    return model, model.addJoint(0, joint, pin.SE3.Identity(), "planar")


def chain():
    model, joint = pin.Model(), 0
    for kind in KINDS:
        joint = model.addJoint(joint, kind(), pin.SE3.Identity(), kind.__name__)
    return model, joint


def turns():
    model = pin.Model()
    return model, model.addJoint(0, pin.JointModelSphericalZYX(), pin.SE3.Identity(), "turns")


def drift(model, joint):
    """Return dJ/dt v of the joint's frame at its origin, and its acceleration while no joint accelerates."""
    data = model.createData()
    pin.computeJointJacobiansTimeVariation(model, data, Q, V)
    of_jacobian = pin.getJointJacobianTimeVariation(model, data, joint, pin.LOCAL_WORLD_ALIGNED) @ V
    pin.forwardKinematics(model, data, Q, V, np.zeros(3))
    return of_jacobian, pin.getClassicalAcceleration(model, data, joint, pin.LOCAL_WORLD_ALIGNED).vector


def main():
    print(f"pinocchio {pin.__version__}")
    off = {}
    for name, build in (("three joints", chain), ("one composite joint", composite), ("SphericalZYX", turns)):
        came, expected = drift(*build())
        off[name] = np.max(np.abs(came - expected))
        print(f"{name}: expected dJ/dt v = {np.round(expected, 12) + 0.0}, came {np.round(came, 12) + 0.0}")
    return 0 if min(off["one composite joint"], off["SphericalZYX"]) > 1e-9 > off["three joints"] else 1


if __name__ == "__main__":
    sys.exit(main())
