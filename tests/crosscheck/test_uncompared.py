"""Where nothing is compared an answer that is called ok has numbers, closed joints, and points on its own bodies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import refkin
from crosscheck.judge.comparison import reference
from crosscheck.judge.records import Cause
from crosscheck.judge.uncompared import unclosed
from crosscheck.measure.check import check
from refkin.motion import Status
from tests.crosscheck.made_up_engines import Made
from tests.crosscheck.test_judgements import some
from tests.refkin.test_answers import files

CORPUS = Path(__file__).parents[1] / "corpus"
OPEN, NUMBERLESS = (("position", cause) for cause in (Cause.UNCLOSED, Cause.NO_NUMBER))
LOST = {
    "limit-touched-1e-17": Status.BRANCH_LOST,
    "crank-over-a-gap": Status.BRANCH_LOST,
    "parallelogram-passed": Status.BRANCH_LOST,
    "space-distance-through-zero": Status.BRANCH_LOST,
    "cam-bump-between-times": Status.BRANCH_LOST,
    "swings-beyond-count": Status.NOT_CONVERGED,
    "unassemblable-but-assembled": Status.LOCKED,
}


def corpus(name):
    return refkin.load(CORPUS / f"{name}.toml")


def at(status, **levels):
    """Return a change of what is said at the times at which the reference has a status: ok, and these numbers."""

    def change(motion):
        here = np.array([s is status for s in motion.status])
        new = {name: np.where(here, level, getattr(motion, name)) for name, level in levels.items()}
        said = [Status.OK if there else s for there, s in zip(here, motion.status, strict=True)]
        return replace(motion, status=tuple(said), **new)

    return change


def found(scene, change, expected, **more):
    """Return what is wrong with the reference's own answer after a change."""
    said = check(scene, [Made("made", change, **more)], {"expected": str(expected)}).disagreements
    return {(d.quantity, d.kind) for d in said if d.method != "rows" and d.kind is not Cause.ORDER}


@pytest.mark.parametrize("name", LOST)
def test_where_the_reference_has_no_motion_joints_are_closed_and_numbers_are_there(name):
    status = LOST[name]

    assert OPEN in found(corpus(name), at(status, q=0.7), status)
    assert NUMBERLESS in found(corpus(name), at(status, q=np.nan), status)


@pytest.mark.parametrize("name", ["crank-over-a-gap", "swings-beyond-count"])
def test_rates_that_are_not_there_are_no_numbers_but_where_there_are_none(name):
    status = LOST[name]
    closed = at(status, q=1.0, qd=np.nan, qdd=np.nan)

    assert ("velocity", Cause.NO_NUMBER) in found(corpus(name), closed, status)
    none = at(Status.SINGULAR, qd=np.nan, qdd=np.nan)
    assert found(corpus("singular-in-the-end"), none, Status.SINGULAR) == set()


def lost(name, status):
    """Return the reference of a scene as if it knew no motion, or no pose either, and its answer, all of it ok."""
    ref = reference(some(refkin.load(files()[name])))
    levels = [level if status is Status.LOCKED else np.full_like(level, np.nan) for level in ref.levels]
    motion, *others = (replace(ref.motion, status=(s,) * len(ref.motion.t)) for s in (Status.OK, status))
    return replace(ref, motion=others[0], levels=tuple(levels), _budgets={}), motion


@pytest.mark.parametrize("status", [Status.LOCKED, Status.BRANCH_LOST])
@pytest.mark.parametrize("name", ["gear", "rack_and_pinion", "cam", "spatial-screw", "slider-turned-1e4-rad"])
def test_a_closed_pose_is_closed_whatever_the_turns_and_whatever_joints_bring(name, status):
    ref, motion = lost(name, status)
    q, turned = motion.q, motion.kind.name == "planar"
    q[2::3] += 2 * np.pi * np.arange(len(motion.bodies))[:, None] * turned
    kinds = [
        [fault["kind"] for fault in unclosed(ref, replace(motion, q=q + off * (np.arange(len(q)) == row)[:, None]))]
        for row in range(len(q))
        for off in (0.0, 1e-9)
    ]

    assert kinds == [[], [Cause.UNCLOSED]] * len(q)


@pytest.mark.parametrize(("bodies", "said"), [(("rocker",), [Cause.UNCLOSED]), (("coupler",), [])])
def test_of_some_bodies_the_joints_among_them_and_with_the_ground_are_asked(bodies, said):
    """A coupler alone has none."""
    scene = replace(corpus("singular-in-the-end"), bodies_wanted=bodies)
    ref, motion = reference(scene), refkin.solve(scene)
    moved = replace(motion, q=motion.q + 1e-9, status=(Status.OK,) * len(motion.t))

    assert [fault["kind"] for fault in unclosed(ref, moved)] == said
