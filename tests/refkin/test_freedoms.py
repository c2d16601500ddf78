"""Checks of mobility: by count, by rank, and which rows depend on which."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from refkin.joints import AngleDriver, Revolute, XDriver, YDriver
from refkin.model import Body, Mechanism
from refkin.motion_laws import Polynomial
from refkin.scenes.linkages import FourBar, SliderCrank
from refkin.solving.mobility import count, gruebler, kind_of, mobility, rank_of
from refkin.solving.solve import solve
from tests.claims import assert_near

ROCKER = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0)
STILL = Polynomial(coefficients=(0.0,))


def test_freedoms_are_counted():
    """By count and by rank a slider-crank has one freedom, an RSSR two, one of them idle, and a triangle none."""
    slider = SliderCrank(crank=1.0, rod=3.0, offset=0.4)
    for linkage in (slider, ROCKER):
        scene = linkage.scene(samples=2)
        pose = solve(scene).q[:, 0]
        assert count(scene.mechanism).mobility == 1, f"{linkage}: {count(scene.mechanism)}"
        found = mobility(scene.mechanism, pose)
        assert found.mobility == 1, f"{linkage}: mobility {found.mobility} by rank"
        assert found.driven.freedoms == 0, f"{linkage}: {found.driven.freedoms} freedoms with its driver"
    rssr = gruebler(
        [("revolute", "ground", "a"), ("spherical", "a", "b"), ("spherical", "b", "c"), ("revolute", "c", "ground")],
        "spatial",
    )
    assert (rssr.mobility, rssr.useful, rssr.idle) == (2, 1, ("b",)), f"RSSR: {rssr}"
    triangle = gruebler([("revolute", "ground", "a"), ("revolute", "a", "b"), ("revolute", "b", "ground")])
    assert (triangle.mobility, triangle.kind) == (0, "structure"), f"triangle: {triangle.kind}"
    geared = gruebler([("revolute", "ground", "a"), ("revolute", "ground", "b"), ("gear", "a", "b")])
    assert geared.mobility == 1, f"a gear pair has {geared.mobility}"


def test_redundant_rows_are_named():
    """A joint that is there twice leaves the rank as it is, and its rows are named as dependent."""
    pin = Revolute(name="pin", body_i="ground", point_i=(0.0, 0.0), body_j="b", point_j=(-0.5, 0.0))
    still = Polynomial(coefficients=(0.0,))
    drivers = (AngleDriver(name="d", body="b", law=still),)
    twice = Mechanism((Body(name="b"),), (pin, replace(pin, name="again")), drivers)
    found = mobility(twice, np.array([0.5, 0.0, 0.0]))
    assert (found.mobility, found.driven.freedoms) == (1, 0), f"{found}"
    assert [d.row for d in found.joints.dependent] == ["again[0]", "again[1]"], f"{found.joints.dependent}"


def test_dependences_reproduce_their_rows():
    """Each row that is named is the sum of the others times its factors, with as many names as rows beyond the rank."""
    rows = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, -1.0], [2.0, 5.0, -1.0], [3.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    names = ["a", "b", "c", "d", "e"]
    found = rank_of(rows, names)
    assert (found.rank, found.freedoms, len(found.dependent)) == (3, 0, 2), f"{found}"
    sigma = np.linalg.svd(rows, compute_uv=False)
    assert_near([found.kept, found.dropped], [sigma[2], 0.0], 1e-14, "values kept and dropped")
    assert [d.row for d in found.dependent] == ["d", "e"] or [d.row for d in found.dependent] == ["c", "e"], f"{found}"
    for d in found.dependent:
        total = sum((f * rows[names.index(n)] for n, f in d.factors.items()), np.zeros(3))
        assert_near(total, rows[names.index(d.row)], 1e-13, f"{d}")
        assert d.row not in d.factors, f"{d} depends on itself"
    nothing = rank_of(np.zeros((0, 3)), [])
    assert (nothing.rank, nothing.freedoms, nothing.kept, nothing.dropped) == (0, 3, 0.0, 0.0), f"{nothing}"
    free = Mechanism(
        (Body(name="b"),), (), tuple(k(name=k.__name__, body="b", law=STILL) for k in (XDriver, YDriver, AngleDriver))
    )
    found_free = mobility(free, np.zeros(3))
    assert (found_free.mobility, found_free.driven.freedoms) == (3, 0), f"{found_free}"


def test_kinds_have_their_names():
    """A structure, a mechanism with so many freedoms, and by how much a system is overconstrained."""
    for mobility_, words in (
        (0, "structure"),
        (1, "one freedom"),
        (3, "3 freedoms"),
        (-1, "1 equation more"),
        (-2, "2 equations more"),
    ):
        assert words in kind_of(mobility_), f"{mobility_}: {kind_of(mobility_)}"
    assert math.prod("freedom" in kind_of(k) for k in (1, 2)) == 1, "a mechanism without freedoms"
