"""Each spatial joint and driver against complex steps, and against rotation matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from refkin.differences import jacobian
from refkin.joints import SPATIAL_DRIVER_TYPES, SPATIAL_JOINT_TYPES, Counted, Spherical, Unit, elements_of
from refkin.joints.spatial_bodies import with_unit_length
from refkin.joints.spatial_frames import across, frame, parameters_of
from refkin.joints.spatial_passive import passive_spins
from refkin.joints.spatial_turns import relative
from refkin.joints.spatial_vectors import SpatialValues, Vec3
from refkin.model import Body
from refkin.motion import BodyMotion
from refkin.scenes.linkages import RSSR
from refkin.solving.mobility import common_columns
from refkin.system import compile_system
from tests.refkin.space.cases import BETWEEN, CASES, FORMS, NAMES, alone, anywhere, drivers, joints

U = 2.0**-53
T = 0.37
EACH = pytest.mark.parametrize("constraint", CASES, ids=NAMES)
LENGTHS = (None, 1.0)


def test_every_type_has_a_case():
    assert {t for t in SPATIAL_JOINT_TYPES if any(isinstance(c, t) for c in joints(BETWEEN))} == {*SPATIAL_JOINT_TYPES}
    assert {c.type for c in drivers(BETWEEN)} == {t.__dataclass_fields__["type"].default for t in SPATIAL_DRIVER_TYPES}


@EACH
@pytest.mark.parametrize("length", LENGTHS)
def test_the_jacobian_is_the_derivative_of_the_residual_on_and_off_the_unit_length(constraint, length):
    system = alone(constraint)
    q, _ = anywhere(system, 1, length)

    exact = jacobian(lambda x: system.phi(x, T), q)

    np.testing.assert_allclose(system.phi_q(q, T), exact, rtol=0, atol=64 * U * max(1.0, np.max(np.abs(exact))))


STEP = 1e-100


def gamma_by_step(system, q, qd):
    """Return gamma at time T, by a complex step of phi_q qd - nu along the motion."""
    at, t = q + 1j * STEP * qd, T + 1j * STEP
    return -np.imag(system.phi_q(at, t) @ qd - system.nu(at, t)) / STEP


@EACH
@pytest.mark.parametrize("length", LENGTHS)
def test_nu_and_gamma_are_derivatives_of_the_residual_on_and_off_the_unit_length(constraint, length):
    system = alone(constraint)
    q, qd = anywhere(system, 2, length)
    nu, gamma = -np.imag(system.phi(q, T + 1j * STEP)) / STEP, gamma_by_step(system, q, qd)

    scale = max(1.0, np.max(np.abs(qd)) ** 2 * np.max(np.abs(system.phi_q(q, T))))
    np.testing.assert_allclose(system.nu(q, T), nu, rtol=0, atol=64 * U * max(1.0, np.max(np.abs(nu))))
    np.testing.assert_allclose(system.gamma(q, qd, T), gamma, rtol=0, atol=64 * U * 8 * scale)


def matrix(p):
    return Rotation.from_quat(p, scalar_first=True).as_matrix()


def frames(c, q, unit):
    """Return d, and the vectors (f, g, h) of a joint on both bodies in the ground frame; None for what it has not."""
    bodies = {"ground": (np.zeros(3), np.eye(3)), "a": (q[:3], matrix(q[3:7])), "b": (q[7:10], matrix(q[10:14]))}
    (r_i, a_i), (r_j, a_j) = (bodies[b] for b in c.bodies[:2])
    d, vectors = None, []
    if hasattr(c, "point_i"):
        p_i, p_j = (np.array(unit.point(b, p)) for b, p in zip(c.bodies, (c.point_i, c.point_j), strict=True))
        d = r_j + a_j @ p_j - r_i - a_i @ p_i
    for body, a in (("i", a_i), ("j", a_j)):
        axis, zero = (getattr(c, f"{key}_{body}", None) for key in ("axis", "zero"))
        vectors.append(None if axis is None else [a @ v.parts for v in frame(axis, zero)])
    return d, *vectors


def stated(c, q, unit, e):
    """Return the rows of a joint by rotation matrices, with e the Euler parameters from frame to frame."""
    d, of_i, of_j = frames(c, q, unit)
    f, g, h = (None, None, None) if of_i is None else of_i
    f_j, g_j, h_j = (None, None, None) if of_j is None else of_j
    form, law = getattr(c, "form", "half"), c.inputs(T, unit, 0)[0][0] if c.laws else None

    def parallel():
        return {"half": lambda: 2 * e[1:3], "dot": lambda: [f @ h_j, g @ h_j], "printed": lambda: np.cross(h, h_j)}[
            form
        ]()

    def on_axis(d=d):
        return np.cross(h, d) if form == "printed" else [f @ d, g @ d]

    def unturned():
        return [2 * e[3] if form == "half" else f @ g_j]

    def hinge():
        return [*on_axis(d + h_j), ((d + h_j) @ (d + h_j) - 1) / 2] if form == "printed" else []

    def thread():
        shift = (2 * q[-1] * c.pitch + c.shift) / unit.size
        return [h @ d - shift, 2 * (e[3] * np.cos(q[-1]) - e[0] * np.sin(q[-1]))]

    def gear():
        return [(0.4 * (2 * q[-2] - 0.3) - 1.1 * (2 * q[-1] + 0.7)) / 1.1]

    def counted():
        return [2 * (e[3] * np.cos(q[-1]) - e[0] * np.sin(q[-1]))] if isinstance(c, Counted) else []

    def angle():
        if c.shares:
            return [2 * q[-1] - law]
        if form == "dot":
            return [g @ f_j * np.cos(law) - f @ f_j * np.sin(law)]
        return [2 * (e[3] * np.cos(law / 2) - e[0] * np.sin(law / 2))]

    rows = {
        "spherical": lambda: d,
        "universal": lambda: [*d, h @ h_j],
        "perpendicular": lambda: [h @ h_j],
        "point_on_plane": lambda: [h @ d],
        "point_on_line": lambda: [f @ d, g @ d],
        "parallel": parallel,
        "cylindrical": lambda: [*parallel(), *on_axis(), *counted()],
        "prismatic": lambda: [*parallel(), *on_axis(), *unturned()],
        "fixed": lambda: [*d, *parallel(), *unturned()],
        "revolute": lambda: [*([] if form == "printed" else d), *parallel(), *hinge(), *counted()],
        "gear": gear,
        "screw": lambda: [*parallel(), *on_axis(), *thread()],
        "distance": lambda: [(d @ d - law**2) / 2 if c.laws else (d @ d - 2.6**2) / 5.2],
        "displacement": lambda: [h @ d - law],
        "angle": angle,
    }
    return np.array(rows[c.type]())


@EACH
def test_the_residual_is_what_rotation_matrices_say(constraint):
    """Euler parameters and their negatives are one pose: half angles have one sign or the other."""
    system = alone(constraint)
    q, _ = anywhere(system, 3, 1.0)
    _, of_i, of_j = frames(constraint, q, system.unit)
    e = np.zeros(4)
    if of_i is not None and of_j is not None:
        e = Rotation.from_matrix(np.array(of_i) @ np.array(of_j).T).as_quat(scalar_first=True)

    phi = system.phi(q, T)

    away = min(np.max(np.abs(phi - stated(constraint, q, system.unit, sign * e))) for sign in (1, -1))
    assert away < 64 * U * max(1.0, np.max(np.abs(q)) ** 2)


def in_form(form, kind):
    """Return a joint of a type in a form."""
    return next(c for c in joints(BETWEEN) if c.type == kind and getattr(c, "form", form) == form)


@pytest.mark.parametrize("length", LENGTHS)
def test_dot_rows_are_the_half_angle_rows_turned_and_printed_rows_the_dot_rows_in_the_ground_frame(length):
    half, dot, printed = (alone(in_form(form, "parallel")) for form in FORMS)
    q, _ = anywhere(half, 4, length)
    f, g, _ = (half_arm.at.parts for half_arm in arms(in_form("half", "parallel"), q))
    e = relative(half.placed[0].g, SpatialValues(*q[:7]), SpatialValues(*q[7:14]))
    e0, e3 = e.a, e.v.z  # from the frame on body i to that on body j

    x1, x2 = half.phi(q, T)
    u, v = dot.phi(q, T)

    assert [u, v] == pytest.approx([e3 * x1 + e0 * x2, e3 * x2 - e0 * x1], abs=1e-13 * np.max(np.abs(q)) ** 4)
    size = q[3:7] @ q[3:7]  # of the homogeneous rotation of body i
    crossed = size * printed.phi(q, T)
    assert crossed == pytest.approx(u * np.array(g) - v * np.array(f), abs=1e-12 * np.max(np.abs(q)) ** 6)


def arms(c, q):
    """Return (f, g, h) of body i as vectors of the homogeneous rotation."""
    body = SpatialValues(*q[:7])
    return [body.arm(*v.parts) for v in frame(c.axis_i, c.zero_i)]


RANKS = {"cylindrical": (6, 4), "prismatic": (7, 5), "revolute": (7, 5), "screw": (8, 6), "universal": (4, 4)}


@pytest.mark.parametrize("kind", RANKS)
def test_printed_rows_have_the_rank_of_the_freedoms_they_take(kind):
    """At a pose that closes: bodies that coincide, with one frame. A screw's rows hold its own angle as well."""
    same = {"point_i": (0.3, -0.2, 0.7), "axis_i": (0.3, 2.0, -0.5), "zero_i": (1.0, 0.2, 0.3)}
    c = in_form("printed", kind)
    mirrored = {key.replace("_i", "_j"): value for key, value in same.items()}
    own = {key: value for key, value in {**same, **mirrored}.items() if hasattr(c, key)}
    if kind == "universal":
        own["axis_j"] = (2.0, -0.3, 0.0)
    own |= {"shift": 0.0} if kind == "screw" else {}
    system = alone(replace(c, **own))
    q = np.zeros(system.n)
    q[3] = q[10] = 1.0

    assert np.max(np.abs(system.phi(q, T))) < 1e-15
    assert (system.m, np.linalg.matrix_rank(in_six_columns(system, q), 1e-9)) == RANKS[kind]


