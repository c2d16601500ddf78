"""The closed form case by case: branches, turns, what does not close, dead centres, laws, refusals."""

import cmath
import math
from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from crosscheck.engines import EngineError, EngineRefusal, Level, Support
from crosscheck.engines.closed_form.assemble import Assembly, LocusRow
from crosscheck.engines.closed_form.engine import ClosedForm
from crosscheck.engines.closed_form.jets import Floats, Jet, Planar
from crosscheck.engines.closed_form.linkage import CircleLocus, JetPose, LineLocus, _line_and_circle
from crosscheck.engines.closed_form.solution import PART, _gaps, _lost_after, _moves
from crosscheck.judge.comparison import compare, reference
from refkin.joints import GROUND, AngleDriver, PointOnLine, Revolute
from refkin.model import Body, Mechanism, Scene
from refkin.motion import Status
from refkin.motion_laws import Polynomial, Sinusoid, Table
from refkin.scenes.files import load
from refkin.scenes.linkages import FourBar, SliderCrank
from tests.claims import U
from tests.drawn import Drawing
from tests.linkages import KITE, PARALLELOGRAM, remade, with_law, without_estimates
from tests.mutation.change import mutated
from tests.places import CORPUS

from .closed_form_scenes import in_balls

LENGTHS = {"ground": 4.0, "crank": 1.0, "coupler": 3.5, "rocker": 3.0}
LAW = Polynomial(coefficients=(0.3, 1.0))


def linkage(lengths, law=LAW, times=(0.0,), sign=1, estimates=True, turns=0):
    """A four-bar with frames at the pins, estimated on the branch of the given sign."""
    g, a, b, c = (lengths[k] for k in ("ground", "crank", "coupler", "rocker"))
    theta = float(law(times[0], 0))
    tip = cmath.rect(a, theta)
    base = g - tip
    x = (abs(base) ** 2 + b * b - c * c) / (2 * abs(base))
    pin = tip + base / abs(base) * complex(x, sign * math.sqrt(abs(b * b - x * x)))
    angles = (theta, cmath.phase(pin - tip) + math.tau * turns, cmath.phase(pin - g))
    poses = zip((0j, tip, complex(g)), angles, strict=True)
    bodies = tuple(
        Body(name=n, estimate=(r.real, r.imag, phi) if estimates else None)
        for n, (r, phi) in zip(("crank", "coupler", "rocker"), poses, strict=True)
    )
    joints = (
        Revolute(name="A0", body_i=GROUND, point_i=(0.0, 0.0), body_j="crank", point_j=(0.0, 0.0)),
        Revolute(name="A", body_i="crank", point_i=(a, 0.0), body_j="coupler", point_j=(0.0, 0.0)),
        Revolute(name="B", body_i="coupler", point_i=(b, 0.0), body_j="rocker", point_j=(c, 0.0)),
        Revolute(name="B0", body_i=GROUND, point_i=(g, 0.0), body_j="rocker", point_j=(0.0, 0.0)),
    )
    drivers = (AngleDriver(name="motor", body="crank", law=law),)
    return Scene(mechanism=Mechanism(bodies, joints, drivers), times=times)


def planar(z):
    return Planar(Jet(z.real), Jet(z.imag))


def orientation(motion):
    """The sign of coupler x rocker at the pin B, per time."""
    return np.sign(np.sin(motion["rocker"].phi - motion["coupler"].phi))


@pytest.mark.parametrize("sign", [1, -1])
def test_the_estimate_chooses_the_branch_and_the_motion_keeps_it(sign):
    motion = ClosedForm().solve(linkage(LENGTHS, times=tuple(np.linspace(0.0, 7.0, 40)), sign=sign))

    assert motion.verdict is Status.OK
    assert set(orientation(motion)) == {sign}


