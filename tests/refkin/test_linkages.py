"""Linkages: what their closed forms say holds for the loop written in complex numbers here, which shares no code."""

from __future__ import annotations

import cmath
import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import refkin
from crosscheck.strategies import four_bars, inverted_slider_cranks, slider_cranks
from refkin.analysis import position
from refkin.scenes.linkages import (
    Branch,
    DoesNotAssemble,
    FourBar,
    GrashofClass,
    InvertedSliderCrank,
    ScrewJack,
    SliderCrank,
)
from refkin.scenes.linkages.base import rough
from refkin.system import compile_system
from tests.linkages import LIMITED, ROCKER

U = 2.0**-53
ROUND_OFF = 128 * U
"""Of the reach: a loop has at most four links, each turned by an angle of up to 16 rad that is right to its last bit
(16 u), from two functions right to 2 u and a corner right to 8 u: 4 * (16 + 2 + 8) u < 128 u."""

LINKAGES = st.one_of(four_bars(), slider_cranks(), inverted_slider_cranks())


@st.composite
def at_inputs(draw, linkages, branches=Branch):
    """Draw (linkage, input pair, value, branch) with the value in the input's range, often at its very ends."""
    linkage = draw(linkages)
    pair = draw(st.sampled_from(linkage.INPUTS))
    low, high = draw(st.sampled_from(linkage.input_range(*pair)))
    low, high = (low, high) if math.isfinite(low) else (-7.0, 7.0)
    part = draw(st.floats(0.0, 1.0) | st.floats(3.0, 14.0).map(lambda k: 10.0**-k))
    value = low + part * (high - low) if draw(st.booleans()) else high - part * (high - low)
    return linkage, pair, min(max(value, low), high), draw(st.sampled_from(branches))


def arm(length: float, phi: float) -> complex:
    return cmath.rect(length, phi)


def loop_gap(linkage, pose) -> complex:
    """Return what the loop of a linkage misses to be closed, from lengths and angles alone."""
    phi = {body: q[2] - linkage.angle for body, q in pose.items()}
    if isinstance(linkage, FourBar):
        far_side = linkage.ground + arm(linkage.rocker, phi["rocker"])
        return arm(linkage.crank, phi["crank"]) + arm(linkage.coupler, phi["coupler"]) - far_side
    if isinstance(linkage, SliderCrank):
        wrist = arm(linkage.crank, phi["crank"]) + arm(linkage.rod, phi["connecting_rod"])
        return complex(0.0, wrist.imag - linkage.offset)
    pin = arm(linkage.crank, phi["crank"]) - linkage.ground
    on_lever = pin * arm(1.0, -phi["lever"])
    return complex(0.0, on_lever.imag - linkage.offset)


def centres(linkage, pose) -> dict[str, complex]:
    """Return where the middles (slider: wrist pin; lever: pivot) must be, in the ground frame, given the angles."""
    at = {"crank": arm(linkage.crank / 2, pose["crank"][2])}
    if isinstance(linkage, FourBar):
        at["coupler"] = 2 * at["crank"] + arm(linkage.coupler / 2, pose["coupler"][2])
        at["rocker"] = arm(linkage.ground, linkage.angle) + arm(linkage.rocker / 2, pose["rocker"][2])
    elif isinstance(linkage, SliderCrank):
        rod = arm(linkage.rod / 2, pose["connecting_rod"][2])
        at |= {"connecting_rod": 2 * at["crank"] + rod, "slider": 2 * (at["crank"] + rod)}
    else:
        at["lever"] = arm(linkage.ground, linkage.angle)
    return {body: z + complex(*linkage.origin) for body, z in at.items()}


