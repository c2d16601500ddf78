"""What linkages share: placement, validation, the scene of a linkage that follows a motion law.

Vectors of the plane are complex numbers in the linkage's own frame: crank pivot at 0, x along the ground link or along
the guide; `origin` and `angle` place that frame on the ground. Angles passed in and out are those of the bodies (phi of
body `driven` minus phi of body `relative_to`), as an angle driver has them. Body frames sit in the middle of a link, on
the wrist pin of a slider, on the pivot of a lever; their x axis points along the link.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from numbers import Real
from typing import Any, ClassVar, TypeVar, cast

import numpy as np

from refkin.errors import Fault, InvalidScene
from refkin.joints import GROUND, PLANE, SPACE, AngleDriver, Constraint, Driver, Pair
from refkin.joints.annotations import check, finite_faults, is_real, plain, type_faults
from refkin.model import Body, Effect, Evidence, Mechanism, Member, Scene
from refkin.motion import Producer, Route, Status, engine_motion
from refkin.motion_laws import Integral, Law, Polynomial
from refkin.output import Drawing, Picture
from refkin.scenes import MOST_TIMES
from refkin.scenes.linkages.closures import DoesNotAssemble, Interval, covers

AnyPose = TypeVar("AnyPose", bound=tuple[float, ...])
Pose = dict[str, tuple[float, float, float]]
"""Body -> (x [m], y [m], phi [rad]) in the ground frame."""

CLOSED_FORM = Route(name="closed form", residual_by="closed form")
AMember = TypeVar("AMember", bound=Member)


class Branch(Member):
    """The two assemblies of a linkage at one input; each linkage says which one is OPEN."""

    OPEN = "open"
    """The one that the linkage calls so."""
    CROSSED = "crossed"
    """The other one."""

    @property
    def sign(self) -> int:
        """1 for OPEN, -1 for CROSSED."""
        return 1 if self is Branch.OPEN else -1


def pictured(scene: Scene, pose: Mapping[str, Sequence[float]]) -> Picture:
    """Return the picture of a scene of one time at a pose, the coordinates of each body."""
    q = np.array([x for body in scene.wanted for x in pose[body]])[:, None]
    producer = Producer.of_refkin("closed form", CLOSED_FORM)
    return Picture(Drawing(scene, engine_motion(scene.times, scene.wanted, q, None, None, (Status.OK,), producer)))


class Shown:
    """What has lengths, and shows itself: as a picture in a notebook, and as text that can be pasted."""

    LENGTHS: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        faults = list(self._faults())
        if faults:
            raise InvalidScene(faults, type(self).__name__)

    def _faults(self) -> Iterator[Fault]:
        for key in self.LENGTHS:
            value = getattr(self, key)
            if not (is_finite(value) and value > 0):
                yield Fault(key, value, "a length above 0 [m]")

    def plot(self) -> Picture:
        """Return a picture."""
        raise NotImplementedError

    def _repr_svg_(self) -> str | None:
        try:
            return self.plot().svg
        except DoesNotAssemble:
            return None

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        """Show the text of `repr`, where IPython and Hypothesis would show class variables as arguments."""
        printer.text(repr(self))


@dataclass(frozen=True)
class Linkage(Shown):
    """A linkage with one input: the coordinate that a driver holds, phi of `driven` against `relative_to` or a slide.

    Raises
    ------
    InvalidScene
        If a length is not a finite number above 0, or an offset or the placement is not finite.
    """

    origin: Pair = field(default=(0.0, 0.0), kw_only=True)
    angle: float = field(default=0.0, kw_only=True)

    INPUTS: ClassVar[tuple[tuple[str, str], ...]]
    """The pairs (driven, relative_to) that can be the input."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in (*self.LENGTHS, "offset", "angle"):
            if hasattr(self, key):
                object.__setattr__(self, key, float(getattr(self, key)))
        object.__setattr__(self, "origin", (float(self.origin[0]), float(self.origin[1])))

    def _faults(self) -> Iterator[Fault]:
        yield from super()._faults()
        for key in ("offset", "angle"):
            if not is_finite(getattr(self, key, 0.0)):
                yield Fault(key, getattr(self, key), "a finite number")
        if not (isinstance(self.origin, Sequence) and len(self.origin) == 2 and all(map(is_finite, self.origin))):
            yield Fault("origin", self.origin, "two finite numbers [m]")

    @property
    def reach(self) -> float:
        """Sum of all lengths [m]: the scale of round-off in the closed forms."""
        return math.fsum(abs(getattr(self, key, 0.0)) for key in (*self.LENGTHS, "offset"))

    @property
    def slack(self) -> float:
        """Distance from the change point [m]: above 0 a link makes full turns, below 0 none does; 0 exactly there."""
        raise NotImplementedError

    def input_range(self, driven: str = "crank", relative_to: str = GROUND) -> tuple[Interval, ...]:
        """Return the intervals of the input [rad, or m] in which the linkage assembles.

        An angle that makes full turns has the one interval (-inf, inf); other intervals of angles repeat every 2 pi.
        """
        raise NotImplementedError

    def closure_margin(self, value: float, driven: str = "crank", relative_to: str = GROUND) -> float:
        """Return how far the linkage is from a pose where its last two links lie in one line [m].

        0 at a limit position; negative where the linkage does not assemble: minus the gap.
        """
        raise NotImplementedError

    def assemble(
        self, value: float, branch: Branch | str = Branch.OPEN, *, driven: str = "crank", relative_to: str = GROUND
    ) -> Pose:
        """Return the pose of all bodies at an input.

        Raises
        ------
        DoesNotAssemble
            With the gap [m], where it is above round-off.
        """
        self._check_input(driven, relative_to)
        check("value", "a finite number [rad, or m]", value, is_finite(value))
        margin = self.closure_margin(value, driven, relative_to)
        # The margin is a sum of lengths and of one distance, each right to a few units 2^-53 of the reach.
        if not margin >= -8 * 2.0**-53 * self.reach:
            raise DoesNotAssemble(self, driven, value, -margin)
        return self._pose(value, member(Branch, branch, "branch").sign, driven, relative_to)

    def _pose(self, value: float, sign: int, driven: str, relative_to: str) -> Pose:
        raise NotImplementedError

    def joints(self) -> tuple[Constraint, ...]:
        """Return the joints, without driver."""
        raise NotImplementedError

    def driver(self, law: Law, driven: str = "crank", relative_to: str = GROUND) -> Driver:
        """Return the driver that makes the input follow a law (a rate as `Integral`)."""
        self._check_input(driven, relative_to)
        return AngleDriver(name="driver", body=driven, relative_to=relative_to, **law_keys(law))

    def mechanism(self, driver: Driver, estimate: Pose | None = None) -> Mechanism:
        """Return the mechanism with a driver of any kind on its bodies."""
        names = dict.fromkeys(body for joint in self.joints() for body in joint.bodies if body != GROUND)
        bodies = tuple(Body(name=name, estimate=(estimate or {}).get(name)) for name in names)
        return Mechanism(bodies, self.joints(), (driver,))

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
        driven: str = "crank",
        relative_to: str = GROUND,
        effects: Collection[Effect | str] = tuple(Effect),
        evidence: Collection[Evidence | str] = tuple(Evidence),
        name: str | None = None,
    ) -> Scene:
        """Return a scene that starts on a branch.

        Parameters
        ----------
        speed, turns, samples, start : float, float, int, float
            The input turns from `start` [rad] at constant `speed` [rad/s], that many turns, over so many times.
        branch : Branch or str
            The assembly at the first time.
        law : Law, optional
            Instead of those four: any motion law of the input, a rate as `Integral(rate=..., initial=...)`; with times.
        times : sequence of float, optional
            Instead of `turns` and `samples`: the times [s].
        driven, relative_to : str
            What the law holds, one of `INPUTS`. For a slider: x of the wrist pin in the ground frame, or its y if the
            guide is nearer to the vertical.

        Raises
        ------
        InvalidScene
            Also if the linkage cannot follow the law: the message says what range its input has.
        """
        self._check_input(driven, relative_to)
        branch = member(Branch, branch, "branch")
        path = "turns" if law is None else "law"
        law, times, values = law_and_times(speed, turns, samples, start, law, times)
        values = [self._input(value, driven) for value in values]
        self._check_range(values, driven, relative_to, path)
        pose = self.assemble(values[0], branch, driven=driven, relative_to=relative_to)
        driver = self.driver(law, driven, relative_to)
        size = self.mechanism(driver).size()
        margin = self.closure_margin(values[0], driven, relative_to)
        mechanism = self.mechanism(driver, rough(pose, size, margin))
        name = f"{type(self).__name__} {branch}" if name is None else name
        return scene_of(mechanism, times, name, effects, evidence)

    def plot(
        self,
        value: float | None = None,
        branch: Branch | str = Branch.OPEN,
        *,
        driven: str = "crank",
        relative_to: str = GROUND,
    ) -> Picture:
        """Return a picture of the linkage at an input, by its closed form; a notebook shows it.

        Parameters
        ----------
        value : float, optional
            The input [rad, or m]; by default one of those at which the linkage assembles.
        branch, driven, relative_to
            As in `assemble`.

        Raises
        ------
        DoesNotAssemble
            With the gap [m].
        """
        self._check_input(driven, relative_to)
        if value is None:
            low, high = next(iter(self.input_range(driven, relative_to)), (0.0, 0.0))
            value = math.pi / 3 if math.isinf(low) else (low + high) / 2
        pose = self.assemble(value, branch, driven=driven, relative_to=relative_to)
        mechanism = self.mechanism(self.driver(Polynomial(coefficients=(value,)), driven, relative_to), pose)
        scene = Scene(mechanism=mechanism, times=(0.0,), name=type(self).__name__)
        return pictured(scene, pose)

    def _input(self, coordinate: float, driven: str) -> float:
        """Return the input at which the coordinate of its driver has this value."""
        return coordinate

    def _check_input(self, driven: str, relative_to: str) -> None:
        if not (isinstance(driven, str) and isinstance(relative_to, str) and (driven, relative_to) in self.INPUTS):
            known = "; ".join(d if r == GROUND else f"{d} relative to {r}" for d, r in self.INPUTS)
            raise InvalidScene([Fault("driven", f"{driven} relative to {relative_to}", known)], type(self).__name__)

    def _check_range(self, values: list[float], driven: str, relative_to: str, path: str) -> None:
        slide = driven == "slider"
        intervals = self.input_range(driven, relative_to)
        if not covers(intervals, min(values), max(values), math.inf if slide else math.tau):
            words = " or ".join(f"[{a:.6g}, {b:.6g}]" for a, b in intervals)
            expected = f"the input ({driven}) within {words} {'m' if slide else 'rad'}, where the linkage assembles"
            keys = [key for key in (*self.LENGTHS, "offset") if hasattr(self, key)]
            apart = Fault(", ".join(keys), [getattr(self, key) for key in keys], "lengths that assemble at some input")
            asked = Fault(path, (min(values), max(values)), expected)
            raise InvalidScene([asked if words else apart], type(self).__name__)

    def place(self, z: complex) -> Pair:
        """Return a point of the linkage's own frame in the ground frame [m]."""
        turned = z * cmath.rect(1.0, self.angle)
        return self.origin[0] + turned.real, self.origin[1] + turned.imag


