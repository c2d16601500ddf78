"""The table of known gaps: every row still shows on its scene, covers only what it says, and no row is malformed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import refkin
from crosscheck.judge.known_gaps import ENOUGH, PREDICATES, InvalidGap, KnownGap, Tally, read, read_findings
from crosscheck.judge.records import Cause, Disagreement, Record
from crosscheck.measure import jobs
from crosscheck.measure.check import check
from crosscheck.night.campaign import still_shows
from refkin import FourBar, Polynomial
from refkin.motion import Status
from tests.places import CORPUS, ROOT

from .made_up_engines import Made
from .report_records import WHO, answer, typed
from .report_records import record as planted

GAPS = read()
ROW = """
[[gap]]
engine = "exudyn"
method = "shipped"
kind = "other assembly"
predicate = "anywhere"
reason = "planted"
class = "our misuse"
date = 2026-11-21
reproduction = "examples/crank-rocker.toml"
"""


def record_of(path: str, engine: str) -> Record:
    """Return the record of a scene of the corpus; its name says whether it ends in a singular pose, is for features."""
    about = {"expected": "singular" if "singular-in-the-end" in path else "ok", "of_features": "/features-" in path}
    return check(refkin.load(ROOT / path), [engine], about)


def shows(gap: KnownGap) -> bool:
    """Whether a gap still shows on its reproduction."""
    record = record_of(gap.reproduction, gap.engine)
    return any(gap.covers(record, item) for item in record.disagreements)


@pytest.mark.parametrize("gap", GAPS, ids=lambda gap: gap.reproduction)
def test_the_reproduction_of_every_row_still_shows_its_gap(gap):
    assert shows(gap)


@pytest.mark.parametrize("gap", GAPS, ids=lambda gap: gap.reproduction)
def test_the_best_method_is_free_of_what_a_row_about_another_method_says(gap):
    record = record_of(gap.reproduction, gap.engine)

    assert Tally(GAPS).add(record) == []


@pytest.mark.parametrize(
    ("about", "sigma_per_step", "expected"),
    [
        ({}, 1.9, {"anywhere", "step_beyond_newton"}),
        ({"dimension": "planar", "expected": "ok"}, 2.0, {"anywhere"}),
        ({"dimension": "spatial"}, 2.1, {"anywhere"}),
        ({"dimension": "spatial"}, 1.9, {"anywhere", "step_beyond_newton", "step_beyond_newton_in_space"}),
        ({"expected": "singular"}, 2.1, {"anywhere", "ends_in_a_singular_pose"}),
    ],
)
def test_a_gap_is_looked_for_in_the_scenes_that_it_is_about_and_in_no_other(about, sigma_per_step, expected):
    record = typed(planted("a scene"))
    record = replace(record, about=about, reference=replace(record.reference, sigma_per_step=sigma_per_step))

    assert {name for name, predicate in PREDICATES.items() if predicate(record)} == expected


@pytest.mark.parametrize(("dimension", "redundant"), [("planar", True), ("planar", False), ("spatial", True)])
def test_redundant_rows_are_a_gap_in_the_plane_alone(dimension, redundant):
    record = typed(planted("a scene"))
    record = replace(
        record,
        about={"dimension": dimension},
        reference=replace(record.reference, redundant=redundant, sigma_per_step=9.0),
    )

    assert ("redundant_in_the_plane" in {name for name, holds in PREDICATES.items() if holds(record)}) == (
        redundant and dimension == "planar"
    )


def test_no_answer_on_the_way_to_the_other_assembly_is_as_well_known_in_the_plane_as_in_space():
    record = record_of("tests/corpus/exudyn-shipped-no-answer.toml", "exudyn")

    assert {Cause.OTHER_ASSEMBLY, Cause.NO_ANSWER} <= {item.kind for item in record.disagreements}
    assert Tally(GAPS).add(record) == []


def test_a_row_whose_reproduction_shows_nothing_is_stale():
    (gap,) = read(ROW)

    assert not shows(gap)


def test_every_scene_of_the_corpus_belongs_to_a_row_or_to_a_test():
    result = " ".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py"))
    result += " ".join(gap.reproduction for gap in GAPS) + " ".join(finding.scene for finding in read_findings())

    assert [path.name for path in CORPUS.glob("*.toml") if path.name not in result] == []


FAULTS = {
    "engine": (ROW.replace('engine = "exudyn"\n', ""), "gap.0.engine: missing; field required"),
    "reproduction": (ROW.replace('reproduction = "examples', 'x = "'), "gap.0.reproduction: missing; field required"),
    "unknown key": (ROW + "colour = 1\n", "gap.0.colour: 1; unexpected keyword argument"),
    "predicate": (ROW.replace("anywhere", "nowhere"), "gap.0.predicate: 'nowhere'; .* there are: step_beyond_newton"),
    "class": (ROW.replace("our misuse", "bad"), "gap.0.class: 'bad'; input should be 'contract violated', 'documented"),
    "date": (ROW.replace("2026-11-21", '"today"'), "gap.0.date: 'today'; input should be a valid date"),
    "time": (ROW.replace("2026-11-21", "2026-11-21T00:00:00"), "gap.0.date: .* input should be a valid date"),
    "text of a date": (ROW.replace("2026-11-21", '"2026-11-21"'), "gap.0.date: '2026-11-21'; input should be a valid"),
    "no text": (ROW.replace('"planted"', '""'), "gap.0.reason: ''; string should have at least 1 character"),
    "no method": (ROW.replace('"shipped"', '""'), "gap.0.method: ''; expected a text, or no such key"),
    "another word for a key": (ROW.replace("class =", "kind_of_gap ="), "gap.0.class: missing; field required"),
    "no table": ("gap = 3", "gap: 3; input should be a valid tuple"),
    "a number": (ROW.replace('"shipped"', "3"), "gap.0.method: 3; input should be a valid string"),
    "all that is ever wrong": (
        ROW.replace('kind = "other assembly"\n', ""),
        "gap.0.predicate: 'anywhere'; expected a quantity or",
    ),
    "second row": (ROW + ROW.replace("anywhere", "nowhere"), "gap.1.predicate"),
    "another table": (ROW.replace("[[gap]]", "[[gaps]]"), "gaps: no such key; there is: gap"),
    "not TOML": (ROW + "[[", r"no TOML: .*\(at end of document\)"),
}


@pytest.mark.parametrize(("text", "told"), FAULTS.values(), ids=FAULTS)
def test_a_row_that_makes_no_sense_gets_one_clear_error(text, told):
    with pytest.raises(InvalidGap, match=told) as error:
        read(text)

    assert "\n" not in str(error.value)


def record(*kinds: Cause, sigma_per_step: float | None = 0.1, method: str = "shipped") -> Record:
    """Return a record in which exudyn answered by a method and has disagreements of some kinds."""
    scene = typed(planted("a", answer("exudyn", {}, method={**WHO, "name": method})))
    fields = {"engine": "exudyn", "method": method, "quantity": "position", "ratio": 9.0}
    disagreements = [Disagreement(**fields, kind=kind, how="SIGSEGV" * (kind is Cause.CRASH)) for kind in kinds]
    assert scene.reference is not None
    row = replace(scene.reference, sigma_per_step=sigma_per_step)
    return replace(scene, reference=row, disagreements=disagreements)


JUMP = Cause.OTHER_ASSEMBLY


@pytest.mark.parametrize(
    ("met", "new"),
    [
        (record(JUMP), []),
        (record(JUMP, sigma_per_step=2.0), [JUMP]),
        (record(JUMP, sigma_per_step=None), [JUMP]),
        (record(JUMP, method="static"), [JUMP]),
        (record(Cause.BEYOND), ["beyond the allowed error"]),
        (record(JUMP, Cause.CRASH), ["crash (SIGSEGV)"]),
    ],
    ids=["covered", "step within Newton's reach", "one time", "best method", "another kind", "one of two"],
)
def test_a_row_covers_what_it_says_and_no_more(met, new):
    assert [d.name for d in Tally(GAPS).add(met)] == new


@pytest.mark.parametrize(("missing", "new"), [(1, 0), (3, 0), (4, 1)])
def test_no_step_is_to_blame_where_there_is_no_pose_to_step_from(missing, new):
    met = record(Cause.NO_ANSWER)
    met = replace(met, answers=[replace(met.answers[0], times=4, missing=missing)])

    assert len(Tally(GAPS).add(met)) == new


@pytest.mark.parametrize("kind", [JUMP, Cause.NO_ANSWER])
def test_no_step_is_to_blame_that_comes_later(kind):
    """Seven of ten scenes of a night have such a step somewhere: whatever went wrong before it was known."""
    met = record(kind)
    met = replace(met, answers=[replace(met.answers[0], times=4, missing=1)])
    early = replace(met, disagreements=[replace(met.disagreements[0], bound=True)])

    assert [len(Tally(GAPS).add(x)) for x in (met, early)] == [0, 1]


@pytest.mark.parametrize(("wrong_from", "bound"), [(0, True), (1, True), (2, False), (3, False)])
def test_what_is_wrong_before_a_step_beyond_newton_says_so(wrong_from, bound):
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.6)
    times = (1.0, 1.02, 1.04, 3.1)
    scene = linkage.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=times, branch="open")
    other = linkage.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=times, branch="crossed")

    def crossed(motion):
        here = np.arange(len(times)) >= wrong_from
        ends = zip(motion.levels, refkin.solve(other).levels, strict=True)
        return replace(motion, **{k: np.where(here, x, y) for k, (y, x) in zip(("q", "qd", "qdd"), ends, strict=True)})

    def silent(motion):
        ok = [s if k < wrong_from else Status.NOT_CONVERGED for k, s in enumerate(motion.status)]
        return replace(motion, status=tuple(ok))

    for change, kind in ((crossed, Cause.OTHER_ASSEMBLY), (silent, Cause.NO_ANSWER)):
        met = [d for d in check(scene, [Made("made", change)]).disagreements if d.kind is kind]
        assert met
        assert {d.bound for d in met} == {bound}


def test_a_row_covers_nothing_of_another_engine():
    met = record(JUMP)
    met = replace(met, disagreements=[replace(met.disagreements[0], engine="mujoco")])

    assert len(Tally(GAPS).add(met)) == 1


def test_a_scene_of_which_nothing_is_known_is_covered_by_no_row():
    met = replace(record(JUMP), reference=None, failure="none")

    assert len(Tally(read(ROW)).add(met)) == 1


@pytest.mark.parametrize(
    ("records", "closed"),
    [
        ([record()] * ENOUGH, True),
        ([record()] * (ENOUGH - 1), False),
        ([record()] * ENOUGH + [record(JUMP)], False),
        ([record(sigma_per_step=5.0)] * (2 * ENOUGH), False),
        ([record(method="static")] * (2 * ENOUGH), False),
    ],
    ids=["many scenes of its kind", "too few", "it showed once", "scenes of another kind", "its method did not run"],
)
def test_a_row_is_possibly_closed_when_it_did_not_show_in_many_scenes_of_its_kind(records, closed):
    tally = Tally(GAPS[:1])
    for met in records:
        tally.add(met)

    assert tally.possibly_closed() == ([(GAPS[0], ENOUGH)] if closed else [])


def test_a_gap_of_space_is_not_possibly_closed_by_scenes_of_the_plane():
    (row,) = (gap for gap in GAPS if gap.match.get("kind") == Cause.REVERSED)
    plane, space = (replace(record(), about={"dimension": dimension}) for dimension in ("planar", "spatial"))

    assert (row.could_show(plane), row.could_show(space)) == (False, True)


def test_every_predicate_is_told_what_it_holds_for():
    assert all(predicate.__doc__ for predicate in PREDICATES.values())


def test_a_record_says_how_small_sigma_is_against_the_steps_beside_it():
    scene = refkin.load(ROOT / "examples" / "crank-rocker.toml")
    motion, size = refkin.solve(scene), scene.mechanism.size()
    ratios = []
    for k in range(len(scene.times) - 1):
        change = [abs(row[k + 1] - row[k]) / (1.0 if j % 3 == 2 else size) for j, row in enumerate(motion.q)]
        ratios.append(min(motion.sigma_min[k], motion.sigma_min[k + 1]) / max(change))

    assert check(scene, []).reference.sigma_per_step == pytest.approx(min(ratios), rel=1e-12, abs=0.0)


@pytest.mark.parametrize("gap", [gap for gap in GAPS if gap.predicate == "ends_in_a_singular_pose"])
def test_a_gap_that_a_night_missed_is_not_possibly_closed_while_its_own_scene_shows_it(gap):
    asked: list[tuple[str, ...]] = []

    def check_one(job, engines):
        asked.append(tuple(engines))
        return jobs.check_job({**job, "engines": engines})

    def right(job, engines):
        return replace(check_one(job, engines), disagreements=[])

    assert still_shows(SimpleNamespace(check_one=check_one), gap)
    assert not still_shows(SimpleNamespace(check_one=right), gap)
    for no_scene in ("nowhere.toml", "README.md"):
        assert not still_shows(SimpleNamespace(check_one=check_one), replace(gap, reproduction=no_scene))
    assert asked == [(gap.engine,)] * 2
