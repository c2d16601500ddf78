"""Digits of methods on the same scenes: side by side, those over all scenes of each would compare the scenes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from crosscheck.judge.records import QUANTITIES, Answer
from crosscheck.report.cells import describe

Who = tuple[str, str]


@dataclass
class _Answered:
    """Scenes that the same methods answered: how many, and the digits of each method and quantity in tenths."""

    scenes: int = 0
    digits: dict[tuple[Who, str], Counter[int]] = field(default_factory=dict)


class SameScenes:
    """Digits by the set of methods that were compared in a scene, of which there are few.

    So those on the scenes that any methods have in common are known when all records are read, and every scene is
    counted once.
    """

    def __init__(self) -> None:
        self.of_sets: dict[frozenset[Who], _Answered] = {}

    def add(self, answers: Iterable[Answer]) -> None:
        """Count one scene; a method of which nothing was compared there did not answer it."""
        compared = {(answer.engine, answer.method.name): answer for answer in answers if answer.compared}
        if not compared:
            return
        found = self.of_sets.setdefault(frozenset(compared), _Answered())
        found.scenes += 1
        for who, answer in compared.items():
            for name, quantity in answer.quantities.items():
                counts = found.digits.setdefault((who, name), Counter())
                for histogram in quantity.digits_by_sigma.values():
                    counts.update(histogram)

    def described(self) -> list[dict[str, Any]]:
        """Return blocks of methods, each on the scenes that all methods of the block answered.

        In the first are the method that answered most scenes, and those that, one after the other, leave at least half
        of these in common. What answered fewer, as sources that a night asks for a sample, comes in a block of its own
        together with all of the first: there it is one of those `apart`. Of every method the block has by quantity its
        `samples` and digits under `engines`, and of all the most poses that one of them was compared at.
        """
        rest = sorted(self._methods(), key=lambda who: (-self._scenes([who]), who))
        first = self._joined([], rest)
        blocks = [self._block(first, [])] if first else []
        while rest:
            joined = self._joined(first, rest)
            blocks.append(self._block(joined, joined[len(first) :]))
        return blocks

    def _methods(self) -> set[Who]:
        return set().union(*self.of_sets)

    def _having(self, methods: Sequence[Who]) -> list[_Answered]:
        """Return what was counted of the scenes that all of these methods answered."""
        return [found for who, found in self.of_sets.items() if who.issuperset(methods)]

    def _scenes(self, methods: Sequence[Who]) -> int:
        return sum(found.scenes for found in self._having(methods))

    def _joined(self, before: Sequence[Who], rest: list[Who]) -> list[Who]:
        """Take the next method out of the rest, and those that leave half of its scenes; return them after others."""
        joined = [*before, *rest[:1]]
        enough = self._scenes(joined)
        for who in rest[1:]:
            if 2 * self._scenes([*joined, who]) >= max(enough, 1):
                joined.append(who)
        rest[:] = [who for who in rest if who not in joined]
        return joined

    def _block(self, methods: Sequence[Who], apart: Sequence[Who]) -> dict[str, Any]:
        found = self._having(methods)
        engines: dict[str, dict[str, Any]] = {}
        for who in sorted(methods):
            engines.setdefault(who[0], {})[who[1]] = {name: _digits(found, who, name) for name in QUANTITIES}
        samples = [cell["samples"] for of in engines.values() for cells in of.values() for cell in cells.values()]
        scenes = sum(each.scenes for each in found)
        return {"scenes": scenes, "poses": max(samples), "apart": sorted(map(list, apart)), "engines": engines}


def _digits(found: Iterable[_Answered], who: Who, name: str) -> dict[str, Any]:
    """Return samples, median, 1st percentile and worst of a method over all that was found."""
    counts = sum((each.digits.get((who, name), Counter()) for each in found), Counter[int]())
    return {"samples": counts.total(), **describe(counts)}
