"""Errors on purpose: each wrong formula of the documents, and more of the same kinds, with the test that sees it.

A mutant is killed if the test that it names goes red while it is in. That is a test of the suite, which runs on its own
too; here it is called as a function, with each of its cases in turn.
"""

from __future__ import annotations

import importlib
import inspect
import signal
import tomllib
import warnings
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from crosscheck.engines import EngineError
from refkin.errors import RefkinError
from tests.mutation.change import mutated

SECONDS = 30.0
"""What a test may take; one that takes more with a mutant has found that it does not end."""
RED = (
    AssertionError,
    ArithmeticError,
    AttributeError,
    EngineError,
    LookupError,
    NameError,
    OSError,
    RefkinError,
    RuntimeError,
    TypeError,
    ValueError,
    pytest.fail.Exception,
)
"""How a test fails: by its own word, or because changed code breaks on the way to it."""


class TooLong(RuntimeError):
    """A test that did not end in time."""


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """One replacement, as `mutated` takes it.

    `row` is the row of the ledger whose erratum or formula it takes up, if there is one; `test` sees it, as
    pytest names it below tests/.
    """

    label: str
    target: str
    old: str
    new: str
    test: str
    row: str = ""


@cache
def mutants():
    """Return all mutants, in the order of the file."""
    text = Path(__file__).with_name("mutants.toml").read_text(encoding="utf-8")
    return [Mutant(label=label, **fields) for label, fields in tomllib.loads(text).items()]


def killed(mutant):
    """Return why a mutant's test is red with it; nothing if it is green."""
    with mutated(mutant.target, mutant.old, mutant.new):
        return red(mutant.test)


def red(name, seconds=SECONDS):
    """Return why a test is red; nothing if it is green."""
    with warnings.catch_warnings(), np.errstate(all="ignore"), limited(seconds):
        warnings.simplefilter("ignore")  # changed code overflows where it likes
        try:
            for run in cases(name):
                run()
        except RED as error:
            return f"{type(error).__name__}: {str(error)[:200]}"
    return ""


def cases(name):
    """Yield a function without arguments for each case of a test: of `file::test` all, of `file::test[case]` one."""
    path, _, rest = name.partition("::")
    name, _, only = rest.removesuffix("]").partition("[")
    test = getattr(importlib.import_module("tests." + path.removesuffix(".py").replace("/", ".")), name)
    marks = [mark for mark in getattr(test, "pytestmark", []) if mark.name == "parametrize"]
    for values in product(*(mark.args[1] for mark in marks)):
        arguments = {}
        for mark, value in zip(marks, values, strict=True):
            names = mark.args[0].replace(" ", "").split(",") if isinstance(mark.args[0], str) else list(mark.args[0])
            arguments |= zip(names, (value,) if len(names) == 1 else value, strict=True)
        if only in ("", *arguments.values()):
            yield partial(_call, test, arguments)


def _call(test, arguments):
    """Call a test with its case, and with the one fixture that it may ask for."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        more = {"monkeypatch": monkeypatch} if "monkeypatch" in inspect.signature(test).parameters else {}
        test(**arguments, **more)


@contextmanager
def limited(seconds, cpu=False):
    """Raise TooLong in the block after so many seconds, of work if asked; an alarm that was set before goes on."""
    timer, bell = (signal.ITIMER_PROF, signal.SIGPROF) if cpu else (signal.ITIMER_REAL, signal.SIGALRM)

    def ring(number, frame):
        raise TooLong(f"no end within {seconds:g} s")

    before = signal.signal(bell, ring)
    running, interval = signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        signal.setitimer(timer, running, interval)
        signal.signal(bell, before)
