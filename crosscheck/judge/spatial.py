"""What is compared of an answer in space: coordinates (r, p), the sign of p and passive spins being those of the truth.

p and -p are one pose, so p, p' and p'' of an answer change their sign together wherever p . p_ref is negative. A body
on two spherical joints and nothing else spins about the line of their centres as it likes, and what is fixed to it with
it: each producer ends on a spin of its own. So its answer is turned about that line, and given the rates of spin, that
bring it nearest the truth; what is left of the difference is that of the points on the line, of its direction, and of
their rates; of bodies that spin as one also that of their turns against each other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.passive import Line
from crosscheck.engines.spatial.reading import AXIAL, Hold, Numbers, numbers_of
from crosscheck.engines.spatial.turning import bends, conjugate, parameters, product, rates, spin
from refkin.joints import GROUND, SI, Unit
from refkin.model import Mechanism
from refkin.motion import Motion

Array = Any
Spins = Sequence[dict[str, Line]]


def passive_lines(mechanism: Mechanism, unit: Unit = SI) -> Spins:
    """Return for each passive spin its bodies, with a point of the line and its direction in the frame of each."""
    return _numbers(mechanism, unit).passive


@lru_cache(maxsize=16)
def _numbers(mechanism: Mechanism, unit: Unit) -> Numbers:
    """Return a mechanism as the judge has read it: each engine reads its own."""
    return numbers_of(mechanism, unit)


def alike(levels: Sequence[Array], truth: Sequence[Array], bodies: Sequence[str], spins: Spins) -> list[Array]:
    """Return an answer with signs of p and passive spins as near the truth's as can be.

    Bodies that spin as one are turned by one angle: that which brings the first of them there.

    Parameters
    ----------
    levels, truth : sequence of (7 n, T) array
        Position, and as many rates as the answer has, of the bodies in their order, in one unit and from one origin.
    bodies : sequence of str
        In that order.
    spins : sequence of dict
        As `passive_lines`, in that unit.
    """
    out = [np.array(level, float) for level in levels]
    for spin_of in spins:
        there = [(slice(7 * k, 7 * k + 7), line) for k, line in _members(spin_of, bodies)]
        by = _spin_between(out, truth, there[0][0], there[0][1][1]) if there else []
        for own, line in there:
            parts = list(_respun(out, own, *line, by))  # all of them before any is put in its place
            for level, part in zip(out, parts, strict=True):
                level[own] = part
    for k in range(len(bodies)):
        turn = slice(7 * k + 3, 7 * k + 7)
        sign = np.where(np.sum(out[0][turn] * truth[0][turn], axis=0) < 0.0, -1.0, 1.0)
        for level in out:
            level[turn] *= sign
    return out


def _members(spin_of: dict[str, Line], bodies: Sequence[str]) -> list[tuple[int, Line]]:
    """Return the places among some bodies of those that take part in a spin, with the line in each."""
    return [(bodies.index(body), line) for body, line in spin_of.items() if body in bodies]


def spun(allowed: Array, bodies: Sequence[str], spins: Spins) -> Array:
    """Return allowed errors (7 n, T) in which those of a passive body may be of any of its Euler parameters.

    Errors are carried to a body that spins as the reference's equations hold it, and compared where it spins as the
    truth does, or the first of those that spin as one with it: the one differs from the other by a spin, no larger than
    the errors of these two, which moves all four.

    Parameters
    ----------
    allowed : (7 n, T) array
        In scaled coordinates.
    bodies, spins
        As for `alike`.
    """
    out = allowed.copy()
    for spin_of in spins:
        there = _members(spin_of, bodies)
        for k, (at, line) in there:
            turn = sum(np.sum(allowed[7 * n + 3 : 7 * n + 7], axis=0) for n in {k, there[0][0]})
            out[7 * k + 3 : 7 * k + 7] = turn
            out[7 * k : 7 * k + 3] += 2.0 * float(np.linalg.norm(np.cross(at, line))) * turn
    return out


def _spin_between(out: Sequence[Array], truth: Sequence[Array], own: slice, line: Array) -> list[Array]:
    """Return cosine and sine (T, 2) of half the angle about a line of a body that brings it to the truth, its rates."""
    p, ours = (levels[0][own][3:].T for levels in (out, truth))
    between = product(conjugate(p), ours)  # what turns p into ours, in the body's frame; its part about the line
    about = np.stack([between[:, 0], between[:, 1:] @ line], axis=1)
    by = [about / np.linalg.norm(about, axis=1, keepdims=True)]
    u, wanted = _turned(p, line), [spin(ours, level[own][3:].T) for level in truth[1:]]
    for k, turning in enumerate([spin(p, level[own][3:].T) for level in out[1:]]):
        by.append(np.sum((wanted[k] - turning) * u, axis=1, keepdims=True))
    return by


def _respun(out: Sequence[Array], own: slice, at: Array, line: Array, by: Sequence[Array]) -> Iterator[Array]:
    """Yield the levels (7, T) of a body turned about a line of its own by an angle with rates (`_spin_between`)."""
    r, p = (part.T for part in np.split(out[0][own], [3]))
    turned = product(p, np.concatenate([by[0][:, :1], by[0][:, 1:] * line], axis=1))
    foot = r + _turned(p, at)
    yield np.concatenate([foot - _turned(turned, at), turned], axis=1).T
    if len(out) == 1:
        return
    u = _turned(p, line)
    v, w = out[1][own][:3].T, spin(p, out[1][own][3:].T)
    spun = w + by[1] * u
    arms = _turned(p, at), _turned(turned, at)
    foot_v = v + np.cross(w, arms[0])
    growing = np.sum(p * out[1][own][3:].T, axis=1, keepdims=True)  # the length of p is no spin
    yield np.concatenate([foot_v - np.cross(spun, arms[1]), rates(turned, spun) + growing * turned], axis=1).T
    if len(out) == 2:
        return
    a, alpha = out[2][own][:3].T, spin(p, out[2][own][3:].T)
    bent = alpha + by[1] * np.cross(w, u) + by[2] * u
    foot_a = a + np.cross(alpha, arms[0]) + np.cross(w, np.cross(w, arms[0]))
    origin = foot_a - np.cross(bent, arms[1]) - np.cross(spun, np.cross(spun, arms[1]))
    growing = np.sum(p * out[2][own][3:].T + out[1][own][3:].T ** 2, axis=1, keepdims=True)
    yield np.concatenate([origin, bends(turned, spun, bent) + growing * turned], axis=1).T


def _turned(p: Array, u: Array) -> Array:
    """Return A(p) u (T, 3) for p (T, 4) of length 1."""
    pure = np.broadcast_to(np.concatenate([[0.0], u]), p.shape)
    return product(product(p, pure), conjugate(p))[:, 1:]


def reversed_joints(mechanism: Mechanism, motion: Motion) -> dict[str, Array]:
    """Return name -> at which times (T,) a joint of parallel axes, or a driven angle, is the wrong way round.

    Of joints between bodies that the motion has, or the ground.
    """
    numbers, wrong = _numbers(mechanism, SI), dict[str, Array]()
    turns = {body: motion.q[7 * k + 3 : 7 * k + 7].T for k, body in enumerate(motion.bodies)}
    turns[GROUND] = np.broadcast_to(np.eye(4)[0], (len(motion.t), 4))
    for hold in numbers.holds:
        if hold.kind in AXIAL and turns.keys() >= set(hold.bodies):
            axes = [_turned(turns[body], hold.end(body)[1][:, 2]) for body in hold.bodies]
            wrong[hold.name] = (np.sum(axes[0] * axes[1], axis=1) < 0.0) | wrong.get(hold.name, False)
    for drive in numbers.drives:
        if drive.kind == JointKind.ANGLE and turns.keys() >= set(drive.hold.bodies):
            (i, j), f = drive.hold.bodies, np.asarray(drive.law(motion.t, 0))[:, None]
            frame = drive.hold.frame_i
            wanted = np.cos(f) * _turned(turns[i], frame[:, 0]) + np.sin(f) * _turned(turns[i], frame[:, 1])
            wrong[drive.name] = np.sum(wanted * _turned(turns[j], drive.hold.frame_j[:, 0]), axis=1) < 0.0
    return wrong


def half_angles(mechanism: Mechanism, q: Array) -> list[Array]:
    """Return half the angle (T,) of every joint that counts turns, from poses (7 n, T) of all bodies [m].

    They are coordinates of the equations, of each joint one, however many of its elements are screws. Of a screw its
    shift says which turn it is in, of another joint nothing does: it is in that about 0.
    """
    numbers = _numbers(mechanism, SI)
    at = {body: q[7 * k : 7 * k + 7].T for k, body in enumerate(numbers.bodies)}
    at[GROUND] = np.zeros_like(q[:7].T) + np.eye(7)[3]
    counting = {hold.name: hold for hold in numbers.holds if hold.name in numbers.counted}
    return [_half_angle(hold, at[hold.body_i], at[hold.body_j]) for hold in counting.values()]


def _half_angle(hold: Hold, i: Array, j: Array) -> Array:
    """Return s = atan2(e3, e0), of the Euler parameters e that lead from the frame on body i to that on body j."""
    a, b = (product(x[:, 3:], parameters(f)) for x, f in ((i, hold.frame_i), (j, hold.frame_j)))
    half = np.arctan2(*product(conjugate(a), b).T[[3, 0]])
    if not hold.pitch:
        return half - np.pi * np.round(half / np.pi)
    d = j[:, :3] + _turned(j[:, 3:], hold.u_j) - i[:, :3] - _turned(i[:, 3:], hold.u_i)
    height = np.sum(_turned(i[:, 3:], hold.frame_i[:, 2]) * d, axis=1)
    return half + np.pi * np.round((0.5 * (height - hold.shift) / hold.pitch - half) / np.pi)
