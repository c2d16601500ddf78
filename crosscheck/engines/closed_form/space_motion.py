"""A scene of space in closed form as a `Motion`: coordinates from frames, and what is known of each time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from flint import ctx

from crosscheck.engines import EngineError, EngineRefusal
from crosscheck.engines.closed_form.jets import Balls, Floats, midpoint
from crosscheck.engines.closed_form.space import BETWEEN, NotPlaced, SpatialAssembly
from crosscheck.engines.closed_form.space_vectors import Frame
from crosscheck.engines.march import hermite
from crosscheck.engines.spatial.kinds import JointKind
from crosscheck.engines.spatial.motion import coordinates, reported
from crosscheck.engines.spatial.reading import Hold, numbers_of
from crosscheck.engines.spatial.turning import parameters
from refkin.model import Scene
from refkin.motion import Motion, Producer, Status

BITS = 113
"""Precision of the balls that prove that nothing assembles."""
OPEN = 1e-7
"""Gap of a joint [sizes] above which floats show a fault of this program, or a linkage that does not close."""
GRID, FINER = 33, 4
"""So many times are looked at where a root may vanish between two, and so often again between two of these."""
Array = Any


def space_closed(scene: Scene, producer: Producer) -> Motion:
    """Return the motion of a scene of space; EngineError if its bodies do not follow, or a joint is left open."""
    numbers = numbers_of(scene.mechanism)
    assembly = SpatialAssembly(scene, Floats())
    with np.errstate(all="ignore"):
        try:
            placed = assembly.run()
        except NotPlaced as error:
            raise EngineRefusal(f"closed_form refuses {scene.name!r}: {error}") from error
        status = _statuses(scene, assembly)
        known = np.array([s is Status.OK for s in status])
        levels = coordinates(*_read([placed[name] for name in numbers.bodies], known, len(scene.times)))
    gaps = np.array([_gap(hold, placed, len(scene.times)) for hold in numbers.holds]).max(axis=0)
    if known.any() and not np.max(gaps[known]) < OPEN:
        worst = numbers.holds[int(np.argmax([np.max(_gap(h, placed, len(scene.times))[known]) for h in numbers.holds]))]
        raise EngineError(f"closed_form: {scene.name!r}: {worst.name!r} is left open by {np.max(gaps[known]):.3g}")
    status = tuple(Status.SINGULAR if ok and not good else s for s, ok, good in zip(
        status, known, np.isfinite(np.concatenate(levels)).all(axis=0), strict=True))  # fmt: skip
    return reported(scene, numbers, levels, status, producer, residual=np.where(known, gaps, np.nan))


def _read(frames: list[Frame], known: Array, count: int) -> tuple[Array, Array, Array]:
    """Return origins, Euler parameters and angular rates of bodies, as `coordinates` takes them; NaN where unknown."""
    r = np.full((3, count, len(frames), 3), np.nan)
    p, w = np.full((count, len(frames), 4), np.nan), np.full((2, count, len(frames), 3), np.nan)
    for b, frame in enumerate(frames):
        for k, order in enumerate("vda"):
            r[k, :, b] = frame.origin.part(order, count).T
        a, ad, add = (np.stack([v.part(o, count) for v in (frame.x, frame.y, frame.z)], axis=1) for o in "vda")
        # A' A^T is the matrix of w; of A'' A^T the antisymmetric part is that of alpha
        w[0, :, b] = _vector_of(np.einsum("ikt,jkt->ijt", ad, a))
        w[1, :, b] = _vector_of(np.einsum("ikt,jkt->ijt", add, a))
        there = known & np.isfinite(a).all(axis=(0, 1))
        p[there, b] = parameters(np.moveaxis(a[:, :, there], 2, 0))
    r[:, ~known], w[:, ~known] = np.nan, np.nan
    return r, p, w


def _vector_of(m: Array) -> Array:
    """Return the vectors (T, 3) of the antisymmetric parts of matrices (3, 3, T)."""
    return 0.5 * np.stack([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]], axis=1)


def _statuses(scene: Scene, assembly: SpatialAssembly) -> tuple[Status, ...]:
    """Return what the roots say: no assembly if balls prove it, singular where two meet, lost from then on."""
    count, t = len(scene.times), np.array(scene.times)
    absent, small, unsure = np.zeros((3, count), bool)
    for root in assembly.roots:
        share, rate = (np.broadcast_to(midpoint(part), (count,)) for part in (root.share.v, root.share.d))
        negative, zero = assembly.arithmetic.sign(share, np.ones(count))
        absent, small = absent | negative, small | zero
        unsure |= np.append(_lowest_between(t, share, rate) <= Floats.zero, False)
    first = np.flatnonzero(unsure & ~absent & ~small & ~np.append((absent | small)[1:], False))
    lost_after = next((t[k] for k in first if _meets_zero(scene, assembly, t[k], t[k + 1])), np.inf)
    lost_after = min([lost_after, *t[absent | small][:1]])
    proved = _proved_absent(scene, assembly, absent) if absent.any() else absent
    status = np.where(t > lost_after, Status.BRANCH_LOST, Status.OK)
    status = np.where(small, Status.SINGULAR, status)
    status = np.where(absent, np.where(proved, Status.UNASSEMBLABLE, Status.NOT_CONVERGED), status)
    return tuple(Status(word) for word in status)


def _meets_zero(scene: Scene, assembly: SpatialAssembly, start: float, end: float, halvings: int = FINER) -> bool:
    """Return whether a root may vanish between two times, looked at on finer and finer grids."""
    times = np.linspace(start, end, GRID)
    finer = SpatialAssembly(replace(scene, times=tuple(times.tolist())), Floats(), dict(assembly.choices))
    finer.run()
    for root in finer.roots:
        share, rate = (np.broadcast_to(midpoint(part), (GRID,)) for part in (root.share.v, root.share.d))
        if not (share > Floats.zero).all():
            return True
        for k in np.flatnonzero(_lowest_between(times, share, rate) <= Floats.zero):
            if not halvings or _meets_zero(scene, assembly, times[k], times[k + 1], halvings - 1):
                return True
    return False


def _lowest_between(t: Array, value: Array, rate: Array) -> Array:
    """Return the lowest value of the cubics between times, (T - 1,)."""
    h = np.diff(t)
    cubic = hermite((0.0, 1.0), (value[:-1], value[1:]), (h * rate[:-1], h * rate[1:]), BETWEEN[:, None])
    return cubic.min(axis=0) if len(t) > 1 else np.ones(0)


def _proved_absent(scene: Scene, assembly: SpatialAssembly, absent: Array) -> Array:
    """Return at which of the times `absent` balls prove that a root does not exist; nothing else is known of them."""
    proved = np.zeros(len(absent), bool)
    with ctx.workprec(BITS):
        times = tuple(t for t, there in zip(scene.times, absent, strict=True) if there)
        exact = SpatialAssembly(replace(scene, times=times), Balls(), dict(assembly.choices))
        exact.run()
        squares = [np.broadcast_to(np.asarray(root.square.v, object), (len(times),)) for root in exact.roots]
        proved[absent] = np.any([square < 0 for square in squares], axis=0)
    return proved


def _gap(hold: Hold, placed: dict[str, Frame], count: int) -> Array:
    """Return how far a joint is open at the times, its axes turned round included (T,)."""
    ends = []
    for side, body in zip("ij", hold.bodies, strict=True):
        frame = placed[body]
        origin = frame.origin.part("v", count)
        turned = np.stack([v.part("v", count) for v in (frame.x, frame.y, frame.z)], axis=1)
        u, own = getattr(hold, f"u_{side}"), getattr(hold, f"frame_{side}")
        ends.append((origin + np.einsum("ikt,k->it", turned, u), np.einsum("ikt,kj->ijt", turned, own)))
    (x, axes), (y, other) = ends
    d, h = y - x, axes[:, 2]
    across = np.abs(np.einsum("it,ijt->jt", d, axes[:, :2])).max(axis=0)
    apart = np.abs(d).max(axis=0)
    off = np.linalg.norm(other[:, 2] - h, axis=0)
    errors = {
        JointKind.DISTANCE: lambda: np.abs(np.linalg.norm(d, axis=0) - hold.length),
        JointKind.SPHERICAL: lambda: apart,
        JointKind.UNIVERSAL: lambda: np.maximum(apart, np.abs(np.sum(h * other[:, 2], axis=0))),
        JointKind.PERPENDICULAR: lambda: np.abs(np.sum(h * other[:, 2], axis=0)),
        JointKind.PARALLEL: lambda: off,
        JointKind.ON_PLANE: lambda: np.abs(np.sum(h * d, axis=0)),
        JointKind.ON_LINE: lambda: across,
        JointKind.REVOLUTE: lambda: np.maximum(apart, off),
        JointKind.FIXED: lambda: np.maximum(apart, np.abs(other - axes).max(axis=(0, 1))),
        JointKind.PRISMATIC: lambda: np.maximum(across, np.abs(other - axes).max(axis=(0, 1))),
    }
    return errors.get(hold.kind, lambda: np.maximum(across, off))()
