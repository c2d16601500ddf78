"""The import graph of the sources, read from their text: modules, arrows, floors."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent


def sources(folder):
    return sorted((ROOT / folder).rglob("*.py"))


@cache
def tree(path):
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def modules():
    """Return name -> path of every module of the two packages."""
    return {module_name(path): path for package in ("refkin", "crosscheck") for path in sources(package)}


def imported(path):
    """Yield the names that a file imports, wherever in it: `a.b` of `import a.b`, `a.b.c` of `from a.b import c`."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            package = module_name(path).split(".")[: -node.level + (path.name == "__init__.py") or None]
            start = ".".join([*(package if node.level else ()), *filter(None, [node.module])])
            yield from (f"{start}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Attribute) and (name := ast.unparse(node)).startswith(("refkin.", "crosscheck.")):
            yield name  # `refkin.proof.pose` by way of a plain `import refkin`


def module_of(name):
    """Return the module of this project that an imported name is, or is taken from; None if it is none of ours."""
    while name:
        if name in modules():
            return name
        name = name.rpartition(".")[0]
    return None


@cache
def arrows():
    """Return module -> the modules of this project that it imports. The faces of packages hand names on: not read."""
    faces = {name for name, path in modules().items() if path.name == "__init__.py"}
    graph = {}
    for name, path in modules().items():
        value = {module_of(other) for other in imported(path)} - {None, name}
        graph[name] = set() if name in faces and name in ("refkin", "crosscheck") else value
    return graph


def folded(graph, folder_of):
    """Return the graph of folders: who imports whom, but for themselves."""
    folders = {}
    for name, others in graph.items():
        folders.setdefault(folder_of(name), set()).update(folder_of(other) for other in others)
    return {name: others - {name} for name, others in folders.items()}


def floors(graph):
    """Return the number of floors: the longest way down, in nodes, in a graph without circles."""

    @cache
    def height(node):
        return 1 + max((height(other) for other in graph[node]), default=0)

    return max(map(height, graph))
