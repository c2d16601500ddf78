"""What is asked about the freedoms, assemblies, starts, motions and paths of a scene; and all that is asked."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np
from flint import ctx

from refkin import RefkinError, analysis
from refkin.model import Scene
from refkin.proof.assembly import spatial
from refkin.proof.assembly.assembly import assemblies
from refkin.proof.assembly.closed_form import place
from refkin.proof.assembly.levenberg import least_squares
from refkin.proof.assembly.rigid_groups import plan
from refkin.proof.assembly.rows import read_rows
from refkin.proof.assembly.search import Search
from refkin.proof.numbers.recentred import recentred
from refkin.proof.singularity.diagnosis import diagnose_scaled
from refkin.proof.singularity.second_order import advances, elsewhere
from refkin.solving.follow import Bifurcation, driven_by, follow, straight_on
from refkin.solving.mobility import count, mobility_of, too_many_drivers
from refkin.solving.solve import solve
from refkin.solving.starts import diagnose, find_start
from refkin.solving.sweep import Sweep
from refkin.system import EVERYTHING, System, compile_system
from tests.kept import Bound
from tests.refkin.asked import bounds, first_pose, moved, poses, summed, system_of, unsigned
from tests.refkin.proof_questions import certified, curves, in_balls, laws, numbers, paths


def diagnosed(scene: Scene) -> Any:
    """What the first pose is, and poses moved along what they leave free."""
    system, q, t = poses(scene, most=1)
    said = [said_of(system, q[:, k], t[k]) for k in range(len(t))]
    free = np.linalg.svd(system.phi_q(q[:, 0], t[0]))[2][-1]
    with suppress(RefkinError):
        own = diagnose(scene, system.to_physical(q[:, 0])[: system.of_bodies], float(t[0]))
        said.append([own.kind, own.rows, own.message, diagnose(scene).message])
    return said, advances(system, q[:, 0], t[0], free)


def said_of(system: System, q: Any, t: float) -> Any:
    found = diagnose_scaled(system, q, t)
    kept = [found.kind, found.rows, found.bodies, found.other_driver, found.message]
    sigma = found.sigma if found.sigma > 1e-5 else None
    return [*kept, sigma, sorted(unsigned(v) for v in found.tangents)]


def mobile(scene: Scene) -> Any:
    """Freedoms, by count and by rank, at the first pose and anywhere."""
    system, m = system_of(scene), scene.mechanism
    places = [elsewhere(system, analysis.estimate_of(system, scene))]
    with suppress(ValueError):
        places.append(first_pose(scene)[1])
    counted = count(m)
    said: list[Any] = [asdict(counted), counted.mobility, counted.useful, counted.kind, too_many_drivers(m)]
    for q in places:
        for tolerance in (1e-8, 1e-3, 0.1):
            found = mobility_of(system, q, scene.times[0], tolerance)
            ranks = [
                [r.coordinates, r.rank, r.freedoms, r.kept, [(str(d), dict(d.factors)) for d in r.dependent]]
                for r in (found.joints, found.driven)
            ]
            said.append([found.mobility, found.useful, found.kind, found.passive, ranks])
    return said


def assembled(scene: Scene) -> Any:
    """All assemblies, in closed form and by search; and the proofs that links which are too long do not close."""
    system, said = system_of(scene), []
    for t in (scene.times[0], scene.times[len(scene.times) // 2]):
        for trying in (True, False):
            said.append(all_of(assemblies(system, t, trying)))
    return said, structure(system, scene.times[0])


def all_of(found: Any) -> Any:
    each = sorted(zip(map(summed, found.poses), found.branches, map(Bound, found.radii), strict=True), key=str)
    return [each, found.complete, found.gap, found.message, found.unassemblable, found.searched]


def structure(system: System, t: float) -> Any:
    """How rows are read, in which groups they are put together, and what is placed."""
    with ctx.workprec(113):
        if system.kind.dimension == 3:
            miss = spatial.certain_miss(system, t)
            said = [(row.name, row.kind, row.i, row.j) for row in spatial.point_rows(system, t)]
            return said, miss and [float(miss.gap), miss.words()]
        rows, names = read_rows(system, t, 1e-9), [body.name for body in system.mechanism.bodies]
        read_ = [
            (r.kind, r.i, r.j, r.key_i, r.key_j, None if r.distance is None else float(r.distance), points(r))
            for r in rows.rows
        ]
        angles = [(a.i, a.j, float(a.angle), a.name) for a in rows.relative_angles]
        scheme = plan(rows, names)
        forms = [
            [[(r.form, r.kind, r.first, r.second, r.line_on_b, sorted(r.uses)) for r in c] for c in step.candidates[:2]]
            for step in scheme.steps
        ]
        groups = [[sorted(step.a), sorted(step.b), sorted(step.turning)] for step in scheme.steps]
        steps = forms, groups, [(step.held, step.locates) for step in scheme.steps]
        placed = place(scheme, rows, names, system.unit.size)
        ends = [[float(end.gap.mid()), end.words()] for end in placed.ends]
        branches = sorted([list(b.modes), b.decided] for b in placed.branches)
        summary = [placed.truncated, len(placed.stuck), placed.impossible, scheme.redundant, rows.foreign]
        return read_, angles, steps, sorted(map(sorted, scheme.groups)), branches, ends, summary


def points(row: Any) -> Any:
    return summed([float(x) for v in (row.p, row.q, row.normal) if v for x in (v.x, v.y)])


def sought(scene: Scene) -> Any:
    """What search finds, also where there is a closed form; and least squares."""
    system, t = system_of(scene), scene.times[0]
    with ctx.workprec(113):
        found = (
            Search(system, t, read_rows(system, t), "").run() if system.kind.dimension == 2 else assemblies(system, t)
        )
    start = analysis.estimate_of(system, scene)
    least = least_squares(system, moved(start, 0.5), t)
    return all_of(found), least.status, summed(least.q) if least.converged else None


def torn(scene: Scene) -> Any:
    """The proofs that there is no assembly, with joints one after another put elsewhere."""
    said = []
    for k, joint in enumerate(scene.mechanism.joints[:6]):
        for key in ("point_j", "point_i", "length"):
            if hasattr(joint, key):
                old = getattr(joint, key)
                new = 7.0 * old if key == "length" else tuple(8.0 * x + 3.0 for x in old)
                joints = list(scene.mechanism.joints)
                joints[k] = replace(joint, **{key: new})
                m = replace(scene.mechanism, joints=tuple(joints))
                system = compile_system(m, EVERYTHING, m.unit())
                said.append([joint.name, key, all_of(assemblies(system, scene.times[0], False))])
    return said


def started(scene: Scene) -> Any:
    """Where estimates lead that are near, far, some or all of them not given, or of no use."""
    system, said = system_of(scene), []
    for by, kept in ((0.02, 9), (0.6, 9), (2.5, 9), (1e13, 9), (0.0, 0), (0.3, 1)):
        bodies = [
            replace(b, estimate=tuple(moved(np.array(b.estimate), by).tolist()) if b.estimate and k < kept else None)
            for k, b in enumerate(scene.mechanism.bodies)
        ]
        other = replace(scene, mechanism=replace(scene.mechanism, bodies=tuple(bodies)))
        start = find_start(system, other)
        said.append([start.status, start.message, None if start.q is None else summed(start.q)])
    return said


def swept(scene: Scene, factor: float = 1.0) -> Any:
    """Where steps lead: to the times of a scene, and far beyond, with and without proofs."""
    system, q, t = first_pose(scene)
    inner, span, said = recentred(system).inner, max(scene.times[-1] - t, 0.5), []
    for target in (t + 0.37 * span, t + 2.0 * span, t + factor * 40.0 * span):
        sweep = Sweep(inner, [t], [recentred(system).inward(q)], proving=target < t + span)
        arrival = sweep.to(target)
        reached = arrival.name in ("REACHED", "AT_SINGULAR_POSE")
        said.append([arrival.name, sweep.why, sweep.winds, len(sweep.jumps), summed(sweep.q[-1]) if reached else None])
        said.append([len(sweep.uncertified) > 0, sweep.singular])
    return said


def solved(scene: Scene) -> Any:
    """Motions with steps that are coarse and fine, proved and not, and without evidence."""
    ends, said = np.array(scene.times)[[0, -1]], []
    last = float(ends[1] if len(scene.times) > 1 else ends[0] + 0.5)
    for number, more in ((2, {}), (5, {"certified": True}), (24, {}), (5, {"evidence": frozenset()})):
        times = tuple(np.linspace(ends[0], last, number).tolist())
        evidence = more.pop("evidence", scene.evidence)
        other = replace(scene, times=times, evidence=evidence)
        motion = solve(other, **more)
        levels = [None if level is None else summed(level) for level in motion.levels]
        proved = [Bound(np.nanmax(x)) for x in vars(motion.certified_radius).values() if np.isfinite(x).any()]
        statuses = [(status, list(motion.status).count(status)) for status in dict.fromkeys(motion.status)]
        said.append([statuses, motion.message, levels, proved, summed(motion.condition), summed(motion.sigma_min)])
    return said


def told(path: Any, system: System) -> Any:
    """Return what is said of a path: its end, its events, their poses and what these are."""
    said = [path.end, path.message, path.parameter, [(path.t[k], summed(path.q[:, k])) for k in (-1,) if path.t.size]]
    for event in path.events:
        tangents = [unsigned(v.q) for v in event.tangents] if isinstance(event, Bifurcation) else event.is_maximum
        said.append([type(event).__name__, event.t, summed(event.q), tangents])
        with suppress(ValueError):
            if len(event.q) == system.n:
                said.append(said_of(system, system.to_unit(event.q), event.t))
    return said


def followed(scene: Scene, driver: str = "", way: int = 1, choose: Any = straight_on) -> Any:
    """A path along a scene's time or a driver's value, and what the poses are at which it turns or meets another."""
    given = driven_by(scene, driver) if driver else scene
    at = given.times[0]
    said = []
    for until in ((at - 40.0, at + 40.0), (at - 0.2, at + 0.3), None):
        path = follow(given, until=until, direction=way, choose=choose, max_step=0.25, most_points=300)
        said.append(told(path, system_of(given)))
    for event in path.bifurcations[:1]:
        for tangent in event.tangents[:2]:
            other = follow(given, event, along=tangent, most_points=6, max_step=0.25)
            said.append([other.end, [unsigned(q - event.q) for q in other.q.T[-1:]]])
    middle = min(5, len(path.t) - 1)
    if middle > 0:
        other = follow(given, (path.q[:, middle], path.t[middle]), along=-path.tangents[middle], most_points=4)
        said.append([other.t, bounds([np.nan_to_num(other.radius).max()]), summed(path.tangents[middle].rate)])
    return said


def by_drivers(scene: Scene) -> Any:
    names = [d.name for d in scene.mechanism.drivers]
    return [followed(scene, name, way) for name, way in zip(names[:2], (1, -1), strict=False)]


QUESTIONS: dict[str, Callable[[Scene], Any]] = {
    "certified": certified,
    "in balls": in_balls,
    "numbers": numbers,
    "laws": laws,
    "paths": paths,
    "curves": curves,
    "diagnosed": diagnosed,
    "mobile": mobile,
    "assembled": assembled,
    "sought": sought,
    "torn": torn,
    "started": started,
    "swept": swept,
    "solved": solved,
    "followed": followed,
    "followed back": partial(followed, way=-1, choose=None),
    "by drivers": by_drivers,
}


def answer(question: str, scene: Scene) -> Any:
    """Return an answer, or what is said where there is none."""
    try:
        with np.errstate(all="ignore"):
            return QUESTIONS[question](scene)
    except (RefkinError, ValueError, np.linalg.LinAlgError) as error:
        return [type(error).__name__, str(error)]
