"""Assemblies of dyads in closed form: all of them, or the proof that there is none, against formulas written here."""

from __future__ import annotations

import cmath
import math
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
from flint import arb, ctx

from refkin.joints import AngleDriver, Distance, Fixed, Gear, PointOnLine, Prismatic, Revolute, XDriver, YDriver
from refkin.model import Body, Mechanism
from refkin.motion_laws import Polynomial, Sinusoid, Table
from refkin.proof.assembly import assembly
from refkin.proof.assembly.group_poses import GroupPose, Link, moves_of_group
from refkin.proof.assembly.loci import Circle, Line, meet
from refkin.proof.assembly.rigid_groups import plan
from refkin.proof.assembly.rows import AssemblyRows, PointRow, RowKind, read_rows
from refkin.system import compile_system
from refkin.vec import Vec

from .assembly_cases import (
    ROUND_OFF,
    bodies,
    constant,
    cylinder,
    diagonal,
    four_bar,
    missing,
    pin,
    residual,
    slider_crank,
    solved,
    turned,
)

# ---- loci


def test_parallel_lines_are_proved_to_miss_each_other_by_their_distance_and_one_line_itself_is_no_proof():
    normal = Vec(arb(0), arb(1))
    one, other = (Line(Vec(arb(x), arb(y)), normal) for x, y in ((0.0, 0.0), (3.0, 0.25)))

    assert meet(one, other).gap == 0.25
    assert meet(one, Line(Vec(arb(7), arb(0)), normal)) is None


@pytest.mark.parametrize("on_b", [True, False])
def test_three_points_that_are_laid_on_three_lines_lie_on_them_in_both_assemblies(on_b):
    """The lines are those of group B, which comes to A, or of group A."""
    pose = GroupPose(Vec(arb(1), arb(2)), arb("0.4"), arb("0.4").cos(), arb("0.4").sin())
    links = []
    for k, (x, y) in enumerate(((0.6, 0.8), (-0.8, 0.6), (0.28, -0.96))):
        q, n = Vec(arb(k), arb(k * k - 1)), Vec(arb(x), arb(y))
        along = n.perp() * arb(0.3 + 0.4 * k)
        p = pose.point(q + along) if on_b else pose.point(q) + along
        links.append(Link(RowKind.LINE, p, q, n, on_b, arb(0)))
    moves, _ = moves_of_group(links, turning=True)

    assert len(moves) == 2
    for move in moves:
        there = GroupPose(move.shift, move.turn.phi, move.turn.c, move.turn.s)
        for k in links:
            gap = k.normal.dot(there.local(k.p) - k.q if on_b else there.point(k.q) - k.p)
            assert gap.contains(0)
            assert gap.rad() < 1e-9


def off(locus, p):
    """How far a point is from a locus, with a sign."""
    if isinstance(locus, Line):
        return locus.normal.dot(p - locus.through)
    return (p - locus.centre).dot(p - locus.centre).sqrt() - locus.radius


def missed(first, second):
    """What is missing for two loci to meet, and the direction whose left side is 1: of numbers, in 50 digits."""
    if isinstance(first, Line):
        return abs(off(first, second.centre)) - second.radius, second.centre, first.normal
    if isinstance(second, Line):
        return missed(second, first)
    way = second.centre - first.centre
    apart, least = way.dot(way).sqrt(), abs(first.radius - second.radius)
    return (apart - first.radius - second.radius).max(least - apart), first.centre, way


