"""Kinds of spatial linkages: what each is made of, on which branch, and to which hard regions it can go."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn

from crosscheck.strategies.linkages import ANGLES, COORDINATES, draw_power_of_ten
from crosscheck.strategies.space_plans import (
    GRID,
    ROOM,
    Array,
    Region,
    RockerCircle,
    SpaceAssembly,
    SpacePlan,
    X,
    Z,
    coupler_frame,
    crank,
    direction,
    drawn_coupler,
    drawn_rocker,
    drawn_span,
    joint_frame,
    link,
    turn,
)
from refkin.joints import (
    GROUND,
    Cylindrical,
    DisplacementDriver,
    Screw,
    SpatialDistanceDriver,
    SpatialGear,
    SpatialPrismatic,
    SpatialRevolute,
    Universal,
)
from refkin.joints.spatial_vectors import SpatialValues
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import RSCR, RSSR, Bennett, Branch, Bricard, Stewart

TRIES = 4
"""How many rockers are drawn for one at which a limit or a fold is."""
NEARLY_ALIKE = (1.0, 2.0)
"""Decades of what the twists of a Bennett linkage may differ by [rad]; its speeds go up to one over that."""


def _to_tip(circle: RockerCircle) -> Callable[[Array], tuple[Array, Array]]:
    """Return what says how near and how far a crank's tip is from a circle."""
    return lambda angles: circle.reach(crank(angles))


