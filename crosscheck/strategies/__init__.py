"""Hypothesis strategies for linkages and scenes, feasible by construction.

`four_bars`, `slider_cranks`, `inverted_slider_cranks` yield linkages (`refkin.scenes.linkages`); `scenes` yields
scenes to solve; `drawn_scenes` yields them with what reports are binned by: kind, Grashof class, branch, distance to a
singular pose. `chains` yields scenes beyond linkages in the same way: `geared_linkages`, `planets`, `racks`, `cams`,
`six_bars`. `ended_scenes` yields scenes that end in a singular pose or in none, with that verdict; `equal_linkages`
four-bars of equal links. `spatial_scenes` yields linkages of space.
"""

from crosscheck.strategies.chains import Chain, cams, chains, geared_linkages, planets, racks, six_bars
from crosscheck.strategies.laws import motion_laws
from crosscheck.strategies.linkages import four_bars, inverted_slider_cranks, slider_cranks
from crosscheck.strategies.scenes import Drawn, drawn_scenes, scenes
from crosscheck.strategies.space import Spatial, spatial_scenes
from crosscheck.strategies.space_plans import Region
from crosscheck.strategies.spans import Hardness
from crosscheck.strategies.verdicts import Ended, ended_scenes, equal_four_bars, equal_linkages

__all__ = [
    "Chain",
    "Drawn",
    "Ended",
    "Hardness",
    "Region",
    "Spatial",
    "cams",
    "chains",
    "drawn_scenes",
    "ended_scenes",
    "equal_four_bars",
    "equal_linkages",
    "four_bars",
    "geared_linkages",
    "inverted_slider_cranks",
    "motion_laws",
    "planets",
    "racks",
    "scenes",
    "six_bars",
    "slider_cranks",
    "spatial_scenes",
]
