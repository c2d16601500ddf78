"""The certificate as one more program: exactly one solution is near these numbers, and it is no further than this.

It is that of `proof.pose.certificate`, block by block, on the equations that elimination leaves. For a block let z be
its core coordinates, F its open rows with the spanning tree seen through, M = dF/dz, R about the inverse of M, and

    eta >= |R F(z)|     gamma >= sum of all |I - R M(x)|, |x - z| <= b,   b = 9/8 max eta.

With gamma <= 1/16 the map x - R F(x) takes the box of radius b into itself, since max eta + gamma b <= b; so there is a
root in it, and only one, since gamma < 1. Blocks upstream are known within their own b, and F, M are bounded for all
values there; so this holds for the exact ones. What the tree states has then the bound that running errors give it.

Velocity solves an affine equation with the same M at the root: w - w* = R (M w - nu) + (I - R M) (w - w*), so with
h >= |R (M w - nu)| it is |w - w*| <= max h / (1 - gamma) <= 9/8 max h. Acceleration likewise.

Running errors are expressions too: the bound of an operation is what its operands' bounds make of it, plus u times the
result for its own rounding (Higham, Accuracy and Stability of Numerical Algorithms, section 3.3). It is made of sums
and products of non-negative numbers, so its own rounding is a factor within 1 +- depth times u, which whoever reads a
bound makes good with `UP`. A number that is exact has the bound 0, and costs nothing.

Nothing is taken from the program that solved: sines are the library's, coordinates and rates are as they were given.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from refkin.errors import RefkinError
from refkin.fast.elimination.eliminate import Eliminated, Elimination, NotReducible
from refkin.fast.elimination.run import Workspaces
from refkin.fast.elimination.schedule import schedule
from refkin.fast.elimination.trace import Known, Traced, trace
from refkin.proof.numbers.bounded import TINY, U
from refkin.proof.numbers.symbols import Graph, Symbol, held_by, needed, passive_of, substitute
from refkin.system import System

ORDERS = 3
"""In the inputs of a law, its values and derivatives come first, then, from this place on, their errors."""
WIDER = 9 / 8
LARGEST_GAMMA = 1 / 16


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


def proof_of(system: System, zeros: Known, levels: int) -> Workspaces | None:
    """Return the certificate of a system with as many rows as coordinates; None if there is none by this means.

    It is a program whose first level has gamma, then the largest radius of each given level. Inputs are, per
    constraint, geometry and then its errors; per law, `ORDERS` values and then their errors; and as the laws of one
    more constraint the given levels.

    Parameters
    ----------
    system : System
    zeros : tuple
        Which numbers of its geometry are 0, 1 or -1, as `known_of` returns it.
    levels : int
        How many levels it certifies: 1 to 3.
    """
    traced = trace(system, zeros, range(system.n), held=True)
    try:
        outputs = _Prover(system, traced, levels).outputs()
    except (NoBound, NotReducible):
        return None
    return Workspaces(schedule(Eliminated((outputs, [], [])), traced.graph, [range(len(outputs))], half_angles=False))


class _Prover:
    """Bounds of the errors of all symbols, filled in block by block and level by level."""

    def __init__(self, system: System, traced: Traced, levels: int) -> None:
        self.system, self.traced, self.levels, self.graph = system, traced, levels, traced.graph
        self.parts = Elimination(traced)
        self.moved = {self.graph.input("q", c): self._given(0, c) for c in self.parts.core}
        self.errors = Errors(self.graph, self._of_inputs())
        self.gammas: list[Symbol] = []
        self.numbers: set[Symbol] = set()
        self.inverses = [self._inverse(k) for k in range(len(self.parts.groups))]

    def outputs(self) -> list[Symbol]:
        """Return gamma, and the radius of each level."""
        core, n = self.parts.core, self.system.n
        radii = [self._level(0, [self._here(x) for x in self.traced.phi], [self._here(x) for x in self.parts.q])]
        right = self.traced.nu
        known = dict(self.parts.known)
        for order in range(1, self.levels):
            sides = [substitute(x, known) for x in right]
            rates = self.parts.along_tree({c: self._given(order, c) for c in core}, sides)
            radii.append(self._level(order, self._equations(sides, rates), [self._at(rates[c]) for c in range(n)]))
            known |= {self.graph.input("qd", c): rates[c] for c in range(n)}
            right = self.traced.gamma
        return [self.graph.largest(self.gammas), *radii]

    def _equations(self, sides: Sequence[Symbol], rates: dict[int, Symbol]) -> list[Symbol]:
        """Return phi_q rates - right side, row by row."""
        rows = []
        for slope, side in zip(self.parts.slope, sides, strict=True):
            row = -side
            for c, entry in slope.items():
                row = row + entry * rates[c]
            rows.append(self._at(row))
        return rows

    def _level(self, order: int, rows: Sequence[Symbol], values: Sequence[Symbol]) -> Symbol:
        """Enclose the core coordinates, or their rates, by the open rows; return the largest radius of all n."""
        for k, (columns, open_rows, _) in enumerate(self.parts.groups):
            own = [self._given(order, c) for c in columns]
            zero = self.graph.constant(0.0)
            centred = Errors(self.graph, {**self._leaves(), **dict.fromkeys(own, zero)})
            residual = [rows[self.parts.open_rows[i]] for i in open_rows]
            carried = [centred.largest(_dot(row, residual)) for row in self.inverses[k]]
            radius = self.graph.largest(carried) * WIDER + TINY
            self.errors.done.update(dict.fromkeys(own, radius))
            if order == 0:
                self.gammas.append(self._gamma(k))
        off = []
        for c, value in enumerate(values):
            given = self._given(order, c)
            if c not in self.parts.core:
                self.errors.done[given] = self.graph.constant(0.0)
            off.append(self.errors.done[given] if c in self.parts.core else self.errors.largest(value - given))
        return self.graph.largest(off)

    def _gamma(self, k: int) -> Symbol:
        """Return the sum of the bounds of |I - R M| over the box."""
        columns, open_rows, _ = self.parts.groups[k]
        zero, total = self.graph.constant(0.0), self.graph.constant(0.0)
        matrix = [[self._at(self.parts.matrix[i].get(c, zero)) for c in columns] for i in open_rows]
        for i, row in enumerate(self.inverses[k]):
            for j in range(len(columns)):
                entry = _dot(row, [others[j] for others in matrix]) - float(i == j)
                total = total + self.errors.largest(entry)
        return total

    def _inverse(self, k: int) -> list[list[Symbol]]:
        """Return R of a block, row by row: numbers that are meant as they stand."""
        columns, _, block = self.parts.groups[k]
        size = range(len(columns))
        solutions = [block.solve([self.graph.constant(float(i == j)) for i in size]) for j in size]
        rows = [[self._at(solutions[j][i]) for j in size] for i in size]
        for x in (x for row in rows for x in row):
            plain = x.args[0] if x.op == "neg" else x  # a product with -x is folded to one with x
            if plain.op not in ("const", "div", "entry"):
                raise NoBound("an entry of R may stand in the equations, too, which divide by nothing")
            self.errors.done[x] = self.errors.done[plain] = self.graph.constant(0.0)
            self.numbers.add(plain)
        return rows

    def _here(self, symbol: Symbol) -> Symbol:
        return self._at(substitute(symbol, self.parts.known))

    def _at(self, symbol: Symbol) -> Symbol:
        """Return an expression at the given core coordinates."""
        return substitute(symbol, self.moved)

    def _given(self, order: int, c: int) -> Symbol:
        return self.graph.input("f", len(self.system.placed), order, c)

    def _of_inputs(self) -> dict[Symbol, Symbol]:
        """Return the errors of geometry and laws, inputs themselves."""
        errors = {}
        for k, p in enumerate(self.system.placed):
            for m in range(len(p.g)):
                errors[self.graph.input("g", k, m)] = self.graph.input("g", k, len(p.g) + m)
            for law in range(len(p.constraint.laws)):
                for m in range(ORDERS):
                    errors[self.graph.input("f", k, law, m)] = self.graph.input("f", k, law, ORDERS + m)
        for k, _ in passive_of(self.system):  # numbers that are meant as they stand
            errors |= dict.fromkeys(held_by(self.graph, k), self.graph.constant(0.0))
        return errors

    def _leaves(self) -> dict[Symbol, Symbol]:
        """Return what is known of inputs and inverses, without what follows from it."""
        return {s: e for s, e in self.errors.done.items() if s.op == "input" or s in self.numbers}


def _dot(a: Iterable[Symbol], b: Iterable[Symbol]) -> Any:
    return sum(x * y for x, y in zip(a, b, strict=True))