@pytest.mark.parametrize("kinds", ["line circle", "circle line", "circle circle"])
@pytest.mark.parametrize("seed", range(20))
def test_two_loci_meet_in_two_points_one_on_each_side_or_miss_each_other_by_what_is_missing(kinds, seed):
    rng = np.random.default_rng(seed)
    with ctx.workdps(50):
        loci = []
        for kind in kinds.split():
            x, y, c, s, r = map(arb, (*rng.uniform(-1.0, 1.0, 4), rng.uniform(0.1, 1.5)))
            normal = Vec(c, s) * (1 / (c * c + s * s).sqrt())
            loci.append(Line(Vec(x, y), normal) if kind == "line" else Circle(Vec(x, y), r))
        met, (missing, centre, way) = meet(*loci), missed(*loci)

        if missing > 0:
            assert met.gap.overlaps(missing)
            assert abs(met.apart - met.reach).overlaps(missing)
            assert (met.inside, met.points) == (met.apart < met.reach, ())
            return
        assert (met.gap, met.decided) == (None, True)
        assert all(off(locus, p).overlaps(arb(0, "1e-40")) for _, p in met.points for locus in loci)
        assert [side for side, p in met.points if way.perp().dot(p - centre) * side > 1e-40] == [1, -1]


# ---- four-bars

CLASSES = {
    "crank-rocker": (4.0, 1.0, 3.5, 3.0),
    "double crank": (1.0, 3.0, 3.5, 4.0),
    "double rocker": (4.0, 3.0, 1.0, 3.5),
    "rocker-crank": (4.0, 3.0, 3.5, 1.0),
    "triple rocker": (6.0, 3.0, 4.0, 2.0),
    "change point": (4.0, 1.0, 3.0, 2.0),
    "never closes": (10.0, 1.0, 2.0, 3.0),
}


@pytest.mark.parametrize("lengths", CLASSES.values(), ids=CLASSES)
def test_two_assemblies_inside_the_input_range_and_a_proof_outside(lengths):
    unit = 8.0 if lengths[0] > 5.7 else 4.0
    for angle in np.linspace(-3.1, 3.1, 41):
        _, result = solved(four_bar(*lengths, float(angle)))
        gap = missing(*lengths, float(angle))

        assert result.complete
        assert len(result.poses) == (0 if gap > 0 else 2)
        assert (result.gap is None) == (gap < 0)
        if gap > 0:
            assert result.gap == pytest.approx(float(gap) / unit, rel=1e-13, abs=0.0)


