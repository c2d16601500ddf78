"""Two of MuJoCo's features, as they are compiled and switched on.

`sites`: the model is in metres, with a site at the origin of each of the scene's bodies. Their places are `site_xpos`,
their velocities the sites' Jacobians times the rates. `sparse Newton`: accelerations of the default solver, Newton,
with sparse Jacobians and a tolerance of 0. It minimizes 1/2 |a - a_0|_M^2 + 1/2 |J a - a_ref|_D^2, which has one
minimum; what it departs from that is added to the accelerations of the method `newton`. The minimum does not depend on
the order in which a model lists its joints, so the solver is asked in several.

And what MuJoCo simulates beside kinematics: `EFFECTS`, switched on in a `Plan` one by one, to see who feels it.
Everything is in the model's unit of length, in which links are of order 1, so that each effect is a large one.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from crosscheck.engines import Array, EngineRefusal, Switch, route_by
from crosscheck.engines.mujoco.model import Plan, mujoco, switch_on
from crosscheck.engines.mujoco.rows import MujocoRows
from crosscheck.engines.tree.joint_tree import Freedom, JointTree, joint_tree
from crosscheck.engines.tree.tree_system import Places
from refkin.model import Mechanism
from refkin.motion import Route

SITES = route_by("mujoco", "sites", "adapter (by the method newton)")
SPARSE = replace(SITES, name="sparse Newton", linear_solve_by="acceleration: mujoco")
FEATURES = (SITES, SPARSE)
ORDERS = 20
"""Of joints, in which the sparse solver is asked: of small branching trees it errs on one in thirty."""


def _turning(tree: JointTree, route: Route) -> JointTree:
    """Return a tree if nothing in it but hinges moves; else raise EngineRefusal."""
    if any(edge.freedom is not Freedom.TURN for edge in tree.edges):
        raise EngineRefusal(f"mujoco refuses this by the method {route.name!r}: it is written for trees of hinges")
    return tree


class Sites:
    """Sites at the origins of bodies in a model in metres, whatever the compiler has made of them."""

    def __init__(self, tree: JointTree) -> None:
        self.tree, size = _turning(tree, SITES), tree.size
        of_edges = ((e, [(x * size, y * size) for x, y in (e.point, e.pin)]) for e in tree.edges)
        metres = [replace(e, point=point, pin=pin) for e, (point, pin) in of_edges]
        plan = Plan(replace(tree, edges=tuple(metres), closures=(), driven=()), ())
        for edge in metres:
            plan.bodies[edge.body].add_site(name=edge.body, pos=plan.place(edge.body, (0.0, 0.0)))
        self.model: Any = plan.spec.compile()
        self.data: Any = mujoco.MjData(self.model)
        self.columns = [self.model.joint(f"q{k}").id for k in range(tree.width)]

    def read(self, q: Array, qd: Array | None, places: Places) -> list[Array]:
        """Return positions, and with rates velocities, (P, 2) of the origins of bodies, in the tree's unit."""
        m, d = self.model, self.data
        d.qpos[self.columns] = q
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        levels = [np.array([d.site(body).xpos[:2] for body, _ in places])]
        if qd is not None:
            d.qvel[self.columns] = qd
            slope = np.empty((3, m.nv))
            levels.append(np.empty((len(places), 2)))
            for k, (body, _) in enumerate(places):
                mujoco.mj_jacSite(m, d, slope, None, m.site(body).id)
                levels[1][k] = (slope @ d.qvel)[:2]
        return [level / self.tree.size for level in levels]


class SparseNewton:
    """What the sparse solver departs from the minimum that it states, in the worst of several orders of the joints."""

    def __init__(self, mechanism: Mechanism) -> None:
        draw, self.tree = random.Random(0), joint_tree(mechanism)
        orders = [mechanism]
        for _ in range(ORDERS - 1):
            joints = draw.sample(mechanism.joints, len(mechanism.joints))
            orders.append(replace(mechanism, joints=tuple(joints)))
        trees = [_turning(joint_tree(order), SPARSE) for order in orders]
        self.trees = list({(tree.edges, tree.closures): tree for tree in trees}.values())  # some orders give one tree
        self.models = [MujocoRows(Plan(tree, (*tree.closures, *tree.driven))) for tree in self.trees]
        for rows in self.models:
            rows.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
            rows.model.opt.tolerance = 0.0

    def departure(self, q: Array, qd: Array, t: float) -> Array:
        """Return it as accelerations (n,) of the scene's own tree."""
        names = [edge.body for edge in self.tree.edges]
        matrix = np.array([self.tree.angle_rows[body] for body in names])
        phi, rate = np.array([self.tree.angle(body, q) for body in names]), matrix @ qd
        worst = np.zeros(len(q))
        for tree, rows in zip(self.trees, self.models, strict=True):
            other = np.array([tree.angle_rows[body] for body in names])
            offsets = [tree.angle_offsets[body] for body in names]
            solved = rows.forward(np.linalg.solve(other, phi - offsets), np.linalg.solve(other, rate), t)
            off = np.linalg.solve(matrix, other @ (solved - _minimum(rows)))
            worst = max(worst, off, key=lambda a: np.max(np.abs(a)))
        return worst


