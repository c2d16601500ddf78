"""`crosscheck bench` on tiny works: the JSON's shape, errors that are noticed, and routes that are absent by name."""

from __future__ import annotations

import importlib.util
import io
import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import refkin
from crosscheck.cli import main
from crosscheck.commands.bench_shown import print_results
from crosscheck.engines.batch_route import Absent
from crosscheck.engines.ours import c_batch as c_routes
from crosscheck.engines.ours import c_kernels
from crosscheck.engines.ours import numpy_batch as numpy_routes
from crosscheck.engines.ours.c_kernels import Kernels, text_of
from crosscheck.judge.of_batches import Piece, judged, system_of
from crosscheck.measure import bench as measure
from crosscheck.measure import bench_run as run
from crosscheck.scenes import works
from crosscheck.scenes.four_bar_answers import four_bar
from crosscheck.workers.timing import Timing
from refkin.system import compile_system

COMPILER = any(map(shutil.which, c_kernels.COMPILERS))
FAST = importlib.util.find_spec("refkin.fast") is not None
ENGINES = {name: importlib.util.find_spec(name) is not None for name in ("exudyn", "pinocchio", "mujoco")}
KEYS = {
    "work": str,
    "route": str,
    "nanoseconds_per_configuration": float,
    "unit": str,
    "spread": float,
    "max_error": float,
    "worst_over_allowed": float,
    "computes": list,
}
"""The public interface: every row has these keys."""


def tiny():
    return works.sweep(24)


def few():
    return works.many("many-10000x360", 5, 24, works.MARGIN)


def short():
    return works.Chain("chain-10", 3)


def expected(work):
    """Names of the routes that must be there on this machine; all others must be absent by name."""
    names = set(measure.builders(work))
    if not COMPILER:
        names -= {name for name in names if name.startswith("c-")}
    if not FAST:
        names -= {name for name in names if name.startswith("refkin-lanes")} | {"c-same-tape"}
    names -= {name for name in names for engine, there in ENGINES.items() if not there and name.startswith(engine)}
    if isinstance(work, works.Chain):
        return set() if not FAST else names - {"c-closed-form", "pinocchio", "mujoco", "scipy-root"}
    return names if work.mechanisms == 1 else names - {"refkin-lanes-certificate"}


@pytest.fixture(scope="module")
def results():
    return {work.name: measure.measured(work, rounds=1) for work in (tiny(), few(), short())}


@pytest.mark.parametrize("work", [tiny(), few(), short()], ids=lambda w: w.name)
def test_every_route_is_a_row_or_absent_by_name(results, work):
    found = results[work.name]
    rows, absent = ({entry["route"] for entry in found[kind]} for kind in ("rows", "absent"))

    assert rows == expected(work)
    assert absent == set(measure.builders(work)) - rows
    assert all(entry["reason"] for entry in found["absent"])


@pytest.mark.parametrize("name", ["sweep-1000", "many-10000x360", "chain-10"])
def test_rows_have_the_keys_and_types_of_the_interface(results, name):
    rows = json.loads(json.dumps(results[name], allow_nan=False))["rows"]

    for row in rows:
        assert {key: type(row[key]) for key in KEYS} == KEYS
        assert row["work"] == name
        assert row["unit"] == ("newton-iteration" if name.startswith("chain") else "configuration")
        assert set(row["computes"]) <= {"position", "velocity", "acceleration", "certificate"}
        assert row["nanoseconds_per_configuration"] > 0.0
        assert row["spread"] >= 0.0


@pytest.mark.parametrize("name", ["sweep-1000", "many-10000x360", "chain-10"])
def test_every_route_is_as_right_as_it_can_be(results, name):
    """Measured, not assumed: each row's own answers, against the closed form in long double."""
    wrong = [row["route"] for row in results[name]["rows"] if not (row["ranked"] and row["worst_over_allowed"] <= 1.0)]

    assert not wrong


def test_the_names_of_the_works_are_the_interface():
    assert works.names() == (
        "sweep-1000",
        "many-10000x360",
        "many-10000x360-any",
        "chain-10",
        "chain-100",
        "chain-1000",
        "chain-10000",
    )


def test_works_are_as_large_as_their_names_say():
    sizes = [w.configurations for w in map(works.work, works.names()[:3])]

    assert sizes == [1000, 3_600_000, 3_600_000]
    assert [works.work(f"chain-{n}").windows for n in works.WINDOWS] == [10, 100, 1000, 10_000]


def test_the_margin_is_a_part_of_the_longest_length_and_the_other_work_has_none():
    for margin, low in ((works.MARGIN, works.MARGIN), (0.0, 0.0)):
        lengths = np.sort(works.grashof(2000, margin), axis=0)
        part = (lengths[1] + lengths[2] - lengths[0] - lengths[3]) / lengths[3]

        assert low < part.min() < low + 0.01


