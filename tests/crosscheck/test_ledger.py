"""The ledger: every row recomputed, every erratum shown, and a ledger that lies goes red."""

from __future__ import annotations

import importlib
import json
import re
from dataclasses import replace

import pytest
from flint import arb, ctx
from pydantic import TypeAdapter, ValidationError

from crosscheck.documents.ledger import all_rows, check_row, ledger_rows, read
from crosscheck.documents.ledger.arithmetic import ArbNumbers, Binary64, NoRoot, Undecided, count_roots, excludes_zero
from crosscheck.documents.ledger.rows import Erratum, Ledger, Value, Written, correct_digits
from crosscheck.documents.systems import me451, me581

ROWS = {row.id: row for row in read().row}
NAMES = [f"{letter}{k}" for letter, count in (("A", 14), ("B", 7), ("C", 12), ("D", 24)) for k in range(1, count + 1)]
ERRATA = {
    **{"A1": 1, "A3": 3, "A4": 1, "A5": 1, "A8": 1, "A11": 1, "A12": 1},
    **{"B1": 1, "B2": 4, "B3": 3},
    **{"C2": 1, "C3": 1, "C4": 3, "C8": 1},
    **{"D3": 1, "D4": 2, "D6": 1, "D7": 2, "D8": 1, "D9": 1, "D10": 3, "D11": 1, "D12": 1, "D13": 2, "D16": 2},
}


@pytest.mark.parametrize("name", ROWS)
def test_row(name):
    """Each row is what it states; none is open."""
    row = check_row(ROWS[name])

    assert row["failures"] == []
    assert row["status"] == "pass"


def test_every_row_of_the_documents_is_there():
    assert list(ROWS) == NAMES


def test_the_errata_are_forty_and_in_their_rows():
    counted = {row.id: n for row in read().row if (n := sum(e.counts for e in row.errata))}

    assert counted == ERRATA
    assert sum(counted.values()) == 40


def test_every_document_has_rows():
    assert {row.document for row in read().row} == set(read().documents)


def test_every_row_has_something_to_compute():
    assert [row["id"] for row in all_rows() if not row["computed_by"]] == []


def test_every_function_that_is_named_by_a_row_recomputes_one():
    there = {(row.module, row.id.lower()) for row in read().row}
    for name in {module for module, _ in there}:
        module = importlib.import_module(f"crosscheck.documents.ledger.{name}")
        named = filter(None, (re.fullmatch("(?:[a-z]+_)?([a-d][0-9]+)", each) for each in vars(module)))
        assert {(name, match[1]) for match in named} <= there


def test_what_a_lost_figure_leaves_open_is_marked():
    assert all(ROWS[name].inferred for name in ("B1", "B2", "B4", "B5", "B7", "C6", "D15", "D16", "D17", "D18", "D19"))


def test_both_readings_of_the_rapier_drive_are_there():
    assert {"R1", "R2"} <= {value.name for value in ROWS["B5"].values}


def test_stated_digits_beyond_binary64_are_enclosed():
    """The longest truths, of more than 15 digits, are computed on balls."""
    long = [v for row in all_rows() for v in row["values"] if isinstance(v["truth"], str) and len(v["truth"]) > 20]

    assert len(long) >= 10
    assert all("balls of 256 bits" in v["computed"] for v in long)


def changed(name, value, **changes):
    """The row with one quantity stated otherwise."""
    row = ROWS[name]
    values = tuple(replace(v, **changes) if v.name == value else v for v in row.values)
    return replace(row, values=values)


@pytest.mark.parametrize(
    ("name", "value", "truth"),
    [
        ("C4", "limit", ("13.1514993464592379703", "114.827770615851464450")),
        ("A9", "f'(-1.2)", "-1.91095523952"),
        ("A12", "nk", 7),
        ("A10", "status for x^2 + 4", "CONVERGED"),
        ("A10", "no root of x^2 + 4 for |x| < 1000", False),
        ("D12", "omega", ("5", "-0.39006044899673384", "3.70309325863936046")),
    ],
)
def test_a_truth_that_is_off_in_its_last_digit_fails(name, value, truth):
    assert check_row(changed(name, value, truth=truth))["status"] == "fail"


