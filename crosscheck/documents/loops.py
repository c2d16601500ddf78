"""Mechanisms as the source documents write their loops, with the symbols of those documents.

Links 2, 3, 4 of a four-bar are crank, coupler and rocker; theta are angles against the fixed x axis [rad]. An input is
a number or a law of time: with `Polynomial(coefficients=(0.0, 1.0))` time is the input itself. Lengths may be in any
one unit. `crosscheck.engines.vector_loop` is the method itself.
"""

from __future__ import annotations

from crosscheck.documents.systems.metu import Rapier, Slotted
from crosscheck.engines.vector_loop import LoopSystem, LoopVector, Variable
from crosscheck.engines.vector_loop.vectors import variable
from refkin.motion_laws import Law

Input = Law | float


def four_bar(ground: float, crank: float, coupler: float, rocker: float, given: Input) -> LoopSystem:
    """Return r2 e^(i theta2) + r3 e^(i theta3) - r4 e^(i theta4) - r1 = 0 in theta3, theta4 (ME581 notes).

    Parameters
    ----------
    ground, crank, coupler, rocker : float
        Lengths r1, r2, r3, r4.
    given : Law or float
        theta2 [rad].
    """
    theta3, theta4 = Variable(unknown="theta3"), Variable(unknown="theta4")
    link2 = LoopVector(crank, angle=variable(given))
    loop = (link2, LoopVector(coupler, angle=theta3), LoopVector(-rocker, angle=theta4), LoopVector(-ground))
    return LoopSystem(("theta3", "theta4"), [loop])


def slider_crank(crank: float, rod: float, offset: float, given: Input) -> LoopSystem:
    """Return l2 e^(i theta2) + l3 e^(i theta3) - s - i h = 0 in theta3, s (notes on Shabana, 3.6).

    Parameters
    ----------
    crank, rod, offset : float
        Lengths l2, l3, and h, by which the guide lies to the left of the crank pivot.
    given : Law or float
        theta2 [rad].
    """
    theta3, s = Variable(unknown="theta3"), Variable(unknown="s")
    link2 = LoopVector(crank, angle=variable(given))
    loop = (link2, LoopVector(rod, angle=theta3), LoopVector(-1.0, s), LoopVector(-1j * offset))
    return LoopSystem(("theta3", "s"), [loop])


def inverted_slider_crank(ground: float, crank: float, given: Input) -> LoopSystem:
    """Return l2 e^(i theta2) - l1 - s e^(i theta3) = 0 in theta3, s: a crank's pin slides on rod 3, through its pivot.

    It is the Coriolis example of the notes on Shabana, with s the place of the block on the rod.

    Parameters
    ----------
    ground, crank : float
        Lengths l1, l2.
    given : Law or float
        theta2 [rad].
    """
    theta3, s = Variable(unknown="theta3"), Variable(unknown="s")
    loop = (LoopVector(crank, angle=variable(given)), LoopVector(-ground), LoopVector(-1.0, s, theta3))
    return LoopSystem(("theta3", "s"), [loop])


def slotted(m: Slotted, given: Input) -> LoopSystem:
    """Return the two coupled loops of METU 3.9 in the unknowns theta14, theta15, s4, s6; theta12 is `given`.

    b1 - i c1 - a2 e^(i theta12) + a5 e^(i theta15) + s4 e^(i theta14) = 0
    b1 - i a1 - s6 + a5 e^(i theta15) + a4 e^(i theta14) = 0
    """
    theta14, theta15, s4, s6 = (Variable(unknown=name) for name in ("theta14", "theta15", "s4", "s6"))
    link2, link5 = LoopVector(-m.a2, angle=variable(given)), LoopVector(m.a5, angle=theta15)
    first = (LoopVector(complex(m.b1, -m.c1)), link2, link5, LoopVector(1.0, s4, theta14))
    second = (LoopVector(complex(m.b1, -m.a1)), LoopVector(-1.0, s6), link5, LoopVector(m.a4, angle=theta14))
    return LoopSystem(("theta14", "theta15", "s4", "s6"), [first, second])


def rapier(m: Rapier, given: Input) -> LoopSystem:
    """Return the two coupled loops of the six-link rapier drive in the unknowns theta13, theta14, theta15, s16.

    A0 is the origin, C0 = x0 + i y0, D = C + to_d e^(i theta14), E = D + a6 on the guide; theta12 is `given`.

    a2 e^(i theta12) + a3 e^(i theta13) - a4 e^(i theta14) - a5 e^(i theta15) - C0 = 0
    C0 + a5 e^(i theta15) + to_d e^(i theta14) + a6 - s16 - counted_from - i guide = 0
    """
    names = ("theta13", "theta14", "theta15", "s16")
    theta13, theta14, theta15, s16 = (Variable(unknown=name) for name in names)
    c0 = complex(m.x0, m.y0)
    first = (
        LoopVector(m.a2, angle=variable(given)),
        LoopVector(m.a3, angle=theta13),
        LoopVector(-m.a4, angle=theta14),
        LoopVector(-m.a5, angle=theta15),
        LoopVector(-c0),
    )
    second = (
        LoopVector(c0 + m.a6 - complex(m.counted_from, m.guide)),
        LoopVector(m.a5, angle=theta15),
        LoopVector(m.to_d, angle=theta14),
        LoopVector(-1.0, s16),
    )
    return LoopSystem(names, [first, second])
