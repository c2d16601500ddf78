"""`crosscheck conform` says in words what an engine gets wrong: which joint, which level, which promise."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import refkin
from crosscheck.commands.replay import lines
from crosscheck.engines import ELEMENTS, NATIVE, EngineError, EngineRefusal, Level
from crosscheck.engines.closed_form.engine import ClosedForm
from crosscheck.engines.loading import load
from crosscheck.judge.known_gaps import HardOutcome
from crosscheck.judge.records import Cause, Disagreement, Record
from crosscheck.measure.check import check
from crosscheck.measure.conform import LevelFault, Reply, _faults_of, ask, hard_replies, replies, summary
from crosscheck.measure.hard_table import outcome_of
from crosscheck.scenes.conformance import questions
from crosscheck.scenes.hard import hard_cases
from refkin.joints import DRIVER_TYPES, JOINT_TYPES, SPATIAL_DRIVER_TYPES, SPATIAL_JOINT_TYPES
from tests.places import ROOT

from .fake_engines import HANG, SEGFAULT, engine_file
from .hard_engines import Claims, Own, Right, Stale, Swapped

OWN = f"{ROOT / 'examples' / 'own_engine.py'}:TwoCircles"
ASKED = {question.about: question for question in questions()}
CHANGED = """m = scene.mechanism
        scene = replace(scene, mechanism=replace(m, joints=tuple(
            replace(j, {keys}) if j.type == {type!r} else j for j in m.joints), drivers=tuple(
            replace(j, {keys}) if j.type == {type!r} else j for j in m.drivers)))"""
"""Solves another scene: all joints of a type are taken for others."""


def changed(kind: str, **keys: str) -> str:
    return CHANGED.format(type=kind, keys=", ".join(f"{key}={value}" for key, value in keys.items()))


def told(spec: str, *about: str) -> str:
    """Return what is said of an engine that is asked some questions in this process."""
    engine = load(spec)
    return "\n".join(lines([ask(engine, ASKED[name]) for name in about or ASKED]))


def test_every_joint_driver_and_status_is_asked_and_the_reference_answers_as_expected():
    asked = [c for q in ASKED.values() for c in (*q.scene.mechanism.joints, *q.scene.mechanism.drivers)]
    profiles = {(j.follower, j.profile.kind) for j in asked if j.type == "cam"}
    planar, spatial = (*JOINT_TYPES, *DRIVER_TYPES), (*SPATIAL_JOINT_TYPES, *SPATIAL_DRIVER_TYPES)

    assert {type(c) for c in asked} == {*planar, *spatial}
    assert profiles == {(f, p) for f in ("flat", "point", "roller") for p in ("disc", "polar")}
    for question in ASKED.values():
        motion = refkin.solve(question.scene)
        assert motion.verdict == question.expected, question.about
        assert question.expected == "ok" or not np.isfinite(motion.q[0, -1])
        assert "more than one assembly" not in motion.message
        assert "the estimate alone" not in motion.message


def test_an_engine_that_answers_all_right_is_told_nothing(tmp_path):
    """The reference itself, in the guise of an engine, at some of the questions."""
    some = list(ASKED)[::5]
    said = told(engine_file(tmp_path), *some)

    assert said == f"{len(some)} of {len(some)} questions answered, 0 refused, 0 wrong"


def test_the_example_is_right_where_it_answers_and_says_what_it_refuses(command, monkeypatch):
    some = ("revolute", "gear", "internal gear", "law: table", SPHERICAL)
    monkeypatch.setattr("crosscheck.commands.replay.hard_replies", lambda spec: iter(()))
    monkeypatch.setattr("crosscheck.measure.conform._asked", lambda: {about: ASKED[about] for about in some})
    code, shown, _ = command("conform", OWN)

    assert code == 0
    assert "WRONG" not in shown
    assert "refused (3 questions): no such element in this engine: rolling wheels, points of space coincide" in shown
    assert shown.splitlines()[-1].endswith(" refused, 0 wrong")


def test_what_is_not_compared_of_a_question_that_is_answered_is_said(tmp_path):
    silent = engine_file(tmp_path, after="motion = replace(motion, points={})")
    said = told(silent, "revolute", "points of two bodies")

    assert said.splitlines() == [
        "not compared (1 question): fake (made up) gives no motion of points: they are not compared",
        "2 of 2 questions answered, 0 refused, 0 wrong",
    ]


SPHERICAL = "space: spherical, a rod that spins as it likes"
WRONG_JOINTS = {
    "prismatic": (changed("prismatic", angle="j.angle + 1e-9"), "prismatic"),
    "gear": (changed("gear", radius_j="j.radius_j * (1 + 1e-9)"), "internal gear"),
    "distance": (changed("distance", length="j.length + 1e-9"), "distance"),
    "cam": (changed("cam", point_i="(j.point_i[0], j.point_i[1] + 1e-9)"), "cam: point on a disc"),
    "screw": (changed("screw", pitch="j.pitch + 1e-9"), "space: screw"),
    "displacement": (
        changed("displacement", law="replace(j.law, offset=j.law.offset + 1e-9)"),
        "space: displacement driven",
    ),
    "x": (changed("x", point="(j.point[0], j.point[1] + 1e-9)"), "x of a point driven"),
}


@pytest.mark.parametrize("kind", WRONG_JOINTS)
def test_an_engine_with_one_wrong_joint_is_told_which(kind, tmp_path):
    before, about = WRONG_JOINTS[kind]
    said = told(engine_file(tmp_path, before=before), "revolute", about)

    assert f"WRONG: position is wrong (method 'made up'): {kind}\n    asked about {about}\n" in said
    assert f"every answer with a wrong number violates a {kind}\n" in said
    assert "2 of 2 questions answered, 0 refused, 1 wrong" in said


LONG = "np.linalg.norm(j.{})"
FRAME = {"axis_j": "(0.0, 0.0, 1.0)", "zero_j": "(1.0, 0.0, 0.0)"}
AS_LONG = {"s0": f"j.s0 / {LONG.format('axis_i')}", "radius": f"j.radius / {LONG.format('axis_i')}"}
DISC = f"replace(j.profile, radius=j.profile.radius / {LONG.format('normal_j')})"
BY_RATE = {
    **{"x of a point driven": "x", "y of a point driven": "y", "distance driven": "distance"},
    **{"space: revolute": "angle", "space: displacement driven": "displacement", "space: distance driven": "distance"},
}
GRANTED = {
    "cam: point on a profile": changed("cam", point_j="(0.0, 0.0)"),
    "cam: flat on a profile": changed("cam", normal_j="(0.0, 1.0)"),
    "cam: flat on a disc": changed("cam", profile=DISC),
    "rack_and_pinion": changed("rack_and_pinion", **AS_LONG),
    "rack on the other side": changed("rack_and_pinion", radius="abs(j.radius)"),
    "gear on a carrier": changed("gear", radius_i="abs(j.radius_i)"),
    "space: gear, internal bevel wheels": changed("gear", radius_j="abs(j.radius_j)"),
    **{f"{about}, by a rate": changed(kind, initial="0.0") for about, kind in BY_RATE.items()},
    "law: table": changed("angle", law="replace(j.law, argument=tuple(np.linspace(-1.0, 3.0, 6).tolist()))"),
    "law: periodic table": changed("angle", law="replace(j.law, argument=(0.0, 0.3, 0.5, 1.3), periodic=False)"),
    "space: revolute": changed("revolute", **FRAME),
    "space: prismatic": changed("prismatic", **FRAME),
    "space: cylindrical": changed("cylindrical", **FRAME),
    "space: fixed": changed("fixed", **FRAME),
    "space: screw": changed("screw", point_i="(0.0, 0.0, 0.0)"),
    "space: screw, left-handed, its shift driven": changed("screw", pitch="abs(j.pitch)"),
    "space: universal": changed("universal", axis_i="(1.0, 0.0, 0.0)", axis_j="(0.0, 1.0, 0.0)"),
    "space: perpendicular": changed("perpendicular", axis_i="(1.0, 0.0, 0.0)", axis_j="(0.0, 1.0, 0.0)"),
    "space: parallel": changed("universal", point_i="(0.0, 0.0, 0.0)", point_j="(0.0, 0.0, 0.0)"),
}
"""What an engine may take for granted: numbers of plain scenes are zeros and unit vectors."""


@pytest.mark.parametrize("about", GRANTED)
def test_an_engine_that_takes_for_granted_what_plain_scenes_have_is_told(about, tmp_path):
    (fault,) = ask(load(engine_file(tmp_path, before=GRANTED[about])), ASKED[about]).faults

    assert fault.what.split(" (")[0] in ("position is wrong", "no answer")  # and no error


@pytest.mark.parametrize("rate", ["velocity", "acceleration"])
def test_an_engine_that_gives_a_rate_right_beside_the_other_alone_is_told(rate, tmp_path):
    level = {"velocity": "qd", "acceleration": "qdd"}[rate]
    alone = f"motion = motion if len(scene.effects) > 1 or motion.{level} is None else"
    spec = engine_file(tmp_path, after=f"{alone} replace(motion, {level}=motion.{level} + 1e-3)")
    names = [about for about in ASKED if about.endswith("s alone")]

    assert f"WRONG: {rate} is wrong" in told(spec, *names)


@pytest.mark.parametrize(
    ("after", "said"),
    [
        ("motion = replace(motion, qdd=motion.qdd * (1 + 1e-9))", "WRONG: acceleration is wrong (method 'made up')"),
        ("motion = replace(motion, qd=motion.qd * (1 + 1e-9))", "WRONG: velocity is wrong (method 'made up')"),
        ("motion = replace(motion, qd=None)", "WRONG: velocity is not delivered at any time (method 'made up')"),
        (
            "motion = replace(motion, bodies=motion.bodies[:1], q=motion.q[:3], qd=motion.qd[:3], qdd=motion.qdd[:3])",
            "WRONG: position is no answer for coupler, rocker (method 'made up')",
        ),
        ("motion = replace(motion, q=motion.q[:, :-1])", "WRONG: q has shape (9, 6), not (9, 7): 3 rows a body"),
        ("motion = motion.q", "WRONG: expected a refkin.motion.Motion, got ndarray (method 'made up')"),
    ],
    ids=["acceleration", "velocity", "no velocity", "one body", "shape", "no motion"],
)
def test_an_engine_with_one_wrong_level_is_told_which(after, said, tmp_path):
    shown = told(engine_file(tmp_path, after=after), "revolute")

    assert said in shown
    assert shown.count("WRONG") == 1


def test_a_level_that_is_wrong_whatever_the_joint_is_told_as_such(tmp_path):
    spec = engine_file(tmp_path, after="motion = replace(motion, qdd=motion.qdd * (1 + 1e-9))")
    asked = [ask(load(spec), ASKED[name]) for name in ("revolute", "prismatic", "gear")]

    assert summary(asked)[-1] == (
        "whatever the joint, numbers are right up to the acceleration, which is the first that is wrong"
    )


def test_an_engine_that_lies_about_its_status_is_told_where(tmp_path):
    numbers = ", ".join(f"{level}=np.nan_to_num(motion.{level})" for level in ("q", "qd", "qdd"))
    lying = f"motion = replace(motion, status=(Status.OK,) * len(motion.t), {numbers})"
    said = told(engine_file(tmp_path, after=lying), "revolute", "parts that do not meet", "driven beyond its limit")

    assert "ok where there is no assembly (method 'made up')" in said
    assert "asked about parts that do not meet; driven beyond its limit" in said
    assert "1 of 1" not in said
    assert said.endswith("3 of 3 questions answered, 0 refused, 2 wrong")


def test_an_engine_that_depends_on_the_order_of_bodies_is_told_so(tmp_path):
    """It takes the first body for the crank."""
    ordered = "motion = motion if scene.mechanism.bodies[0].name == 'crank' else replace(motion, q=motion.q + 1e-9)"
    said = told(engine_file(tmp_path, after=ordered), "revolute", "law: table", "law: polynomial")

    assert "position depends on how a scene is stated (method 'made up')" in said
    assert "3 wrong" in said


@pytest.mark.parametrize("error", [EngineRefusal, EngineError, ValueError])
def test_an_engine_that_answers_no_scene_that_is_stated_otherwise_is_told_so(error):
    """It was told nothing where it refused, and that numbers depend on the order where it failed."""

    class Once(Right):
        def change(self, motion):
            self.first = vars(self).get("first", [*motion.bodies])
            if [*motion.bodies] == self.first:
                return motion
            raise error("by the test")

    (fault,), (other,) = (ask(Once(), ASKED[about]).faults for about in ("law: table", "revolute"))

    assert fault.what == "no answer where a scene is stated otherwise (method 'planted')"
    assert "by the test" in fault.example
    assert "by the test" in other.example  # of one scene in four it is asked as a night asks


@pytest.mark.parametrize("silent", [False, True])
@pytest.mark.parametrize("right", [lambda count: count == 1, lambda count: count % 2 == 1], ids=["once", "every other"])
def test_an_engine_that_answers_otherwise_when_asked_again_is_not_said_to_mind_the_statement(right, silent):
    """A night told the two apart, and this did not."""

    class Again(Right):
        count = 0

        def change(self, motion):
            self.count += 1
            if silent and not right(self.count):
                raise EngineError("by the test")
            return motion if right(self.count) else replace(motion, q=motion.q + 1e-6)

    (fault,) = ask(Again(), ASKED["law: table"]).faults

    assert fault.what == f"{'no answer' if silent else 'position differs'} when asked again (method 'planted')"


@pytest.mark.parametrize("k", range(3))
def test_euler_parameters_that_are_too_long_are_told_of_any_body_also_of_one_that_spins(k):
    class Longer(Right):
        def change(self, motion):
            q = motion.q.copy()
            q[7 * k + 3 : 7 * k + 7] *= 1.0 + 1e-6
            return replace(motion, q=q)

        def capabilities(self):
            return {key: dict.fromkeys(Level, NATIVE) for key in ELEMENTS}

    reply = ask(Longer(), ASKED[SPHERICAL])

    assert ["unit_length" in fault.types for fault in reply.faults] == [True]


def test_an_equality_that_no_joint_can_move_is_no_failure_of_mujoco():
    """Both shafts of a Hooke joint turn about the point that it holds together: MuJoCo leaves its rows out."""
    assert told("mujoco", "space: universal") == "1 of 1 questions answered, 0 refused, 0 wrong"


def test_what_an_engine_refuses_of_a_whole_scene_is_told_and_is_no_fault():
    class Refuses(ClosedForm):
        def solve(self, scene, route=None):
            raise EngineRefusal("not on Sundays")

    reply = ask(Refuses(), next(iter(ASKED.values())))

    assert (reply.refusals, reply.faults, reply.levels) == (("not on Sundays",), (), ())


def test_a_refusal_without_a_reason_is_told_all_the_same():
    assert str(EngineRefusal("")) == str(EngineRefusal()) == "it gave no reason"


def test_what_violates_no_joint_has_nothing_in_common_with_what_does():
    """Of a mirror assembly nothing is violated: a cam beside it is not what all wrong answers violate."""
    cam = LevelFault("position", "position is wrong", types=("cam",))
    mirror = LevelFault("position", "position is another assembly")

    assert summary([Reply("cam", (cam,))]) == ["every answer with a wrong number violates a cam"]
    assert summary([Reply("cam", (cam,)), Reply("four-bar", (mirror,))]) == []


def test_of_each_method_the_first_level_that_is_beyond_is_told_and_every_fault_of_status_and_rows():
    scene = next(iter(ASKED.values())).scene
    seen = [
        ("a", "position", Cause.BEYOND),
        ("a", "velocity", Cause.BEYOND),
        ("b", "velocity", Cause.BEYOND),
        ("b", "acceleration", Cause.NOT_DELIVERED),
        ("b", "status", Cause.NO_ANSWER),
        ("rows", "jacobian", Cause.TRANSLATED),
    ]
    wrong = [Disagreement(engine="own", method=method, quantity=quantity, kind=kind) for method, quantity, kind in seen]
    nothing = {"answers": [], "levels": [], "refusals": [], "about": {}}
    record = Record(key=16 * "0", scene="any", disagreements=wrong, **nothing)

    levels = ["position", "velocity", "acceleration", "status", "own rows"]
    assert [fault.level for fault in _faults_of(record, scene)] == levels


def test_an_engine_that_crashes_or_hangs_at_a_question_is_asked_the_next(tmp_path, monkeypatch):
    monkeypatch.setattr("crosscheck.measure.conform.SECONDS", 4.0)
    monkeypatch.setattr(
        "crosscheck.measure.conform._asked", lambda: {k: ASKED[k] for k in ("fixed", "gear", "distance")}
    )
    at = "if any(j.type == {!r} for j in scene.mechanism.joints): {}"
    spec = engine_file(tmp_path, before=at.format("fixed", SEGFAULT) + "\n        " + at.format("gear", HANG))
    fixed, gear, distance = replies(spec)

    assert fixed.faults[0].what == "crash"
    assert gear.faults[0].what == "hang"
    assert distance.faults == ()


def test_an_engine_that_hangs_again_and_again_is_asked_no_more(tmp_path, monkeypatch):
    """At a minute a question it would take an hour."""
    monkeypatch.setattr("crosscheck.measure.conform.SECONDS", 3.0)
    monkeypatch.setattr("crosscheck.measure.conform.MOST_HUNG", 1)
    monkeypatch.setattr("crosscheck.measure.conform._asked", lambda: {k: ASKED[k] for k in ("fixed", "gear")})
    fixed, gear = replies(engine_file(tmp_path, before=HANG))

    assert fixed.faults[0].what == "hang"
    assert gear.refusals == ("it was not asked: it hung at 1 questions",)


def test_an_engine_that_answers_a_scene_as_the_one_before_it_is_told(tmp_path, monkeypatch):
    """Each question was asked of an engine that was made anew: what one keeps of a scene was never seen."""
    asked = ("law: polynomial", "law: rate")
    monkeypatch.setattr("crosscheck.measure.conform._asked", lambda: {k: ASKED[k] for k in asked})
    kept = "scene = replace(self.__dict__.setdefault(str(len(scene.times)), scene), effects=scene.effects)"
    first, second = replies(engine_file(tmp_path, before=kept))

    assert first.faults == ()
    assert second.faults[0].what == "position is wrong (method 'made up')"


@pytest.mark.parametrize("before", range(3))
def test_a_model_is_asked_again_because_such_a_one_is_priced(before):
    """Its third answer alone was looked at: positions alone, and what it is asked first, could be anything."""
    right = (0.0,) * before
    (fault,) = ask(Stale(*right, 1e-3), ASKED["revolute"]).faults
    (lost,) = ask(Stale(*right, np.nan), ASKED["revolute"]).faults

    assert lost.what == "no answer where its model is asked again (method 'planted')"
    assert fault.what == "position is wrong where its model is asked again (method 'planted')"
    assert ask(load("mujoco"), ASKED["fixed"]).faults == ()


@pytest.mark.parametrize("asked_first", [0, 1])
def test_a_model_that_cannot_be_built_or_asked_again_gives_no_answer(asked_first):
    def refusing(scene, route=None):
        calls = iter([engine.solve] * asked_first)

        def solve(scene):
            for answer in calls:
                return answer(scene)
            raise EngineError("asked once is enough")

        return SimpleNamespace(solve=solve)

    engine = Stale()
    engine.model = refusing
    (fault,) = ask(engine, ASKED["revolute"]).faults

    assert fault.what == "no answer where its model is asked again (method 'planted')"
    assert fault.example == "asked once is enough"


def test_a_model_is_asked_again_for_no_more_than_its_method_gives():
    """One of positions alone that raised where it was asked for rates was told as one that gives no answer."""

    def build(scene):
        def solve(order):
            if order:
                raise EngineError("positions alone")
            return model.solve(order)

        model = right.build(scene)
        return replace(model, solve=solve)

    engine = Own()
    right, _ = engine.methods()
    engine.methods = lambda: [replace(right, highest=0, build=build)]
    assert ask(engine, ASKED["revolute"]).faults == ()


def test_points_are_asked_for_of_the_plane_and_of_space():
    (fault,) = ask(Swapped(), ASKED["points of two bodies"]).faults

    assert fault.level == "position"
    assert len(ASKED["space: a point of the crank"].scene.points) == 1


def test_what_an_engine_says_that_it_adds_makes_no_pose_right_at_a_hard_case():
    """Nor where the certificate judges: only what is granted in a comparison is granted there."""
    case = next(c for c in hard_cases() if c.case == "toggle")
    spec = f"{ROOT / 'tests' / 'crosscheck' / 'hard_engines.py'}:Claims"
    record = check(ASKED["revolute"].scene, [Claims()], arbiter=True)

    assert outcome_of((spec, "planted", "", case.key))[0] == HardOutcome.WRONG
    assert [(a.certificate.inside, a.certificate.outside) for a in record.answers] == [(0, 7)]


def test_hard_cases_are_asked_and_what_is_wrong_there_is_told(tmp_path):
    shifted = engine_file(tmp_path, after="motion = replace(motion, q=motion.q + 1e-6)")
    asked = list(hard_replies(shifted, within=10.0))

    assert len(asked) >= 10
    assert any("a wrong pose is called ok at a hard case" in f.what for reply in asked for f in reply.faults)


def test_an_engine_of_the_plane_is_asked_no_hard_case_of_space():
    """Its capability table says so: it need not look itself."""
    case = next(c for c in hard_cases() if c.scene.mechanism.kind.name == "spatial")
    verdict, note = outcome_of((OWN, "two circles", "", case.key))

    assert verdict == HardOutcome.REFUSED
    assert "no such element in this engine" in note


def test_an_engine_that_is_not_there_is_named_and_one_that_answers_nothing_passes_nothing(
    tmp_path, command, monkeypatch
):
    monkeypatch.setattr("crosscheck.commands.replay.hard_replies", lambda spec: iter(()))
    monkeypatch.setattr("crosscheck.measure.conform._asked", lambda: {"fixed": ASKED["fixed"]})
    refuses = engine_file(
        tmp_path, name="no", before="raise __import__('crosscheck.engines').engines.EngineRefusal('never')"
    )
    told = [command("conform", spec, "--json") for spec in ("nobody", "own.py", refuses)]
    missing = command("conform", "nowhere.py:Mine")

    assert [one.returncode for one in (*told, missing)] == [2, 2, 5, 3]
    assert "no engine is called 'nobody'" in told[0].stderr
    assert told[1].stderr == "own.py: name the class in it, too, as in own.py:Mine\n"
    assert (missing.stdout, missing.stderr) == ("", "there is no file nowhere.py\n")  # and no place in our code
    assert json.loads(told[2].stdout.splitlines()[-1])["replies"][0]["refusals"] == ["never"]
