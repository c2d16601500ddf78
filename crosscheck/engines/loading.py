"""Where engines come from: by name among the entry points of group `crosscheck.engines`, from a file or a module."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib import import_module
from importlib.metadata import PackageNotFoundError, distribution, entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from crosscheck.engines import API, ELEMENTS, PEERS, QUANTITIES, Capability, Engine, EngineError, all_of
from crosscheck.errors import kept, quoted
from crosscheck.scenes.names import OURS
from refkin.motion import Route

GROUP = "crosscheck.engines"
"""The group of entry points that engines are registered in."""


def available() -> dict[str, Any]:
    """Return name -> entry point of every engine that is registered, whether or not its package is installed."""
    return {point.name: point for point in entry_points(group=GROUP)}


def _registered(name: str) -> Any:
    """Return the entry point of a registered engine; EngineError if there is none.

    Ours are looked for first, in our own package: to look through all that are installed takes 7 ms.
    """
    with suppress(PackageNotFoundError):
        for point in distribution("refkin").entry_points.select(group=GROUP, name=name):
            return point
    points = available()
    if name not in points:
        raise EngineError(unknown(name, points))
    return points[name]


def unknown(name: str, known: Iterable[str]) -> str:
    """Return in words that no engine has a name, and which there are."""
    if name.endswith(".py"):
        return f"{name}: name the class in it, too, as in {name}:Mine"
    return f"no engine is called {quoted(name)}; there are: {', '.join(sorted(known))}, or file.py:Class"


def load(spec: str) -> Engine:
    """Return an engine: by its name among those that are registered, or as `file.py:Class` or `module:Class`.

    Raises
    ------
    EngineError
        If there is none, its package is missing, or it does not keep the protocol; the message says which.
    """
    engine: Engine = _class_of(spec)()
    of_methods = ("methods",) if hasattr(engine, "methods") else ("routes", "solve")
    of_models = ("model",) if hasattr(engine, "kept") else ()
    needed = ("name", "api", "version", *of_methods, *of_models, "capabilities", "terms")
    missing = [key for key in needed if not hasattr(engine, key)]
    if missing:
        raise EngineError(f"engine {spec!r} lacks: {', '.join(missing)}")
    for key, text in (("name", engine.name), ("version()", engine.version())):
        if not (isinstance(text, str) and text and text.isprintable()):
            raise EngineError(f"engine {spec!r}: {key}: expected printable text, got {text!r}")
    _formed(spec, engine)
    if engine.api[0] != API[0]:
        raise EngineError(f"engine {spec!r} speaks interface {engine.api[0]}.x, this suite {API[0]}.x")
    strange = [key for key in engine.capabilities() if key not in ELEMENTS]
    if strange:
        raise EngineError(f"engine {spec!r}: its capability table has {strange[0]!r}, not one of {', '.join(ELEMENTS)}")
    if engine.name != spec and ":" not in spec:
        raise EngineError(f"engine {spec!r} calls itself {engine.name!r}")
    if ":" in spec and engine.name in {*available(), *OURS}:
        raise EngineError(f"engine {spec!r} calls itself {engine.name!r}, as a registered one or one of ours does")
    return engine


def _formed(spec: str, engine: Any) -> None:
    """Raise EngineError unless what an engine says of itself, whatever the scene, has the form of the protocol."""
    api, table, able = engine.api, engine.capabilities(), getattr(engine, "delivers", QUANTITIES)
    rows = list(table.values()) if isinstance(table, Mapping) else [None]
    levels = all(isinstance(row, Mapping) and all(isinstance(x, Capability) for x in row.values()) for row in rows)
    again = getattr(engine, "kept", {})
    noted = isinstance(again, Mapping) and all(isinstance(one, Route) for one in again)
    right = isinstance(able, tuple | list | set | frozenset) and all(quantity in QUANTITIES for quantity in able)
    for key, value, expected, well in (
        ("api", api, f"two whole numbers, as in {API}", isinstance(api, tuple) and [*map(type, api)] == [int, int]),
        ("capabilities()", table, "a table of element -> level -> Capability", levels),
        ("delivers", able, f"some of {', '.join(QUANTITIES)}", right),
        ("kept", again, "a table of Route -> what is said of its price", noted),
    ):
        if not well:
            raise EngineError(f"engine {spec!r}: {key}: expected {expected}, got {kept(repr(value))}")
    if hasattr(engine, "routes"):
        all_of(engine, "routes", engine.routes(), Route)


def _class_of(spec: str) -> Any:
    """Return the class that a name or a path stands for."""
    where, _, name = spec.rpartition(":")
    if where.startswith(".") and not where.endswith(".py"):
        raise EngineError(f"engine {spec!r}: expected a file .py or a module before the colon, got {where!r}")
    try:
        if not where:
            return _registered(spec).load()
        module = _module_of_file(where) if where.endswith(".py") else import_module(where)
    except (ImportError, SyntaxError, SystemExit) as error:
        hint = "; pip install 'refkin[engines]' brings it" if spec in PEERS else ""
        why = f"it ends with {error!r}" if isinstance(error, SystemExit) else f"{error}{hint}"
        raise EngineError(f"engine {spec!r} cannot be imported: {why}") from error
    if not hasattr(module, name):
        raise EngineError(f"engine {spec!r}: there is no {name!r} in {where}")
    found = getattr(module, name)
    if not callable(found):
        raise EngineError(f"engine {spec!r}: expected a class, got a {type(found).__name__}")
    return found


def _module_of_file(where: str) -> Any:
    path = Path(where)
    if not path.is_file():
        raise EngineError(f"there is no file {where}")
    name = f"crosscheck_engine_{path.stem}"
    spec = spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module
