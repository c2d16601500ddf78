"""Newton and the march over the times, on small systems whose solutions can be written down."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from crosscheck.engines import EngineError, poses
from crosscheck.engines import march as continuation
from crosscheck.engines.loading import load
from crosscheck.engines.march import MarchResult, march
from crosscheck.engines.poses import EPS, Poses, close, solve
from crosscheck.engines.tree.tree_system import TreeSystem
from crosscheck.measure.check import check
from refkin.joints import AngleDriver, DistanceDriver, Prismatic, Revolute, elements_of
from refkin.model import Body, Mechanism, Scene
from refkin.motion import Status
from refkin.motion_laws import Polynomial, Sinusoid
from refkin.scenes.linkages import FourBar
from tests.linkages import ROCKER
from tests.mutation.change import mutated

OK, LOST, SINGULAR = Status.OK, Status.NOT_CONVERGED, Status.SINGULAR


class OneByOne:
    """Equations of poses (n,) and a time, lifted to batches."""

    laws = ()

    def __init__(self, toy: Toy) -> None:
        self.position = toy.position
        self.nu, self.gamma, self.round_off = lifted(toy.nu), lifted(toy.gamma), lifted(toy.round_off)

    def rows(self, q: Any, t: Any) -> tuple[Any, Any]:
        values = [self.position(*at) for at in zip(q, t.tolist(), strict=True)]
        return np.array([residual for residual, _ in values]), np.array([jacobian for _, jacobian in values])


def lifted(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *given: np.array([function(*at) for at in zip(*given, strict=True)])


@dataclass
class Toy:
    """A system given by its functions, with as many calls of `position` as it took."""

    start: list[float]
    phi: Callable[[Any, float], list[float]]
    phi_q: Callable[[Any, float], list[list[float]]]
    rate: Callable[[float], list[float]]
    curvature: Callable[[Any, Any, float], list[float]] | None = None
    calls: int = field(default=0)

    def position(self, q: Any, t: float) -> tuple[Any, Any]:
        assert np.isfinite(q).all()
        self.calls += 1
        return np.array(self.phi(q, t)), np.array(self.phi_q(q, t))

    def nu(self, q: Any, t: float) -> Any:
        return np.array(self.rate(t))

    def gamma(self, q: Any, qd: Any, t: float) -> Any:
        assert self.curvature is not None
        return np.array(self.curvature(q, qd, t))

    def round_off(self, q: Any, t: float) -> Any:
        return np.full(1, 64.0 * EPS * (1.0 + np.max(np.abs(q))))

    @property
    def equations(self) -> OneByOne:
        return OneByOne(self)


def closed(toy: Toy, at: float, t: float, **more: Any) -> Poses:
    """Return the pose to which Newton goes from (at, 0 ...)."""
    q = np.zeros((1, len(toy.start)))
    q[0, 0] = at
    with np.errstate(all="ignore"):
        return close(toy.equations, q, np.array([t]), **more)


def circle() -> Toy:
    """x^2 + y^2 = 1 with y = t: x = sqrt(1 - t^2), a fold at t = 1."""
    return Toy(
        start=[0.9, 0.1],
        phi=lambda q, t: [0.5 * (q[0] ** 2 + q[1] ** 2 - 1.0), q[1] - t],
        phi_q=lambda q, t: [[q[0], q[1]], [0.0, 1.0]],
        rate=lambda t: [0.0, 1.0],
        curvature=lambda q, qd, t: [-(qd[0] ** 2) - qd[1] ** 2, 0.0],
    )


def two_tracks() -> Toy:
    """(x - 5 t^2)^2 = 0.01: two branches 0.2 apart that move by 5 up to t = 1; the start is near the upper one."""
    return Toy(
        start=[0.11],
        phi=lambda q, t: [0.5 * ((q[0] - 5.0 * t * t) ** 2 - 0.01)],
        phi_q=lambda q, t: [[q[0] - 5.0 * t * t]],
        rate=lambda t: [math.nan],  # replaced below: it depends on the branch
    )


def run(toy: Toy, times: Any, order: int = 0) -> MarchResult:
    return march(toy.equations, np.array(toy.start), tuple(float(t) for t in times), order)


def test_position_velocity_and_acceleration_are_those_of_the_closed_form() -> None:
    t = np.linspace(0.0, 0.9, 31)
    x = np.sqrt(1.0 - t * t)
    result = run(circle(), t, 2)

    assert result.status == (OK,) * 31
    # x >= 0.43: J's inverse is at most 3, and enters to the powers 1, 3 and 5
    for level, exact, power in zip(result.levels, (x, -t / x, -1.0 / x**3), (1, 3, 5), strict=True):
        assert np.max(np.abs(level[0] - exact)) <= 4 * EPS * 2.3**power


def test_newton_goes_on_until_round_off() -> None:
    """From 0.1 off: 5e-3, 1e-5, 1e-10, round-off, one to see that it no longer decreases; full Newton is quadratic."""
    toy = circle()
    pose = closed(toy, 1.1, 0.0)

    assert abs(pose.q[0, 0] - 1.0) <= EPS
    assert toy.calls <= 6


def test_what_is_not_called_for_is_not_computed() -> None:
    toy = circle()
    toy.curvature = None  # whose call would fail

    assert len(run(toy, [0.0, 0.1], 1).levels) == 2


def test_the_march_reaches_a_pose_close_to_a_fold() -> None:
    """1e-10 before the fold, x = 1.4e-5 is found, where it can be known to EPS / x."""
    result = run(circle(), [0.0, 1.0 - 1e-10])
    t = 1.0 - 1e-10  # its rounding is that of the driver's value

    assert result.status == (OK, OK)
    assert abs(result.levels[0][0, 1] - math.sqrt((1.0 - t) * (1.0 + t))) <= 8 * EPS / 1.4e-5


def test_a_fold_is_singular_and_has_no_rates() -> None:
    result = run(circle(), [0.0, 1.0], 2)

    assert result.status == (OK, SINGULAR)
    assert np.isnan(result.levels[1][:, 1]).all()
    assert np.isnan(result.levels[2][:, 1]).all()


def test_the_end_of_a_branch_is_approached_by_ever_smaller_parts_of_what_is_left() -> None:
    """Halving steps that fail takes some 250 calls."""
    toy = circle()

    assert run(toy, [0.0, 1.5]).status == (OK, LOST)
    assert toy.calls <= 150


def test_of_an_end_far_beyond_a_short_step_the_tangent_is_taken() -> None:
    """The roots of what is left at both times are the same number then."""
    a, b = closed(circle(), 1.0, 0.0), closed(circle(), 1.0, 1e-17)

    assert continuation._ahead(a, b, 1.0, 3e-17)[0] == pytest.approx([1.0, 2e-17], abs=1e-30)


def test_beyond_a_fold_there_is_no_answer() -> None:
    result = run(circle(), [0.0, 1.0 + 1e-9, 1.5], 2)

    assert result.status == (OK, LOST, LOST)
    assert np.isnan(np.array([level[:, 1:] for level in result.levels])).all()


def test_nothing_is_predicted_from_a_singular_pose() -> None:
    """On the way from 0 to 2 the step that ends at 1 lands on a pose without rates."""
    toy = Toy([0.0], lambda q, t: [(q[0] - t) * (1 - q[0])], lambda q, t: [[1 - 2 * q[0] + t]], lambda t: [1 - t])

    assert run(toy, [0.0, 2.0]).status == (OK, LOST)


def test_from_a_first_pose_that_is_singular_nothing_goes_on() -> None:
    """x^2 = t: Newton from the estimate would take one of the two branches, and exudyn was blamed for the other."""
    toy = Toy([0.1], lambda q, t: [q[0] ** 2 - t], lambda q, t: [[2.0 * q[0]]], lambda t: [1.0])

    assert run(toy, [0.0, 0.5, 1.0]).status == (SINGULAR, LOST, LOST)


def tracked(toy: Toy) -> Toy:
    toy.rate = lambda t: [0.1 * 10.0 * t]  # (x - 5 t^2) * 10 t with x - 5 t^2 = +0.1: the velocity of the upper branch
    return toy


def test_the_march_stays_on_its_branch() -> None:
    result = run(tracked(two_tracks()), [0.0, 1.0])

    assert result.levels[0][0].tolist() == pytest.approx([0.1, 5.1], abs=1e-12)


REACHES = FourBar(ground=4.0, crank=3.0, coupler=2.0, rocker=1.5)
"""Its crank swings through 1.01 rad either way."""
BEYOND = {
    "rates zero at both": (Polynomial(coefficients=(0.5, 0.0, 16.0, -32.0, 16.0)), 1.5),
    "signs alike at both": (Sinusoid(amplitude=0.8, angular_frequency=math.tau, offset=0.3, phase=0.1), 1.1),
    "within": (Polynomial(coefficients=(0.5, 0.0, 6.4, -12.8, 6.4)), 0.9),
}


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco", "exudyn", "closed_form", "vector_loop"])
@pytest.mark.parametrize(("law", "most"), BEYOND.values(), ids=BEYOND)
def test_a_motion_does_not_pass_over_what_its_law_does_between_two_times(engine, law, most) -> None:
    """It turns back twice there: by the rates at both ends it did not, and all times were ok with 0.5 rad too much."""
    scene = REACHES.scene(law=law, times=(0.0, 1.0))
    status = load(engine).solve(scene).status

    assert (status[0], status[1] is Status.OK) == (Status.OK, most < 1.01)


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco", "exudyn"])
@pytest.mark.parametrize("frequency", [20.0, 60.0])
def test_a_law_that_swings_between_times_is_followed(engine, frequency) -> None:
    """From rest to rest, and from a pose that is not apart from the next turn, no step told how it goes on."""
    law = Sinusoid(amplitude=0.5, angular_frequency=frequency, offset=1.0)
    scene = ROCKER.scene(law=law, times=tuple(np.linspace(0.0, 5.0, 20).tolist()))

    assert set(load(engine).solve(scene).status) == {OK}


def test_without_shorter_steps_it_would_jump(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shows that the test before can fail: Newton from the prediction alone lands on the lower branch."""
    monkeypatch.setattr(continuation, "NEAR", math.inf)
    for name in ("TRUST", "CONTRACTION"):
        for owner in (continuation, poses):
            monkeypatch.setattr(owner, name, math.inf)
    monkeypatch.setattr(continuation, "connected", lambda inverse, other, off=0.0: np.ones(len(other), bool))

    assert run(tracked(two_tracks()), [0.0, 1.0]).levels[0][0, 1] == pytest.approx(4.9, abs=1e-12)


