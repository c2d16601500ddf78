"""The vector-loop method: loop-closure equations in complex form, a formulation without absolute coordinates.

`vectors`    c r e^(i theta), and sums of them with two derivatives
`system`     the equations: residual and Jacobian in real and in complex form, nu, gamma
`marching`   one pose: Newton, new estimates, least squares; a whole cycle, on one branch
`chains`, `engine` a scene as loops: what the engine `vector_loop` solves
"""

from crosscheck.engines.vector_loop.marching import MinimumStatus as MinimumStatus
from crosscheck.engines.vector_loop.marching import close as close
from crosscheck.engines.vector_loop.marching import march as march
from crosscheck.engines.vector_loop.marching import minimise as minimise
from crosscheck.engines.vector_loop.marching import with_new_estimates as with_new_estimates
from crosscheck.engines.vector_loop.system import AngleRelation as AngleRelation
from crosscheck.engines.vector_loop.system import LoopSystem as LoopSystem
from crosscheck.engines.vector_loop.vectors import LoopVector as LoopVector
from crosscheck.engines.vector_loop.vectors import Variable as Variable
