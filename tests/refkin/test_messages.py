"""Every sentence that a solve prints is a claim: here is a scene where each is printed, and one where it is not.

The sentences are read from the sources, so that a new one asks for its two scenes.
"""

from __future__ import annotations

import ast
import math
import re
from dataclasses import replace

import numpy as np
import pytest

import refkin
from refkin import (
    AngleDriver,
    Body,
    Distance,
    DistanceDriver,
    FourBar,
    Mechanism,
    Polynomial,
    Prismatic,
    Scene,
    Sinusoid,
    XDriver,
    YDriver,
)
from refkin.proof.assembly.search import Assemblies
from tests.linkages import ROCKER, with_estimates, with_law
from tests.places import CORPUS, ROOT
from tests.refkin.test_hostile_scenes import peaucellier

SPEAKING = ("solving/sweep", "solving/solve", "solving/starts", "proof/pose/choices")
LONG = 12
"""Characters from which a text is a sentence."""


def scene(name, **changes):
    return replace(refkin.load(CORPUS / f"{name}.toml"), **changes)


def moved(name, law, **changes):
    """A scene of the corpus with another law for its only driver."""
    given = scene(name, **changes)
    return with_law(given, law)


def shaken(frequency):
    law = Sinusoid(amplitude=0.1, angular_frequency=frequency)
    still = AngleDriver(name="phi", body="b", law=Polynomial(coefficients=(0.0,)))
    drivers = (XDriver(name="x", body="b", law=law), YDriver(name="y", body="b", law=law), still)
    body = Body(name="b", estimate=(0.0, 0.0, 0.0))
    return Scene(mechanism=Mechanism((body,), (), drivers), times=(0.0, 1.0))


def parallelogram(*times):
    law = Polynomial(coefficients=(-0.5, 1.0))
    return FourBar(ground=2.0, crank=1.0, coupler=2.0, rocker=1.0).scene(law=law, times=times, branch="open")


def estimated(**estimates):
    """A four-bar with estimates of its own; None is none."""
    given = ROCKER.scene(law=Polynomial(coefficients=(0.5,)), times=(0.0,))
    return with_estimates(given, lambda b: estimates.get(b.name, b.estimate))


def held(*lengths):
    """A point that is so far from (0, 0) and from (2, 0)."""
    rods = tuple(
        Distance(
            name=f"rod {k}", body_i="ground", point_i=(2.0 * k, 0.0), body_j="b", point_j=(0.0, 0.0), length=length
        )
        for k, length in enumerate(lengths)
    )
    still = AngleDriver(name="phi", body="b", law=Polynomial(coefficients=(0.0,)))
    body = Body(name="b", estimate=(1.0, 0.5, 0.0))
    return Scene(mechanism=Mechanism((body,), rods, (still,)), times=(0.0,))