@given(at_inputs(LINKAGES))
def test_the_loop_closes_bodies_are_where_their_angles_put_them_and_the_input_has_its_value(case):
    linkage, (driven, relative_to), value, branch = case

    pose = linkage.assemble(value, branch, driven=driven, relative_to=relative_to)

    assert abs(loop_gap(linkage, pose)) <= ROUND_OFF * linkage.reach
    scale = linkage.reach + abs(complex(*linkage.origin))
    for body, expected in centres(linkage, pose).items():
        assert abs(expected - complex(*pose[body][:2])) <= ROUND_OFF * scale
    if driven == "slider":
        foot = complex(*pose["slider"][:2]) - complex(*linkage.origin)
        measured = (foot * arm(1.0, -linkage.angle)).real
        assert abs(value - measured) <= ROUND_OFF * scale
    else:
        measured = pose[driven][2] - (pose[relative_to][2] if relative_to != "ground" else 0.0)
        assert abs(value - measured) <= 32 * U  # sums of angles below 16 rad


def can_turn(base: float, link: float, a: float, b: float) -> bool:
    """Return whether `link` turns fully against `base` while links a and b still reach, tried at 720 angles."""
    gaps = [abs(base - arm(link, k * math.pi / 360)) for k in range(720)]
    return all(abs(a - b) <= gap <= a + b for gap in gaps)


@given(four_bars(classes=[c for c in GrashofClass if c is not GrashofClass.CHANGE_POINT]))
def test_grashof_class_is_what_turning_the_links_by_hand_finds(linkage):
    g, c, k, r = linkage.ground, linkage.crank, linkage.coupler, linkage.rocker
    turns = (can_turn(g, c, k, r), can_turn(g, r, k, c), can_turn(g, k, c, r))
    expected = {
        (True, False, False): GrashofClass.CRANK_ROCKER,
        (True, True, True): GrashofClass.DOUBLE_CRANK,
        (False, True, False): GrashofClass.ROCKER_CRANK,
        (False, False, True): GrashofClass.DOUBLE_ROCKER,
        (False, False, False): GrashofClass.TRIPLE_ROCKER,
    }

    assert expected[turns] is linkage.grashof


@pytest.mark.parametrize("order", tuple(itertools.permutations(range(4))))
def test_change_point_is_met_exactly_and_left_by_one_bit(order):
    """With 1 + 4 = 2 + 3 the slack is 0; with one bit more or less on the longest link it has that bit's sign."""
    for longest, sign in ((4.0, 0), (math.nextafter(4.0, 5.0), -1), (math.nextafter(4.0, 0.0), 1)):
        lengths = (1.0, 2.0, 3.0, longest)
        linkage = FourBar(*(lengths[k] for k in order))

        assert sign * abs(4.0 - longest) == linkage.slack
        assert (linkage.grashof is GrashofClass.CHANGE_POINT) == (sign == 0)
        assert (linkage.grashof is GrashofClass.TRIPLE_ROCKER) == (sign < 0)


@given(LINKAGES)
def test_input_range_ends_where_the_two_assemblies_become_one(linkage):
    for pair in linkage.INPUTS:
        for end in {end for interval in linkage.input_range(*pair) for end in interval if math.isfinite(end)}:
            poses = [linkage.assemble(end, b, driven=pair[0], relative_to=pair[1]) for b in Branch]

            # Round-off in the end opens the flat triangle by its root.
            for body in poses[0]:
                apart = math.remainder(poses[0][body][2] - poses[1][body][2], math.tau)
                assert abs(apart) <= 32 * math.sqrt(ROUND_OFF)


@given(LINKAGES)
def test_beyond_the_ends_of_the_input_range_nothing_assembles(linkage):
    for driven, relative_to in linkage.INPUTS:
        step = 1e-6 * (linkage.reach if driven == "slider" else 1.0)
        for low, high in linkage.input_range(driven, relative_to):
            for outside in (low - step, high + step):
                if math.isfinite(outside) and not _elsewhere(linkage, driven, relative_to, outside):
                    with pytest.raises(DoesNotAssemble):
                        linkage.assemble(outside, driven=driven, relative_to=relative_to)


