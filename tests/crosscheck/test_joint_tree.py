"""The spanning tree of a mechanism: which joints become edges, what is left to close, and where a solve starts."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from crosscheck.engines import EngineError
from crosscheck.engines.spatial.tree import longest_chain
from crosscheck.engines.tree.joint_tree import WIDTH, Freedom, JointTree, joint_tree
from crosscheck.scenes.hard_case import pin
from refkin.joints import AngleDriver, Distance, Fixed, PointOnLine, Prismatic, XDriver, YDriver, elements_of
from refkin.model import Body, Mechanism
from refkin.motion_laws import Polynomial

REST = Polynomial(coefficients=(0.0,))


def held(*bodies: Body, joints: tuple = ()) -> Mechanism:
    """Return a mechanism with drivers on every coordinate, so that it has enough constraints whatever its joints."""
    drivers = [
        driver
        for b in bodies
        for driver in (
            XDriver(name=f"{b.name} x", body=b.name, law=REST),
            YDriver(name=f"{b.name} y", body=b.name, law=REST),
            AngleDriver(name=f"{b.name} phi", body=b.name, law=REST),
        )
    ]
    return Mechanism(bodies, joints, tuple(drivers))


def four_bar(size: float = 1.0, x: float = 0.0) -> Mechanism:
    """Crank 3-4-5, assembled: A (3, 4), B (9, 4), pivots (0, 0) and (9, 0), in `size`, moved by x."""
    bodies = (
        Body(name="crank", estimate=(x, 0.0, math.atan2(4, 3))),
        Body(name="coupler", estimate=(x + 3 * size, 4 * size, 0.0)),
        Body(name="rocker", estimate=(x + 9 * size, 0.0, math.pi / 2)),
    )
    joints = (
        pin("A0", "ground", (x, 0.0), "crank", (0.0, 0.0)),
        pin("A", "crank", (5.0 * size, 0.0), "coupler", (0.0, 0.0)),
        pin("B", "coupler", (6.0 * size, 0.0), "rocker", (4.0 * size, 0.0)),
        pin("B0", "rocker", (0.0, 0.0), "ground", (x + 9.0 * size, 0.0)),
    )
    return held(*bodies, joints=joints)


def posed(tree: JointTree, q: np.ndarray) -> dict[str, tuple[complex, float]]:
    """Return each body's origin (complex, in sizes) and angle, composed as the definition of `Edge` says."""
    poses = {"ground": (0j, 0.0)}
    for edge in tree.edges:
        r, phi = poses[edge.parent]
        r += cmath.exp(1j * phi) * complex(*edge.point)
        phi += edge.angle
        own = q[edge.first : edge.first + WIDTH[edge.freedom]]
        if edge.freedom is Freedom.FREE:
            r, phi = r + cmath.exp(1j * phi) * complex(own[0], own[1]), phi + own[2]
        elif edge.freedom is Freedom.SLIDE:
            r += cmath.exp(1j * phi) * own[0] * complex(*edge.axis)
        elif edge.freedom is Freedom.TURN:
            phi += own[0]
        poses[edge.body] = (r - cmath.exp(1j * phi) * complex(*edge.pin), phi)
    return poses


def parents(tree: JointTree) -> dict[str, tuple[str, Freedom]]:
    return {edge.body: (edge.parent, edge.freedom) for edge in tree.edges}


def test_a_four_bar_hangs_crank_and_rocker_on_the_ground_and_is_closed_by_the_joint_that_is_left() -> None:
    tree = joint_tree(four_bar())

    assert parents(tree) == {
        "crank": ("ground", Freedom.TURN),
        "rocker": ("ground", Freedom.TURN),
        "coupler": ("crank", Freedom.TURN),
    }
    assert [joint.name for joint in tree.closures] == ["B"]


def test_two_joints_between_the_same_bodies_make_one_edge_and_one_closure() -> None:
    joints = (pin("a", "ground", (0.0, 0.0), "b", (0.0, 0.0)), pin("c", "ground", (1.0, 0.0), "b", (1.0, 0.0)))
    tree = joint_tree(held(Body(name="b"), joints=joints))

    assert ([edge.body for edge in tree.edges], [joint.name for joint in tree.closures]) == (["b"], ["c"])


def test_a_body_held_by_a_line_alone_floats_freely() -> None:
    line = PointOnLine(name="l", body_i="ground", point_i=(0.0, 0.0), axis_i=(1.0, 0.0), body_j="b", point_j=(0.0, 0.0))

    assert parents(joint_tree(held(Body(name="b"), joints=(line,)))) == {"b": ("ground", Freedom.FREE)}


def test_bodies_tied_to_a_floating_one_hang_on_it() -> None:
    joint = pin("a", "c", (0.0, 0.0), "b", (1.0, 0.0))

    assert parents(joint_tree(held(Body(name="b"), Body(name="c"), joints=(joint,)))) == {
        "b": ("ground", Freedom.FREE),
        "c": ("b", Freedom.TURN),
    }


def test_coordinates_follow_each_other_edge_by_edge() -> None:
    bodies = (Body(name="a"), Body(name="b"), Body(name="c"))
    weld = Fixed(name="w", body_i="a", point_i=(0.0, 0.0), body_j="b", point_j=(0.0, 0.0))
    tree = joint_tree(held(*bodies, joints=(weld, pin("p", "b", (1.0, 0.0), "c", (0.0, 0.0)))))

    assert ([edge.first for edge in tree.edges], tree.width) == ([0, 3, 3], 4)


