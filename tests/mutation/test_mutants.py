"""Mutants: each fits the production code, each is killed by tests of the suite, and nothing of them stays behind."""

from __future__ import annotations

import ast
import inspect
import os
import signal
import time
from inspect import signature
from types import SimpleNamespace

import pytest

from crosscheck.documents.ledger import read
from refkin.newton import CorrectionNorm, newton
from tests.mutation.change import DoesNotFit, changed_function, compiled, mutated, resolve, switched
from tests.mutation.mutants import Mutant, cases, killed, mutants, red
from tests.mutation.operators import changes
from tests.mutation.reach import key, probes, segments
from tests.mutation.sample import VERDICTS, Run, in_parallel, stale, verdicts

MUTANTS = mutants()
SLOPE = "solve_linear(slope, -residuals[-1])", "solve_linear(slope, residuals[-1])"


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda m: m.label)
def test_mutant_is_killed(mutant):
    """By the test that it names, which the suite runs on its own, without a mutant, too."""
    assert killed(mutant)


def test_no_test_that_kills_is_red_without_a_mutant():
    """A sample in this process: the whole is the suite itself."""
    assert {name: why for name in sorted({m.test for m in MUTANTS})[::7] if (why := red(name))} == {}


def test_every_mutant_fits_the_code():
    """All of them in a second: where code moved on, its mutants move with it."""
    misfits = {}
    for m in MUTANTS:
        try:
            changed_function(resolve(m.target), m.old, m.new, m.target)
        except DoesNotFit as error:
            misfits[m.label] = str(error)
    assert misfits == {}


def test_the_tests_that_kill_exist():
    assert [m.test for m in MUTANTS if not next(cases(m.test), None)] == []


def test_a_test_that_kills_is_called_with_all_that_it_asks_for():
    """One with another fixture would be red with and without a mutant."""
    runs = {m.test: next(cases(m.test)).args for m in MUTANTS}
    lacking = {
        name: signature(test).parameters.keys() - given - {"monkeypatch"} for name, (test, given) in runs.items()
    }

    assert {name: what for name, what in lacking.items() if what} == {}


def test_there_are_enough_of_them():
    """No two have one label, which is the name of a table."""
    assert len(MUTANTS) >= 218


def test_rows_with_an_erratum_in_a_formula_or_a_claim_have_a_mutant():
    """But for those about what is said, not computed: a regular example, a lack of remedies."""
    with_mutants = {m.row for m in MUTANTS if m.row}
    rows = {row.id for row in read().row if any(e.kind in ("formula", "claim") for e in row.errata)}

    assert rows - with_mutants <= {"A1", "D9"}
    assert with_mutants <= {row.id for row in read().row}


def test_every_joint_and_driver_has_mutants():
    for target in ("Revolute", "Fixed", "PointOnLine", "Prismatic", "Distance", "Gear", "RackAndPinion", "FaceOnDisc"):
        assert [m for m in MUTANTS if f":{target}." in m.target]
    for target in ("AngleDriver", "CoordinateDriver", "DistanceDriver", "Clearance", "RollerOnCurve"):
        assert [m for m in MUTANTS if f":{target}." in m.target]


def test_a_mutant_replaces_production_code_under_every_name():
    """The function object itself runs the changed text, whoever imported it."""
    phi, slope = (lambda x: x * x - 4), (lambda x: 2 * x)
    with mutated("refkin.newton:newton", *SLOPE):
        assert not newton(phi, slope, 3.0).converged

    assert newton(phi, slope, 3.0).converged


def test_a_mutant_is_put_back_when_a_test_raises():
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
            "x = np.linalg.solve(stacked, columns)",
            "x = (np.linalg.solve(stacked, columns))",
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


def test_a_change_that_changes_nothing_survives():
    survivor = Mutant(
        label="the other way around",
        target="refkin.newton:CorrectionNorm.__call__",
        old="bool(np.linalg.norm(correction) < self.limit)",
        new="bool(self.limit > np.linalg.norm(correction))",
        test="refkin/test_newton.py::test_stopping_tests_see_both_signs_and_both_limits",
    )

    assert not killed(survivor)


@pytest.mark.parametrize("wait", [0.01, 0.02])
def endless(wait):
    while True:
        time.sleep(wait)


def test_a_test_that_does_not_end_is_ended():
    """A mutant may loop for ever: that is found, in time."""
    assert "no end" in red("mutation/test_mutants.py::endless", seconds=0.2)


def test_random_mutants_are_other_programs_that_say_when_they_are_reached(monkeypatch):
    definition = ast.parse(inspect.getsource(newton)).body[0]
    rows = list(changes("refkin.newton:newton", definition))
    undamped = next(tree for what, tree, _ in rows if what.old == "if damped:")
    reached = []
    monkeypatch.setattr("builtins.__reached__", reached.append, raising=False)
    with switched({newton: compiled(newton, undamped)}):
        newton(lambda x: x * x - 4, lambda x: 2 * x, 3.0)

    assert len(rows) > 20
    assert all(what.old != what.new for what, *_ in rows)
    assert set(reached) == {"refkin.newton:newton"}


def test_probes_tell_which_statements_were_reached_and_change_nothing(monkeypatch):
    definition = ast.parse(inspect.getsource(newton)).body[0]
    first, number = segments(definition)
    reached = set()
    monkeypatch.setattr("builtins.__reached__", reached.add, raising=False)
    with switched(probes({"refkin.newton:newton": definition})):
        result = newton(lambda x: x * x - 4, lambda x: 2 * x, 3.0)
    names = {ast.unparse(statement): key("refkin.newton:newton", definition, k) for statement, k in number.items()}

    assert result.converged
    assert names["iterates.append(q)"] in reached
    assert names["correction = _damp(phi, q, residuals[-1], correction)"] not in reached
    assert names["status = NewtonStatus.CONVERGED"] in reached
    assert len(reached) < len(first) <= len(number)


def test_every_survivor_has_a_verdict_with_a_reason():
    for name, (verdict, why) in verdicts().items():
        assert verdict in VERDICTS, name
        assert len(why) > 20, name


def test_every_verdict_is_of_a_change_that_the_code_still_has():
    """A verdict outlives no change of the statement that it is of, nor another name of its function."""
    key = next(iter(verdicts()))
    others = [key.replace("refkin.fast", "refkin.slow"), key.replace("_common", "_rare"), key.replace("1.5", "1.6")]

    assert list(stale(verdicts())) == []
    assert list(stale([key, *others])) == others


def test_a_part_of_the_suite_whose_process_dies_is_not_taken_for_noted(monkeypatch):
    """An alarm that rings in an engine's C++ may end Python: no test of that part would be asked again."""
    taken = []
    jobs = [(["dies"], lambda: os.kill(os.getpid(), signal.SIGKILL)), (["ends"], lambda: [("ends", 0.0, ())])]
    reach = SimpleNamespace(jobs=lambda *_: jobs, take=lambda *part: taken.append(part), save=lambda: None)
    monkeypatch.setattr("tests.mutation.sample.candidates", lambda names: ())
    run = Run(SimpleNamespace(workers=1, minutes=1.0), reach)

    assert not run.note([])
    assert taken == [(["ends"], [("ends", 0.0, ())])]


def test_a_job_is_done_though_a_process_that_it_left_behind_holds_its_pipe():
    def leaving_one_behind():
        if not os.fork():
            time.sleep(60.0)
            os._exit(0)
        return "done"

    assert list(in_parallel([(7, leaving_one_behind, 5.0)], 1, time.monotonic() + 5.0)) == [(7, "done")]
