"""The spatial mechanisms of the problem set, by family.

Couplers are distances, or held by a universal joint: one between two spherical joints may spin about its own line, and
where it stands is nobody's answer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from random import Random

from crosscheck.problems import Family, Stated, polynomial, stated, within
from crosscheck.scenes.hard_case import ends
from refkin.joints import (
    GROUND,
    Constraint,
    Cylindrical,
    Parallel,
    Perpendicular,
    PointOnPlane,
    SpatialAngleDriver,
    SpatialDistance,
    SpatialFixed,
    SpatialPointOnLine,
    SpatialPrismatic,
    SpatialRevolute,
    Spherical,
    Triple,
    Universal,
)
from refkin.scenes.linkages.spatial_base import AT as ORIGIN
from refkin.scenes.linkages.spatial_base import X, Y, Z


def _hinge(name: str, at: Triple, axis: Triple, body: str) -> SpatialRevolute:
    return SpatialRevolute(name=name, **ends(GROUND, at, body), axis_i=axis, zero_i=X, axis_j=Z, zero_j=X)


def _driven(title: str, joints: Sequence[Constraint]) -> Stated:
    return stated(
        title, joints, SpatialAngleDriver(name="motor", joint=joints[0].name, law=polynomial(0.4, 1.0, 0.125))
    )


def _tilted(random: Random) -> Triple:
    return (within(random, -0.5, 0.5), 1.0, within(random, -0.5, 0.5))


def spatial_four_bars(random: Random) -> Iterator[Stated]:
    """Yield RSSR linkages: a crank, a rocker on a skew axis, and a massless coupler between two ball joints."""
    for _ in range(5):
        pivot = (within(random, 2.2, 2.8), within(random, -0.6, -0.3), within(random, 0.5, 0.9))
        at = ends("crank", X, "rocker", (within(random, 1.8, 2.2), 0.0, 0.0))
        coupler = SpatialDistance(name="coupler", **at, length=within(random, 2.8, 3.2))
        joints = [_hinge("R1", ORIGIN, Z, "crank"), _hinge("R2", pivot, _tilted(random), "rocker"), coupler]
        yield _driven("RSSR with a massless coupler", joints)


def universal_couplers(random: Random) -> Iterator[Stated]:
    """Yield RUSR linkages: a universal joint keeps the coupler from spinning."""
    for _ in range(3):
        pivot = (within(random, 2.2, 2.8), within(random, -0.6, -0.3), within(random, 0.5, 0.9))
        cross = Universal(name="U", **ends("crank", X, "coupler"), axis_i=Z, axis_j=Y)
        ball = Spherical(name="S", **ends("coupler", (within(random, 2.8, 3.2), 0.0, 0.0), "rocker", (2.0, 0.0, 0.0)))
        joints = [_hinge("R1", ORIGIN, Z, "crank"), cross, ball, _hinge("R2", pivot, _tilted(random), "rocker")]
        yield _driven("RUSR", joints)


def spatial_slider_cranks(random: Random) -> Iterator[Stated]:
    """Yield RSSP linkages with massless rods, and rods whose end runs on a rail or in a plane."""
    for _ in range(3):
        guide = SpatialPrismatic(
            name="P", **ends(GROUND, (0.0, within(random, -0.5, 0.5), 0.25), "slider"),
            axis_i=(1.0, within(random, -0.3, 0.3), 0.1), zero_i=Z, axis_j=X, zero_j=Z,
        )  # fmt: skip
        rod = SpatialDistance(name="rod", **ends("crank", X, "slider"), length=within(random, 2.2, 3.0))
        yield _driven("RSSP with a massless rod", [_hinge("R1", ORIGIN, Z, "crank"), guide, rod])
    for k in range(4):
        ball = Spherical(name="S", **ends("crank", X, "rod"))
        at = ends(GROUND, (0.0, 0.0, within(random, 0.0, 0.6)), "rod", (within(random, 2.5, 3.5), 0.0, 0.0))
        joints: list[Constraint] = [_hinge("R1", ORIGIN, Z, "crank"), ball]
        if k % 2:
            joints += [SpatialPointOnLine(name="rail", **at, axis_i=X)]
            joints += [Perpendicular(name="level", body_i=GROUND, axis_i=Z, body_j="rod", axis_j=Y)]
        else:
            level = {"body_i": GROUND, "axis_i": Z, "zero_i": X, "body_j": "rod", "axis_j": Z, "zero_j": X}
            joints += [Parallel(name="upright", **level)]  # type: ignore[arg-type]
            joints += [PointOnPlane(name="wall", **at, axis_i=(within(random, -0.2, 0.2), 1.0, 0.0))]
        yield _driven("rod with its end on a rail" if k % 2 else "rod with its end in a plane", joints)


def shafts(random: Random) -> Iterator[Stated]:
    """Yield shafts at an angle, joined by Hooke's joint, and one that slides as it turns."""
    for _ in range(3):
        bearing = SpatialRevolute(
            name="bearing", **ends(GROUND, (-1.0, 0.0, 0.0), "input", (-1.0, 0.0, 0.0)),
            axis_i=X, zero_i=Y, axis_j=X, zero_j=Y,
        )  # fmt: skip
        cross = Universal(name="cross", **ends("input", ORIGIN, "output"), axis_i=Y, axis_j=Z)
        away = (1.0, within(random, 0.2, 0.9), within(random, -0.3, 0.3))
        line = Parallel(name="line", body_i=GROUND, axis_i=away, zero_i=Z, body_j="output", axis_j=X, zero_j=Z)
        yield _driven("Hooke's joint", [bearing, cross, line])


def arms(random: Random) -> Iterator[Stated]:
    """Yield an arm with a welded tool, which draws a sleeve along a rod by a massless link."""
    for _ in range(2):
        weld = SpatialFixed(name="weld", **ends("arm", X, "tool"), axis_i=(0.0, 0.6, 0.8), zero_i=X, axis_j=Z, zero_j=X)
        rod = Cylindrical(
            name="rod", **ends(GROUND, (0.0, 0.0, 1.0), "sleeve"), axis_i=(0.25, 0.0, 1.0), zero_i=X, axis_j=Z, zero_j=X
        )
        link = SpatialDistance(
            name="link", **ends("tool", (0.5, 0.0, 0.0), "sleeve", (0.5, 0.0, 0.0)), length=within(random, 2.0, 2.4)
        )
        level = Perpendicular(name="level", body_i="arm", axis_i=Y, body_j="sleeve", axis_j=X)
        yield _driven("arm, tool and sleeve", [_hinge("R1", ORIGIN, Z, "arm"), weld, rod, link, level])


FAMILIES: tuple[Family, ...] = (spatial_four_bars, universal_couplers, spatial_slider_cranks, shafts, arms)
