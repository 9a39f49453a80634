"""Recursive Bayesian least squares in information form; nothing is forgotten."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bdnn_ros.errors import RecordingError
from bdnn_ros.physical.linear import Definite, inverse, principal, solve
from bdnn_ros.physical.parameters import Prior
from bdnn_ros.physical.sensing import SensorNoise
from bdnn_ros.physical.statistics import Blocks, Statistics
from bdnn_ros.physical.structure import Layout

SMALLEST_NOISE = 1e-5
"""Smallest standard deviation of a joint's residual, relative to its effort scale."""
FIRST_NOISE = 0.01
"""The residual's standard deviation before any is known, relative to the effort scale."""
FIRST_CORRELATION = 8.0
"""Rows that say as much as one independent row, before blocks of time tell, where the model lacks something."""
FIRST_ITERATIONS = 40
"""Of noise and parameters, at most, after the start from the sensors."""
SETTLED = 0.02
"""Share by which the weights of the joints' rows change no more."""
LEAST_LEFT = 0.05
"""Share of the information that is left, at least, where all of it seems to be the position's noise."""
NOISE_DOUBT = 0.2
"""Share of what the position's noise took, and is given back, that is its standard deviation."""
MOST_BLOCKS = 32
"""Blocks of time kept apart."""
FEWEST_BLOCKS = 6
"""Blocks it takes to tell how the residual is correlated."""


@dataclass(frozen=True)
class Posterior:
    """Gaussian posterior of P parameters.

    Attributes:
        mean: (P,).
        known: inverse of the covariance, (P, P).
        noise: standard deviation of each joint's residual, (n,) [N·m].
        correlation: rows that say as much as one independent row, of each joint, (n,).
        layout: what the parameters are.
    """

    mean: np.ndarray
    known: Definite
    noise: np.ndarray
    correlation: np.ndarray
    layout: Layout

    @property
    def information(self) -> np.ndarray:
        """Inverse of the covariance, (P, P)."""
        return self.known.matrix

    @cached_property
    def covariance(self) -> np.ndarray:
        """(P, P)."""
        return self.known.inverse()

    @cached_property
    def std(self) -> np.ndarray:
        """Standard deviation of each parameter, (P,)."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))

    def coefficients(self, joint: int) -> np.ndarray:
        """Coefficients of the joint's columns."""
        return self.mean[self.layout.parameters[joint]]