def _minimum(rows: MujocoRows) -> Array:
    """Return the accelerations (n,) that MuJoCo's problem has where it was last solved, in the order of the tree."""
    m, d = rows.model, rows.data
    inertia, jacobian = np.empty((m.nv, m.nv)), np.empty((d.nefc, m.nv))
    mujoco.mj_fullM(m, d, inertia)
    mujoco.mju_sparse2dense(jacobian, d.efc_J, d.efc_J_rownnz, d.efc_J_rowadr, d.efc_J_colind)
    weighted = jacobian.T * d.efc_D
    right = inertia @ d.qacc_smooth + weighted @ d.efc_aref
    return np.array(np.linalg.solve(inertia + weighted @ jacobian, right)[rows.columns])


def affected(plan: Plan, effect: str | None) -> Plan:
    """Return a plan with one of `EFFECTS` switched on, or as it is."""
    if effect is not None:
        EFFECTS[effect].switch(plan)
    return plan


def _moving(plan: Plan) -> list[Any]:
    """Return the bodies of the specification that have joints."""
    return [body for body in plan.spec.bodies if body.joints]


def _gravity(plan: Plan) -> None:
    plan.spec.option.gravity = [0.0, -9.81, 0.0]
    switch_on(plan.spec, "GRAVITY")


def _contact(plan: Plan) -> None:
    switch_on(plan.spec, "CONTACT")
    for body in (plan.spec.worldbody, *_moving(plan)):
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.5, 0.0, 0.0])


def _in_joints(*effects: str, **numbers: Any) -> Callable[[Plan], None]:
    """Return what switches some effects on and gives every joint these numbers."""

    def switch(plan: Plan) -> None:
        switch_on(plan.spec, *effects)
        for joint in plan.spec.joints:
            for key, value in numbers.items():
                setattr(joint, key, value)

    return switch


def _actuation(plan: Plan) -> None:
    switch_on(plan.spec, "ACTUATION")
    for k, joint in enumerate(plan.spec.joints):
        motor = plan.spec.add_actuator(name=f"a{k}", target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_position(kp=10.0)


def _sensors(plan: Plan) -> None:
    switch_on(plan.spec, "SENSOR")
    for kind in (mujoco.mjtSensor.mjSENS_JOINTPOS, mujoco.mjtSensor.mjSENS_JOINTVEL):
        for joint in plan.spec.joints:
            named = {"name": f"s{int(kind)} {joint.name}", "objname": joint.name}
            plan.spec.add_sensor(type=kind, objtype=mujoco.mjtObj.mjOBJ_JOINT, **named)


def _inertia(plan: Plan) -> None:
    for k, body in enumerate(_moving(plan)):
        body.mass, body.inertia, body.ipos = 7.0 + k, [3.0, 3.0, 5.0], [0.3, 0.1, 0.0]


EFFECTS = {
    "gravity": Switch("9.81 across the plane's x axis", _gravity),
    "contact": Switch("a sphere of half a size on each body and on the ground", _contact),
    "friction": Switch("frictionloss 1 in every joint", _in_joints("FRICTIONLOSS", frictionloss=1.0)),
    "joint limits": Switch(
        "every joint limited to 1e-3 about zero",
        _in_joints("LIMIT", limited=mujoco.mjtLimited.mjLIMITED_TRUE, range=[-1e-3, 1e-3]),
    ),
    "passive forces": Switch(
        "stiffness 10 and damping 1 in every joint",
        _in_joints("SPRING", "DAMPER", stiffness=[10.0, 0.0, 0.0], damping=[1.0, 0.0, 0.0]),
    ),
    "actuation": Switch("a position servo of gain 10 on every joint", _actuation),
    "sensors": Switch("position and velocity sensors on every joint", _sensors),
    "inertia": Switch("seven times the mass, off the joints", _inertia),
}