def test_a_printed_revolute_joint_without_spacing_is_a_singular_formulation():
    c = in_form("printed", "revolute")
    system = alone(replace(c, spacing=0.0, point_j=c.point_i, axis_j=c.axis_i, zero_j=c.zero_i))
    q = np.zeros(14)
    q[3] = q[10] = 1.0

    assert np.linalg.matrix_rank(in_six_columns(system, q), 1e-9) == 4


def test_a_printed_revolute_joint_is_spaced_by_a_size_unless_it_says_otherwise():
    c, unit = in_form("printed", "revolute"), Unit(0.5)
    spaced = [replace(c, spacing=spacing).constants(unit) for spacing in (None, 0.5, 0.75)]

    assert spaced[0] == spaced[1] != spaced[2]


def in_six_columns(system, q):
    """Return phi_q in velocity and angular velocity of each body."""
    return common_columns(system, q, system.phi_q(q, T))


@pytest.mark.parametrize("form", ["half", "dot"])
def test_the_elements_of_a_joint_have_its_rows(form):
    for c in (c for c in CASES if getattr(c, "form", form) == form):
        assert sum(element.rows for element in elements_of([c])) == c.rows - isinstance(c, Counted)


def test_the_equations_of_a_linkage_have_a_row_for_each_unit_length_and_hold_off_it():
    """An RSSR: 18 rows of joints, a driver, three unit lengths, one passive spin; anywhere, by complex steps."""
    mechanism = RSSR(1.0, 3.0, 2.0, (2.5, -0.5, 0.75), (0.25, 1.0, 0.125)).scene(start=0.4).mechanism
    system = compile_system(mechanism, unit=mechanism.unit())
    q, qd = np.random.default_rng(7).normal(size=(2, system.n))

    assert (system.m, system.n) == (21, 21)
    np.testing.assert_allclose(system.phi_q(q, T), jacobian(lambda x: system.phi(x, T), q), rtol=0, atol=1e-14)
    np.testing.assert_allclose(system.gamma(q, qd, T), gamma_by_step(system, q, qd), rtol=0, atol=1e-12)


