"""What columns leave of efforts, joint by joint, and which of several readings of the efforts the joints prefer together."""

from __future__ import annotations

import numpy as np
from scipy.linalg import qr

NEW = 1e-6
"""Columns that add less than this share to others say nothing of their own."""
MOST_REGRET = 0.5
"""Most that one joint's log error may speak against a reading: no joint outvotes all others."""


def basis(columns: np.ndarray) -> np.ndarray:
    """Orthonormal columns that span those (R, k), each counted alike."""
    size = np.linalg.norm(columns, axis=0)
    spanning, triangle, _ = qr(columns[:, size > 0.0] / size[size > 0.0], mode="economic", pivoting=True)
    return np.asarray(spanning[:, np.abs(np.diagonal(triangle)) > NEW])


def beyond(values: np.ndarray, spanned: np.ndarray) -> np.ndarray:
    """Values (R,) or (R, k) without what an orthonormal basis (R, b) explains of them."""
    return np.asarray(values - spanned @ (spanned.T @ values))


def regret(left: np.ndarray) -> np.ndarray:
    """How much more each of C readings leaves than the best one for each of J joints, mean of these, (C, J) to (C,).

    Where a gear is soft or loose a joint asks for another reading: none counts without bound.

    Args:
        left: logarithms of mean squares.
    """
    return np.asarray(np.minimum(left - left.min(axis=0), MOST_REGRET).mean(axis=1))
