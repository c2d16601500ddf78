"""Elimination: what the program solves is what the formulas state, at poses of every kind, for every joint."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from refkin import Body, Mechanism, Polynomial
from refkin.fast import program_of
from refkin.fast.compiled import compiled
from refkin.fast.elimination import eliminate
from refkin.fast.elimination.blocks import LARGEST_SELECTED, factored
from refkin.fast.elimination.eliminate import Eliminated, NotReducible, blocks_of, spanning_tree
from refkin.fast.elimination.run import Workspace
from refkin.fast.elimination.schedule import schedule
from refkin.fast.elimination.trace import known_of, trace
from refkin.joints import AngleDriver
from refkin.proof.numbers.symbols import Graph
from refkin.system import compile_system
from tests.linkages import system_of

from .linkworks import chain, pin
from .scenes import SCENES

SAMPLES = 5


def run(scene, spread=0.05):
    """(system, program, q, workspace) with core coordinates off their estimates, so that loops are open."""
    system = system_of(scene)
    made = compiled(system, range(system.n), [p.g for p in system.placed])
    space = Workspace(schedule(made.solved, made.graph, [range(made.n)] * 3), SAMPLES)
    t = np.linspace(scene.times[0], scene.times[-1], SAMPLES)

    def profile(constraint, order, s):
        return system.placed[constraint].constraint.profile_values(s, system.unit, order)[order]

    space.give_geometry([p.g for p in system.placed], profile)
    placed = enumerate(system.placed)
    space.give_laws({k: p.constraint.inputs(t, system.unit, 2) for k, p in placed if p.constraint.laws})
    estimate = np.zeros(system.n)
    estimate[: system.of_bodies] = [x for b in scene.mechanism.bodies for x in b.estimate]
    estimate = system.to_unit(estimate)
    draw = np.random.default_rng(1)
    for c, row in zip(made.core, space.core(), strict=True):
        row[:] = estimate[c] + 0.3 * (c >= system.of_bodies) + draw.uniform(-spread, spread, SAMPLES)
    space.run("answer")
    return system, space, space.level(0).copy(), t


@pytest.mark.parametrize("name", SCENES)
def test_the_stated_coordinates_satisfy_their_rows(name):
    system, _, q, t = run(SCENES[name])
    traced = trace(system, known_of([p.g for p in system.placed]), range(system.n))
    rows = [pivot.row for pivot in eliminate.Elimination(traced).stated]

    assert np.max(np.abs(system.phi(q, t)[rows]), initial=0.0) < 2e-15 * np.max(np.abs(q))


@pytest.mark.parametrize("name", SCENES)
def test_rates_solve_the_equations_at_any_pose(name):
    """phi_q qd = nu and phi_q qdd = gamma, with the reference's phi_q, nu and gamma, loops open or closed."""
    system, space, q, t = run(SCENES[name])
    slope, qd, qdd = system.phi_q(q, t), space.level(1), space.level(2)
    size = np.max(np.abs(slope), axis=(0, 1)) * 1e-13

    for rates, right in ((qd, system.nu(q, t)), (qdd, system.gamma(q, qd, t))):
        off = np.einsum("ijb,jb->ib", slope, rates) - right
        assert np.all(np.abs(off) <= size * np.max(np.abs(rates), axis=0, initial=1.0))


@pytest.mark.parametrize("name", SCENES)
def test_a_newton_step_is_that_of_all_equations(name):
    system, space, q, t = run(SCENES[name])
    core = list(space.program.core)
    space.run("newton")
    slopes = np.moveaxis(system.phi_q(q, t), -1, 0)
    full = np.linalg.solve(slopes, system.phi(q, t).T[..., None])[..., 0]
    made = q[core] - np.array([row for row in space.core()]).reshape(len(core), SAMPLES)
    # Both are backward stable: each off by about n u cond, of which the residual's own size is part.
    allowed = system.n * 2.0**-52 * np.linalg.cond(slopes) * np.maximum(1.0, np.max(np.abs(full), axis=1))

    assert np.all(np.max(np.abs(made - full.T[core]), axis=0, initial=0.0) <= allowed)


def solved(numbers, right):
    """The solution, sample by sample, of matrices (size, size, B) by that size's block; its determinant and pivot."""
    size = len(right)
    graph = Graph()
    entries = [graph.input("f", 0, 0, k) for k in range(size * size + size)]
    block = factored([entries[size * i : size * i + size] for i in range(size)])
    solution = Eliminated(
        core=(0,),
        blocks=((0,),),
        corrections=[graph.input("q", 0)],
        levels=([*block.solve(entries[size * size :]), graph.input("q", 0)], [], []),
        determinants=[block.determinant],
        pivots=[block.pivot],
    )
    space = Workspace(schedule(solution, graph, [range(size + 1)], half_angles=False), numbers.shape[2])
    with np.errstate(all="ignore"):
        space.give_laws({0: [[*numbers.reshape(size * size, -1), *right]]})
        space.run("answer")
    out = space.program.outputs
    return space.level(0)[:size].copy(), space.row(out.determinants[0]).copy(), space.row(out.pivots[0]).copy()


SIZES = [1, 2, 3, 4, LARGEST_SELECTED, LARGEST_SELECTED + 1, 12]


