"""The ledger on the page of a night: every row, every erratum, and what fails."""

from __future__ import annotations

import json
import re

import pytest

from crosscheck.documents.ledger import all_rows, read
from crosscheck.documents.ledger import page as documents
from crosscheck.night.sections import write_documents
from crosscheck.report.build import build


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("night")
    write_documents(folder)
    return build(folder).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def section(page):
    return re.search(r'<section id="documents".*?</section>', page, re.DOTALL).group()


def test_every_row_and_every_erratum_stands_on_the_page(section):
    rows, _, errata = section.partition("What is wrong in them")
    names = re.compile(r'<tr><th scope="row">([A-D]\d+)</th>')

    assert names.findall(rows) == [row.id for row in read().row]
    assert names.findall(errata) == [row.id for row in read().row for _ in row.errata]


def test_no_row_is_open_on_the_page(section):
    assert section.count('<span class="gap">open</span>') == 0


def test_the_section_is_folded_and_says_without_being_opened_what_is_in_it(section):
    summary = re.search(r"<summary>.*?</summary>", section, re.DOTALL).group()

    assert '<h2 id="documents-title">Source documents</h2>' in summary
    assert "57 rows" in summary


def test_the_tables_are_folded_away(section):
    assert section.count("<details>") == section.count("<table>") == 2


def test_the_page_shows_no_number_of_the_ledger_that_the_report_does_not_hold(tmp_path):
    write_documents(tmp_path)
    build(tmp_path)
    held = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["documents"]

    assert held == json.loads(json.dumps(documents.documents()))


def test_a_row_that_fails_is_red_on_the_page(tmp_path, monkeypatch):
    wrong = [{**row, "status": "fail", "failures": ["x[2]: <off>"]} if row["id"] == "A3" else row for row in all_rows()]
    monkeypatch.setattr(documents, "all_rows", lambda: wrong)
    write_documents(tmp_path)
    page = build(tmp_path).read_text(encoding="utf-8")

    assert "Row A3 fails: x[2]: &lt;off&gt;" in page
    assert page.count("✕ fails") == 1
