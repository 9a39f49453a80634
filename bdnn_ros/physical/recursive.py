"""Bayesian least squares in information form: what the samples say is summed, and nothing is forgotten."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from bdnn_ros.errors import RecordingError

SMALLEST_NOISE = 1e-5
"""Smallest standard deviation of a joint's residual, relative to its effort scale."""
MOST_BLOCKS = 32
"""Blocks of time kept apart; beyond that, neighbours are joined and a block covers twice the time."""


@dataclass(frozen=True)
class Statistics:
    """What a stretch of motion says about each joint's K coefficients.

    Attributes:
        gram: Σ φ φᵀ, (n, K, K).
        moment: Σ φ y, (n, K).
        energy: Σ y², (n,).
        count: number of rows.
    """

    gram: np.ndarray
    moment: np.ndarray
    energy: np.ndarray
    count: float

    @classmethod
    def of(cls, columns: np.ndarray, effort: np.ndarray) -> Statistics:
        """Statistics of columns (N, n, K) against effort (N, n)."""
        phi = np.ascontiguousarray(columns.transpose(1, 0, 2))
        gram = phi.transpose(0, 2, 1) @ phi
        moment = np.einsum("jtk,tj->jk", phi, effort)
        return cls(gram, moment, np.einsum("tj,tj->j", effort, effort), float(len(effort)))

    def __add__(self, other: Statistics) -> Statistics:
        return Statistics(
            self.gram + other.gram,
            self.moment + other.moment,
            self.energy + other.energy,
            self.count + other.count,
        )

    def squared_error(self, coefficients: np.ndarray) -> np.ndarray:
        """Σ (y − φᵀ x)² of each joint under coefficients (n, K), (n,)."""
        fitted = np.einsum("jk,jkl,jl->j", coefficients, self.gram, coefficients)
        return np.maximum(self.energy - 2.0 * np.einsum("jk,jk->j", coefficients, self.moment) + fitted, 0.0)

    def score(self, coefficients: np.ndarray) -> np.ndarray:
        """Σ φ (y − φᵀ x) of each joint, (n, K)."""
        return self.moment - np.einsum("jkl,jl->jk", self.gram, coefficients)


