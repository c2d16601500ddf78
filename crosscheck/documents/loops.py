"""Mechanisms as the source documents write their loops, with the symbols of those documents.

Links 2, 3, 4 of a four-bar are crank, coupler and rocker; theta are angles against the fixed x axis [rad]. An input is
a number or a law of time: with `Polynomial(coefficients=(0.0, 1.0))` time is the input itself. Lengths may be in any
one unit. `crosscheck.engines.vector_loop` is the method itself.
"""

from __future__ import annotations

from collections.abc import Mapping

from crosscheck.engines.vector_loop import LoopSystem, LoopVector, Variable
from crosscheck.engines.vector_loop.vectors import variable
from refkin.motion_laws import Law

Input = Law | float


def four_bar(
    ground: float,
    crank: float,
    coupler: float,
    rocker: float,
    given: Input,
    *,
    driven: str = "theta2",
    ground_angle: float = 0.0,
) -> LoopSystem:
    """Return r2 e^(i theta2) + r3 e^(i theta3) - r4 e^(i theta4) - r1 e^(i theta1) = 0 (ME581 notes).

    Parameters
    ----------
    ground, crank, coupler, rocker : float
        Lengths r1, r2, r3, r4.
    given, driven : Law or float, str
        Which of theta2, theta3, theta4 is the input, and its value; the other two are the unknowns, in this order.
    ground_angle : float
        theta1 [rad].
    """
    angles = _angles(("theta2", "theta3", "theta4"), given, driven)
    loop = (
        LoopVector(crank, angle=angles["theta2"]),
        LoopVector(coupler, angle=angles["theta3"]),
        LoopVector(-rocker, angle=angles["theta4"]),
        LoopVector(-ground, angle=Variable(ground_angle)),
    )
    return LoopSystem(_free(angles), [loop])


def slider_crank(
    crank: float, rod: float, offset: float, given: Input, *, driven: str = "theta2", guide_angle: float = 0.0
) -> LoopSystem:
    """Return l2 e^(i theta2) + l3 e^(i theta3) - s - i h = 0, in axes along the guide (notes on Shabana, 3.6).

    theta2 and theta3 are angles against the fixed x axis.

    Parameters
    ----------
    crank, rod, offset : float
        Lengths l2, l3, and h, by which the guide lies to the left of the crank pivot.
    given, driven : Law or float, str
        Which of theta2, theta3, s is the input, and its value; the other two are the unknowns, in this order.
    guide_angle : float
        Of the guide against the x axis [rad].
    """
    angles = _angles(("theta2", "theta3", "s"), given, driven)
    guide = Variable(guide_angle)
    loop = (
        LoopVector(crank, angle=angles["theta2"]),
        LoopVector(rod, angle=angles["theta3"]),
        LoopVector(-1.0, angles["s"], guide),
        LoopVector(-1j * offset, angle=guide),
    )
    return LoopSystem(_free(angles), [loop])


def inverted_slider_crank(
    ground: float, crank: float, offset: float, given: Input, *, driven: str = "theta2"
) -> LoopSystem:
    """Return l2 e^(i theta2) - l1 - (s + i h) e^(i theta3) = 0: a crank whose pin slides on a rod that turns.

    The rod turns about a pivot
    at distance `ground` from the crank's, its line passes the pivot at `offset` h to the left. Without offset this is
    the Coriolis example of the notes on Shabana, with s the place of the block on rod 3.

    Parameters
    ----------
    ground, crank, offset : float
        Lengths l1, l2, h.
    given, driven : Law or float, str
        As for `slider_crank`.
    """
    angles = _angles(("theta2", "theta3", "s"), given, driven)
    loop = (
        LoopVector(crank, angle=angles["theta2"]),
        LoopVector(-ground),
        LoopVector(-1.0, angles["s"], angles["theta3"]),
        LoopVector(-1j * offset, angle=angles["theta3"]),
    )
    return LoopSystem(_free(angles), [loop])


