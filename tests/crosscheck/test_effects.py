"""The ledger of effects: every effect has a row, whoever feels one is named, whoever fails is a row, noise is noise."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from crosscheck.cli import main
from crosscheck.commands.bench import absent_lines, felt_lines, ledger_table
from crosscheck.engines.loading import load
from crosscheck.engines.methods import Use, methods
from crosscheck.judge.changes import _difference, same_bits
from crosscheck.judge.comparison import reference
from crosscheck.measure import effects as ledger
from crosscheck.measure.effects import ablations, effects_ledger, noise, rows
from crosscheck.report.prices import effects_bars, look, parts
from crosscheck.scenes.names import PHYSICAL
from crosscheck.workers.processes import Failure, FailureKind
from refkin.model import Point
from refkin.motion_laws import Sinusoid
from refkin.solving.solve import solve
from tests.linkages import ROCKER
from tests.places import EXAMPLES

from .fake_engines import EXIT, HANG, RAISE, engine_file
from .report_records import effect_row

EXAMPLE = EXAMPLES / "crank-rocker.toml"
KEYS = {"engine", "effect", "microseconds", "inert", "largest_change"}
CALLED_FOR = {"velocity", "acceleration", "points", "other bodies", "condition", "certificate"}
SCENE = ROCKER.scene(speed=2.0, turns=0.1, samples=5)
FELT = """
    def physical_effects(self):
        return {"gravity": "a planted one", "contact": "one that is isolated"}

    def missing_effects(self):
        return {"sensors": "it has none"}

    def with_effect(self, effect):
        other = type(self)()
        other.effect = effect
        return other

    def dynamic_routes(self):
        return ()
"""


def simulating(folder, planted):
    """Return an engine with two effects; `planted` is what is done to its answer under `effect`."""
    spec = engine_file(folder, name="feeling", after=f"effect = getattr(self, 'effect', None)\n        {planted}")
    path = Path(spec.rsplit(":", 1)[0])
    text = path.read_text(encoding="utf-8")
    path.write_text(text + FELT, encoding="utf-8")
    return spec


def only(actual, effect, engine=None):
    (row,) = (r for r in actual if r.effect == effect and engine in (None, r.engine))
    return row


def rows_of(spec, scene=SCENE):
    """Return the rows of an engine in this process, with the fewest rounds."""
    ref = reference(scene)
    return [row for method in methods(spec, Use.EFFECTS) for row in rows(ablations(method, scene), ref, 0.0)]


def of_refkin(scene=SCENE):
    (method,) = methods("refkin", Use.EFFECTS)
    return ablations(method, scene)


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """What the command prints for refkin and the three engines."""
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(EXAMPLE.read_text(encoding="utf-8").replace("count = 73", "count = 3"), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch, pytest.MonkeyPatch.context() as out:
        lines = []
        patch.setattr("builtins.print", lambda text, file=None, **_: file or lines.append(text))
        out.setattr("crosscheck.commands.bench.effects_ledger", partial(effects_ledger, within=1.5))
        with pytest.raises(SystemExit) as ended:
            main(["effects", str(path), "--json"])
    return ended.value.code, json.loads("".join(lines))


def test_the_command_prints_one_object_with_the_promised_keys(printed):
    code, result = printed

    assert code == 0
    assert (result["schema"], result["scene"]) == (2, "crank-rocker")
    assert all(set(row) >= KEYS for row in result["rows"])
    assert {row["engine"] for row in result["rows"]} == {"refkin", "exudyn", "mujoco", "pinocchio"}


def test_every_effect_has_one_row_by_every_method(printed):
    _, result = printed
    by_method = Counter((row["engine"], row["method"]) for row in result["rows"])
    effects = {(row["engine"], row["method"], row["effect"]) for row in result["rows"]}

    assert len(effects) == len(result["rows"])
    assert {effect for _, _, effect in effects} == CALLED_FOR | set(PHYSICAL)
    assert set(by_method.values()) == {len(CALLED_FOR) + len(PHYSICAL)}


def test_a_row_without_a_price_says_why(printed):
    _, result = printed

    assert all(row["note"] for row in result["rows"] if row["microseconds"] is None)


def test_nothing_that_refkin_computes_in_addition_changes_a_bit_of_the_rest(printed):
    _, result = printed
    ours = [row for row in result["rows"] if row["engine"] == "refkin" and row["effect"] in CALLED_FOR]

    assert [(row["inert"], row["largest_change"]) for row in ours] == [(True, 0.0)] * len(CALLED_FOR)


def test_no_effect_is_felt_by_a_method_that_answers_the_crank_rocker(printed):
    _, result = printed

    assert not [row for row in result["rows"] if row["inert"] is False and row["method"] != "forward dynamics"]


def test_ablation_sees_the_effects_where_soft_dynamics_feel_them(printed):
    _, result = printed
    felt = {row["effect"] for row in result["rows"] if row["engine"] == "mujoco" and row["inert"] is False}

    assert felt == set(PHYSICAL) - {"sensors"}


def test_gravity_left_on_where_it_is_felt_is_not_inert_and_is_named(tmp_path):
    spec = simulating(tmp_path, "motion = replace(motion, q=motion.q + 1e-6 * (effect == 'gravity'))")
    result = rows_of(spec)

    assert (only(result, "gravity").inert, only(result, "contact").inert) == (False, True)
    assert only(result, "gravity").largest_change == pytest.approx(1e-6, rel=1e-6)
    (line,) = felt_lines(result)
    assert line.startswith("not inert: gravity in feeling, made up: changes position of ")


@pytest.mark.parametrize(
    ("change", "worst"),
    [
        ("if effect == 'gravity': motion = replace(motion, qdd=motion.qdd + 9.81)", "acceleration of "),
        (
            "motion = replace(motion, status=(Status.SINGULAR,) * 5) if effect else motion",
            "ok becomes singular at t = ",
        ),
    ],
    ids=["accelerations alone", "an answer"],
)
def test_gravity_that_is_felt_in_accelerations_alone_or_costs_an_answer_is_not_inert(tmp_path, change, worst):
    assert only(rows_of(simulating(tmp_path, change)), "gravity").worst.startswith(worst)


def test_a_refusal_with_an_effect_alone_is_not_inert(tmp_path):
    spec = simulating(tmp_path, "if effect == 'gravity': raise EngineError('it falls')")
    row = only(rows_of(spec), "gravity")

    assert (row.inert, row.microseconds, row.note) == (False, None, "a planted one: it falls")


def test_of_a_scene_that_is_refused_nothing_is_known(tmp_path):
    result = rows_of(engine_file(tmp_path, before='raise EngineError("no such joint")'))

    assert {row.inert for row in result} == {None}
    assert only(result, "velocity").note == "no answer without it: no such joint"


def test_an_effect_that_an_engine_has_not_is_told_with_its_reason(tmp_path):
    result = rows_of(simulating(tmp_path, "pass"))

    assert "no price in feeling (made up): sensors: it has none" in absent_lines(result)


def test_an_engine_that_simulates_nothing_is_told_to_have_none(tmp_path):
    result = rows_of(engine_file(tmp_path))

    assert {row.note for row in result if row.effect in PHYSICAL} == {"the engine offers no simulation to switch on"}


def bitwise(effect, nudge):
    """Return refkin's rows where the answer with one effect is nudged."""
    result = of_refkin()
    plain = result.runs[effect]
    return rows(replace(result, runs={**result.runs, effect: lambda: nudge(plain())}), reference(SCENE), 0.0)


