"""Mobility: Gruebler's count in the plane and in space, rank at a pose, redundant rows by name."""

from __future__ import annotations

import inspect
import math
import runpy
from dataclasses import replace

import numpy as np
import pytest

import refkin
from refkin.errors import InvalidRequest, InvalidScene
from refkin.joints import SPATIAL_JOINT_TYPES, AngleDriver, XDriver, YDriver
from refkin.joints.spatial import PointOnPlane, SpatialRevolute
from refkin.model import Body, Mechanism, Scene
from refkin.motion_laws import Polynomial
from refkin.proof.singularity.second_order import balance
from refkin.scenes.linkages import ScrewJack
from refkin.solving.mobility import FREEDOMS, count, gruebler, kind_of, mobility, rank_of
from tests.claims import assert_near
from tests.linkages import ROCKER, moved_frame, with_estimates

from .assembled import beside_a_mast

RSSR = (
    ("revolute", "ground", "crank"),
    ("spherical", "crank", "coupler"),
    ("spherical", "coupler", "rocker"),
    ("revolute", "rocker", "ground"),
)


# ---- by count


def test_a_screw_jack_has_one_freedom():
    """6 x 3 - 6 - 5 - 6 + 0: the turn of a screw is a coordinate more, and a row more."""
    assert count(ScrewJack(0.1).scene(samples=2).mechanism).mobility == 1


def test_the_rssr_has_two_of_which_one_is_the_passive_spin_of_its_coupler():
    """6 x 4 - 22."""
    freedoms = gruebler(RSSR, "spatial")

    assert (freedoms.bodies, freedoms.equations, freedoms.mobility) == (4, 22, 2)
    assert (freedoms.passive, freedoms.useful) == (("coupler",), 1)


def test_a_coupler_held_by_a_universal_joint_does_not_spin():
    """R-U-S-R: 6 x 4 - (6 + 5 + 4 + 3 + 5) = 1."""
    joints = (RSSR[0], ("universal", "crank", "coupler"), *RSSR[2:])

    assert (gruebler(joints, "spatial").mobility, gruebler(joints, "spatial").passive) == (1, ())


def test_the_ground_spins_between_no_balls():
    """Two balls are all that holds it here, too, and no body moves less."""
    joints = (("spherical", "ground", "a"), ("revolute", "a", "b"), ("spherical", "b", "ground"))

    assert gruebler(joints, "spatial").passive == ()


def test_a_four_bar_counted_in_space_seems_overconstrained():
    """6 x 4 - 6 - 4 x 5 = -2: parallel axes make equations depend on each other, which no count sees."""
    joints = [("revolute", a, b) for a, b in (("ground", "a"), ("a", "b"), ("b", "c"), ("c", "ground"))]

    assert gruebler(joints, "spatial").mobility == -2
    assert gruebler(joints, "spatial").kind == "overconstrained: 2 equations more than coordinates"


def test_a_joint_leaves_as_many_freedoms_as_the_books_say():
    """A joint that somebody adds leaves what its rows, or its elements, do not take."""
    lower_pairs = {"fixed": 0, "revolute": 1, "prismatic": 1}
    one_row = dict.fromkeys(("point_on_line", "distance", "gear", "rack_and_pinion", "cam"), 2)
    of_space = {"screw": 1, "cylindrical": 2, "universal": 2, "spherical": 3, "point_on_line": 4, "parallel": 4}
    one_row_of_space = dict.fromkeys(("distance", "perpendicular", "point_on_plane"), 5)

    assert FREEDOMS["planar"].items() >= (lower_pairs | one_row).items()
    assert FREEDOMS["spatial"].items() >= (lower_pairs | of_space | one_row_of_space).items()


@pytest.mark.parametrize(
    ("joints", "dimension", "words"),
    [
        ([("spherical", "a", "b")], "planar", "joints\\[0\\]: expected one of revolute, fixed"),
        ([("revolute", "a")], "planar", "joints\\[0\\]: expected a type and two different bodies, got"),
        (
            [("revolute", "a", "b"), ("revolute", "a", "a")],
            "planar",
            "joints\\[1\\]: expected a type and two different",
        ),
        ("revolute", "planar", "joints\\[0\\]: expected a type and two different bodies, got 'r'"),
        ([("revolute", "a", "b")], "solid", "dimension: expected planar or spatial, got 'solid'"),
    ],
)
def test_what_cannot_be_counted_is_refused_in_words(joints, dimension, words):
    with pytest.raises(InvalidScene, match=words):
        gruebler(joints, dimension)


