"""What an engine may have changed for the whole process is given back: the judge, and other engines, come after it."""

from __future__ import annotations

import builtins
import math
import os
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np

SHARED = (builtins, math, sys, time, np, np.linalg)
"""Modules that all use who come after an engine: a name that it binds anew is bound as before; what it adds stays."""
STREAMS = {"stdout": 1, "stderr": 2}
"""Names of `sys` -> the file that a process prints to."""


@contextmanager
def quiet() -> Iterator[None]:
    """Give back the folder, and how numbers beyond all bounds and warnings are told: so much may be timed."""
    folder = os.getcwd()
    with np.errstate(all="ignore"), warnings.catch_warnings():
        try:
            yield
        finally:
            os.chdir(folder)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Give back what `quiet` does, the environment, the streams, and the names of `SHARED` modules."""
    environment, names = dict(os.environ), [vars(module).copy() for module in SHARED]
    files = {name: _kept(file) for name, file in STREAMS.items()}
    try:
        with quiet():
            yield
    finally:
        for module, before in zip(SHARED, names, strict=True):
            vars(module).update(before)
        for name, kept in files.items():
            if kept is not None:
                _reopen(name, kept)
        if os.environ != environment:
            os.environ.clear()
            os.environ.update(environment)


def _kept(file: int) -> int | None:
    """Return another number of an open file; None if it is not open, as where there is no console."""
    with suppress(OSError):
        return os.dup(file)
    return None


def _reopen(name: str, kept: int) -> None:
    """Have a process print to where it did; a stream of `sys` that was closed is made anew."""
    os.dup2(kept, STREAMS[name])
    os.close(kept)
    stream = getattr(sys, name)
    if getattr(stream, "closed", False):
        setattr(sys, name, os.fdopen(STREAMS[name], "w", encoding="utf-8", errors="backslashreplace", closefd=False))
