"""The program: only what a scene calls for is in it, one topology is compiled once, and a person can read it."""

from __future__ import annotations

import importlib
import re
import threading
from dataclasses import replace

import numpy as np
import pytest

import refkin
from refkin import Effect, FourBar, Point, SliderCrank
from refkin.errors import RefkinError
from refkin.fast import legend, program_of, solve_many, sweep
from refkin.fast.elimination.program import SEGMENTS
from tests.linkages import system_of

from .linkworks import chain
from .scenes import ROCKER, SCENES, bare

compiled_module = importlib.import_module("refkin.fast.compiled")


def called_for(*effects, scene=None, **changes):
    scene = ROCKER.scene(samples=5) if scene is None else scene
    return bare(scene, effects=frozenset(effects), **changes)


def total(scene):
    return sum(program_of(scene).counts().values())


POSITION, VELOCITY, BOTH = (), (Effect.VELOCITY,), (Effect.VELOCITY, Effect.ACCELERATION)


@pytest.mark.parametrize("name", SCENES)
def test_each_level_costs_operations_of_its_own(name):
    counts = [total(called_for(*effects, scene=SCENES[name])) for effects in (POSITION, VELOCITY, BOTH)]

    assert counts[0] < counts[1] <= counts[2]


def test_the_counts_of_a_four_bar_are_what_they_were():
    """A change of the formulas or of the elimination shows here; fewer is better."""
    assert program_of(called_for(*BOTH)).counts() == {"mechanism": 0, "time": 34, "newton": 53, "answer": 115}
    assert program_of(called_for()).counts() == {"mechanism": 0, "time": 13, "newton": 53, "answer": 47}


def test_a_newton_step_does_not_depend_on_what_is_called_for():
    newton = [program_of(called_for(*effects)).segments["newton"] for effects in (POSITION, BOTH)]

    assert len(newton[0]) == len(newton[1])


@pytest.mark.parametrize("wanted", range(4))
def test_wanting_some_bodies_drops_every_group_downstream(wanted):
    """The rockers of a chain: the k-th needs k loops, whatever hangs on it."""
    scene = called_for(*BOTH, scene=chain(3), bodies_wanted=(f"rocker{wanted}",))

    assert len(program_of(scene).blocks) == wanted
    assert total(scene) < total(called_for(*BOTH, scene=chain(3))) or wanted == 3


def test_wanting_less_takes_fewer_operations_than_a_shorter_chain_would():
    assert total(called_for(*BOTH, scene=chain(6), bodies_wanted=("rocker2",))) == total(
        called_for(*BOTH, scene=chain(2), bodies_wanted=("rocker2",))
    )


def test_a_point_is_wanted_with_its_body():
    scene = called_for(*BOTH, scene=chain(3), bodies_wanted=("rocker0",))
    point = Point(name="P", body="coupler1", position=(0.1, 0.2))

    assert len(program_of(replace(scene, points=(point,))).blocks) == 2


@pytest.mark.parametrize("far", [0.0, 50.0])
def test_a_status_says_nothing_of_bodies_that_are_left_out_and_the_message_says_so(far):
    """A coupler that is 46.5 m too short; or one that is not."""
    whole = ROCKER.scene(samples=5)
    moved = [replace(j, point_i=(j.point_i[0] + far, 0.0)) if j.name == "B0" else j for j in whole.mechanism.joints]
    asked = replace(whole, mechanism=replace(whole.mechanism, joints=tuple(moved)), bodies_wanted=("crank",))
    less = replace(asked, evidence=frozenset({refkin.Evidence.CERTIFICATE}))
    said = "whether coupler, rocker can be assembled, as nothing wanted depends on it"

    assert sweep(less).verdict == refkin.Status.OK
    assert sweep(less).message == f"not asked {said}"
    assert sweep(asked).verdict == refkin.solve(less).verdict == ("unassemblable" if far else "ok")
    assert "not asked" not in sweep(asked).message
    rows = {"A0": {"point_j": (np.full(2, -0.5), 0.0)}}
    assert solve_many(less, rows).unseen == said
    assert solve_many(replace(less, bodies_wanted=None), rows).unseen == ""


def test_a_scene_that_asks_for_the_condition_number_keeps_all_bodies():
    scene = replace(chain(3), bodies_wanted=("rocker0",), evidence=frozenset({refkin.Evidence.CONDITION}))

    assert len(program_of(scene).blocks) == 3


def test_lengths_and_laws_are_inputs():
    compiled_module.forget()
    for crank in (0.5, 0.7, 1.1):
        linkage = FourBar(ground=4.0, crank=crank, coupler=3.5, rocker=3.0 + crank / 3)
        sweep(bare(linkage.scene(speed=1.0 + crank, samples=9)))

    assert len(compiled_module._kept) == 1


def test_another_joint_is_another_topology():
    compiled_module.forget()
    sweep(bare(ROCKER.scene(samples=9)))
    sweep(bare(SliderCrank(crank=1.0, rod=3.0).scene(samples=9)))

    assert len(compiled_module._kept) == 2


def test_a_program_that_was_compiled_for_other_lengths_answers_as_well():
    compiled_module.forget()
    sweep(bare(ROCKER.scene(samples=9)))
    linkage = FourBar(ground=3.0, crank=0.8, coupler=2.75, rocker=2.9)
    scene = bare(linkage.scene(samples=50))
    motion = sweep(scene)

    assert motion.producer.name == "refkin.fast"
    assert np.max(np.abs(motion.q - refkin.solve(scene).q)) < 1e-14


