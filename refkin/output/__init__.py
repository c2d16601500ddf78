"""What a person or another program takes out of an answer: pictures and tables.

SVG, CSV and npz need no further package; PNG and GIF need matplotlib (extra `figures`), data frames pandas (`tables`).
It stands above the reference and knows nothing of how an answer came about.
"""

from refkin.output.drawing import Drawing, NothingToDraw
from refkin.output.scene_motion import Picture, SceneMotion
from refkin.output.svg import animated, still
from refkin.output.tables import MissingPackage, long, wide

__all__ = ["Drawing", "MissingPackage", "NothingToDraw", "Picture", "SceneMotion", "animated", "long", "still", "wide"]
