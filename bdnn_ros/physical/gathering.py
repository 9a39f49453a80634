"""Assembles sums over each joint's columns into one system of equations for the parameters of all joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


class Gathering:
    """Precomputed index maps from sums over the first K columns of n joints to the system of the P parameters.

    Args:
        columns: of each joint, which take part; of these, those among the first K do.
        parameters: which parameters the columns of each joint belong to; no joint has one twice.
        shared: so many columns, from the first, are the first parameters on all joints, and none of the others is.
        count: K.
    """

    def __init__(
        self, columns: Sequence[np.ndarray], parameters: Sequence[np.ndarray], shared: int, count: int
    ) -> None:
        places = [each[taken < count] for taken, each in zip(columns, parameters, strict=True)]
        columns = [taken[taken < count] for taken in columns]
        self._shared, self._size = shared, 1 + max(int(each.max()) for each in places)
        own, joints = [each[shared:] for each in columns], np.arange(len(columns))
        rows = [joint * count + each for joint, each in enumerate(own)]
        self._vector_source = np.concatenate(rows)
        self._vector_target = np.concatenate([each[shared:] for each in places])
        self._vector_joint = np.repeat(joints, [len(each) for each in own])
        self._source = _pairs([each * count for each in rows], columns)
        self._target = _pairs([(each[shared:] - shared) * self._size for each in places], places)
        self._joint = np.repeat(joints, [a.size * b.size for a, b in zip(own, columns, strict=True)])

    def matrix(self, sums: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Sum over joints of symmetric matrices (n, K, K), each with its weight, (P, P)."""
        shared, result = self._shared, np.empty((self._size, self._size))
        result[:shared, :shared] = np.einsum("j,jab->ab", weights, sums[:, :shared, :shared])
        values = np.take(sums, self._source) * weights[self._joint]
        result[shared:].reshape(-1)[:] = np.bincount(self._target, values, result[shared:].size)
        result[:shared, shared:] = result[shared:, :shared].T
        return result

    def vector(self, sums: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Sum over joints of vectors (n, K), each with its weight, (P,)."""
        values = np.take(sums, self._vector_source) * weights[self._vector_joint]
        result = np.bincount(self._vector_target, values, self._size)
        result[: self._shared] = weights @ sums[:, : self._shared]
        return result


def _pairs(rows: Sequence[np.ndarray], columns: Sequence[np.ndarray]) -> np.ndarray:
    """Sums of all pairs of each joint's rows and columns, concatenated."""
    return np.concatenate([(a[:, None] + b).ravel() for a, b in zip(rows, columns, strict=True)])
