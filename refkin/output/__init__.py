"""What a person or another program takes out of an answer: pictures and tables.

SVG and CSV need the standard library alone; PNG and GIF need matplotlib (extra `figures`), data frames pandas.
"""

from refkin.output.drawing import Drawing, NothingToDraw
from refkin.output.svg import animated, still

__all__ = ["Drawing", "NothingToDraw", "animated", "still"]
