"""A number of its own kind: a symbol, on which the joints' formulas leave an expression instead of a value.

Every symbol is a node of a `Graph`. Equal expressions are one node (hash-consing), and what is known is folded at once:
constants, 0 and 1, double signs. So a common subexpression is found where it arises, and an entry of a Jacobian that is
always zero is the constant 0. Folding never changes a value: only exact identities of binary64 are used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import Any, NamedTuple, cast

import numpy as np

from refkin.system import EVERYTHING, ConstraintRows, System


class Leaf(NamedTuple):
    """What a symbol stands for: a number that is given when the formulas are run.

    Attributes
    ----------
    kind : str
        "g" geometry, "f" a law's value or derivative, "q" a coordinate, "qd" its rate.
    place : tuple of int
        "g": (constraint, number); "f": (constraint, law, order); "q", "qd": (coordinate,).
    """

    kind: str
    place: tuple[int, ...]


class Symbol:
    """A node: an operation, the nodes it works on, and what else it needs (`value`).

    ========= ============================ =================================================
    op        args                         value
    ========= ============================ =================================================
    const                                  the number
    input                                  a `Leaf`
    add ...   two                          (add, sub, mul, div, max, greater)
    neg ...   one                          (neg, abs, cos, sin, tan)
    select    mask, x, y: x where mask
    profile   the parameter s              (constraint, order): a derivative of its profile
    inverse   the entries of a matrix      the number of its rows
    apply     an inverse, a right side
    entry     an inverse or an applied one which number of it
    ========= ============================ =================================================
    """

    __slots__ = ("args", "graph", "index", "op", "value")
    __array_ufunc__ = None  # an array on the left of + - * leaves the operation to this class

    def __init__(self, graph: Graph, op: str, args: tuple[Symbol, ...], value: Any, index: int) -> None:
        self.graph, self.op, self.args, self.value, self.index = graph, op, args, value, index

    def __add__(self, other: Any) -> Symbol:
        return self.graph.add(self, self.graph.lift(other))

    def __sub__(self, other: Any) -> Symbol:
        return self.graph.sub(self, self.graph.lift(other))

    def __rsub__(self, other: Any) -> Symbol:
        return self.graph.sub(self.graph.lift(other), self)

    def __mul__(self, other: Any) -> Symbol:
        return self.graph.mul(self, self.graph.lift(other))

    def __truediv__(self, other: Any) -> Symbol:
        return self.graph.div(self, self.graph.lift(other))

    def __rtruediv__(self, other: Any) -> Symbol:
        return self.graph.div(self.graph.lift(other), self)

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self) -> Symbol:
        return self.graph.neg(self)

    def __abs__(self) -> Symbol:
        return self.graph.size(self)

    def cos(self) -> Symbol:
        """Return the cosine."""
        return self.graph.node("cos", self)

    def sin(self) -> Symbol:
        """Return the sine."""
        return self.graph.node("sin", self)

    @property
    def zero(self) -> bool:
        """Whether the symbol is the constant 0."""
        return self.op == "const" and self.value == 0.0

    @property
    def unit(self) -> int:
        """1 or -1 if the symbol is that constant, else 0."""
        return int(self.value) if self.op == "const" and abs(self.value) == 1.0 else 0

    def __repr__(self) -> str:
        if self.op == "const":
            return f"{self.value:g}"
        if self.op == "input":
            return f"{self.value.kind}{list(self.value.place)}"
        return f"{self.op}({', '.join(map(repr, self.args))})"


class Graph:
    """The nodes, each once, in an order in which no node comes before its arguments."""

    def __init__(self) -> None:
        self._nodes: dict[tuple[Any, ...], Symbol] = {}

    def node(self, op: str, *args: Symbol, value: Any = None) -> Symbol:
        """Return the node of an operation, without folding."""
        key = (op, value, args)
        symbol = self._nodes.get(key)
        if symbol is None:
            symbol = self._nodes[key] = Symbol(self, op, args, value, len(self._nodes))
        return symbol

    def constant(self, value: float) -> Symbol:
        """Return a number that is known now."""
        return self.node("const", value=float(value) + 0.0)  # -0.0 is 0.0

    def input(self, kind: str, *place: int) -> Symbol:
        """Return a number that is given when the formulas are run."""
        return self.node("input", value=Leaf(kind, place))

    def lift(self, x: Any) -> Symbol:
        """Return a plain number as a symbol."""
        if isinstance(x, Symbol):
            return x
        if not isinstance(x, Real):
            raise TypeError(f"expected a symbol or a real number, got {x!r}")
        return self.constant(float(x))

    def add(self, a: Symbol, b: Symbol) -> Symbol:
        """Return a + b."""
        if a.op == "const" and b.op == "const":
            return self.constant(a.value + b.value)
        if a.zero or b.zero:
            return b if a.zero else a
        if b.op == "neg":
            return self.sub(a, b.args[0])
        if a.op == "neg":
            return self.sub(b, a.args[0])
        return self.node("add", *ordered(a, b))

    def sub(self, a: Symbol, b: Symbol) -> Symbol:
        """Return a - b."""
        if a.op == "const" and b.op == "const":
            return self.constant(a.value - b.value)
        if b.zero:
            return a
        if a.zero:
            return self.neg(b)
        if a is b:
            return self.constant(0.0)
        if b.op == "neg":
            return self.add(a, b.args[0])
        if a.op == "neg":
            return self.neg(self.add(a.args[0], b))
        return self.node("sub", a, b)

    def mul(self, a: Symbol, b: Symbol) -> Symbol:
        """Return a b."""
        if a.op == "const" and b.op == "const":
            return self.constant(a.value * b.value)
        for known, other in ((a, b), (b, a)):
            if known.zero:
                return known
            if known.unit:
                return other if known.unit > 0 else self.neg(other)
        if a.op == "neg":
            return self.neg(self.mul(a.args[0], b))
        if b.op == "neg":
            return self.neg(self.mul(a, b.args[0]))
        return self.node("mul", *ordered(a, b))

    def div(self, a: Symbol, b: Symbol) -> Symbol:
        """Return a / b."""
        if a.zero or b.unit:
            return a if a.zero or b.unit > 0 else self.neg(a)
        if a.op == "neg":
            return self.neg(self.div(a.args[0], b))
        return self.node("div", a, b)

    def neg(self, a: Symbol) -> Symbol:
        """Return -a."""
        if a.op == "const":
            return self.constant(-a.value)
        if a.op == "neg":
            return a.args[0]
        if a.op == "sub":
            return self.node("sub", a.args[1], a.args[0])
        return self.node("neg", a)

    def size(self, a: Symbol) -> Symbol:
        """Return |a|."""
        if a.op == "const":
            return self.constant(abs(a.value))
        if a.op in ("abs", "neg"):
            return a if a.op == "abs" else self.size(a.args[0])
        return self.node("abs", a)

    def largest(self, symbols: Iterable[Symbol]) -> Symbol:
        """Return the largest of symbols that are not negative, 0 of none."""
        largest = self.constant(0.0)
        for symbol in symbols:
            if not symbol.zero:
                largest = symbol if largest.zero else self.node("max", largest, symbol)
        return largest

    def again(self, symbol: Symbol, args: tuple[Symbol, ...]) -> Symbol:
        """Return a symbol's operation on other arguments, folded."""
        fold: Callable[..., Symbol] | None = _FOLDED.get(symbol.op)
        return self.node(symbol.op, *args, value=symbol.value) if fold is None else fold(self, *args)


