"""Spatial linkages, feasible by construction: at the first time every joint is placed in the ground frame, closed.

What a joint is on each of its bodies follows from that pose, so it closes whatever was drawn. Hard regions are gone to
on purpose (`Region`).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields, replace
from typing import Any, cast

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from crosscheck.strategies.laws import motion_laws
from crosscheck.strategies.linkages import ANGLES, COORDINATES, draw_size
from crosscheck.strategies.space_kinds import KINDS
from crosscheck.strategies.space_plans import Array, Region, SpaceAssembly, SpacePlan, direction, joint_frame, turn
from crosscheck.strategies.spans import Binned, check_asked
from refkin.joints import (
    GROUND,
    SPATIAL_JOINT_TYPES,
    AxesPerpendicular,
    Element,
    PointInPlane,
    PointOnAxis,
    PointsMeet,
    Screw,
    SpatialFixed,
    TurnAboutAxis,
    Universal,
    elements_of,
)
from refkin.joints.spatial_frames import parameters_of
from refkin.joints.spatial_vectors import Vec3
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Law
from refkin.scenes.linkages import Branch
from refkin.scenes.linkages.base import law_keys


class Spatial(Binned):
    """A drawn scene of space: `distance` is the least room of the coupler over its span, in cranks."""


def spatial_scenes(
    *,
    kinds: Collection[str] | None = None,
    regions: Collection[Region] = tuple(Region),
    decades: tuple[float, float] = (2, 6),
    samples: int = 72,
) -> SearchStrategy[Spatial]:
    """Return scenes of `KINDS` that assemble at all times, with a crank of a centimetre to a hundred metres.

    `decades` (k, k') say that hard regions are 10^-k ... 10^-k' wide. Examples from this strategy shrink towards an
    RSSR with a crank of about one metre at the origin.

    Parameters
    ----------
    kinds : collection of str, optional
        Of `KINDS`; all by default.
    regions : collection of Region
        Where scenes may go.
    decades : (float, float)
        (k, k'): those that go near a singular pose come within 10^-k to 10^-k'.
    samples : int
        How many times a scene has.
    """
    asked = KINDS if kinds is None else kinds
    check_asked(samples, kinds=(asked, KINDS), regions=(regions, Region))
    wanted = [(kind, r) for kind, (_, own) in KINDS.items() if kind in asked for r in own if r in regions]
    if not wanted:
        raise ValueError(f"regions: expected some of those that {', '.join(asked)} may go to, got {regions!r}")
    return _spatial(tuple(wanted), decades, samples)


@st.composite
def _spatial(
    draw: DrawFn, wanted: tuple[tuple[str, Region], ...], decades: tuple[float, float], samples: int
) -> Spatial:
    kind, region = draw(st.sampled_from(wanted), label="kind and region")
    size = draw_size(draw, (1e-2, 1e2))
    branch = draw(st.sampled_from(Branch), label="branch")
    plan = KINDS[kind][0](draw, region, 1.0 if branch is Branch.OPEN else -1.0, decades)
    duration = 10.0 ** draw(st.floats(-1.0, 1.0), label="decade of the duration")
    unit = 1.0 if plan.driver.law_is_angle else size
    first, last = (unit * end for end in plan.span)
    law = draw(motion_laws(first=first, last=last, duration=duration, monotone=True))
    times = tuple(np.linspace(0.0, duration, samples).tolist())
    scene = _scene(draw, plan, law, size, times, f"{kind} {branch}, {plan.region}")
    return Spatial(scene, kind, branch, plan.room, plan.region)


def _scene(draw: DrawFn, plan: SpacePlan, law: Law, size: float, times: tuple[float, ...], name: str) -> Scene:
    """Return the scene of a plan: somewhere on the ground, its bodies with frames of their own."""
    place, apart = np.eye(3), np.zeros(3)
    if draw(st.booleans(), label="somewhere else"):
        place = turn(direction(draw, "axis of the place"), draw(ANGLES, label="turn of the place"))
        apart = 10.0 * np.array([draw(COORDINATES, label="origin") for _ in range(3)])
    frames = {GROUND: (np.zeros(3), np.eye(3))}
    other = draw(st.booleans(), label="other frames")
    for body, (r, a) in plan.bodies.items():
        if other:
            a = a @ turn(direction(draw, f"axis of {body}"), draw(ANGLES, label=f"turn of {body}"))
            r = r + np.array([draw(COORDINATES, label=f"frame of {body}") for _ in range(3)])
        frames[body] = (size * (apart + place @ r), place @ a)
    pose = SpaceAssembly(frames, place, apart, size)
    plan.joints(pose)
    drivers: list[Any] = [joint for joint in pose.joints if joint.laws]
    joints = tuple(joint for joint in pose.joints if joint not in drivers)
    if draw(st.booleans(), label="bodies of joints the other way round"):
        joints = tuple(map(_reversed, joints))
    joints = _structured(draw, plan, pose, joints)
    if plan.driven:
        drivers.append(plan.driver(name="driver", joint=plan.driven, **law_keys(law)))
    bodies = tuple(Body(name=body, estimate=_rough(*at, size)) for body, at in frames.items() if body != GROUND)
    return Scene(mechanism=Mechanism(bodies, joints, tuple(drivers)), times=times, name=name)


STRUCTURES = ("as it is",) * 4 + ("elements", "bracket")
"""What stands for the joints of a kind: joints that say one thing each, or one body more that is fixed to another."""
OF_ONE = {kind.consists_of[0]: kind for kind in cast("Any", SPATIAL_JOINT_TYPES) if len(kind.consists_of) == 1}
"""Joints that say what one element says."""
PARTS: dict[Any, tuple[type[Element], ...]] = {
    PointsMeet: (PointOnAxis, PointInPlane),
    TurnAboutAxis: (AxesPerpendicular,),
}
"""Elements that say together what one says: points meet on a line and in the plane across it, whichever it is."""
ENDS = {f"{end}_{side}" for end in ("body", "point", "axis") for side in "ij"}


def _structured(draw: DrawFn, plan: SpacePlan, pose: SpaceAssembly, joints: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return joints as they are, in parts of one element each, or with a body more that is fixed to another."""
    structure = draw(st.sampled_from(STRUCTURES), label="structure")
    if structure == "elements":
        named = {plan.driven, *(getattr(joint, key, "") for joint in joints for key in ("joint_i", "joint_j"))}
        return tuple(part for joint in joints for part in ((joint,) if joint.name in named else _elements(joint)))
    if structure == "bracket":
        carrier = draw(st.sampled_from(tuple(pose.frames)), label="carrier")
        return (*joints, _bracket(pose, carrier, direction(draw, "bracket")))
    return joints


def _elements(joint: Any) -> list[Any]:
    """Return joints of one element each that say together what one says; itself, if it is such a joint."""
    own = list(elements_of([joint]))
    parts = [(element, part) for element in own for part in PARTS.get(type(element), (type(element),))]
    if len(own) < 2 or any(part not in OF_ONE for _, part in parts):
        return [joint]
    return [_of_one(joint.name, element, OF_ONE[part]) for element, part in parts]


def _of_one(name: str, element: Any, kind: Any) -> Any:
    """Return a joint that says what an element says, or a part of it; turns are held by zeros across each other."""
    ends: dict[str, Any] = {"axis_i": (0.0, 0.0, 1.0)} | vars(element)
    if isinstance(element, TurnAboutAxis):
        ends |= {"axis_i": ends["zero_i"], "axis_j": tuple(np.cross(ends["axis_j"], ends["zero_j"]).tolist())}
    keys = {field.name for field in fields(kind)} & ENDS
    return kind(name=f"{name} {kind.type}", **{key: ends[key] for key in keys})


def _bracket(pose: SpaceAssembly, carrier: str, axis: Array) -> SpatialFixed:
    """Return a joint that holds a body more on another, a crank away along an axis, whose frame lies as on the ground.

    The joint sits between the two frames.
    """
    r, _ = pose.frames[carrier]
    pose.frames["bracket"] = r + pose.size * pose.place @ axis, pose.place
    middle = pose.place.T @ (r / pose.size + pose.place @ axis / 2) - pose.place.T @ pose.apart
    zero = joint_frame(axis, None)[:, 0]
    pose.add(SpatialFixed, "bracket", carrier, "bracket", middle, axis, zero_i=zero, zero_j=zero)
    joint: SpatialFixed = pose.joints.pop()
    return joint


def _reversed(joint: Any) -> Any:
    """Return a joint from its second body to its first: with its axis turned round, its angle has the same sense.

    Of a screw the shift along the axis would change its sign as well.
    """
    if isinstance(joint, Screw):
        return joint
    keys = [key for key in ("body", "point", "axis", "zero") if hasattr(joint, f"{key}_i")]
    ends = {f"{key}_{a}": getattr(joint, f"{key}_{b}") for key in keys for a, b in ("ij", "ji")}
    if not isinstance(joint, Universal):  # its axes are two
        ends |= {key: tuple(-x for x in ends[key]) for key in ("axis_i", "axis_j") if key in ends}
    return replace(joint, **ends)


def _rough(r: Array, a: Array, size: float) -> tuple[float, ...]:
    """Return a pose as an estimate of three decimals, of the size and of its Euler parameters."""
    return (
        *(size * round(float(x) / size, 3) for x in r),
        *(round(float(x), 3) for x in parameters_of(*(Vec3(*column) for column in a.T))),
    )
