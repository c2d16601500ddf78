"""The vector-loop method: loop-closure equations in complex form, a formulation without absolute coordinates.

`vectors`    c r e^(i theta), and sums of them with two derivatives
`system`     the equations: residual and Jacobian in real and in complex form, nu, gamma
`marching`   one pose: Newton, new estimates, least squares; a whole cycle, on one branch
`chains`, `engine` a scene as loops: what the engine `vector_loop` solves
"""

from crosscheck.engines.vector_loop.marching import (
    LoopMarch,
    Minimum,
    MinimumStatus,
    close,
    march,
    minimise,
    with_new_estimates,
)
from crosscheck.engines.vector_loop.system import AngleRelation, LoopSystem
from crosscheck.engines.vector_loop.vectors import Variable, Vector

__all__ = [
    "AngleRelation",
    "LoopMarch",
    "LoopSystem",
    "Minimum",
    "MinimumStatus",
    "Variable",
    "Vector",
    "close",
    "march",
    "minimise",
    "with_new_estimates",
]
