"""Findings are strict: each still shows, by rows, scene and script, and what is wrong without one fails."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import refkin
from crosscheck.engines import PEERS
from crosscheck.engines.loading import load
from crosscheck.engines.methods import methods
from crosscheck.engines.mujoco.model import Plan, mujoco
from crosscheck.engines.mujoco.rows import MujocoRows
from crosscheck.engines.mujoco.shipped import as_shipped
from crosscheck.engines.tree.joint_tree import joint_tree
from crosscheck.judge.comparison import reference
from crosscheck.judge.delivery import DOCUMENTED
from crosscheck.judge.hard_poses import samples, scene_truths
from crosscheck.judge.known_gaps import BAD, HardOutcome, InvalidGap, finding_of, read_findings, unexplained
from crosscheck.measure.hard_table import classed, listed, outcome_of
from crosscheck.scenes.hard import hard_cases
from refkin.motion import Status
from tests.places import ROOT

FINDINGS = read_findings()
ROUTES = {name: tuple(key[1] for key in listed(name)) for name in PEERS}
IN_TABLE = [f for f in FINDINGS if f.method in ROUTES[f.engine]]
SLOW = ("mujoco", "mj_step")
FIRST = {case.case: case.key for case in reversed(hard_cases())}
ROW = """
[[finding]]
engine = "exudyn"
method = "shipped"
cases = ["toggle"]
verdict = "wrong"
class = "our misuse"
quote = "a"
source = "b"
reason = "c"
script = "d"
since = "e"
date = 2026-11-21
"""


@pytest.mark.parametrize(
    ("finding", "case"), [(f, case) for f in IN_TABLE for case in f.cases], ids=lambda x: getattr(x, "method", x)
)
def test_every_finding_still_shows_in_each_kind_of_its_scenes(finding, case):
    keys = [c.key for c in hard_cases() if c.case == case]
    shown = (outcome_of((finding.engine, finding.method, "", key))[0] == finding.verdict for key in keys)

    assert any(shown)


@pytest.mark.parametrize(("engine", "route"), [(e, r) for e, routes in ROUTES.items() for r in routes])
def test_what_is_wrong_is_explained_by_a_finding(engine, route):
    keys = set(FIRST.values()) if (engine, route) == SLOW else {c.key for c in hard_cases()}
    case_of = {c.key: c.case for c in hard_cases()}
    new = []
    for key in sorted(k for k in keys if not k.startswith("branching") or k in FIRST.values()):
        outcome, note = outcome_of((engine, route, "", key))
        row = {"engine": engine, "method": route, "case": case_of[key], "verdict": outcome}
        if outcome in BAD and finding_of(FINDINGS, row) is None:
            new.append((key, outcome, note))

    assert new == []


PASSED = "tests/corpus/parallelogram-passed.toml"
WITH_SCENE = [f for f in IN_TABLE if f.scene]


@pytest.mark.parametrize("finding", WITH_SCENE, ids=lambda f: f"{f.engine} {f.scene}")
def test_the_minimal_scene_of_a_finding_shows_it(finding):
    scene = refkin.load(ROOT / finding.scene)
    candidate = next(m for m in methods(finding.engine) if m.key == (finding.engine, finding.method, ""))

    ref, answer = reference(scene), candidate.solve(scene)
    where = samples(ref.system, scene_truths(ref), scene, answer, candidate.terms(scene))

    assert classed(where)[0] == finding.verdict


@pytest.mark.parametrize("key", [None, *(c.key for c in hard_cases() if c.case == "parallelogram, passed")])
def test_the_march_of_the_method_static_says_that_a_parallelogram_past_its_flat_pose_is_lost(key):
    engine = load("exudyn")
    scene = refkin.load(ROOT / PASSED) if key is None else next(c.scene for c in hard_cases() if c.key == key)
    motion = engine.solve(scene, engine.routes()[0])
    ok = [status is Status.OK for status in motion.status]

    assert motion.status[-1] is Status.BRANCH_LOST
    assert abs(motion["coupler"].phi[ok]).max() < 1e-7
    assert all(ok[: sum(t <= -1e-3 for t in scene.times)])


@pytest.mark.parametrize("script", sorted({f.script for f in FINDINGS if f.script}))
def test_the_script_of_a_finding_shows_it_in_the_engines_own_api(script, tmp_path):
    done = subprocess.run(
        [sys.executable, ROOT / script], capture_output=True, text=True, cwd=tmp_path, timeout=60, check=False
    )

    assert (done.returncode, done.stderr) == (0, "")
    assert "came" in done.stdout


def test_the_default_solver_of_mujoco_errs_on_a_branching_tree_of_more_than_60_freedoms():
    case = next(c for c in hard_cases() if c.key == "branching tree, 3e+01")
    tree = joint_tree(case.scene.mechanism)
    rows = MujocoRows(Plan(tree, (*tree.closures, *tree.driven)))
    as_shipped(rows.model)
    model, (default, dense) = rows.model, (rows.model.opt.jacobian, mujoco.mjtJacobian.mjJAC_DENSE)
    q = tree.start() + np.random.default_rng(2).uniform(-0.05, 0.05, tree.width)

    fields = {}
    for jacobian in (default, dense):
        model.opt.jacobian = jacobian
        data = mujoco.MjData(model)
        data.qpos[rows.columns] = q
        mujoco.mj_forward(model, data)
        fields[jacobian] = np.array(data.qacc)

    assert (default, model.nv) == (mujoco.mjtJacobian.mjJAC_AUTO, 65)
    assert np.max(np.abs(fields[default] - fields[dense])) > 1e-3 * np.max(np.abs(fields[dense]))


def test_the_script_about_an_exudyn_tolerance_shows_success_with_an_angle_of_1e12_rad_and_an_open_joint():
    script = next(f.script for f in FINDINGS if "square_root" in f.script and f.engine == "exudyn")
    done = subprocess.run([sys.executable, ROOT / script], capture_output=True, text=True, timeout=60, check=True)

    angle, gap = re.search(r"success, coupler angle ([\d.]+e\+\d+) rad, joint open by (\S+) m", done.stdout).groups()
    assert float(angle) > 1e12
    assert float(gap) > 1.0


@pytest.mark.parametrize("finding", FINDINGS, ids=lambda f: f"{f.engine} {f.method} {f.script}")
def test_a_script_says_what_a_maintainer_asks(finding):
    """Its class, the documentation that it contradicts or follows, and the versions that show it."""
    text = (ROOT / finding.script).read_text(encoding="utf-8")
    promise = " ".join(text.split('"""')[1].split("Class:")[1].split())
    of_script = [f for f in FINDINGS if f.script == finding.script]

    assert Path(finding.script).parent.name == finding.kind.replace(" ", "-")
    assert promise in [
        f'{f.kind}. Documentation: "{" ".join(f.quote.split())}" ({f.source}). Since: {f.since}.' for f in of_script
    ]
    assert "__version__" in text


