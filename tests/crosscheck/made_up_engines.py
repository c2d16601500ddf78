"""Engines that answer as the reference does, but for what is made of it: one for each way of being wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np

from crosscheck.engines import ELEMENTS, NATIVE, EngineError, EngineRefusal, Level, Term, refused
from crosscheck.measure import check
from crosscheck.scenes.names import PHYSICAL
from refkin.model import Scene
from refkin.motion import Motion, Status
from tests.crosscheck.hard_engines import Right
from tests.crosscheck.test_judgements import Rows

CONFIGURED: list[Any] = []
"""The configurations at which rows are compared, the last ones last."""
PARTS = 6
"""Of so many parts each has some of the engines: a test is quick."""


class Made(Right):
    """Answers as the reference does, but for what a change makes of it; its rows are moved ones of our own."""

    def __init__(self, name: str, change: Callable[[Motion], Motion], *, rows: bool = False, **more: Any) -> None:
        self.name, self.change, self.asked = name, change, 0
        vars(self).update(more)
        if rows:
            self.constraints = self.own_rows

    def capabilities(self) -> Any:
        levels = {**dict.fromkeys(Level, NATIVE), Level.JACOBIAN: refused("it has no such row")}
        return {key: levels if key == "angle by a law" else dict.fromkeys(Level, NATIVE) for key in ELEMENTS}

    def solve(self, scene: Scene, route: Any = None) -> Motion:
        self.scene, self.asked = scene, self.asked + 1
        return super().solve(scene, route)

    def own_rows(self, scene: Scene) -> Any:
        model = Rows(CONFIGURED[-1])
        model.close = lambda: None  # type: ignore[attr-defined]
        return model


def by(part: float, level: str = "q", to: int | None = None) -> Callable[[Motion], Motion]:
    """Return a change of one level by a part of it."""

    def change(motion: Motion) -> Motion:
        values = getattr(motion, level)
        if values is None:
            return motion
        wave = np.cos(3.0 * np.arange(values.size)).reshape(values.shape)
        wave[:, to:] = 0.0
        return replace(motion, **{level: values + part * wave})

    return change


def without(motion: Motion) -> Motion:
    """Return an answer that ends before its last time."""
    q = np.array(motion.q)
    q[:, -1] = np.nan
    return replace(motion, q=q, status=(*motion.status[:-1], Status.NOT_CONVERGED))


def raises(error: BaseException) -> Callable[[Motion], Motion]:
    def change(motion: Motion) -> Motion:
        raise error

    return change


def renamed(engine: Made) -> Callable[[Motion], Motion]:
    """Return a change of the scene that the engine was handed."""

    def change(motion: Motion) -> Motion:
        object.__setattr__(engine.scene, "name", "another")
        return motion

    return change


def at_second(engine: Made, change: Callable[[Motion], Motion]) -> Callable[[Motion], Motion]:
    return lambda motion: change(motion) if engine.asked > 1 else motion


def made() -> Iterator[Made]:
    """Yield an engine for each way of being wrong."""
    yield Made("right", lambda motion: motion)
    yield Made("positions", by(1e-6), rows=True)
    yield Made("beginning", by(1e-5, to=1))
    yield Made("velocities", by(1e-4, "qd"), delivers=("position", "velocity"))
    yield Made("accelerations", by(1e-4, "qdd"), rows=True)
    yield Made("alone", lambda motion: replace(motion, qd=None, qdd=None), delivers=("position",))
    yield Made("undelivered", lambda motion: replace(motion, qd=None, qdd=None))
    yield Made("without", without)
    yield Made(
        "nan", lambda motion: replace(motion, q=np.full_like(motion.q, np.nan), qdd=np.full_like(motion.q, np.inf))
    )
    yield Made("all ok", lambda motion: replace(by(1e-7)(motion), status=(Status.OK,) * len(motion.status)))
    yield Made("other bodies", lambda motion: replace(motion, bodies=motion.bodies[::-1]))
    yield Made("shapeless", lambda motion: replace(motion, q=motion.q[1:]))
    yield Made("fails", raises(EngineError("it failed")), constraints=raises(EngineError("it failed at rows")))
    yield Made("refuses", raises(EngineRefusal("it will not")), constraints=raises(EngineRefusal("nor here")))
    yield Made("routeless", by(0.0), routes=lambda: ())
    granted = [Term(name=f"of {x}", level="position", reason="made up", absolute=x) for x in (1e-3, 1e-14)]
    yield Made("granted", by(1e-6), terms=lambda *_: granted)
    for name, change in (("renames", renamed), ("second", partial(at_second, change=by(1e-6)))):
        engine = Made(name, by(0.0))
        engine.change = change(engine)
        yield engine
    engine = Made("second without", by(0.0))
    engine.change = at_second(engine, raises(EngineError("")))
    yield engine


@contextmanager
def on_record() -> Iterator[None]:
    """Have every scene drawn for what some are, and configurations kept for rows that are made up."""
    own = check.configurations

    def configured(*given: Any) -> Any:
        CONFIGURED.extend(own(*given))
        return CONFIGURED[-1:]

    with patch.multiple(check, key_of=lambda scene: "0" * 16, configurations=configured):
        yield


class Felt(Made):
    """An engine with effects, of which one moves it, one ends it, one is refused, and one is not felt."""

    def physical_effects(self) -> Any:
        return {name: f"{name} on" for name in PHYSICAL[:4]}

    def missing_effects(self) -> Any:
        return {PHYSICAL[4]: "it has none"}

    def dynamic_routes(self) -> Any:
        return ()

    def with_effect(self, effect: str) -> Felt:
        changes = [by(1e-6), raises(EngineError("it ended")), raises(EngineRefusal("not this")), lambda motion: motion]
        return Felt("felt", changes[PHYSICAL.index(effect)])
