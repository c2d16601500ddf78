"""The fast paths: the same answers sooner. Nothing of the reference needs this package.

============= ======================================================================================================
`sweep`       a scene, all times at once: what `refkin.solve` answers, in microseconds per pose
`attempt`     the same, or None where `sweep` would leave the scene to `refkin.solve`
`prepared`    a scene made ready for `attempt`, to be solved again and again
`solve_many`  many mechanisms of one topology, all at once
`solve_large` one configuration of a mechanism with up to 100,000 coordinates
`program_of`  what `sweep` runs for a scene, to be printed; `legend` says what its numbers stand for
============= ======================================================================================================

All rest on the joints' own formulas. `sweep` and `solve_many` run them as a compiled program (`elimination`), which
reorders arithmetic and has sines of its own: so every pose is checked afterwards by the formulas themselves.
"""

from refkin.fast.many import Many, Slice, solve_many
from refkin.fast.prepare import legend, prepared, program_of
from refkin.fast.sparse import Large, SparseSystem, solve_large
from refkin.fast.sweep import attempt, sweep

__all__ = [
    "Large",
    "Many",
    "Slice",
    "SparseSystem",
    "attempt",
    "legend",
    "prepared",
    "program_of",
    "solve_large",
    "solve_many",
    "sweep",
]
