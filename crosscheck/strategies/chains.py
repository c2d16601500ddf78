"""Scenes beyond the three linkages: five-bars, planets, racks, disc cams, six-bars; each assembles by construction.

The cranks of a five-bar are turned by a gear, or by a second driver. Lengths are drawn so that every closure keeps a
margin over a full turn of the input: these scenes are regular, and leave the near-singular ones to the linkages.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from crosscheck.strategies.chain_kinds import KINDS, SIGNS, Frames
from crosscheck.strategies.laws import motion_laws, moved
from crosscheck.strategies.linkages import ANGLES, COORDINATES, ORIGINS, draw_size
from crosscheck.strategies.spans import Binned, check_asked
from refkin.joints import GROUND, AngleDriver
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Sinusoid
from refkin.scenes.linkages import Branch, law_keys, rough


class Chain(Binned):
    """A drawn scene of several loops or contacts: `distance` is their smallest margin, in longest lengths."""


def chains(*, kinds: Collection[str] | None = None, samples: int = 72, **bounds: float) -> SearchStrategy[Chain]:
    """Return scenes of `KINDS` that assemble at all times.

    Examples from this strategy shrink towards a geared five-bar of about one metre at the origin.

    Parameters
    ----------
    kinds : collection of str
        Of `KINDS`; all by default.
    samples : int
        How many times a scene has.
    **bounds : float
        `min_size` and `max_size` of the crank [m].
    """
    asked = KINDS if kinds is None else kinds
    check_asked(samples, kinds=(asked, KINDS))
    return _chains(tuple(kind for kind in KINDS if kind in asked), samples, **bounds)


def geared_linkages(**bounds: Any) -> SearchStrategy[Chain]:
    """Return geared five-bars, some with a second driver for the gear; bounds are those of `chains`."""
    return chains(kinds=["geared five-bar"], **bounds)


def planets(**bounds: Any) -> SearchStrategy[Chain]:
    """Return planets that roll on a wheel at rest and move a coupler and a rocker; bounds are those of `chains`."""
    return chains(kinds=["planet five-bar"], **bounds)


def racks(**bounds: Any) -> SearchStrategy[Chain]:
    """Return slider-cranks whose slider is a rack that turns a pinion; bounds are those of `chains`."""
    return chains(kinds=["rack and pinion"], **bounds)


def cams(**bounds: Any) -> SearchStrategy[Chain]:
    """Return disc cams with followers of every form; bounds are those of `chains`."""
    return chains(kinds=["disc cam"], **bounds)


def six_bars(**bounds: Any) -> SearchStrategy[Chain]:
    """Return crank-rockers whose rocker moves a second dyad; bounds are those of `chains`."""
    return chains(kinds=["six-bar"], **bounds)


@st.composite
def _chains(draw: DrawFn, kinds: tuple[str, ...], samples: int, min_size: float = 1e-2, max_size: float = 1e2) -> Chain:
    kind = draw(st.sampled_from(kinds), label="kind")
    size = draw_size(draw, (min_size, max_size))
    branch = draw(st.sampled_from(Branch), label="branch")
    plan = KINDS[kind](draw, size, 1 if branch is Branch.OPEN else -1)
    first = draw(ANGLES, label="first angle")
    last = first + draw(SIGNS, label="sense") * draw(st.just(math.tau) | st.floats(0.75, 12.5), label="turned")
    duration = 10.0 ** draw(st.floats(-1.0, 1.0), label="decade of the duration")
    law = draw(motion_laws(first=first, last=last, duration=duration))
    times = tuple(np.linspace(0.0, duration, samples).tolist())
    start = plan.poses(float(law(0.0)))
    frames = _draw_frames(draw, tuple(start), size)
    of_frame = moved(law, frames.apart(GROUND, plan.driven))
    joints, drivers = plan.joints(frames), [AngleDriver(name="driver", body=plan.driven, **law_keys(of_frame))]
    if kind == "geared five-bar" and draw(st.booleans(), label="a motor for the gear"):
        joints = [joint for joint in joints if joint.name != "mesh"]
        drivers.append(_draw_second(draw, start["second"][1] + frames.apart(GROUND, "second"), duration))
        kind = "five-bar with two drivers"
    pose = {body: frames.on_ground(place, body) for body, place in start.items()}
    bodies = tuple(Body(name=name, estimate=q) for name, q in rough(pose, plan.longest, plan.margin).items())
    mechanism = Mechanism(bodies, tuple(joints), tuple(drivers))
    scene = Scene(mechanism=mechanism, times=times, name=f"{kind} {branch}, {drivers[0].type} driver")
    return Chain(scene, kind, branch, plan.margin / plan.longest)


def _draw_second(draw: DrawFn, begin: float, duration: float) -> AngleDriver:
    """Draw a second crank's own wave from an angle on: a five-bar's couplers meet whatever its cranks do."""
    amplitude, phase = draw(st.floats(0.25, 3.0), label="amplitude"), draw(ANGLES, label="phase")
    frequency = math.tau * draw(st.floats(0.25, 2.0), label="waves") / duration
    wave = Sinusoid(amplitude=amplitude, angular_frequency=frequency, phase=phase, offset=begin)
    law = replace(wave, offset=2.0 * begin - float(wave(0.0)))
    return AngleDriver(name="second driver", body="second", law=law)


def _draw_frames(draw: DrawFn, bodies: tuple[str, ...], size: float) -> Frames:
    x, y = draw(ORIGINS, label="origin")
    own: dict[str, tuple[complex, float]] = {body: (0j, 0.0) for body in bodies}
    if draw(st.booleans(), label="other frames"):
        frame = st.tuples(COORDINATES, COORDINATES, ANGLES)
        for body in bodies:
            u, v, angle = draw(frame, label=f"frame of {body}")
            own[body] = (size * complex(u, v), angle)
    return Frames(10.0 * size * complex(x, y), draw(ANGLES, label="angle"), own)