def law_keys(law: Law) -> dict[str, Any]:
    """Return the keys by which a driver takes a law: `law`, or `rate_law` and `initial` for an integral."""
    return {"rate_law": law.rate, "initial": law.initial} if isinstance(law, Integral) else {"law": law}


def rough(pose: Mapping[str, AnyPose], size: float, margin: float) -> dict[str, AnyPose]:
    """Return an assembled pose rounded to an estimate: two decimals of the size, more where two assemblies are near.

    They are about sqrt(margin / size) apart; the estimate stays within a twentieth of that.

    Parameters
    ----------
    pose : mapping of str to tuple
        Body -> its coordinates [m, rad].
    size, margin : float
        Of the linkage, and how far it is from one that does not close [m].
    """
    near = math.sqrt(max(margin / size, 1e-20)) / 10
    decimals = max(2, math.ceil(-math.log10(near)))
    lengths = decimals - math.floor(math.log10(size))
    turns = {kind.width: kind.turns for kind in (PLANE, SPACE)}
    return {
        body: cast(
            AnyPose, tuple(round(x, decimals if turn else lengths) for x, turn in zip(q, turns[len(q)], strict=True))
        )
        for body, q in pose.items()
    }


def member(kind: type[AMember], value: str, key: str) -> AMember:
    """Return the member of an enumeration with that value.

    Parameters
    ----------
    kind : type
        The enumeration.
    value, key : str
        What was given, and the argument's name.

    Raises
    ------
    InvalidScene
        If there is none; names key, value, and the members there are.
    """
    try:
        return kind(value)
    except ValueError:
        raise InvalidScene([Fault(key, value, " or ".join(kind))], "linkage") from None


