"""What the program of a certificate proves is true: held against 113-bit enclosures, on every joint it takes."""

from __future__ import annotations

import importlib
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given, settings

import refkin
from crosscheck.strategies import Hardness, drawn_scenes
from refkin import Evidence, Integral, Polynomial, Sinusoid, SliderCrank, Status, Table
from refkin.fast import attempt
from refkin.fast.certify import _law, _Number, exact_geometry, proved, radii, zeros_of
from refkin.fast.elimination import prove
from refkin.fast.elimination.program import SEGMENTS
from refkin.fast.prepare import prepared
from refkin.proof.numbers.exact import exact_system
from refkin.proof.numbers.symbols import Graph
from refkin.proof.pose.krawczyk import krawczyk
from refkin.system import compile_system
from tests.mutation.change import mutated

from .linkworks import chain
from .scenes import ROCKER, SCENES, bare

answer = importlib.import_module("refkin.fast.answer")
CERTIFIED = [name for name, scene in SCENES.items() if not any(j.parameters for j in scene.mechanism.joints)]
LEVELS = ("position", "velocity", "acceleration")
U = 2.0**-53


def answered(scene):
    """(system, what is compiled, scaled levels, times) of the scene's answer."""
    motion, result = attempt(scene), prepared(scene)
    return result.system, result.made, [result.system.to_unit(x, k) for k, x in enumerate(motion.levels)], motion.t


def distances(system, levels, t):
    """How far a pose and its rates are from the root, by balls that are far narrower."""
    root = krawczyk(system, levels[0], t, 113)
    rate = root.velocity()
    exact = (None, rate, root.acceleration(rate))
    return [np.max(root.distance(x) if e is None else root.distance(x, e)) for x, e in zip(levels, exact, strict=True)]


