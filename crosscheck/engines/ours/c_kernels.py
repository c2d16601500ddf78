"""C sources of this package, compiled on the spot by the machine's own compiler, and loaded.

Nothing is kept: sources and libraries live in a temporary folder, which goes with the object. Where there is no
compiler, or it does not take the sources, the routes in C are absent and say why.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from importlib.resources import files
from pathlib import Path
from types import TracebackType
from typing import Any

FLAGS = ("-O3", "-march=native", "-std=c11", "-shared", "-fPIC")
COMPILERS = ("cc", "gcc", "clang")
HEADERS = ("march.h",)
SECONDS = 120.0
"""So long a compiler may take."""


class NoKernel(Exception):
    """There is no compiler, or it does not take the source; the message says which."""


def compiler() -> str:
    """Return the compiler: $CC, or the first of `COMPILERS` there is.

    Raises
    ------
    NoKernel
        If there is none.
    """
    wanted = os.environ.get("CC")
    for name in (wanted,) if wanted else COMPILERS:
        found = shutil.which(name)
        if found:
            return found
    raise NoKernel(f"no C compiler: looked for {wanted or ', '.join(COMPILERS)}")


def compiler_version() -> str:
    """Return the first line of what the compiler says of itself, with the flags."""
    told = subprocess.run([compiler(), "--version"], capture_output=True, text=True, check=False, timeout=SECONDS)
    first = (told.stdout.strip().splitlines() or ["unknown"])[0]
    return f"{first} ({' '.join(FLAGS[:2])})"


class Kernels:
    """A temporary folder with compiled libraries; a context manager."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="crosscheck-bench-", ignore_cleanup_errors=True)
        self._count = 0

    def __enter__(self) -> Kernels:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._folder.cleanup()

    def library(self, source: str, **generated: str) -> Any:
        """Return a source of this package compiled and loaded.

        Parameters
        ----------
        source : str
            The name of the file.
        generated : str
            Headers that are not files of the package: name without ".h" -> text.

        Raises
        ------
        NoKernel
            If it cannot be compiled.
        """
        self._count += 1
        folder = Path(self._folder.name) / str(self._count)
        folder.mkdir()
        for name in (source, *HEADERS):
            (folder / name).write_text(text_of(name), encoding="utf-8")
        for name, text in generated.items():
            (folder / f"{name}.h").write_text(text, encoding="utf-8")
        library = folder / "kernel.so"
        command = [compiler(), *FLAGS, "-o", str(library), str(folder / source), "-lm"]
        try:
            told = subprocess.run(command, capture_output=True, text=True, check=False, timeout=SECONDS)
        except subprocess.TimeoutExpired as error:
            raise NoKernel(f"the C compiler took more than {SECONDS:.0f} s for {source}") from error
        if told.returncode:
            raise NoKernel(f"the C compiler refused {source}: {(told.stderr.strip().splitlines() or ['?'])[0]}")
        return ctypes.CDLL(str(library))


def text_of(name: str) -> str:
    """Return the text of a C file of this package."""
    return (files("crosscheck.engines.ours") / "c" / name).read_text(encoding="utf-8")
