"""`python -m crosscheck` is `crosscheck`: the command line, in a process of its own."""

import gc
import os
import signal
import sys
from typing import NoReturn

from crosscheck.errors import INTERRUPTED, Terminated

SIGNALS = ("SIGTERM", "SIGHUP")
"""By which a batch system, and a terminal that is closed, end a process; Windows has no second one."""


def main() -> None:
    """Run the command line, whose modules are loaded as a process loads them that ends when they have done their work.

    What is loaded stays: looking for what could be freed of it is a tenth of the time of a small command. And pydantic
    need not ask every package that is installed whether it adds something to it. Matrices of a mechanism are small:
    threads that share one wait for each other, on a busy machine most of the time.
    """
    gc.set_threshold(10_000)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", os.environ.get("OMP_NUM_THREADS") or "1")
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    try:
        from crosscheck.cli import main as command_line
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)

    for number in (getattr(signal, name, None) for name in SIGNALS):
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:  # `nohup` has one ignored
            signal.signal(number, _end)
    command_line()


def _end(number: int, _: object) -> NoReturn:
    signal.signal(number, signal.SIG_DFL)  # the next one ends it wherever it is
    raise Terminated(number)


if __name__ == "__main__":
    main()
