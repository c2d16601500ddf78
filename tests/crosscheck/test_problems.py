"""The problem set: its answers are right to 30 digits, its models say the same, and the grader counts what is right."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from decimal import Decimal
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from flint import arb

from crosscheck.commands.solve import to_json
from crosscheck.engines.mujoco.model import mujoco
from crosscheck.errors import CannotRun
from crosscheck.problems import VERSION, planar, spatial
from crosscheck.problems import export as problems
from crosscheck.problems.export import export
from crosscheck.problems.exudyn_script import to_exudyn
from crosscheck.problems.grader import LEVELS
from crosscheck.problems.mjcf import to_mjcf
from crosscheck.problems.statement import digits_of, drafts
from crosscheck.workers.processes import hang
from refkin.joints import PLANE, SPACE
from refkin.model import Scene
from refkin.scenes.files import load, to_dict
from refkin.scenes.linkages import ScrewJack
from refkin.solving.solve import solve

HARD = ("near-change-points-05", "near-limits-11", "near-limits-12", "flat-linkages-06", "sizes-08")


def sample():
    """The first problem of every family, and the hardest of the hard ones."""
    seen: dict[str, int] = {}
    for draft in drafts():
        first = seen.setdefault(draft.family, 0) == 0
        seen[draft.family] += 1
        if first or (draft.name in HARD and not draft.assembly):
            yield draft


SAMPLE = list(sample())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    at = tmp_path_factory.mktemp("problems")
    export(at, SAMPLE)
    return at


@pytest.fixture(scope="module")
def index(folder):
    return {entry["name"]: entry for entry in json.loads((folder / "problems.json").read_text())["problems"]}


@pytest.fixture(scope="module")
def ours(folder, index):
    """What refkin answers to each problem's file."""
    scenes = {name: load(folder / name / "scene.toml") for name in index}
    return {name: json.loads(json.dumps(to_json(scene, solve(scene)))) for name, scene in scenes.items()}


def truth(folder, name):
    return json.loads((folder / name / "certified.json").read_text())


def graded(folder, answers, tmp_path):
    """Return exit code and printed lines of the stand-alone grader, run by a Python that sees no package."""
    (tmp_path / "answers.json").write_text(json.dumps({"problems": answers}))
    command = [sys.executable, "-I", "-S", str(folder / "grade.py"), str(tmp_path / "answers.json")]
    run = subprocess.run(command, capture_output=True, text=True)
    assert not run.stderr, run.stderr
    return run.returncode, run.stdout.splitlines()


def scores(line):
    words = line.split()
    return dict(zip(words[1::2], map(float, words[2::2]), strict=True))


def test_every_family_has_a_problem():
    assert len({draft.family for draft in SAMPLE}) == len((*planar.FAMILIES, *spatial.FAMILIES))
    assert 180 <= len(list(drafts())) <= 300


def test_our_own_answers_are_right_to_what_is_attainable(folder, index, ours, tmp_path):
    code, lines = graded(folder, ours, tmp_path)
    short = {
        (name, level): (digits, index[name]["attainable"][level])
        for name, line in zip(ours, lines, strict=True)
        for level, digits in scores(line).items()
        if digits < min(15.0, index[name]["attainable"][level] - ROUNDINGS)
    }

    assert code == 0
    assert short == {}


ROUNDINGS = 0.3
"""Digits: attainable is what half an ulp of every given number leaves, and a solve rounds some more."""


def test_the_answers_are_those_of_this_version(folder):
    """Whoever changes a problem or a digit raises `VERSION`, and states the new hashes here and beside it."""
    assert VERSION == "5"
    assert json.loads((folder / "problems.json").read_text())["sha256"][:16] == "4d7efd77cdda57a1"