def straight(**more: Any) -> Toy:
    """x = t."""
    rest = {"phi": lambda q, t: [q[0] - t], "phi_q": lambda q, t: [[1.0]], "rate": lambda t: [1.0], **more}
    return Toy(start=[0.0], **rest)


@pytest.mark.parametrize("lost", [0.0, 0.5])
def test_a_time_without_answer_does_not_end_the_march(lost: float) -> None:
    times = [0.0, 0.5, 1.0]
    result = run(straight(phi=lambda q, t: [math.nan if t == lost else q[0] - t]), times)

    assert result.status == tuple(LOST if t == lost else OK for t in times)
    assert result.levels[0][0, 2] == 1.0


def interrupted(until: float) -> Toy:
    """x = t^2 / 2, but no answer after t = 0.3 and before another time."""
    return straight(phi=lambda q, t: [math.nan if 0.3 < t < until else q[0] - 0.5 * t * t], rate=lambda t: [t])


def test_where_a_motion_goes_on_the_times_after_follow_from_there() -> None:
    """From 0.3 a step to 1 can be trusted, one to 1.2 cannot, nor can it be halved."""
    times = [0.0, 0.3, 0.5, 0.6, 0.7, 0.8, 1.0, 1.2, 1.4]

    assert run(interrupted(until=1.0), times).status == (OK, OK, *[LOST] * 4, OK, OK, OK)


