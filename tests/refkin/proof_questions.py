"""What `refkin.proof` is asked about a scene, piece by piece, so that each answer is another one.

Answers are asked at poses that are moved by a little, of boxes and steps of many sizes: what is said of these hangs on
the formulas, not on what rounding has left. What hangs on that is a `Bound`, or is not kept (`tests.kept`).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict
from typing import Any

import numpy as np
from flint import arb, ctx

from refkin.model import Scene
from refkin.proof.numbers import extrema, inputs
from refkin.proof.numbers.bounded import Bounds, Extended, Times, bounded_system, box, read
from refkin.proof.numbers.exact import exact_system
from refkin.proof.numbers.preconditioned import groups_of_rows, independent_rows
from refkin.proof.numbers.recentred import recentred
from refkin.proof.numbers.symbols import Graph, coordinates, substitute
from refkin.proof.path import blocks
from refkin.proof.path.branch import first_unproved, step_over_crossing
from refkin.proof.path.curve import Curve, crossing
from refkin.proof.path.tube import ConnectionProof, Tubes
from refkin.proof.pose.certificate import certify, unique_within
from refkin.proof.pose.choices import isolate_every_choice
from refkin.proof.pose.krawczyk import judge, krawczyk, objects
from refkin.solving.limits import expected_seconds
from refkin.solving.passages import Winding, moving_law, unseen
from refkin.solving.sweep import pose_between
from tests.refkin.asked import (
    MOVED,
    PARTS,
    bounds,
    first_pose,
    moved,
    poses,
    rates_of,
    step_of,
    summed,
    system_of,
    unsigned,
)


def certified(scene: Scene) -> Any:
    """What is proved of poses that are off by much and by little, and how far no other solution is."""
    system, q, t = poses(scene)
    held, rates, said = system.held_at(q), None, []
    with suppress(np.linalg.LinAlgError):
        rates = rates_of(held, q, t)
    for by in (0.0, MOVED, 1e-3, 3e-2):
        levels = () if rates is None else tuple(moved(x, by) for x in rates)
        proof = certify(held, moved(q, by), t, *levels)
        parts = (proof.radii, *(x for x in (proof.velocity, proof.acceleration) if x is not None))
        rows, error = (proof.rows, proof.root.error)
        said.append([proof.ok, rows, [bounds(np.max(x, axis=0)) if not by else summed(x) for x in (*parts, error)]])
    free = unique_within(held, proof.rows, q, t, np.full(len(t), 1e-9))
    levels = () if rates is None else tuple(moved(x) for x in rates)
    for some in ((q, t), (moved(q), t, *levels), (moved(q), t, *levels[:1])):
        proof = isolate_every_choice(system, *some)
        known = [proof.position, proof.velocity, proof.acceleration]
        said.append([proof.ok, proof.bits, [bounds(x) for x in known], bounds(proof.contradiction), proof.why])
    return said, summed(free)


def in_balls(scene: Scene) -> Any:
    """Roots in boxes of several sizes, and what is said of answers that are off."""
    system, q, t = first_pose(scene)
    said = []
    for radius in (1e-9, 1e-3, 3e-2, 0.3):
        box_ = krawczyk(system, moved(q, radius / 3), t, radius=radius)
        said.append(None if box_ is None else [summed(box_.nearest()), summed(box_.radii), box_.rows])
    for bits, by in ((80, MOVED), (113, 1e-3), (200, 0.1)):
        root = krawczyk(system, moved(q, by), t, bits)
        if root is None:
            said.append(None)
            continue
        velocity = root.velocity()
        wide = [max(float(x.rad()) for x in ball) for ball in (root.q, velocity, root.acceleration(velocity))]
        away = list(root.distances(*(moved(x) for x in (q, *rates_of(root.system, q, t)))))
        nearly = root.root(moved(q, by))
        said.append([summed(root.nearest()), summed(root.radii), bounds(wide), away, summed(nearly.shift)])
        allowed = [1e-12, 0.9 * MOVED, MOVED, 2e-6, np.cos(np.arange(len(q))) ** 2 * 1e-5]
        verdicts = [judge(root.q, moved(q), limit) for limit in allowed]
        said.append([(each.verdict, each.radii) for each in verdicts])
        said.append(asdict(judge(tuple(x + arb(0, 1e-6) for x in root.q), moved(q), 1e-6)))
    return said


def numbers(scene: Scene) -> Any:
    """Formulas in other numbers: with bounds, exact, as symbols; frames elsewhere, and what rounding does."""
    system, q, t = first_pose(scene)
    qd, qdd = (moved(np.zeros(len(q)), by) for by in (0.3, 0.2))
    at, times, said = moved(q, 0.1), Times([t], 3), []
    for number, radius, error in ((None, 0.0, None), (None, 1e-2, None), (Extended, 0.0, None), (None, 0.0, 1e-9)):
        more = {} if error is None else {"error": inputs.InputError(error, least=0.5)}
        rough = bounded_system(system, number, **more) if number else bounded_system(system, **more)
        q_, qd_ = (box(x[:, None], radius, number) if number else box(x[:, None], radius) for x in (at, qd))
        for item in (rough.phi(q_, times), rough.phi_q(q_, times), rough.nu(q_, times), rough.gamma(q_, qd_, times)):
            of: Bounds = read(item, 1)
            said.append([summed(of.mid), bounds([np.sum(of.rounding)]), summed(of.spread)])
    with ctx.workprec(113):
        exact, balls, moment = exact_system(system, 113), objects([*map(arb, at.tolist())]), arb(t + 0.01)
        rates = objects([*map(arb, qd.tolist())])
        items = (exact.phi(balls, moment), exact.nu(balls, moment), exact.gamma(balls, rates, moment))
        said.append([summed([float(x) for x in item]) for item in items])
        said.append(summed([float(x) for x in exact.phi_q(balls, moment).ravel()]))
    frames = recentred(system)
    inner = frames.inward(q)
    said.append([summed(frames.shifts), frames.furthest, summed(inner), summed(frames.outward(inner))])
    said.append([summed(frames.inward_rate(inner, qd)), summed(frames.outward_rate(inner, qdd))])
    said.append(summed([float(x) for x in frames.outward(np.array(list(map(arb, inner.tolist()))))]))
    some, one = q[:, None], np.array([t])
    said += [inputs.has_digits(system, some, one), inputs.laws_have_digits(system, np.array([1e3, 1e9, 1e15]))]
    said += [summed(inputs.half_ulp(system, some * 1e9, order)) for order in range(3)]
    said.append(bounds(np.sum(inputs.output_rounding(system, some))))
    said.append(summed(inputs.input_effect(system, some, one, inputs.InputError(1e-6, least=1.0))))
    rows = independent_rows(system, moved(some, 0.1), one)
    said += [rows, [(x, y) for x, y in groups_of_rows(system, np.repeat(moved(some, 0.1), 3, axis=1), np.full(3, t))]]
    return said, symbolic()


def symbolic() -> Any:
    """How expressions are folded, and put into each other."""
    graph = Graph()
    a, c = coordinates(graph, "q", 2)
    b = graph.constant(0.5)
    made = [a / b, -a / b, a / -b, 1.0 / a, abs(-a), abs(abs(a)), abs(b), a - a, a - b, b - a, a * b - c * -1.0]
    made += [-(a - c), (a + b).cos() * -c, 0.0 * a + 1.0 * c, (c / a - a.sin()) * 2.0, a + -c, -a + c, -a * -c]
    known: dict[Any, Any] = {a: graph.constant(0.25), c: a}
    return [[repr(s), repr(substitute(s, dict(known)))] for s in made]


def laws(scene: Scene) -> Any:
    """Where laws turn back, vanish, and hide something."""
    a, b = scene.times[0], scene.times[0] + 3.0 * max(scene.times[-1] - scene.times[0], 1.0)
    own = [law for c in scene.mechanism.constraints for law in c.laws]
    own += [c.profile.law for c in scene.mechanism.joints if hasattr(getattr(c, "profile", None), "law")]
    said: list[Any] = [extrema.extrema_of(scene.mechanism.constraints, a, b), expected_seconds(scene)]
    exact = [law for p in exact_system(system_of(scene), 113).placed for law in p.constraint.laws]
    for law in own:
        for ends in ((a, b), (a - 0.7, a + 0.2), (b - 0.01, b)):
            with suppress(ValueError):
                said.append([extrema.extrema(law, *ends), extrema.zeros(law, *ends), extrema.hides(law, *ends)])
    for law in exact:
        at = [arb(x) for x in (*np.linspace(a, scene.times[-1], 5), a - 3.0, b + 1.5)]
        said.append([[float(law(x, order)) for order in range(3)] for x in (*at, arb(a, 1e-3), arb(a + 0.3, 0.2))])
    return said


def paths(scene: Scene) -> Any:
    """Which steps, short and long ones, are proved to stay on the branch; and what determinants say of them."""
    system, q, t = first_pose(scene)
    whole, said = 4.0 * step_of(scene), []
    for part in PARTS:
        later = t + part * whole
        end = pose_between(system, q, t, later)
        if end is None:
            said.append(None)
            continue
        both, ends = np.stack([q, end], axis=-1), np.array([t, later])
        v, middle = (end - q) / (later - t), (q + end) / 2
        held = system.held_at(q)
        tube = Tubes(held, middle[:, None], v[:, None], [(t + later) / 2], np.array([(later - t) / 2]), 1e-6)
        proof = ConnectionProof(held, 12, pose_between)
        said.append([summed(end), tube.proved, summed(tube.w), proof.connects(t, later, q, end), proof.tried])
        said.append(
            [blocks.dips(held, ends, both), unseen(held, ends, both), step_over_crossing(held, ends, both, [0])]
        )
        if part < 1.0:
            said.append(first_unproved(held, ends, both, pose_between, [0]))
    rows = independent_rows(system, q[:, None], np.array([t]))
    parts = blocks.blocks(system, q, t, rows)
    slope = np.stack([system.phi_q(moved(q, by), t) for by in (0.0, 0.3)], axis=-1)
    said += [len(parts.entries), summed(parts.entries), summed(parts.places), parts.empty.shape]
    said += [summed(x) for x in parts.each_of_batch(slope)]
    moving = moving_law(system, t, t + whole)
    winding = Winding.of(system, q, t)
    turns = None if winding is None else [winding.angle, winding.loops, winding.felt, *winding.tree]
    return said, moving and [moving[0], type(moving[1]).__name__], turns


def curves(scene: Scene) -> Any:
    """The curve of poses: its tangent, steps along it, and where it crosses others."""
    system, q, t = first_pose(scene)
    inner = recentred(system).inner
    curve = Curve.through(inner, q, scene.times[:9])
    x = curve.point(recentred(system).inward(q), t)
    tangent, said = curve.tangent(x), [summed(curve.scale), summed(x)]
    rows = curve.rows(x)
    regular = curve.clearance(x) > 1e-6
    if regular:
        said += [summed(tangent), curve.clearance(x), curve.side(x, tangent, rows), curve.is_locked(x)]
    said.append(summed(curve.bend(x, np.cos(np.arange(len(rows))), rows)))
    for h in (0.01, 0.1, 0.4, 1.6):
        there = curve.stepped(x, tangent, h)
        said.append(None if there is None or not regular else [summed(there), summed(curve.tangent(there, tangent))])
        with suppress(np.linalg.LinAlgError):
            near = crossing(curve, x + h * tangent)
            if near is not None:
                found = [summed(near.x), near.is_bifurcation, near.is_decided, bounds([near.explained])]
                said.append([*found, [unsigned(v) for v in near.tangents]])
    back = curve.corrected(moved(x, 0.02), tangent)
    return said, back.converged, summed(back.q) if regular else None