def _elsewhere(linkage, driven, relative_to, value) -> bool:
    """Return whether the neighbouring interval of the range already holds the value."""
    period = math.inf if driven == "slider" else math.tau
    copies = (value,) if math.isinf(period) else tuple(value + k * period for k in range(-2, 3))
    return any(low <= v <= high for low, high in linkage.input_range(driven, relative_to) for v in copies)


@given(four_bars(), st.floats(-7.0, 7.0))
def test_four_bar_assembles_exactly_where_two_circles_meet(linkage, value):
    for driven, relative_to in linkage.INPUTS:
        margin = linkage.closure_margin(value, driven, relative_to)
        inside = _elsewhere(linkage, driven, relative_to, math.remainder(value, math.tau))
        assert inside == (margin >= 0) or abs(margin) <= 1e-12 * linkage.reach  # the end itself, known to round-off


@given(at_inputs(four_bars(), branches=Branch))
def test_determinant_of_the_four_bar_loop_is_coupler_rocker_sine_of_the_transmission_angle(case):
    linkage, pair, value, branch = case
    pose = linkage.assemble(value, branch, driven=pair[0], relative_to=pair[1])
    by_coupler, by_rocker = 1j * arm(linkage.coupler, pose["coupler"][2]), -1j * arm(linkage.rocker, pose["rocker"][2])

    determinant = (by_coupler.conjugate() * by_rocker).imag

    mu = linkage.transmission_angle(pose["crank"][2])
    expected = linkage.coupler * linkage.rocker * math.sin(mu)
    # Squares, because near a flat pose the angle itself is known to the root of round-off only.
    assert abs(expected**2 - determinant**2) <= ROUND_OFF * linkage.reach**4


@given(at_inputs(slider_cranks()))
def test_determinant_of_the_slider_crank_loop_is_rod_sine_of_the_transmission_angle(case):
    linkage, pair, value, branch = case
    pose = linkage.assemble(value, branch, driven=pair[0], relative_to=pair[1])
    by_rod = 1j * arm(linkage.rod, pose["connecting_rod"][2] - linkage.angle)  # the other column is -1

    expected = linkage.rod * math.sin(linkage.transmission_angle(pose["crank"][2]))

    assert abs(expected**2 - by_rod.imag**2) <= ROUND_OFF * linkage.reach**2


@given(at_inputs(inverted_slider_cranks()))
def test_determinant_of_the_inverted_loop_is_line_sine_of_the_transmission_angle(case):
    linkage, pair, value, branch = case
    pose = linkage.assemble(value, branch, driven=pair[0], relative_to=pair[1])
    pin = arm(linkage.crank, pose["crank"][2]) - arm(linkage.ground, linkage.angle)
    slide = (pin * arm(1.0, -pose["lever"][2])).real  # |by lever x by slide|

    expected = abs(pin) * math.sin(linkage.transmission_angle(pose["crank"][2]))

    assert abs(expected**2 - slide**2) <= ROUND_OFF * linkage.reach**2


@pytest.mark.parametrize("value", [5e-324, -1e-310])
def test_inputs_that_are_almost_nothing_assemble(value):
    """`cmath.phase` takes the underflow of an angle for an error; `atan2` does not."""
    kinds = (
        ROCKER,
        SliderCrank(crank=1.0, rod=3.0, offset=1e-320),
        InvertedSliderCrank(ground=3.0, crank=1.0, offset=1e-320),
    )
    for linkage in kinds:
        assert linkage.assemble(value)["crank"][2] == pytest.approx(value, abs=1e-300)
        assert linkage.scene(start=value, samples=3).times