def test_times_without_answer_are_tried_together() -> None:
    def batches(times: Any) -> int:
        asked, equations = list[int](), interrupted(until=math.inf).equations
        rows = equations.rows
        equations.rows = lambda q, t: (asked.append(len(t)), rows(q, t))[1]  # type: ignore[method-assign, func-returns-value]
        march(equations, np.zeros(1), [0.0, 0.3, *times], 0)
        return len(asked)

    assert batches(np.linspace(0.4, 2.0, 80)) < 2 * batches(np.linspace(0.4, 2.0, 10))


@pytest.mark.parametrize(("gap", "status"), [(0.0, OK), (1e-9, LOST)])
def test_redundant_rows_must_agree(gap: float, status: Status) -> None:
    """A second row that contradicts the first by 1e-9 is no pose, however small the least-squares correction is."""
    toy = straight(
        phi=lambda q, t: [q[0] - t, q[0] - t - gap], phi_q=lambda q, t: [[1.0], [1.0]], rate=lambda t: [1.0, 1.0]
    )

    assert run(toy, [0.0, 1.0]).status == (status, status)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_in_a_batch_a_fold_takes_fewer_corrections_and_its_side_stays(side: float) -> None:
    """Alone, 0.3 before a fold, halves lead to 1.4e-6: 18 of them. Of those with others every second is an eighth."""
    t = np.array([0.0, 1.0 - 1e-12])
    alone, toy = circle(), circle()
    close(alone.equations, np.array([[side * 0.3, t[1]]]), t[1:])
    both = close(toy.equations, np.array([[side, 0.0], [side * 0.3, t[1]]]), t)

    assert alone.calls >= 20
    assert toy.calls <= 16
    assert both.q[:, 0] == pytest.approx(side * np.sqrt((1.0 - t) * (1.0 + t)), rel=1e-4)  # EPS / x^2


