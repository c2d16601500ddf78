"""What the fast path makes of mechanisms is what it was: programs, sweeps, families with poses lost, large systems.

As in `tests/refkin/test_answers.py`: whoever means a change makes the file anew, `python -m
tests.refkin.fast.test_programs_kept`, and says what changed.
"""

from __future__ import annotations

import json
import zlib
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from refkin.fast import legend, program_of, solve_large, solve_many, sweep
from refkin.model import Evidence
from tests.kept import read, write
from tests.refkin.fast.families import estimates, geometry, grashof, scene
from tests.refkin.fast.linkworks import chain, platform
from tests.refkin.fast.scenes import SCENES
from tests.refkin.test_answers import LEVEL, WEIGHTS, kept

FILE = Path(__file__).with_name("programs.json")


def program(name):
    """Return what a scene's numbers stand for, what its programs say of their parts, and sums of their texts."""
    told = [legend(SCENES[name])]
    for evidence in (frozenset(), frozenset(Evidence)):
        text = str(program_of(replace(SCENES[name], evidence=evidence)))
        told += [[line for line in text.splitlines() if line[:1] == "#"], zlib.crc32(text.encode())]
    return told


def swept(name):
    """Return what is kept of a sweep at all times, and at few ones, far apart."""
    whole = SCENES[name]
    few = replace(whole, times=whole.times[:: max(1, len(whole.times) // 5)])
    some = [kept(sweep(each)) for each in (whole, few)]
    return [[each["said"], each["levels"]] for each in some]


def many(sign, evidence):
    """Return codes and sums of a family, of which some do not assemble and some are lost on the way."""
    lengths = grashof(12, 0.02, seed=3)
    lengths[2, ::3] *= 1.4
    lengths[3, 1::4] *= 0.45
    found = solve_many(replace(scene(24), evidence=evidence), geometry(lengths), estimates(lengths, sign))
    sums = [None if x is None else summed(x) for x in (found.q, found.qd, found.qdd)]
    proved = None if found.radii is None else np.isfinite(found.radii).sum(axis=2).tolist()
    return [found.codes.tolist(), found.unseen, sums, proved, [str(status) for status in found.status(1)]]


def large(made):
    """Return what is kept of a large system."""
    answer = solve_large(made)
    sums = [None if x is None else summed(np.asarray(x)[:, None]) for x in (answer.q, answer.qd, answer.qdd)]
    return [str(answer.status), sums, [float(f"{x:.6g}") for x in (answer.inverse_norm,)], len(answer.steps)]


def summed(level):
    return [float(f"{x:.10g}") for x in np.ravel(np.tensordot(WEIGHTS[: len(level)], np.nan_to_num(level), axes=1))]


MADE = {
    **{f"program: {name}": partial(program, name) for name in SCENES},
    **{f"sweep: {name}": partial(swept, name) for name in SCENES},
    **{f"many: {s}, {len(e)}": partial(many, s, frozenset(e)) for s in (1, -1) for e in ((), (Evidence.CERTIFICATE,))},
    **{f"large: {n}": partial(large, chain(n, times=(0.3,))) for n in (4, 9)},
    "large: at once": partial(large, chain(5, together=True, times=(0.2,))),
    "large: platform": partial(large, platform(times=(0.05,))),
}
KEPT = read(FILE)


@pytest.mark.parametrize("name", KEPT)
def test_what_the_fast_path_makes_is_what_it_was(name):
    same(json.loads(json.dumps(MADE[name]())), KEPT[name])


def same(now, was):
    """Assert that two are the same, numbers within what another processor makes of them."""
    if isinstance(was, list) and was and all(isinstance(x, float) for x in was):
        assert now == pytest.approx(was, rel=0.0, abs=LEVEL * np.nanmax(np.abs([*was, 1e-3])), nan_ok=True)
    elif isinstance(was, list):
        assert len(now) == len(was)
        for pair in zip(now, was, strict=True):
            same(*pair)
    else:
        assert now == was


if __name__ == "__main__":
    write(FILE, {name: made() for name, made in MADE.items()})
