"""The command `crosscheck bench`."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter


def bench(
    *,
    only: Annotated[list[str] | None, Parameter(negative="")] = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Measure this project's time and error against C, the engines, SciPy and the closed form, on one thread.

    Exit codes: 0 done, 2 there is no work of that name, 4 a work could not be measured.

    Parameters
    ----------
    only
        A work, such as sweep-1000; may be given more than once. All by default, which takes some minutes.
    as_json
        Print one JSON object instead of tables.
    """
    from crosscheck.measure.bench_run import run  # here, because no other command needs it

    return run(only or [], as_json)
