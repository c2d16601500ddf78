"""The lanes' tape as C: the same list of operations, a scalar at a time, for a compiler to do its best with."""

from __future__ import annotations

from typing import Any

FUNCTIONS = {"abs": "fabs({0})", "max": "fmax2({0}, {1})", "min": "fmin2({0}, {1})", "select": "({0} ? {1} : {2})"}
PLAIN = ("add", "sub", "mul", "div", "neg", "greater", "cos", "sin", "tan", "copy")
HEAD = """#include <math.h>
#define NU {u}
#define NW {w}
#define NM {m}
#define CORE {core}
#define LEVELS {levels}
#define MARCHED {marched}
static inline double fmax2(double a, double b) {{ return a > b ? a : b; }}
static inline double fmin2(double a, double b) {{ return a < b ? a : b; }}
"""


class NotInC(Exception):
    """A tape with operations that call back into NumPy: large blocks, profiles."""


def emitted(tape: Any) -> str:
    """Return `tape.h` for `tape.c`.

    Parameters
    ----------
    tape : refkin.fast.lanes.tape.Tape
        Its geometry's inputs become g[0], g[1], ... in the order of `geometry_of`; its one law is that of the driver.

    Raises
    ------
    NotInC
        If an operation is more than arithmetic.
    """
    out, sizes = tape.outputs, tape.sizes
    levels = [row for rows in out.levels for row in rows]
    core = [out.levels[0][c] for c in tape.core]
    marched = bool(out.levels[2])
    head = HEAD.format(
        u=sizes["u"], w=sizes["w"], m=sizes["m"], core=len(core), levels=len(levels), marched=int(marched)
    )
    constants = [f"    {_name(r)} = {value!r};" for r, value in tape.constants.items()]
    given = [f"    u[{r.number}] = g[{k}];" for k, (r, _) in enumerate(geometry_of(tape))]
    laws = [f"    w[{r.number}] = f{leaf.place[2]};" for leaf, r in tape.inputs.items() if leaf.kind == "f"]
    predicting = ("q", "v", "a") if marched else ()
    leaving = [
        f"    {name}[{k}] = w[{rows[c]}];"
        for name, rows in zip(predicting, out.levels, strict=False)
        for k, c in enumerate(tape.core)
    ]
    sign = " * ".join(f"copysign(1.0, w[{k}])" for k in out.determinants) or "1.0"
    state = "const double *u, double *w, int *m"
    functions = [
        _function("inputs", "double *u, const double *g", [*constants, *given]),
        _function("laws", "double *w, double f0, double f1, double f2", [*laws, "    (void)f0; (void)f1; (void)f2;"]),
        _function("mechanism", "double *u", _statements(tape.segments["mechanism"])),
        _function("times", state, ["    (void)u; (void)w; (void)m;", *_statements(tape.segments["time"])]),
        _function("newton", state, ["    (void)m;", *_statements(tape.segments["newton"])]),
        _function("answer", state, ["    (void)m;", *_statements(tape.segments["answer"])]),
        _function("core_in", "double *w, const double *q", [f"    w[{row}] = q[{k}];" for k, row in enumerate(core)]),
        _function("core_out", "const double *w, double *q, double *v, double *a", leaving),
        _function(
            "levels_out", "const double *w, double *to", [f"    to[{k}] = w[{row}];" for k, row in enumerate(levels)]
        ),
        f"static inline double step_of(const double *w) {{ return w[{out.step}]; }}",
        f"static inline double sign_of(const double *w) {{ return {sign}; }}",
    ]
    return head + "\n".join(functions) + "\n"


def geometry_of(tape: Any) -> list[tuple[Any, tuple[int, int]]]:
    """Return the registers of the geometry with (constraint, number) of what they hold."""
    return [(register, leaf.place) for leaf, register in tape.inputs.items() if leaf.kind == "g"]


def _function(name: str, arguments: str, lines: list[str]) -> str:
    body = "\n".join(lines)
    return f"static inline void {name}({arguments})\n{{\n{body}\n}}\n"


def _statements(instructions: Any) -> list[str]:
    return [f"    {_name(i.out)} = {_expression(i)};" for i in instructions]


def _expression(instruction: Any) -> str:
    from refkin.fast.lanes.tape import FORMATS  # here: the fast paths may be absent

    op, args = instruction.op, [_name(a) for a in instruction.args]
    if op in FUNCTIONS:
        return FUNCTIONS[op].format(*args)
    if op in PLAIN:
        return FORMATS[op].format(*args)
    raise NotInC(f"the tape holds {op!r}, which is no arithmetic")


def _name(register: Any) -> str:
    if register.bank == "x":
        raise NotInC("the tape solves a block of three or more at once")
    return f"{register.bank}[{register.number}]"
