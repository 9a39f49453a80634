"""Which groups of inputs predict a value, cross-validated over blocks of time that had no part in the choice."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import Generic, TypeVar

import numpy as np

K = TypeVar("K", bound=Hashable)

FOLDS = 5
RIDGE = 1e-2
VARIES = 1e-6
"""Spread of an input, relative to its size, below which it is constant, as at a joint that stands still."""
LONGEST = 0.99
"""Largest correlation of neighbouring values that is assumed."""
ADDS = 0.05
"""Additional share of the value that a group must predict to be chosen beside others."""


class Predictor(Generic[K]):
    """Ridge prediction of a value from groups of inputs, each of five folds of blocks from the others.

    Args:
        groups: inputs by name, (R, k) each.
        value: the value to predict, (R,).
        rows: usable rows, (R,) bool.
        block: block of time of each row, (R,) int.
    """

    def __init__(
        self, groups: Mapping[K, np.ndarray], value: np.ndarray, rows: np.ndarray, block: np.ndarray
    ) -> None:
        inputs = np.concatenate([np.ones((len(value), 1)), *groups.values()], axis=1)
        among = inputs[rows] if rows.any() else np.zeros((1, inputs.shape[1]))
        middle, spread = among.mean(axis=0), among.std(axis=0)
        varies = spread > VARIES * np.abs(among).max(axis=0)
        self._inputs = (inputs - middle) * varies / np.where(varies, spread, 1.0)
        self._inputs[:, 0] = 1.0
        ends = np.cumsum([1, *(one.shape[1] for one in groups.values())])
        places = (np.arange(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True))
        self._columns = {key: own[varies[own]] for key, own in zip(groups, places, strict=True)}
        self._fold = block % FOLDS
        parts = [rows & (self._fold == fold) for fold in range(FOLDS)]
        self._count = np.array([part.sum() for part in parts])
        self._squares = np.stack([self._inputs[part].T @ self._inputs[part] for part in parts])
        self._products = np.stack([self._inputs[part].T @ value[part] for part in parts])
        self._energy = np.array([float(value[part] @ value[part]) for part in parts])
        self._known: dict[tuple[bytes, bytes], np.ndarray] = {}

    def predicted(self) -> tuple[np.ndarray, dict[K, float]]:
        """Prediction (R,) from groups chosen by the other folds alone, and the share of the value that each explains.

        The choice is cross-validated, too: of many groups one may fit the folds it is chosen by, but not the held-out one.
        Listed are the groups that most folds choose, or the best one.
        """
        result = np.zeros(len(self._inputs))
        helps = {key: np.zeros(FOLDS) for key in self._columns}
        for fold in range(FOLDS):
            others = [one for one in range(FOLDS) if one != fold]
            columns = np.zeros(1, int)
            for key, share in self._chosen(others).items():
                helps[key][fold] = share
                columns = np.append(columns, self._columns[key])
            out = self._fold == fold
            result[out] = self._inputs[np.ix_(out, columns)] @ self._weights(columns, others)
        mean = {key: float(shares.mean()) for key, shares in helps.items()}
        best = max(mean.values(), default=0.0)
        named = {key for key, shares in helps.items() if np.count_nonzero(shares) > FOLDS // 2}
        named = named or {key for key, share in mean.items() if share == best > 0.0}
        return result, {key: mean[key] for key in named}

    def _chosen(self, folds: Sequence[int]) -> dict[K, float]:
        """Groups chosen by forward selection, with the share of the value that each adds."""
        columns, found = np.zeros(1, int), dict[K, float]()
        left, whole = self._left(columns, folds), float(self._energy[list(folds)].sum())
        while len(found) < len(self._columns):
            tried = {
                key: self._left(np.append(columns, own), folds)
                for key, own in self._columns.items()
                if key not in found and len(own)
            }
            best = min(tried, key=lambda key: tried[key], default=None)
            if best is None or tried[best] >= left - ADDS * whole:
                break
            found[best] = (left - tried[best]) / whole
            left, columns = tried[best], np.append(columns, self._columns[best])
        return found

    def _left(self, columns: np.ndarray, folds: Sequence[int]) -> float:
        """Squared error of inputs on some folds, each predicted from the others of these."""
        left = 0.0
        for fold in folds:
            w = self._weights(columns, [one for one in folds if one != fold])
            squares = self._squares[fold][np.ix_(columns, columns)]
            left += float(self._energy[fold] - w @ (2.0 * self._products[fold][columns] - squares @ w))
        return left

    def _weights(self, columns: np.ndarray, folds: Sequence[int]) -> np.ndarray:
        """Ridge weights of inputs fitted to some folds, (k,); zero if they hold too little data."""
        key = columns.tobytes(), bytes(folds)
        if key not in self._known:
            self._known[key] = self._solved(columns, np.array(folds))
        return self._known[key]

    def _solved(self, columns: np.ndarray, folds: np.ndarray) -> np.ndarray:
        count = self._count[folds].sum()
        if count < 2 * len(columns):
            return np.zeros(len(columns))
        squares = self._squares[np.ix_(folds, columns, columns)].sum(axis=0)
        products = self._products[np.ix_(folds, columns)].sum(axis=0)
        return np.linalg.solve(squares + RIDGE * count * np.eye(len(columns)), products)


def by_chance(left: np.ndarray, rows: np.ndarray, tried: int) -> float:
    """Share of a residual (R,) that the best of so many inputs would explain by chance, over some rows (R,) bool.

    The more slowly it varies, the fewer of its values are independent.
    """
    pairs, whole = rows[1:] & rows[:-1], float(np.sum(left[rows] ** 2))
    lasts = float(np.sum(left[1:][pairs] * left[:-1][pairs])) / max(whole, 1e-30)
    lasts = min(max(lasts, 0.0), LONGEST)
    return 2.0 * float(np.log(tried)) * (1.0 + lasts) / (1.0 - lasts) / max(int(rows.sum()), 1)
