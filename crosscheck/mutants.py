"""Errors on purpose: each wrong formula of the documents, and more of the same kinds, put into production code.

A mutant is killed if one of the checks goes red that the tests run too: `crosscheck.selfchecks`, and the rows of the
ledger. `mutants.toml` holds what is replaced; which check kills is found out, not stated there.
"""

from __future__ import annotations

import json
import signal
import threading
import time
import tomllib
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, ClassVar

import numpy as np
from pydantic import TypeAdapter

from crosscheck.documents.ledger import check_row, read
from crosscheck.engines import EngineError
from crosscheck.mutation import changed_function, mutated, resolve
from crosscheck.selfchecks import CHECKS, CheckFailed
from refkin.errors import RefkinError

SECONDS = 30.0
"""What a check may take; one that takes more with a mutant has found that it does not end."""
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
)
"""How a check fails: by its own word, or because changed code breaks on the way to it."""


class TooLong(RuntimeError):
    """A check that did not end in time."""


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """One replacement.

    Attributes
    ----------
    label : str
        What it does, in a few words; no two are the same.
    row : str
        The row of the ledger whose erratum or formula it takes up.
    target, old, new : str
        As `crosscheck.mutation.mutated` takes them.
    checks : tuple of str
        Checks to try first; all others follow.
    """

    label: str
    row: str
    target: str
    old: str
    new: str
    checks: tuple[str, ...] = ()
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True}


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant; `killed_by` is the name of the check that went red, None if none did."""

    mutant: Mutant
    killed_by: str | None
    how: str
    seconds: float


@cache
def mutants() -> tuple[Mutant, ...]:
    """Return all mutants.

    Raises
    ------
    ValueError
        If a label occurs twice, or a row or a check does not exist.
    DoesNotFit
        If a target or a passage does not exist, or the changed text is the same program.
    """
    text = files("crosscheck").joinpath("mutants.toml").read_text(encoding="utf-8")
    found = TypeAdapter(tuple[Mutant, ...]).validate_json(json.dumps(tomllib.loads(text)["mutant"]))
    known = all_checks()
    rows = {row.id for row in read().row}
    for k, m in enumerate(found):
        if m.label in [other.label for other in found[:k]]:
            raise ValueError(f"mutant[{k}].label: expected a label not used before, got {m.label!r}")
        if m.row not in rows:
            raise ValueError(f"mutant[{k}].row: expected a row of the ledger, got {m.row!r}")
        for name in m.checks:
            if name not in known:
                raise ValueError(f"mutant[{k}].checks: expected a check that exists, got {name!r}")
        changed_function(resolve(m.target), m.old, m.new, m.target)
    return found


def all_checks() -> dict[str, Callable[[], None]]:
    """Return every check by name: `module.claim` of `crosscheck.selfchecks`, and `ledger.A3` for each row."""
    checks = {name: each.run for name, each in CHECKS.items()}
    return checks | {f"ledger.{row.id}": _row_check(row) for row in read().row if row.values}


def _row_check(row: Any) -> Callable[[], None]:
    def run() -> None:
        failures = check_row(row)["failures"]
        if failures:
            raise CheckFailed(failures[0])

    return run


def unharmed(names: Iterable[str] = ()) -> dict[str, str]:
    """Return the checks, all by default, that are red without any mutant, and why: none may be, or nothing counts."""
    checks = all_checks()
    told = {name: _red(checks[name]) for name in (names or checks)}
    return {name: why for name, why in told.items() if why}


def try_all(some: Sequence[Mutant] | None = None, others: bool = True) -> Iterator[Outcome]:
    """Put in one mutant after the other and yield what became of it.

    Parameters
    ----------
    others : bool
        Whether checks beyond those that a mutant names are tried where these stay green.
    """
    checks = all_checks()
    for mutant in mutants() if some is None else some:
        rest = [name for name in checks if name not in mutant.checks] if others else []
        start = time.perf_counter()
        killer, how = None, ""
        with mutated(mutant.target, mutant.old, mutant.new):
            for name in (*mutant.checks, *rest):
                how = _red(checks[name])
                if how:
                    killer = name
                    break
        yield Outcome(mutant, killer, how, time.perf_counter() - start)


def _red(run: Callable[[], None]) -> str:
    """Return why a check is red; nothing if it is green."""
    with warnings.catch_warnings(), np.errstate(all="ignore"), _limited(SECONDS):
        warnings.simplefilter("ignore")  # changed code overflows where it likes
        try:
            run()
        except RED as error:
            return f"{type(error).__name__}: {str(error)[:200]}"
    return ""


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise TooLong in the block after so many seconds, where the system has such an alarm."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def ring(number: int, frame: Any) -> None:
        raise TooLong(f"no end within {seconds:g} s")

    before = signal.signal(signal.SIGALRM, ring)
    running, interval = signal.setitimer(signal.ITIMER_REAL, seconds)
    started = time.monotonic()
    try:
        yield
    finally:
        left = max(1e-3, running - (time.monotonic() - started)) if running else 0.0
        signal.signal(signal.SIGALRM, before)
        signal.setitimer(signal.ITIMER_REAL, left, interval)
