"""Answers that are kept in a file: as JSON has them, where they are not what they were, and how the file is made.

What is kept hangs on no rounding: it is asked for again as other processors compute (`PROCESSORS`, kernels of
OpenBLAS, of which the last needs AVX-512), and what is another there is kept as `BY_ROUNDING`, which anything fits.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

CLOSE = 1e-6
"""What another processor makes of a number, as a part of it."""
WIDER, LIKE = 4.0, 1.5
"""How many times as large a bound may be elsewhere, and how many times here, for it to be kept."""
BY_ROUNDING = "?"
PROCESSORS = ("", "Prescott", "Nehalem", "Sandybridge", "Haswell", "SkylakeX")


class Bound(float):
    """A number of which a part is what rounding happened to leave: a few times as much is as good."""


def plain(item: Any) -> Any:
    """Return something as JSON has it: numbers to eight figures, those that are none as words, bounds by a tilde."""
    if isinstance(item, dict):
        return {str(key): plain(value) for key, value in item.items()}
    if isinstance(item, list | tuple | np.ndarray):
        return [plain(value) for value in (item.tolist() if isinstance(item, np.ndarray) else item)]
    if isinstance(item, np.generic):
        item = item.item()
    if isinstance(item, Bound):
        return f"~{item:.3g}"
    if isinstance(item, float):
        return float(f"{item:.8g}") if abs(item) < 1e300 else str(item)
    return item if item is None or isinstance(item, bool | int) else str(item)


def differences(now: Any, was: Any, where: str = "", wider: float = WIDER) -> Iterator[str]:
    """Yield where something is not what it was; what hangs on rounding is not kept."""
    if was == BY_ROUNDING:
        return
    if isinstance(was, dict | list) and type(now) is type(was):
        pairs = {str(k): v for k, v in (was.items() if isinstance(was, dict) else enumerate(was))}
        others = {str(k): v for k, v in (now.items() if isinstance(now, dict) else enumerate(now))}
        if pairs.keys() != others.keys():
            yield f"{where}: {sorted(others)} instead of {sorted(pairs)}"
        for key in pairs.keys() & others.keys():
            yield from differences(others[key], pairs[key], f"{where}.{key}", wider)
    elif not (now == was or alike(now, was, wider)):
        yield f"{where}: {now} instead of {was}"


def alike(now: Any, was: Any, wider: float) -> bool:
    """Return whether two numbers are, or two bounds."""
    if isinstance(now, str) and isinstance(was, str) and now[:1] == was[:1] == "~":
        one, other = float(now[1:]), float(was[1:])
        return now == was or one < wider * other < wider**2 * one
    numbers = all(isinstance(x, float | int) for x in (now, was)) and not isinstance(now, bool)
    return numbers and isinstance(was, float) and math.isclose(now, was, rel_tol=CLOSE, abs_tol=1e-300)


def same(one: Any, other: Any) -> Any:
    """Return what two answers have in common."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        return {key: same(one[key], other[key]) for key in one}
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        return [same(*pair) for pair in zip(one, other, strict=True)]
    return BY_ROUNDING if other == BY_ROUNDING or any(differences(one, other, wider=LIKE)) else one


def read(file: Path) -> dict[str, Any]:
    """Return what is kept in a file, by name."""
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}


def write(file: Path, said: dict[str, Any]) -> None:
    """Keep answers, a line each."""
    lines = (f"{json.dumps(name)}: {json.dumps(of_name)}" for name, of_name in said.items())
    file.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def on_every_processor(module: str, *asked: str) -> dict[str, Any]:
    """Return what a module that prints its answers as JSON, by name, says on all processors."""
    command = [sys.executable, "-m", module, "--print", *asked]
    environments = [{**os.environ, **({"OPENBLAS_CORETYPE": kind} if kind else {})} for kind in PROCESSORS]
    running = [subprocess.Popen(command, env=each, stdout=subprocess.PIPE, text=True) for each in environments]
    first, *others = [json.loads(each.communicate()[0]) for each in running]
    for said in others:
        first = {name: same(first[name], said[name]) for name in first}
    return first
