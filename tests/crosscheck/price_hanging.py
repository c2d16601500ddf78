"""A route that never comes back, and one behind it."""

import time
from functools import partial

import price_fakes

from crosscheck.engines.price_route import PricedRoute


def routes(scene):
    right = partial(price_fakes._moved, scene, 0.0)
    for name, solve in (("hangs", lambda order: time.sleep(3600)), ("right", right)):
        yield PricedRoute(engine="slow", name=name, knob="-", newton_by="nobody", solve=solve, read=list)