@pytest.mark.parametrize("away", [0.0, 64.0])
@pytest.mark.parametrize(
    ("lifted", "scale", "sign"), [(0.0, 1.0, 1), (0.15, 1.0, 1), (0.15, 2.0**10, 1), (0.7, 1.0, -1)]
)
def test_a_flat_estimate_goes_to_the_nearer_assembly(lifted, scale, sign, away):
    """Coupler and rocker in one line in the estimate, which lies on the upper side; but not of a tip that is lifted.

    If it is lifted so far that they are in no line any more, their own orientation decides.
    """
    lengths = {name: scale * length for name, length in LENGTHS.items()}
    scene = linkage(lengths, sign=1)
    bodies = list(scene.mechanism.bodies)
    bodies[0] = replace(bodies[0], estimate=(0.0, 0.0, 0.3 + lifted))
    tip, ground = cmath.rect(scale, 0.3), 4.0 * scale
    pin = 0.5 * (tip + ground) + 0.05j * scale  # sine of the angle at the pin: 0.07, not decisive
    lean = cmath.phase(pin - tip)
    end = pin - cmath.rect(lengths["coupler"], lean)  # so that the estimate sees the pin B there
    bodies[1] = replace(bodies[1], estimate=(end.real, end.imag, lean))
    bodies = [replace(b, estimate=(b.estimate[0] + away * scale, *b.estimate[1:])) for b in bodies]
    joints = [
        replace(j, point_i=(j.point_i[0] + away * scale, j.point_i[1])) if j.body_i == GROUND else j
        for j in scene.mechanism.joints
    ]
    flat = remade(scene, bodies=tuple(bodies), joints=tuple(joints))

    assert orientation(ClosedForm().solve(flat)) == sign


def nearer(angle, seen, chord=0.5 - 0.25j, locus=None):
    """Which assembly is nearer an estimate that sees a point there, from the centre of the circle it is on."""
    meeting = SimpleNamespace(foot=planar(1.0 + 2.0j), chord=chord and planar(chord))
    row = LocusRow(locus or CircleLocus(planar(-0.5 + 0.25j), Jet(1.0)), seen, "rod")
    return Assembly._nearer(SimpleNamespace(_angle_estimate=lambda group: angle), None, meeting, (None, row))


def test_the_nearer_assembly_is_the_one_on_whose_side_the_estimate_is_however_its_group_is_turned():
    chord, middle = 0.5 - 0.25j, 1.5 + 1.75j
    for angle, part in product((0.0, 0.7, -2.0), (0.6, -0.6)):
        seen = (middle + (part + 0.5j) * chord) * cmath.rect(1.0, angle)
        assert nearer(angle, seen) == math.copysign(1.0, part)
        line = LineLocus(planar(1.0 + 0.0j), Jet(0.0))
        nothing = nearer(None, seen), nearer(angle, None), nearer(angle, seen, None), nearer(angle, seen, locus=line)
        assert (*nothing, nearer(angle, seen * math.nan)) == (0.0,) * 5
    assert nearer(0.0, middle + 0.5j * chord) == 0.0


def test_a_group_is_turned_as_the_estimate_of_any_of_its_bodies_says():
    """One without an estimate is passed over, unless it is on the ground's group already."""

    def pose(angle):
        return JetPose(Jet(angle), planar(1.0 + 0.0j), planar(0.0j))

    of_ground = SimpleNamespace(bodies={GROUND: pose(0.0), "b": pose(0.25)})
    other, bare = (
        SimpleNamespace(bodies={name: pose(phi) for name, phi in x}) for x in ([("a", 0.5), ("c", 0.7)], [("a", 0.5)])
    )
    state = SimpleNamespace(groups=[of_ground, other], estimates={"c": (0.0, 0.0, 1.0)})
    state._body_angle = lambda body: Assembly._body_angle(state, body)

    assert [Assembly._angle_estimate(state, x) for x in (of_ground, other, bare)] == [0.0, pytest.approx(0.3), None]
    assert [state._body_angle(body) for body in "abc"] == [None, 0.25, 1.0]


@pytest.mark.parametrize("made", ["four-bar", "slider-crank"])
def test_without_estimates_the_positive_orientation_is_taken_and_said(made):
    scene = linkage(LENGTHS, estimates=False)
    if made == "slider-crank":  # of which the line is known, and the circle is not
        scene = SliderCrank(crank=1.0, rod=3.0).scene(speed=1.0, turns=1, samples=3, branch="open")
    scene = without_estimates(scene)
    motion = ClosedForm().solve(scene)

    assert motion.verdict is Status.OK
    assert "no estimate" in motion.message


@pytest.mark.parametrize("turns", [-3, 0, 7])
def test_angles_keep_the_turns_of_the_estimate(turns):
    scene = linkage(LENGTHS, times=tuple(np.linspace(0.0, 20.0, 100)), turns=turns)
    plain = linkage(LENGTHS, times=scene.times)
    moved = ClosedForm().solve(scene)["coupler"].phi - ClosedForm().solve(plain)["coupler"].phi

    assert np.abs(moved - math.tau * turns).max() < 1e-13


