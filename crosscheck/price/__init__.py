"""What accuracy costs in time: every producer by every route, its knobs swept, digits against microseconds.

========================= ==============================================================================================
`route`                   what is priced: a route at one setting of its knob
`*_routes`                the routes of one producer each
`truth`                   digits against the certified truth, and the digits that are attainable
`measuring`               answers and timings, in a process of its own
`rows`                    the price list as data, and the cheapest way to so many digits
`classes`                 the fixed scenes of the nightly's price list, and `price_list`
`iterations`              digits after each Newton iteration
`figures`, `page`, `show` diagrams, one page, the terminal
========================= ==============================================================================================

Position, velocity and acceleration are three currencies: a row states what one configuration costs up to its quantity,
and what was not called for is not computed. A model is built once and not counted, nor is the way from an engine's own
coordinates to the poses of bodies.
"""

from __future__ import annotations
