"""What MuJoCo simulates beside kinematics, switched on in a `Plan` one by one, to see who feels it.

Everything is in the model's unit of length, in which links are of order 1, so that each effect is a large one.
"""

from __future__ import annotations

from typing import Any

from crosscheck.engines import Switch
from crosscheck.engines.mujoco.model import Plan, mujoco, switch_on


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


def _friction(plan: Plan) -> None:
    switch_on(plan.spec, "FRICTIONLOSS")
    for joint in plan.spec.joints:
        joint.frictionloss = 1.0


def _limits(plan: Plan) -> None:
    switch_on(plan.spec, "LIMIT")
    for joint in plan.spec.joints:
        joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_TRUE, [-1e-3, 1e-3]


def _passive(plan: Plan) -> None:
    switch_on(plan.spec, "SPRING", "DAMPER")
    for joint in plan.spec.joints:
        joint.stiffness, joint.damping = [10.0, 0.0, 0.0], [1.0, 0.0, 0.0]


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
    "friction": Switch("frictionloss 1 in every joint", _friction),
    "joint limits": Switch("every joint limited to 1e-3 about zero", _limits),
    "passive forces": Switch("stiffness 10 and damping 1 in every joint", _passive),
    "actuation": Switch("a position servo of gain 10 on every joint", _actuation),
    "sensors": Switch("position and velocity sensors on every joint", _sensors),
    "inertia": Switch("seven times the mass, off the joints", _inertia),
}