@pytest.mark.parametrize("square", [1.0, 1e-20])
def test_newton_that_never_converges_ends_without_an_answer(square: float) -> None:
    """x^2 + 1 = 0 has no root; its flat part sends Newton far away, which is a status and not a warning."""
    toy = straight(phi=lambda q, t: [square * q[0] ** 2 + 1.0], phi_q=lambda q, t: [[2.0 * square * q[0]]])
    toy.start = [0.5]

    assert run(toy, [0.0, 1.0]).status == (LOST, LOST)


def test_a_small_residual_is_not_enough() -> None:
    """x^4 = t at t = 1e-18: far from the root (3e-5) the residual is at round-off, but corrections still decrease."""
    toy = Toy([0.01], lambda q, t: [q[0] ** 4 - t], lambda q, t: [[4.0 * q[0] ** 3]], lambda t: [1.0])
    pose = closed(toy, 0.01, 1e-18)

    assert pose.q[0, 0] == pytest.approx(1e-18**0.25, rel=1e-6, abs=0.0)


def test_noise_that_shrinks_ever_so_little_is_the_end_of_newton() -> None:
    """Corrections change their sign and lose a thousandth each time; 60 of them would be no nearer to the root."""
    noise = [1e-9, *(2e-15 * (-0.999) ** k for k in range(100))]
    toy = straight(phi=lambda q, t: [noise[toy.calls - 1]], phi_q=lambda q, t: [[1.0]])
    pose = closed(toy, 0.5, 0.0, near=True)

    assert pose.known[0]
    assert toy.calls == 3


def test_a_matrix_without_inverse_solves_to_nothing() -> None:
    assert np.isnan(solve(np.zeros((1, 2, 2)), np.ones((1, 2)))).all()


def test_a_matrix_without_inverse_spoils_no_other_in_its_batch() -> None:
    x = solve(np.stack([np.zeros((2, 2)), np.eye(2)]), np.ones((2, 2)))

    assert np.isnan(x[0]).all()
    assert x[1].tolist() == [1.0, 1.0]


def test_redundant_rows_do_not_hide_that_columns_depend_on_each_other() -> None:
    """Three rows and two columns that are alike: a pseudo-inverse leaves the vanishing singular value out."""
    flat = Toy(
        start=[0.5, 0.5],
        phi=lambda q, t: [q[0] + q[1] - 1.0] * 3,
        phi_q=lambda q, t: [[1.0, 1.0]] * 3,
        rate=lambda t: [0.0] * 3,
    )

    assert run(flat, [0.0]).status == (SINGULAR,)


