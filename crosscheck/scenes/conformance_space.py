"""What an engine is asked in space, as `conformance` asks in the plane: each joint and driver in a plain mechanism."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from crosscheck.scenes.hard_case import ends
from refkin.joints import (
    GROUND,
    SPACE,
    Constraint,
    Cylindrical,
    DisplacementDriver,
    Driver,
    Parallel,
    Perpendicular,
    PointOnPlane,
    Screw,
    SpatialAngleDriver,
    SpatialDistanceDriver,
    SpatialFixed,
    SpatialGear,
    SpatialPointOnLine,
    SpatialPrismatic,
    SpatialRevolute,
    Spherical,
)
from refkin.joints.spatial_vectors import Quaternion, Vec3, turned
from refkin.model import Body, Effect, Mechanism, Point, Scene
from refkin.motion import Status
from refkin.motion_laws import Polynomial, Sinusoid
from refkin.scenes.linkages import RSCR, RSSP, RSSR, Bennett, Hooke, Stewart
from refkin.scenes.linkages.spatial_base import AT, X, Y, Z

Times = tuple[float, ...]
DriveLaw = Polynomial | Sinusoid
ROCKER: Any = {"pivot": (2.5, -0.5, 0.75), "axis": (0.25, 1.0, 0.125)}
LOOP = RSSR(crank=1.0, coupler=3.0, rocker=2.0, massless=True, **ROCKER)
FRAME: Any = {"axis_j": Z, "zero_j": X}
ASKEW: Any = {"axis_i": (0.25, 0.1, 1.0), "zero_i": X, **FRAME}
"""A line askew in the ground, and the z axis of a body."""
ORIGIN, TURN, LONGER = (0.1, -0.2, 0.15), Quaternion.of(6 / 7, 2 / 7, 3 / 7, 0.0), 2.0
"""Of the frames in which joints are asked about: where they are in the plain ones [m], how they are turned in these,
and how many times as long directions are in them."""
HINGE = SpatialRevolute(name="R1", body_i=GROUND, point_i=AT, body_j="crank", point_j=(-0.5, 0.0, 0.0), **ASKEW)
UPRIGHT = replace(HINGE, axis_i=Z)
CRANK = (0.2, 0.45, -0.1, 0.84, 0.02, 0.13, 0.53)
MOTOR = "motor"


def spatial_scenes(law: DriveLaw, times: Times) -> Iterator[tuple[str, Scene, Status]]:
    """Yield what is asked about, the scene and its verdict, at some times [s].

    The law is that of the driven angle, from about 1.1 rad on.
    """
    asked = ((about, _in_other_frames(scene)) for about, scene in (*_joints(law, times), *_driven(law, times)))
    yield from ((f"space: {about}", scene, Status.OK) for about, scene in (*asked, *_loops(law, times)))
    link: Any = LOOP.scene(law=law, times=times)
    joints = tuple(replace(j, length=9.0) if j.name == "L" else j for j in link.mechanism.joints)
    apart = replace(link, mechanism=replace(link.mechanism, joints=joints))
    beyond = _boom(Polynomial(coefficients=(1.2, 0.2)), (0.0, 1.0, 2.0, 7.0))
    yield "space: parts that do not meet", apart, Status.UNASSEMBLABLE
    yield "space: driven beyond its limit", beyond, Status.UNASSEMBLABLE


def _in_other_frames(scene: Scene) -> Scene:
    """Return a scene with the frames of its bodies moved and turned, and axes and zeros in them made longer.

    Plain numbers are half unit vectors and half zeros, of which an engine may take one for granted.
    """

    def anew(constraint: Any) -> Any:
        ends = [end for end in "ij" if getattr(constraint, f"body_{end}", GROUND) != GROUND]
        keys = (f"{key}_{end}" for key in ("point", "axis", "zero") for end in ends)
        given = {key: u for key in keys if (u := getattr(constraint, key, None)) is not None}
        return replace(constraint, **{key: _in_frame(u, key.startswith("point")) for key, u in given.items()})

    def moved(body: Body) -> Body:
        assert body.estimate is not None
        at = SPACE.values(*body.estimate)
        r = at.r + at.arm(*ORIGIN).at
        return replace(body, estimate=(*r.parts, *at.p.times(TURN).parts))

    m = scene.mechanism
    bodies, joints, drivers = map(moved, m.bodies), map(anew, m.joints), map(anew, m.drivers)
    return replace(scene, mechanism=Mechanism(tuple(bodies), tuple(joints), tuple(drivers)))


def _in_frame(u: tuple[float, ...], point: bool) -> tuple[float, ...]:
    """Return a point or a direction of a body's frame in the one that is moved and turned."""
    v = Vec3(*u) - Vec3(*ORIGIN) if point else Vec3(*u) * LONGER
    return turned(TURN.conj(), v)[2].parts


