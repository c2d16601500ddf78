"""The same motion by other joints and other frames, so that adapters meet more than a textbook's form of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn

from crosscheck.strategies.linkages import COORDINATES, AnyLinkage, longest
from refkin.joints import GROUND, Constraint, Distance, Fixed, Pair, PointOnLine, Prismatic, Revolute
from refkin.scenes.linkages import FourBar, Pose, SliderCrank

Frame = tuple[float, float, float]
"""x, y [m] and angle [rad] of a new body frame in the old one."""
ROD = "connecting_rod"


@dataclass(frozen=True)
class LinkageModel:
    """Joints of a linkage, a pose that assembles them, and the pins a coordinate driver can hold: (body, point)."""

    joints: tuple[Constraint, ...]
    pose: Pose
    pins: Mapping[str, tuple[str, Pair]]


@dataclass(frozen=True)
class Variant:
    """What is changed in a linkage's own joints and frames; `apply` changes it.

    A distance joint replaces the link `massless`, point_on_line a slider ("no slider"), or the crank's pin is in a
    block on the lever ("block"); the body `carrier` has one more fixed to it, at `bracket`. `frames` are bodies' new
    frames, `stretch` is the length of the axes of prismatic and point_on_line joints, and joints that are `swapped`
    have their bodies i and j exchanged.
    """

    massless: str = ""
    sliding: str = ""
    carrier: str = ""
    bracket: Frame = (0.0, 0.0, 0.0)
    frames: Mapping[str, Frame] = field(default_factory=dict)
    stretch: float = 1.0
    swapped: frozenset[str] = frozenset()

    def turned(self, pair: tuple[str, str]) -> float:
        """Return by how much the new frames change the angle of body `pair[0]` against body `pair[1]` [rad]."""
        driven, relative_to = (self.frames.get(body, (0.0, 0.0, 0.0))[2] for body in pair)
        return driven - relative_to

    def apply(self, linkage: AnyLinkage, pose: Pose) -> LinkageModel:
        """Return the model of the linkage in a pose of its own bodies."""
        pins = {"crank": ("crank", (linkage.crank / 2, 0.0)), "slider": ("slider", (0.0, 0.0))}
        model = LinkageModel(linkage.joints(), pose, {body: pin for body, pin in pins.items() if body in pose})
        if self.sliding == "no slider":
            model = _without_slider(model)
        elif self.sliding == "block":
            model = _with_block(model)
        if self.massless:
            model = _without_link(model, self.massless)
        if self.carrier:
            model = _with_bracket(model, self.carrier, self.bracket)
        model = _reframed(model, self.frames, self.stretch)
        return replace(model, joints=tuple(_swap(j) if j.name in self.swapped else j for j in model.joints))


def draw_variant(draw: DrawFn, linkage: AnyLinkage, pose: Pose, held: tuple[str, str]) -> Variant:
    """Draw a variant of a linkage that leaves it the bodies that a driver holds.

    Parameters
    ----------
    draw : callable
        What Hypothesis draws with.
    linkage : Linkage
    pose : mapping
        Body -> (x, y, phi).
    held : (str, str)
        The bodies that a driver holds.
    """
    massless, sliding = draw(st.sampled_from(_structures(linkage, held)), label="structure")
    variant = Variant(massless=massless, sliding=sliding)
    size = longest(linkage)
    if draw(RARELY, label="bracket"):
        carrier = draw(st.sampled_from((GROUND, *variant.apply(linkage, pose).pose)), label="carrier")
        variant = replace(variant, carrier=carrier, bracket=_draw_frame(draw, size, "bracket"))
    model = variant.apply(linkage, pose)
    if draw(st.booleans(), label="other frames"):
        frames = {body: _draw_frame(draw, size, body) for body in model.pose}
        variant = replace(variant, frames=frames, stretch=draw(st.floats(0.25, 4.0), label="length of axes"))
    swapped = draw(SWAPS, label="swapped")
    names = (joint.name for joint, swap in zip(model.joints, swapped, strict=False) if swap)
    return replace(variant, swapped=frozenset(names))


RARELY = st.sampled_from((False,) * 9 + (True,))
FRAMES = st.tuples(COORDINATES, COORDINATES, st.floats(-math.pi, math.pi))
SWAPS = st.just((False,) * 6) | st.tuples(*[st.booleans()] * 6)


def _draw_frame(draw: DrawFn, size: float, body: str) -> Frame:
    x, y, angle = draw(FRAMES, label=f"frame of {body}")
    return x * size, y * size, angle


def _structures(linkage: AnyLinkage, held: tuple[str, str]) -> list[tuple[str, str]]:
    """Return (massless, sliding) for what a linkage can do without; its own structure comes first and most often."""
    if isinstance(linkage, FourBar):
        return [("", "")] * 3 + [(link, "") for link in ("coupler", "rocker", "crank") if link not in held]
    if not isinstance(linkage, SliderCrank):
        return [("", ""), ("", "block")]
    links = [link for link in (ROD, "crank") if link not in held]
    bare = [("", "no slider")] + [("crank", "no slider")] * ("crank" in links)
    return [("", "")] * 3 + [(link, "") for link in links] + bare


def _without_slider(model: LinkageModel) -> LinkageModel:
    joints: Any = model.joints
    a0, a, b, guide = joints
    line: dict[str, Any] = {"body_i": GROUND, "point_i": guide.point_i, "axis_i": guide.axis_i}
    on_guide = PointOnLine(name="guide", **line, body_j=ROD, point_j=b.point_i)
    pose = {body: q for body, q in model.pose.items() if body != "slider"}
    return LinkageModel((a0, a, on_guide), pose, {**model.pins, "slider": (ROD, b.point_i)})


def _with_block(model: LinkageModel) -> LinkageModel:
    joints: Any = model.joints
    a0, b0, a = joints
    pin = Revolute(name="A", body_i=a.body_j, point_i=a.point_j, body_j="block", point_j=(0.0, 0.0))
    line: dict[str, Any] = {"body_i": a.body_i, "point_i": a.point_i, "axis_i": a.axis_i}
    slide = Prismatic(name="slide", **line, body_j="block", point_j=(0.0, 0.0))
    at = _to_ground(model.pose[a.body_j], a.point_j)
    return LinkageModel((a0, b0, pin, slide), {**model.pose, "block": (*at, model.pose[a.body_i][2])}, model.pins)


def _without_link(model: LinkageModel, link: str) -> LinkageModel:
    """Replace a link between two revolutes by a distance joint."""
    ends = [j for j in model.joints if link in j.bodies]
    sides = [[(b, p) for b, p in joint.points()] for joint in ends]
    (body_i, point_i), (body_j, point_j) = (next(s for s in pair if s[0] != link) for pair in sides)
    own = [next(p for b, p in pair if b == link) for pair in sides]
    rod = Distance(
        name=link, body_i=body_i, point_i=point_i, body_j=body_j, point_j=point_j, length=math.dist(own[0], own[1])
    )
    joints = tuple(rod if joint is ends[0] else joint for joint in model.joints if joint is not ends[1])
    pose = {body: q for body, q in model.pose.items() if body != link}
    return LinkageModel(joints, pose, {name: pin for name, pin in model.pins.items() if pin[0] != link})


def _with_bracket(model: LinkageModel, carrier: str, frame: Frame) -> LinkageModel:
    x, y, angle = frame
    held = Fixed(name="bracket", body_i=carrier, point_i=(x, y), body_j="bracket", point_j=(0.0, 0.0), angle=angle)
    q = model.pose.get(carrier, (0.0, 0.0, 0.0))
    pose = {**model.pose, "bracket": (*_to_ground(q, (x, y)), q[2] + angle)}
    return LinkageModel((*model.joints, held), pose, model.pins)


def _reframed(model: LinkageModel, frames: Mapping[str, Frame], stretch: float) -> LinkageModel:
    """Give bodies new frames: points, axes and angles are rewritten, the motion of the bodies stays."""
    pose = {}
    for body, q in model.pose.items():
        x, y, angle = frames.get(body, (0.0, 0.0, 0.0))
        pose[body] = (*_to_ground(q, (x, y)), q[2] + angle)
    pins = {name: (body, _in_frame(frames.get(body), point)) for name, (body, point) in model.pins.items()}
    return LinkageModel(tuple(_in_frames(joint, frames, stretch) for joint in model.joints), pose, pins)


def _in_frames(joint: Any, frames: Mapping[str, Frame], stretch: float) -> Any:
    i, j = (frames.get(body) for body in joint.bodies)
    (_, point_i), (_, point_j) = joint.points()
    keys: dict[str, object] = {"point_i": _in_frame(i, point_i), "point_j": _in_frame(j, point_j)}
    turned_i, turned_j = (frame[2] if frame else 0.0 for frame in (i, j))
    if hasattr(joint, "axis_i"):
        x, y = _turned(joint.axis_i, -turned_i)
        keys["axis_i"] = (x * stretch, y * stretch)
    if hasattr(joint, "angle"):
        keys["angle"] = joint.angle + turned_j - turned_i
    return replace(joint, **keys)


def _swap(joint: Any) -> Any:
    """Exchange bodies i and j of a joint that says the same of both; leave a point on a line, which does not."""
    if hasattr(joint, "axis_i") and not hasattr(joint, "angle"):
        return joint
    (body_i, point_i), (body_j, point_j) = joint.points()
    keys: dict[str, object] = {"body_i": body_j, "point_i": point_j, "body_j": body_i, "point_j": point_i}
    if hasattr(joint, "angle"):
        keys["angle"] = -joint.angle
    if hasattr(joint, "axis_i"):
        keys["axis_i"] = _turned(joint.axis_i, -joint.angle)  # the same line, carried by the other body
    return replace(joint, **keys)


def _turned(u: Pair, angle: float) -> Pair:
    c, s = math.cos(angle), math.sin(angle)
    return c * u[0] - s * u[1], s * u[0] + c * u[1]


def _in_frame(frame: Frame | None, u: Pair) -> Pair:
    """Return a body-fixed point in a new frame of its body."""
    return u if frame is None else _turned((u[0] - frame[0], u[1] - frame[1]), -frame[2])


def _to_ground(q: Frame, u: Pair) -> Pair:
    """Return a body-fixed point in the ground frame."""
    x, y = _turned(u, q[2])
    return q[0] + x, q[1] + y