FAST, SLOW = Polynomial(coefficients=(0.3, 1e9)), Polynomial(coefficients=(0.3, 1.0))
FLAT = (-3.7219566330096985 + 1e-9, -1.889041898950115, 0.9445209494750575)
SAID = {
    "gave up at t = {}: the laws turn back {}": (shaken(1e4), shaken(1e2)),
    "more than {} times before t = {}": (shaken(1e4), shaken(1e2)),
    "the branch ends or meets another at a singular pose after t = {}": (
        scene("fast-table-pulse"),
        scene("fast-table-pulse", times=(0.0, 0.2)),
    ),
    "at t = {}, where {}, no pose of the branch is proved to be alone": (
        scene("limit-touched-1e-17"),
        moved("limit-touched-1e-17", Polynomial(coefficients=FLAT)),
    ),
    "gave up at t = {}: a wheel turns by {} rad to t = {}, more than in {} steps": (
        ROCKER.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=(-1e9, 1e9)),
        ROCKER.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=(-1e3, 1e6)),
    ),
    "t has no more digits at t = {}: by its last one a law moves by {} [sizes, rad]": (
        moved("time-resolution", FAST),
        moved("time-resolution", SLOW, times=(0.0, 3e-7, 6e-7)),
    ),
    "t has no more digits: {} at t = {}, next to a time asked for": (
        scene("pulse-in-the-last-digits"),
        scene("fast-table-pulse", times=(0.0, 0.2)),
    ),
    "laws have no digits at t = {}: the last ones move phi by {}": (
        ROCKER.scene(law=Polynomial(coefficients=(0.3, 1e16)), times=(1.0,)),
        ROCKER.scene(law=Polynomial(coefficients=(0.3, 1e14)), times=(1.0,)),
    ),
    "the pose at t = {} is singular: how the branch goes on is not decided": (
        parallelogram(0.0, 0.5, 0.6),
        parallelogram(0.0, 0.4),
    ),
    "at t = {} redundant rows contradict each other in {}: {} times what rounding explains": (
        scene("unassemblable-but-assembled"),
        scene("redundant-one-ulp"),
    ),
    "assembly {} of {}": (estimated(rocker=None), estimated()),
    "no estimate for {}": (estimated(rocker=None), estimated(rocker=(1e20, 0.0, 0.0))),
    "an estimate beyond all digits for {}": (estimated(rocker=(1e20, 0.0, 0.0)), estimated(rocker=None)),
    "{} (gap at least {}, in sizes of {} m or rad)": (held(0.9, 0.9), held(1.2, 1.2)),
}
"""Sentence -> a scene where it is said, and one where it is not."""
ELSEWHERE = {
    "the scene has no first pose: {}": "test_diagnose.py: redundant_rows_that_contradict_each_other",
    "a time in the table of {}": "test_sentences.py: what_cannot_be_diagnosed_or_followed",
    "rates at t = {} are too large for numbers": "test_hostile_scenes.py: rates_beyond_all_numbers",
    "gave up at t = {} after {} steps": "test_sweep.py: a_sweep_that_gives_up_before_a_law_turns_back",
    "no step from t = {} on, however small, is certain to stay on the branch": "test_messages.py: a_step_that_is_never",
    "after t = {} it is not proved on which branch the motion goes on": "test_messages.py: a_branch_that_is_not_proved",
    "the contact of {} leaves its profile after t = {}": "test_contacts.py: profile",
    "{}; poses of some of the redundant rows contradict others: {} times what rounding explains": (
        "space/test_unseen_scenes.py: nothing_starts"
    ),
    "{}: that of the estimate, {} found": "test_messages.py: an_assembly_that_alone_was_found",
    "the nearest of {}": "test_messages.py: an_assembly_that_alone_was_found",
    "redundant rows can be chosen in more than {} ways": "test_hostile_scenes.py: too_many_choices",
    "{}: the bounds cover inverses of a Frobenius norm up to {} / sigma_min of all rows": (
        "test_hostile_scenes.py: too_many_to_certify"
    ),
    "{}: no error bound covers all of them": "test_hostile_scenes.py: too_many_choices",
    "solving {} at {} times": "test_limits.py: a_solve_that_takes_long_says_so",
}
"""Sentence -> the file, and a part of the name, of the test that is about it."""
PAIRS = ((5.0, 30.0, 0.0), (-2.0, 30.0, -2.0), (-2.0, 30.0, 3.0))
FAR = {
    "the estimate was far: {} found an assembly at t = {}": PAIRS,
    "least squares{}": ((0.0, 0.0, 0.0), (-2.0, 1.0, 3.0), (-2.0, 1.0, 4.0)),
    "damped Newton{}": ((1.0, 1.0, 3.0), (40.0, 30.0, 4.0), (0.0, 0.0, -2.0)),
    "{}: less than rounding of the numbers explains": PAIRS,
}
"""Sentence -> estimates of a four-bar at which it is said, if no enumeration finds an assembly."""
NOWHERE = ("no assembly was found at t = {}: {}; {}", "smallest scaled residual {}")
"""Sentences about linkages that do not close, if no enumeration proves it."""


