"""Which engines can be loaded: each is tried in a process of its own, so that one that crashes is missing, no more."""

from __future__ import annotations

from collections.abc import Sequence

from crosscheck.engines import EngineError, load
from crosscheck.errors import UsageError
from crosscheck.workers.processes import Failure, call_each


class SameName(UsageError):
    """Two engines have the same name, so that their answers could not be told apart."""


def find_engines(specs: Sequence[str]) -> tuple[dict[str, tuple[str, str]], dict[str, str]]:
    """Return the engines that can be loaded, as name -> (what loads it, version), and for the others why not.

    Raises
    ------
    SameName
        If two have the same name.
    """
    loaded: dict[str, tuple[str, str]] = {}
    missing = {}
    for spec, answer in zip(specs, call_each(_tried, specs), strict=True):
        if isinstance(answer, Failure | str):
            missing[spec] = answer if isinstance(answer, str) else answer.text
        elif answer[0] in loaded:
            raise SameName(f"engines {loaded[answer[0]][0]!r} and {spec!r} are both called {answer[0]!r}")
        else:
            loaded[answer[0]] = (spec, answer[1])
    return loaded, missing


def _tried(spec: str) -> tuple[str, str] | str:
    """Return name and version, or why there is no such engine: no fault of ours, so no place in our code is named."""
    try:
        return name_and_version(spec)
    except EngineError as error:
        return str(error)


def name_and_version(spec: str) -> tuple[str, str]:
    """Return what an engine calls itself, and its version."""
    engine = load(spec)
    return engine.name, engine.version()
