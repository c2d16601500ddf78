"""What a scene asks for and no more: its mechanism as far as the wanted bodies depend on it, compiled."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress
from typing import Any

import numpy as np

from refkin.errors import RefkinError, expect
from refkin.fast.compiled import Compiled, compiled
from refkin.fast.elimination.program import Program
from refkin.fast.residual import without_zeros
from refkin.joints import GROUND, SPACE
from refkin.model import Evidence, Mechanism, Scene
from refkin.motion import Status
from refkin.proof.formulas import agreeing
from refkin.proof.numbers.extrema import extrema_of
from refkin.proof.numbers.inputs import laws_have_digits
from refkin.proof.numbers.preconditioned import independent_rows
from refkin.solving.starts import Start, find_start
from refkin.system import System, compile_system


@dataclass(frozen=True)
class Prepared:
    """A scene, reduced to what is wanted, with its system and what is compiled of it.

    `start` is the first pose where it had to be found for that: to choose independent rows. Solving it changes nothing
    in it, so that it can be solved again and again: what its times alone decide is computed once. `dropped` says what
    is not looked at, as nothing wanted depends on it.
    """

    scene: Scene
    system: System
    made: Compiled = field(repr=False)  # expressions are written as trees, which grow without bounds
    start: Start | None = None
    dropped: str = ""

    @cached_property
    def t(self) -> Any:
        """The times (T,) [s]."""
        return np.fromiter(self.scene.times, float, len(self.scene.times))

    @cached_property
    def laws(self) -> dict[int, Any]:
        """The laws' values at all times, by constraint, law and order: (T,) each."""
        order = 2  # the march predicts by rates, whatever is called for
        placed = enumerate(self.system.placed)
        with np.errstate(over="ignore", invalid="ignore"):  # a time whose rates are not finite is not ok
            return {k: p.constraint.inputs(self.t, self.system.unit, order) for k, p in placed if p.constraint.laws}

    @cached_property
    def laws_have_digits(self) -> bool:
        """Whether rounding of the laws is too little to be asked about, at all times."""
        return bool(laws_have_digits(self.system, np.max(np.abs(self.t))))

    @cached_property
    def checked(self) -> System:
        """The system by which residuals are checked: in rows, or number by number at a time alone."""
        return without_zeros(self.system) if len(self.t) > 1 else self.system

    @cached_property
    def extrema(self) -> list[float]:
        """The times between the first and the last at which a law turns back."""
        return extrema_of(self.system.mechanism.constraints, self.scene.times[0], self.scene.times[-1])

    @cached_property
    def u(self) -> tuple[float, ...]:
        """What the steps from pose to pose take from the geometry."""
        geometry = [p.g for p in self.system.placed]
        return self.made.march.prepare([geometry[c][k] for c, k in self.made.march.geometry])


def prepared(scene: Scene) -> Prepared | None:
    """Return a scene ready to be run; None if its equations have no unique solution by their structure alone."""
    expect("scene", scene, Scene)
    system = agreeing(compile_system(scene.mechanism, scene.effects, scene.mechanism.unit()), scene.times)
    start: Start | None = None
    rows: Any = range(system.n)
    if system.m != system.n:
        start = find_start(system, scene)
        if start.status is not Status.OK:
            return None
        rows = independent_rows(system, start.q[:, None], np.array(scene.times[:1])).tolist()
    made = compiled(system, rows, [p.g for p in system.placed])
    if made is None:
        return None
    mechanism = scene.mechanism if start else upstream(scene, system, made)
    if mechanism is scene.mechanism:
        return Prepared(scene, system, made, start)
    reduced = compile_system(mechanism, system.effects, system.unit)
    made = compiled(reduced, range(reduced.n), [p.g for p in reduced.placed])
    assert made is not None  # the part is solved by the same blocks as the whole
    less = replace(scene, mechanism=mechanism, bodies_wanted=scene.wanted)
    return Prepared(less, reduced, made, dropped=dropped(scene.mechanism, mechanism))