_FOLDED: Mapping[str, Callable[..., Symbol]] = {
    "add": Graph.add,
    "sub": Graph.sub,
    "mul": Graph.mul,
    "div": Graph.div,
    "neg": Graph.neg,
    "abs": Graph.size,
}


def ordered(a: Symbol, b: Symbol) -> tuple[Symbol, Symbol]:
    """Return two symbols in the order in which they came to be: a b and b a are one node."""
    return (a, b) if a.index <= b.index else (b, a)


def needed(outputs: Iterable[Symbol], known: Mapping[Symbol, Any] | None = None) -> list[Symbol]:
    """Return the nodes that the outputs need, themselves included, arguments first; those in `known` end the search."""
    known = known or {}
    reached: set[Symbol] = set()
    waiting = list(outputs)
    while waiting:
        symbol = waiting.pop()
        if symbol not in reached and symbol not in known:
            reached.add(symbol)
            waiting.extend(symbol.args)
    return sorted(reached, key=lambda s: s.index)


def substitute(
    output: Symbol, done: dict[Symbol, Symbol], rule: Callable[[Symbol, Any], Symbol] | None = None
) -> Symbol:
    """Return an expression with the symbols in `done` replaced; what is replaced on the way is added to `done`.

    Parameters
    ----------
    output : Symbol
        The expression.
    done : dict of Symbol to Symbol
        What becomes what; grows.
    rule : callable, optional
        From an old symbol and its new arguments to a new one; by default it is the same operation.
    """
    for symbol in needed((output,), done):
        args = tuple(done[a] for a in symbol.args)
        if rule is not None:
            done[symbol] = rule(symbol, args)
        else:
            done[symbol] = symbol.graph.again(symbol, args) if args else symbol
    return done[output]


