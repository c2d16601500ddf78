"""Coloured differences: the entries of a sparse Jacobian from a few evaluations, with the errors that each rule has."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import random_array

from refkin import differences
from refkin.differences import Scheme
from refkin.fast import Colouring, pattern_of

from .linkworks import chain
from .scenes import SCENES, system_of

pytest.importorskip("scipy.optimize._numdiff")  # loaded before anything is timed


def estimate(scene):
    system = system_of(scene)
    q = np.full(system.n, 0.4)
    q[: system.of_bodies] = [x for b in scene.mechanism.bodies for x in b.estimate]
    return system, system.to_unit(q)


@given(st.integers(1, 12), st.integers(1, 12), st.floats(0.05, 0.6), st.integers(0, 2**32 - 1))
def test_no_two_columns_of_a_colour_share_a_row(m, n, density, seed):
    pattern = random_array((m, n), density=density, rng=np.random.default_rng(seed)).tocsc()
    colours = Colouring(pattern)
    dense = pattern.toarray() != 0

    for colour in range(colours.colours):
        assert np.all(np.sum(dense[:, colours.colour == colour], axis=1) <= 1)


@pytest.mark.parametrize("scheme", Scheme)
@pytest.mark.parametrize("name", SCENES)
def test_a_coloured_jacobian_is_that_of_the_columns_one_by_one(name, scheme):
    """The same steps of the same coordinates: entries agree to the rounding of f over the step."""
    system, q = estimate(SCENES[name])

    def phi(x):
        return system.phi(x, 0.0)

    result = Colouring(pattern_of(phi, system.n)).jacobian(phi, q, scheme).toarray()
    expected = differences.jacobian(phi, q, scheme)
    rounding = 2.0**-50 * np.max(np.abs(q)) / np.min(differences.step(scheme, q))

    assert np.max(np.abs(result - expected)) <= (1e-15 if scheme is Scheme.COMPLEX_STEP else rounding)


@pytest.mark.parametrize("windows", [1, 10, 60])
def test_the_complex_step_is_exact_at_every_size(windows):
    system, q = estimate(chain(windows))

    def phi(x):
        return system.phi(x, 0.0)

    result = Colouring(pattern_of(phi, system.n)).jacobian(phi, q).toarray()

    assert np.max(np.abs(result - system.phi_q(q, 0.0))) < 4e-16


@pytest.mark.parametrize(("scheme", "order"), [(Scheme.FORWARD, 1), (Scheme.CENTRAL, 2)])
def test_differences_err_with_their_order(scheme, order):
    system, q = estimate(chain(5))

    def phi(x):
        return system.phi(x, 0.0)

    colours = Colouring(pattern_of(phi, system.n))
    off = [abs(colours.jacobian(phi, q, scheme, h) - system.phi_q(q, 0.0)).max() for h in (1e-2, 1e-3)]

    assert np.log10(off[0] / off[1]) == pytest.approx(order, abs=0.05)


def test_colours_do_not_grow_with_the_mechanism():
    colours = [
        Colouring(pattern_of(lambda x, s=s: s.phi(x, 0.0), s.n)).colours
        for s in map(system_of, map(chain, (3, 12, 48)))
    ]

    assert max(colours) <= 7


def test_a_pattern_that_lacks_an_entry_is_seen():
    """The planted fault of this file: an entry left out makes others of its colour wrong, or itself zero."""
    system, q = estimate(SCENES["four-bar"])

    def phi(x):
        return system.phi(x, 0.0)

    whole = pattern_of(phi, system.n).toarray()
    whole[4, 5] = 0.0
    result = Colouring(whole).jacobian(phi, q).toarray()

    assert np.max(np.abs(result - system.phi_q(q, 0.0))) > 1e-3