@pytest.mark.parametrize("lane", range(3))
def test_the_truth_is_what_the_reference_finds(lane):
    work = few()
    motion = refkin.solve(work.scene(lane))
    truth = four_bar(work.lengths[:, lane, None].astype(np.longdouble), work.t.astype(np.longdouble))

    for order, (exact, found) in enumerate(zip(truth, motion.levels, strict=True)):
        error = exact - found
        if order == 0:
            error[2::3] -= np.round(error[2::3] / (2 * np.pi)) * 2 * np.pi
        assert np.max(np.abs(error)) < 1e-13 * max(1.0, float(np.max(np.abs(exact))))


def test_the_truth_of_a_chain_is_what_the_reference_finds():
    """Its second loop is driven with an acceleration of its own."""
    work = short()
    motion = refkin.solve(work.scene)

    for exact, found in zip(work.truth(), motion.levels, strict=True):
        assert np.max(np.abs(exact - found[:, 0])) < 1e-14


def test_equations_of_many_mechanisms_are_those_of_each():
    work = few()
    lanes = np.arange(work.mechanisms)
    q = np.random.default_rng(0).normal(size=(9, work.mechanisms))
    together = system_of(work, lanes).phi(q, np.full(work.mechanisms, 0.3))

    for lane in lanes:
        mechanism = work.scene(lane).mechanism
        alone = compile_system(mechanism, unit=mechanism.unit()).phi(q[:, lane], 0.3)
        assert np.allclose(together[:, lane], alone, rtol=0.0, atol=1e-15)


def answers(work, levels):
    lanes = np.arange(work.mechanisms)
    times = np.arange(len(work.t))
    return Piece(np.repeat(lanes, len(times)), np.tile(times, len(lanes)), range(9), levels)


def right(work):
    return [x.reshape(9, -1) for x in four_bar(work.lengths[:, :, None], work.t[None, :])]


def test_right_answers_are_ranked():
    work = few()

    found = judged(work, [answers(work, tuple(right(work)))])

    assert found.ranked
    assert found.configurations == work.configurations


@pytest.mark.parametrize("level", range(3))
def test_one_wrong_number_among_all_is_noticed(level):
    """Also where it is not in the sample: the configurations with the largest errors are always judged."""
    work = few()
    levels = right(work)
    levels[level][5, 77] *= 1.0 + 1e-11

    found = judged(work, [answers(work, tuple(levels))])

    assert found.worst_over_allowed > 1.0
    assert found.max_error > 1e-12
    assert not found.ranked


def test_the_other_branch_is_noticed():
    work = tiny()
    mirrored = four_bar(work.lengths[:, :, None], -work.t[None, :])  # reflected in the ground link: the other branch
    q = mirrored[0].reshape(9, -1)
    q[1::3] *= -1.0
    q[2::3] *= -1.0

    assert not judged(work, [answers(work, (q,))]).ranked


def test_no_answer_is_no_rank_and_null_in_the_json():
    work = few()
    levels = right(work)
    levels[0][:, 3] = np.nan
    route = numpy_routes.closed_form(work)
    broken = replace(route, accuracy=lambda: judged(work, [answers(work, tuple(levels))]))

    found = measure.row(work, broken, Timing(1.0, 0.0))

    assert not found["ranked"]
    assert found["max_error"] is None
    assert json.dumps(found, allow_nan=False)


PLANTED = {
    "dense.c": ("gamma[6 + c] = -w[2]", "gamma[6 + c] = w[2]", "c-dense", c_routes.dense),
    "closed.c": ("rest > 0.0 ? sqrt(rest)", "rest > 0.0 ? -sqrt(rest)", "c-closed-form", c_routes.closed_form),
    "march.h": ("MOST_NEWTON 8", "MOST_NEWTON 1", "c-same-tape", c_routes.same_tape),
}


@pytest.mark.parametrize("source", PLANTED)
def test_a_wrong_kernel_is_marked_and_not_ranked(monkeypatch, source):
    before, after, name, builder = PLANTED[source]
    text = text_of(source)
    assert text.count(before) == 1
    monkeypatch.setattr(c_kernels, "text_of", lambda s: text.replace(before, after) if s == source else text_of(s))

    results = measure.measured(few(), {name: builder}, rounds=1)

    if not COMPILER or (name == "c-same-tape" and not FAST):
        assert [entry["route"] for entry in results["absent"]] == [name]
        return
    (row,) = results["rows"]
    assert not row["ranked"]
    assert row["worst_over_allowed"] is None or row["worst_over_allowed"] > 1.0
    assert "not ranked" in printed(results | {"rows": [row, *right_rows()]})


def right_rows():
    """A rival to be compared with."""
    row = dict.fromkeys(KEYS, 1.0) | {"work": "many-10000x360", "route": "c-dense", "unit": "configuration"}
    return [
        row
        | {
            "computes": ["position"],
            "ranked": True,
            "driven_by": "",
            "what": "",
            "timed": 1,
            "judged": 1,
            "unjudged": 0,
        }
    ]


def printed(results):
    out = io.StringIO()
    print_results(results, Console(width=200, file=out))
    return out.getvalue()


def without_compiler(monkeypatch):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(c_kernels.shutil, "which", lambda name: None)


