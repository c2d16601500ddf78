"""`crosscheck bench` on tiny workloads: the JSON's shape, errors that are noticed, methods absent by name."""

from __future__ import annotations

import io
import json
import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

import refkin
from crosscheck.commands.bench import print_results
from crosscheck.engines import EngineError
from crosscheck.engines.methods import Batch, Use, methods
from crosscheck.engines.ours import c_kernels
from crosscheck.engines.ours.c_kernels import text_of
from crosscheck.judge import workloads
from crosscheck.judge.workloads import of_four_bars
from crosscheck.measure import bench as measure
from crosscheck.measure.bench import _entries, key_of
from crosscheck.scenes import workloads as works
from crosscheck.scenes.four_bar_answers import four_bar
from crosscheck.scenes.workloads import AnswerPiece, system_of, unit_of
from crosscheck.workers import timing
from crosscheck.workers.processes import Failure, FailureKind
from crosscheck.workers.timing import Timing
from refkin.solving import limits
from refkin.system import compile_system
from tests.places import ROOT

COMPILER = any(map(shutil.which, c_kernels.COMPILERS))
THERE = [producer for producer in measure.PRODUCERS if COMPILER or producer != "c"]
KEYS = {
    "workload": str,
    "engine": str,
    "method": str,
    "setting": str,
    "nanoseconds_per_configuration": float,
    "unit": str,
    "spread": float,
    "max_error": float,
    "worst_over_allowed": float,
    "computes": list,
}
"""The public interface: every row has these keys."""


def method(producer, name):
    return next(one for one in methods(producer) if one.key == (producer, name, ""))


def tiny():
    return works.sweep(24)


def few():
    return works.many("many-10000x360", 5, 24, works.MARGIN)


def short():
    return works.LoopChain("chain-10", 3)


@pytest.fixture(scope="module")
def results():
    return {work.name: measure.measured(work, rounds=1) for work in (tiny(), few(), short())}


@pytest.mark.parametrize("work", [tiny(), few(), short()], ids=lambda w: w.name)
def test_every_method_is_a_row_or_absent_by_name(results, work):
    value = results[work.name]
    rows, absent = ({key_of(entry) for entry in value[kind]} for kind in ("rows", "absent"))
    listed = {m.key for p in THERE for m in methods(p, Use.BENCH)}

    assert rows | {key for key in absent if key[1] != "any"} == listed
    assert not rows & absent
    assert all(entry["reason"] for entry in value["absent"])


def test_every_producer_that_is_there_has_a_row_of_one_mechanism(results):
    assert {row["engine"] for row in results["sweep-1000"]["rows"]} == {*THERE}


@pytest.mark.parametrize("work", [tiny(), few()], ids=lambda w: w.name)
def test_positions_alone_are_a_row_of_their_own_where_they_are_computed_alone(results, work):
    computed = {}
    for row in results[work.name]["rows"]:
        computed.setdefault(key_of(row), []).append(len(row["computes"]))

    assert computed["numpy", "closed form", ""] == [3]
    assert computed["refkin", "solve", "no evidence"] == [3, 1]


@pytest.mark.parametrize("name", ["sweep-1000", "many-10000x360", "chain-10"])
def test_rows_have_the_keys_and_types_of_the_interface(results, name):
    rows = json.loads(json.dumps(results[name], allow_nan=False))["rows"]

    for row in rows:
        assert {key: type(row[key]) for key in KEYS} == KEYS
        assert row["workload"] == name
        assert row["unit"] == ("newton-iteration" if name.startswith("chain") else "configuration")
        assert set(row["computes"]) <= {"position", "velocity", "acceleration", "certificate"}
        assert row["nanoseconds_per_configuration"] > 0.0
        assert row["spread"] >= 0.0


@pytest.mark.parametrize("name", ["sweep-1000", "many-10000x360", "chain-10"])
def test_every_method_is_as_right_as_it_can_be(results, name):
    """Measured, not assumed: each row's own answers, against the closed form in long double."""
    wrong = [key_of(row) for row in results[name]["rows"] if not (row["ranked"] and row["worst_over_allowed"] <= 1.0)]

    assert not wrong


def test_the_names_of_the_workloads_are_the_interface():
    chains = (f"chain-{n}" for n in (10, 100, 1000, 10_000))
    plane, space = ("sweep-1000", "many-10000x360", "many-10000x360-any", *chains), ("rssr-1000", "rssrs-100x72")
    assert tuple(works.WORKLOADS) == (*plane, *space)


