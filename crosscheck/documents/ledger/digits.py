"""Decimal numbers as they are written: how much the last digit says, and how many digits of a printed one are right."""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from enum import StrEnum
from typing import Any

from flint import arb


class Printed(StrEnum):
    """What a printed number is to the true one."""

    RIGHT = "right"
    TRUNCATED = "truncated"
    WRONG = "wrong"


@dataclass(frozen=True)
class Written:
    """A decimal number with the place of its last digit.

    Attributes
    ----------
    text : str
        As it is written: "0.0107", "-1.4e-14".
    value : arb
        A ball around it, as narrow as the precision in force.
    unit : Decimal
        One unit of its last digit.
    digits : int
        How many significant digits are written; of a zero, those behind the point and at least one.
    """

    text: str
    value: Any
    unit: Decimal
    digits: int

    @classmethod
    def read(cls, text: str) -> Written:
        """Read a number.

        Raises
        ------
        ValueError
            If the text is no finite decimal number.
        """
        try:
            number = Decimal(text)
        except InvalidOperation:
            raise ValueError(f"expected a decimal number, got {text!r}") from None
        if not number.is_finite():
            raise ValueError(f"expected a finite number, got {text!r}")
        exponent = int(number.as_tuple().exponent)
        digits = len(number.as_tuple().digits) if number else max(1, -exponent)
        return cls(text, arb(text), Decimal(1).scaleb(exponent), digits)

    @property
    def half(self) -> Any:
        """Half a unit of the last digit, as an `arb`: what correct rounding may change."""
        return arb(str(self.unit)) / 2


def printed_is(printed: Written, truth: Any) -> Printed:
    """Return what a printed number is to a ball around the truth; a tie may be rounded either way."""
    away = abs(printed.value - truth)
    slack = arb(2) ** -100 * (printed.half + abs(truth))
    if away <= printed.half + slack:
        return Printed.RIGHT
    towards_zero = printed.value * truth >= 0 and abs(printed.value) <= abs(truth)
    return Printed.TRUNCATED if towards_zero and away < 2 * printed.half else Printed.WRONG


def correct_digits(printed: Written, truth: Any) -> float:
    """Return how many digits of a printed number are right: all if it is correctly rounded, else -log10 of its error.

    The error is taken relative to the truth; the result is cut to a tenth and lies between 0 and the digits printed.
    """
    if printed_is(printed, truth) is Printed.RIGHT:
        return float(printed.digits)
    size = abs(float(truth))
    if size == 0.0:
        return 0.0
    digits = -math.log10(abs(float(printed.value - truth)) / size)
    return math.floor(10 * min(max(digits, 0.0), printed.digits)) / 10
