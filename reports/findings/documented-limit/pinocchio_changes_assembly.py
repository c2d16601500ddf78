"""Pinocchio: the closed-chain example's loop, led in steps of 1 rad, goes over to the mirror assembly and converges.

A crank-rocker with ground 4, crank 1, coupler 3.99, rocker 1.02 has two assemblies at every crank angle. On each of
them the sign of the cross product of coupler and rocker stays what it is.

Class: documented limit. Documentation: "if primal_feas < eps and dual_feas < eps:" (Pinocchio 3.7.0,
examples/simulation-closed-kinematic-chains.py). Since: 4.1.0, by the loop of an example of 3.7.0; no other version
was run.
"""

import math
import sys

import numpy as np
import pinocchio as pin

RHO, MU, EPS, N = 1e-10, 1e-4, 1e-10, 100  # of the example


def at(x, y=0.0, angle=0.0):
    c, s = math.cos(angle), math.sin(angle)
    return pin.SE3(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([x, y, 0.0]))


def four_bar(ground, crank, coupler, rocker):
    """Crank and coupler in one chain, the rocker in another; what is left is to join their ends."""
    model = pin.Model()
    a = model.addJoint(0, pin.JointModelRZ(), at(0.0), "crank")
    b = model.addJoint(a, pin.JointModelRZ(), at(crank), "coupler")
    c = model.addJoint(0, pin.JointModelRZ(), at(ground), "rocker")
    loop = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, b, at(coupler), c, at(rocker))
    return model, loop


def close(model, loop, q, angle):
    """Return (converged, q) by the loop of the example simulation-closed-kinematic-chains.py, the crank held in 6D."""
    data = model.createData()
    held = pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, model, 1, pin.SE3.Identity(), 0, at(0.0, 0.0, angle))
    models = [loop, held]
    datas = [m.createData() for m in models]
    y = np.ones(9)
    data.M = np.eye(model.nv) * RHO
    kkt = pin.ConstraintCholeskyDecomposition(model, data, models, datas)
    for _ in range(N):
        pin.computeJointJacobians(model, data, q)
        for m, d in zip(models, datas, strict=True):
            m.calc(model, data, d)
        kkt.compute(model, data, models, datas, MU)
        value = np.concatenate([datas[0].c1Mc2.translation, pin.log6(datas[1].c1Mc2).vector])
        jacobian = pin.getConstraintsJacobian(model, data, models, datas)
        primal, dual = np.max(np.abs(value)), np.max(np.abs(jacobian.T @ (value + y)))
        if primal < EPS and dual < EPS:
            return True, q
        dz = kkt.solve(np.concatenate([-value - y * MU, np.zeros(model.nv)]))
        q, y = pin.integrate(model, q, -dz[9:]), dz[:9]
    return False, q


def main():
    print(f"pinocchio {pin.__version__}")
    model, loop = four_bar(4.0, 1.0, 3.99, 1.02)
    q = np.array([-2.5, 0.39 + 2.5, 2.08])
    sides = []
    for k in range(6):
        converged, q = close(model, loop, q, -2.5 + k)
        side = math.sin(q[2] - q[0] - q[1])
        print(f"crank {-2.5 + k:5.2f} rad: converged {converged}, sine of coupler to rocker {side:+.6f}")
        sides += [side] if converged else []
    shown = min(sides) < 0 < max(sides)
    print("expected: one sign throughout, or no convergence")
    print("came:     both signs, converged" if shown else "came:     what was expected")
    return 0 if shown else 1


if __name__ == "__main__":
    sys.exit(main())