def sentences():
    """Yield the texts with numbers in them, with {} for each number, in the modules that speak."""
    for name in SPEAKING:
        tree = ast.parse((ROOT / "refkin" / f"{name}.py").read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                text = "".join(str(v.value) if isinstance(v, ast.Constant) else "{}" for v in node.values)
                if len(text) > LONG:
                    yield text


def says(motion, sentence):
    parts = [re.escape(part) for part in sentence.split("{}")]
    return re.search(".+?".join(parts), motion.message) is not None


def test_every_sentence_has_its_scenes_or_a_test():
    assert set(sentences()) == {*SAID, *ELSEWHERE, *FAR, *NOWHERE}


@pytest.mark.parametrize("sentence", SAID)
def test_a_sentence_is_said_where_it_holds_and_not_where_it_does_not(sentence):
    true, false = (refkin.solve(given) for given in SAID[sentence])

    assert says(true, sentence), true.message
    assert not says(false, sentence), false.message
    assert false.verdict is refkin.Status.OK


@pytest.mark.parametrize("sentence", ELSEWHERE)
def test_sentences_with_tests_elsewhere_have_them(sentence):
    name, part = ELSEWHERE[sentence].split(": ")
    defined = re.findall(r"^def (\w+)", (ROOT / "tests" / "refkin" / name).read_text(encoding="utf-8"), re.M)

    assert any(part in function for function in defined if function.startswith("test_"))


def test_an_assembly_that_alone_was_found_is_not_said_to_be_nearer_than_itself():
    """Of two links in line both Newton's method and the search find the one assembly, to the root of rounding."""
    alone, among = (refkin.solve(given) for given in (scene("stretched"), peaucellier(0.3, 0)))

    assert says(alone, "that of the estimate, the only one found"), alone.message
    assert says(among, "that of the estimate, the nearest of {} found"), among.message


def test_a_step_that_is_never_certain_is_not_blamed_on_a_singular_pose(monkeypatch):
    given = ROCKER.scene(speed=1.0, turns=0.1, samples=2)
    sentence = "no step from t = {} on, however small, is certain to stay on the branch"
    assert not says(refkin.solve(given), sentence)
    monkeypatch.setattr("refkin.solving.sweep.Sweep._on_branch", lambda *_: False)

    motion = refkin.solve(given)

    assert motion.status[1] is refkin.Status.BRANCH_LOST
    assert says(motion, sentence)


def test_a_branch_that_is_not_proved_is_named_by_the_last_time_up_to_which_it_is(monkeypatch):
    given = ROCKER.scene(law=Polynomial(coefficients=(0.3, 1.0)), times=(0.0, 0.1, 0.2))
    sentence = "after t = {} it is not proved on which branch the motion goes on"
    assert not says(refkin.solve(given, certified=True), sentence)
    monkeypatch.setattr("refkin.solving.sweep.first_unproved", lambda _, t, *rest: len(t) - 2)

    motion = refkin.solve(given, certified=True)

    assert says(motion, sentence)
    assert np.isnan(motion.q[0]).tolist() == [False, False, True]


def test_a_distance_that_goes_through_zero_is_not_said_to_turn_back():
    """Its row does, but the law goes on: that was said of both."""
    rail = Prismatic(name="rail", body_i="ground", point_i=(0, 0), axis_i=(1, 0), body_j="b", point_j=(0, 0), angle=0.0)
    law = Sinusoid(amplitude=0.8, angular_frequency=1.0, phase=math.pi / 2)
    rod = DistanceDriver(name="rod", body_i="ground", point_i=(0, 0), body_j="b", point_j=(0, 0), law=law)
    body = Body(name="b", estimate=(0.8, 0.0, 0.0))
    given = Scene(mechanism=Mechanism((body,), (rail,), (rod,)), times=(0.0, 3.0))

    assert says(refkin.solve(given), "where a distance is zero, no pose")
    assert says(
        refkin.solve(SAID["at t = {}, where {}, no pose of the branch is proved to be alone"][0]),
        "where a law turns back, no pose",
    )


def far(*estimates):
    return estimated(**dict(zip(("crank", "coupler", "rocker"), estimates, strict=True)))


def finding_nothing(gap):
    return lambda system, t, **_: Assemblies(gap=gap, message="nothing was enumerated")


@pytest.mark.parametrize("sentence", FAR)
def test_a_start_that_no_enumeration_reaches_says_what_found_it_and_is_an_assembly(sentence, monkeypatch):
    assert not says(refkin.solve(far(*FAR[sentence])), sentence)
    monkeypatch.setattr("refkin.solving.starts.assemblies", finding_nothing(1e-17 if "rounding" in sentence else None))

    motion, near = refkin.solve(far(*FAR[sentence])), refkin.solve(estimated())

    assert says(motion, sentence), motion.message
    assert motion.verdict is refkin.Status.OK
    assert motion.residual[0] < 1e-14
    assert near.message == ""


def test_how_far_from_an_assembly_all_tries_ended_is_what_is_said(monkeypatch):
    """Two rods of 0.9 whose ends are 2 apart: the smallest residual is that half-way, (1 - 0.9^2) / 1.8 m."""
    for module in ("starts", "solve"):
        monkeypatch.setattr(f"refkin.solving.{module}.assemblies", finding_nothing(None))
    motion, closing = refkin.solve(held(0.9, 0.9)), refkin.solve(held(1.2, 1.2))

    assert all(says(motion, sentence) and not says(closing, sentence) for sentence in NOWHERE), motion.message
    assert motion.verdict is refkin.Status.NOT_CONVERGED
    least = (1.0 - 0.9**2) / 1.8 / held(0.9, 0.9).mechanism.size()
    assert float(motion.message.rpartition("residual ")[2]) == pytest.approx(least, rel=1e-2, abs=0.0)


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        ("compile_system", "mechanism: expected a Mechanism"),
        ("position", "system: expected a System"),
        ("velocity", "system: expected a System"),
        ("acceleration", "system: expected a System"),
        ("solve", "scene: expected a Scene"),
        ("follow", "given: expected a Scene or System"),
        ("diagnose", "given: expected a Scene or System"),
    ],
)
def test_an_argument_of_a_wrong_kind_is_said_with_what_was_expected(call, expected):
    """It ended in an AttributeError of something inside."""
    rest = {"position": (0, 0), "velocity": (0, 0), "acceleration": (0, 0, 0)}.get(call, ())
    with pytest.raises(TypeError, match=f"^{expected}, got a FourBar$"):
        getattr(refkin, call)(ROCKER, *rest)
