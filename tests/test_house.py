"""How the house is built: which way imports run, that exported names exist, that no engine knows refkin's geometry."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ENGINE_PACKAGES = {"exudyn", "pinocchio", "mujoco", "coal"}
TYPES_AND_LAWS = {"refkin.model", "refkin.motion", "refkin.motion_laws", "refkin.joints", "refkin.errors"}
"""What an adapter may know of refkin: what a scene says, and the type of an answer."""
NUMBERS_ONLY = ("joint_tree", "loop_closing", "tree_system", "tree_motion", "frames")
"""Modules of crosscheck that adapters share; they are held to the same rule."""


def imported(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def sources(folder):
    return sorted((ROOT / folder).rglob("*.py"))


@pytest.mark.parametrize("path", sources("refkin"), ids=lambda p: str(p.relative_to(ROOT)))
def test_refkin_imports_neither_crosscheck_nor_an_engine(path):
    packages = {name.split(".")[0] for name in imported(path)}

    assert not packages & (ENGINE_PACKAGES | {"crosscheck", "tests"})


@pytest.mark.parametrize("path", sources("refkin"), ids=lambda p: str(p.relative_to(ROOT)))
def test_the_reference_needs_nothing_fast(path):
    if "fast" not in path.parts:
        assert not [name for name in imported(path) if name.startswith("refkin.fast")]


@pytest.mark.parametrize("path", sources("crosscheck"), ids=lambda p: str(p.relative_to(ROOT)))
def test_of_crosscheck_only_what_shows_the_fast_path_needs_it(path):
    """At the top of a module: a command may import it when it is called."""
    top = [node for node in ast.parse(path.read_text(encoding="utf-8")).body]
    names = [node.module or "" for node in top if isinstance(node, ast.ImportFrom)]

    assert path.name == "lanes.py" or not [name for name in names if name.startswith("refkin.fast")]


def adapters():
    shared = [ROOT / "crosscheck" / f"{name}.py" for name in NUMBERS_ONLY]
    # refkin's own fast path is no peer: it is compared as a second producer of the same formulas.
    peers = [path for path in sources("crosscheck/engines") if path.name != "lanes.py"]
    return [*peers, *sources("crosscheck/assur"), *shared]


@pytest.mark.parametrize("path", adapters(), ids=lambda p: str(p.relative_to(ROOT)))
def test_an_adapter_shares_no_geometry_with_refkin(path):
    of_refkin = {name for name in imported(path) if name.split(".")[0] == "refkin"}

    assert not of_refkin - TYPES_AND_LAWS


@pytest.mark.parametrize("path", adapters(), ids=lambda p: str(p.relative_to(ROOT)))
def test_an_adapter_calls_no_formula_of_a_joint(path):
    formulas = {"residual", "jacobian", "nu", "gamma", "constants", "inputs"}
    of_a_joint = [
        node
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute)
        and node.attr in formulas
        and isinstance(node.value, ast.Name)
        and node.value.id
        in {"joint", "driver", "constraint", "Revolute", "Prismatic", "Distance", "PointOnLine", "Fixed"}
    ]

    assert not of_a_joint


@pytest.mark.parametrize("path", sources("crosscheck/engines"), ids=lambda p: p.name)
def test_no_engine_imports_another(path):
    own = path.name.split("_")[0]
    others = [n for n in imported(path) if n.split(".")[0] in ENGINE_PACKAGES and n.split(".")[0] != own]
    modules = [n.rsplit(".", 1)[1] for n in imported(path) if n.startswith("crosscheck.engines.")]

    assert not others
    assert all(path.name == "__init__.py" or m.split("_")[0] == own for m in modules)


@pytest.mark.parametrize(
    "package", ["refkin", "crosscheck", "crosscheck.strategies", "refkin.linkages", "refkin.proof"]
)
def test_every_exported_name_exists(package):
    module = importlib.import_module(package)

    assert module.__all__
    assert not [name for name in module.__all__ if not hasattr(module, name)]
