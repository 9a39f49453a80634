"""Linear algebra of symmetric systems whose unknowns differ in scale."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve


@dataclass(frozen=True)
class Definite:
    """A positive-definite matrix (P, P) whose rows differ in scale; it is factored once, when first asked."""

    matrix: np.ndarray

    def solve(self, vector: np.ndarray) -> np.ndarray:
        """Solution of its system for a right-hand side (P,), or for several (P, k)."""
        factor, size = self._scaled
        scale = size if vector.ndim == 1 else size[:, None]
        return np.asarray(scale * cho_solve(factor, scale * vector, check_finite=False))

    def inverse(self) -> np.ndarray:
        """(P, P)."""
        factor, size = self._scaled
        return np.asarray(cho_solve(factor, np.diag(size), check_finite=False) * size[:, None])

    @cached_property
    def _scaled(self) -> tuple[tuple[np.ndarray, bool], np.ndarray]:
        """Cholesky factor of the matrix scaled to a unit diagonal, and the scaling."""
        size = 1.0 / np.sqrt(np.diagonal(self.matrix))
        return cho_factor(self.matrix * np.outer(size, size), lower=True, check_finite=False), size


def solve(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Solution of a positive-definite system whose unknowns differ in scale."""
    return Definite(matrix).solve(vector)


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a positive-definite matrix whose rows differ in scale."""
    return Definite(matrix).inverse()


def principal(gram: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and vectors of the excited directions, after scaling columns to one size."""
    size = np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
    used = size > 1e-9 * size.max()
    values, vectors = np.linalg.eigh(gram[np.ix_(used, used)] / np.outer(size[used], size[used]))
    keep = values > 1e-8 * values[-1]
    full = np.zeros((len(gram), int(np.count_nonzero(keep))))
    full[used] = vectors[:, keep] / size[used, None]
    return values[keep], full