@pytest.mark.parametrize("name", CERTIFIED)
def test_no_radius_is_less_than_the_error(name):
    system, made, levels, t = answered(SCENES[name])
    bounds = radii(system, made, levels, t)

    for sample in range(0, len(t), max(1, len(t) // 5)):
        off = distances(system, [x[:, sample] for x in levels], t[sample])
        for level, error in zip(LEVELS, off, strict=True):
            assert bounds[LEVELS.index(level)][sample] >= error


@pytest.mark.parametrize("name", CERTIFIED)
@pytest.mark.parametrize("level", range(3))
def test_numbers_that_are_off_have_a_radius_that_says_so(name, level):
    """Every coordinate of every level in its turn is moved by 1e-9."""
    system, made, levels, t = answered(SCENES[name])
    t, levels = t[:1], [x[:, :1] for x in levels]
    for c in range(system.n):
        moved = [x.copy() for x in levels]
        moved[level][c] += 1e-9
        bounds = radii(system, made, moved, t)

        assert bounds is None or bounds[level][0] >= 0.999e-9


def test_the_proof_takes_sine_and_cosine_as_they_are():
    """By the tangent of half the angle they are off by roundings of 1: more than the 2 ulp that are counted, near 0."""
    result = prepared(SCENES["four-bar"])
    geometry = exact_geometry(result.system)
    program = result.made.proof(zeros_of(geometry)).program
    operations = sum((program.operations(segment) for segment in SEGMENTS), Counter())

    assert operations.keys() & {"cos", "sin", "tan"} == {"cos", "sin"}


@pytest.mark.parametrize("name", CERTIFIED)
def test_radii_are_round_off_times_the_condition(name):
    """Errors of a few round-offs for each of the few operations on each of the bodies' arms, carried by the inverse."""
    system, made, levels, t = answered(SCENES[name])
    slope = np.moveaxis(system.phi_q(levels[0], t), -1, 0)
    carried = np.max(np.sum(np.abs(np.linalg.inv(slope)), axis=2), axis=1)
    size = np.max(np.abs(levels[0]), axis=0, initial=1.0)

    assert np.all(radii(system, made, levels, t)[0] <= 64 * system.n * U * carried * size)


@settings(max_examples=40)
@given(drawn_scenes(hardness=[Hardness.REGULAR]))
def test_drawn_mechanisms_are_certified_on_the_program_and_the_reference_is_within_both_radii(drawn):
    scene = replace(drawn.scene, evidence=frozenset({Evidence.CERTIFICATE}))
    system, made, levels, t = answered(scene)
    ref = refkin.solve(scene)
    bounds = radii(system, made, levels, t)

    assert bounds is not None
    for k, level in enumerate(LEVELS):
        off = np.max(np.abs(levels[k] - system.to_unit(ref.levels[k], k)), axis=0)
        handed = 4 * U * np.max(np.abs(ref.levels[k])) / system.unit.size * (k == 0) + 4 * U * np.max(np.abs(levels[k]))
        assert np.all(off <= bounds[LEVELS.index(level)] + getattr(ref.certified_radius, level) + handed)


LAWS = {
    "polynomial": Polynomial(coefficients=(0.3, 1.0, -0.2, 0.05)),
    "sinusoid": Sinusoid(amplitude=0.4, angular_frequency=3.0, offset=0.2, phase=0.1),
    "integral of a polynomial": Integral(rate=Polynomial(coefficients=(1.0, 0.3, 0.1)), initial=0.3),
    "integral of a sinusoid": Integral(rate=Sinusoid(amplitude=0.4, angular_frequency=3.0), initial=0.3),
    "table": Table(argument=(0.0, 0.5, 1.0, 2.0), value=(0.1, 0.5, 0.7, 1.9)),
    "constant": Polynomial(coefficients=(0.3,)),
}


@pytest.mark.parametrize("law", LAWS)
def test_every_law_is_enclosed(law):
    times = tuple(np.linspace(0.1, 1.9, 7).tolist())
    system, made, levels, t = answered(bare(ROCKER.scene(law=LAWS[law], times=times)))
    bounds = radii(system, made, levels, t)

    for sample in range(len(t)):
        off = distances(system, [x[:, sample] for x in levels], t[sample])
        assert all(bounds[LEVELS.index(level)][sample] >= error for level, error in zip(LEVELS, off, strict=True))


@pytest.mark.parametrize("law", LAWS)
def test_no_value_of_a_law_is_off_by_more_than_is_said_of_it(law):
    """Against 200 bits: value, rate and its rate, at the ends of a table's pieces and within them."""
    times = np.array([0.0, 0.3, 0.5, 1.0, 1.9])
    system = compile_system(bare(ROCKER.scene(law=LAWS[law], times=tuple(times.tolist()))).mechanism)
    k = next(k for k, p in enumerate(system.placed) if p.constraint.laws)
    values, said = np.split(np.array(_law(system, k, times)[0]), 2)
    with ctx.workprec(200):
        driver = exact_system(system, 200).placed[k].constraint
        exact = zip(*(driver.inputs(arb(t), system.unit, 2)[0] for t in times.tolist()), strict=True)
        off = [
            [float(abs(x - float(y)).abs_upper()) for x, y in zip(*each, strict=True)]
            for each in zip(exact, values, strict=True)
        ]

    assert (off <= said).all()


def test_what_rounding_takes_from_a_bound_is_given_back():
    values = SimpleNamespace(
        give_laws=lambda laws: None, run=lambda name: None, level=lambda order: np.array([[0.0], [1.0]])
    )

    assert proved(values, {}) > 1.0


@pytest.mark.parametrize("levels", [1, 2, 3])
def test_only_the_levels_that_are_called_for_are_proved(levels):
    effects = (refkin.Effect.VELOCITY, refkin.Effect.ACCELERATION)[: levels - 1]
    scene = ROCKER.scene(samples=9)
    motion = attempt(replace(scene, effects=frozenset(effects), evidence=frozenset({Evidence.CERTIFICATE})))
    given = [np.isfinite(getattr(motion.certified_radius, level)).all() for level in LEVELS]

    assert given == [k < levels for k in range(3)]


@pytest.mark.parametrize("levels", [1, 2, 3])
@pytest.mark.parametrize("crank", [0.0, 5e-8])
def test_a_near_singular_pose_has_no_certificate_here(levels, crank):
    """A slider driven to just before its stretched position: the inverse moves by more than itself, from there too."""
    linkage = SliderCrank(crank=1.0, rod=3.0)
    law = Polynomial(coefficients=(4.0 - 1e-15,))
    scene = linkage.scene(law=law, times=(0.0,), driven="slider")
    effects = frozenset((refkin.Effect.VELOCITY, refkin.Effect.ACCELERATION)[: levels - 1])
    ready = prepared(replace(scene, evidence=frozenset(), effects=effects))
    q = np.zeros((ready.system.n, 1))
    q[:, 0] = ready.system.to_unit(np.array([0.5, crank / 2, crank, 2.5, crank / 2, -crank / 3, 4.0, 0.0, 0.0]))

    assert radii(ready.system, ready.made, [q, 0 * q, 0 * q][:levels], np.array([0.0])) is None


def test_two_assemblies_are_two_roots():
    """The mirrored pose has a certificate of its own: which branch it is, other checks say."""
    system, made, levels, t = answered(bare(ROCKER.scene(samples=5, branch="crossed")))

    assert np.all(radii(system, made, levels, t)[0] < 1e-13)


def test_a_chain_is_proved_block_by_block():
    scene = replace(chain(4), evidence=frozenset({Evidence.CERTIFICATE}))
    motion = attempt(scene)

    assert motion.verdict is Status.OK
    assert np.all(motion.certified_radius.acceleration < 1e-10)


def test_what_has_no_proof_here_is_proved_densely(monkeypatch):
    calls = []
    isolate = answer.isolate_every_choice
    monkeypatch.setattr(answer, "isolate_every_choice", lambda *args: calls.append(1) or isolate(*args))
    attempt(replace(SCENES["roller over lobes"], evidence=frozenset({Evidence.CERTIFICATE})))
    dense = len(calls)
    attempt(replace(SCENES["four-bar"], evidence=frozenset({Evidence.CERTIFICATE})))

    assert (dense, len(calls)) == (1, 1)


def test_a_scene_far_from_its_origin_counts_the_way_back():
    there = replace(ROCKER, origin=(1e6, 0.0)).scene(samples=5)
    motion = attempt(replace(there, evidence=frozenset({Evidence.CERTIFICATE})))

    assert np.all(motion.certified_radius.position >= 0.25 * np.spacing(1e6) / there.mechanism.size())


# Planted faults.


@pytest.mark.parametrize("of", ["mul", "add", "sin"])
def test_operations_that_are_off_by_1e_9_show_in_the_radius(monkeypatch, of):
    run = importlib.import_module("refkin.fast.elimination.run")
    scene = bare(ROCKER.scene(samples=9))
    system, made, levels, t = answered(scene)
    function = run.FUNCTIONS[of]

    def wrong(*args):
        function(*args)
        args[-1][...] *= 1.0 + 1e-9

    monkeypatch.setitem(run.FUNCTIONS, of, wrong)
    made.__dict__.pop("proving", None)
    bounds = radii(system, made, levels, t)
    made.__dict__.pop("proving", None)

    assert bounds is None or np.max(bounds[0]) > 1e-10


def test_a_sum_and_a_product_of_exact_numbers_are_off_by_their_own_rounding():
    graph = Graph()
    a, b = (graph.input("g", 0, k) for k in (0, 1))
    known = dict.fromkeys((a, b), graph.constant(0.0))
    for x in (a + b, a - b, a * b):
        assert prove.Errors(graph, known).of(x) is graph.constant(U) * abs(x)


@pytest.mark.parametrize("name", CERTIFIED)
def test_no_number_of_a_mechanism_is_off_by_more_than_its_error(name):
    system = prepared(SCENES[name]).system
    for exact, both in zip(exact_system(system, 200).placed, exact_geometry(system), strict=True):
        numbers, off = both[: len(both) // 2], both[len(both) // 2 :]
        assert all(abs(x - float(g)) <= float(e) for x, g, e in zip(exact.g, numbers, off, strict=True))


def test_an_inverse_that_is_wrong_proves_nothing():
    """R mirrored: gamma is not small, and there is no certificate."""
    with mutated("refkin.fast.elimination.prove:_Prover._inverse", "return rows", "return rows[::-1]"):
        system, made, levels, t = answered(bare(ROCKER.scene(samples=9)))
        assert radii(system, made, levels, t) is None


@pytest.mark.parametrize("off", [0.0, 1e-18, 1e-3])
@pytest.mark.parametrize("square", [0.7, 2.0, 3.0, 1e6 + 0.1])
def test_the_root_of_a_number_is_as_near_as_its_bound_says(square, off):
    root = _Number(square, off * square).sqrt()
    with mpmath.workdps(40):
        ends = [mpmath.sqrt(mpmath.mpf(square) * (1 + sign * mpmath.mpf(off))) for sign in (-1, 1)]
        apart = max(float(abs(end - float(root.mid))) for end in ends)

    assert apart <= float(root.rounding) <= 2.1 * apart + 2 * U * float(root.mid)