def test_round_off_grows_with_the_turns() -> None:
    system = TreeSystem(SimpleNamespace(tree=SimpleNamespace(edges=(), driven=())))  # type: ignore[arg-type]
    turned, still = system.round_off(np.array([[1000.0], [0.0]]), np.zeros(2))[:, 0]

    assert turned == 1001 * still


STILL = Polynomial(coefficients=(0.5,))


def test_an_element_of_another_kind_is_refused_by_name() -> None:
    ends = {"body_i": "ground", "point_i": (0.0, 0.0), "body_j": "b", "point_j": (0.0, 0.0)}
    odd = Revolute(name="odd", **ends, offset_law=(STILL, STILL))

    with pytest.raises(EngineError, match="points coincide by a law of 'odd'"):
        TreeSystem(SimpleNamespace(tree=SimpleNamespace(driven=tuple(elements_of([odd])))))  # type: ignore[arg-type]


def test_a_hinge_far_out_on_a_slide_is_as_exact_as_one_at_home():
    """Newton stopped at corrections that are rounding of the slide's coordinate: the angle was off by 4e-10 rad."""
    big = 1e6
    bodies = tuple(Body(name=name, estimate=(2.0 * big, 0.0, 0.3 * k)) for k, name in enumerate(("slide", "arm")))
    at = {"point_i": (0.0, 0.0), "point_j": (0.0, 0.0)}
    rail = Prismatic(name="rail", body_i="ground", body_j="slide", axis_i=(1.0, 0.0), **at)
    hinge = Revolute(name="hinge", body_i="slide", body_j="arm", **at)
    rope = Polynomial(coefficients=(2.0 * big, 1.0))
    turn = Sinusoid(amplitude=1.0, angular_frequency=0.1, offset=0.3)
    drivers = (
        DistanceDriver(name="rope", body_i="ground", body_j="slide", law=rope, **at),
        AngleDriver(name="turn", body="arm", relative_to="slide", law=turn),
    )
    times = tuple(np.linspace(0.0, 2.0, 40).tolist())
    scene = Scene(mechanism=Mechanism(bodies, (rail, hinge), drivers), times=times)

    for engine in ("pinocchio", "mujoco"):
        assert np.max(np.abs(load(engine).solve(scene)["arm"].phi - turn(np.array(times)))) < 1e-15


TURN, HELD = 0.4, -0.3


def drawn_telescope() -> Scene:
    """A block slides along x, turned by 0.4 against its guide; a rod pinned to it slides in a turning sleeve."""
    bodies = (
        Body(name="block", estimate=(2.0, 0.0, TURN)),
        Body(name="rod", estimate=(2.0, 0.0, 0.5 + HELD)),
        Body(name="sleeve", estimate=(0.0, -1.0, 0.5)),
    )
    origin = (0.0, 0.0)
    joints = (
        Prismatic(
            name="guide", body_i="ground", point_i=origin, axis_i=(1.0, 0.0), body_j="block", point_j=origin, angle=TURN
        ),
        Revolute(name="pin", body_i="block", point_i=origin, body_j="rod", point_j=origin),
        Revolute(name="pivot", body_i="ground", point_i=(0.0, -1.0), body_j="sleeve", point_j=origin),
        Prismatic(
            name="bore", body_i="sleeve", point_i=origin, axis_i=(1.0, 0.0), body_j="rod", point_j=origin, angle=HELD
        ),
    )
    motor = AngleDriver(name="motor", body="sleeve", law=Polynomial(coefficients=(0.5, 0.2)))
    return Scene(mechanism=Mechanism(bodies, joints, (motor,)), times=(0.0, 0.5, 1.0, 1.5), name="telescope")


@pytest.mark.parametrize("engine", ["mujoco", "pinocchio", "exudyn"])
def test_engines_agree_on_it(engine):
    record = check(drawn_telescope(), [engine])

    assert record.reference.verdict == "ok"
    assert [item for item in record.disagreements if item.method != "shipped"] == []


def test_a_turn_counted_with_the_wrong_sign_is_found():
    turn = "turns, offset = self.tree.turn(e)"
    with mutated("crosscheck.engines.mujoco.model:Plan._angle", turn, f"{turn}; offset = -offset"):
        assert check(drawn_telescope(), ["mujoco"]).disagreements
