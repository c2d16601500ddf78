"""When Newton's method stops, by the source documents; that of ME451 is `refkin.newton.CorrectionNorm`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class ResidualOrCorrection:
    """Stop when |phi| < residual_limit or |dq| < correction_limit (METU 3.9; printed there without absolute values)."""

    residual_limit: float = 1e-8
    correction_limit: float = 1e-8

    def __call__(self, residual: Any, correction: Any, q: Any) -> bool:
        small_residual = np.linalg.norm(residual) < self.residual_limit
        return bool(small_residual or np.linalg.norm(correction) < self.correction_limit)


@dataclass(frozen=True)
class BothLargest:
    """Stop when the largest components of phi and of dq are both below their limits (ME581 notes)."""

    residual_limit: float = 1e-8
    correction_limit: float = 1e-8

    def __call__(self, residual: Any, correction: Any, q: Any) -> bool:
        small_residual = np.max(np.abs(residual)) < self.residual_limit
        return bool(small_residual and np.max(np.abs(correction)) < self.correction_limit)


@dataclass(frozen=True)
class ScaledNorms:
    """Stop when |dq| / n or |phi| / m is below the limit, n and m the numbers of components (notes on Shabana)."""

    limit: float = 1e-8

    def __call__(self, residual: Any, correction: Any, q: Any) -> bool:
        scaled = (np.linalg.norm(v) / np.size(v) for v in (correction, residual))
        return bool(min(scaled) < self.limit)