def test_workloads_are_as_large_as_their_names_say():
    sizes = [w.configurations for w in map(works.workload, list(works.WORKLOADS)[:3])]

    assert sizes == [1000, 3_600_000, 3_600_000]
    assert [works.workload(f"chain-{n}").windows for n in works.WINDOWS] == [10, 100, 1000, 10_000]


def test_the_margin_is_a_part_of_the_longest_length_and_the_other_work_has_none():
    for margin, low in ((works.MARGIN, works.MARGIN), (0.0, 0.0)):
        lengths = np.sort(works.grashof(2000, margin), axis=0)
        part = (lengths[1] + lengths[2] - lengths[0] - lengths[3]) / lengths[3]

        assert low < part.min() < low + 0.01


@pytest.mark.parametrize("sample", range(3))
def test_the_truth_is_what_the_reference_finds(sample):
    work = few()
    motion = refkin.solve(work.scene(sample))
    truth = four_bar(work.lengths[:, sample, None].astype(np.longdouble), work.t.astype(np.longdouble))

    for order, (exact, item) in enumerate(zip(truth, motion.levels, strict=True)):
        error = exact - item
        if order == 0:
            error[2::3] -= np.round(error[2::3] / (2 * np.pi)) * 2 * np.pi
        assert np.max(np.abs(error)) < 1e-13 * max(1.0, float(np.max(np.abs(exact))))


def test_the_truth_of_a_chain_is_what_the_reference_finds():
    """Its second loop is driven with an acceleration of its own."""
    work = short()
    motion = refkin.solve(work.scene)

    for exact, item in zip(work.truth(), motion.levels, strict=True):
        assert np.max(np.abs(exact - item[:, 0])) < 1e-14


def test_equations_of_many_mechanisms_are_those_of_each():
    work = few()
    samples = np.arange(work.mechanisms)
    q = np.random.default_rng(0).normal(size=(9, work.mechanisms))
    together = system_of(work, samples).phi(q, np.full(work.mechanisms, 0.3))

    for sample in samples:
        mechanism = work.scene(sample).mechanism
        alone = compile_system(mechanism, unit=mechanism.unit()).phi(q[:, sample], 0.3)
        assert np.allclose(together[:, sample], alone, rtol=0.0, atol=1e-15)


def answers(work, levels):
    samples = np.arange(work.mechanisms)
    times = np.arange(len(work.t))
    return AnswerPiece(np.repeat(samples, len(times)), np.tile(times, len(samples)), range(9), levels)


def right(work):
    return [x.reshape(9, -1) for x in four_bar(work.lengths[:, :, None], work.t[None, :])]


def test_right_answers_are_ranked():
    work = few()

    result = of_four_bars(work, [answers(work, tuple(right(work)))])

    assert result.ranked
    assert 0.0 < result.worst_over_allowed < 0.9
    assert result.configurations == work.configurations


