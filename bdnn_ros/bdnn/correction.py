"""A network that corrects a prior's mass matrix: M = L P(h(q))⁻¹ Lᵀ with the prior's M = L Lᵀ.

For a prior that cannot be identified (any dynamics but a robot's) or that is no chain of rigid bodies. Fitted
to the effort by L-BFGS with the derivative by hand; kept only if the held-out error falls.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from bdnn_ros.bdnn.backtracking import flat
from bdnn_ros.bdnn.cores import PriorCore, angles
from bdnn_ros.bdnn.local_training import LEAST_GAIN
from bdnn_ros.bdnn.networks import (
    Network,
    spd_apply,
    spd_factor,
    spd_matrix,
    spd_pull,
    spd_shift,
    vector_size,
)
from bdnn_ros.bdnn.samples import samples_of, scales_of
from bdnn_ros.signals import Signals

HIDDEN = 16
MOST_SAMPLES = 3000
ITERATIONS = 150
DECAY = 1e-3
"""Weight decay, relative to the error of the uncorrected prior."""
WORTH = 2e-3
"""A prior that leaves less than this of the held-out effort's variance needs no correction."""


@dataclass(frozen=True)
class Task:
    """The data that the correction has to explain.

    Attributes:
        inputs: [sin q, cos q], (N, 2n).
        root: L of the prior, (N, n, n).
        motion: Lᵀ q̈, (N, n).
        effort: u − R, (N, n) [N·m].
        scale: typical effort, (n,).
        seen: where u was measured, (N, n) bool.
    """

    inputs: np.ndarray
    root: np.ndarray
    motion: np.ndarray
    effort: np.ndarray
    scale: np.ndarray
    seen: np.ndarray

    def loss(self, network: Network) -> tuple[float, np.ndarray]:
        """Mean squared error over the effort's variance, and its gradient by the weights.

        With y = P⁻¹ Lᵀ q̈ the effort is L y, and dy = −P⁻¹ dP y.
        """
        done = network.run(self.inputs)
        factor = spd_factor(done.output, self.effort.shape[1])
        matrix = spd_matrix(factor)
        y = np.linalg.solve(matrix, self.motion[..., None])[..., 0]
        error = ((self.root @ y[..., None])[..., 0] - self.effort) / self.scale * self.seen
        count = np.count_nonzero(self.seen)
        on_y = (np.swapaxes(self.root, 1, 2) @ (2.0 * error / (self.scale * count))[..., None])[..., 0]
        left = -np.linalg.solve(matrix, on_y[..., None])[..., 0]
        shift = spd_shift(factor)
        left_inner, right_inner = spd_apply(factor, shift, left)[1], spd_apply(factor, shift, y)[1]
        cotangent = spd_pull(factor, left, left_inner, y, right_inner)
        gradient = network.weight_gradient(done, network.deltas(done, cotangent))
        return float(np.sum(error**2) / count), flat(gradient)


class _Enough(Exception):
    """Stops the optimiser: time is up, or the held-out error rises."""


def corrected(
    core: PriorCore,
    train: Sequence[Signals],
    validation: Sequence[Signals],
    rng: np.random.Generator,
    give_up: Callable[[], bool],
) -> PriorCore:
    """The core with a corrected M, or unchanged if that does not lower the held-out error."""
    learn, judge = (_task(core, parts, rng) for parts in (train, validation))
    n = core.local.velocity.size
    network = Network.random(2 * n, HIDDEN, vector_size(n), rng)
    network = replace(network, output_weights=np.zeros_like(network.output_weights))
    before, _ = judge.loss(network)
    if before < WORTH or give_up():
        return core
    best, best_weights, worse = before, network.vector(), 0
    decay = DECAY * learn.loss(network)[0]

    def cost(weights: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = learn.loss(network.with_vector(weights))
        return value + 0.5 * decay * float(weights @ weights), gradient + decay * weights

    def look(weights: np.ndarray) -> None:
        nonlocal best, best_weights, worse
        error, _ = judge.loss(network.with_vector(weights))
        worse = 0 if error < best else worse + 1
        if error < best:
            best, best_weights = error, weights.copy()
        if worse > 10 or give_up():
            raise _Enough

    try:
        options = {"maxiter": ITERATIONS}
        minimize(cost, network.vector(), jac=True, method="L-BFGS-B", callback=look, options=options)
    except _Enough:
        pass
    return replace(core, h=network.with_vector(best_weights)) if best < (1.0 - LEAST_GAIN) * before else core


def _task(core: PriorCore, parts: Sequence[Signals], rng: np.random.Generator) -> Task:
    samples = samples_of(parts).some(MOST_SAMPLES, rng)
    q, v = samples.position, samples.velocity
    root = np.linalg.cholesky(core.prior.mass_matrix(q))
    motion = (np.swapaxes(root, 1, 2) @ samples.acceleration[..., None])[..., 0]
    bias = core.bias(q, v, samples.direction)
    scale = scales_of(samples).effort
    return Task(angles(q), root, motion, samples.effort - bias, scale, samples.seen)
