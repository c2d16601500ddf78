"""Mutants: each fits the production code, each is killed, and nothing of them stays behind."""

from __future__ import annotations

import inspect
import json
import time

import pytest

from crosscheck import mutants as lab
from crosscheck.cli import main
from crosscheck.documents.ledger import read
from crosscheck.mutants import Mutant, all_checks, mutants, try_all, unharmed
from crosscheck.mutation import DoesNotFit, changed_function, mutated, resolve
from crosscheck.selfchecks import CHECKS
from refkin.newton import CorrectionNorm, newton

MUTANTS = mutants()


@pytest.fixture(scope="module")
def unharmed_green():
    """Without any mutant every check is green: else a red one would prove nothing."""
    assert unharmed() == {}


@pytest.mark.usefixtures("unharmed_green")
@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda m: m.label)
def test_mutant_is_killed(mutant):
    """By one of the checks that it names, which the tests run on their own too."""
    (outcome,) = try_all([mutant], others=False)

    assert outcome.killed_by in mutant.checks


def test_there_are_enough_of_them():
    assert len(MUTANTS) >= 40


@pytest.mark.parametrize(
    "words",
    [
        *("(3,2)", "(3,4)", "stray 0", "row 1: theta14", "without absolute value", "counter of iterations", "no cap"),
        *(
            "reset is forgotten",
            "test_jac.m",
            "three Coriolis",
            "C_q qdd = -Q_d",
            "C_q qd = +C_t",
            "C_t with a row less",
        ),
        *("asin", "singular where theta3 = 0", "x - e^y = 1", "theta_0", "not divided", "s + l < p + q", "+h"),
        *("-theta2''", "residual of the iterate before", "2.7109"),
    ],
)
def test_each_wrong_formula_of_the_documents_is_a_mutant(words):
    assert [m for m in MUTANTS if words in m.label]


def test_rows_with_an_erratum_in_a_formula_or_a_claim_have_a_mutant():
    """But for those about what is said, not computed: a regular example, a lack of remedies."""
    with_mutants = {m.row for m in MUTANTS}
    rows = {row.id for row in read().row if any(e.kind in ("formula", "claim") for e in row.errata)}

    assert rows - with_mutants <= {"A1", "D9"}


def test_every_joint_and_driver_has_mutants():
    for target in ("Revolute", "Fixed", "PointOnLine", "Prismatic", "Distance", "Gear", "RackAndPinion", "FaceOnDisc"):
        assert [m for m in MUTANTS if f":{target}." in m.target]
    for target in ("AngleDriver", "XDriver", "YDriver", "DistanceDriver", "Gap", "RollerOnCurve"):
        assert [m for m in MUTANTS if f":{target}." in m.target]


def test_a_mutant_replaces_production_code_under_every_name():
    """The function object itself runs the changed text, whoever imported it."""
    phi, slope = (lambda x: x * x - 4), (lambda x: 2 * x)
    with mutated("refkin.newton:newton", "solve_linear(slope, -residuals[-1])", "solve_linear(slope, residuals[-1])"):
        assert not newton(phi, slope, 3.0).converged

    assert newton(phi, slope, 3.0).converged


def test_a_mutant_is_put_back_when_a_check_raises():
    before = CorrectionNorm.__call__.__code__
    with (
        pytest.raises(KeyError),
        mutated("refkin.newton:CorrectionNorm.__call__", "np.linalg.norm(correction)", "np.max(correction)"),
    ):
        raise KeyError
    assert CorrectionNorm.__call__.__code__ is before


@pytest.mark.parametrize(
    ("target", "old", "new", "told"),
    [
        ("refkin.newton:nothing", "a", "b", "exists"),
        ("refkin.nowhere:newton", "a", "b", "exists"),
        ("refkin.newton:NewtonStatus", "a", "b", "function"),
        ("refkin.newton:newton", "no such text", "b", "found it 0 times"),
        ("refkin.newton:newton", "residuals", "b", "times"),
        (
            "refkin.newton:solve_linear",
            "return np.linalg.solve(matrix, right)",
            "return (np.linalg.solve(matrix, right))",
            "same",
        ),
    ],
)
def test_a_mutant_that_does_not_fit_is_an_error(target, old, new, told):
    """Code that moved on must not leave a mutant behind that changes nothing."""
    with pytest.raises(DoesNotFit, match=told), mutated(target, old, new):
        pass


@pytest.mark.parametrize("target", ["refkin.newton:NewtonResult.residual", "refkin.joints.planar:Distance.gamma"])
def test_properties_and_static_methods_are_found(target):
    assert inspect.isfunction(resolve(target))


def test_a_method_that_calls_super_can_be_changed():
    old, new = "Revolute.gamma(g, f, i, j), 0)", "Revolute.gamma(g, f, i, j), 1)"
    assert changed_function(resolve("refkin.joints.planar:Fixed.gamma"), old, new)
    assert changed_function(resolve("refkin.joints.planar:Fixed.constants"), "self.angle", "-self.angle")


SURVIVOR = Mutant(
    label="a comment",
    row="A1",
    target="refkin.newton:CorrectionNorm.__call__",
    old="bool(np.linalg.norm(correction) < self.limit)",
    new="bool(self.limit > np.linalg.norm(correction))",
)


def test_a_survivor_is_told(monkeypatch, capsys):
    """A change that changes nothing survives, and the command ends with 1."""
    few = {name: all_checks()[name] for name in list(CHECKS)[:3]}
    monkeypatch.setattr(lab, "all_checks", lambda: few)
    monkeypatch.setattr("crosscheck.mutants_shown.mutants", lambda: (SURVIVOR,))

    code, told = run(capsys, "mutants")

    assert code == 1
    assert "SURVIVED" in told.out


def test_nothing_counts_if_a_check_is_red_on_its_own(monkeypatch, capsys):
    def broken():
        raise ValueError("broken")

    monkeypatch.setattr(lab, "all_checks", lambda: {"broken": broken})
    monkeypatch.setattr("crosscheck.mutants_shown.mutants", lambda: (SURVIVOR,))
    code, told = run(capsys, "mutants")

    assert code == 1
    assert "broken" in told.out


def test_a_check_that_does_not_end_is_ended(monkeypatch):
    """A mutant may loop for ever: that is found, in time."""
    monkeypatch.setattr(lab, "SECONDS", 0.2)

    def endless():
        while True:
            time.sleep(0.01)

    monkeypatch.setattr(lab, "all_checks", lambda: {"endless": endless})
    assert "no end" in unharmed()["endless"]


def test_the_command_shows_label_row_target_and_killer(capsys):
    code, told = run(capsys, "mutants", "--json", "C11")
    (first, *_), survived = (json.loads(told.out)[key] for key in ("mutants", "survived"))

    assert (code, survived) == (0, 0)
    assert first["row"] == "C11"
    assert first["killed_by"] in all_checks()


def test_the_command_refuses_words_that_fit_nothing(capsys):
    code, told = run(capsys, "mutants", "no such mutant")

    assert code == 2
    assert "no such mutant" in told.err


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    return ended.value.code, capsys.readouterr()