def slotted(a1: float, a2: float, a4: float, a5: float, b1: float, c1: float, given: Input) -> LoopSystem:
    """Return the two coupled loops of METU 3.9 in the unknowns theta14, theta15, s4, s6; theta12 is the input.

    b1 - i c1 - a2 e^(i theta12) + a5 e^(i theta15) + s4 e^(i theta14) = 0
    b1 - i a1 - s6 + a5 e^(i theta15) + a4 e^(i theta14) = 0

    Parameters
    ----------
    a1, a2, a4, a5, b1, c1 : float
        Lengths.
    given : Law or float
        theta12 [rad].
    """
    theta14, theta15, s4, s6 = (Variable(unknown=name) for name in ("theta14", "theta15", "s4", "s6"))
    link5 = LoopVector(a5, angle=theta15)
    first = (LoopVector(complex(b1, -c1)), LoopVector(-a2, angle=variable(given)), link5, LoopVector(1.0, s4, theta14))
    second = (LoopVector(complex(b1, -a1)), LoopVector(-1.0, s6), link5, LoopVector(a4, angle=theta14))
    return LoopSystem(("theta14", "theta15", "s4", "s6"), [first, second])


RAPIER_LENGTHS: Mapping[str, float] = {
    "a1": 340.0,
    "b1": 520.0,
    "d1": 623.0,
    "a2": 250.0,
    "a3": 1225.0,
    "a4": 350.0,
    "a5": 600.0,
    "b4": 600.0,
    "a6": 1100.0,
}
"""Of the rapier drive in METU 3.9 [mm]."""


def rapier(reading: str, given: Input) -> LoopSystem:
    """Return the two coupled loops of the six-link rapier drive in the unknowns theta13, theta14, theta15, s16.

    A0 is the origin, C0 = -d1 - i a1, D = C + c e^(i theta14), E = D + a6 on the guide at height g:

    a2 e^(i theta12) + a3 e^(i theta13) - a4 e^(i theta14) - a5 e^(i theta15) - C0 = 0
    C0 + a5 e^(i theta15) + c e^(i theta14) + a6 - s16 - o - i g = 0

    The source gives lengths and a guess alone, its figure is lost, so two readings are inferred. "R1": C lies between B
    and D, the guide below A0, s16 is counted from C0: c = a4 - b4, g = -b1, o = -d1. "R2": B lies between C and D, the
    guide above A0, s16 is counted from A0: c = a4 + b4, g = b1, o = 0. `given` is theta12.
    """
    if reading not in ("R1", "R2"):
        raise ValueError(f"reading: expected R1 or R2, got {reading!r}")
    long, first_reading = RAPIER_LENGTHS, reading == "R1"
    names = ("theta13", "theta14", "theta15", "s16")
    theta13, theta14, theta15, s16 = (Variable(unknown=name) for name in names)
    c0 = complex(-long["d1"], -long["a1"])
    to_d = long["a4"] - long["b4"] if first_reading else long["a4"] + long["b4"]
    counted_from = complex(-long["d1"], -long["b1"]) if first_reading else complex(0.0, long["b1"])
    first = (
        LoopVector(long["a2"], angle=variable(given)),
        LoopVector(long["a3"], angle=theta13),
        LoopVector(-long["a4"], angle=theta14),
        LoopVector(-long["a5"], angle=theta15),
        LoopVector(-c0),
    )
    second = (
        LoopVector(c0 + long["a6"] - counted_from),
        LoopVector(long["a5"], angle=theta15),
        LoopVector(to_d, angle=theta14),
        LoopVector(-1.0, s16),
    )
    return LoopSystem(names, [first, second])


def _angles(names: tuple[str, ...], given: Input, driven: str) -> dict[str, Variable]:
    if driven not in names:
        raise ValueError(f"driven: expected one of {', '.join(names)}, got {driven!r}")
    return {name: variable(given) if name == driven else Variable(unknown=name) for name in names}


def _free(variables: Mapping[str, Variable]) -> tuple[str, ...]:
    return tuple(v.unknown for v in variables.values() if v.unknown is not None)
