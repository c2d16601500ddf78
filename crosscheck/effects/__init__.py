"""The ledger of effects: what each costs, and the proof that one which is not called for changes nothing.

A scene calls for positions, and for what it names beyond: velocity, acceleration, points, condition, certificate. It
never calls for gravity, contact, friction, joint limits, passive forces, actuation, sensors or inertia. The ledger
switches each of them on, the latter behind the scene's back, and takes the two answers apart:

`microseconds`    what the effect adds to the cost of one configuration
`inert`           whether the rest of the answer stays as it was: bit for bit in refkin, within the allowed error in an
                  engine
`largest_change`  by how much it does not, relative to the mechanism's size (position) or to the largest rate

Engines run in processes of their own: one that ends takes its row along and no other.
"""

from crosscheck.effects.ledger import effects_ledger
from crosscheck.effects.rows import EffectRow

__all__ = ["EffectRow", "effects_ledger"]
