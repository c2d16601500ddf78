"""Running one sample at a time: a program becomes Python functions, which beat NumPy calls on a few samples by far.

The source is the program's own text (`program.text`), with the Newton segment in a loop. Nothing of a scene is in that
text but numbers of registers, so there is nothing in it that somebody else wrote.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from refkin.fast.elimination.program import Program, statement


class Answer(NamedTuple):
    """What `Single.advance` returns.

    Attributes
    ----------
    levels : tuple of three tuples
        The wanted coordinates, their rates, their accelerations; empty if the program has none.
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
    """The functions of a program.

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


def compile_single(program: Program, wanted: Sequence[int]) -> Single:
    """Return the functions of a program whose answer is about the coordinates `wanted`."""
    scope = {"cos": math.cos, "sin": math.sin, "tan": math.tan, "inverse": _inverse, "apply": _apply, "Answer": Answer}
    exec(compile(source(program, wanted), "<program>", "exec"), scope)
    places = {kind: [leaf.place for leaf in program.inputs if leaf.kind == kind] for kind in "gf"}
    prepare: Any = scope["prepare"]
    advance: Any = scope["advance"]
    return Single(prepare, advance, places["g"], places["f"])


def source(program: Program, wanted: Sequence[int]) -> str:
    """Return the source of the functions."""
    inputs = {kind: [str(r) for leaf, r in program.inputs.items() if leaf.kind == kind] for kind in "gf"}
    core = [f"w{k}" for k in program.outputs.core]
    u = [f"u{k}" for k in range(program.sizes["u"])]
    levels = [[f"w{rows[c]}" for c in wanted if rows] for rows in program.outputs.levels]
    evidence = [_tuple([f"w{k}" for k in rows]) for rows in (program.outputs.determinants, program.outputs.pivots)]
    prepare = [
        *_unpacked(inputs["g"], "g"),
        *(f"{register} = {number!r}" for register, number in program.constants.items()),
        *map(statement, program.segments["mechanism"]),
        f"return {_tuple(u)}",
    ]
    step = f"w{program.outputs.step}"
    newton = [*map(statement, program.segments["newton"]), f"steps.append({step})", f"if {step} <= enough: break"]
    advance = [
        *_unpacked(u, "u"),
        *_unpacked(inputs["f"], "f"),
        *_unpacked(core, "q"),
        *map(statement, program.segments["time"]),
        "steps = []",
        "for _ in range(most):",
        *("    " + line for line in newton),
        *map(statement, program.segments["answer"]),
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
    largest = float(np.max(np.sum(np.abs(inverse), axis=1)))
    if not largest < math.inf:  # of entries beyond all numbers NumPy would warn whoever runs this
        raise OverflowError("a block without a finite inverse")
    return float(np.linalg.slogdet(matrix)[0]), 1.0 / largest, inverse


def _apply(inverse: tuple[Any, ...], *right: float) -> list[float]:
    product: list[float] = (inverse[2] @ np.array(right)).tolist()
    return product
