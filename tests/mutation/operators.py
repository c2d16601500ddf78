"""What a random mutant may change in a function: one operator, comparison, constant or choice in its body."""

from __future__ import annotations

import ast
import copy
from dataclasses import dataclass
from functools import cache

SWAPS = {
    **{ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Div},
    **{ast.Mod: ast.Mult, ast.Pow: ast.Mult, ast.MatMult: ast.Mult},
    **{ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.BitXor: ast.BitOr, ast.LShift: ast.RShift},
    **{ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq},
    **{ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And},
}
NAMES = {"min": "max", "all": "any", "minimum": "maximum", "argmin": "argmax", "floor": "ceil", "sin": "cos"}
NAMES |= {other: name for name, other in NAMES.items()}


@dataclass(frozen=True)
class Change:
    """A statement of a function, and what stands there instead; `place` finds it in the function's tree."""

    target: str
    line: int
    old: str
    new: str
    place: tuple[int, int]

    @property
    def key(self):
        """What it is called, wherever in its file the function stands."""
        return f"{self.target}: {self.old}  ->  {self.new}"


def places(definition):
    """Yield where a function may be changed, in the order of its tree."""
    for number, node in enumerate(ast.walk(definition)):
        for kind, _ in enumerate(alternatives(node)):
            yield number, kind


def changes(target, definition, key=None):
    """Yield the changes of a function, or those that are called so, each with its tree and the statement in it."""
    for place in places(definition):
        what, tree, statement = change(target, definition, place, key)
        if what is not None and key in (None, what.key):
            yield what, tree, statement


def change(target, definition, place, key=None):
    """Return the change of a function at a place, its tree with it, and the statement; None where nothing would change.

    The tree says `__reached__(target)` before the statement. None, too, if it cannot be what is called `key`.
    """
    nodes = list(ast.walk(definition))
    statement, old = statements(definition).get(nodes[place[0]], (None, ""))
    if statement is None or not (key is None or key.startswith(f"{target}: {old}  ->  ")):
        return None, None, None
    tree = copy.deepcopy(definition)
    there = list(ast.walk(tree))
    other = there[nodes.index(statement)]
    alternatives(there[place[0]])[place[1]](there[place[0]])
    new = text(other)
    if old == new:
        return None, None, None
    block = block_of(tree, other)
    probe = ast.parse(f"__reached__({target!r})").body[0]
    block.insert(next(k for k, each in enumerate(block) if each is other), probe)
    return Change(target, statement.lineno, old, new, place), tree, statement


def alternatives(node):
    """Return what a node may be changed to, as functions that change it."""
    match node:
        case ast.BinOp() | ast.BoolOp() | ast.AugAssign() if type(node.op) in SWAPS:
            return [lambda n: setattr(n, "op", SWAPS[type(n.op)]())]
        case ast.Compare() if type(node.ops[0]) in SWAPS:
            return [lambda n: n.ops.__setitem__(0, SWAPS[type(n.ops[0])]())]
        case ast.UnaryOp(op=ast.USub()):
            return [lambda n: setattr(n, "op", ast.UAdd())]
        case ast.UnaryOp(op=ast.Not()):
            return [lambda n: setattr(n, "operand", ast.UnaryOp(ast.Not(), n.operand))]
        case ast.Constant(value=bool()):
            return [lambda n: setattr(n, "value", not n.value)]
        case ast.Constant(value=int()):
            return [lambda n: setattr(n, "value", n.value + 1)]
        case ast.Constant(value=float()):
            return [lambda n: setattr(n, "value", 1.5 * n.value or 1.0)]
        case ast.Name(id=name) if name in NAMES:
            return [lambda n: setattr(n, "id", NAMES[n.id])]
        case ast.Attribute(attr=name) if name in NAMES:
            return [lambda n: setattr(n, "attr", NAMES[n.attr])]
        case ast.IfExp() | ast.If():
            return [lambda n: setattr(n, "test", ast.UnaryOp(ast.Not(), n.test))]
    return []


@cache
def statements(tree):
    """Return the innermost statement of each node but defaults, annotations, words, and `strict`; and its text."""
    result = {}

    def visit(node, statement):
        other = isinstance(node, ast.Raise | ast.JoinedStr | ast.FunctionDef | ast.AnnAssign)
        if other or (isinstance(node, ast.keyword) and node.arg == "strict"):
            return
        statement = (node, text(node)) if isinstance(node, ast.stmt) else statement
        result[node] = statement
        for child in ast.iter_child_nodes(node):
            visit(child, statement)

    for node in tree.body:
        visit(node, None)
    return result


def block_of(tree, statement):
    """Return the list of statements in which one stands."""
    for node in ast.walk(tree):
        for name in ("body", "orelse", "finalbody"):
            block = getattr(node, name, None)
            if isinstance(block, list) and any(other is statement for other in block):
                return block
    raise LookupError(ast.unparse(statement))


def text(statement):
    """Return a statement's text without the block that it leads."""
    if not hasattr(statement, "body"):
        return ast.unparse(statement)
    short = copy.copy(statement)
    short.body = [ast.Pass()]
    for name in ("orelse", "finalbody", "handlers"):
        if hasattr(short, name):
            setattr(short, name, [])
    return ast.unparse(short).partition("\n    pass")[0]
