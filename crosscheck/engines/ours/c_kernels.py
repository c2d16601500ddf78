"""C sources of this package, compiled on the spot by the machine's own compiler, and loaded.

Nothing is kept: sources and libraries live in a temporary folder. Where there is no compiler, or it does not take the
sources, the methods in C are absent and say why.
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


def compiler() -> str:
    """Return the compiler: $CC, or the first of `COMPILERS` there is.

    Raises
    ------
    EngineError
        If there is none.
    """
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
    """Return a source of this package compiled and loaded; nothing is kept on disk.

    Parameters
    ----------
    source : str
        The name of the file.
    generated : str
        Headers that are not files of the package: name without ".h" -> text.

    Raises
    ------
    EngineError
        If it cannot be compiled.
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
