"""Linear algebra of symmetric systems whose unknowns have very different scales."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import lapack


@dataclass(frozen=True)
class Definite:
    """A positive-definite matrix (P, P) with badly scaled rows, factored on first use.

    The rounding errors of Cholesky's factorisation do not depend on such scaling (Higham, Accuracy and Stability of Numerical
    Algorithms, 2002, §10.1).

    Raises:
        LinAlgError: it is not definite.
    """

    matrix: np.ndarray

    def solve(self, vector: np.ndarray) -> np.ndarray:
        """Solution for a right-hand side (P,), or for several (P, k)."""
        return np.asarray(lapack.dpotrs(self._factor, vector[::-1], lower=1)[0][::-1])

    def inverse(self) -> np.ndarray:
        """The inverse, (P, P)."""
        lower = lapack.dpotri(self._factor, lower=1)[0]
        return np.asarray((lower + np.tril(lower, -1).T)[::-1, ::-1])

    def left(self, count: int) -> np.ndarray:
        """Schur complement: the matrix of the first unknowns after the others are eliminated, B⁻¹ of `halved`, (count, count)."""
        last = self._factor[-count:, -count:]
        return np.asarray((last @ last.T)[::-1, ::-1])

    def halved(self, columns: np.ndarray) -> np.ndarray:
        """H (k, m) with Hᵀ H = Cᵀ B C, of columns C (k, m) and the first k rows and columns B of the inverse."""
        last = self._factor[-len(columns) :, -len(columns) :]
        return np.asarray(lapack.dtrtrs(last, columns[::-1], lower=1)[0])

    @cached_property
    def _factor(self) -> np.ndarray:
        """Lower Cholesky factor of the matrix with rows and columns reversed, whose end gives the beginning of the inverse."""
        factor, failed = lapack.dpotrf(self.matrix[::-1, ::-1].T, lower=1)
        if failed:
            raise np.linalg.LinAlgError(f"The matrix is not definite at row {len(factor) - failed}.")
        return np.asarray(factor)


def solve(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Solution of a positive-definite system whose unknowns differ in scale."""
    return Definite(matrix).solve(vector)


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a positive-definite matrix whose rows differ in scale."""
    return Definite(matrix).inverse()


def principal(gram: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and vectors of the excited directions, after scaling the columns to equal size."""
    size = np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
    used = size > 1e-9 * size.max()
    values, vectors = np.linalg.eigh(gram[np.ix_(used, used)] / np.outer(size[used], size[used]))
    keep = values > 1e-8 * values[-1]
    full = np.zeros((len(gram), int(np.count_nonzero(keep))))
    full[used] = vectors[:, keep] / size[used, None]
    return values[keep], full
