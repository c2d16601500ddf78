"""One route, of position alone."""

from functools import partial

import price_fakes

from crosscheck.engines.price_route import PricedRoute


def routes(scene):
    """Yield the reference's own answer."""
    solve = partial(price_fakes._moved, scene, 0.0)
    yield PricedRoute(engine="made up", name="right", knob="-", newton_by="nobody", solve=solve, read=list, highest=0)
