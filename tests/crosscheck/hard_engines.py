"""Engines with planted faults, to be loaded as `hard_engines.py:Name`: they answer with the reference, and then err."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType, SimpleNamespace

import numpy as np

import refkin
from crosscheck.engines import API, ELEMENTS, NATIVE, EngineError, Level, Term
from crosscheck.engines.methods import ALL, ORDERS, Method, Model, levels_of
from refkin.motion import Motion, Producer, Route, Seeding, Status

ROUTE = Route(
    name="planted",
    residual_by="refkin",
    jacobian_by="refkin",
    newton_by="refkin",
    linear_solve_by="refkin",
    drift_by="refkin",
    seeding=Seeding.NONE,
)


class Right:
    """Answers as the reference does; each of the others is named after its class, and errs as its `change` says."""

    name = "right"
    api = API

    def __init_subclass__(cls) -> None:
        cls.name = cls.__name__.lower()

    def version(self) -> str:
        return "0"

    def routes(self) -> Sequence[Route]:
        return (ROUTE,)

    def capabilities(self):
        return {key: dict.fromkeys(Level, NATIVE) for key in ("points coincide", "angle by a law")}

    def terms(self, scene, route=None) -> Sequence[Term]:
        return ()

    def solve(self, scene, route=None) -> Motion:
        return self.change(replace(refkin.solve(scene), producer=Producer(name=self.name, version="0", route=ROUTE)))

    def change(self, motion: Motion) -> Motion:
        return motion


class NoMethods(Right):
    """Has no method at all."""

    def routes(self) -> Sequence[Route]:
        return ()


class Wrong(Right):
    """Is off by 1e-9 at the last time, and says nothing."""

    def change(self, motion: Motion) -> Motion:
        q = motion.q.copy()
        q[-1, -1] += 1e-9
        return replace(motion, q=q)


class Claims(Right):
    """Is half a size off, and says that it adds ten."""

    def terms(self, scene, route=None) -> Sequence[Term]:
        return (Term(name="own", level="position", reason="so it says", absolute=10.0),)

    def change(self, motion: Motion) -> Motion:
        return replace(motion, q=motion.q + 0.5)


class Stale(Right):
    """Has a model that is off by so much when it is asked first, then by so much; from then on it is right."""

    kept = MappingProxyType({ROUTE: ""})

    def __init__(self, *off: float) -> None:
        self.off = off

    def model(self, scene, route=None):
        calls = iter(self.off)

        def solve(scene) -> Motion:
            motion = self.solve(scene)
            return replace(motion, q=motion.q + next(calls, 0.0))

        return SimpleNamespace(solve=solve)


class Swapped(Right):
    """Takes each of a scene's points for another."""

    def change(self, motion: Motion) -> Motion:
        return replace(motion, points=dict(zip(motion.points, reversed(motion.points.values()), strict=True)))


class Warns(Right):
    """Is right, and calls the last pose singular."""

    def change(self, motion: Motion) -> Motion:
        return replace(motion, status=(*motion.status[:-1], Status.SINGULAR))


class Empty(Right):
    """Calls NaN ok."""

    def change(self, motion: Motion) -> Motion:
        return replace(motion, q=np.full_like(motion.q, np.nan))


class Refuses(Right):
    def change(self, motion: Motion) -> Motion:
        raise EngineError("refuses refuses every scene")


class Raises(Right):
    def change(self, motion: Motion) -> Motion:
        raise ZeroDivisionError("planted")


class Crashes(Right):
    def change(self, motion: Motion) -> Motion:
        os.kill(os.getpid(), signal.SIGSEGV)
        return motion


class Shapeless(Right):
    """Answers with an array."""

    def change(self, motion: Motion):
        return motion.q


class Hangs(Right):
    def change(self, motion: Motion) -> Motion:
        time.sleep(600.0)
        return motion


def modelled(off, scene):
    """The reference as a model, off by a part of the mechanism's size, by more at a higher order."""
    plain = replace(scene, evidence=frozenset(), points=(), bodies_wanted=None)
    off *= scene.mechanism.size()

    def read(motion):
        levels = levels_of(motion)
        return [level + off * len(levels) for level in levels]

    return Model(lambda order: refkin.solve(replace(plain, effects=ORDERS[order])), read)


class Own:
    """Lists methods of its own and has no routes: one is right, one has a planted fault."""

    name, api = "own", API
    version, terms = Right.version, Right.terms

    def capabilities(self):
        return {key: dict.fromkeys(Level, NATIVE) for key in ELEMENTS}

    def methods(self):
        for name, setting, off in (("right", "", 0.0), ("faulty", "by 1e-6", 1e-6)):
            build = partial(modelled, off)
            yield Method(engine="any", name=name, setting=setting, newton_by="refkin", uses=ALL, build=build)


class FaultyFirst(Own):
    """The same; what is hunted and pictured is its first."""

    name = "faulty_first"

    def methods(self):
        return list(super().methods())[::-1]


class OneNameTwice(Own):
    """Has two methods of one name."""

    def methods(self):
        return [one for one in super().methods() if one.name == "right"] * 2


def imaginary(model):
    """A model whose numbers have real parts that are right."""
    return replace(model, read=lambda motion: [level + 1j for level in model.read(motion)])


class Complex(Own):
    """Answers with complex numbers."""

    name = "complex"

    def methods(self):
        for one in list(super().methods())[:1]:
            yield replace(one, build=lambda scene, build=one.build: imaginary(build(scene)))
