"""The certificate as the arbiter of a scene that is replayed, and runs against another table of known gaps."""

from __future__ import annotations

from dataclasses import replace

import refkin
from crosscheck.commands.engines import PLACES, arbiter_table
from crosscheck.judge import known_gaps
from crosscheck.measure.check import check
from refkin.scenes.linkages import ScrewJack
from tests.places import CORPUS

JUMP = CORPUS / "exudyn-shipped-changes-assembly.toml"


def places(record):
    return {answer.method.name: answer.certificate for answer in record.answers}


def test_an_answer_on_the_other_assembly_is_outside_and_the_others_are_inside():
    where = places(check(refkin.load(JUMP), ["exudyn"], arbiter=True))

    assert [getattr(where["static"], place) for place in PLACES] == [9, 0, 0, 0]
    assert [getattr(where["shipped"], place) for place in PLACES] == [6, 3, 0, 0]
    assert where["shipped"].radii > 1e6 > 1.0 > where["static"].radii


def test_answers_are_enclosed_where_joints_have_coordinates_of_their_own():
    (where,) = places(check(ScrewJack(0.8).scene(samples=4), ["pinocchio"], arbiter=True)).values()

    assert [getattr(where, place) for place in PLACES] == [4, 0, 0, 0]


def test_without_the_arbiter_nothing_is_enclosed():
    assert set(places(check(refkin.load(JUMP), ["exudyn"])).values()) == {None}


def test_the_table_of_the_arbiter_has_a_row_for_each_answer():
    record = check(refkin.load(JUMP), ["exudyn", "pinocchio"], arbiter=True)

    assert arbiter_table(record).row_count == 3


def test_bodies_that_are_not_wanted_are_not_judged():
    scene = refkin.load(JUMP)
    fewer = refkin.model.Scene(mechanism=scene.mechanism, times=scene.times, bodies_wanted=("crank",))

    # The crank is where its driver has it, on whichever assembly.
    assert places(check(fewer, ["exudyn"], arbiter=True))["shipped"].outside == 0


def test_a_run_may_be_held_against_no_table_or_that_of_a_file(tmp_path):
    path = tmp_path / "gaps.toml"
    path.write_text("", encoding="utf-8")

    assert known_gaps.table("none") == known_gaps.table(str(path)) == ()
    assert known_gaps.table() == known_gaps.read() != ()


def test_a_row_is_found_again_by_the_first_record_that_shows_it():
    (gap, *_) = known_gaps.read()
    shown = check(refkin.load(JUMP), [gap.engine])
    quiet = replace(shown, disagreements=[])

    assert known_gaps.found_again([gap], [quiet, quiet, shown, shown]) == [3]
    assert known_gaps.found_again([gap], [quiet]) == [None]
