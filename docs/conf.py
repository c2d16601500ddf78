"""The book: `make docs` builds it into docs/_build/html. Pictures and tables are made from the project."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import made
import mathml

import refkin

project = "refkin and crosscheck"
author = "the refkin developers"
copyright = author
version = release = refkin.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.viewcode", "numpydoc"]
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build", "_made"]
suppress_warnings = ["myst.header"]  # sections that are made stand below a heading of the page they are put into

autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
autosummary_generate = False

html_theme = "furo"
html_title = "refkin and crosscheck"
html_static_path = ["_static"]
html_css_files = ["book.css"]
html_math_renderer = "mathml"
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True}


def setup(app: Any) -> None:
    """Make what is made, and render formulas without scripts and without the net."""
    app.add_html_math_renderer("mathml", (mathml.inline, None), (mathml.display, None))
    app.connect("builder-inited", lambda app: made.make(Path(app.srcdir)))