@pytest.mark.parametrize("level", range(3))
@pytest.mark.parametrize("row", [0, 5])
def test_an_error_is_stated_in_sizes_and_radians_and_that_of_a_rate_as_a_part_of_the_largest(level, row):
    work, sample = replace(few(), lengths=7.0 * few().lengths), 77
    levels, sizes = right(work), np.ones(9)
    sizes[np.arange(9) % 3 < 2] = unit_of(work.lengths[:, [sample // len(work.t)]]).size[0]
    part = np.max(np.abs(levels[level][:, sample] / sizes)) if level else 1.0
    levels[level][row, sample] += 1e-3 * part * sizes[row]

    assert of_four_bars(work, [answers(work, tuple(levels))]).max_error == pytest.approx(1e-3, rel=1e-6)


@pytest.mark.parametrize("level", range(3))
def test_one_wrong_number_among_all_is_noticed(level):
    """Also where it is not in the sample: the configurations with the largest errors are always judged."""
    work = few()
    levels = right(work)
    levels[level][5, 77] *= 1.0 + 1e-11

    result = of_four_bars(work, [answers(work, tuple(levels))])

    assert result.worst_over_allowed > 1.0
    assert result.max_error > 1e-12
    assert not result.ranked


def test_one_configuration_in_so_many_is_judged_over_all_mechanisms_and_times_and_the_worst_are(monkeypatch):
    work, judged = few(), []
    monkeypatch.setattr(workloads, "SAMPLE", work.configurations // 7)
    monkeypatch.setattr(workloads, "WORST", 1)
    monkeypatch.setattr(workloads, "_over_allowed", lambda work, piece: (judged.append(piece), (0.0, 0))[1])
    levels = right(work)
    levels[0][5, 79] += 1.0
    of_four_bars(work, [answers(work, tuple(levels))])
    numbers = [piece.mechanisms * len(work.t) + piece.times for piece in judged]

    assert np.concatenate(numbers).tolist() == [*range(0, work.configurations, 7), 79]


def test_the_other_branch_is_noticed():
    work = tiny()
    mirrored = four_bar(work.lengths[:, :, None], -work.t[None, :])  # reflected in the ground link: the other branch
    q = mirrored[0].reshape(9, -1)
    q[1::3] *= -1.0
    q[2::3] *= -1.0

    assert not of_four_bars(work, [answers(work, (q,))]).ranked


def test_no_answer_is_no_rank_and_null_in_the_json():
    work = few()
    levels = right(work)
    levels[0][:, 3] = np.nan
    batch = Batch(lambda: None, 1, lambda: [answers(work, tuple(levels))])
    row = measure.row(work, method("numpy", "closed form"), batch, Timing(1.0, 0.0))

    assert not row["ranked"]
    assert row["max_error"] is None
    assert json.dumps(row, allow_nan=False)


def test_a_row_says_what_one_configuration_costs_and_of_how_many_how_much_was_judged():
    work = few()
    batch = Batch(lambda: None, 40, lambda: [answers(work, tuple(right(work)))], "of the batch")
    row = measure.row(work, method("numpy", "closed form"), batch, Timing(2e-6, 0.25))

    assert row["nanoseconds_per_configuration"] == pytest.approx(50.0)
    assert (row["spread"], row["timed"], row["compared"], row["uncompared"]) == (0.25, 40, work.configurations, 0)
    assert row["ranked"]
    assert row["note"].endswith("of the batch")


def test_results_of_workloads_are_put_together(monkeypatch):
    """Their rows one after the other; versions and machine as the last one has them."""
    monkeypatch.setattr(measure, "measured", lambda work, by, without: {"rows": [work.name], "absent": [by, without]})
    names = ("chain-10", "many-10000x360")
    parts = [
        {**measure.measured_by_name((name, ["numpy"], ())), "versions": {"at": k}, "machine": {"number": k}}
        for k, name in enumerate(names)
    ]
    whole = measure.merged(parts)

    assert (whole["rows"], whole["absent"]) == (list(names), [["numpy"], ()] * 2)
    assert (whole["versions"], whole["machine"]) == ({"at": 1}, {"number": 1})


PLANTED = {
    "dense.c": ("gamma[6 + c] = -w[2]", "gamma[6 + c] = w[2]", "dense Newton"),
    "closed.c": ("rest > 0.0 ? sqrt(rest)", "rest > 0.0 ? -sqrt(rest)", "closed form"),
    "march.h": ("MOST_NEWTON 8", "MOST_NEWTON 1", "same program"),
}


@pytest.mark.parametrize("source", PLANTED)
def test_a_wrong_kernel_is_marked_and_not_ranked(monkeypatch, source):
    before, after, name = PLANTED[source]
    text = text_of(source)
    assert text.count(before) == 1
    monkeypatch.setattr(c_kernels, "text_of", lambda s: text.replace(before, after) if s == source else text_of(s))

    results = measure.measured(few(), rounds=1, listed=[method("c", name)])

    if not COMPILER:
        assert [entry["method"] for entry in results["absent"]] == [name]
        return
    (row,) = results["rows"]
    assert not row["ranked"]
    assert row["worst_over_allowed"] is None or row["worst_over_allowed"] > 1.0
    assert "not ranked" in printed(results | {"rows": [row, *right_rows()]})


def right_rows():
    """A rival to be compared with."""
    row = dict.fromkeys(KEYS, 1.0) | {
        "workload": "many-10000x360",
        "engine": "c",
        "method": "dense Newton",
        "setting": "",
        "unit": "configuration",
    }
    return [
        row
        | {
            "computes": ["position"],
            "ranked": True,
            "newton_by": "",
            "note": "",
            "timed": 1,
            "compared": 1,
            "uncompared": 0,
        }
    ]


def printed(results):
    out = io.StringIO()
    print_results(results, Console(width=200, file=out))
    return out.getvalue()


def without_compiler(monkeypatch):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(c_kernels.shutil, "which", lambda name: None)


def test_without_a_compiler_its_methods_are_reported_as_absent(monkeypatch):
    without_compiler(monkeypatch)
    listed = [method("c", "dense Newton"), method("c", "closed form"), method("numpy", "closed form")]

    results = measure.measured(tiny(), rounds=1, listed=listed)

    assert [row["engine"] for row in results["rows"]] == ["numpy"]
    assert [(a["method"], a["reason"]) for a in results["absent"]] == [
        (name, "no C compiler: looked for cc, gcc, clang") for name in ("dense Newton", "closed form")
    ]
    assert results["versions"]["compiler"] == "absent"
    assert "absent: c, dense Newton (sweep-1000): no C compiler" in printed(results)


def test_a_compiler_that_is_asked_for_and_is_not_there_is_named(monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")

    with pytest.raises(EngineError, match="no-such-compiler"):
        method("c", "dense Newton").batched(tiny(), 2)


def test_what_the_compiler_refuses_is_absent_with_its_reason(monkeypatch):
    monkeypatch.setattr(c_kernels, "text_of", lambda name: "this is no C\n")

    reason = r"the C compiler refused dense\.c: .*error" if COMPILER else "no C compiler"
    with pytest.raises(EngineError, match=reason):
        method("c", "dense Newton").batched(tiny(), 2)


def test_without_the_fast_paths_their_methods_are_absent(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("crosscheck.engines.ours.batch")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "refkin.fast", None)
    monkeypatch.setitem(sys.modules, "refkin.fast.prepare", None)

    results = measure.measured(tiny(), ["refkin-batch", "c", "numpy"], rounds=1)

    assert {a["engine"] for a in results["absent"]} >= {"refkin-batch"}
    assert "same program" in [a["method"] for a in results["absent"]]
    assert "numpy" in [row["engine"] for row in results["rows"]]


@pytest.mark.parametrize("engine", ["exudyn", "pinocchio", "mujoco"])
def test_an_engine_that_is_not_installed_is_absent(monkeypatch, engine):
    for name in [name for name in sys.modules if name.startswith(f"crosscheck.engines.{engine}")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, engine, None)

    results = measure.measured(tiny(), [engine], rounds=1)

    assert results["rows"] == []
    assert f"{engine} is not installed" in results["absent"][0]["reason"]


def test_claims_name_the_same_algorithm_in_c_first_then_dense_c():
    """By the price of all that a method computes, not of positions alone."""
    row = right_rows()[0] | {"computes": ["position", "velocity"]}
    times = {
        ("refkin-batch", "all times at once", "no evidence"): 200.0,
        ("c", "dense Newton", ""): 800.0,
        ("c", "same program", ""): 100.0,
        ("mujoco", "batch", ""): 6000.0,
    }
    names = ("engine", "method", "setting")
    rows = [row | dict(zip(names, key, strict=True)) | {"nanoseconds_per_configuration": t} for key, t in times.items()]
    rows.append(rows[0] | {"computes": ["position"], "nanoseconds_per_configuration": 150.0})

    text = printed({"rows": rows, "absent": [], "versions": {}, "machine": {**timing.machine(), "threads": 1}})

    claim = (
        "refkin-batch, all times at once takes 2 times the same operations compiled as C, 0.25 times dense Newton in "
        "C, 0.0333 times mujoco, batch, the fastest engine."
    )
    assert claim in text


def test_the_command_prints_one_json_object_measured_on_one_thread(command):
    told = command("bench", "--only", "chain-10", "--json")
    out = json.loads(told.stdout)

    assert told.returncode == 0
    assert set(out) == {"schema", "rows", "absent", "versions", "machine"}
    assert {entry["workload"] for entry in (*out["rows"], *out["absent"])} == {"chain-10"}
    assert out["machine"]["threads"] == "1"


def out_of_order(asked: object) -> None:
    """End the process that measures, which says that it takes long: what it is started for in the next test."""
    os._exit(3)


def test_a_process_that_fails_ends_with_one_error_and_the_exit_code_of_infrastructure(command, monkeypatch, caplog):
    monkeypatch.syspath_prepend(str(ROOT))
    monkeypatch.setattr(measure, "measured_by_name", out_of_order)
    monkeypatch.setattr(limits, "LOOK", 0.005)
    monkeypatch.setattr(limits, "LONG", 0.01)
    monkeypatch.setattr(limits, "_WATCH", limits._Watch())  # that of another test sleeps as long as it was told
    told = command("bench", "--only", "chain-10", "--json")

    assert told.returncode == 4
    assert "chain-10: its process ended: exit code 3" in told.stderr
    assert caplog.messages[0].startswith("measuring chain-10: ")


def test_an_engine_that_raises_hangs_or_ends_its_process_is_absent_and_the_others_have_their_rows():
    """One that hangs is not asked again."""
    hung, engines = {}, Path(__file__).with_name("hard_engines.py")
    specs = [f"{engines}:{name}" for name in ("Raises", "Crashes", "Complex", "Hangs")]
    part = measure.measured_apart("sweep-1000", ["numpy", *specs], hung, patience=3.0)
    told = {row["engine"]: row["reason"] for row in part["absent"]}
    (again,) = measure.measured_apart("sweep-1000", specs[-1:], hung)["absent"]

    assert [row["engine"] for row in part["rows"]] == ["numpy"]
    assert told.keys() == {"raises", "crashes", "complex", "hangs"}
    assert told["complex"] == "expected an array of floats, got complex128"
    assert told["raises"].startswith("ZeroDivisionError: planted (change, hard_engines.py:")
    assert (told["hangs"], told["crashes"]) == ("no answer within 3 s", "its process ended: SIGSEGV")
    assert again["reason"] == "not asked again: no answer within 3 s, at sweep-1000"


def test_an_engine_whose_file_ends_the_process_is_absent_by_its_file(tmp_path):
    (tmp_path / "ends.py").write_text("import os\nos._exit(7)\n", encoding="utf-8")
    spec = f"{tmp_path / 'ends.py'}:Ends"
    part = measure.measured_apart("chain-10", [spec], {})

    assert [(key_of(row), row["reason"]) for row in part["absent"]] == [
        ((spec, "any", ""), "its process ended: exit code 7")
    ]


@pytest.mark.parametrize("fails", ["own engines", "all"])
def test_what_fails_only_beside_others_costs_no_row_of_theirs(fails, monkeypatch):
    ended, asked = Failure(FailureKind.CRASH, "its process ended: SIGSEGV"), []

    def each(function, arguments, seconds=None):
        if function is measure.keys_of:
            return [[("mine", "solve", "")]]
        asked.append(arguments[0][2])
        return [ended if fails == "all" or not asked[-1] else {"rows": ["others"], "absent": []}]

    monkeypatch.setattr(measure, "call_each", each)
    monkeypatch.setattr(measure, "call_in_turn", lambda *_: iter([None]))
    part = measure.measured_apart("sweep-1000", ["numpy", "mine.py:Mine"], {})

    assert asked == [set(), {("mine", "solve", "")}]
    assert part == ended if fails == "all" else part["rows"] == ["others"]
    assert fails == "all" or part["absent"][0]["reason"] == "beside others: its process ended: SIGSEGV"


def test_a_workload_that_is_named_twice_is_measured_once(command, monkeypatch):
    asked = []
    part = {"rows": [], "absent": [], "versions": {}, "machine": {}}
    monkeypatch.setattr("crosscheck.commands.bench.measured_apart", lambda name, *_: asked.append(name) or part)

    assert command("bench", "--only", "chain-10", "--only", "chain-10", "--json").returncode == 0
    assert asked == ["chain-10"]


RESULTS = sorted((ROOT / "reports").glob("bench-*.json"))


def test_committed_results_cover_all_workloads():
    covered = {row["workload"] for path in RESULTS for row in json.loads(path.read_text(encoding="utf-8"))["rows"]}

    assert covered == set(works.WORKLOADS)


@pytest.mark.parametrize("path", RESULTS, ids=lambda p: p.stem)
def test_committed_results_say_what_they_were_measured_on(path):
    data = json.loads(path.read_text(encoding="utf-8"))

    assert all({key: type(row[key]) for key in KEYS} == KEYS for row in data["rows"])
    assert all(row["ranked"] for row in data["rows"])
    assert data["machine"]["threads"] == "1"
    assert data["machine"]["processor"]
    assert set(data["versions"]) == {"python", *timing.PACKAGES, "compiler"}


@pytest.mark.parametrize(("highest", "at_once", "orders"), [(2, False, [2, 0]), (2, True, [2]), (0, False, [0])])
def test_a_method_is_timed_for_positions_alone_too_where_that_makes_a_difference(highest, at_once, orders):
    method = SimpleNamespace(highest=highest, at_once=at_once, batched=lambda work, order: (work, order))

    assert [batch for _, batch in _entries("work", [method], [])] == [("work", order) for order in orders]