# ---- by rank


def pose(scene):
    """The pose of all bodies at the first time."""
    return refkin.solve(scene).q[:, 0]


@pytest.mark.parametrize(
    "linkage",
    [
        refkin.FourBar(4.0, 1.0, 3.5, 3.0, origin=(1e3, 2.0)),
        refkin.SliderCrank(0.2, 0.35, 0.05),
        refkin.InvertedSliderCrank(3e-6, 1e-6),
    ],
    ids=lambda linkage: type(linkage).__name__,
)
def test_a_linkage_has_one_freedom_by_count_and_by_rank(linkage):
    scene = linkage.scene(samples=2)
    freedoms = mobility(scene.mechanism, pose(scene))

    assert (count(scene.mechanism).mobility, freedoms.mobility, freedoms.driven.freedoms) == (1, 1, 0)
    assert freedoms.joints.dependent == ()


@pytest.mark.parametrize(
    "linkage",
    [refkin.FourBar(4e-4, 1e-4, 3.5e-4, 3e-4), refkin.SliderCrank(2e-5, 3.5e-5, 5e-6)],
    ids=lambda linkage: type(linkage).__name__,
)
def test_a_body_of_1_km_takes_no_rows_from_links_of_a_tenth_of_a_millimetre(linkage):
    alone = linkage.scene(samples=2)
    beside = beside_a_mast(alone)
    freedoms, of_one = mobility(beside.mechanism, pose(beside)), mobility(alone.mechanism, pose(alone))

    assert (freedoms.mobility, freedoms.driven.freedoms, freedoms.joints.dropped) == (2, 0, 0.0)
    assert freedoms.joints.kept == pytest.approx(of_one.joints.kept, rel=1e-6)


def test_frames_far_from_their_joints_leave_the_freedoms_as_they_are():
    """Turning such a body is nearly the same as shifting it: of rows that are not balanced the rank is 1 too small."""
    motion = refkin.solve(scene := ROCKER.scene(samples=2))
    closed = with_estimates(scene, lambda b: tuple(motion[b.name].q[:, 0].tolist()))
    far = moved_frame(closed, "coupler", (1e9, 0.0)).mechanism

    assert mobility(far, np.concatenate([b.estimate for b in far.bodies])).mobility == 1


def parallelogram(third_crank, phi=1.0):
    """Two cranks of length 1, 2 m apart, on a coupler; and, if asked, a third one between."""
    pins = {"crank": 0.0, "rocker": 2.0} | ({"third": 1.0} if third_crank else {})
    tip = np.array([math.cos(phi), math.sin(phi)])
    poses = {name: (x, 0.0, phi) for name, x in pins.items()} | {"coupler": (*tip, 0.0)}
    joints = []
    for name, x in pins.items():
        at = {"body_j": name, "point_j": (0.0, 0.0)}
        joints.append(refkin.Revolute(name=f"{name} pivot", body_i="ground", point_i=(x, 0.0), **at))
        end = {"body_i": name, "point_i": (1.0, 0.0), "body_j": "coupler", "point_j": (x, 0.0)}
        joints.append(refkin.Revolute(name=f"{name} pin", **end))
    driver = refkin.AngleDriver(name="motor", body="crank", law=Polynomial(coefficients=(phi,)))
    bodies = tuple(Body(name=name, estimate=q) for name, q in poses.items())
    return Mechanism(bodies, tuple(joints), (driver,)), np.array(list(poses.values())).ravel()


def test_a_third_crank_of_a_parallelogram_is_redundant_and_named():
    """By count a structure; it moves, as one row of the third crank says what the others say."""
    mechanism, q = parallelogram(third_crank=True)
    freedoms = mobility(mechanism, q)
    (dependence,) = freedoms.joints.dependent

    assert (count(mechanism).kind, freedoms.mobility) == ("structure", 1)
    assert dependence.row.startswith("third pin")
    assert {name.split("[")[0] for name in dependence.factors} == {
        *("crank pivot", "crank pin", "rocker pivot", "rocker pin"),
        *("third pivot", "third pin"),
    }