def test_a_follower_that_turns_is_counted_between_far_times():
    """A drag link: crank, coupler and rocker all turn, 50 rad between two times that are asked for."""
    drag = {"ground": 1.0, "crank": 3.0, "coupler": 2.5, "rocker": 3.2}
    law = Polynomial(coefficients=(0.3, 100.0))
    motion = ClosedForm().solve(linkage(drag, law, times=(0.0, 0.5, 1.0, 1.5)))
    turned = motion["rocker"].phi - motion["crank"].phi

    assert motion.verdict is Status.OK
    assert np.abs(turned - turned[0]).max() < math.pi, motion.message


def test_turns_that_cannot_be_counted_are_no_answer():
    """1e9 rad between two times: no grid of the closed form follows that."""
    drag = {"ground": 1.0, "crank": 3.0, "coupler": 2.5, "rocker": 3.2}
    law = Polynomial(coefficients=(0.3, 1e9))
    motion = ClosedForm().solve(linkage(drag, law, times=(0.0, 1.0)))

    assert motion.status == (Status.OK, Status.NOT_CONVERGED)
    assert np.isnan(motion.q[:, 1]).all()


@pytest.mark.parametrize(("coupler", "gap"), [(1.5, "(a + b) - D"), (8.5, "D - |a - b|")])
def test_what_cannot_close_is_unassemblable_with_its_gap(coupler, gap):
    """Crank at pi: D = 5. Rocker 3 and coupler 1.5 reach 4.5; coupler 8.5 and rocker 3 stay 5.5 apart."""
    law = Polynomial(coefficients=(math.pi, 1.0))
    motion = ClosedForm().solve(linkage({**LENGTHS, "coupler": coupler}, law))

    assert motion.verdict is Status.UNASSEMBLABLE
    assert f"{gap} = -0.5 m" in motion.message
    assert np.isnan(motion.q).all()


def test_floats_alone_prove_no_unassemblable(monkeypatch):
    """Every slack called negative stands for a dyad that has lost its digits."""
    monkeypatch.setattr(Floats, "sign", lambda self, slack, scale: (np.asarray(slack > 0), np.asarray(slack < 0)))
    motion = ClosedForm().solve(linkage(LENGTHS))

    assert motion.verdict is Status.NOT_CONVERGED
    assert "not proved" in motion.message


def test_a_joint_that_is_left_open_is_a_fault_of_the_program():
    closed = "crosscheck.engines.closed_form.engine:_residual"
    with (
        mutated(closed, "np.abs(solution.closure)", "np.abs(solution.closure + 1e-3)"),
        pytest.raises(EngineError, match=r"a joint is left open by 0\.001 sizes"),
    ):
        ClosedForm().solve(linkage(LENGTHS))


def test_what_each_joint_and_row_leaves_open_is_told_in_sizes_and_radians():
    """Of two bodies where nothing closes: a pin, an angle, a line and a distance between them."""
    at = {"a": (1.0 + 2.0j, 0.4), "b": (-0.5 + 0.3j, 1.1)}
    local = {"a": {0: 0.2 + 0.1j, 1: 0.7 + 0.0j}, "b": {0: 0.5 - 0.4j, 2: 0.3j}}
    place = {(name, k): r + u * cmath.rect(1.0, phi) for name, (r, phi) in at.items() for k, u in local[name].items()}
    line = {"body_i": "a", "node": 2, "anchor": planar(0.1 + 0.2j), "normal": planar(cmath.rect(1.0, 0.9))}
    drawn = SimpleNamespace(
        groups=[SimpleNamespace(bodies=[n], nodes={k: planar(u) for k, u in own.items()}) for n, own in local.items()],
        places=range(3),
        angles=[SimpleNamespace(body_i="a", body_j="b", value=Jet(0.3))],
        lines=[SimpleNamespace(value=Jet(0.25), **line)],
        distances=[SimpleNamespace(node_a=1, node_b=2, value=Jet(1.5))],
    )
    poses = {name: JetPose(Jet(phi), planar(cmath.rect(1.0, phi)), planar(r)) for name, (r, phi) in at.items()}
    scene = SimpleNamespace(mechanism=SimpleNamespace(size=lambda: 8.0))
    pin, away = place["b", 0] - place["a", 0], place["b", 2] - (1.0 + 2.0j) - (0.1 + 0.2j) * cmath.rect(1.0, 0.4)
    off = (away * cmath.rect(1.0, -0.4 - 0.9)).real - 0.25
    apart = abs(place["b", 2] - place["a", 1]) - 1.5

    gaps = _gaps(drawn, SimpleNamespace(bodies=poses), scene)
    assert gaps == pytest.approx([pin.real / 8.0, pin.imag / 8.0, 1.1 - 0.4 - 0.3, off / 8.0, apart / 8.0], rel=1e-14)


