"""What an engine may have changed for the whole process is given back: the judge, and other engines, come after it."""

from __future__ import annotations

import builtins
import ctypes
import math
import os
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from typing import Any

import numpy as np

SHARED = (builtins, math, sys, time, np, np.linalg)
"""Modules that all use who come after an engine: a name that it binds anew is bound as before; what it adds stays. So
are the names of the reference's own modules."""
REFERENCE = "refkin"
MATHEMATICS = ctypes.CDLL("ucrtbase" if os.name == "nt" else None)
FLOATING = 256
"""Bytes, more than enough for C's `fenv_t`: how numbers are rounded, and whether the smallest are flushed to zero."""
STREAMS = {"stdout": 1, "stderr": 2}
"""Names of `sys` -> the file that a process prints to."""


@contextmanager
def quiet() -> Iterator[None]:
    """Give back the folder, how numbers are rounded, how such beyond all bounds and warnings are told.

    So much may be timed.
    """
    folder, floating = os.getcwd(), ctypes.create_string_buffer(FLOATING)
    MATHEMATICS.fegetenv(floating)
    with np.errstate(all="ignore"), warnings.catch_warnings():
        try:
            yield
        finally:
            MATHEMATICS.fesetenv(floating)
            os.chdir(folder)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Give back what `quiet` does, the environment, the streams, and the names of modules that others use."""
    environment = _environment().copy()
    names = _names(len(sys.modules))
    bound = [now.copy() for now in names]
    files = {name: _kept(file) for name, file in STREAMS.items()}
    try:
        with quiet():
            yield
    finally:
        if not _same(names, bound):
            for now, before in zip(names, bound, strict=True):
                now.update(before)
        for name, kept in files.items():
            if kept is not None:
                _reopen(name, kept)
        if _environment() != environment:
            os.environ.clear()
            os.environ.update({os.fsdecode(key): os.fsdecode(value) for key, value in environment.items()})


def _environment() -> dict[Any, Any]:
    """Return the environment as it is kept: to read it name by name takes as long as all else here."""
    kept: dict[Any, Any] = vars(os.environ)["_data"]
    return kept


@lru_cache(maxsize=1)
def _names(loaded: int) -> list[dict[str, Any]]:
    """Return the names of the modules that others use, of which there may be more where more are loaded."""
    own = [module for name, module in sys.modules.items() if name.partition(".")[0] == REFERENCE]
    return [vars(module) for module in (*SHARED, *own)]


def _same(names: list[dict[str, Any]], bound: list[dict[str, Any]]) -> bool:
    try:
        return names == bound
    except Exception:  # an array that is another has no one truth
        return False


def _kept(file: int) -> int | None:
    """Return another number of an open file; None if it is not open, as where there is no console."""
    with suppress(OSError):
        return os.dup(file)
    return None


def _reopen(name: str, kept: int) -> None:
    """Have a process print to where it did; a stream of `sys` that was closed is made anew."""
    os.dup2(kept, STREAMS[name])
    os.close(kept)
    if getattr(getattr(sys, name), "closed", False):
        setattr(sys, name, os.fdopen(STREAMS[name], "w", encoding="utf-8", errors="backslashreplace", closefd=False))