def test_a_third_crank_in_the_place_of_a_driver_holds_nothing_and_the_estimate_stays():
    """By count nothing is missing; the pose given was the flat one, 2 rad away."""
    mechanism, q = parallelogram(third_crank=True)
    bodies = tuple(replace(b, estimate=tuple(np.round(b.estimate, 2))) for b in mechanism.bodies)
    motion = refkin.solve(Scene(mechanism=replace(mechanism, bodies=bodies, drivers=()), times=(0.0,)))

    assert motion.verdict == "singular"
    assert motion.q[:, 0] == pytest.approx(q, abs=0.01)
    assert "idle motion: no driver holds" in motion.message


def test_a_third_crank_of_another_length_makes_a_structure():
    mechanism, q = parallelogram(third_crank=True)
    shorter = [
        refkin.Revolute(name=j.name, body_i=j.body_i, point_i=(0.9, 0.1), body_j=j.body_j, point_j=(0.95, -0.05))
        if j.name == "third pin"
        else j
        for j in mechanism.joints
    ]
    freedoms = mobility(Mechanism(mechanism.bodies, tuple(shorter), mechanism.drivers), q)

    assert (freedoms.mobility, freedoms.kind) == (0, "structure")


def test_a_flat_parallelogram_has_two_instantaneous_freedoms():
    mechanism, q = parallelogram(third_crank=False, phi=0.0)

    assert mobility(mechanism, q).mobility == 2
    assert [d.row for d in mobility(mechanism, q).joints.dependent] == ["rocker pin[0]"]


def stretched(driver):
    """The slider-crank of the notes, crank and rod in one line."""
    joints = refkin.SliderCrank(0.2, 0.35).joints()
    poses = {"crank": (0.1, 0.0, 0.0), "connecting_rod": (0.375, 0.0, 0.0), "slider": (0.55, 0.0, 0.0)}
    bodies = tuple(Body(name=name, estimate=q) for name, q in poses.items())
    return Mechanism(bodies, joints, (driver,)), np.array(list(poses.values())).ravel()


def test_at_a_dead_centre_the_slider_holds_nothing_but_the_crank_does():
    """The same pose, another actuator: the slider's row repeats what three pins say along the guide."""
    law = Polynomial(coefficients=(0.0,))
    by_slider = mobility(*stretched(refkin.XDriver(name="pull", body="slider", law=law)))
    by_crank = mobility(*stretched(refkin.AngleDriver(name="motor", body="crank", law=law)))
    (dependence,) = by_slider.driven.dependent

    assert (by_slider.mobility, by_crank.mobility) == (1, 1)
    assert (by_slider.driven.freedoms, by_crank.driven.freedoms) == (1, 0)
    assert (dependence.row, set(dependence.factors)) == ("pull", {"A0[0]", "A[0]", "B[0]"})


def test_linear_constraints_may_repeat_each_other():
    """Two equal rows are linear and singular: the claim that linear constraints are never singular is false."""
    rank = rank_of(np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 0.0], [1.0, 0.0, 2.0]]), ["a", "b", "a again"])

    assert rank.rank == 2
    assert [(d.row, {k: round(v, 12) for k, v in d.factors.items()}) for d in rank.dependent] == [
        ("a again", {"a": 1.0})
    ]


@pytest.mark.parametrize("phi", [1.1, -0.7, 0.5364, 0.0])
def test_two_rods_along_one_line_hold_one_freedom_whichever_way_it_leads(phi):
    """Of the angle's column rounding is all that is left, and it passed for a freedom held where a driver has one."""
    cos, sin = math.cos(phi), math.sin(phi)

    def rod(name, start, end):
        ends = {"body_i": "ground", "point_i": (start * cos, start * sin), "body_j": "plate", "point_j": (end, 0.0)}
        return refkin.Distance(name=name, **ends, length=end - start)

    law = Polynomial(coefficients=(phi,))
    drivers = (AngleDriver(name="motor", body="plate", law=law), YDriver(name="lift", body="plate", law=STILL))
    plate = Body(name="plate", estimate=(0.0, 0.0, phi))
    freedoms = mobility(Mechanism((plate,), (rod("a", -0.3, 0.1), rod("b", -0.2, 0.3)), drivers), [0.0, 0.0, phi])

    assert (freedoms.mobility, [row.row for row in freedoms.joints.dependent]) == (2, ["b"])