def test_one_bit_that_an_uncalled_effect_changes_in_refkin_is_named():
    result = bitwise("certificate", lambda motion: replace(motion, q=np.nextafter(motion.q, np.inf)))

    assert [row.effect for row in result if row.inert is False] == ["certificate"]
    assert only(result, "certificate").worst.startswith("position of ")


def test_the_same_bit_is_within_the_allowed_error_of_an_engine(tmp_path):
    spec = simulating(tmp_path, "motion = replace(motion, q=np.nextafter(motion.q, np.inf) if effect else motion.q)")

    assert only(rows_of(spec), "gravity").inert is True


def test_a_bit_of_the_residual_counts_in_refkin_too():
    result = bitwise("condition", lambda motion: replace(motion, residual=np.nextafter(motion.residual, np.inf)))

    assert [row.effect for row in result if row.inert is False] == ["condition"]


@pytest.mark.parametrize("level", ["r", "v", "a"])
def test_a_bit_of_a_point_counts_in_refkin_too(level):
    motion = solve(replace(SCENE, points=(Point(name="P", body="coupler", position=(0.1, 0.2)),)))
    point = motion.points["P"]
    other = replace(point, **{level: np.nextafter(getattr(point, level), np.inf)})

    assert same_bits(motion, motion)
    assert not same_bits(motion, replace(motion, points={"P": other}))
    assert same_bits(motion, replace(motion, points={}))


@pytest.mark.parametrize(
    ("fault", "told"), [(EXIT, "crash (exit code 7)"), (RAISE, "ZeroDivisionError: by the test"), (HANG, "hang")]
)
def test_an_engine_that_fails_with_one_effect_is_a_row_and_the_others_are_measured(fault, told, tmp_path, monkeypatch):
    monkeypatch.setattr(ledger, "START", 8.0)
    spec = simulating(tmp_path, f"if effect == 'gravity': {fault.split('  #')[0]}")
    result = effects_ledger(SCENE, [spec], within=0.5)

    assert told in only(result, "gravity", "feeling").note
    assert only(result, "gravity", "feeling").inert is False
    assert only(result, "contact", "feeling").inert is True
    assert only(result, "velocity", "refkin").microseconds is not None


