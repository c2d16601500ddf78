"""Motion laws that stay between two values, each as a value or as a rate; and what a driver holds.

That is the input itself, or a coordinate of a pin that goes one way while the input does.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn
from scipy.interpolate import CubicSpline

from crosscheck.strategies.linkages import AnyLinkage
from crosscheck.strategies.variety import LinkageModel
from refkin.joints import GROUND, AngleDriver, DistanceDriver, Driver, Pair, XDriver, YDriver
from refkin.motion_laws import Integral, Law, Polynomial, Sinusoid, Table
from refkin.scenes.linkages import SliderCrank, law_keys

KNOTS = 6


class LawKind(StrEnum):
    """The kinds of motion laws that are drawn."""

    POLYNOMIAL = "polynomial"
    """Of degree one to three."""
    SINUSOID = "sinusoid"
    """An offset and one harmonic."""
    TABLE = "table"
    """A spline through a few values."""


KINDS = st.sampled_from(LawKind)
CONTROLS = st.lists(st.floats(0.125, 0.875), max_size=2)
CROWDING = st.just(1.0) | st.floats(0.75, 1.375)
DISTURBANCES = st.lists(st.floats(-0.125, 0.125), min_size=KNOTS, max_size=KNOTS)
RATES = st.lists(st.floats(1.0, 1.5), min_size=KNOTS, max_size=KNOTS)


@st.composite
def motion_laws(draw: DrawFn, *, first: float, last: float, duration: float, monotone: bool = False) -> Law:
    """Return laws whose values over [0, duration] lie between `first` and `last`.

    A monotone law goes from `first` at 0 to `last` at `duration`, with a rate that is nowhere 0; others may oscillate.
    A law that is given as a rate comes as `Integral`.

    Examples from this strategy shrink towards a linear polynomial that is given as a value.

    Parameters
    ----------
    first, last : float
        Bounds of its values; a monotone one begins and ends there [m or rad].
    duration : float
        Until when [s].
    monotone : bool
        Whether its rate is nowhere 0.
    """
    kind = draw(KINDS, label="law")
    as_rate = draw(st.booleans(), label="given as a rate")
    if kind is LawKind.POLYNOMIAL:
        return _polynomial(_draw_cubic(draw), first, last, duration, as_rate)
    if kind is LawKind.SINUSOID:
        return _draw_sinusoid(draw, first, last, duration, monotone, as_rate)
    power = draw(CROWDING, label="crowding of knots")  # evenly spaced over [0, duration], or closer at one end
    argument = [duration * (k / (KNOTS - 1)) ** power for k in range(KNOTS)]
    if as_rate:
        return _draw_rate_table(draw, argument, first, last)
    return _draw_table(draw, argument, first, last, monotone)


def _draw_cubic(draw: DrawFn) -> list[float]:
    """Draw coefficients of a polynomial of tau in [0, 1], of degree 1 to 3, that rises from 0 to 1 without a stop.

    In Bernstein form with control values 0, b, c, 1 its rate is 3 (b (1-tau)^2 + 2 (c-b) tau (1-tau) + (1-c) tau^2):
    above 0 while b - c < sqrt(b (1-c)), and so for all b, c in [1/8, 7/8].
    """
    inner = draw(CONTROLS, label="control values")
    if not inner:
        return [0.0, 1.0]
    if len(inner) == 1:
        return [0.0, 2 * inner[0], 1 - 2 * inner[0]]
    b, c = inner
    return [0.0, 3 * b, 3 * c - 6 * b, 1 + 3 * b - 3 * c]


def _polynomial(unit: list[float], first: float, last: float, duration: float, as_rate: bool) -> Law:
    c = [a * (last - first) / duration**k for k, a in enumerate(unit)]
    if as_rate:
        return Integral(rate=Polynomial(coefficients=tuple(k * a for k, a in enumerate(c))[1:]), initial=first)
    return Polynomial(coefficients=(first, *c[1:]))


def _draw_sinusoid(draw: DrawFn, first: float, last: float, duration: float, monotone: bool, as_rate: bool) -> Law:
    """Draw a wave between the two values; monotone as long as it sweeps less than half a turn, around its zero."""
    sweep = draw(st.floats(0.5, 2.75) if monotone else st.floats(0.5, 6.25), label="angle swept")
    phase = -sweep / 2 if monotone else draw(st.floats(-3.125, 3.125), label="phase")
    amplitude = (last - first) / 2 / (math.sin(sweep / 2) if monotone else 1.0)
    middle, frequency = (first + last) / 2, sweep / duration
    if not as_rate:
        return Sinusoid(offset=middle, amplitude=amplitude, angular_frequency=frequency, phase=phase)
    rate = Sinusoid(amplitude=amplitude * frequency, angular_frequency=frequency, phase=phase + math.pi / 2)
    return Integral(rate=rate, initial=middle + amplitude * math.sin(phase))


def _draw_table(draw: DrawFn, argument: list[float], first: float, last: float, monotone: bool) -> Law:
    """Draw a cubic sampled at knots (its not-a-knot spline is that cubic); or that, or a closed wave, disturbed."""
    steps = [t / argument[-1] for t in argument]
    periodic = not monotone and draw(st.booleans(), label="periodic")
    if periodic:
        value = [(1 - math.cos(math.tau * step)) / 2 for step in steps]
    else:
        unit = _draw_cubic(draw)
        value = [sum(c * step**k for k, c in enumerate(unit)) for step in steps]
    if not monotone:
        value = [v + by for v, by in zip(value, draw(DISTURBANCES, label="disturbances"), strict=True)]
        value[-1] = value[0] if periodic else value[-1]
        value = _fitted(value, CubicSpline(argument, value, bc_type="periodic" if periodic else "not-a-knot"))
    value = [first + (last - first) * v for v in value]
    return Table(argument=tuple(argument), value=tuple(value), periodic=periodic)


def _fitted(value: list[float], spline: Any) -> list[float]:
    """Return the values scaled so that their spline just fits into [0, 1]: interpolation is linear in the values."""
    turning = [float(t) for t in spline.derivative().roots(extrapolate=False) if math.isfinite(t)]
    extremes = spline([*spline.x[[0, -1]], *turning])
    low, high = float(min(extremes)), float(max(extremes))
    return [(v - low) / (high - low) for v in value]


def _draw_rate_table(draw: DrawFn, argument: list[float], first: float, last: float) -> Law:
    """Draw a positive rate; its integral is scaled to go from `first` to `last`.

    A spline of values in 1.25 +- 0.25 stays within 0.25 L of 1.25, so above 0 while L < 5. On these knots the Lebesgue
    constant L of the not-a-knot spline is below 3.1.
    """
    rate = draw(RATES, label="rates")
    scale = (last - first) / float(CubicSpline(argument, rate).integrate(0.0, argument[-1]))
    return Integral(rate=Table(argument=tuple(argument), value=tuple(scale * r for r in rate)), initial=first)


WIDEST = 1.0
"""Largest range of the crank [rad] over which a coordinate of its pin is driven, so that it stays off its extremes."""


def _itself(value: float) -> float:
    return value


@dataclass(frozen=True)
class InputDriver:
    """How an input is held: `to` gives the driven coordinate at an input, `back` the input at a coordinate.

    It is the input's angle; or, of a pin, x, y or, with an anchor, the distance from a point of the ground.
    """

    kind: type[Any] = AngleDriver
    pin: str = ""
    anchor: Pair | None = None
    to: Callable[[float], float] = _itself
    back: Callable[[float], float] = _itself

    def driver(self, model: LinkageModel, pair: tuple[str, str], law: Law, turned: float) -> Driver:
        """Return the driver of the pair (driven, relative_to) in a model whose frames turn their angle by `turned`."""
        if not self.pin:
            held: dict[str, Any] = {"body": pair[0], "relative_to": pair[1], **law_keys(moved(law, turned))}
        else:
            body, point = model.pins[self.pin]
            held = {"body": body, "point": point, **law_keys(law)}
            if self.anchor is not None:
                ends = {"body_i": GROUND, "point_i": self.anchor, "body_j": body, "point_j": point}
                held = {**ends, **law_keys(law)}
        driver: Driver = self.kind(name="driver", **held)
        return driver


def crank_drive(linkage: AnyLinkage, kind: str, middle: float) -> InputDriver:
    """Return the drive of a crank by its angle, or by x, y (whichever changes faster) or a distance of its pin.

    The distance is that from a point 2 radii from the centre, a quarter turn ahead of the pin at `middle`.

    Parameters
    ----------
    linkage, kind
    middle : float
        The crank's angle half-way [rad].
    """
    r = linkage.crank
    if kind == "coordinate":
        is_x = abs(math.sin(middle)) >= abs(math.cos(middle))
        axis, pivot = (0.0, linkage.origin[0]) if is_x else (math.pi / 2, linkage.origin[1])

        def angle(coordinate: float) -> float:
            corner = math.acos((coordinate - pivot) / r)
            return nearest(middle, axis + corner, axis - corner)

        return InputDriver(
            XDriver if is_x else YDriver, "crank", to=lambda phi: pivot + r * math.cos(phi - axis), back=angle
        )
    if kind == "distance":
        anchor = complex(*linkage.origin) + cmath.rect(2 * r, middle + math.pi / 2)
        return InputDriver(
            DistanceDriver,
            "crank",
            (anchor.real, anchor.imag),
            to=lambda phi: r * abs(2 - cmath.rect(1.0, phi - middle - math.pi / 2)),
            back=lambda distance: middle + math.pi / 2 - math.acos((5 - (distance / r) ** 2) / 4),
        )
    return InputDriver()


def slider_drive(linkage: SliderCrank, kind: str) -> InputDriver:
    """Return the drive of a slider by x or y (whichever changes faster) or a distance of the wrist pin."""
    if kind == "distance":
        behind, aside = -1.5 * (linkage.crank + linkage.rod), linkage.crank
        return InputDriver(
            DistanceDriver,
            "slider",
            linkage.place(complex(behind, linkage.offset + aside)),
            to=lambda s: math.hypot(s - behind, aside),
            back=lambda distance: behind + math.sqrt(distance**2 - aside**2),
        )
    x, y = linkage.place(complex(0.0, linkage.offset))
    cosine, sine = math.cos(linkage.angle), math.sin(linkage.angle)
    is_x = abs(cosine) >= abs(sine)
    foot, slope = (x, cosine) if is_x else (y, sine)
    return InputDriver(
        XDriver if is_x else YDriver,
        "slider",
        to=lambda s: foot + slope * s,
        back=lambda coordinate: (coordinate - foot) / slope,
    )


def moved(law: Law, by: float) -> Law:
    """Return the law plus a constant."""
    if isinstance(law, Integral):
        return replace(law, initial=law.initial + by)
    if isinstance(law, Polynomial):
        return replace(law, coefficients=(law.coefficients[0] + by, *law.coefficients[1:]))
    if isinstance(law, Sinusoid):
        return replace(law, offset=law.offset + by)
    assert isinstance(law, Table)
    return replace(law, value=tuple(v + by for v in law.value))


def nearest(middle: float, *angles: float) -> float:
    """Return the one of the angles, full turns added, that is nearest to `middle`."""
    turned = (angle + math.tau * round((middle - angle) / math.tau) for angle in angles)
    return min(turned, key=lambda angle: abs(angle - middle))