ROD = Distance(name="rod", body_i="crank", point_i=(1.0, 0.0), body_j="slider", point_j=(0.0, 0.0), length=3.0)
GUIDE = Prismatic(
    name="g", body_i="ground", point_i=(0.0, 0.5), axis_i=(2.0, 0.0), body_j="slider", point_j=(0.0, 0.0), angle=0.3
)


def slider_crank(*more: Body, rod: Distance = ROD) -> Mechanism:
    bodies = (Body(name="crank", estimate=(0.0, 0.0, 0.0)), Body(name="slider", estimate=(3.9, 0.5, 0.3)), *more)
    return held(*bodies, joints=(pin("A0", "ground", (0.0, 0.0), "crank", (0.0, 0.0)), GUIDE, rod))


def test_a_distance_joint_is_a_closure() -> None:
    assert joint_tree(slider_crank()).closures == tuple(elements_of([ROD]))


def test_a_distance_joint_may_become_a_body_of_its_length_from_point_i_towards_point_j() -> None:
    tree = joint_tree(slider_crank(), massless_links=True)

    (closure,) = tree.closures
    links = dict(zip(["link of rod"], elements_of([ROD]), strict=True))
    assert (tree.links, closure.body_j, closure.point_j) == (links, "link of rod", (3.0, 0.0))
    r, phi = posed(tree, tree.start())["link of rod"]
    assert (r * tree.size, phi) == pytest.approx((1.0, math.atan2(0.5, 2.9)), abs=1e-15)


def test_a_massless_link_takes_no_name_of_a_body() -> None:
    tree = joint_tree(slider_crank(Body(name="link of rod", estimate=(0.0, 0.0, 0.0))), massless_links=True)

    assert list(tree.links) == ["link of rod'"]


def mixed(forward: bool) -> Mechanism:
    """Every kind of edge, away from the origin, each joint from ground to body or the other way round; assembled."""
    bodies = (
        Body(name="slide", estimate=(7.0, 1.0, 0.4)),
        Body(name="weld", estimate=(-1.0, 2.0, -0.3)),
        Body(name="float", estimate=(5.0, -2.0, 7.0)),
    )
    axis = (math.cos(0.2), math.sin(0.2))  # of the guide, in the ground frame
    at = complex(7.0, 1.0) + cmath.exp(0.4j) * complex(0.5, 0.25)  # point of `slide` in the ground frame
    base = at - 2.5 * complex(*axis)
    ends = {"ground": (base.real, base.imag), "slide": (0.5, 0.25)}
    i, j = ("ground", "slide") if forward else ("slide", "ground")
    own = axis if forward else (math.cos(-0.2), math.sin(-0.2))
    angle = 0.4 if forward else -0.4
    guide = Prismatic(name="g", body_i=i, point_i=ends[i], axis_i=own, body_j=j, point_j=ends[j], angle=angle)
    point = complex(7.0, 1.0) + cmath.exp(0.4j) * complex(2.0, 1.0)
    on_weld = (point - complex(-1.0, 2.0)) * cmath.exp(0.3j)
    ends = {"slide": (2.0, 1.0), "weld": (on_weld.real, on_weld.imag)}
    i, j = ("slide", "weld") if forward else ("weld", "slide")
    angle = -0.7 if forward else 0.7
    weld = Fixed(name="w", body_i=i, point_i=ends[i], body_j=j, point_j=ends[j], angle=angle)
    return held(*bodies, joints=(guide, weld))


@pytest.mark.parametrize(
    "mechanism", [four_bar(), four_bar(size=0.25, x=64.0), mixed(True), mixed(False)], ids=["bar", "far", "ij", "ji"]
)
def test_the_start_puts_every_body_where_it_is_estimated(mechanism: Mechanism) -> None:
    tree = joint_tree(mechanism)
    poses = posed(tree, tree.start())

    for body in mechanism.bodies:
        r, phi = poses[body.name]
        x, y = (r * tree.size + complex(*tree.origin)).real, (r * tree.size + complex(*tree.origin)).imag
        # coordinates of some tens, a dozen roundings each
        assert (x, y, phi) == pytest.approx(body.estimate, abs=12 * np.finfo(float).eps * 64)


def test_the_angle_of_a_body_is_the_sum_along_its_chain() -> None:
    tree = joint_tree(mixed(True))
    q = tree.start()

    assert tree.angle("weld", q) == posed(tree, q)["weld"][1]


def test_turns_of_an_estimate_are_kept() -> None:
    crank = Body(name="crank", estimate=(0.0, 0.0, 1000.0))
    tree = joint_tree(held(crank, joints=(pin("A0", "ground", (0.0, 0.0), "crank", (0.0, 0.0)),)))

    assert tree.angle("crank", tree.start()) == 1000.0


def test_scale_and_origin_do_not_change_a_bit_of_the_start() -> None:
    near, far = joint_tree(four_bar()), joint_tree(four_bar(size=2.0**-40, x=1024.0))

    assert near.start().tolist() == far.start().tolist()


def test_a_missing_estimate_is_named() -> None:
    tree = joint_tree(held(Body(name="lost"), joints=(pin("A0", "ground", (0.0, 0.0), "lost", (0.0, 0.0)),)))

    with pytest.raises(EngineError, match="body 'lost' has no estimate"):
        tree.start()


def test_the_longest_chain_counts_its_bodies() -> None:
    assert longest_chain(joint_tree(four_bar()).edges) == 2
