"""Angles of bodies as loops have them: those of known difference share one unknown, those tied to the ground none."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from crosscheck.engines import EngineRefusal
from crosscheck.engines.vector_loop.vectors import Variable
from refkin.joints import GROUND, Constraint, RelativeAngle, elements_of
from refkin.model import Mechanism


@dataclass(frozen=True)
class Tie:
    """phi_j = phi_i + value."""

    name: str
    i: str
    j: str
    value: Variable

    def other(self, body: str) -> str | None:
        """Return the body that is tied to this one, if any."""
        return self.j if body == self.i else self.i if body == self.j else None

    def carry(self, body: str, angle: Variable) -> Variable:
        """Return the angle of the other body from that of `body`."""
        sign = 1.0 if body == self.i else -1.0
        laws = tuple((sign * factor, law) for factor, law in self.value.laws)
        return Variable(angle.constant + sign * self.value.constant, angle.unknown, (*angle.laws, *laws))


@dataclass(frozen=True)
class Families:
    """The angle of each body, ground included; and the bodies that share an unknown, by its name."""

    angles: Mapping[str, Variable]
    members: Mapping[str, tuple[str, ...]]


def ties(constraints: Sequence[Constraint]) -> Iterator[Tie]:
    """Yield what joints and drivers say of two angles."""
    for e in elements_of(constraints):
        if isinstance(e, RelativeAngle):
            yield Tie(e.name, e.body_i, e.body_j, Variable(e.angle, laws=tuple((1.0, law) for law in e.laws)))


def angle_families(mechanism: Mechanism) -> Families:
    """Return the angles of a mechanism's bodies.

    Raises
    ------
    EngineError
        If the difference of two angles is given twice.
    """
    left = list(ties(mechanism.constraints))
    angles: dict[str, Variable] = {}
    members: dict[str, tuple[str, ...]] = {}
    for root in (GROUND, *(body.name for body in mechanism.bodies)):
        if root in angles:
            continue
        name = None if root == GROUND else f"angle of {root}"
        angles[root], family = Variable(unknown=name), [root]
        for body in family:
            for tie in [tie for tie in left if tie.other(body)]:
                left.remove(tie)
                other = str(tie.other(body))
                if other in angles:
                    raise EngineRefusal(f"vector_loop refuses {tie.name!r}: redundant, the angle of {other!r} is given")
                angles[other] = tie.carry(body, angles[body])
                family.append(other)
        if name is not None:
            members[name] = tuple(family)
    return Families(angles, members)