@pytest.mark.parametrize("size", SIZES)
def test_a_block_is_solved_as_well_as_by_lapack(size):
    draw = np.random.default_rng(size)
    numbers, right = draw.normal(size=(size, size, 200)), draw.normal(size=(size, 200))
    x, determinant, _ = solved(numbers, right)
    matrices = np.moveaxis(numbers, -1, 0)
    expected = np.linalg.solve(matrices, right.T[..., None])[..., 0].T
    # Forward errors of both are at most about size^2 u cond, growth apart, which is small for random matrices.
    allowed = size**2 * 2.0**-50 * np.linalg.cond(matrices) * np.max(np.abs(expected), axis=0)

    assert np.all(np.max(np.abs(x - expected), axis=0) <= allowed)
    assert np.array_equal(np.sign(determinant), np.linalg.slogdet(matrices)[0])


@pytest.mark.parametrize("size", [3, 4, 5])
def test_every_sample_has_its_own_order_of_rows(size):
    """Permuted triangular matrices with zeros on the diagonal, a different permutation in each sample."""
    orders = list(permutations(range(size)))
    draw = np.random.default_rng(7)
    numbers = np.stack([(np.triu(draw.uniform(1.0, 2.0, (size, size))))[list(order)] for order in orders], axis=-1)
    x = draw.normal(size=(size, len(orders)))
    result, determinant, _ = solved(numbers, np.einsum("ijb,jb->ib", numbers, x))

    assert np.max(np.abs(result - x)) < 1e-13
    assert np.all(np.sign(determinant) == np.sign(np.linalg.det(np.moveaxis(numbers, -1, 0))))


@pytest.mark.parametrize("size", SIZES)
def test_a_singular_sample_spoils_no_other(size):
    draw = np.random.default_rng(3)
    numbers, right = draw.normal(size=(size, size, 9)), draw.normal(size=(size, 9))
    alone = solved(numbers, right)[0]
    numbers[:, :, 4] = 0.0
    numbers[:, :, 6] = np.nan
    with np.errstate(all="ignore"):
        x, _, pivot = solved(numbers, right)
    good = [k for k in range(9) if k not in (4, 6)]

    assert np.array_equal(x[:, good], alone[:, good])
    assert not np.isfinite(x[:, [4, 6]]).any()
    assert not (pivot[[4, 6]] > 0.0).any()


@pytest.mark.parametrize("size", SIZES)
def test_the_pivot_of_a_block_shows_how_near_to_singular_it_is(size):
    """Orthogonal but for one singular value: the pivot is that value up to a factor of the size."""
    draw = np.random.default_rng(5)
    small = 10.0 ** np.linspace(-9, 0, 30)
    matrices = []
    for sigma in small:
        u, v = (np.linalg.qr(draw.normal(size=(size, size)))[0] for _ in range(2))
        matrices.append(u @ np.diag([*[1.0] * (size - 1), sigma]) @ v)
    pivot = solved(np.stack(matrices, axis=-1), np.ones((size, 30)))[2]

    assert np.all(pivot >= small / (4 * size))
    assert np.all(pivot <= small * 4 * size)


@pytest.mark.parametrize("name", SCENES)
def test_pivots_of_the_tree_come_after_what_they_need(name):
    system = system_of(SCENES[name])
    slope = trace(system, known_of([p.g for p in system.placed]), range(system.n)).phi_q
    done = {c for c in range(system.n) if c not in {p.coordinate for p in spanning_tree(slope)}}

    for pivot in spanning_tree(slope):
        assert set(slope[pivot.row]) - {pivot.coordinate} <= done
        done.add(pivot.coordinate)
    assert done == set(range(system.n))


def test_loops_that_hang_on_each_other_are_blocks_of_their_own():
    assert [len(b) for b in program_of(SCENES["chain"]).blocks] == [2, 2, 2]


def test_a_triad_is_one_block_and_so_are_loops_closed_at_once():
    assert [len(b) for b in program_of(SCENES["platform"]).blocks] == [4]
    assert [len(b) for b in program_of(chain(5, together=True)).blocks] == [11]


def row(graph, *columns):
    return {c: graph.input("q", c) for c in columns}


def test_blocks_come_after_those_they_need():
    graph = Graph()
    matrix = [row(graph, 4, 7), row(graph, 2), row(graph, 2, 4, 7), row(graph, 2, 7, 9)]
    matched, result = blocks_of(matrix, [2, 4, 7, 9])

    assert result == [[2], [4, 7], [9]]
    assert sorted(matched.values()) == [0, 1, 2, 3]


@pytest.mark.parametrize("columns", [((0,), (0,)), ((0, 1),), ((0,), (0,), (0, 1), (1, 2))])
def test_rows_that_cannot_be_matched_are_refused(columns):
    graph = Graph()

    with pytest.raises(NotReducible, match="matched"):
        blocks_of([row(graph, *some) for some in columns], list(range(max(len(columns), 2))))


def test_a_crossed_choice_of_drivers_has_no_program():
    """Twice the crank driven, the other body free: as many rows as coordinates, and no solution."""
    law = Polynomial(coefficients=(0.0, 1.0))
    drivers = tuple(AngleDriver(name=n, body="a", law=law) for n in ("m", "n"))
    joints = (pin("A", "ground", 0j, "a", 0j), pin("B", "ground", 1 + 0j, "b", 0j))
    bodies = tuple(Body(name=n, estimate=(0.0, 0.0, 0.0)) for n in "ab")
    system = compile_system(Mechanism(bodies, joints, drivers))

    assert compiled(system, range(system.n), [p.g for p in system.placed]) is None


def test_what_a_coordinate_depends_on_in_the_end_is_what_itself_depends_on_nothing():
    assert eliminate._leaves([1, 5], {1: {2, 3}, 3: {4, 2}, 6: {7}}) == {2, 4, 5}