def _scene(
    times: Times, poses: Mapping[str, tuple[float, ...]], joints: tuple[Constraint, ...], *drivers: Driver
) -> Scene:
    """Return a scene; poses are rough."""
    bodies = tuple(Body(name=name, estimate=pose) for name, pose in poses.items())
    return Scene(mechanism=Mechanism(bodies, joints, drivers), times=times, name="conformance in space")


def _joints(law: DriveLaw, times: Times) -> Iterator[tuple[str, Scene]]:
    motor = SpatialAngleDriver(name=MOTOR, joint="R1", law=law)
    yield "revolute", _scene(times, {"crank": CRANK}, (HINGE,), motor)
    yield "spherical, a rod that spins as it likes", replace(LOOP, massless=False).scene(law=law, times=times)
    yield "distance", LOOP.scene(law=law, times=times)
    yield "prismatic", RSSP(crank=1.0, rod=3.0, guide=(0.5, 0.5, 0.2), axis=(1.0, 0.2, 0.1)).scene(law=law, times=times)
    yield "cylindrical", RSCR(crank=1.0, coupler=3.0, rocker=2.0, **ROCKER).scene(law=law, times=times)
    hooke = Hooke(beta=0.5).scene(law=law, times=times)
    yield "universal", hooke
    centre = Spherical(name="S", **ends("input", AT, "output", AT))
    pins = Perpendicular(name="pins", body_i="input", axis_i=X, body_j="output", axis_j=Y)
    first, _, last = hooke.mechanism.joints
    yield "perpendicular", replace(hooke, mechanism=replace(hooke.mechanism, joints=(first, centre, pins, last)))
    line = Parallel(name="line", body_i=GROUND, axis_i=last.axis_i, zero_i=X, body_j="output", **FRAME)  # type: ignore[attr-defined]
    joints = (*hooke.mechanism.joints[:2], line)
    yield "parallel", replace(hooke, mechanism=replace(hooke.mechanism, joints=joints))
    at = ends("crank", (0.5, 0.1, 0.2), "tool", (-0.3, 0.2, 0.0))
    weld = SpatialFixed(name="weld", **at, axis_i=(0.0, 0.6, 0.8), zero_i=X, **FRAME)
    carried = {"crank": CRANK, "tool": (0.66, 1.16, 0.05, 0.8, -0.24, -0.04, 0.54)}
    yield "fixed", _scene(times, carried, (HINGE, weld), motor)
    ball = Spherical(name="S", **ends("crank", (0.5, 0.0, 0.0), "rod", (-0.1, 0.0, 0.0)))
    tip = ends(GROUND, (0.0, 0.1, 0.3), "rod", (3.0, 0.0, 0.0))
    poses = {"crank": (0.21, 0.45, 0.0, 0.84, 0.0, 0.0, 0.53), "rod": (0.52, 0.88, 0.0, 0.98, 0.0, 0.0, -0.15)}
    level = Parallel(name="level", body_i=GROUND, axis_i=Z, zero_i=X, body_j="rod", **FRAME)
    wall = PointOnPlane(name="wall", **tip, axis_i=(0.1, 1.0, 0.2))
    yield "point_on_plane", _scene(times, poses, (UPRIGHT, ball, level, wall), motor)
    keel = Perpendicular(name="keel", body_i=GROUND, axis_i=Z, body_j="rod", axis_j=Y)
    rail = SpatialPointOnLine(name="rail", **tip, axis_i=(1.0, 0.1, 0.2))
    poses["rod"] = (0.52, 0.89, 0.03, 0.98, -0.01, -0.16, -0.08)
    yield "point_on_line", _scene(times, poses, (UPRIGHT, ball, keel, rail), motor)


def _driven(law: DriveLaw, times: Times) -> Iterator[tuple[str, Scene]]:
    joint = {"name": "J", **ends(GROUND, (0.2, -0.1, 0.3), "nut", (0.1, 0.0, 0.0)), **ASKEW}
    poses = {"nut": (0.25, -0.15, 0.7, 0.84, 0.02, 0.13, 0.53)}
    turn = SpatialAngleDriver(name=MOTOR, joint="J", law=law)
    lift = Sinusoid(amplitude=0.1, angular_frequency=1.3, phase=0.4, offset=0.35)
    shift = DisplacementDriver(name="lift", joint="J", law=lift)
    screw = Screw(**joint, pitch=0.125, shift=0.25)
    yield "screw", _scene(times, poses, (screw,), turn)
    left_handed = {"nut": (0.25, 0.03, 0.68, 0.84, -0.11, 0.08, -0.53)}
    yield "screw, left-handed, its shift driven", _scene(times, left_handed, (replace(screw, pitch=-0.125),), shift)
    sleeve, slide = Cylindrical(**joint), SpatialPrismatic(**joint)
    yield "cylindrical, both its motions driven", _scene(times, poses, (sleeve,), turn, shift)
    yield "displacement driven", _scene(times, {"nut": (0.2, -0.06, 0.7, 0.99, -0.05, 0.12, -0.01)}, (slide,), shift)
    yield from _geared(law, times)
    yield "distance driven", _boom(replace(lift, offset=1.2), times)
    yield "six distances driven", Stewart.three_three().scene(speed=law(0.0, 1), times=times)