def symbolic_system(system: System, graph: Graph, geometry: Sequence[tuple[Symbol, ...]], *, held: bool) -> System:
    """Return a system whose formulas leave expressions: its geometry is given, per constraint; laws are inputs.

    What is passive is held as it was estimated or, `held`, as inputs say.

    Parameters
    ----------
    system : System
    graph : Graph
        Where expressions are kept.
    geometry : sequence of tuple of Symbol
        Per constraint its scaled numbers.
    held : bool
        What is passive moves as laws say.
    """
    placed = [
        replace(p, constraint=cast(Any, _Symbolic(p.constraint, graph, k)), g=cast(Any, g))
        for k, (p, g) in enumerate(zip(system.placed, geometry, strict=True))
    ]
    gauge = {p.row: held_by(graph, k) for k, p in passive_of(system)} if held else system.gauge
    return replace(system, placed=tuple(placed), effects=EVERYTHING, gauge=gauge)


def passive_of(system: System) -> list[tuple[int, ConstraintRows]]:
    """Return the constraints that hold what is passive, by their numbers."""
    return [(k, p) for k, p in enumerate(system.placed) if p.constraint.passive]


def held_by(graph: Graph, k: int) -> tuple[Symbol, ...]:
    """Return the inputs that say how a constraint holds what is passive, as `gauge` does."""
    return tuple(graph.input("f", k, m, 0) for m in range(4))


class _Symbolic:
    """A constraint whose laws and profile are inputs; its formulas are the constraint's own."""

    def __init__(self, constraint: Any, graph: Graph, k: int) -> None:
        self.constraint, self.graph, self.k = constraint, graph, k

    def __getattr__(self, name: str) -> Any:
        return getattr(self.constraint, name)

    def inputs(self, t: Any, unit: Any, order: int) -> tuple[tuple[Symbol, ...], ...]:
        laws = range(len(self.constraint.laws))
        return tuple(tuple(self.graph.input("f", self.k, law, m) for m in range(order + 1)) for law in laws)

    def profile_values(self, s: Symbol, unit: Any, order: int) -> tuple[Symbol, ...]:
        return tuple(self.graph.node("profile", s, value=(self.k, m)) for m in range(order + 1))


def coordinates(graph: Graph, kind: str, n: int) -> Any:
    """Return coordinates ("q"), or their rates ("qd"), as inputs, (n,).

    Parameters
    ----------
    graph : Graph
    kind : str
        "q" or "qd".
    n : int
        How many.
    """
    out = np.empty(n, object)
    for c in range(n):
        out[c] = graph.input(kind, c)
    return out