def test_frames_far_from_their_joints_are_answered():
    """Points 1e12 away from the bodies' origins leave four digits, and no error."""
    d = Drawing({"1": (1e12 + 0j, 0.3)})
    d.pin("ground", "1", 0.5j)
    d.drive_angle("1")

    assert ClosedForm().solve(d.scene(times=(0.0,))).verdict is Status.OK


def test_a_motion_that_leaves_its_range_is_answered_up_to_there():
    """Beyond a gap no motion leads to either assembly: the branch is lost."""
    short = {**LENGTHS, "coupler": 1.5}
    times = tuple(np.linspace(0.0, math.tau, 41))
    motion = ClosedForm().solve(linkage(short, times=times))
    distance = abs(4.0 - np.exp(1j * (0.3 + motion.t)))
    closes = (distance < 4.5) & (distance > 1.5)

    before = np.logical_and.accumulate(closes)
    expected = np.where(before, Status.OK, np.where(closes, Status.BRANCH_LOST, Status.UNASSEMBLABLE))
    assert list(motion.status) == expected.tolist()
    assert 0 < before.sum() < closes.sum() < 41
    assert np.array_equal(np.isfinite(motion.q), np.tile(before, (len(motion.q), 1)))


PASSING = {"parallelogram": PARALLELOGRAM, "kite": KITE, "isosceles slider-crank": SliderCrank(crank=1.0, rod=1.0)}


@pytest.mark.parametrize("name", PASSING)
@pytest.mark.parametrize("samples", [4, 9, 50])
def test_past_a_pose_where_two_assemblies_meet_between_two_times_the_branch_is_lost(name, samples):
    """The crank passes it at pi, and at pi/2 where rod and crank are as long as each other."""
    times = tuple(np.linspace(0.4, 5.0, samples))
    scene = PASSING[name].scene(law=Polynomial(coefficients=(0.0, 1.0)), times=times, branch="open")
    end = math.pi / 2 if "slider" in name else math.pi
    motion = ClosedForm().solve(scene)

    assert list(motion.status) == [Status.OK if t < end else Status.BRANCH_LOST for t in times]


@pytest.mark.parametrize("slack", [1e-2, 1e-5, 1e-8, 1e-11])
def test_a_near_change_point_that_is_passed_between_two_times_loses_no_branch(slack):
    linkage = FourBar(ground=4.0, crank=1.0, coupler=3.5, rocker=1.5 + slack)
    scene = linkage.scene(speed=1.0, turns=2, samples=13, branch="open")

    assert ClosedForm().solve(scene).verdict is Status.OK


@pytest.mark.parametrize(
    ("beyond", "verdict"), [(-1e-9, Status.OK), (1e-9, Status.BRANCH_LOST), (0.05, Status.BRANCH_LOST)]
)
def test_a_limit_passed_and_come_back_from_between_two_times_is_seen(beyond, verdict):
    linkage = FourBar(ground=4.0, crank=2.0, coupler=2.5, rocker=2.0)
    (_, end), *_ = linkage.input_range()
    law = Sinusoid(amplitude=end * (1.0 + beyond), angular_frequency=1.0)
    start = linkage.scene(law=Polynomial(coefficients=(0.0, 1.0)), times=(0.0, 1e-3), branch="open")
    scene = replace(with_law(start, law), times=(0.0, 1.0, 2.0, 3.0))

    assert ClosedForm().solve(scene).verdict is verdict


