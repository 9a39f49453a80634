"""Posterior of one set of effects."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve


@dataclass(frozen=True)
class Fit:
    """Posterior of one set of terms.

    Attributes:
        terms: indices into the pool.
        coefficients: links' relative errors, nuisances, then the terms' coefficients, (P,).
        precision: their prior precisions, (P,), for the likeliest kind of each effect.
        factor: lower Cholesky factor of their posterior precision, (P, P).
        evidence: log evidence up to a constant that depends on the data only.
        loss: half the sum of squared whitened residuals plus the prior's share.
    """

    terms: tuple[int, ...]
    coefficients: np.ndarray
    precision: np.ndarray
    factor: np.ndarray
    evidence: float
    loss: float

    @cached_property
    def covariance(self) -> np.ndarray:
        """Posterior covariance of the coefficients, bounds left out, (P, P)."""
        return np.asarray(cho_solve((self.factor, True), np.eye(len(self.coefficients))))