def test_the_problems_are_those_of_this_version():
    """All that are stated, of which only some are proved above."""
    scenes = [(d, to_dict(Scene(mechanism=d.stated.mechanism, times=d.stated.times))) for d in drafts()]
    stated = [(d.name, d.assembly, d.stated.title, d.stated.driven, scene) for d, scene in scenes]

    assert hashlib.sha256(json.dumps(stated, sort_keys=True).encode()).hexdigest()[:16] == "1883b827431a2175"


@pytest.mark.parametrize("lost", [3, 9, 20])
def test_a_wrong_digit_scores_where_it_stands(folder, tmp_path, lost):
    name = "four-bars-01-open"
    right = truth(folder, name)
    q = [[Decimal(x) for x in row] for row in right["q"]]
    q[2][3] += Decimal(right["size"]) / 10**lost
    rows = {body: [[str(x) for x in row[k : k + 3]] for row in q] for body, k in right["columns"].items()}
    code, (line,) = graded(folder, {name: {"bodies": {body: {"q": r} for body, r in rows.items()}}}, tmp_path)

    assert code == 0
    assert scores(line) == {"position": lost}


def as_answer(right, rows, level="q"):
    width = len(right["units"])
    return {"bodies": {body: {level: [row[k : k + width] for row in rows]} for body, k in right["columns"].items()}}


def test_an_answer_of_the_other_branch_is_refused_by_name(folder, index, tmp_path):
    answers, expected = {}, []
    for name, right in ((name, truth(folder, name)) for name in index):
        if all(right["others"]):
            other, *_ = right["others"][0]
            rows = [others.get(other, next(iter(others.values()))) for others in right["others"]]
            answers[name] = as_answer(right, rows)
            expected.append(f"assembly '{other}' at t = {right['t'][0]}, '{right['assembly']}' is asked for")
    code, lines = graded(folder, answers, tmp_path)

    assert code == 1
    assert len(expected) >= 15
    assert [f"{name}: REFUSED, {words}" for name, words in zip(answers, expected, strict=True)] == lines


def test_whole_turns_are_no_error(folder, tmp_path):
    name = "four-bars-01-open"
    right = truth(folder, name)
    rows = [[turned(x, 3 if k % 3 == 2 else 0) for k, x in enumerate(row)] for row in right["q"]]
    _, (line,) = graded(folder, {name: as_answer(right, rows)}, tmp_path)

    assert scores(line) == {"position": 30.0}


def turned(number, turns):
    """Return a number with so many whole turns more, in 50 digits."""
    with mpmath.workdps(60):
        return mpmath.nstr(mpmath.mpf(number) + 2 * mpmath.pi * turns, 50)


def test_an_answer_with_the_other_sign_of_the_euler_parameters_is_the_same_pose(folder, index, tmp_path):
    name = next(n for n in index if n.startswith("spatial"))
    right = truth(folder, name)
    answer = {"bodies": {body: {} for body in right["columns"]}}
    for level in LEVELS:
        rows = [[x if k % 7 < 3 else negative(x) for k, x in enumerate(row)] for row in right[level]]
        for body, levels in as_answer(right, rows, level)["bodies"].items():
            answer["bodies"][body] |= levels
    _, (line,) = graded(folder, {name: answer}, tmp_path)
    answer["bodies"]["crank"]["qd"][1][6] = right["qd"][1][6]
    _, (mixed,) = graded(folder, {name: answer}, tmp_path)

    assert set(scores(line).values()) == {30.0}
    assert scores(mixed)["velocity"] < 1.0


def negative(digits):
    return digits.removeprefix("-") if digits.startswith("-") else f"-{digits}"


def test_a_body_that_is_missing_and_a_number_that_is_none_earn_nothing(folder, tmp_path):
    name = "four-bars-01-open"
    right = truth(folder, name)
    answer = as_answer(right, right["q"])
    answer["bodies"]["rocker"]["q"][1] = [None, None, None]
    _, (line,) = graded(folder, {name: answer}, tmp_path)
    del answer["bodies"]["rocker"]
    code, (refused,) = graded(folder, {name: answer}, tmp_path)

    assert scores(line) == {"position": 0.0}
    assert code == 1
    assert "REFUSED, q of rocker: 5 rows of 3 numbers expected" in refused