def test_scripts_need_nothing_of_this_project():
    for path in (ROOT / "reports" / "findings").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert not any(word in text for word in ("refkin", "crosscheck"))
        assert any(f.script.endswith(path.name) for f in FINDINGS)


def test_the_quotations_of_exudyn_stand_in_its_settings_and_items():
    import exudyn as exu
    from exudyn import itemInterface

    settings = exu.SimulationSettings()
    groups = {
        "NewtonSettings": settings.staticSolver.newton,
        "GeneralizedAlphaSettings": settings.timeIntegration.generalizedAlpha,
    }
    for finding in FINDINGS:
        if finding.engine == "exudyn":
            group, key = finding.source.split(", ")[1].split(".")
            item = getattr(itemInterface, group, None)
            assert finding.quote in (item or getattr(type(groups[group]), key)).__doc__
            assert item is None or f"{key}: " in item.__doc__


def test_the_sentences_that_grant_an_error_term_stand_in_the_documentation():
    """That of Pinocchio's example was compared with the repository at v3.7.0."""
    import exudyn as exu

    reference = (Path(mujoco.__file__).parent / "doc" / "XMLreference.rst").read_text(encoding="utf-8")
    newton = type(exu.SimulationSettings().staticSolver.newton)
    texts = {"mujoco": " ".join(reference.split()), "exudyn": newton.relativeTolerance.__doc__}

    assert {engine for engine, _ in DOCUMENTED} == {*texts, "pinocchio"}
    assert all(item.quote in texts[engine] for (engine, _), item in DOCUMENTED.items() if engine in texts)


def test_the_quotations_of_pinocchio_stand_in_its_docstrings():
    """Those of its example were compared with the repository at v3.7.0 (c51d923); the package does not hold it."""
    texts = {
        "docstring of computeJointJacobiansTimeVariation": pin.computeJointJacobiansTimeVariation.__doc__,
        "docstring of PointAnchorConstraintModel.jacobian": pin.PointAnchorConstraintModel.jacobian.__doc__,
    }
    for finding in FINDINGS:
        if finding.engine == "pinocchio" and "examples/" not in finding.source:
            assert finding.quote in texts[finding.source.split(", ")[1]]


def test_the_quotations_of_mujoco_stand_in_its_documentation():
    for finding in FINDINGS:
        if finding.engine == "mujoco":
            file = re.search(r"doc/\S+\.rst", finding.source).group()
            text = (Path(mujoco.__file__).parent / file).read_text(encoding="utf-8")
            assert finding.quote in " ".join(text.split())


def row(verdict: str, kind: str | None = None) -> dict[str, object]:
    return {"engine": "exudyn", "method": "shipped", "case": "toggle", "verdict": verdict, "class": kind}


def test_what_is_wrong_and_has_no_class_is_unexplained():
    rows = [row("wrong"), row("wrong", "our misuse"), row("refused"), row("crash"), row("hang")]

    assert unexplained(rows) == [rows[0], rows[3], rows[4]]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (ROW.replace('quote = "a"\n', ""), "finding.0.quote: missing"),
        (ROW.replace("our misuse", "bad"), "finding.0.class: 'bad'; input should be"),
        (ROW.replace('["toggle"]', '"toggle"'), "finding.0.cases: 'toggle'; input should be a valid tuple"),
        (ROW.replace('["toggle"]', "[]"), "finding.0.cases: .*should have at least 1 item"),
        (ROW.replace('script = "d"', ""), "finding.0: .* neither scene nor script"),
        (ROW.replace('script = "d"', 'script = ""'), "finding.0.script: ''; string should have at least 1 character"),
        (ROW + "colour = 1\n", "finding.0.colour: 1; unexpected"),
        (ROW + "[[", "no TOML: "),
    ],
)
def test_a_finding_that_makes_no_sense_gets_one_clear_error(text, told):
    with pytest.raises(InvalidGap, match=told):
        read_findings(text)


def test_only_kinds_that_exist_are_named():
    assert {case for f in FINDINGS for case in f.cases} - {case.case for case in hard_cases()} == set()
    assert {f.verdict for f in FINDINGS} <= set(HardOutcome)
    assert "refkin" not in {f.engine for f in FINDINGS}
