"""Methods made up for tests: right, wrong by a known amount, without an answer, crashing, hanging, lying.

Processes that measure prices load these engines from this file.
"""

import os
import signal
import time
from dataclasses import replace
from functools import cache, partial

import numpy as np

from crosscheck.engines import API, ELEMENTS, NATIVE, EngineError, Level
from crosscheck.engines.methods import Method, Model, Use
from refkin.model import Effect
from refkin.solving.solve import nearest

OFF = 1e-6


class Listing:
    """What `load` wants of an engine that lists its methods."""

    api = API

    def version(self):
        return "0"

    def capabilities(self):
        return dict.fromkeys(ELEMENTS, dict.fromkeys(Level, NATIVE))

    def terms(self, scene, route=None):
        return ()


class MadeUp(Listing):
    """A method for each way of being wrong."""

    name = "made up"

    def methods(self):
        yield made("right", "-", partial(_moved, 0.0))
        yield made("off", "by 1e-6 sizes", partial(_moved, OFF))
        yield made("honest", "tolerance 1e-3", partial(_moved, 1e-3))
        yield made("honest", "tolerance 1e-9", partial(_moved, 1e-9))
        yield made("liar", "tolerance 1e-9", partial(_moved, 1e-9))
        yield made("liar", "tolerance 1e-12", partial(_moved, 1e-3))
        yield made("gap", "-", _with_a_gap)
        yield replace(made("stale", "-", _moved), build=_stale)
        yield made("raises", "-", _raises)
        yield replace(made("raises while it builds", "-", _raises), build=lambda scene: _raises(scene, 0))
        yield made("ends", "-", lambda scene, order: _refuses(scene))
        yield made("crashes", "-", _crashes)
        yield made("position alone", "-", partial(_moved, 0.0), highest=0)
        yield replace(made("refused", "-", _raises), build=_refuses)


class Hanging(Listing):
    """A method that never comes back, and one behind it."""

    name = "slow"

    def methods(self):
        yield made("hangs", "-", lambda scene, order: time.sleep(3600))
        yield made("right", "-", partial(_moved, 0.0))


class PositionAlone(Listing):
    """One method, of position alone."""

    name = "made up"

    def methods(self):
        yield made("right", "-", partial(_moved, 0.0), highest=0)


def made(name, setting, solve, **more):
    def build(scene):
        return Model(partial(solve, scene), list)

    uses = frozenset({Use.PRICE})
    return Method(engine="made up", name=name, setting=setting, newton_by="nobody", uses=uses, build=build, **more)


def _stale(scene):
    """Return a model that is right once, and from then on off by 1e-3 sizes."""
    calls = iter([0.0])
    return Model(lambda order: _moved(next(calls, 1e-3), scene, order), list)


def _refuses(scene):
    raise EngineError("it does not like four-bars")


def _moved(off, scene, order):
    """Return what answers are held against with x of the first body moved by so many sizes, and rates likewise."""
    levels = [level.copy() for level in _known(scene)[: order + 1]]
    for level in levels:
        level[0] += off * scene.mechanism.size()
    return levels


@cache
def _known(scene):
    motion = nearest(replace(scene, effects=frozenset(Effect)))
    return [np.array(level) for level in motion.levels]


def _with_a_gap(scene, order):
    levels = _moved(0.0, scene, order)
    for level in levels:
        level[:, min(1, level.shape[1] - 1)] = np.nan
    return levels


def _raises(scene, order):
    raise ValueError("no such thing")


def _crashes(scene, order):
    os.kill(os.getpid(), signal.SIGSEGV)