NO_ANSWERS = ([], 3, None, {}, {"problems": 3}, {"problems": {"four-bars-01-open": 3}})
NO_ROWS = (3, [3] * 5, [["a", 0, 0]] * 5, [[[], {}, 0]] * 5, {"q": 1})


def refused(folder, file, command):
    """Return what the stand-alone grader and the command say of a file of answers that they refuse."""
    run = subprocess.run([sys.executable, "-I", "-S", folder / "grade.py", file], capture_output=True, text=True)
    told = command("problems", "grade", file, "--problems", folder, "--json")
    assert 0 not in (run.returncode, told.returncode)
    said = run.stdout + run.stderr, told.stdout + told.stderr
    assert not [text for text in said if "Traceback" in text]
    return said


@pytest.mark.parametrize("answers", NO_ANSWERS)
def test_a_file_that_holds_no_answers_is_refused_in_a_sentence(folder, tmp_path, command, answers):
    (file := tmp_path / "answers.json").write_text(json.dumps(answers))

    for said in refused(folder, file, command):
        assert "expected an object" in said


def test_a_file_of_lists_in_lists_and_numbers_beyond_all_bounds_are_no_tracebacks(folder, tmp_path, command):
    (file := tmp_path / "answers.json").write_text("[" * 100_000)
    for said in refused(folder, file, command):
        assert "itself" not in said

    right = truth(folder, name := "four-bars-01-open")
    answer = as_answer(right, right["q"])
    answer["bodies"]["rocker"]["q"][1][0] = "1e999999999"
    assert scores(graded(folder, {name: answer}, tmp_path)[1][0]) == {"position": 0.0}


@pytest.mark.parametrize("rows", NO_ROWS)
def test_rows_that_are_no_numbers_are_refused_in_a_sentence(folder, tmp_path, command, rows):
    right = truth(folder, name := "four-bars-01-open")
    answer = as_answer(right, right["q"])
    answer["bodies"]["rocker"]["q"] = rows
    (file := tmp_path / "answers.json").write_text(json.dumps({"problems": {name: answer}}))

    for said in refused(folder, file, command):
        assert "q of rocker: 5 rows of 3 numbers expected" in said


def test_the_command_says_the_same_and_refuses_other_sets(folder, index, ours, tmp_path, command):
    file = tmp_path / "answers.json"

    def run(problems):
        file.write_text(json.dumps({"problems": problems}))
        return command("problems", "grade", file, "--problems", folder, "--json")

    told = run(ours)
    _, lines = graded(folder, ours, tmp_path)

    assert told.returncode == 0
    for line in lines:
        of_command = json.loads(told.stdout)[line.split(":")[0]]
        assert {level: round(digits, 1) for level, digits in of_command.items()} == scores(line)
    assert run({"no-such-problem": {"bodies": {}}}).returncode == 2


def test_a_set_whose_answers_were_changed_is_no_set(folder, tmp_path):
    copy = tmp_path / "set"
    export(copy, SAMPLE[:1])
    file = copy / SAMPLE[0].problem().name / "certified.json"
    file.write_text(file.read_text().replace("1", "2", 1))
    (tmp_path / "answers.json").write_text('{"problems": {}}')
    command = [sys.executable, str(copy / "grade.py"), str(tmp_path / "answers.json")]

    assert "not those of this set" in subprocess.run(command, capture_output=True, text=True).stderr


def test_two_processes_write_the_same_problems_in_the_same_bytes_again(folder, tmp_path):
    export(tmp_path, SAMPLE[::5], processes=2)

    for file in tmp_path.glob("*/*"):
        assert file.read_bytes() == (folder / file.relative_to(tmp_path)).read_bytes()
    assert len(list(tmp_path.glob("*/*"))) == 5 * len(SAMPLE[::5])