def test_gap_of_an_unassemblable_linkage_is_stated():
    """Coupler 2 and rocker 3 cannot span the 9 m from the crank pin to the rocker pivot."""
    with pytest.raises(DoesNotAssemble) as caught:
        FourBar(10.0, 1.0, 2.0, 3.0).assemble(0.0)

    assert caught.value.gap == 4.0


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf, "4", None])
@pytest.mark.parametrize(
    ("kind", "good"),
    [
        (FourBar, {"ground": 4, "crank": 1, "coupler": 3, "rocker": 3}),
        (SliderCrank, {"crank": 1, "rod": 3}),
        (InvertedSliderCrank, {"ground": 3, "crank": 1}),
        (ScrewJack, {"pitch": 1, "height": 3}),
    ],
)
def test_every_length_that_is_none_is_named_with_its_value(kind, good, bad):
    for key in good:
        with pytest.raises(refkin.InvalidScene) as caught:
            kind(**{**good, key: bad})

        assert [(key, repr(bad))] == [(fault.path, repr(fault.value)) for fault in caught.value.faults]


def test_all_faults_of_a_linkage_come_at_once():
    with pytest.raises(refkin.InvalidScene) as caught:
        SliderCrank(-1.0, 0.0, math.nan, origin=(0.0,), angle=math.inf)

    assert [fault.path for fault in caught.value.faults] == ["crank", "rod", "offset", "angle", "origin"]


@pytest.mark.parametrize(
    ("arguments", "path"),
    [
        ({"speed": 0.0}, "speed"),
        ({"speed": math.nan}, "speed"),
        ({"turns": 0}, "turns"),
        ({"samples": 1}, "samples"),
        ({"samples": 3.5}, "samples"),
        ({"start": math.inf}, "start"),
        ({"start": 10**400}, "start"),
        ({"branch": "up"}, "branch"),
        ({"driven": "slider"}, "driven"),
        ({"effects": ["speed"]}, "effects"),
        ({"evidence": ["trust"]}, "evidence"),
        ({"law": refkin.Polynomial(coefficients=(1.0,))}, "times"),
        ({"law": refkin.Polynomial(coefficients=()), "times": [0.0]}, "law.coefficients"),
        ({"law": refkin.Polynomial(coefficients=1.0), "times": [0.0]}, "law.coefficients"),
        ({"law": refkin.Polynomial(coefficients=np.array([0.0, math.nan])), "times": [0.0]}, "law.coefficients[1]"),
        ({"law": refkin.Integral(rate=2.0), "times": [0.0]}, "law.rate"),
        ({"law": refkin.Sinusoid(amplitude="1", angular_frequency=1.0), "times": [0.0]}, "law.amplitude"),
        ({"law": refkin.Polynomial(coefficients=(1.0,)), "times": [1.0, 0.0]}, "times"),
        ({"times": [0.0, "1"]}, "times"),
        ({"times": [True, 2.0]}, "times"),
        ({"times": [0.0, math.inf]}, "times"),
        ({"times": 3.0}, "times"),
        ({"times": [0.0, 1.0], "turns": 2}, "turns"),
        ({"times": [0.0, 1.0], "samples": 5}, "samples"),
        ({"law": refkin.Polynomial(coefficients=(1.0,)), "times": [0.0], "speed": 9.0}, "speed"),
        ({"law": refkin.Polynomial(coefficients=(1.0,)), "times": [0.0], "start": 9.0}, "start"),
        ({"effects": "velocity"}, "effects"),
        ({"evidence": 3}, "evidence"),
    ],
)
def test_scene_names_the_argument_that_makes_no_sense(arguments, path):
    with pytest.raises(refkin.InvalidScene) as caught:
        ROCKER.scene(**arguments)

    assert [path] == [fault.path for fault in caught.value.faults]


@pytest.mark.parametrize("linkage", [ROCKER, ScrewJack(0.1)])
def test_a_law_of_a_linkage_may_hold_rows_of_numpy(linkage):
    rows, numbers = (refkin.Polynomial(coefficients=c) for c in (np.array([0.25, 1.0]), (0.25, 1.0)))

    assert linkage.scene(law=rows, times=[0.0, 1.0]) == linkage.scene(law=numbers, times=[0.0, 1.0])


