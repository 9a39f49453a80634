"""Residuals of efforts beside given columns, and the reading of the efforts that all joints together prefer."""

from __future__ import annotations

import numpy as np
from scipy.linalg import qr

NEW = 1e-6
"""Columns that add less than this share to others are taken as dependent."""
MOST_REGRET = 0.5
"""Largest regret of a single joint: none outvotes all others."""


def basis(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis of columns (R, k), scaled alike."""
    size = np.linalg.norm(columns, axis=0)
    spanning, triangle, _ = qr(columns[:, size > 0.0] / size[size > 0.0], mode="economic", pivoting=True)
    return np.asarray(spanning[:, np.abs(np.diagonal(triangle)) > NEW])


def projected_out(values: np.ndarray, spanned: np.ndarray) -> np.ndarray:
    """Values (R,) or (R, k) with their projection on an orthonormal basis (R, b) removed."""
    return np.asarray(values - spanned @ (spanned.T @ values))


def regret(left: np.ndarray) -> np.ndarray:
    """Excess of each of C readings' log error over the best one for each of J joints, averaged over joints, (C, J) to (C,).

    Bounded for each joint, since one with a soft or loose gear prefers another reading.

    Args:
        left: logarithms of mean squares.
    """
    return np.asarray(np.minimum(left - left.min(axis=0), MOST_REGRET).mean(axis=1))