def test_an_element_that_an_export_does_not_know_is_named():
    scene = ScrewJack(0.1).scene(samples=2)
    for write in (lambda: to_exudyn(scene, "a jack"), lambda: to_mjcf(scene)):
        with pytest.raises(CannotRun, match=r"^\w+: no export for "):
            write()


def test_a_problem_at_which_a_process_fails_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(problems, "call_in_turn", lambda *_: iter([hang(600.0)]))

    with pytest.raises(CannotRun, match=f"{SAMPLE[0].name}: hang; no answer within 600 s"):
        export(tmp_path, SAMPLE[:2], processes=2)


def test_four_bars_are_right_to_30_digits_by_an_independent_closed_form(folder, index):
    """In 50 digits, without refkin: the rocker's angle from the lengths in the file, and the crank's law."""
    for name in (n for n in index if n.startswith(("four-bars", "near-change", "sizes-01"))):
        right, scene = truth(folder, name), json.loads((folder / name / "scene.json").read_text())
        joints = {joint["name"]: joint for joint in scene["joint"]}
        at = {key: [mpmath.mpf(x) for x in joints[joint][key2]] for key, joint, key2 in PLACES}
        with mpmath.workdps(50):
            ground, crank, coupler, rocker = (
                at["B0"][0], 2 * at["A"][0], 2 * at["B"][0], 2 * at["rocker"][0]
            )  # fmt: skip
            for t, row in zip(right["t"], right["q"], strict=True):
                theta = law(scene["driver"][0], mpmath.mpf(t))
                d = ground - crank * mpmath.expj(theta)
                inner = mpmath.acos((coupler**2 + abs(d) ** 2 - rocker**2) / (2 * coupler * abs(d)))
                tip = crank * mpmath.expj(theta)
                ends = [tip + coupler * mpmath.expj(mpmath.arg(d) + s * inner) for s in (1, -1)]
                expected = [(end + ground) / 2 for end in ends]
                rocker_at = mpmath.mpc(*row[right["columns"]["rocker"] :][:2])

                assert min(abs(rocker_at - e) for e in expected) < mpmath.mpf(10) ** -28 * abs(ground)


PLACES = (("B0", "B0", "point_i"), ("A", "A", "point_i"), ("B", "B", "point_i"), ("rocker", "B", "point_j"))


def law(driver, t):
    if "rate_law" in driver:
        rate = driver["rate_law"]["coefficients"]
        return driver["initial"] + sum(mpmath.mpf(c) * t ** (k + 1) / (k + 1) for k, c in enumerate(rate))
    law = driver["law"]
    if law["kind"] == "sinusoid":
        angle = mpmath.mpf(law["angular_frequency"]) * t + law.get("phase", 0.0)
        return law.get("offset", 0.0) + law["amplitude"] * mpmath.sin(angle)
    return sum(mpmath.mpf(c) * t**k for k, c in enumerate(law["coefficients"]))


def test_a_ball_whose_ends_round_apart_has_no_digits():
    half_way = Fraction(1, 3) + Fraction(1, 2 * 10**30)
    third = arb(1) / 3

    assert digits_of(arb("0.125")) == "0.125"
    assert digits_of(arb(float(half_way), 1e-20)) is None
    assert digits_of(arb(0, 1e-50)) == "0"
    assert digits_of(arb(0, 1e-40)) is None
    assert digits_of(arb(0, 1e-40), Fraction(10**6)) == "0"
    assert digits_of(third) is None  # at 53 bits
    assert digits_of(arb.nan()) is None