CAUSED = tuple(replace(e, explained_by=("f(1.0042)",)) if e.at == ("f'[2]",) else e for e in ROWS["A3"].errata)
SAID = {
    "a quantity that nobody computes": (
        replace(ROWS["A9"], values=(*ROWS["A9"].values, Value(name="f(0)", truth="1"))),
        "f(0): not computed",
    ),
    "a quantity that is not stated": (
        replace(ROWS["A9"], values=ROWS["A9"].values[1:]),
        "f(-1.2): computed, but not stated",
    ),
    "more digits than anybody encloses": (
        changed("B6", "root from the new estimate", truth="3.73205080756887729"),
        "not enclosed",
    ),
    "a misprint without an erratum": (
        replace(ROWS["C8"], errata=()),
        "phi moved[1][1]: -17.8108 is printed, which is wrong: no erratum says so",
    ),
    "nothing is checked": (replace(ROWS["D23"], id="D0", values=()), "nothing is checked"),
    "a truth outside its bounds": (changed("A8", "rate at the fold", truth=None, between=("0.6", "0.7")), ""),
    "an erratum for a right number": (
        replace(ROWS["C5"], errata=(Erratum(kind="wrong", at=("det",), cause="none"),)),
        "",
    ),
    "a cause that does not explain": (replace(ROWS["A3"], errata=CAUSED), ""),
    "a claim that nothing shows": (
        replace(ROWS["D9"], errata=tuple(replace(e, shown_by="nothing") for e in ROWS["D9"].errata)),
        "erratum nothing: nothing shows it",
    ),
    "a claim that is right": (
        replace(ROWS["D9"], errata=tuple(replace(e, claimed=2) for e in ROWS["D9"].errata)),
        "erratum rank: 2 is claimed, and right by ",
    ),
    "a formula that is right": (
        replace(ROWS["D7"], errata=tuple(replace(e, claimed="-0.1255") for e in ROWS["D7"].errata)),
        "erratum with three terms: -0.1255 is claimed, and right by ",
    ),
    "a claim of nothing": (
        replace(ROWS["D9"], errata=tuple(replace(e, claimed=None) for e in ROWS["D9"].errata)),
        "erratum rank: nothing shows it",
    ),
    "an open row that is wrong": (changed("D2", "mobility by count", truth=3), ""),
}


@pytest.mark.parametrize(("row", "sentence"), SAID.values(), ids=SAID)
def test_a_row_that_lies_fails(row, sentence):
    value = check_row(row)

    assert value["status"] == "fail"
    assert any(sentence in text for text in value["failures"])


def test_the_digits_of_the_rates_in_the_notes_are_about_two():
    """Five are printed; they were evaluated before Newton had converged."""
    values = {v["name"]: v for v in ledger_rows(["D12"])[0]["values"]}
    rates = [values[p] for p in ("omega[1]", "omega[2]", "alpha[1]", "alpha[2]")]

    assert [rate["digits_correct"] for rate in rates] == [1.7, 2.7, 2.0, 1.8]
    assert {rate["digits_printed"] for rate in rates} == {5}


@pytest.mark.parametrize("text", ["", "1,5", "nan", "inf", "abc"])
def test_what_is_no_decimal_number_is_refused(text):
    with pytest.raises(ValueError, match="number"):
        Written.read(text)


@pytest.mark.parametrize(
    ("text", "digits"), [("0.0107", 3), ("3.5838", 5), ("0.0", 1), ("-1.4e-14", 2), ("45.0000", 6)]
)
def test_significant_digits_are_counted(text, digits):
    assert Written.read(text).digits == digits


def test_no_more_digits_are_right_than_are_printed():
    with ctx.workprec(200):
        assert correct_digits(Written.read("1.00"), arb("1.0000000001")) == 3.0


def test_an_unknown_key_in_the_ledger_is_an_error():
    with pytest.raises(ValidationError):
        TypeAdapter(Ledger).validate_python({"documents": {}, "row": [], "more": 1})


def test_balls_prove_a_root_to_their_precision():
    n = ArbNumbers(256)
    with n.at_precision():
        (root,) = n.root(me581.quadratic(), n.vector(["4"]))

        assert root.overlaps(2 + arb(3).sqrt())
        assert root.rad() < 1e-70


def test_balls_prove_no_root_where_there_is_none():
    n = ArbNumbers(113)
    with n.at_precision(), pytest.raises(NoRoot):
        n.root(me451.square(4), n.vector(["1.5"]))


def test_floats_find_no_root_where_there_is_none():
    with pytest.raises(NoRoot):
        Binary64().root(me451.square(4), [1.5])


def test_roots_are_counted_and_excluded():
    system = me451.square(-2)

    assert count_roots(system, -3.0, 2.5) == 2
    assert excludes_zero(lambda x: x * x + 1, -3.0, 3.0)
    assert not excludes_zero(lambda x: x * x - 1, -3.0, 3.5)
    with pytest.raises(Undecided):
        count_roots(me451.square(0), -1.0, 1.5)


def test_the_command_prints_every_row_and_ends_well(command):
    code, out, _ = command("ledger")

    assert code == 0
    assert "57 rows: 57 pass, 0 fail, 0 open" in out
    assert "40 errata" in out


def test_the_command_prints_json(command):
    code, out, _ = command("ledger", "--json", "A3", "D23")

    assert code == 0
    assert [row["status"] for row in json.loads(out)["rows"]] == ["pass", "pass"]


def test_the_command_fails_when_a_row_does(command, monkeypatch):
    wrong = changed("A9", "f'(-1.2)", truth="-1.92")
    monkeypatch.setattr("crosscheck.documents.ledger.read", lambda: replace(read(), row=(wrong,)))
    code, out, _ = command("ledger")

    assert code == 1
    assert "FAIL A9: f'(-1.2)" in out
