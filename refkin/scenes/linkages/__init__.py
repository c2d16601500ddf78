"""Linkages by their lengths: `FourBar`, `SliderCrank`, `InvertedSliderCrank`, `spatial` ones -> Mechanism and Scene.

Each also knows in closed form what its lengths imply: change-point slack and Grashof class, the range of its input,
both assemblies at an input, transmission angle, dead centres. Solving a scene uses none of this: it gives the estimate
to start from, and refuses an input that the linkage cannot follow.
"""

from refkin.scenes.linkages.base import Branch, Linkage, Pose, law_keys, rough
from refkin.scenes.linkages.closures import ANYWHERE, DoesNotAssemble, Interval
from refkin.scenes.linkages.four_bar import FourBar, GrashofClass
from refkin.scenes.linkages.slider_cranks import InvertedSliderCrank, SliderCrank
from refkin.scenes.linkages.spatial_base import SpatialLinkage
from refkin.scenes.linkages.spatial_cranks import RSCR, RSSP, RSSR, RSSRChain
from refkin.scenes.linkages.spatial_loops import Bennett, Bricard, DoubleHooke, Hooke, ScrewJack, Stewart

# fmt: off
__all__ = [
    "ANYWHERE", "RSCR", "RSSP", "RSSR", "Bennett", "Branch", "Bricard", "DoesNotAssemble", "DoubleHooke", "FourBar",
    "GrashofClass", "Hooke", "Interval", "InvertedSliderCrank", "Linkage", "Pose", "RSSRChain", "ScrewJack",
    "SliderCrank", "SpatialLinkage", "Stewart", "law_keys", "rough",
]
# fmt: on
