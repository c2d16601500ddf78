"""Running one lane at a time: a tape becomes Python functions, which beat NumPy calls on a few lanes by far.

The source is the tape's own text (`tape.text`), with the Newton segment in a loop. Nothing of a scene is in that text
but numbers of registers, so there is nothing in it that somebody else wrote.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from refkin.fast.lanes.tape import Tape, statement


class Answer(NamedTuple):
    """What `Single.advance` returns.

    Attributes
    ----------
    levels : tuple of three tuples
        The wanted coordinates, their rates, their accelerations; empty if the tape has none.
    determinants, pivots : tuple
        Per block.
    steps : list of float
        The largest core correction of each Newton step.
    """

    levels: tuple[tuple[float, ...], ...]
    determinants: tuple[float, ...]
    pivots: tuple[float, ...]
    steps: list[float]


class Single(NamedTuple):
    """The functions of a tape.

    Attributes
    ----------
    prepare : callable
        Numbers of the geometry, in the order of `geometry` -> numbers of the `u` bank.
    advance : callable
        (u, f, q, profile, most, enough) -> Answer: Newton from the core coordinates q, then the rest. `f` are the laws'
        values in the order of `laws`; at most `most` Newton steps are made, and none after one of at most `enough`.
        Numbers that fail raise ArithmeticError or ValueError.
    geometry, laws : list of tuple
        (constraint, number) and (constraint, law, order) of the inputs.
    """

    prepare: Callable[[Sequence[float]], tuple[float, ...]]
    advance: Callable[..., Answer]
    geometry: list[tuple[int, ...]]
    laws: list[tuple[int, ...]]


def compile_single(tape: Tape, wanted: Sequence[int]) -> Single:
    """Return the functions of a tape whose answer is about the coordinates `wanted`."""
    scope = {"cos": math.cos, "sin": math.sin, "tan": math.tan, "inverse": _inverse, "apply": _apply, "Answer": Answer}
    exec(compile(source(tape, wanted), "<tape>", "exec"), scope)
    places = {kind: [leaf.place for leaf in tape.inputs if leaf.kind == kind] for kind in "gf"}
    prepare: Any = scope["prepare"]
    advance: Any = scope["advance"]
    return Single(prepare, advance, places["g"], places["f"])


def source(tape: Tape, wanted: Sequence[int]) -> str:
    """Return the source of the functions."""
    inputs = {kind: [str(r) for leaf, r in tape.inputs.items() if leaf.kind == kind] for kind in "gf"}
    core = [f"w{k}" for k in tape.outputs.core]
    u = [f"u{k}" for k in range(tape.sizes["u"])]
    levels = [[f"w{rows[c]}" for c in wanted if rows] for rows in tape.outputs.levels]
    evidence = [_tuple([f"w{k}" for k in rows]) for rows in (tape.outputs.determinants, tape.outputs.pivots)]
    prepare = [
        *_unpacked(inputs["g"], "g"),
        *(f"{register} = {number!r}" for register, number in tape.constants.items()),
        *map(statement, tape.segments["mechanism"]),
        f"return {_tuple(u)}",
    ]
    step = f"w{tape.outputs.step}"
    newton = [*map(statement, tape.segments["newton"]), f"steps.append({step})", f"if {step} <= enough: break"]
    advance = [
        *_unpacked(u, "u"),
        *_unpacked(inputs["f"], "f"),
        *_unpacked(core, "q"),
        *map(statement, tape.segments["time"]),
        "steps = []",
        "for _ in range(most):",
        *("    " + line for line in newton),
        *map(statement, tape.segments["answer"]),
        f"return Answer({_tuple([_tuple(level) for level in levels])}, {', '.join(evidence)}, steps)",
    ]
    return "\n".join(
        [
            "def prepare(g):",
            *("    " + line for line in prepare),
            "def advance(u, f, q, profile, most, enough):",
            *("    " + line for line in advance),
            "",
        ]
    )


def _unpacked(names: Sequence[str], given: str) -> list[str]:
    return [f"{_tuple(names)} = {given}"] if names else []


def _tuple(names: Sequence[str]) -> str:
    return f"({', '.join(names)},)" if names else "()"


def _inverse(size: int, *entries: float) -> tuple[Any, ...]:
    matrix = np.array(entries).reshape(size, size)
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        raise ZeroDivisionError("a singular block") from None
    return float(np.linalg.slogdet(matrix)[0]), float(1.0 / np.max(np.sum(np.abs(inverse), axis=1))), inverse


def _apply(inverse: tuple[Any, ...], *right: float) -> list[float]:
    product: list[float] = (inverse[2] @ np.array(right)).tolist()
    return product
