"""C sources, compiled on the spot by the machine's own compiler, and loaded: those of this package, and one emitted.

What is emitted is the samples' program: the same list of operations, a scalar at a time, for a compiler to do its best
with. Nothing is kept: sources and libraries live in a temporary folder. Where there is no compiler, or it does not take
the sources, the methods in C are absent and say why.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.engines import EngineError

FLAGS = ("-O3", "-march=native", "-std=c11", "-shared", "-fPIC")
COMPILERS = ("cc", "gcc", "clang")
HEADERS = ("march.h",)
SECONDS = 120.0
"""So long a compiler may take."""
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


def compiler() -> str:
    """Return the compiler: $CC, or the first of `COMPILERS` there is; EngineError if there is none."""
    wanted = os.environ.get("CC")
    for name in (wanted,) if wanted else COMPILERS:
        path = shutil.which(name)
        if path:
            return path
    raise EngineError(f"no C compiler: looked for {wanted or ', '.join(COMPILERS)}")


def compiler_version() -> str:
    """Return the first line of what the compiler says of itself, with the flags."""
    process = subprocess.run([compiler(), "--version"], capture_output=True, text=True, check=False, timeout=SECONDS)
    first = (process.stdout.strip().splitlines() or ["unknown"])[0]
    return f"{first} ({' '.join(FLAGS[:2])})"


def library(source: str, **generated: str) -> Any:
    """Return a source file of this package compiled and loaded, EngineError if it cannot be; nothing is kept on disk.

    `generated` are headers that are no files of the package: name without ".h" -> text.
    """
    with tempfile.TemporaryDirectory(prefix="crosscheck-bench-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        for header in (source, *HEADERS):
            (folder / header).write_text(text_of(header), encoding="utf-8")
        for header, text in generated.items():
            (folder / f"{header}.h").write_text(text, encoding="utf-8")
        command = [compiler(), *FLAGS, "-o", str(folder / "kernel.so"), str(folder / source), "-lm"]
        try:
            process = subprocess.run(command, capture_output=True, text=True, check=False, timeout=SECONDS)
        except subprocess.TimeoutExpired as error:
            raise EngineError(f"the C compiler took more than {SECONDS:.0f} s for {source}") from error
        if process.returncode:
            raise EngineError(f"the C compiler refused {source}: {(process.stderr.strip().splitlines() or ['?'])[0]}")
        return ctypes.CDLL(str(folder / "kernel.so"))  # it stays loaded when its file is gone


def text_of(name: str) -> str:
    """Return the text of a C file of this package."""
    return (files("crosscheck.engines.ours") / "c" / name).read_text(encoding="utf-8")


def rows(x: Any) -> Any:
    """Return numbers (k, M) as C has them, mechanism by mechanism."""
    return np.ascontiguousarray(np.transpose(x), float)


def row_of(x: Any) -> Any:
    """Return an array of doubles as C takes it."""
    return x.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def emitted(program: Any) -> str:
    """Return `program.h` for `program.c`; EngineError if an operation is more than arithmetic.

    A program's (`refkin.fast.elimination.program`) inputs of geometry become g[0], g[1], ... in the order of
    `geometry_of`; its one law is that of the driver.
    """
    sizes, levels = program.sizes, _levels(program)
    head = HEAD.format(
        u=sizes["u"],
        w=sizes["w"],
        m=sizes["m"],
        core=len(program.core),
        levels=len(levels),
        marched=int(bool(program.outputs.levels[2])),
    )
    return head + "\n".join([*_inputs(program), *_segments(program), *_outputs(program)]) + "\n"


def _inputs(program: Any) -> list[str]:
    """Return the functions that write constants, geometry, laws and the core coordinates."""
    constants = [f"    {_name(r)} = {value!r};" for r, value in program.constants.items()]
    given = [f"    u[{r.number}] = g[{k}];" for k, (r, _) in enumerate(geometry_of(program))]
    laws = [f"    w[{r.number}] = f{leaf.place[2]};" for leaf, r in program.inputs.items() if leaf.kind == "f"]
    core = [f"    w[{row}] = q[{k}];" for k, row in enumerate(_core(program, 0))]
    return [
        _function("inputs", "double *u, const double *g", [*constants, *given]),
        _function("laws", "double *w, double f0, double f1, double f2", [*laws, "    (void)f0; (void)f1; (void)f2;"]),
        _function("core_in", "double *w, const double *q", core),
    ]


def _segments(program: Any) -> list[str]:
    """Return a function for each segment."""
    functions = [_function("mechanism", "double *u", _statements(program.segments["mechanism"]))]
    for name, segment in (("times", "time"), ("newton", "newton"), ("answer", "answer")):
        lines = ["    (void)u; (void)w; (void)m;", *_statements(program.segments[segment])]
        functions.append(_function(name, "const double *u, double *w, int *m", lines))
    return functions


def _outputs(program: Any) -> list[str]:
    """Return the functions that read what was found; without rates nothing is marched, and the core is not read."""
    out = program.outputs
    orders = enumerate("qva" if out.levels[2] else "")
    core = [f"    {name}[{k}] = w[{row}];" for order, name in orders for k, row in enumerate(_core(program, order))]
    levels = [f"    to[{k}] = w[{row}];" for k, row in enumerate(_levels(program))]
    sign = " * ".join(f"copysign(1.0, w[{k}])" for k in out.determinants) or "1.0"
    return [
        _function("core_out", "const double *w, double *q, double *v, double *a", core),
        _function("levels_out", "const double *w, double *to", levels),
        f"static inline double step_of(const double *w) {{ return w[{out.step}]; }}",
        f"static inline double sign_of(const double *w) {{ return {sign}; }}",
    ]


def _core(program: Any, order: int) -> list[int]:
    """Return the registers of the core coordinates, or of their rates."""
    return [program.outputs.levels[order][c] for c in program.core]


def _levels(program: Any) -> list[int]:
    """Return the registers of all coordinates and rates."""
    return [row for rows in program.outputs.levels for row in rows]


def geometry_of(program: Any) -> list[tuple[Any, tuple[int, int]]]:
    """Return the registers of the geometry with (constraint, number) of what they hold."""
    return [(register, leaf.place) for leaf, register in program.inputs.items() if leaf.kind == "g"]


def _function(name: str, arguments: str, lines: list[str]) -> str:
    body = "\n".join(lines)
    return f"static inline void {name}({arguments})\n{{\n{body}\n}}\n"


def _statements(instructions: Any) -> list[str]:
    return [f"    {_name(i.out)} = {_expression(i)};" for i in instructions]


def _expression(instruction: Any) -> str:
    from refkin.fast.elimination.program import FORMATS  # here: the fast paths may be absent

    op, args = instruction.op, [_name(a) for a in instruction.args]
    if op in FUNCTIONS:
        return FUNCTIONS[op].format(*args)
    if op in PLAIN:
        return FORMATS[op].format(*args)
    raise EngineError(f"the program holds {op!r}, which is no arithmetic")


def _name(register: Any) -> str:
    if register.bank == "x":
        raise EngineError("the program solves a block of three or more at once")
    return f"{register.bank}[{register.number}]"
