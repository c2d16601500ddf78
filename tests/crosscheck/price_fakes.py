"""Routes made up for tests: right, wrong by a known amount, without an answer, crashing, hanging, lying.

Processes that measure prices import this module by its name, from this folder.
"""

import os
import signal
import time
from dataclasses import replace
from functools import cache, partial

import numpy as np

import refkin
from crosscheck.engines.price_route import PricedRoute, Refused
from refkin.model import Effect

OFF = 1e-6


def routes(scene):
    """Yield a route for each way of being wrong."""
    yield _route(scene, "right", "-", partial(_moved, scene, 0.0))
    yield _route(scene, "off", "by 1e-6 sizes", partial(_moved, scene, OFF))
    yield _route(scene, "honest", "tolerance 1e-3", partial(_moved, scene, 1e-3))
    yield _route(scene, "honest", "tolerance 1e-9", partial(_moved, scene, 1e-9))
    yield _route(scene, "liar", "tolerance 1e-9", partial(_moved, scene, 1e-9))
    yield _route(scene, "liar", "tolerance 1e-12", partial(_moved, scene, 1e-3))
    yield _route(scene, "gap", "-", partial(_with_a_gap, scene))
    yield _route(scene, "raises", "-", _raises)
    yield _route(scene, "crashes", "-", _crashes)
    yield _route(scene, "position alone", "-", partial(_moved, scene, 0.0), highest=0)
    yield _route(scene, "slower with each order", "-", partial(_slow, scene))
    yield _route(scene, "all at once", "-", partial(_slow, scene), at_once=True)
    yield Refused(engine="made up", name="refused", reason="it does not like four-bars")


def _route(scene, name, knob, solve, **more):
    return PricedRoute(engine="made up", name=name, knob=knob, newton_by="nobody", solve=solve, read=list, **more)


def _moved(scene, off, order):
    """Return the reference's answer with x of the first body moved by so many sizes, and rates likewise."""
    motion = refkin.solve(replace(scene, effects=frozenset(Effect), evidence=frozenset()))
    levels = [np.array(level) for level in motion.levels[: order + 1]]
    for level in levels:
        level[0] += off * scene.mechanism.size()
    return levels


def _with_a_gap(scene, order):
    levels = _moved(scene, 0.0, order)
    for level in levels:
        level[:, 1] = np.nan
    return levels


def _raises(order):
    raise ValueError("no such thing")


def _crashes(order):
    os.kill(os.getpid(), signal.SIGSEGV)


def _slow(scene, order):
    """Take 20 ms for position, and 40 ms for each further level; the answer itself is known."""
    time.sleep(0.020 + 0.040 * order)
    return _known(scene)


@cache
def _known(scene):
    return _moved(scene, 0.0, 2)