@dataclass(frozen=True)
class Posterior:
    """What is known of P parameters after the data: a Gaussian.

    Attributes:
        mean: (P,).
        information: inverse of the covariance, (P, P).
        noise: standard deviation of each joint's residual, (n,) [N·m].
        correlation: rows that say as much as one independent row, of each joint, (n,).
    """

    mean: np.ndarray
    information: np.ndarray
    noise: np.ndarray
    correlation: np.ndarray

    @cached_property
    def covariance(self) -> np.ndarray:
        """(P, P)."""
        return _inverse(self.information)

    @cached_property
    def std(self) -> np.ndarray:
        """Standard deviation of each parameter, (P,)."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))


class Recursion:
    """Sums statistics block by block and solves for the parameters of all joints at once.

    Args:
        mean, covariance: Gaussian prior of the P parameters, (P,) and (P, P).
        index: which parameters the K coefficients of each joint are, (n, K); several joints may share one.
        scale: typical effort of each joint, (n,) [N·m].
    """

    def __init__(
        self, mean: np.ndarray, covariance: np.ndarray, index: np.ndarray, scale: np.ndarray
    ) -> None:
        self.mean = mean
        self.prior_information = _inverse(covariance)
        self.index = index
        self.scale = scale
        self.blocks: list[Statistics] = []
        self.total: Statistics | None = None
        self._noise = 0.1 * scale
        self._correlation = np.ones(len(scale))
        self._per_block = 1
        self._parts: list[Statistics] = []

    def update(self, columns: np.ndarray, effort: np.ndarray) -> None:
        """Take in rows: columns (N, n, K) and effort (N, n), both low-passed alike."""
        statistics = Statistics.of(columns, effort)
        self.total = statistics if self.total is None else self.total + statistics
        self._parts.append(statistics)
        if len(self._parts) >= self._per_block:
            self.blocks.append(summed(self._parts))
            self._parts = []
        if len(self.blocks) > MOST_BLOCKS:
            pairs = zip(self.blocks[::2], self.blocks[1::2], strict=False)
            odd = self.blocks[-1:] if len(self.blocks) % 2 else []
            self.blocks = [a + b for a, b in pairs]
            self._parts = [*odd, *self._parts]
            self._per_block *= 2

    def solve(self, iterations: int = 1) -> Posterior:
        """The parameters after all data so far.

        Noise and parameters are estimated in turn (EM: Dempster, Laird and Rubin 1977); the noise of the
        last call is the start of the next, so one iteration is enough while data comes in.

        Raises:
            RecordingError: no data came yet.
        """
        if self.total is None:
            raise RecordingError("No motion has been seen yet.", "Move the robot.")
        posterior = solve(self.total, self, self._noise, self._correlation)
        for _ in range(max(iterations, 1)):
            self._noise = self.noise(posterior)
            self._correlation = self.correlation(posterior)
            posterior = solve(self.total, self, self._noise, self._correlation)
        return posterior

    def coefficients(self, mean: np.ndarray) -> np.ndarray:
        """Coefficients (n, K) of each joint in a parameter vector (P,)."""
        return mean[self.index]

    def noise(self, posterior: Posterior) -> np.ndarray:
        """Standard deviation of the residual, allowing for what is still unknown of the parameters, (n,)."""
        assert self.total is not None
        error = self.total.squared_error(self.coefficients(posterior.mean))
        spread = [
            np.sum(gram * posterior.covariance[np.ix_(rows, rows)])
            for gram, rows in zip(self.total.gram, self.index, strict=True)
        ]
        variance = (error + np.array(spread)) / self.total.count
        return np.maximum(np.sqrt(variance), SMALLEST_NOISE * self.scale)

    def correlation(self, posterior: Posterior) -> np.ndarray:
        """How many rows say as much as one independent one, (n,): the design effect of a cluster-robust
        covariance.

        Rows are correlated in time by the low-pass, by coloured noise and by what the model lacks. Were they
        not, the squared scores of blocks of time would add up to what the noise alone gives (Liang and Zeger
        1986).
        """
        assert self.total is not None
        blocks = [*self.blocks, *self._parts]
        if len(blocks) < 4:
            return self._correlation
        coefficients = self.coefficients(posterior.mean)
        scores = np.array([block.score(coefficients) for block in blocks])
        result = np.empty(len(self.scale))
        for joint, gram in enumerate(self.total.gram):
            values, vectors = _principal(gram)
            whitened = scores[:, joint] @ vectors / np.sqrt(values)
            free = max(len(blocks) - 1, 1) / len(blocks)
            ratio = float(np.sum(whitened**2)) / (len(values) * free * posterior.noise[joint] ** 2)
            result[joint] = max(ratio, 1.0)
        return result


def solve(
    statistics: Statistics, recursion: Recursion, noise: np.ndarray, correlation: np.ndarray
) -> Posterior:
    """Posterior of the parameters for known noise (n,) [N·m] and correlation (n,)."""
    information = recursion.prior_information.copy()
    vector = recursion.prior_information @ recursion.mean
    weights = 1.0 / (noise**2 * correlation)
    for weight, gram, moment, rows in zip(
        weights, statistics.gram, statistics.moment, recursion.index, strict=True
    ):
        information[np.ix_(rows, rows)] += weight * gram
        vector[rows] += weight * moment
    return Posterior(_solve(information, vector), information, noise, correlation)


def summed(parts: Sequence[Statistics]) -> Statistics:
    """The statistics of several stretches together."""
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


def _principal(gram: np.ndarray, threshold: float = 1e-8) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and vectors of the excited directions, after scaling columns to one size."""
    size = np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
    used = size > 1e-9 * size.max()
    values, vectors = np.linalg.eigh(gram[np.ix_(used, used)] / np.outer(size[used], size[used]))
    keep = values > threshold * values[-1]
    full = np.zeros((len(gram), np.count_nonzero(keep)))
    full[used] = vectors[:, keep] / size[used, None]
    return values[keep], full


def _scaled(matrix: np.ndarray) -> tuple[tuple[np.ndarray, bool], np.ndarray]:
    """Cholesky factor of a positive-definite matrix scaled to a unit diagonal, and the scaling."""
    size = 1.0 / np.sqrt(np.diagonal(matrix))
    return cho_factor(matrix * np.outer(size, size), lower=True, check_finite=False), size


def _solve(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    factor, size = _scaled(matrix)
    return np.asarray(size * cho_solve(factor, size * vector, check_finite=False))


def _inverse(matrix: np.ndarray) -> np.ndarray:
    factor, size = _scaled(matrix)
    return np.asarray(cho_solve(factor, np.diag(size), check_finite=False) * size[:, None])
