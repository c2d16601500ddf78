"""Where open tables of laws end: a path stops there, and says so.

It finds its last pose from one beyond it. There the last piece of a spline goes on, for the path alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Any

from refkin.joints import Constraint
from refkin.model import Mechanism
from refkin.motion_laws import Table


class _Continued(Table):
    """A table whose first and last piece go on beyond its ends."""

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import CubicSpline  # here, because importing it costs more than the rest of refkin

        return CubicSpline(self.argument, self.value)


def continued(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose open tables go on beyond their ends."""
    joints, drivers = (tuple(map(_with_continued, group)) for group in (mechanism.joints, mechanism.drivers))
    return replace(mechanism, joints=joints, drivers=drivers)


def _with_continued(constraint: Any) -> Any:
    own = {key: getattr(constraint, key) for key in {key.partition("[")[0] for key in constraint.law_keys}}
    return replace(constraint, **{key: _law(law) for key, law in own.items()}) if own else constraint


def _law(law: Any) -> Any:
    if isinstance(law, tuple):
        return tuple(map(_law, law))
    return _Continued(argument=law.argument, value=law.value) if isinstance(law, Table) and not law.periodic else law


def ends(constraints: tuple[Constraint, ...]) -> Iterator[tuple[str, float, float]]:
    """Yield the name of each constraint with a law, and from where to where that is known."""
    for constraint in constraints:
        for law in constraint.laws:
            yield constraint.name, *law.domain()
