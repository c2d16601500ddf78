"""What spatial linkages share: their bodies' frames, the joints by few words, a scene at an assembly.

Body frames have their z axis along the joint that leads to the body, their origin on it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from refkin.errors import Fault
from refkin.joints import Constraint, Driver, SpatialAngleDriver, SpatialRevolute, Spherical, Triple
from refkin.joints.annotations import check, plain, word_faults
from refkin.joints.spatial_base import Form
from refkin.joints.spatial_frames import parameters_of
from refkin.joints.spatial_vectors import Vec3
from refkin.model import Body, Effect, Evidence, Mechanism, Scene
from refkin.motion_laws import Law, Polynomial
from refkin.output.scene_motion import Picture
from refkin.scenes.linkages.base import Branch, Shown, is_finite, law_and_times, law_keys, member, pictured, scene_of
from refkin.scenes.linkages.closures import DoesNotAssemble

X, Y, Z, AT = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
Place = tuple[float, ...]
"""The coordinates of a body."""
ROUGH = 9
"""Decimals that an estimate keeps: assemblies that are nearer to each other than that are not told apart."""
SHAPES: dict[str, tuple[int, ...]] = dict.fromkeys(("alpha", "beta", "phase", "stroke"), ())
SHAPES |= {"pivot": (3,), "axis": (3,), "guide": (3,), "base": (6, 3), "platform": (6, 3), "home": (7,)}
"""Of what a linkage has beside lengths: how many numbers that are, or rows of numbers; () is one number."""


def _has_shape(value: Any, shape: tuple[int, ...]) -> bool:
    if not shape:
        return is_finite(value)
    return isinstance(value, tuple) and len(value) == shape[0] and all(_has_shape(x, shape[1:]) for x in value)


def pose_of(r: Vec3, f: Vec3, h: Vec3) -> Place:
    """Return the coordinates of a body at r with its x axis along f and its z axis along h.

    Parameters
    ----------
    r : Vec3
        The origin [m].
    f, h : Vec3
        Unit vectors at a right angle.
    """
    return (*r.parts, *parameters_of(f, h.cross(f), h))


def turned(f: Vec3, g: Vec3, angle: float) -> Vec3:
    """Return f turned towards g.

    Parameters
    ----------
    f, g : Vec3
        Unit vectors at a right angle.
    angle : float
        How far [rad].
    """
    return f * math.cos(angle) + g * math.sin(angle)


def revolute(name: str, i: str, point: Triple, axis: Triple, zero: Triple, j: str, **more: Any) -> SpatialRevolute:
    """Return a revolute joint to a body whose own z axis it is, its angle counted from `zero` to the body's x axis.

    Parameters
    ----------
    name : str
        Of the joint.
    i, j : str
        The bodies.
    point, axis, zero : tuple of three float
        On body i: where [m], along what, and from where the angle counts.
    **more
        Other keys of the joint.
    """
    ends: dict[str, Any] = {"body_i": i, "point_i": point, "axis_i": axis, "zero_i": zero, "body_j": j}
    return SpatialRevolute(name=name, **{**ends, "point_j": AT, "axis_j": Z, "zero_j": X, **more})


def spherical(name: str, i: str, point_i: Triple, j: str, point_j: Triple) -> Spherical:
    """Return a spherical joint.

    Parameters
    ----------
    name : str
        Of the joint.
    i, j : str
        The bodies.
    point_i, point_j : tuple of three float
        The common point, in the frame of either [m].
    """
    return Spherical(name=name, body_i=i, point_i=point_i, body_j=j, point_j=point_j)


@dataclass(frozen=True, kw_only=True)
class SpatialLinkage(Shown):
    """A spatial linkage with one input, the angle of its joint `R1` (of a screw jack `H1`).

    Raises
    ------
    InvalidScene
        If a length is not a finite number above 0, or anything else not as many finite numbers as it takes, or no word
        or flag of those that there are.
    """

    form: Form = "half"
    DRIVEN: ClassVar[str] = "R1"

    def _faults(self) -> Iterator[Fault]:
        yield from super()._faults()
        yield from word_faults(self)
        for key, shape in [(key, shape) for key, shape in SHAPES.items() if hasattr(self, key)]:
            value = getattr(self, key)
            if not _has_shape(plain(value), shape):
                count = " times ".join(map(str, shape))
                yield Fault(key, value, f"{count} finite numbers" if shape else "a finite number")
            elif key == "axis" and not any(value):
                yield Fault(key, value, "a vector that is not zero")

    def joints(self) -> tuple[Constraint, ...]:
        """Return the joints, without driver."""
        raise NotImplementedError

    def assemble(self, value: float, branch: Branch | str = Branch.OPEN) -> dict[str, Place]:
        """Return the coordinates of all bodies at an input [rad], in closed form.

        Raises
        ------
        DoesNotAssemble
            With the gap [m], or NaN where none is known.
        """
        check("value", "a finite number [rad]", value, is_finite(value))
        return dict(self._poses(value, member(Branch, branch, "branch").sign))

    def plot(self, value: float = 0.0, branch: Branch | str = Branch.OPEN) -> Picture:
        """Return a picture of the linkage at an input [rad], by its closed form; a notebook shows it.

        Raises
        ------
        DoesNotAssemble
            As `assemble` does.
        """
        scene = self.scene(law=Polynomial(coefficients=(value,)), times=(0.0,), branch=branch)
        return pictured(scene, self.assemble(value, branch))

    def _poses(self, value: float, sign: int) -> Iterator[tuple[str, Place]]:
        raise NotImplementedError

    def _cosine(self, value: float, x: float, gap: float = math.nan) -> float:
        """Return the angle in [0, pi] of a cosine; what rounding leaves beyond 1 counts as 1, else there is a gap."""
        if abs(x) > 1 + 2.0**-44:
            raise DoesNotAssemble(self, self.DRIVEN, value, gap)
        return math.acos(max(-1.0, min(1.0, x)))

    def drivers(self, law: Law) -> tuple[Driver, ...]:
        """Return the drivers that make the input follow a law."""
        return (SpatialAngleDriver(name="driver", joint=self.DRIVEN, **law_keys(law)),)

    def scene(
        self,
        speed: float = 2.0,
        turns: float = 1,
        samples: int = 361,
        branch: Branch | str = Branch.OPEN,
        *,
        start: float = 0.0,
        law: Law | None = None,
        times: Sequence[float] | None = None,
        effects: Collection[Effect | str] = tuple(Effect),
        evidence: Collection[Evidence | str] = tuple(Evidence),
        name: str | None = None,
    ) -> Scene:
        """Return a scene that starts on a branch.

        Parameters
        ----------
        speed, turns, samples, branch, start, law, times, effects, evidence, name
            As in `refkin.FourBar.scene`.
        """
        law, times, values = law_and_times(speed, turns, samples, start, law, times)
        poses = self.assemble(values[0], branch)
        bodies = (Body(name=body, estimate=tuple(round(x, ROUGH) for x in pose)) for body, pose in poses.items())
        mechanism = Mechanism(tuple(bodies), self.joints(), self.drivers(law))
        branch = member(Branch, branch, "branch")
        name = f"{type(self).__name__} {branch}" if name is None else name
        return scene_of(mechanism, times, name, effects, evidence)
