"""Running error analysis as expressions: for every symbol another one, a bound of what its value is off by.

The bound of an operation is what its operands' bounds make of it, plus u times the result for its own rounding (Higham,
Accuracy and Stability of Numerical Algorithms, section 3.3). It is made of sums and products of non-negative numbers,
so its own rounding is a factor within 1 +- depth times u, which whoever reads a bound makes good with `UP`.

Bounds are folded and shared like all expressions: a number that is exact has the bound 0, and costs nothing.
"""

from __future__ import annotations

from collections.abc import Mapping

from refkin.errors import RefkinError
from refkin.proof.numbers.bounded import U
from refkin.proof.numbers.symbols import Graph, Symbol, needed


class NoBound(RefkinError):
    """An operation without a bound: profiles, and what chooses between values."""


class Errors:
    """Bounds of the errors of symbols.

    Parameters
    ----------
    known : mapping
        Bounds of some symbols: of all inputs that are needed, and of numbers that are meant as they stand.
    """

    def __init__(self, graph: Graph, known: Mapping[Symbol, Symbol]) -> None:
        self.graph = graph
        self.done = dict(known)
        self._u, self._sine = graph.constant(U), graph.constant(4 * U)

    def of(self, symbol: Symbol) -> Symbol:
        """Return the bound of |value - exact value|."""
        for each in needed((symbol,), self.done):
            self.done[each] = self._bound(each)
        return self.done[symbol]

    def largest(self, symbol: Symbol) -> Symbol:
        """Return a bound of the exact value's size."""
        return abs(symbol) + self.of(symbol)

    def _bound(self, symbol: Symbol) -> Symbol:
        if symbol.op == "const":
            return self.graph.constant(0.0)
        errors = [self.done[a] for a in symbol.args]
        if symbol.op in ("neg", "abs"):
            return errors[0]
        if symbol.op in ("cos", "sin"):  # slopes of at most 1, and within 2 ulp, as `proof.numbers.bounded` has it
            return errors[0] + self._sine * abs(symbol)
        if symbol.op in ("add", "sub"):
            return errors[0] + errors[1] + self._u * abs(symbol)
        if symbol.op == "mul":
            (a, b), (off_a, off_b) = symbol.args, errors
            return abs(a) * off_b + (abs(b) + off_b) * off_a + self._u * abs(symbol)
        raise NoBound(f"no bound of the error of {symbol.op}")
