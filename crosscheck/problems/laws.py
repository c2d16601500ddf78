"""A motion law as a formula that is read, and run, in Python."""

from __future__ import annotations

from typing import Any

from crosscheck.errors import CannotRun
from refkin.motion_laws import Integral, Polynomial, Sinusoid


def formula(law: Any) -> str:
    """Return f(t) as an expression in `t`, with `sin` and `cos`.

    Raises
    ------
    CannotRun
        For a table, which has no formula.
    """
    if isinstance(law, Polynomial):
        return _polynomial(law.coefficients)
    if isinstance(law, Sinusoid):
        return f"{law.offset!r} + {law.amplitude!r} * sin({law.angular_frequency!r} * t + {law.phase!r})"
    if isinstance(law, Integral) and isinstance(law.rate, Polynomial):
        return _polynomial([law.initial, *(c / (k + 1) for k, c in enumerate(law.rate.coefficients))])
    raise CannotRun(f"no formula for {law!r}")


def _polynomial(coefficients: Any) -> str:
    first, *rest = coefficients
    return f"{first!r} + t * ({_polynomial(rest)})" if rest else repr(first)