class Recursion:
    """Accumulates statistics block by block and solves for the parameters of all joints at once.

    Args:
        belief: Gaussian prior of the base parameters.

    Attributes:
        total: of all rows, None before the first.
        blocks: of successive stretches of time.
        noise, correlation: as in `Posterior`.
    """

    def __init__(self, belief: Prior) -> None:
        self.belief = belief
        self.prior_information = inverse(belief.covariance)
        self._prior_vector = self.prior_information @ belief.mean
        self.blocks = Blocks(MOST_BLOCKS, least=2 * FEWEST_BLOCKS)
        self.clear()
        self.doubt()

    def doubt(self) -> None:
        """Discard the estimates of noise and correlation."""
        self.noise = FIRST_NOISE * self.belief.effort_scale
        self.correlation = np.full(len(self.belief.effort_scale), FIRST_CORRELATION)
        self._doubting = True

    def clear(self) -> None:
        """Discard all data; the estimates of noise and correlation stay."""
        self.total: Statistics | None = None
        self.sensors: SensorNoise | None = None
        self.blocks.clear()

    def update(
        self,
        columns: np.ndarray,
        effort: np.ndarray,
        weights: np.ndarray | None = None,
        sensors: SensorNoise | None = None,
    ) -> None:
        """Add rows: columns (N, n, K) and effort (N, n), low-passed alike, with weights (N, n).

        Args:
            sensors: noise that is in these rows, where it is known.
        """
        if sensors is not None:
            self.sensors = sensors if self.sensors is None else self.sensors + sensors
        statistics = Statistics.of(columns, effort, weights)
        self.blocks.add(statistics)
        if self.total is None:
            self.total = statistics
        else:
            self.total.take_in(statistics)

    def solve(self, layout: Layout, iterations: int = 1) -> Posterior:
        """The parameters from all data so far.

        Noise and parameters are estimated alternately (EM: Dempster, Laird and Rubin 1977). The noise of the last call is the
        start of the next, so one iteration suffices while data comes in.

        Raises:
            RecordingError: no data came yet.
        """
        if self.total is None:
            raise RecordingError("No motion has been seen yet.", "Move the robot.")
        if self._doubting and self.sensors is not None and iterations:
            self._start_from_sensors(layout)
            iterations = max(iterations, FIRST_ITERATIONS)
        posterior = self._posterior(layout)
        for _ in range(iterations):
            before = self.weights()
            self.noise = self._noise(posterior)
            self.correlation = self._correlation(posterior)
            posterior = self._posterior(layout)
            if np.allclose(self.weights(), before, rtol=SETTLED, atol=0.0):
                break
        return posterior if self.sensors is None else self._freed(posterior)

    def weights(self) -> np.ndarray:
        """Information of one row of each joint, (n,) [1/(N·m)²]."""
        return 1.0 / (self.noise**2 * self.correlation)

    def without_joint(self, layout: Layout, joint: int) -> tuple[np.ndarray, np.ndarray]:
        """Information on the first `base` parameters of this joint from all other joints: matrix and vector."""
        weights = self.weights()
        weights[joint] = 0.0
        information, vector = self._accumulated(layout, self.total, weights)
        own = layout.parameters[joint]
        kept = own[own < layout.base]
        rest = np.setdiff1d(np.arange(layout.size), kept)
        cross = information[np.ix_(kept, rest)]
        gain = solve(information[np.ix_(rest, rest)], np.column_stack([cross.T, vector[rest]]))
        return information[np.ix_(kept, kept)] - cross @ gain[:, :-1], vector[kept] - cross @ gain[:, -1]

    def left_out(self, layout: Layout, folds: Sequence[Statistics]) -> np.ndarray:
        """Cross-validated squared error of each joint, each fold under the parameters of all others, (n,) [N²·m²]."""
        assert self.total is not None
        errors = np.zeros(len(self.noise))
        for fold in folds:
            mean = solve(*self._accumulated(layout, self.total - fold, self.weights()))
            for joint, rows in enumerate(layout.parameters):
                errors[joint] += layout.regression(fold, joint).squared_error(mean[rows])
        return errors

    def _posterior(self, layout: Layout) -> Posterior:
        information, vector = self._accumulated(layout, self.total, self.weights())
        known = Definite(information)
        return Posterior(known.solve(vector), known, self.noise, self.correlation, layout)

    def _freed(self, posterior: Posterior) -> Posterior:
        """The posterior corrected for the attenuation by noise in the positions.

        Noise in the columns biases their coefficients towards zero, however long the motion (Fuller, Measurement Error
        Models, 1987). Its contribution F to the information A is known, so the mean is that of A - F. The information becomes
        (A - F) A⁻¹ (A - F), which stays definite even if F is nearly all of A.
        """
        assert self.total is not None and self.sensors is not None
        layout, known = posterior.layout, posterior.known
        columns = self.sensors.columns
        weights = self.weights() * self.total.count / self.sensors.count
        noise = layout.gathering(columns.shape[-1]).matrix(columns, weights)
        if not noise.any():
            return posterior
        taken = slice(len(noise))
        left, half = known.left(len(noise)), known.halved(noise)
        again = half.T @ half
        change = (1.0 + LEAST_LEFT) * again - 2.0 * noise
        vector = (noise - again) @ posterior.mean[taken]
        asked = np.zeros(layout.size)
        asked[taken] = left @ solve(left + change, vector)
        given = known.solve(asked)
        # how loud the noise is, is not known exactly
        doubt = NOISE_DOUBT * vector
        information = posterior.information.copy()
        information[taken, taken] += change - np.outer(
            doubt, doubt / (1.0 + NOISE_DOUBT * given[taken] @ doubt)
        )
        return replace(posterior, mean=posterior.mean + given, known=Definite(information))

    def _accumulated(
        self, layout: Layout, total: Statistics | None, weights: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Information matrix and vector of prior and data, each joint's rows with its weight."""
        assert total is not None
        information, vector = layout.gathered(total, weights)
        information[: layout.base, : layout.base] += self.prior_information
        vector[: layout.base] += self._prior_vector
        extra = np.arange(layout.base, layout.size)
        information[extra, extra] += 1.0 / layout.deviation**2
        return information, vector

    def _noise(self, posterior: Posterior) -> np.ndarray:
        """Standard deviation of the residual, allowing for the remaining uncertainty of the parameters, (n,)."""
        assert self.total is not None
        layout = posterior.layout
        result = np.empty(len(layout.columns))
        for joint, rows in enumerate(layout.parameters):
            sums = layout.regression(self.total, joint)
            unknown = float(np.sum(sums.gram * posterior.covariance[np.ix_(rows, rows)]))
            error = sums.squared_error(posterior.coefficients(joint))
            result[joint] = np.sqrt((error + unknown) / max(sums.count, 1.0))
        return np.maximum(result, SMALLEST_NOISE * self.belief.effort_scale)

    def _correlation(self, posterior: Posterior) -> np.ndarray:
        """Number of rows that count as one independent row, (n,).

        Rows are correlated in time by the low-pass, by coloured noise and by unmodelled effects. Without correlation the
        squared scores of blocks of time would add up to what the noise alone gives: the design effect of a cluster-robust
        covariance (Liang and Zeger 1986). While there are too few blocks, the share of sensor noise in the residual is taken
        with its known correlation, and the rest with `FIRST_CORRELATION`.
        """
        assert self.total is not None
        blocks = self.blocks
        if len(blocks) < FEWEST_BLOCKS:
            return self._first_correlation(posterior)
        layout, result = posterior.layout, np.empty(len(self.correlation))
        for joint in range(len(result)):
            coefficients = posterior.coefficients(joint)
            scores = np.array([layout.score(block, joint, coefficients) for block in blocks])
            values, vectors = principal(layout.regression(self.total, joint).gram)
            whitened = scores @ vectors / np.sqrt(values)
            free = (len(blocks) - 1) / len(blocks)
            ratio = float(np.sum(whitened**2)) / (len(values) * free * posterior.noise[joint] ** 2)
            result[joint] = max(ratio, 1.0)
        return result

    def _start_from_sensors(self, layout: Layout) -> None:
        """Start with the noise of the sensors, the least there can be; unmodelled effects show in the residual later."""
        assert self.sensors is not None
        self._doubting = False
        known = self.sensors.columns.shape[-1]
        for joint, rows in enumerate(layout.parameters):
            x = self.belief.mean[rows[:known]]
            least = SMALLEST_NOISE * self.belief.effort_scale[joint]
            self.noise[joint] = np.sqrt(max(self.sensors.variance(joint, x), least**2))
            self.correlation[joint] = self.sensors.correlation(
                joint, x, self.noise[joint] ** 2, FIRST_CORRELATION
            )

    def _first_correlation(self, posterior: Posterior) -> np.ndarray:
        """The same from the noise of the sensors, (n,).

        A joint whose few rows fit by chance is not taken to be better known than most of the others.
        """
        if self.sensors is None:
            return self.correlation
        known = self.sensors.columns.shape[-1]
        each = np.array(
            [
                self.sensors.correlation(joint, x[:known], posterior.noise[joint] ** 2, FIRST_CORRELATION)
                for joint, x in enumerate(map(posterior.coefficients, range(len(self.correlation))))
            ]
        )
        return np.maximum(each, np.median(each))