@pytest.mark.parametrize("linkage", [ROCKER, ScrewJack(0.1)])
def test_words_of_a_scene_stand_in_a_list(linkage):
    with pytest.raises(refkin.InvalidScene, match="effects: expected a list of words, got 'velocity'"):
        linkage.scene(effects="velocity")


def test_crank_that_cannot_turn_is_refused_with_its_range():
    """The four-bar 90/30/60/45 cm stops at +-112.024312837042 degrees = 1.955193 rad."""
    with pytest.raises(refkin.InvalidScene, match=r"turns: .*\[-1\.95519, 1\.95519\] rad"):
        LIMITED.scene(turns=1)


@pytest.mark.parametrize(
    ("linkage", "told"),
    [
        (FourBar(40.0, 1.0, 3.0, 2.0), r"ground, crank, coupler, rocker: .* got \[40\.0, 1\.0, 3\.0, 2\.0\]"),
        (SliderCrank(1.0, 1.0, 5.0), r"crank, rod, offset: .* got \[1\.0, 1\.0, 5\.0\]"),
    ],
)
def test_lengths_that_assemble_nowhere_are_what_is_wrong_with_a_scene(linkage, told):
    with pytest.raises(refkin.InvalidScene, match=told):
        linkage.scene()


def test_limit_of_the_textbook_four_bar_is_right_to_fifteen_digits():
    ((low, high),) = FourBar(90.0, 30.0, 60.0, 45.0).input_range()

    assert (-high, high) == (low, pytest.approx(math.radians(112.024312837042), rel=1e-15 * 10, abs=0.0))


def test_scene_of_the_readme_has_the_times_and_the_law_asked_for():
    scene = ROCKER.scene(speed=2.0, turns=1, samples=361, branch="open")

    assert (361, 0.0, math.pi) == (len(scene.times), scene.times[0], scene.times[-1])
    assert scene.mechanism.drivers[0].law == refkin.Polynomial(coefficients=(0.0, 2.0))


@pytest.mark.parametrize("branch", Branch)
def test_scene_moves_on_the_branch_asked_for(branch):
    linkage = FourBar(4.0, 1.0, 3.5, 3.0, origin=(2.0, -1.0), angle=0.5)
    motion = refkin.solve(linkage.scene(samples=37, branch=branch))

    rocker = [linkage.assemble(2.0 * t, branch)["rocker"][2] for t in motion.t]

    apart = [math.remainder(a - b, math.tau) for a, b in zip(rocker, motion["rocker"].phi, strict=True)]
    assert np.max(np.abs(apart)) <= 1e-13  # sigma_min is above 0.1 all around: round-off over it


@given(at_inputs(LINKAGES))
def test_newton_from_the_estimate_finds_the_branch_asked_for(case):
    linkage, (driven, relative_to), value, branch = case
    margin = linkage.closure_margin(value, driven, relative_to)
    assume(margin > 1e-10 * linkage.reach)  # below, round-off leaves but one branch
    exact = linkage.assemble(value, branch, driven=driven, relative_to=relative_to)
    held = _coordinate(linkage, exact, driven, value)
    driver = linkage.driver(refkin.Polynomial(coefficients=(held,)), driven, relative_to)
    mechanism = linkage.mechanism(driver)
    system = compile_system(mechanism, unit=mechanism.unit())
    estimate = rough(exact, mechanism.size(), margin)
    q0, q = (system.to_unit(np.concatenate([p[b.name] for b in mechanism.bodies])) for p in (estimate, exact))

    actual = position(system, q0, 0.0).q

    (another,) = {*Branch} - {branch}
    other = linkage.assemble(value, another, driven=driven, relative_to=relative_to)
    away = system.to_unit(np.concatenate([other[b.name] for b in mechanism.bodies]))
    assert _apart(actual, q) < 0.01 * _apart(away, q)


