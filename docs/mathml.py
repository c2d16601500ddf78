"""Formulas as MathML, which browsers show without a script: a label of a formula is its number."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert


def inline(self: Any, node: Any) -> None:
    """Write a formula in a line."""
    self.body.append(convert(node.astext()))
    raise nodes.SkipNode


def display(self: Any, node: Any) -> None:
    """Write a formula of its own, with its label as number and anchor."""
    label = node.get("label") or ""
    anchor = f' id="{label}"' if label else ""
    number = f'<a class="number" href="#{label}">({label})</a>' if label else ""
    self.body.append(f'<div class="math"{anchor}>{convert(node.astext(), display="block")}{number}</div>\n')
    raise nodes.SkipNode
