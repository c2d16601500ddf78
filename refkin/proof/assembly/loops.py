"""Loops of links that no driver can close: one link is longer than all the others together."""

from __future__ import annotations

from collections.abc import Iterator

from flint import arb

from refkin.proof.assembly.loci import Ball, length
from refkin.proof.assembly.placing import End
from refkin.proof.assembly.rows import Kind, Row, Rows

MOST_LOOPS = 200
LONGEST = 8


def open_loop(rows: Rows, size: float) -> End | None:
    """Return the proof that some loop of pins and distances never closes; None if there is none.

    `size` [m] is the unit of length, for the message.
    """
    for count, loop in enumerate(_loops(rows.rows)):
        if count == MOST_LOOPS:
            break
        lengths = [(name, x) for name, x in _lengths(loop) if not x.is_zero()]
        for name, x in lengths:
            others = sum((y for _, y in lengths), arb(0)) - x
            if x > others:
                return End(x - others, lambda n=name, x=x, y=others: _words(n, x * size, y * size))  # type: ignore[misc]
    return None


def _words(name: str, x: Ball, others: Ball) -> str:
    long, rest = float(x.mid()), float(others.mid())
    return f"{name} is longer ({long:.6g} m) than the rest of its loop ({rest:.6g} m): no angle closes it"


Passage = tuple[Row, str, str]
"""A row on the way around a loop, the body it is entered from and the body it leads to."""


def _loops(rows: tuple[Row, ...]) -> Iterator[list[Passage]]:
    """Yield closed ways over different bodies, each from its first row on."""
    links = [row for row in rows if row.kind is not Kind.LINE]
    for k, row in enumerate(links):
        yield from _closed([(row, row.i, row.j)], links[k + 1 :])


def _closed(way: list[Passage], links: list[Row]) -> Iterator[list[Passage]]:
    start, here = way[0][1], way[-1][2]
    if here == start:
        yield way
        return
    visited = {leaving for _, leaving, _ in way[1:]} | {here}
    for row in links if len(way) < LONGEST else ():
        for leaving, entering in ((row.i, row.j), (row.j, row.i)):
            if leaving == here and entering not in visited and all(row is not r for r, _, _ in way):
                yield from _closed([*way, (row, leaving, entering)], links)


def _lengths(loop: list[Passage]) -> Iterator[tuple[str, Ball]]:
    """Yield the links of a loop: bodies, from the point they are entered by to that they are left by, and distances."""
    for (row, _, body), (following, _, _) in zip(loop, [*loop[1:], loop[0]], strict=True):
        entered = row.q if row.j == body else row.p
        left = following.p if following.i == body else following.q
        yield body, length(left - entered)
        if row.kind is Kind.DISTANCE:
            yield row.name, row.distance