def test_an_engine_that_always_ends_its_process_is_known_for_nothing(tmp_path):
    result = effects_ledger(SCENE, [engine_file(tmp_path, before=EXIT)], within=0.5)
    theirs = [row for row in result if row.engine == "fake"]

    assert {row.effect for row in theirs} == CALLED_FOR | set(PHYSICAL)
    assert {row.inert for row in theirs} == {None}
    assert only(theirs, "velocity").note == "crash (exit code 7): its process ended: exit code 7"


def priced(microseconds, spread, effect="gravity", engine="made up"):
    return effect_row(effect, engine=engine, microseconds=microseconds, spread=spread, largest_change=0.0)


def test_what_an_effect_seems_to_save_is_noise():
    assert noise([5.0, 5.0, 5.0, 5.0], [4.0, 4.0, 4.0, 4.0]) == 1.0


def test_noise_is_how_far_the_difference_of_least_times_differs_between_rounds():
    assert noise([1.0, 1.0], [2.0, 2.5]) == 0.5


def test_the_noise_of_one_round_is_not_known():
    assert noise([1.0], [2.0]) is None


@pytest.mark.parametrize(("microseconds", "spread", "within"), [(3.0, 1.0, False), (0.5, 1.0, True), (-0.5, 1.0, True)])
def test_a_price_no_larger_than_its_noise_is_shown_as_such(microseconds, spread, within):
    row = priced(microseconds, spread)
    (shown,) = ledger_table("a scene", [row]).columns[2].cells

    assert row.within_noise is within
    assert shown == ("within noise" if within else f"{microseconds:.1f}")


def test_no_price_of_the_command_is_a_saving_beyond_noise(printed):
    _, result = printed
    priced_rows = [row for row in result["rows"] if row["microseconds"] is not None]

    assert priced_rows
    assert all(row["microseconds"] >= -row["spread"] for row in priced_rows)


def test_a_price_has_its_noise_however_little_time_there_is():
    """A machine that is busy makes no more than the fewest rounds."""
    prices = [row for row in rows(of_refkin(), reference(SCENE), 0.0) if row.microseconds is not None]

    assert prices
    assert all(row.spread is not None for row in prices)


def test_a_ledger_is_plain_data_that_json_takes():
    assert json.loads(json.dumps(asdict(priced(1.0, None))))["spread"] is None


def test_points_of_the_scene_are_what_is_priced():
    scene = replace(SCENE, points=tuple(Point(name=f"P{k}", body="crank", position=(0.1 * k, 0.0)) for k in range(2)))

    assert only(rows(of_refkin(scene), reference(scene), 0.0), "points").note.startswith("2 of them")


@pytest.mark.parametrize("spec", ["exudyn", "mujoco", "pinocchio", "vector_loop"])
@pytest.mark.parametrize(("effects", "highest"), [((), 1), (("velocity",), 1), (("acceleration",), 2)])
def test_no_engine_evaluates_a_law_beyond_the_rate_that_its_march_predicts_by(spec, effects, highest, monkeypatch):
    """The march of vector loops predicts by accelerations as well."""
    orders, plain = set(), Sinusoid.__call__

    def counting(law, t, order=0):
        orders.add(order)
        return plain(law, t, order)

    law = Sinusoid(offset=0.5, amplitude=0.3, angular_frequency=1.0, phase=0.0)
    scene = ROCKER.scene(law=law, times=[0.0, 0.1, 0.2], effects=effects, evidence=())
    monkeypatch.setattr(Sinusoid, "__call__", counting)
    load(spec).solve(scene)

    assert orders == set(range(3 if spec == "vector_loop" else highest + 1))


def test_a_scene_without_a_pose_is_told_in_one_line_and_nobody_is_asked(tmp_path, command):
    path = tmp_path / "apart.toml"
    path.write_text(EXAMPLE.read_text(encoding="utf-8").replace("[4.0, 0.0]", "[40.0, 0.0]"), encoding="utf-8")
    code, out, err = command("effects", path)

    assert (code, out) == (1, "")
    assert "no pose, so no effect has a price: coupler and rocker cannot meet" in err


def test_noise_is_told_from_three_groups_of_many_rounds_and_from_two_of_few():
    after = [1.0 + extra for extra in (3.0, 5.0, 9.0, 4.0, 6.0, 8.0)]

    assert noise([1.0] * 6, after) == 8.0 - 3.0  # by every third round: 3, 5 and 8
    assert noise([1.0] * 5, after[:5], per=2.0) == 2.0 * (4.0 - 3.0)  # by every second one: 3 and 4