def _geared(law: DriveLaw, times: Times) -> Iterator[tuple[str, Scene]]:
    """Yield bevel wheels on the ground, and a differential: the arm turns, and a sun against it."""
    tilted, rest = (0.6, 0.0, 0.8), (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

    def axle(name: str, i: str, j: str, axis: Any) -> SpatialRevolute:
        along: Any = {f"axis_{end}": axis for end in "ij"} | {f"zero_{end}": Y for end in "ij"}
        return SpatialRevolute(name=name, **ends(i, AT, j, AT), **along)

    def mesh(i: str, radius_i: float, j: str, radius_j: float, **zeros: Any) -> SpatialGear:
        return SpatialGear(name=f"{i} {j}", joint_i=i, radius_i=radius_i, joint_j=j, radius_j=radius_j, **zeros)

    motor = SpatialAngleDriver(name=MOTOR, joint="one", law=law)
    poses = {"wheel": (*AT, 0.85, 0.0, 0.0, 0.53), "pinion": (*AT, 0.89, -0.28, 0.0, -0.37)}
    wheels = axle("one", GROUND, "wheel", Z), axle("two", GROUND, "pinion", tilted)
    bevel = mesh("one", 0.5, "two", 0.25, phi0_i=0.3, phi0_j=0.7)
    yield "gear, bevel wheels", _scene(times, poses, (*wheels, bevel), motor)
    inside = {**poses, "pinion": (*AT, 0.38, 0.55, 0.0, 0.74)}
    yield "gear, internal bevel wheels", _scene(times, inside, (*wheels, replace(bevel, radius_j=-0.25)), motor)
    slow = Polynomial(coefficients=(0.0, 0.5))
    arm = SpatialAngleDriver(name="arm", joint="shaft", law=slow)
    poses = {"arm": rest, "sun": (*AT, 0.85, 0.0, 0.0, 0.53), "planet": (*AT, 0.45, -0.89, 0.0, 0.0)}
    poses |= {"other sun": (*AT, 0.85, 0.0, 0.0, -0.53)}
    axles = axle("one", "arm", "sun", Z), axle("two", "arm", "planet", X), axle("three", "other sun", "arm", Z)
    gears = mesh("two", 0.25, "three", 0.5), mesh("one", 0.5, "two", 0.25)
    yield "gears on an arm", _scene(times, poses, (*gears, axle("shaft", GROUND, "arm", Z), *axles), arm, motor)


def _boom(law: DriveLaw, times: Times) -> Scene:
    """Return an arm on a hinge, which a cylinder of driven length lifts."""
    hinge = replace(HINGE, body_j="boom", point_j=AT, axis_i=(0.1, 1.0, 0.0), zero_i=X)
    at = ends(GROUND, (1.0, 0.0, -0.25), "boom", (1.5, 0.0, 0.0))
    cylinder = SpatialDistanceDriver(name="cylinder", **at, law=law)
    return _scene(times, {"boom": (0.0, 0.0, 0.0, 0.65, -0.68, -0.21, -0.28)}, (hinge,), cylinder)


def _loops(law: DriveLaw, times: Times) -> Iterator[tuple[str, Scene]]:
    yield "more rows than are independent", Bennett(length=1.0, alpha=0.6, beta=1.1).scene(law=law, times=times)
    yield "joints written by dot products", replace(LOOP, form="dot").scene(law=law, times=times)
    yield "joints written by cross products", replace(LOOP, form="printed").scene(law=law, times=times)
    point = Point(name="P", body="crank", position=(0.4, -0.7, 0.3))
    yield "a point of the crank", replace(LOOP.scene(law=law, times=times), points=(point,))
    yield "the other assembly", LOOP.scene(law=law, times=times, branch="crossed")
    plain = LOOP.scene(law=law, times=times)
    m: Any = plain.mechanism
    signs = tuple(replace(b, estimate=(*b.estimate[:3], *(-e for e in b.estimate[3:]))) for b in m.bodies)
    yield "Euler parameters of the other sign", replace(plain, mechanism=replace(m, bodies=signs))
    apart = tuple(replace(j, point_j=(*j.point_j[:2], 0.4)) if j.body_j == "rocker" else j for j in m.joints)
    yield "a frame beside its joints", replace(plain, mechanism=replace(m, joints=apart))
    small = replace(LOOP, crank=1e-3, coupler=3e-3, rocker=2e-3, pivot=(2.5e-3, -5e-4, 7.5e-4))
    yield "millimetres", small.scene(law=law, times=times)
    yield "positions alone", replace(plain, effects=frozenset())
    yield "accelerations alone", replace(plain, effects=frozenset({Effect.ACCELERATION}))