@pytest.mark.parametrize("scale", [1.0, 2.0**-10])
def test_what_swings_between_two_times_is_counted_by_its_way(scale):
    """A law that is back where it was has gone four amplitudes; an angle that is found goes 0.3 rad."""
    law = Sinusoid(amplitude=0.2, angular_frequency=4.0 * math.pi, phase=0.5 * math.pi)
    scene = linkage(
        {name: scale * length for name, length in LENGTHS.items()}, law, times=(0.5, 1.0, 1.0625, 1.125, 1.25)
    )
    unit = min(scene.mechanism.size(), 1.0)
    angles = [np.array([0.0, 0.0, 0.0, 0.0, -0.3 / unit])]
    moves = _moves(SimpleNamespace(scene=scene, assembly=SimpleNamespace(known_angles=angles)))

    assert moves * unit == pytest.approx(
        [0.8, *0.2 * -np.diff(np.cos([0.0, 0.25 * math.pi, 0.5 * math.pi])), 0.3], rel=0.08
    )


def slack_of(law, asked, scale=1.0):
    """What solves a scene with one slack that follows a law beside one that stays, and keeps which times were asked."""

    def solve(times):
        asked.append(times)
        t = np.array(times)
        moved = [SimpleNamespace(value=x(t) * scale, rate=x.deriv()(t) * scale, scale=scale) for x in (law, law**0)]
        return SimpleNamespace(meetings=[SimpleNamespace(slacks=moved)], scene=SimpleNamespace(times=times))

    return solve


def test_an_interval_is_looked_at_in_as_many_parts_as_things_move_in_it():
    """In two at least, in sixteen at most, and where it is not known how far."""
    asked, moves = [], PART * np.array([0.0, 5.5, math.nan, 99.0])
    solve = slack_of(np.polynomial.Polynomial([1.0, 1.0]), asked)
    parts = (0.0, 0.5, *np.linspace(1.0, 3.0, 6, endpoint=False), *np.arange(48, 64) / 16, *np.arange(16, 33) / 4)

    assert _lost_after((0.0, 1.0, 3.0, 4.0, 8.0), solve, moves) == _lost_after((0.0, 1.0), solve, moves[:1]) == math.inf
    assert asked == [parts, (0.0, 0.5, 1.0)]


@pytest.mark.parametrize("size", [1.0, 2.0**-5, 2.0**5])
@pytest.mark.parametrize(("lowest", "met"), [(1e-9, False), (-1e-9, True), (-0.3, True)])
def test_a_slack_that_is_least_between_two_times_is_followed_down_to_where_it_is_none(lowest, met, size):
    """Every solve begins at the first time: there the estimates tell the assembly."""
    asked, law = [], size * np.polynomial.Polynomial([3.6**2 + lowest, -7.2, 1.0])
    lost = _lost_after((0.0, 2.0, 4.0), slack_of(law, asked, 1.0 / size**2), np.zeros(2))

    assert lost == pytest.approx(3.6, abs=1.1 * math.sqrt(abs(lowest))) if met else lost == math.inf
    assert not met or law(lost) <= 0.0
    assert {times[0] for times in asked} == {0.0}
    assert _lost_after((0.0, 2.0, 4.0), slack_of(law.deriv() * -1.0, asked), np.zeros(2)) == 4.0  # and stays so


def test_what_does_not_feel_a_short_chord_keeps_its_digits():
    """A chord's rates err by 1 / chord^3; along the span of the two circles nothing of that is to be left."""
    scene = load(CORPUS / "closed-form-beside-a-change-point.toml")
    motion, exact = ClosedForm().solve(scene), in_balls(scene).motion

    assert np.abs(motion["crank"].qdd[0] - exact["crank"].qdd[0]).max() < 16 * U  # of accelerations of about 1
    assert compare(reference(scene), motion, ClosedForm().terms(scene)).agrees


def test_scenes_scale_with_powers_of_two_bit_by_bit():
    scene = linkage(LENGTHS, times=tuple(np.linspace(0.0, 6.0, 20)))
    small = linkage({k: math.ldexp(v, -30) for k, v in LENGTHS.items()}, times=scene.times)
    scale = np.tile([2.0**-30, 2.0**-30, 1.0], 3)[:, None]

    for large, little in zip(ClosedForm().solve(scene).levels, ClosedForm().solve(small).levels, strict=True):
        assert np.array_equal(little, large * scale)


LAWS = [
    Polynomial(coefficients=(0.2, 0.5, -0.1, 0.03)),
    Sinusoid(amplitude=0.4, angular_frequency=1.3, offset=0.1, phase=0.2),
    Table(argument=(0.0, 0.7, 1.1, 2.0, 3.0), value=(0.1, 0.3, 0.2, 0.5, 0.4)),
    Table(argument=(0.0, 1.0, 3.0), value=(0.1, 0.3, 0.2)),
    Table(argument=(0.0, 3.0), value=(0.1, 0.3)),
    Table(argument=(0.0, 0.4, 1.0, 1.7), value=(0.1, 0.3, 0.2, 0.1), periodic=True),
]