def test_a_row_that_vanishes_depends_on_nothing():
    (result,) = rank_of(np.array([[1.0, 0.0], [0.0, 0.0]]), ["a", "b"]).dependent

    assert str(result) == "b depends on nothing: it vanishes"


def test_a_pose_of_another_mechanism_is_refused():
    mechanism, q = parallelogram(third_crank=False)
    with pytest.raises(InvalidRequest, match="q: expected 9 coordinates"):
        mobility(mechanism, q[:6])


STILL = Polynomial(coefficients=(0.0,))


def test_dependences_reproduce_their_rows():
    """Each row that is named is the sum of the others times its factors, with as many names as rows beyond the rank."""
    rows = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, -1.0], [2.0, 5.0, -1.0], [3.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    names = ["a", "b", "c", "d", "e"]
    rank = rank_of(rows, names)
    assert (rank.rank, rank.freedoms, len(rank.dependent)) == (3, 0, 2), f"{rank}"
    sigma = np.linalg.svd(balance(rows)[0], compute_uv=False)
    assert_near([rank.kept, rank.dropped], [sigma[2], 0.0], 1e-14, "values kept and dropped")
    assert [d.row for d in rank.dependent] == ["d", "e"] or [d.row for d in rank.dependent] == ["c", "e"], f"{rank}"
    for d in rank.dependent:
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


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        *(({"q": q}, "q: expected 9 coordinates") for q in ("abc", None, ["a"] * 9, [math.nan] * 9, [math.inf] * 9)),
        *(({"t": t}, "t: expected a finite time") for t in ("0", math.nan)),
        *(({"tolerance": least}, "tolerance: expected a number of at least 0") for least in (math.nan, -1.0, "small")),
    ],
)
def test_what_no_rank_can_be_found_of_is_told_by_name(wrong, told):
    """A tolerance that is no number left nothing of the rank, and was answered."""
    scene = refkin.FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=3.0).scene(samples=2)

    with pytest.raises(InvalidRequest, match=told):
        mobility(scene.mechanism, **{"q": refkin.solve(scene).q[:, 0], **wrong})


def test_euler_parameters_of_a_pose_are_made_a_unit_as_those_of_an_estimate_are():
    """Twice as long they put points out of their places: rows depended otherwise. Where all are 0, NaN was printed."""
    frame = {f"{key}_{side}": axis for key, axis in (("axis", (0, 0, 1)), ("zero", (1, 0, 0))) for side in "ij"}
    places = {"ground": (0, 0), "a": (0, 0), "b": (1, 1), "c": (4, 0)}
    pins = [("ground", "a", (0, 0)), ("a", "b", (1, 1)), ("b", "c", (3, 2)), ("c", "ground", (4, 0))]
    joints = [
        SpatialRevolute(
            name=f"{i} {j}",
            body_i=i,
            point_i=(*np.subtract(at, places[i]).tolist(), 0),
            body_j=j,
            point_j=(*np.subtract(at, places[j]).tolist(), 0),
            **frame,
        )
        for i, j, at in pins
    ]
    mechanism = Mechanism([Body(name=name) for name in "abc"], joints)
    poses = [np.ravel([(*places[name], 0, length, 0, 0, 0) for name in "abc"]) for length in (1.0, 2.0, 0.0)]
    known, longer = (mobility(mechanism, q) for q in poses[:2])

    assert known.mobility == longer.mobility == 1
    assert known.joints.dependent == longer.joints.dependent
    with pytest.raises(InvalidRequest, match="q: expected Euler parameters that are not all 0, got"):
        mobility(mechanism, poses[2])


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


def test_a_joint_of_space_that_says_its_elements_one_by_one_is_counted_by_its_formulas(monkeypatch):
    class Planes(PointOnPlane):
        formulas = PointOnPlane.formulas * 2
        consists_of = ()
        type = "planes"

    monkeypatch.setattr("refkin.joints.SPATIAL_JOINT_TYPES", (*SPATIAL_JOINT_TYPES, Planes))
    counted = runpy.run_path(inspect.getsourcefile(gruebler))["FREEDOMS"]["spatial"]

    assert (counted["planes"], counted["point_on_plane"]) == (4, 5)