@pytest.mark.parametrize("draft", SAMPLE, ids=lambda draft: draft.name)
def test_mujoco_reads_the_model_and_its_own_equations_have_the_same_solution(draft, folder, index):
    """Newton on MuJoCo's rows, from the certified pose: it stays there. From a pose that is off, its rows say so."""
    name = next(n for n in index if n.startswith(draft.name))
    right, random = truth(folder, name), np.random.default_rng(1)
    model = mujoco.MjModel.from_xml_path(str(folder / name / "model.xml"))
    data = mujoco.MjData(model)
    axes = KINDS[len(right["units"])].coordinates
    columns = {f"{body}.{axis}": k + n for body, k in right["columns"].items() for n, axis in enumerate(axes)}
    names = [name for j in range(model.njnt) for name in entries_of(model.joint(j))]
    asked = [columns.get(name) for name in names]
    unit = model.numeric("metres per unit").data[0]
    slides = np.array([k is not None and right["units"][k % len(axes)] == "length" for k in asked])
    wanted = np.array([0.0 if k is None else float(right["q"][0][k]) for k in asked])
    wanted[slides] /= unit
    size = right["size"] / unit
    own = np.array([k is not None for k in asked])
    data.qpos[:] = wanted
    carriages = [k for k in range(model.nv) if model.joint(model.dof_jntid[k]).name.startswith("carriage")]
    for _ in range(20):  # where the carriages stand is nobody's answer: they are found first
        solved(model, data, carriages)
        if np.max(np.abs(data.efc_pos)) < 1e-9 * max(1.0, size):
            break
        data.qpos[~own] = random.uniform(-3.0, 3.0, np.sum(~own))
    solved(model, data, list(range(model.nv)))
    off = np.max(np.abs(data.qpos - wanted)[own] / np.where(slides, size, 1.0)[own])

    assert own.sum() == len(columns)
    assert np.max(np.abs(data.efc_pos)) < 1e-15 * max(8.0, size, np.max(np.abs(wanted)))
    assert off < 1e-9
    mujoco.mj_integratePos(model, data.qpos, 1e-3 * np.resize((1.0, -2.0, 3.0), model.nv), 1.0)
    mujoco.mj_fwdPosition(model, data)
    assert np.max(np.abs(data.efc_pos)) > 1e-4


def solved(model, data, columns):
    """Bring MuJoCo's rows to zero by some of the coordinates."""
    for _ in range(25):
        mujoco.mj_fwdPosition(model, data)
        step = np.zeros(model.nv)
        rows = data.efc_J.reshape(-1, model.nv)[:, columns]
        step[columns] = np.linalg.lstsq(rows, -data.efc_pos, rcond=1e-9)[0]
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        if np.max(np.abs(step), initial=0.0) < 1e-14:
            break
    mujoco.mj_fwdPosition(model, data)


KINDS = {kind.width: kind for kind in (PLANE, SPACE)}


def entries_of(joint):
    """The names of a joint's entries in qpos."""
    free = joint.type[0] == mujoco.mjtJoint.mjJNT_FREE
    return [f"{joint.name}.{axis}" for axis in SPACE.coordinates] if free else [joint.name]


TOO_HARD = ("near-change-points", "near-limits", "flat-linkages", "motions")
"""Where exudyn's Newton, started at the last pose, goes over to another assembly or stops early: that is its score."""


def rows_of(model, data):
    return data.efc_J.reshape(-1, model.nv)


@pytest.mark.parametrize("draft", SAMPLE, ids=lambda draft: draft.name)
def test_exudyn_runs_the_script_and_answers_what_is_asked(draft, folder, index, tmp_path):
    name = next(n for n in index if n.startswith(draft.name))
    run = subprocess.run(
        [sys.executable, str(folder / name / "exudyn_model.py")], capture_output=True, text=True, cwd=tmp_path
    )
    answer = json.loads(run.stdout)["problems"]  # nothing else is on standard output: it may be sent to a file
    _, (line,) = graded(folder, answer, tmp_path)

    assert run.returncode == 0
    enough = min(11.0, index[name]["attainable"]["position"] - 1.0)  # a million metres away fewer are attainable
    assert draft.family in TOO_HARD or scores(line)["position"] > enough, line