HUNG = Failure(FailureKind.HANG, "no answer within 9 s")
ENDED = Failure(FailureKind.CRASH, "its process ended: SIGSEGV", "SIGSEGV")


@pytest.mark.parametrize("known", [True, False], ids=["answers with others", "has no answer at all"])
def test_of_an_engine_that_fails_as_a_whole_every_effect_is_asked_alone_until_too_many_hang(known, monkeypatch):
    """What fails where another effect is known is felt; what is no longer asked is told as the whole was."""
    bad, asked, told = ("points", "condition", "gravity", "contact", "friction"), [], []

    def answered(function, arguments, seconds):
        for _, spec, share, effect in arguments:
            asked.append((spec, share, effect, seconds))
            if spec == "bad" and (not effect or effect in bad or not known):
                yield ENDED if not effect else HUNG
            else:
                yield [priced(1.0, 0.5, engine=f"{spec} named", effect=effect or "all")]

    monkeypatch.setattr(ledger, "call_in_turn", answered)
    there = effects_ledger(SCENE, ["bad"], 10.0, lambda *words: told.append(words))
    found = {row.effect: row for row in there if row.engine != "refkin named"}
    tried = [effect for spec, _, effect, _ in asked if spec == "bad"]

    assert told == [(0, "refkin"), (1, "bad")]
    assert [row.effect for row in there if row.engine == "refkin named"] == ["all"]
    assert [asked[k][1:] for k in (0, 1, 2)] == [
        (5.0, "", 5.0 + ledger.START),
        (5.0, "", 5.0 + ledger.START),
        (0.0, "velocity", ledger.START),
    ]
    assert list(found) == list(ledger.EFFECTS)
    last = "contact" if known else ledger.EFFECTS[ledger.MOST_HANGS - 1]
    assert tried == ["", *ledger.EFFECTS[: ledger.EFFECTS.index(last) + 1]]
    for effect, row in found.items():
        fails = effect not in tried or effect in bad or not known
        assert row.engine == ("bad named" if known else "bad")
        assert row.inert is ((False if known else None) if fails else True)
        assert row.microseconds == (None if fails else 1.0)
        whole = "crash (SIGSEGV): its process ended: SIGSEGV"
        assert row.note == ("" if not fails else "hang: no answer within 9 s" if effect in tried else whole)
        assert row.called_for is (fails and effect not in PHYSICAL)


def test_an_engine_of_a_file_that_never_answers_has_its_own_name(tmp_path, monkeypatch):
    monkeypatch.setattr(ledger, "call_in_turn", lambda function, arguments, seconds: (HUNG for _ in arguments))

    assert {row.engine for row in effects_ledger(SCENE, [engine_file(tmp_path)], 1.0)} == {"refkin", "fake"}


def test_a_number_that_one_answer_has_and_the_other_has_not_is_a_change_without_end():
    motion = (ref := reference(ROCKER.scene(samples=3))).motion
    gone = replace(motion, q=np.where(np.arange(3) == 1, np.nan, motion.q))
    changes = [_difference(ref, *pair, motion.bodies, 0) for pair in ((gone, motion), (motion, gone), (gone, gone))]

    assert [np.max(change, axis=0).tolist() for change in changes] == [[0.0, np.inf, 0.0]] * 2 + [[0.0] * 3]


def drawn(effect, microseconds):
    return replace(priced(microseconds, 0.1, effect), called_for=effect not in PHYSICAL)


def test_no_two_effects_look_alike():
    looks = [look(effect) for effect in ("position", *CALLED_FOR, *PHYSICAL)]

    assert len(set(looks)) == len(looks)


def test_an_effect_looks_the_same_whatever_else_is_drawn():
    alone, among = ([drawn("velocity", 5.0)], [drawn("gravity", 9.0), drawn("velocity", 5.0)])
    fills = [_fill_of("velocity", effects_bars(rows)) for rows in (alone, among)]

    assert fills[0] == fills[1]


def test_a_bar_begins_with_the_cost_of_positions_and_leaves_noise_out():
    shown = [drawn("velocity", 5.0), drawn("gravity", 0.05), drawn("contact", None)]

    assert parts(shown) == {("made up", "newton"): [("position", 10.0, True), ("velocity", 5.0, True)]}


def test_an_effect_of_an_engine_that_nobody_knows_is_drawn():
    assert _fill_of("wind", effects_bars([drawn("wind", 5.0)]))


def _fill_of(effect, figure):
    """Return fill and opacity of the part of a bar that carries the name of an effect."""
    of = lambda element: element.tag.rpartition("}")[2]  # noqa: E731
    for box in ET.fromstring(figure).iter():
        title = next((child.text or "" for child in box if of(child) == "title"), "")
        if of(box) == "rect" and title.startswith(f"{effect}:"):
            return box.get("fill"), box.get("fill-opacity")
    raise AssertionError(f"no part is called {effect!r}")