def test_without_a_compiler_its_routes_are_reported_as_absent(monkeypatch):
    without_compiler(monkeypatch)
    routes = {
        "c-dense": c_routes.dense,
        "c-closed-form": c_routes.closed_form,
        "numpy": measure.builders(tiny())["numpy-closed-form"],
    }

    results = measure.measured(tiny(), routes, rounds=1)

    assert [row["route"] for row in results["rows"]] == ["numpy-closed-form"]
    assert [(a["route"], a["reason"]) for a in results["absent"]] == [
        (name, "no C compiler: looked for cc, gcc, clang") for name in ("c-dense", "c-closed-form")
    ]
    assert results["versions"]["compiler"] == "absent"
    assert "absent: c-dense (sweep-1000): no C compiler" in printed(results)


def test_a_compiler_that_is_asked_for_and_is_not_there_is_named(monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")

    with Kernels() as kernels, pytest.raises(Absent, match="no-such-compiler"):
        c_routes.dense(tiny(), kernels)


def test_what_the_compiler_refuses_is_absent_with_its_reason(monkeypatch):
    monkeypatch.setattr(c_kernels, "text_of", lambda name: "this is no C\n")

    reason = r"the C compiler refused dense\.c: .*error" if COMPILER else "no C compiler"
    with Kernels() as kernels, pytest.raises(Absent, match=reason):
        c_routes.dense(tiny(), kernels)


def test_without_the_fast_paths_their_routes_are_absent(monkeypatch):
    monkeypatch.setitem(sys.modules, "refkin.fast", None)

    for work in (tiny(), short()):
        for name, builder in measure.builders(work).items():
            if name.startswith("refkin-lanes") or isinstance(work, works.Chain):
                with Kernels() as kernels, pytest.raises(Absent):
                    builder(work, kernels)


@pytest.mark.parametrize("engine", ENGINES)
def test_an_engine_that_is_not_installed_is_absent(monkeypatch, engine):
    monkeypatch.setitem(sys.modules, engine, None)
    monkeypatch.delitem(sys.modules, f"crosscheck.engines.{engine}.batch", raising=False)

    with Kernels() as kernels, pytest.raises(Absent, match=f"{engine} is not installed"):
        measure.builders(tiny())[engine](tiny(), kernels)


def test_claims_name_the_same_algorithm_in_c_first_then_dense_c():
    row = right_rows()[0]
    rows = [
        row | {"route": route, "nanoseconds_per_configuration": time}
        for route, time in (("refkin-lanes", 200.0), ("c-dense", 800.0), ("c-same-tape", 100.0), ("mujoco", 6000.0))
    ]

    told = printed({"rows": rows, "absent": [], "versions": {}, "machine": measure.machine()})

    claim = (
        "refkin-lanes takes 2 times the same operations compiled as C, 0.25 times dense Newton in C, "
        "0.0333 times mujoco, the fastest engine route."
    )
    assert claim in told


def test_the_command_prints_one_json_object_measured_on_one_thread(capsys):
    with pytest.raises(SystemExit) as end:
        main(["bench", "--only", "chain-10", "--json"])
    out = json.loads(capsys.readouterr().out)

    assert end.value.code == 0
    assert set(out) == {"rows", "absent", "versions", "machine", "aims"}
    assert {entry["work"] for entry in (*out["rows"], *out["absent"])} == {"chain-10"}
    assert out["machine"]["threads"] == "1"


def test_a_process_that_fails_ends_with_one_error_and_the_exit_code_of_infrastructure(capsys, monkeypatch, tmp_path):
    program = tmp_path / "fails"
    program.write_text("#!/bin/sh\necho out of order >&2\nexit 3\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setattr(run.sys, "executable", str(program))
    with pytest.raises(SystemExit) as end:
        main(["bench", "--only", "chain-10", "--json"])

    assert end.value.code == 4
    assert "chain-10: its process ended with code 3\nout of order" in capsys.readouterr().err


def test_a_work_nobody_has_heard_of_is_a_usage_error(capsys):
    with pytest.raises(SystemExit) as end:
        main(["bench", "--only", "sweep-12"])

    assert end.value.code == 2
    assert "no work is called 'sweep-12'; there are: sweep-1000, many-10000x360" in capsys.readouterr().err


RESULTS = sorted((Path(__file__).parents[2] / "reports").glob("bench-*.json"))


def test_there_are_committed_results():
    assert RESULTS


@pytest.mark.parametrize("path", RESULTS, ids=lambda p: p.stem)
def test_committed_results_say_what_they_were_measured_on_and_cover_all_works(path):
    found = json.loads(path.read_text(encoding="utf-8"))

    assert {row["work"] for row in found["rows"]} == set(works.names())
    assert all({key: type(row[key]) for key in KEYS} == KEYS for row in found["rows"])
    assert all(row["ranked"] for row in found["rows"])
    assert found["machine"]["threads"] == "1"
    assert found["machine"]["processor"]
    assert set(found["versions"]) == {"python", *measure.PACKAGES, "compiler"}