def test_coordinates_and_rates_of_a_turning_body_are_those_of_its_rotation_matrix():
    """Euler parameters scalar first; omega and alpha in the ground frame, by a complex step of the matrix."""
    t, h = 0.7, 1e-100

    def parameters(s):
        axis, half = np.array([0.3 + s, -0.2, 0.5 * s * s + 0.4]), 0.9 * s + 0.3 * s * s
        axis = axis / np.sqrt(np.sum(axis * axis))
        return np.append(np.cos(half), axis * np.sin(half))

    p, pd = parameters(t), np.imag(parameters(t + 1j * h)) / h
    q, qd = np.append(np.zeros(3), p), np.append(np.zeros(3), pd)
    body = BodyMotion(q[:, None], qd[:, None], None)
    skew = np.imag(np.array([SpatialValues(0, 0, 0, *parameters(t + 1j * h)).arm(*e).at.parts for e in np.eye(3)]).T)
    spin = (skew / h) @ matrix(p).T

    assert body.rotation[..., 0] == pytest.approx(matrix(p), abs=1e-15)
    assert body.omega[:, 0] == pytest.approx([spin[2, 1], spin[0, 2], spin[1, 0]], abs=1e-14)


@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("small", [0.0, 1e-9, 1e-4, 0.4])
def test_the_parameters_of_a_frame_lose_no_digit_whichever_of_them_is_largest(first, small):
    """At and beside half turns about each axis, where the first of them vanishes."""
    p = np.roll([1.0, small, -small / 2, small / 3], first)
    p /= np.linalg.norm(p)
    found = np.array(parameters_of(*(Vec3(*column) for column in matrix(p).T.tolist())))

    assert found * np.sign(found @ p) == pytest.approx(p, rel=0, abs=8 * U)


