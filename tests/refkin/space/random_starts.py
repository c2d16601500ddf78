"""Linkages of space from estimates drawn at random: what `solve` calls ok has no axis and no crank the wrong way round.

    python -m tests.refkin.space.random_starts --count 143     # of each linkage: 1,001 in each form, 40 minutes in all

An answer is held against the equations of `truth`, by rotation matrices.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import replace

import numpy as np

import refkin
from refkin.scenes.files import to_dict
from refkin.scenes.linkages import RSSP, RSSR, Bennett, Bricard, DoubleHooke, ScrewJack
from tests.refkin.space.truth import Truth, matrix_of

FORMS = ("half", "dot", "printed")
SHAPE = (1.0, 3.0, 2.0, (2.5, -0.5, 0.75), (0.25, 1.0, 0.125))
LINKAGES = {
    "RSSR": lambda form: RSSR(*SHAPE, form=form),
    "RSSR by distance": lambda form: RSSR(*SHAPE, massless=True, form=form),
    "RSSP": lambda form: RSSP(1.0, 3.0, (0.5, 0.25, 0.5), (1.0, 0.5, 0.25), form=form),
    "Bennett": lambda form: Bennett(1.0, 0.7, 1.2, form=form),
    "double Hooke": lambda form: DoubleHooke(0.5, 2.0, form=form),
    "Bricard": lambda form: Bricard(1.0, 1.2, form=form),
    "screw jack": lambda form: ScrewJack(0.1, form=form),
}
CLOSED = 1e-12
"""Largest residual of what is closed, by formulas of its own [m, or of unit vectors]."""


def start(name, form, seed):
    """Return a linkage at an input drawn at random, with estimates drawn at random."""
    random = np.random.default_rng([seed, FORMS.index(form), list(LINKAGES).index(name)])
    value = float(random.uniform(0.2, 1.2) if name == "Bricard" else random.uniform(-3.0, 3.0))
    scene = LINKAGES[name](form).scene(start=value, samples=2, effects=())
    bodies = tuple(replace(body, estimate=tuple(random.normal(size=7).tolist())) for body in scene.mechanism.bodies)
    return replace(scene, mechanism=replace(scene.mechanism, bodies=bodies), times=scene.times[:1])


def wrong(scene, motion):
    """Return what a pose that is called ok violates, by rotation matrices; nothing if it is an assembly."""
    truth = Truth(to_dict(scene))
    rows = truth.rows({b: (motion[b].q[:3, 0].tolist(), matrix_of(motion[b].q[3:, 0])) for b in truth.names}, 0.0)
    return truth.wrong | ({"open"} if max(abs(float(x)) for x in rows) > CLOSED else set())


def campaign(form, names, seeds):
    """Yield, per linkage, how often each status was given, what was wrong of those ok, and the seconds it took."""
    for name in names:
        told, faults, began = Counter(), [], time.process_time()
        for seed in seeds:
            scene = start(name, form, seed)
            motion = refkin.solve(scene)
            told[str(motion.verdict)] += 1
            if motion.verdict is refkin.Status.OK and (off := wrong(scene, motion)):
                faults.append((seed, sorted(off)))
        yield name, dict(told), faults, time.process_time() - began


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=143, help="estimates of each linkage")
    parser.add_argument("--first", type=int, default=0, help="seed of the first estimate")
    parser.add_argument("--form", choices=FORMS, action="append")
    parser.add_argument("--linkage", choices=list(LINKAGES), action="append")
    given = parser.parse_args()
    for form in given.form or FORMS:
        seeds = range(given.first, given.first + given.count)
        for name, told, faults, seconds in campaign(form, given.linkage or LINKAGES, seeds):
            print(f"{form:8} {name:17} {told} wrong: {faults or 'none'} ({seconds:.0f} s)", flush=True)


if __name__ == "__main__":
    main()
