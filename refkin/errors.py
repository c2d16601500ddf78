"""What refkin raises where a request makes no sense, with the data; numbers that failed are a status, no error."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

LONGEST, MOST = 200, 100
"""How much of a value a message quotes [characters], and of how many faults it tells: there may be thousands."""


class RefkinError(Exception):
    """Base of every error that refkin raises on purpose."""


def printable(text: str) -> str:
    """Return text with its control characters written out: a name in a scene file may hold what steers a terminal."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong with a scene: the path, as in its file (`joint[2].body_i`); what stands there, or None.

    `where` is that place in other words: "joint 'A', line 12". Of a name, `choices` are those that may stand there.
    """

    path: str
    value: object
    expected: str
    where: str = ""
    choices: tuple[str, ...] = ()

    def __str__(self) -> str:
        text = re.sub(r"np\.float64\((.+?)\)", r"\1", repr(self.value))  # a number, as Python shows it
        got = "" if self.value is None else f", got {text[:LONGEST]}{' ...' if len(text) > LONGEST else ''}"
        return printable(f"{self.path}: expected {self.expected}{got}{f' ({self.where})' if self.where else ''}")


class InvalidScene(RefkinError):
    """A scene or mechanism that makes no sense; `faults` has everything that is wrong, its text the first hundred."""

    def __init__(self, faults: Sequence[Fault], source: str = "scene") -> None:
        self.faults, self.source = tuple(faults), source
        more = [f"{source}: {len(self.faults) - MOST} more faults"] if len(self.faults) > MOST else []
        super().__init__("\n".join([*(f"{source}: {fault}" for fault in self.faults[:MOST]), *more]))


class InvalidRequest(RefkinError, ValueError):
    """An argument that makes no sense; says which, what was expected and what came."""

    def __init__(self, argument: str, expected: str, got: str) -> None:
        self.argument, self.expected, self.got = argument, expected, got
        super().__init__(f"{argument}: expected {expected}, got {got}")


def expect(name: str, value: object, *kinds: type) -> None:
    """Raise TypeError, with what was expected and what came, if an argument is of none of these kinds.

    Parameters
    ----------
    name : str
        Its name.
    value, *kinds : object, types
    """
    if not isinstance(value, kinds):
        raise TypeError(f"{name}: expected a {' or '.join(k.__name__ for k in kinds)}, got a {type(value).__name__}")


class NotCalledFor(RefkinError):
    """An effect was asked of a system that was compiled without it."""

    def __init__(self, effect: str, effects: frozenset[str]) -> None:
        self.effect, self.effects = effect, effects
        super().__init__(f"the system is compiled for {sorted(map(str, effects))}: {str(effect)!r} was not called for")


class UnknownName(RefkinError):
    """A body, point or coordinate that does not exist; lists those that do."""

    def __init__(self, kind: str, name: str, known: tuple[str, ...]) -> None:
        self.kind, self.name, self.known = kind, name, known
        super().__init__(f"no {kind} is called {name!r}; there are: {printable(', '.join(known)) or 'none'}")
