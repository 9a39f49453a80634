"""Sufficient statistics of a motion for the coefficients of each joint."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

MOST_BYTES = 1 << 28
"""Blocks together take no more, if fewer of them will do: one grows with the cube of the number of joints."""


@dataclass(frozen=True)
class Statistics:
    """Sufficient statistics of a stretch of motion for each joint's K coefficients.

    Attributes:
        gram: Σ w φ φᵀ, (n, K, K).
        moment: Σ w φ y, (n, K).
        energy: Σ w y², (n,).
        count: Σ w, (n,).
    """

    gram: np.ndarray
    moment: np.ndarray
    energy: np.ndarray
    count: np.ndarray

    @classmethod
    def of(cls, columns: np.ndarray, effort: np.ndarray, weights: np.ndarray | None = None) -> Statistics:
        """Statistics of columns (N, n, K) against effort (N, n), each row weighted (N, n)."""
        root = np.ones_like(effort) if weights is None else np.sqrt(weights)
        # joint by joint, as products want it
        phi = np.empty((effort.shape[1], len(effort), columns.shape[-1]))
        np.multiply(columns.swapaxes(0, 1), root.T[:, :, None], out=phi)
        y = np.ascontiguousarray((effort * root).T)
        gram = phi.transpose(0, 2, 1) @ phi
        moment = (y[:, None, :] @ phi)[:, 0]
        return cls(gram, moment, (y**2).sum(axis=1), (root**2).sum(axis=0))

    def take_in(self, other: Statistics) -> None:
        """Add others to these in place, since they are large."""
        for own, further in zip(self.parts, other.parts, strict=True):
            own += further

    @property
    def parts(self) -> tuple[np.ndarray, ...]:
        """The four sums."""
        return self.gram, self.moment, self.energy, self.count

    def __add__(self, other: Statistics) -> Statistics:
        return Statistics(*(a + b for a, b in zip(self.parts, other.parts, strict=True)))

    def __sub__(self, other: Statistics) -> Statistics:
        return Statistics(*(a - b for a, b in zip(self.parts, other.parts, strict=True)))

    def of_joint(self, joint: int, columns: np.ndarray) -> Regression:
        """The regression of one joint on some of its columns."""
        gram, moment = self.gram[joint][np.ix_(columns, columns)], self.moment[joint, columns]
        return Regression(gram, moment, float(self.energy[joint]), float(self.count[joint]))

    def score(self, joint: int, columns: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """Σ w φ (y − φᵀ x) of one joint under coefficients of some of its columns."""
        full = np.zeros(self.gram.shape[-1])
        full[columns] = coefficients
        return self.moment[joint, columns] - (self.gram[joint] @ full)[columns]


@dataclass(frozen=True)
class Regression:
    """Statistics of one joint: gram (k, k), moment (k,), energy and count."""

    gram: np.ndarray
    moment: np.ndarray
    energy: float
    count: float

    def squared_error(self, coefficients: np.ndarray) -> float:
        """Σ w (y − φᵀ x)² under coefficients (k,)."""
        fitted = float(coefficients @ self.gram @ coefficients)
        return max(self.energy - 2.0 * float(coefficients @ self.moment) + fitted, 0.0)


class Blocks:
    """Statistics of successive stretches of time in fixed memory, however long the stream lasts.

    Args:
        most: blocks kept apart; beyond that, neighbours are joined and a block covers twice the time.
        least: as `most`, of blocks of which so many take `MOST_BYTES` or more.
    """

    def __init__(self, most: int, least: int) -> None:
        self._most, self._least = most, least
        self._memory: tuple[np.ndarray, ...] = ()
        self.clear()

    def clear(self) -> None:
        """Discard all."""
        self._count = self._parts = 0
        self._per_block = 1

    def add(self, statistics: Statistics) -> None:
        """Add the next stretch."""
        parts = statistics.parts
        if not self._memory:
            self._most = min(self._most, max(MOST_BYTES // statistics.gram.nbytes, self._least))
            self._memory = tuple(np.zeros((self._most + 1, *part.shape)) for part in parts)
        begins = self._parts == 0
        self._count += begins
        for kept, part in zip(self._memory, parts, strict=True):
            if begins:
                kept[self._count - 1] = part
            else:
                kept[self._count - 1] += part
        self._parts += 1
        if self._parts >= self._per_block:
            self._parts = 0
        if self._count > self._most and self._parts == 0:
            self._join()

    def _join(self) -> None:
        pairs, odd = divmod(self._count, 2)
        for kept in self._memory:
            for pair in range(pairs):
                np.add(kept[2 * pair], kept[2 * pair + 1], out=kept[pair])
            kept[pairs] = kept[self._count - 1]
        # an odd block at the end goes on growing, from what it holds already
        self._count, self._parts = pairs + odd, odd * self._per_block
        self._per_block *= 2

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Statistics]:
        """Views, valid until the next `add`."""
        for block in range(self._count):
            yield Statistics(*(kept[block] for kept in self._memory))


def summed(parts: Sequence[Statistics]) -> Statistics:
    """The sum of several statistics."""
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total
