"""Sums over each joint's columns, gathered in one system of the parameters of all joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


class Gathering:
    """Where sums over the columns of n joints go in a system of P parameters; found once, used for every sum.

    Args:
        columns: of each joint, which of its K columns take part.
        parameters: which of the P parameters those columns belong to; no joint has one twice.
        shared: so many columns, from the first, are the first parameters on all joints, and none of the others is.
        count: K.
        size: P.
    """

    def __init__(
        self,
        columns: Sequence[np.ndarray],
        parameters: Sequence[np.ndarray],
        shared: int,
        count: int,
        size: int,
    ) -> None:
        self._shared, self._size = shared, size
        joints = range(len(columns))
        own = [((k * count + each[shared:, None]) * count + each).ravel() for k, each in enumerate(columns)]
        self._source = np.concatenate(own)
        self._target = np.concatenate(
            [((each[shared:, None] - shared) * size + each).ravel() for each in parameters]
        )
        self._joint = np.repeat(joints, [len(each) for each in own])
        self._vector_source = np.concatenate([k * count + columns[k][shared:] for k in joints])
        self._vector_target = np.concatenate([each[shared:] for each in parameters])
        self._vector_joint = np.repeat(joints, [len(each) - shared for each in columns])

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