@pytest.mark.parametrize("rate", [False, True])
@pytest.mark.parametrize("law", LAWS, ids=lambda law: f"{law.kind}-{len(getattr(law, 'argument', ()))}")
def test_exact_laws_agree_with_float_laws(law, rate):
    """Coefficients of five knots are some tens of operations on values and slopes of order 1: 1e-14 holds them."""
    scene = linkage(LENGTHS, times=tuple(np.linspace(0.0, 3.0, 13)))
    driver = {"rate_law": law, "initial": 0.3} if rate else {"law": law}
    motor = AngleDriver(name="motor", body="crank", **driver)
    driven = remade(scene, drivers=(motor,))
    crank = in_balls(driven).motion["crank"]
    expected = [motor.laws[0](np.array(scene.times), order) for order in range(3)]

    for got, want in zip((crank.phi, crank.phid, crank.phidd), expected, strict=True):
        assert np.abs(got - want).max() < 1e-14


def triad():
    """Three bodies on three pins of a coupler that is not held: class III."""
    d = Drawing({"1": (0j, 0.0), "2": (1 + 0j, 1.0), "3": (0j, 2.0), "4": (1j, 0.5)})
    for k, (root, tip) in enumerate(((0j, 1 + 0.2j), (3 + 0j, 2 + 0.3j), (1 + 3j, 1.5 + 1j))):
        d.pin("ground", str(k + 1), root)
        d.pin(str(k + 1), "4", tip)
    return d.scene(times=(0.0,))


def test_a_group_of_class_three_is_refused_by_name():
    with pytest.raises(EngineRefusal, match=r"no dyad places '1', '2', '3', '4'"):
        ClosedForm().solve(triad())


def test_redundant_constraints_are_refused_by_name():
    scene = linkage(LENGTHS)
    twice = AngleDriver(name="again", body="rocker", law=LAW)
    m = scene.mechanism

    with pytest.raises(EngineRefusal, match="1 redundant constraint"):
        ClosedForm().solve(remade(scene, drivers=(*m.drivers, twice)))


def test_an_angle_given_twice_is_refused_by_name():
    """As many rows as coordinates, but one angle has two and a distance none."""
    scene = linkage(LENGTHS)
    m = scene.mechanism
    twice = AngleDriver(name="again", body="crank", law=LAW)
    loose = (*m.joints[:3], PointOnLine(name="B0", body_i=GROUND, point_i=(4.0, 0.0), axis_i=(1.0, 0.0),
                                       body_j="rocker", point_j=(0.0, 0.0)))  # fmt: skip

    with pytest.raises(EngineRefusal, match="'again' gives an angle that is already given"):
        ClosedForm().solve(replace(scene, mechanism=Mechanism(m.bodies, loose, (*m.drivers, twice))))


def test_there_are_no_constraint_rows():
    engine = ClosedForm()
    with pytest.raises(EngineRefusal, match="no constraint rows"):
        engine.constraints(linkage(LENGTHS))

    levels = {(lv, c.support) for joint in engine.capabilities().values() for lv, c in joint.items()}
    assert {lv for lv, support in levels if support is not Support.REFUSED} == {Level.SOLVE}


@pytest.mark.parametrize("far", [0.0, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_line_touches_a_circle_as_far_as_their_places_are_rounded_and_not_farther(far, side):
    """x = k against a circle of radius 1/2 about (c, 0), both far away, k on either side of c."""
    arithmetic, scale = Floats(), 0.5 + 2.0 * far + 0.5

    def constant(value):
        return Jet(np.array([value]), np.array([0.0]), np.array([0.0]))

    for off, touches in ((0.0, True), (0.5 * arithmetic.zero * scale, True), (4.0 * arithmetic.zero * scale, False)):
        line = LineLocus(Planar(constant(1.0), constant(0.0)), constant(far + side * (0.5 - off)))
        with np.errstate(invalid="ignore"):  # there is no rate where they touch
            meeting = _line_and_circle(
                line, CircleLocus(Planar(constant(far), constant(0.0)), constant(0.25)), arithmetic
            )

        assert (meeting.singular.item(), meeting.absent.item()) == (touches, False), off
