"""Linear algebra of symmetric systems whose unknowns differ in scale."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve


def solve(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Solution of a positive-definite system whose unknowns differ in scale."""
    factor, size = _scaled(matrix)
    if vector.ndim == 2:
        size = size[:, None]
    return np.asarray(size * cho_solve(factor, size * vector, check_finite=False))


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a positive-definite matrix whose rows differ in scale."""
    factor, size = _scaled(matrix)
    return np.asarray(cho_solve(factor, np.diag(size), check_finite=False) * size[:, None])


def _scaled(matrix: np.ndarray) -> tuple[tuple[np.ndarray, bool], np.ndarray]:
    """Cholesky factor of a positive-definite matrix scaled to a unit diagonal, and the scaling."""
    size = 1.0 / np.sqrt(np.diagonal(matrix))
    return cho_factor(matrix * np.outer(size, size), lower=True, check_finite=False), size


def principal(gram: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and vectors of the excited directions, after scaling columns to one size."""
    size = np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
    used = size > 1e-9 * size.max()
    values, vectors = np.linalg.eigh(gram[np.ix_(used, used)] / np.outer(size[used], size[used]))
    keep = values > 1e-8 * values[-1]
    full = np.zeros((len(gram), int(np.count_nonzero(keep))))
    full[used] = vectors[:, keep] / size[used, None]
    return values[keep], full