@pytest.mark.parametrize("gap", [1e-1, 1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("side", ["stretched", "folded"])
@pytest.mark.parametrize("sign", [1, -1], ids=["missing", "to spare"])
def test_a_gap_of_this_size_is_decided_on_both_sides(gap, side, sign):
    """Closure missed by the gap is proved and measured; closure with as much to spare gives both assemblies."""
    ground, crank, rocker, angle = 4.0, 1.0, 3.0, 0.9
    d = float(diagonal(ground, crank, angle))
    coupler = d - rocker - sign * gap if side == "stretched" else d + rocker + sign * gap
    if coupler < 0:
        coupler, rocker = 7.0, d + 7.0 + sign * gap
    system, result = solved(four_bar(ground, crank, coupler, rocker, angle))
    truth = float(missing(ground, crank, coupler, rocker, angle)) / system.unit.size

    assert sign * truth > 0
    assert result.complete
    if sign > 0:
        assert result.gap == pytest.approx(truth, rel=1e-9, abs=0.0)
        assert result.gap <= truth * (1 + 1e-15)
        assert result.poses == ()
    else:
        assert result.gap is None
        assert sorted(result.branches) == [(-1,), (1,)]
        assert residual(system, result) < ROUND_OFF


def test_the_message_names_bodies_distance_and_reach():
    _, result = solved(four_bar(10.0, 1.0, 2.0, 3.0, math.pi))

    assert result.message == (
        "coupler and rocker cannot meet: their pins are 11 m apart, their lengths reach 5 m; 6 m are missing"
    )


def test_a_loop_with_a_link_longer_than_the_rest_never_closes_however_it_is_driven():
    """The driver on a coupler point leaves no dyad; the loop alone is the proof."""
    driver = YDriver(name="motor", body="coupler", point=(1.0, 0.7), law=constant(0.5))
    system, result = solved(four_bar(10.0, 1.0, 2.0, 3.0, driver))

    assert result.gap == pytest.approx(4.0 / system.unit.size, rel=1e-14, abs=0.0)
    assert "ground is longer (10 m) than the rest of its loop (6 m)" in result.message


def test_the_sides_say_on_which_side_of_the_diagonal_the_inner_pin_lies():
    system, result = solved(four_bar(4.0, 1.0, 3.5, 3.0, 0.7))
    a = cmath.rect(1.0, 0.7)
    for q, (side,) in zip(result.poses, result.branches, strict=True):
        physical = system.to_physical(q)
        x, y, phi = physical[system.columns("coupler")]
        b = complex(x, y) + cmath.rect(3.5, phi)

        assert math.copysign(1, ((b - a) * (4.0 - a).conjugate()).imag) == side


@pytest.mark.parametrize(
    ("driver", "count"),
    [
        (turned("coupler", 0.6), 2),
        (AngleDriver(name="motor", body="coupler", relative_to="rocker", law=constant(1.6)), 2),
        (cylinder("ground", (0.0, -2.0), "crank", (0.8, 0.0), 1.6), 4),
        (cylinder("coupler", (1.0, 1.0), "crank", (0.5, 0.0), -1.1), 4),
    ],
    ids=["coupler angle", "angle between coupler and rocker", "cylinder on the crank", "cylinder, negative length"],
)
def test_a_four_bar_is_enumerated_wherever_its_driver_sits(driver, count):
    system, result = solved(four_bar(4.0, 1.0, 3.5, 3.0, driver))

    assert result.complete
    assert len(result.poses) == count
    assert residual(system, result) < ROUND_OFF


def test_poses_are_better_than_any_that_floats_could_find_close_to_a_limit():
    """1e-12 before the limit the condition is 1e6; the pose is still right to its last digits, and says so."""
    d = float(diagonal(4.0, 1.0, 0.9))
    coupler = d - 3.0 + 1e-12
    system, result = solved(four_bar(4.0, 1.0, coupler, 3.0, 0.9))
    with mpmath.workdps(50):
        b, c, dd = mpmath.mpf(coupler), mpmath.mpf(3), diagonal(4.0, 1.0, 0.9)
        a = mpmath.expj(mpmath.mpf(0.9))
        inner = mpmath.acos((b * b + dd * dd - c * c) / (2 * b * dd))
        exact = [float(mpmath.arg(4 - a) + side * inner) for (side,) in result.branches]
    angles = [float(q[system.columns("coupler")][2]) for q in result.poses]

    assert np.abs(np.subtract(angles, exact)).max() < 4e-16
    assert max(result.radii) < 4e-16


def test_what_newton_finds_takes_the_place_of_a_ball_s_middle_only_if_it_closes(monkeypatch):
    _, middles = solved(four_bar(4.0, 1.0, 3.5, 3.0, 0.7))
    monkeypatch.setattr(assembly, "closes", lambda system, q, t, allowed=0.0: allowed > 0.0)
    monkeypatch.setattr(assembly, "position", lambda system, q, t, **_: SimpleNamespace(q=q + 1.0, converged=True))

    _, result = solved(four_bar(4.0, 1.0, 3.5, 3.0, 0.7))

    assert len(result.poses) == 2
    assert np.array_equal(result.poses, middles.poses)


# ---- other dyads

UNDECIDED_AT = {
    "slider at its limit": slider_crank(
        1.0, 3.0, 0.0, XDriver(name="m", body="slider", law=constant(4.0))
    ),
    "crank and coupler in line": four_bar(4.0, 1.0, 2.0, 5.0, 0.0),
}  # fmt: skip


@pytest.mark.parametrize("mechanism", UNDECIDED_AT.values(), ids=UNDECIDED_AT)
def test_where_the_assemblies_coincide_exactly_the_pose_is_given_and_nothing_is_claimed(mechanism):
    system, result = solved(mechanism)

    assert result.gap is None
    assert not result.complete
    assert result.branches == ((0,),)
    assert residual(system, result) < ROUND_OFF


@pytest.mark.parametrize("x", [2.0, 2.3, 3.9, 4.0 - 1e-9, 4.0 + 1e-9, 4.5, 1.9])
def test_a_slider_that_drives_reaches_from_rod_minus_crank_to_their_sum(x):
    system, result = solved(slider_crank(1.0, 3.0, 0.25, XDriver(name="m", body="slider", law=constant(x))))
    with mpmath.workdps(50):
        d = mpmath.hypot(mpmath.mpf(x), mpmath.mpf(0.25))
        truth = float(max(d - 4, 2 - d)) / system.unit.size

    assert result.complete
    assert len(result.poses) == (2 if truth < 0 else 0)
    if truth > 0:
        assert result.gap == pytest.approx(truth, rel=1e-9, abs=0.0)


@pytest.mark.parametrize("angle", [-2.0, -1.3, -0.4, 0.7, 1.9, 3.0])
@pytest.mark.parametrize("rod", [3.0, 0.6])
def test_a_crank_that_drives_reaches_the_guide_where_the_rod_is_long_enough(rod, angle):
    system, result = solved(slider_crank(1.0, rod, 0.25, turned("crank", angle)))
    truth = (abs(math.sin(angle) - 0.25) - rod) / system.unit.size

    assert len(result.poses) == (2 if truth < 0 else 0)
    if truth > 0:
        assert result.gap == pytest.approx(truth, rel=1e-12, abs=0.0)
        assert "the line is" in result.message


def inverted(ground, crank, offset, angle):
    """A block on the crank pin slides along the rocker, on a line at a distance of `offset` from the rocker's pivot."""
    joints = (
        pin("A0", "ground", (0.0, 0.0), "crank", (0.0, 0.0)),
        pin("A", "crank", (crank, 0.0), "block", (0.0, 0.0)),
        pin("B0", "ground", (ground, 0.0), "rocker", (0.0, 0.0)),
        Prismatic(
            name="slide", body_i="rocker", point_i=(0.3, offset), axis_i=(2.0, 0.0), body_j="block", point_j=(0.0, 0.0)
        ),
    )
    return Mechanism(bodies("crank", "block", "rocker"), joints, (turned("crank", angle),))


@pytest.mark.parametrize("offset", [0.0, 0.3, 1.9, 2.5])
def test_an_inverted_slider_crank_assembles_where_the_pin_is_farther_than_the_offset(offset):
    system, result = solved(inverted(3.0, 1.0, offset, 0.8))
    truth = (offset - abs(3.0 - cmath.rect(1.0, 0.8))) / system.unit.size

    assert len(result.poses) == (2 if truth < 0 else 0)
    assert result.complete
    if truth > 0:
        assert result.gap == pytest.approx(truth, rel=1e-12, abs=0.0)


def test_a_coupler_that_points_exactly_backwards_has_an_angle_of_pi():
    """A parallelogram, its coupler turned round: on the cut of atan2 a ball of the angle would hold a whole turn."""
    base = four_bar(4.0, 1.0, 4.0, 1.0, 0.7)
    joints = (base.joints[0], pin("A", "crank", (1.0, 0.0), "coupler", (4.0, 0.0)), *base.joints[2:])
    joints = (*joints[:2], pin("B", "coupler", (0.0, 0.0), "rocker", (1.0, 0.0)), joints[3])
    system, result = solved(Mechanism(base.bodies, joints, base.drivers))
    angles = [abs(q[system.columns("coupler")][2]) for q in result.poses]

    assert max(angles) == pytest.approx(math.pi, abs=1e-15)
    assert max(result.radii) < ROUND_OFF


def five_bar():
    """Two drivers: a cylinder that makes the first two links rigid, and the angle of the second."""
    joints = (
        pin("A", "ground", (0.0, 0.0), "first", (0.0, 0.0)),
        pin("B", "first", (1.0, 0.0), "second", (0.0, 0.0)),
        pin("C", "second", (2.0, 0.0), "third", (0.0, 0.0)),
        pin("D", "third", (2.5, 0.0), "fourth", (0.0, 0.0)),
        pin("E", "fourth", (1.5, 0.0), "ground", (3.0, 0.5)),
    )
    drivers = (cylinder("first", (0.2, 0.3), "second", (1.0, 0.1), 1.5), turned("second", 0.3))
    return Mechanism(bodies("first", "second", "third", "fourth"), joints, drivers)


def two_sliders():
    """PRP: two sliders on lines of the ground, pinned to each other."""
    first = Prismatic(name="p", body_i="ground", point_i=(0.0, 0.1), axis_i=(1.0, 0.2), body_j="a", point_j=(0.0, 0.0))
    second = Prismatic(name="r", body_i="ground", point_i=(1.0, 0.0), axis_i=(0.0, 1.0), body_j="b", point_j=(0.0, 0.0))
    return Mechanism(bodies("a", "b"), (first, second, pin("C", "a", (0.1, 0.2), "b", (0.3, 0.0))), ())


def ladder(driver):
    def on(name, axis, at):
        return PointOnLine(
            name=name, body_i="ground", point_i=(0.0, 0.0), axis_i=axis, body_j="ladder", point_j=(at, 0.0)
        )

    return Mechanism(bodies("ladder"), (on("wall", (0.0, 1.0), 0.0), on("floor", (1.0, 0.0), 2.0)), (driver,))


def foot(x):
    return ladder(XDriver(name="m", body="ladder", point=(2.0, 0.0), law=constant(x)))


def middle(x):
    return ladder(XDriver(name="m", body="ladder", point=(1.0, 0.3), law=constant(x)))


def massless(length):
    rod = Distance(name="rod", body_i="crank", point_i=(1.0, 0.0), body_j="rocker", point_j=(3.0, 0.0), length=length)
    joints = (
        pin("A0", "ground", (0.0, 0.0), "crank", (0.0, 0.0)),
        pin("B0", "ground", (4.0, 0.0), "rocker", (0.0, 0.0)),
        rod,
    )
    return Mechanism(bodies("crank", "rocker"), joints, (turned("crank", 0.8),))


def plate(angle):
    """A plate fixed to the crank, and a rod from the plate to a pin of the ground: a fixed joint within a dyad."""
    weld = Fixed(name="weld", body_i="crank", point_i=(1.0, 0.0), body_j="plate", point_j=(0.1, 0.0), angle=0.4)
    base = four_bar(4.0, 1.0, 3.5, 3.0, angle)
    joints = (*base.joints[:1], weld, pin("A", "plate", (0.1, 0.0), "coupler", (0.0, 0.0)), *base.joints[2:])
    return Mechanism((*base.bodies, *bodies("plate")), joints, base.drivers)


DYADS = {
    "PRP": (two_sliders(), 1),
    "foot of a ladder": (foot(1.3), 2),
    "middle of a ladder": (middle(0.7), 2),
    "angle of a ladder": (ladder(turned("ladder", -0.7)), 1),
    "massless coupler": (massless(3.5), 2),
    "fixed plate": (plate(0.7), 2),
    "inverted": (inverted(3.0, 1.0, 0.3, 0.8), 2),
    "five-bar": (five_bar(), 2),
}


@pytest.mark.parametrize(("mechanism", "count"), DYADS.values(), ids=DYADS)
def test_every_assembly_of_a_dyad_is_enumerated(mechanism, count):
    system, result = solved(mechanism)

    assert result.complete
    assert len(result.poses) == len(result.branches) == count
    assert residual(system, result) < ROUND_OFF
    assert max(result.radii) < ROUND_OFF


OUT_OF_REACH = {
    "foot of a ladder": (foot(2.3), 0.3),
    "middle of a ladder": (middle(1.7), 1.7 - math.hypot(1.0, 0.3)),
    "massless coupler": (massless(0.2), abs(4.0 - cmath.rect(1.0, 0.8)) - 3.2),
}


@pytest.mark.parametrize(("mechanism", "metres"), OUT_OF_REACH.values(), ids=OUT_OF_REACH)
def test_what_a_dyad_misses_is_measured(mechanism, metres):
    """For the trammel a cos + b sin = d the gap is |d| - |(a, b)|; here (a, b) is the driven point on the ladder."""
    system, result = solved(mechanism)

    assert result.poses == ()
    assert result.gap * system.unit.size == pytest.approx(metres, rel=1e-12, abs=0.0)


def six_bar(angle, reach=3.0):
    base = four_bar(4.0, 1.0, 3.5, 3.0, angle)
    more = (
        pin("D", "coupler", (1.7, 1.0), "link", (0.0, 0.0)),
        pin("E", "link", (reach, 0.0), "output", (2.5, 0.0)),
        pin("E0", "ground", (3.0, 4.0), "output", (0.0, 0.0)),
    )
    return Mechanism((*base.bodies, *bodies("link", "output")), (*base.joints, *more), base.drivers)


def test_two_dyads_have_four_assemblies():
    system, result = solved(six_bar(0.7))

    assert result.complete
    assert sorted(result.branches) == [(-1, -1), (-1, 1), (1, -1), (1, 1)]
    assert residual(system, result) < ROUND_OFF
    assert min(np.abs(a - b).max() for k, a in enumerate(result.poses) for b in result.poses[:k]) > 1e-3


def test_the_gap_of_two_dyads_is_the_smallest_along_all_branches():
    """Both assemblies of the first dyad leave the second one open; the nearer of the two is the gap."""
    system, result = solved(six_bar(0.7, reach=0.25))
    inner = [system.to_physical(q) for q in solved(six_bar(0.7))[1].poses]
    misses = []
    for q in inner:
        x, y, phi = q[system.columns("coupler")]
        d = abs(complex(x, y) + complex(1.7, 1.0) * cmath.exp(1j * phi) - (3 + 4j))
        misses.append(max(d - 2.75, 2.25 - d))

    assert min(misses) > 0
    assert result.gap * system.unit.size == pytest.approx(min(misses), rel=1e-12, abs=0.0)


def test_a_branch_of_the_first_dyad_that_the_second_cannot_follow_is_left_out():
    """The gap between the branches of the test above: a link that reaches from one of them only."""
    values = [solved(six_bar(0.7, reach=float(r)))[1] for r in np.linspace(0.3, 3.0, 28)]

    assert {len(f.poses) for f in values} == {0, 2, 4}
    assert all(f.complete for f in values)
    assert all({s[0] for s in f.branches} == {f.branches[0][0]} for f in values if len(f.poses) == 2)


def test_more_branches_than_are_followed_leave_everything_open():
    """Nine dyads in a row, 512 assemblies: what is given is right, but neither all nor proved to be."""
    base, names, joints = four_bar(4.0, 1.0, 3.5, 3.0, 0.7), [], []
    for k in range(8):
        inner, outer = f"inner {k}", f"outer {k}"
        names += [inner, outer]
        joints += [
            pin(f"P{k}", f"inner {k - 1}" if k else "coupler", (1.0, 0.3), inner, (0.0, 0.0)),
            pin(f"Q{k}", inner, (3.0, 0.0), outer, (3.0, 0.0)),
            pin(f"R{k}", "ground", (0.5, 2.0), outer, (0.0, 0.0)),
        ]
    system, result = solved(Mechanism((*base.bodies, *bodies(*names)), (*base.joints, *joints), base.drivers))

    assert result.poses
    assert residual(system, result) < ROUND_OFF
    assert not result.complete
    assert result.gap is None
    assert "more than 256 branches" in result.message


# ---- redundant rows


def parallelogram(third, at=0.0):
    base = four_bar(4.0, 1.0, 4.0, 1.0, 0.7, at=(at, 0.0))
    more = (
        pin("D", "coupler", (0.3 * 4.0, 0.0), "third", (third, 0.0)),
        pin("D0", "ground", (at + 0.3 * 4.0, 0.0), "third", (0.0, 0.0)),
    )
    return Mechanism((*base.bodies, *bodies("third")), (*base.joints, *more), base.drivers)  # fmt: skip


def test_a_third_crank_that_fits_keeps_the_parallel_assembly_alone():
    system, result = solved(parallelogram(1.0))
    coupler = result.poses[0][system.columns("coupler")]

    assert result.complete
    assert len(result.poses) == 1
    assert abs(coupler[2]) < ROUND_OFF


@pytest.mark.parametrize("off", [1e-3, -1e-6, 1e-9, -1e-11])
def test_a_third_crank_that_does_not_fit_is_refused_with_what_it_misses(off):
    """The coupler stays parallel, so the third crank misses by exactly what its length is off."""
    system, result = solved(parallelogram(1.0 + off))

    # Each number is spread by 2^-50 = 9e-16; a few hundred operations on them widen a ball to no more than 2e-12.
    assert abs(off) - 2e-12 < result.gap * system.unit.size <= abs(1.0 + off - 1.0)
    assert result.message.startswith("D0 cannot close: ground and third miss by")


def test_a_third_crank_that_is_rounded_is_not_refused():
    assert solved(parallelogram(math.nextafter(1.0, 2.0)))[1].gap is None


def test_a_third_crank_whose_pivot_is_rounded_far_from_the_origin_is_not_refused():
    """At 1e8 m a pivot is rounded to 1.5e-8 m: 1.2 m from the first it is 4 nm off."""
    off = (1e8 + 1.2) - 1e8 - 1.2
    _, result = solved(parallelogram(1.0, at=1e8))

    assert abs(off) > 1e-9
    assert result.gap is None
    assert len(result.poses) == 1


@pytest.mark.parametrize("off", [-1e-6, 1e-6], ids=["too short", "too long"])
def test_a_rod_to_a_crank_that_is_driven_already_is_refused(off):
    base = four_bar(4.0, 1.0, 3.5, 3.0, 0.7)
    length = abs(cmath.rect(1.0, 0.7) - (2 - 1j)) + off
    ends = {"body_i": "ground", "point_i": (2.0, -1.0), "body_j": "crank", "point_j": (1.0, 0.0)}
    rod = Distance(name="rod", **ends, length=length)
    system, result = solved(Mechanism(base.bodies, (*base.joints, rod), base.drivers))

    assert result.gap * system.unit.size == pytest.approx(1e-6, rel=1e-6, abs=0.0)
    assert result.message.startswith("rod cannot close: ground and crank miss by")


def test_two_motors_on_one_body_must_agree():
    base = four_bar(4.0, 1.0, 3.5, 3.0, 0.7)
    for second, gap in ((0.7, None), (0.7 + 1e-9, 1e-9), (0.7 + math.tau, math.tau)):
        also = AngleDriver(name="second motor", body="crank", law=constant(second))
        value = solved(Mechanism(base.bodies, base.joints, (*base.drivers, also)))[1]

        assert value.gap == (None if gap is None else pytest.approx(gap, rel=1e-5, abs=0.0))


# ---- scale, place, laws


@pytest.mark.parametrize("exponent", [-30, -3, 30])
def test_a_linkage_and_its_copy_of_another_size_have_the_same_bits(exponent):
    f = 2.0**exponent
    one, other = solved(four_bar(4.0, 1.0, 3.5, 3.0, 0.7))[1], solved(four_bar(4.0 * f, f, 3.5 * f, 3.0 * f, 0.7))[1]

    assert all((a == b).all() for a, b in zip(one.poses, other.poses, strict=True))


def test_a_gap_far_from_the_origin_is_that_of_the_rounded_numbers():
    """1e8 m away the ground pins are rounded to 1.5e-8 m: their distance is still 4 m here, as both are integers."""
    d = float(diagonal(4.0, 1.0, 0.9))
    near = four_bar(4.0, 1.0, d - 3.0 - 1e-9, 3.0, 0.9)
    far = four_bar(4.0, 1.0, d - 3.0 - 1e-9, 3.0, 0.9, at=(1e8, -3e8))

    assert solved(far)[1].gap == solved(near)[1].gap > 0


@pytest.mark.parametrize("lengths", [(4.0, 1e-6, 3.5, 3.0), (4.0, 1e-3, 3.5, 3.0), (4e6, 1.0, 4e6, 3.0)])
def test_a_linkage_with_lengths_of_a_large_ratio_has_both_assemblies(lengths):
    system, result = solved(four_bar(*lengths, 0.7))

    assert result.complete
    assert len(result.poses) == 2
    assert residual(system, result) < ROUND_OFF


KNOTS = tuple(0.25 * k for k in range(9))
LAWS = {
    "polynomial": turned("crank", Polynomial(coefficients=(0.1, 1.5, -0.2))),
    "sinusoid": turned("crank", Sinusoid(amplitude=0.7, angular_frequency=3.0, offset=0.2, phase=0.1)),
    "table": turned("crank", Table(argument=KNOTS, value=tuple(math.sin(t) for t in KNOTS))),
    "rate": AngleDriver(name="m", body="crank", rate_law=Sinusoid(amplitude=1.0, angular_frequency=2.0), initial=0.3),
    "1e5 rad": turned("crank", Polynomial(coefficients=(1e5, 1.0))),
}


@pytest.mark.parametrize("driver", LAWS.values(), ids=LAWS)
def test_the_driven_angle_is_that_of_the_law_with_its_turns(driver):
    system, result = solved(four_bar(4.0, 1.0, 3.5, 3.0, driver), t=0.7)
    expected = float(driver.laws[0](0.7))

    assert [q[2] for q in result.poses] == pytest.approx([expected] * 2, rel=4e-16, abs=0.0)
    assert residual(system, result, 0.7) < ROUND_OFF


def test_a_point_that_two_lines_hold_is_located_once_though_that_leads_nowhere():
    """Its body may still turn: it belongs to no group, and there is no end to locating what is located.

    Lines of its own body are no loci of a point of it: it is those of the other body that lie on them.
    """
    zero = Vec(arb(0), arb(0))
    on = tuple(PointRow(RowKind.LINE, "ground", "b", zero, zero, name, key_j=(0.0, 0.0)) for name in "GH")
    own = tuple(PointRow(RowKind.LINE, "b", "ground", zero, zero, name, key_i=(0.0, 0.0)) for name in "GH")

    assert [step.locates for step in plan(AssemblyRows((), on, ()), ["b"]).steps] == [True]
    assert plan(AssemblyRows((), own, ()), ["b"]).steps == ()


@pytest.mark.parametrize("driven", [("arm", "sun"), ("planet", "arm"), ("sun", "planet")])
def test_of_two_wheels_and_their_carrier_two_angles_give_the_third(driven):
    """2 (sun - arm - 0.3) + (planet - arm - 0.5) = 0: Newton would mend a wrong one."""
    pins = ("ground", 0.0, "sun"), ("ground", 0.0, "arm"), ("arm", 3.0, "planet")
    joints = [Revolute(name=j, body_i=i, point_i=(x, 0.0), body_j=j, point_j=(0.0, 0.0)) for i, x, j in pins]
    wheels = {"body_i": "sun", "radius_i": 2.0, "phi0_i": 0.3, "body_j": "planet", "radius_j": 1.0, "phi0_j": 0.5}
    laws = [Polynomial(coefficients=(angle,)) for angle in (0.2, 1.2)]
    drivers = [AngleDriver(name=f"{name} 2", body=name, law=law) for name, law in zip(driven, laws, strict=True)]
    bodies = [Body(name=name) for name in ("sun", "arm", "planet")]
    mechanism = Mechanism(bodies, [*joints, Gear(name="teeth", **wheels, carrier="arm")], drivers)
    read = read_rows(compile_system(mechanism, unit=mechanism.unit()), 0.0).relative_angles
    (teeth,) = (row for row in read if row.name == "teeth")
    at = {**dict(zip(driven, (0.2, 1.2), strict=True)), teeth.j: float(teeth.angle)}

    assert teeth.i == "ground"
    assert abs(2.0 * (at["sun"] - at["arm"] - 0.3) + (at["planet"] - at["arm"] - 0.5)) < 1e-14
