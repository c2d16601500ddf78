"""Production code with one formula changed: the code object of a function is replaced where it lives, and put back.

Nothing is copied and no name is rebound: whoever holds the function, under whatever name, runs the changed text. The
text is that of the source, with one passage replaced that must occur exactly once; so a mutant that no longer fits its
target is an error, and not a mutant that survives.
"""

from __future__ import annotations
import __future__

import ast
import importlib
import inspect
import sys
import textwrap
import types
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import Any

from refkin.fast.compiled import forget


class DoesNotFit(Exception):
    """A replacement whose target or passage does not exist as it says."""


@contextmanager
def mutated(target: str, old: str, new: str) -> Iterator[None]:
    """Run the block with a passage of a function's text replaced.

    Parameters
    ----------
    target : str
        module:function or module:Class.method; a property is its getter.
    old, new : str
        The passage, which occurs exactly once in the function, and what stands there instead.

    Raises
    ------
    DoesNotFit
        If there is no such function or passage, or the changed text is the same program.
    """
    function = resolve(target)
    with switched({function: changed_function(function, old, new, target)}):
        yield


@contextmanager
def switched(changed: Mapping[types.FunctionType, types.FunctionType]) -> Iterator[None]:
    """Run the block with other functions' code in place of some functions' own."""
    before = {f: (f.__code__, f.__defaults__, f.__kwdefaults__) for f in changed}
    forget_caches()
    try:
        for f, other in changed.items():
            f.__code__, f.__defaults__, f.__kwdefaults__ = other.__code__, other.__defaults__, other.__kwdefaults__
        yield
    finally:
        for f, parts in before.items():
            f.__code__, f.__defaults__, f.__kwdefaults__ = parts
        forget_caches()


def resolve(target: str) -> types.FunctionType:
    """Return the function that a target names."""
    module, _, path = target.partition(":")
    try:
        result: Any = importlib.import_module(module)
        for name in path.split("."):
            result = inspect.getattr_static(result, name)
    except (ImportError, AttributeError):
        raise DoesNotFit(f"target: expected module:function, which exists, got {target!r}") from None
    if isinstance(result, property):
        result = result.fget
    if isinstance(result, cached_property):
        result = result.func
    result = inspect.unwrap(result.__func__ if isinstance(result, staticmethod | classmethod) else result)
    if not isinstance(result, types.FunctionType):
        raise DoesNotFit(f"target: expected a function, got {target!r}")
    return result


def changed_function(function: types.FunctionType, old: str, new: str, target: str = "") -> types.FunctionType:
    """Return a function of the changed text, in the function's own module; it is not put anywhere."""
    text = textwrap.dedent(inspect.getsource(function))
    if text.count(old) != 1:
        raise DoesNotFit(f"{target}: expected {old!r} once, found it {text.count(old)} times")
    before, after = (ast.parse(some) for some in (text, text.replace(old, new)))
    if ast.dump(before) == ast.dump(after):
        raise DoesNotFit(f"{target}: the changed text is the same program")
    return compiled(function, after.body[0])


def compiled(function: types.FunctionType, definition: ast.AST) -> types.FunctionType:
    """Return a function of another definition, in the module of the one whose code it is to take the place of."""
    if not isinstance(definition, ast.FunctionDef):
        raise DoesNotFit(f"{function.__qualname__}: expected a plain function")
    definition.decorator_list = []
    # A method that calls super() finds its class in a cell: that of the enclosing function here.
    outer = ast.parse("def outer(__class__):\n    return None").body[0]
    assert isinstance(outer, ast.FunctionDef)
    # Global, for one that calls itself.
    outer.body = [ast.Global([definition.name]), definition, ast.Return(ast.Name(definition.name, ast.Load()))]
    module = ast.fix_missing_locations(ast.Module([outer], []))
    flags = __future__.annotations.compiler_flag
    code = compile(module, inspect.getsourcefile(function) or "<changed>", "exec", flags=flags, dont_inherit=True)
    names: dict[str, Any] = dict(function.__globals__)
    exec(code, names)
    changed = names["outer"](None)
    if changed.__code__.co_freevars != function.__code__.co_freevars:
        raise DoesNotFit(f"{function.__qualname__}: the changed text has other free variables")
    return changed


def forget_caches() -> None:
    """Empty the caches of functions and programs of this project: what other formulas gave must not be found again."""
    forget()
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] in ("refkin", "crosscheck", "tests"):
            for value in list(vars(module).values()):
                clear = getattr(value, "cache_clear", None)
                if callable(clear) and hasattr(value, "__wrapped__"):
                    clear()