def _rssr(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> SpacePlan:
    whole = draw(st.booleans(), label="coupler is a body")
    for _ in range(TRIES):
        circle = drawn_rocker(draw, region, decades)
        span, length, room, there = drawn_coupler(draw, region, decades, _to_tip(circle))
        if there is region:
            break
    centre, axis = (tuple(v.tolist()) for v in (circle.centre, circle.frame[:, 2]))
    linkage = RSSR(1.0, length, circle.radius, centre, axis, massless=not whole)
    return _assembled(linkage, span, sign, room, there)


def _rssp(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> SpacePlan:
    axis = joint_frame(direction(draw, "axis of the slide") + 0.125 * X, None)
    whole = draw(st.booleans(), label="coupler is a body")
    foot = np.array([draw(COORDINATES, label="offset of the slide") for _ in range(3)])

    def away(points: Array) -> Array:
        w = (points - foot) @ axis
        return np.hypot(w[..., 0], w[..., 1])

    span = drawn_span(draw)
    least = float(np.max(away(crank(np.linspace(*span, GRID)))))
    if region is Region.LIMIT:
        near = draw_power_of_ten(draw, decades)
        span = (
            span[0],
            span[0] + (span[1] - span[0]) * int(np.argmax(away(crank(np.linspace(*span, GRID))))) / GRID * 0.8,
        )
        if abs(span[1] - span[0]) < 0.1:
            span = span[0], span[0] + 0.1
        beyond = float(away(crank(span[1] + math.copysign(near, span[1] - span[0]))))
        least = float(np.max(away(crank(np.linspace(*span, GRID)))))
        if beyond > least:
            least, room = beyond, 0.0
        else:
            region = Region.REGULAR
    if region is not Region.LIMIT:
        room = draw(st.floats(0.25, 2.0), label="room of the rod")
    length = least + room
    tip = crank(span[0])
    along = (tip - foot) @ axis[:, 2] + sign * math.sqrt(max(length**2 - float(away(tip)) ** 2, 0.0))
    end = foot + along * axis[:, 2]
    bodies = {"crank": (np.zeros(3), turn(Z, span[0])), "slider": (end, axis)}
    if whole:
        bodies["coupler"] = coupler_frame((tip, end))

    def joints(pose: SpaceAssembly) -> None:
        pose.add(SpatialRevolute, "R1", GROUND, "crank", np.zeros(3), Z, zero_i=X, zero_j=tip)
        link(pose, "crank", "slider", (tip, end), "coupler", whole)
        pose.add(SpatialPrismatic, "P", GROUND, "slider", end, axis[:, 2], zero_i=axis[:, 0], zero_j=axis[:, 0])

    return SpacePlan(bodies, joints, "R1", span, max(room, 1e-12), region)


def _pssr(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> SpacePlan:
    """A slide that moves a rocker: its displacement is the input, in cranks.

    It is across x, along which the rocker is away: to a tip on the axis of the rocker all poses of that are alike.
    """
    whole = draw(st.booleans(), label="coupler is a body")
    axis = turn(X, draw(ANGLES, label="angle of the slide")) @ Z

    def tip(shift: Any) -> Array:
        return np.multiply.outer(shift, axis)

    circle = drawn_rocker(draw, region, decades)
    span, length, room, region = drawn_coupler(draw, region, decades, lambda shifts: circle.reach(tip(shifts)))
    ends = tip(span[0]), circle.at(np.array(circle.meets(tip(span[0]), length, sign)))
    zero = joint_frame(axis, None)[:, 0]
    bodies = {"slider": (ends[0], np.eye(3)), "rocker": (circle.centre, circle.frame)}
    if whole:
        bodies["coupler"] = coupler_frame(ends)

    def joints(pose: SpaceAssembly) -> None:
        pose.add(SpatialPrismatic, "P", GROUND, "slider", np.zeros(3), axis, at_j=ends[0], zero_i=zero, zero_j=zero)
        link(pose, "slider", "rocker", ends, "coupler", whole)
        pose.add(SpatialRevolute, "R", GROUND, "rocker", circle.centre, circle.frame[:, 2])

    return SpacePlan(bodies, joints, "P", span, room, region, DisplacementDriver)


def _bennett(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> SpacePlan:
    alpha = draw(st.floats(0.25, 0.75), label="first twist")
    if region is Region.ALIKE:
        beta = alpha + draw_power_of_ten(draw, NEARLY_ALIKE)
    else:
        beta = draw(st.floats(1.0, 1.5), label="second twist")
    begin, end = drawn_span(draw)
    first = math.remainder(begin, math.tau)
    if abs(math.sin(first)) < 0.125:  # not begun where all links lie in a line
        first += 0.25
    room = abs(math.sin(beta) / math.sin(alpha) - 1.0)
    return _assembled(Bennett(1.0, alpha, beta), (first, first + end - begin), sign, room, region)


def _hooke(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> SpacePlan:
    """One Hooke joint between two shafts that cross: two rows more than are independent."""
    near = (
        draw_power_of_ten(draw, decades)
        if region is Region.GIMBAL
        else draw(st.floats(0.25, 1.5), label="angle off a right one")
    )
    bend = sign * (math.pi / 2 - near)
    n, span = np.array([0.0, math.sin(bend), math.cos(bend)]), drawn_span(draw)
    first = span[0]
    if abs(math.cos(first)) < 0.25:  # where the pin of the input is across both shafts the speeds differ most
        span = (first + 0.5, span[1] + 0.5)
    pin = crank(span[0])
    fork = np.cross(n, pin) / np.linalg.norm(np.cross(n, pin))
    bodies = {"input": (np.zeros(3), turn(Z, span[0])), "output": (np.zeros(3), joint_frame(n, fork))}

    def joints(pose: SpaceAssembly) -> None:
        pose.add(SpatialRevolute, "R1", GROUND, "input", -Z, Z, zero_i=X, zero_j=pin)
        pose.add(Universal, "U", "input", "output", np.zeros(3), pin, axis_j=fork)
        pose.add(SpatialRevolute, "R2", GROUND, "output", n, n)

    return SpacePlan(bodies, joints, "R1", span, near, region)


def _double_hooke(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> SpacePlan:
    """Two shafts and a link between them, a universal joint at either end; the output may shift."""
    bends = [
        sign * draw(st.floats(0.125, 1.0), label="angle of the link"),
        draw(st.floats(0.125, 1.0), label="of the output"),
    ]
    line = np.array([0.0, math.sin(bends[0]), math.cos(bends[0])])
    n = turn(Z, draw(ANGLES, label="angle of the shafts")) @ turn(X, bends[1]) @ line
    span, second = drawn_span(draw), line * draw(st.floats(0.5, 3.0), label="length of the link")
    pin = crank(span[0])
    one = np.cross(line, pin) / np.linalg.norm(np.cross(line, pin))
    two = turn(line, draw(ANGLES, label="angle of the forks")) @ one
    fork = np.cross(two, n) / np.linalg.norm(np.cross(two, n))
    bodies = {
        "input": (np.zeros(3), turn(Z, span[0])),
        "link": (np.zeros(3), joint_frame(line, one)),
        "output": (second, joint_frame(n, fork)),
    }

    def joints(pose: SpaceAssembly) -> None:
        pose.add(SpatialRevolute, "R1", GROUND, "input", -Z, Z, zero_i=X, zero_j=pin)
        pose.add(Universal, "U1", "input", "link", np.zeros(3), pin, axis_j=one)
        pose.add(Universal, "U2", "link", "output", second, two, axis_j=fork)
        pose.add(Cylindrical, "C", GROUND, "output", second + n, n)

    return SpacePlan(bodies, joints, "R1", span, math.pi / 2 - max(map(abs, bends)), region)


def _screw(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> SpacePlan:
    """A nut on a screw, and a slider that a rod ties to it."""
    pitch, span = draw(st.floats(0.03125, 0.25), label="pitch"), drawn_span(draw)
    axis = joint_frame(direction(draw, "axis of the slide"), None)
    foot = np.array([draw(COORDINATES, label="offset of the slide") for _ in range(3)])
    angles = np.linspace(*span, GRID)
    shift = draw(COORDINATES, label="shift of the screw")
    w = (crank(angles) + np.outer(pitch * angles + shift, Z) - foot) @ axis
    away = np.hypot(w[:, 0], w[:, 1])
    length = float(np.max(away)) + draw(st.floats(0.25, 2.0), label="room of the rod")
    nut = (pitch * span[0] + shift) * Z
    tip = crank(span[0]) + nut
    end = foot + (w[0, 2] + sign * math.sqrt(length**2 - away[0] ** 2)) * axis[:, 2]
    bodies = {"nut": (nut, turn(Z, span[0])), "slider": (end, axis)}

    def joints(pose: SpaceAssembly) -> None:
        turns = {"pitch": pitch * pose.size, "shift": shift * pose.size, "zero_i": X, "zero_j": crank(span[0])}
        pose.add(Screw, "H", GROUND, "nut", np.zeros(3), Z, at_j=nut, **turns)
        link(pose, "nut", "slider", (tip, end), "rod", False)
        pose.add(SpatialPrismatic, "P", GROUND, "slider", end, axis[:, 2], zero_i=axis[:, 0], zero_j=axis[:, 0])

    return SpacePlan(bodies, joints, "H", span, length - float(np.max(away)), region)


def _geared(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> SpacePlan:
    """A wheel in gear with one whose axis lies in any direction, and a slider that a rod ties to that one."""
    radii = draw(st.floats(0.5, 2.0), label="first radius"), sign * draw(st.floats(0.5, 2.0), label="second radius")
    span, wheel = drawn_span(draw), joint_frame(direction(draw, "axis of the second wheel"), None)
    axis = joint_frame(direction(draw, "axis of the slide"), None)
    foot = np.array([draw(COORDINATES, label="offset of the slide") for _ in range(3)])
    tips = crank(-radii[0] / radii[1] * np.linspace(*span, GRID)) @ wheel.T
    w = (tips - foot) @ axis
    away = np.hypot(w[:, 0], w[:, 1])
    length = float(np.max(away)) + draw(st.floats(0.25, 2.0), label="room of the rod")
    end = foot + (w[0, 2] + math.sqrt(length**2 - away[0] ** 2)) * axis[:, 2]
    bodies = {
        "wheel": (np.zeros(3), turn(Z, span[0])),
        "crank": (np.zeros(3), joint_frame(wheel[:, 2], tips[0])),
        "slider": (end, axis),
    }

    def joints(pose: SpaceAssembly) -> None:
        sizes: Any = {f"radius_{k}": radius * pose.size for k, radius in zip("ij", radii, strict=True)}
        pose.add(SpatialRevolute, "R1", GROUND, "wheel", np.zeros(3), Z, zero_i=X, zero_j=crank(span[0]))
        pose.add(SpatialRevolute, "R2", GROUND, "crank", np.zeros(3), wheel[:, 2], zero_i=wheel[:, 0], zero_j=tips[0])
        pose.joints.append(SpatialGear(name="G", joint_i="R1", joint_j="R2", **sizes))
        link(pose, "crank", "slider", (tips[0], end), "rod", False)
        pose.add(SpatialPrismatic, "P", GROUND, "slider", end, axis[:, 2], zero_i=axis[:, 0], zero_j=axis[:, 0])

    return SpacePlan(bodies, joints, "R1", span, length - float(np.max(away)), region)


def _chain(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> SpacePlan:
    """An RSSR whose rocker is the crank of another."""
    circle, whole = drawn_rocker(draw, region, decades), draw(st.booleans(), label="coupler is a body")
    span, length, room, region = drawn_coupler(draw, region, decades, _to_tip(circle))
    second = RockerCircle(
        circle.centre + 2.0 * circle.radius * direction(draw, "second ground"),
        joint_frame(direction(draw, "second axis"), None),
        circle.radius,
    )
    arm = draw(st.floats(-1.0, 1.0), label="angle of the arm")

    def arms(inputs: Array) -> Array:
        return circle.at(np.array([circle.meets(crank(x), length, sign) for x in inputs]) + arm)

    while True:
        least, greatest = second.reach(arms(np.linspace(*span, GRID)))
        low, high = float(np.max(least)), float(np.min(greatest))
        if high - low > ROOM or abs(span[1] - span[0]) < 1e-2:
            break
        span = span[0], (span[0] + span[1]) / 2
    tip, angle = crank(span[0]), circle.meets(crank(span[0]), length, sign)
    end, begin = circle.at(np.array(angle)), circle.at(np.array(angle + arm))
    last = second.at(np.array(second.meets(begin, (low + high) / 2, sign)))
    bodies = {
        "crank": (np.zeros(3), turn(Z, span[0])),
        "rocker": (circle.centre, circle.frame),
        "second rocker": (second.centre, second.frame),
    }
    if whole:
        bodies |= {"coupler": coupler_frame((tip, end)), "second coupler": coupler_frame((begin, last))}

    def joints(pose: SpaceAssembly) -> None:
        pose.add(SpatialRevolute, "R1", GROUND, "crank", np.zeros(3), Z, zero_i=X, zero_j=tip)
        link(pose, "crank", "rocker", (tip, end), "coupler", whole)
        pose.add(SpatialRevolute, "R2", GROUND, "rocker", circle.centre, circle.frame[:, 2])
        link(pose, "rocker", "second rocker", (begin, last), "second coupler", whole)
        pose.add(SpatialRevolute, "R3", GROUND, "second rocker", second.centre, second.frame[:, 2])

    return SpacePlan(bodies, joints, "R1", span, min(room, (high - low) / 2), region)


def _assembled(linkage: Any, span: tuple[float, float], sign: float, room: float, region: Region) -> SpacePlan:
    """Return the plan of a linkage with lengths in cranks, which begins with the first input of the span."""
    frames = {GROUND: (np.zeros(3), np.eye(3))}
    for body, q in linkage.assemble(span[0], Branch.OPEN if sign > 0 else Branch.CROSSED).items():
        frames[body] = (np.array(q[:3]), SpatialValues(*q).rotation())

    def joints(out: SpaceAssembly) -> None:
        for j in linkage.joints():
            (r, a), (r_j, a_j) = (frames[body] for body in j.bodies)
            axis, more = None, dict[str, Any](at_j=r_j + a_j @ j.point_j)
            if hasattr(j, "axis_i"):
                axis = a @ j.axis_i
                more |= {"axis_j": a_j @ j.axis_j, "zero_i": a @ j.zero_i, "zero_j": a_j @ j.zero_j}
            if hasattr(j, "length"):
                more["length"] = out.size * j.length
            out.add(type(j), j.name, j.body_i, j.body_j, r + a @ j.point_i, axis, **more)

    bodies = {body: frame for body, frame in frames.items() if body != GROUND}
    return SpacePlan(bodies, joints, "R1", span, room, region)


def _rscr(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> SpacePlan:
    """Seen along the axis of the rocker, which is that of the cylindrical joint: circle against circle."""
    circle = drawn_rocker(draw, region, decades)

    def reach(angles: Array) -> tuple[Array, Array]:
        w = (crank(angles) - circle.centre) @ circle.frame
        flat = np.hypot(w[:, 0], w[:, 1])
        return np.abs(flat - circle.radius), flat + circle.radius

    span, length, room, region = drawn_coupler(draw, region, decades, reach)
    centre, axis = (tuple(v.tolist()) for v in (circle.centre, circle.frame[:, 2]))
    return _assembled(RSCR(1.0, length, circle.radius, centre, axis), span, sign, room, region)


def _bricard(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> SpacePlan:
    """Six hinges, of which the input turns as far as the other three follow it."""
    linkage = Bricard(1.0, draw(st.floats(1.0, 1.5), label="twist"))
    c, s = math.cos(linkage.alpha), math.sin(linkage.alpha)
    first = draw(st.floats(0.25, 0.75), label="first angle")
    angles = np.linspace(first, first + draw(st.floats(0.25, 1.0), label="turned"), GRID)
    cosine = (c * c + s * s * np.cos(angles)) / np.hypot(s * s + (1 + c * c) * np.cos(angles), 2 * c * np.sin(angles))
    rooms = np.minimum.accumulate(1.0 - np.abs(cosine))
    last = max(int(np.sum(rooms > ROOM / 4)) - 1, 2)
    return _assembled(linkage, (first, float(angles[last])), sign, float(rooms[last]), region)


def _stewart(draw: DrawFn, region: Region, sign: float, decades: tuple[float, float]) -> SpacePlan:
    """A platform on six driven legs, each of which goes in and out in its own time, from its home."""
    lengths = draw(st.floats(0.375, 0.75), label="top"), sign * draw(st.floats(0.5, 1.0), label="height")
    stewart = Stewart.three_three(1.0, *lengths, stroke=draw(st.floats(0.0078125, 0.0625), label="stroke"))
    speed = draw(st.floats(0.5, 2.0), label="speed")

    def joints(out: SpaceAssembly) -> None:
        legs: Any = stewart.drivers(Polynomial(coefficients=(0.0, speed)))
        for leg in legs:
            stroke = leg.law.amplitude
            home = leg.law.offset - stroke * math.sin(leg.law.phase)
            law = replace(leg.law, amplitude=out.size * stroke, offset=out.size * home)
            top = np.array([*leg.point_j[:2], leg.point_j[2] + lengths[1]])
            out.add(SpatialDistanceDriver, leg.name, GROUND, "platform", np.array(leg.point_i), at_j=top, law=law)

    bodies = {"platform": (np.array(stewart.home[:3]), np.eye(3))}
    return SpacePlan(bodies, joints, "", (0.0, 1.0), abs(lengths[1]) - 2.0 * stewart.stroke, region)


KINDS: dict[str, tuple[Callable[..., SpacePlan], Sequence[Region]]] = {
    "RSSR": (_rssr, (Region.REGULAR, Region.LIMIT, Region.FOLD, Region.PLANAR, Region.OVER)),
    "RSSP": (_rssp, (Region.REGULAR, Region.LIMIT)),
    "Bennett": (_bennett, (Region.REGULAR, Region.ALIKE)),
    "Hooke": (_hooke, (Region.REGULAR, Region.GIMBAL)),
    "double Hooke": (_double_hooke, (Region.REGULAR,)),
    "screw": (_screw, (Region.REGULAR,)),
    "RSSR chain": (_chain, (Region.REGULAR,)),
    "RSCR": (_rscr, (Region.REGULAR, Region.LIMIT, Region.FOLD)),
    "Bricard": (_bricard, (Region.REGULAR,)),
    "Stewart": (_stewart, (Region.REGULAR,)),
    "geared": (_geared, (Region.REGULAR,)),
    "PSSR": (_pssr, (Region.REGULAR, Region.LIMIT, Region.FOLD)),
}
"""How each kind is made, and where it can go."""