def dropped(whole: Mechanism, kept: Mechanism) -> str:
    """Return in words what is not looked at of a mechanism of which a part is kept: a status says nothing of it."""
    names = [body.name for body in whole.bodies if body not in kept.bodies]
    return f"whether {', '.join(names)} can be assembled, as nothing wanted depends on it" if names else ""


def program_of(scene: Scene) -> Program:
    """Return the program that `sweep` runs for a scene: `print` it, or ask for its `counts()`.

    Raises
    ------
    RefkinError
        If there is none, as the equations have no unique solution by their structure alone.
    """
    ready = prepared(scene)
    if ready is None:
        raise RefkinError(f"{scene.name}: no unique solution by the structure of the equations, so no program")
    return ready.made.program


def legend(scene: Scene) -> str:
    """Return what the numbers in a program's text stand for: q[..] by body, g[..] and f[..] by joint or driver."""
    ready = prepared(scene)
    lines = []
    if ready is not None:
        for body in ready.scene.mechanism.bodies:
            own = range(ready.system.n)[ready.system.columns(body.name)]
            places, names = ", ".join(f"q[{c}]" for c in own), ", ".join(ready.system.kind.coordinates)
            lines.append(f"# {places} = {names} of {body.name}")
        for k, p in enumerate(ready.system.placed):
            kind = p.constraint.type
            lines.append(f"# g[{k}, ..], f[{k}, law, order] = geometry and laws of {p.constraint.name} ({kind})")
            if p.constraint.parameters:
                what = "half the angle" if ready.system.kind is SPACE else "contact parameter"
                lines.append(f"# q[{p.starts[2]}] = {what} of {p.constraint.name}")
    return "\n".join([*lines, ""])


def upstream(scene: Scene, system: System, made: Compiled) -> Mechanism:
    """Return the mechanism without the bodies that nothing wanted depends on.

    A condition number is that of the whole mechanism, so a scene that asks for it keeps all bodies.

    Parameters
    ----------
    scene, system : Scene, System
        What is asked, and the whole mechanism compiled.
    made : Compiled
        Its program, which says what follows from what.
    """
    mechanism = scene.mechanism
    if scene.bodies_wanted is None or Evidence.CONDITION in scene.evidence:
        return mechanism
    kept = _bodies_needed(system, made, [*scene.wanted, *(p.body for p in scene.points)])
    if len(kept) == len(mechanism.bodies):
        return mechanism
    known, first = {*kept, GROUND}, len(mechanism.joints)
    whole = [known.issuperset(c.bodies) for c in mechanism.constraints]  # there what names a joint has its bodies
    return replace(
        mechanism,
        bodies=tuple(body for body in mechanism.bodies if body.name in kept),
        joints=tuple(compress(mechanism.joints, whole[:first])),
        drivers=tuple(compress(mechanism.drivers, whole[first:])),
    )


def _bodies_needed(system: System, made: Compiled, wanted: list[str]) -> set[str]:
    """Return the wanted bodies and all that their equations, and those of the bodies so found, hold.

    A coordinate of a joint's own takes its bodies along: without them there is no such joint.
    """
    names = [b.name for b in system.mechanism.bodies]
    owners: dict[int | None, tuple[str, ...]] = {c: (names[c // system.kind.width],) for c in range(system.of_bodies)}
    joints = (p for p in system.placed if p.constraint.parameters)
    owners |= {p.starts[2]: tuple({*p.constraint.bodies} & {*names}) for p in joints}
    upstream: set[int] = set()
    waiting = {c for body in wanted for c in range(*system.columns(body).indices(system.n))}
    while waiting:
        upstream |= waiting
        reached = set().union(*(made.solved.depends[c] for c in waiting))
        of_bodies = {body for c in reached for body in owners[c]}
        reached |= {c for body in of_bodies for c in range(*system.columns(body).indices(system.n))}
        waiting = reached - upstream
    return {body for c in upstream for body in owners[c]}