def scene_of(
    mechanism: Mechanism,
    times: Sequence[float],
    name: str,
    effects: Collection[Effect | str],
    evidence: Collection[Evidence | str],
) -> Scene:
    """Return the scene of a mechanism at times [s]; effects and evidence by their names, too.

    Parameters
    ----------
    mechanism : Mechanism
    times : sequence of float
        Increasing [s].
    name : str
        Of the scene.
    effects, evidence : collection of str
        What it calls for.
    """
    for key, words in (("effects", effects), ("evidence", evidence)):
        if isinstance(words, str) or not isinstance(words, Iterable):
            raise InvalidScene([Fault(key, words, "a list of words")], "linkage")
    return Scene(
        mechanism=mechanism,
        times=tuple(times),
        name=name,
        effects=frozenset(member(Effect, effect, "effects") for effect in effects),
        evidence=frozenset(member(Evidence, kind, "evidence") for kind in evidence),
    )


def law_and_times(
    speed: float, turns: float, samples: int, start: float, law: Law | None, times: Sequence[float] | None
) -> tuple[Law, list[float], list[float]]:
    """Return a law, its times and its values then, or those of a constant speed; InvalidScene for what makes none.

    Parameters
    ----------
    speed, start : float
        Rate and first value of the input [rad or m, per second].
    turns, samples : float, int
        How far it goes [1 turn, or m], at how many times.
    law, times : Law, sequence of float; optional
        In place of all of these; times in [s].
    """
    given = None if times is None else [*times] if isinstance(times, Iterable) else []
    counted = f"a whole number from 2 to {MOST_TIMES}"
    asked = (
        ("speed", speed, is_finite(speed) and speed, "a finite number that is not 0 [rad/s]"),
        ("start", start, is_finite(start), "a finite angle [rad]"),
        ("turns", turns, given or (is_finite(turns) and turns > 0), "a number above 0"),
        ("samples", samples, given or (isinstance(samples, int) and 1 < samples <= MOST_TIMES), counted),
    )
    faults = [Fault(key, value, expected) for key, value, fits, expected in asked if not fits] if law is None else []
    if law is not None:
        law = plain(law)
        faults += _law_faults(law)
    if given == [] or (given is None and law is not None):
        faults.append(Fault("times", times, "one time [s] or more"))
    unused = [("law", "speed", speed, 2.0), ("law", "start", start, 0.0)] if law is not None else []
    unused += [("times", "turns", turns, 1), ("times", "samples", samples, 361)] if given else []
    faults += [Fault(key, x, f"no {key} beside `{other}`") for other, key, x, default in unused if x != default]
    faults += [Fault("times", t, "finite numbers [s]") for t in given or () if not is_finite(t)][:1]
    if faults:
        raise InvalidScene(faults, "linkage")
    last = 0.0 if given else math.tau * turns / abs(speed)
    if not math.isfinite(last):
        raise InvalidScene([Fault("turns", turns, f"so few that they end at some time, at {speed!r} rad/s")], "linkage")
    law = Polynomial(coefficients=(float(start), float(speed))) if law is None else law
    at = [float(t) for t in given] if given else np.linspace(0.0, last, samples).tolist()
    values = [float(law(t)) for t in at]
    for t, value in zip(at, values, strict=True):
        if not math.isfinite(value):
            raise InvalidScene([Fault("law", value, f"a finite number at t = {t!r}")], "linkage")
    return law, at, values


def _law_faults(law: Any) -> list[Fault]:
    """Return what is wrong with a law: with the types of its numbers, or else with their values."""
    for key, one in (("law", law), ("law.rate", getattr(law, "rate", law))):
        if not hasattr(one, "faults"):
            return [Fault(key, one, "a motion law, as Polynomial")]
    path = "driver[0].law"  # as a scene tells it
    faults = [*type_faults(path, law)] if is_dataclass(law) else []
    faults = faults or [*finite_faults(path, law), *law.faults(path)]
    return [replace(fault, path=fault.path.removeprefix("driver[0].")) for fault in faults]


def is_finite(value: object) -> bool:
    """Return whether a value is a number that float64 holds."""
    return isinstance(value, Real) and not isinstance(value, bool) and is_real(value) and math.isfinite(value)