def test_old_topologies_are_dropped(monkeypatch):
    monkeypatch.setattr(compiled_module, "MOST_KEPT", 3)
    compiled_module.forget()
    for windows in range(1, 6):
        program_of(called_for(scene=chain(windows)))

    assert len(compiled_module._kept) == 3


@pytest.mark.parametrize("name", SCENES)
def test_the_text_of_a_program_states_every_instruction_and_their_number(name):
    program = program_of(SCENES[name])
    text = str(program)

    for segment in SEGMENTS:
        assert f"# {segment}: {len(program.segments[segment])} instructions" in text
    statements = [line for line in text.splitlines() if " = " in line and not line.startswith("#")]
    named = len(program.constants) + len(program.inputs)
    assert len(statements) == named + sum(program.counts().values())


def test_no_register_is_read_before_it_is_written():
    for scene in SCENES.values():
        program = program_of(scene)
        written = {*program.constants, *program.inputs.values()}
        for name in SEGMENTS:
            for instruction in program.segments[name]:
                assert set(instruction.args) <= written
                written.add(instruction.out)


def read_first(instructions):
    """The registers that a segment reads before it writes them: what it is given."""
    given, written = set(), set()
    for instruction in instructions:
        given |= set(instruction.args) - written
        written.add(instruction.out)
    return given


def test_what_is_given_to_newton_and_answer_survives_them():
    """Both may run again and again: they overwrite nothing that they are given, but for the core coordinates."""
    for scene in SCENES.values():
        program = program_of(scene)
        core = {f"w{k}" for k in program.outputs.core}
        given = read_first(program.segments["newton"]) | read_first(program.segments["answer"])
        overwritten = {i.out for name in ("newton", "answer") for i in program.segments[name]} & given

        assert {str(register) for register in overwritten} <= core


def test_registers_are_used_again():
    program = program_of(called_for(*BOTH))

    assert program.sizes["w"] < 0.4 * sum(program.counts().values())


def test_the_legend_names_bodies_joints_and_contacts():
    text = legend(SCENES["tip on lobes"])

    assert "# q[0], q[1], q[2] = x, y, phi of cam" in text
    assert "geometry and laws of contact (cam)" in text
    assert "# q[6] = contact parameter of contact" in text


def test_what_has_no_program_says_so():
    body = refkin.Body(name="a", estimate=(0.0, 0.0, 0.0))
    law = refkin.Polynomial(coefficients=(0.0, 1.0))
    drivers = tuple(refkin.XDriver(name=n, body="a", law=law) for n in "mnk")
    scene = refkin.Scene(mechanism=refkin.Mechanism((body,), (), drivers), times=(0.0,))

    with pytest.raises(RefkinError, match="no program"):
        program_of(scene)


def test_threads_do_not_share_registers():
    scenes = [bare(FourBar(4.0, 1.0, 3.5, 2.5 + 0.1 * k).scene(samples=200)) for k in range(4)]
    alone = [sweep(scene).q for scene in scenes]
    by_name: dict[int, list] = {k: [] for k in range(4)}

    def work(k):
        for _ in range(20):
            by_name[k].append(sweep(scenes[k]).q)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert all(np.array_equal(q, alone[k]) for k in range(4) for q in by_name[k])


def test_the_source_of_a_program_holds_nothing_of_the_scene():
    """Names come from scene files of anybody; what is compiled to Python holds registers and numbers alone."""
    from refkin.fast.compiled import compiled
    from refkin.fast.elimination.program import source
    from refkin.fast.elimination.schedule import schedule

    system = system_of(SCENES["roller over lobes"])
    made = compiled(system, range(system.n), [p.g for p in system.placed])
    text = source(schedule(made.solved, made.graph, [made.core] * 3, half_angles=False), made.core)
    words = set(re.findall(r"[A-Za-z_]\w*", text))

    python = "def for in range if else break return prepare advance append StepAnswer"
    names = "g u f q _ steps profile most enough cos sin abs inverse apply"
    assert {w for w in words if not re.fullmatch(r"[uwmx]\d+|e", w)} <= {*python.split(), *names.split()}


def test_a_block_inverted_for_one_mechanism_says_its_sign_its_size_and_its_inverse():
    from refkin.fast.elimination import program

    for seed in range(4):
        matrix = np.random.default_rng(seed).uniform(-1.0, 1.0, (4, 4))
        sign, size, inverse = program._inverse(4, *matrix.ravel().tolist())

        assert sign == np.sign(np.linalg.det(matrix))
        assert size == pytest.approx(1 / np.linalg.norm(np.linalg.inv(matrix), np.inf))
        assert np.max(np.abs(inverse @ matrix - np.eye(4))) < 1e-13
    with pytest.raises(ZeroDivisionError):
        program._inverse(2, 1.0, 2.0, 2.0, 4.0)


def test_a_block_whose_entries_left_all_numbers_has_no_inverse_and_warns_nobody():
    """A step that diverges does it: NumPy warned in a user's program."""
    from refkin.fast.elimination import program

    with pytest.raises(OverflowError, match="without a finite inverse"):
        program._inverse(2, np.nan, 1.0, 0.0, np.nan)
