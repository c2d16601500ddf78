"""What a check is: a named claim about the project that a function demands, and that can fail."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

U = 2.0**-53
"""Unit round-off of binary64."""


class CheckFailed(AssertionError):
    """A claim that does not hold."""


@dataclass(frozen=True)
class Check:
    """A claim by name; `run` raises where it does not hold."""

    name: str
    claim: str
    run: Callable[[], None]


CHECKS: dict[str, Check] = {}
"""All checks by name, in the order of their modules."""


def check(function: Callable[[], None]) -> Callable[[], None]:
    """Register a function as a check, under the names of its module and its own; the claim is its docstring."""
    name = f"{function.__module__.rpartition('.')[2]}.{function.__name__}"
    CHECKS[name] = Check(name, (inspect.getdoc(function) or "").partition("\n")[0], function)
    return function


def demand(holds: Any, told: str) -> None:
    """Raise unless a claim holds; NaN holds nowhere."""
    if not holds:
        raise CheckFailed(told)


def demand_near(found: Any, expected: Any, allowed: Any, told: str) -> None:
    """Raise unless two arrays have one shape and differ by what is allowed at most; NaN is near nothing."""
    found, expected = np.asarray(found), np.asarray(expected)
    demand(found.shape == expected.shape, f"{told}: shape {found.shape}, expected {expected.shape}")
    away = np.abs(found - expected)
    demand((away <= allowed).all(), f"{told}: {found} is not {expected}, off by {np.max(away, initial=0.0):.3g}")


def demand_raises(kind: type[Exception], call: Callable[[], Any], told: str) -> None:
    """Raise unless a call raises an error of this kind."""
    try:
        call()
    except kind:
        return
    raise CheckFailed(f"{told}: no {kind.__name__}")