@pytest.mark.parametrize("size", [1e-4, 1.0, 1e4])
def test_a_body_on_balls_spins_if_they_lie_on_a_line_whatever_its_size(size):
    def spins(*points):
        ends = {"body_i": "ground", "point_i": (0.0, 0.0, 0.0), "body_j": "b"}
        balls = [Spherical(name=str(k), **ends, point_j=tuple(size * x for x in u)) for k, u in enumerate(points)]
        return [" and ".join(spin) for spin in passive_spins([Body(name="b")], balls)]

    assert spins((0.1, 0.2, 0.3), (0.8, 0.3, 0.6)) == ["b"]
    assert spins((0.1, 0.2, 0.3), (0.8, 0.3, 0.6), (2.2, 0.5, 1.2)) == ["b"]
    assert spins((0.1, 0.2, 0.3), (0.8, 0.3, 0.6), (2.2, 0.5, 1.2001)) == []
    assert spins((0.1, 0.2, 0.3)) == []


def test_an_estimate_turns_as_it_says_whatever_the_length_of_its_parameters():
    """Scaled to length 1; one that does not say how it turns stays, for its fault to be named."""
    r = (1.0, 2.0, 3.0)

    assert with_unit_length((*r, 0.0, 6.0, 0.0, -8.0)) == (*r, 0.0, 0.6, 0.0, -0.8)
    assert with_unit_length((*r, 0.0, 2.0, 0.0, 0.0)) == (*r, 0.0, 1.0, 0.0, 0.0)
    for p in ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (np.inf, 0.0, 0.0, 0.0)):
        assert with_unit_length((*r, *p)) == (*r, *p)


@pytest.mark.parametrize("size", [1e-200, 1.0, 1e200])
def test_a_line_of_angle_zero_lies_across_its_axis_by_more_than_rounding(size):
    axis = (0.3 * size, 0.6 * size, -0.2 * size)

    assert not across(axis, (0.9, 1.8, -0.6))
    assert not across(axis, (0.9, 1.8, -0.6 + 1e-14))
    assert across(axis, (0.9, 1.8, -0.6 + 1e-10))
    assert not across(axis, (0.0, 0.0, 0.0))
    assert across(axis, (np.nan, 0.0, 1.0)), "another fault says so"