def _coordinate(linkage, pose, driven, value) -> float:
    if driven != "slider":
        return value
    return pose["slider"][0] if abs(math.cos(linkage.angle)) >= abs(math.sin(linkage.angle)) else pose["slider"][1]


def _apart(a, b) -> float:
    return max(abs(math.remainder(x, math.tau)) for x in (a - b)[2::3])


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.2, -2.0])
def test_slider_driven_scene_moves_the_wrist_pin_by_the_law(angle):
    """At a rest angle beyond 45 degrees the law is that of y."""
    linkage = SliderCrank(1.0, 3.0, 0.25, origin=(0.5, 0.25), angle=angle)
    axis = 0 if abs(math.cos(angle)) >= abs(math.sin(angle)) else 1
    near, far = (linkage.place(complex(slide, 0.25))[axis] for slide in (2.5, 3.5))
    law = refkin.Integral(rate=refkin.Polynomial(coefficients=(far - near,)), initial=near)

    motion = refkin.solve(linkage.scene(law=law, times=[0.0, 0.5, 1.0], driven="slider", branch="crossed"))

    assert motion["slider"].q[axis] == pytest.approx([near, (near + far) / 2, far], abs=1e-14)


def test_slider_law_outside_the_stroke_is_refused_in_metres():
    law = refkin.Polynomial(coefficients=(3.5, 1.0))

    with pytest.raises(refkin.InvalidScene, match=r"law: .* \[2, 4\] or \[-4, -2\] m"):
        SliderCrank(1.0, 3.0).scene(law=law, times=[0.0, 1.0], driven="slider")


@given(st.floats(-14.0, 0.0), st.floats(-3.0, 3.0), st.lists(st.floats(-4.0, 4.0), min_size=3, max_size=3))
def test_estimate_is_rounded_finer_than_the_distance_of_the_assemblies(decade, size_decade, q):
    size, part = 10.0**size_decade, 10.0**decade
    exact = (q[0] * size, q[1] * size, q[2])

    x, y, phi = rough({"crank": exact}, size, part * size)["crank"]

    error = max(abs(x - exact[0]) / size, abs(y - exact[1]) / size, abs(phi - exact[2]))
    # Decimals count from the power of ten at or below the size; half a unit of the last one is left.
    assert error <= min(0.005, math.sqrt(part) / 20) + 16 * U


@pytest.mark.parametrize("linkage", [ROCKER, ScrewJack(0.1)])
def test_times_without_a_law_are_those_of_a_constant_speed(linkage):
    scene = linkage.scene(speed=0.5, start=0.25, times=(-1.0, 0.0, 3.0))
    driver = scene.mechanism.drivers[0]

    assert scene.times == (-1.0, 0.0, 3.0)
    assert [float(driver.laws[0](t)) for t in scene.times] == [-0.25, 0.25, 1.75]
    with pytest.raises(refkin.InvalidScene, match=r"times: expected one time \[s\] or more, got \(\)"):
        linkage.scene(times=())
    with pytest.raises(refkin.InvalidScene, match=r"times: expected one time \[s\] or more"):
        linkage.scene(law=driver.laws[0])
    with pytest.raises(refkin.InvalidScene, match=r"law: expected a motion law, as Polynomial, got 5"):
        linkage.scene(law=5, times=(0.0,))
    table = refkin.Table(argument=(0.0, 1.0, 2.0), value=(0.1, 0.2, 0.3))
    with pytest.raises(refkin.InvalidScene, match=r"law: expected a finite number at t = 2\.5, got nan"):
        linkage.scene(law=table, times=(1.0, 2.5))
    with pytest.raises(refkin.InvalidScene, match=r"law: expected a finite number at t = -1e\+308, got -inf"):
        linkage.scene(speed=2.0, times=(-1e308,))
