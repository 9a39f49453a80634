"""A serial chain learned from effort alone: without URDF or geometry, its axes are weights like any other.

For given axes the effort is linear in bodies, rotors and friction, so only the axes are searched, from random starts, each
step solving for the rest (variable projection: Golub and Pereyra, SIAM J. Numer. Anal. 10(2), 1973). The best starts are then
refined on more samples with physically possible bodies. The result has the seed form: its H is positive-definite whatever the
weights.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.bdnn.bodies import Belief, Quadratic, columns, fit, quadratic
from bdnn_ros.bdnn.kinematics import Kinematics
from bdnn_ros.bdnn.samples import Samples, mean_square, scales_of
from bdnn_ros.robot import PER_LINK

SEARCH_SAMPLES = 300
SEARCH_STEPS = 14
RIDGE = 1e-6
"""Weight on the contribution of each column while searching, relative to the effort's variance."""
LARGEST_TURN = 0.8
"""Longest step of an axis [rad, m]."""
FOUND_AGAIN = 1.1
"""A start that ends within this factor of the best has found it again."""
CHUNK = 1000
GENERIC_STRENGTH = 1.0
"""How firmly the generic body is believed in [nats]."""
LONGEST = 0.5
"""Distance between two axes that a link seldom has [m]."""
LEAST_GAIN = 0.5
"""A step of the axes that gains less is not worth another [nats]."""
NOISE_FLOOR = 1e-3
"""Least noise of the low-passed effort, relative to its spread."""


@dataclass(frozen=True)
class Chain:
    """A chain that explains the effort.

    Attributes:
        kinematics: its axes.
        parameters: θ, as in `bodies`; feasible after `refine` only.
        cost: mean squared error over the effort's variance, on the samples it was fitted to and of joints seen in them.
    """

    kinematics: Kinematics
    parameters: np.ndarray
    cost: float

    def effort(self, samples: Samples) -> np.ndarray:
        """Effort along samples, (N, n) [N·m], zero where none was measured."""
        regressor = self.kinematics.regressor(samples.position, samples.velocity, samples.acceleration)
        return columns(regressor, samples) @ self.parameters

    def error(self, samples: Samples, scale: np.ndarray | None = None) -> np.ndarray:
        """Mean squared error of what was measured, (n,), relative to a scale (n,), by default the spread of the effort."""
        scale = scales_of(samples).effort if scale is None else scale
        return mean_square((self.effort(samples) - samples.effort) / scale, samples.seen)


# -- search ----------------------------------------------------------------------------------------------


def descend(samples: Samples, start: Kinematics, steps: int, give_up: Callable[[], bool]) -> Chain:
    """The chain reached from a start by Levenberg-Marquardt over the axes.

    Args:
        give_up: asked before every step.
    """
    scale, count = scales_of(samples).effort, np.count_nonzero(samples.seen)
    kinematics, damping = start, 1e-2
    rows, target, theta, residual, cost = _solved(samples, kinematics, scale)
    for _ in range(steps):
        if give_up():
            break
        inertials = theta[: PER_LINK * samples.width].reshape(-1, PER_LINK)
        motion = (samples.position, samples.velocity, samples.acceleration)
        slope = kinematics.jacobian(inertials, *motion) / scale[:, None] * samples.seen[:, :, None]
        slope = slope.reshape(len(target), -1)
        gram = rows.T @ rows / count
        cross = rows.T @ slope / count
        projected = np.linalg.solve(gram + np.diag(_ridge(gram)), cross)
        hessian = slope.T @ slope / count - cross.T @ projected
        gradient = slope.T @ residual / count - projected.T @ (rows.T @ residual) / count
        if not np.isfinite(hessian).all():
            break
        gain = 0.0
        for _ in range(6):
            step = np.linalg.solve(hessian + damping * np.diag(np.diag(hessian) + 1e-6), gradient)
            step *= min(1.0, LARGEST_TURN / max(float(np.abs(step).max()), 1e-12))
            moved = kinematics.moved(step)
            trial = _solved(samples, moved, scale)
            if trial[-1] < cost:
                gain = (cost - trial[-1]) / cost
                kinematics, (rows, target, theta, residual, cost) = moved, trial
                damping = max(damping / 3.0, 1e-6)
                break
            damping *= 4.0
        if gain < 1e-3:
            break
    return Chain(kinematics, theta, cost)


class Search:
    """Random starts, one after the other; the best are kept.

    Attributes:
        found: the best chains so far, best first.
        starts: how many starts were made.
    """

    def __init__(self, samples: Samples, rng: np.random.Generator, keep: int = 3) -> None:
        self._samples = samples.some(SEARCH_SAMPLES, rng)
        self._rng = rng
        self._keep = keep
        self.found: list[Chain] = []
        self.starts = 0

    @property
    def settled(self) -> bool:
        """Whether two starts reached the best chain: a third would hardly be better."""
        return len(self.found) > 1 and self.found[1].cost < FOUND_AGAIN * self.found[0].cost

    def try_once(self, give_up: Callable[[], bool]) -> None:
        """Try one more start."""
        self.starts += 1
        start = Kinematics.random(self._samples.width, self._rng)
        try:
            chain = descend(self._samples, start, SEARCH_STEPS, give_up)
        except np.linalg.LinAlgError:  # axes that make the columns meaningless: the next start is better
            return
        if np.isfinite(chain.cost):
            self.found = sorted([*self.found, chain], key=lambda c: c.cost)[: self._keep]


def _solved(
    samples: Samples, kinematics: Kinematics, scale: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """Rows (N n, P), target, best θ, residual and cost for given axes; rows are zero where no effort was measured."""
    regressor = kinematics.regressor(samples.position, samples.velocity, samples.acceleration)
    design = columns(regressor, samples) / scale[:, None]
    rows, target = design.reshape(-1, design.shape[2]), (samples.effort / scale).ravel()
    count = np.count_nonzero(samples.seen)
    gram, right = rows.T @ rows / count, rows.T @ target / count
    ridge = _ridge(gram)
    theta = np.linalg.solve(gram + np.diag(ridge), right)
    residual = target - rows @ theta
    return rows, target, theta, residual, float(np.sum(residual**2) / count + theta @ (ridge * theta))


def _ridge(gram: np.ndarray) -> np.ndarray:
    size = np.diag(gram)
    return RIDGE * (size + 1e-3 * float(np.mean(size)))


# -- refinement ------------------------------------------------------------------------------------------


def generic(samples: Samples) -> Belief:
    """A weak prior for a chain without a description: decimetre links, masses that suit the effort, small rotors and friction."""
    n, scales = samples.width, scales_of(samples)
    mass = float(scales.effort.max()) / 9.81
    body = np.zeros(PER_LINK)
    body[0] = mass
    body[[4, 6, 9]] = 2.0 * mass * 0.1**2
    joints = 0.1 * np.array(
        [scales.effort / scales.acceleration, scales.effort / scales.velocity, scales.effort]
    )
    return Belief(np.tile(body, (n, 1)), joints, scales.effort, GENERIC_STRENGTH, GENERIC_STRENGTH)


def feasible(samples: Samples, chain: Chain, belief: Belief) -> Chain:
    """The chain with the same axes and physically possible bodies."""
    error = _error(samples, chain.kinematics, noise_of(samples, chain))
    return _costed(samples, Chain(chain.kinematics, fit(error, belief), np.nan))


def refine(samples: Samples, chain: Chain, belief: Belief) -> Chain | None:
    """One Newton step of axes, bodies and joints together; None if it gains nothing.

    Args:
        chain: feasible.
    """
    noise = noise_of(samples, chain)
    now = _error(samples, chain.kinematics, noise).nats(chain.parameters) + belief.nats(chain.parameters)
    now += _reach_nats(chain.kinematics)
    hessian, gradient = _normal(samples, chain, belief, noise)
    if not np.isfinite(hessian).all():
        return None
    edge, damping = 6 * samples.width, 1e-6
    for _ in range(6):
        size = 1.0 / np.sqrt(np.diag(hessian) + 1e-9)
        scaled = hessian * np.outer(size, size) + damping * np.eye(len(size))
        step = -size * np.linalg.solve(scaled, size * gradient)
        moved = chain.kinematics.moved(np.clip(step[:edge], -LARGEST_TURN, LARGEST_TURN))
        error = _error(samples, moved, noise)
        start = chain.parameters + step[edge:]
        theta = fit(error, belief, start if np.isfinite(belief.nats(start)) else chain.parameters)
        if error.nats(theta) + belief.nats(theta) + _reach_nats(moved) < now - LEAST_GAIN:
            return _costed(samples, Chain(moved, theta, np.nan))
        damping *= 30.0
    return None


def _reach_nats(kinematics: Kinematics) -> float:
    """Negative log prior of the distances between axes: links are seldom longer than `LONGEST`."""
    return 0.5 * float(np.sum(kinematics.translations**2)) / LONGEST**2


def refit(samples: Samples, chain: Chain, belief: Belief) -> Chain:
    """The same axes with bodies and joints fitted to these samples."""
    error = _error(samples, chain.kinematics, noise_of(samples, chain))
    return _costed(samples, Chain(chain.kinematics, fit(error, belief, chain.parameters), np.nan))


def noise_of(samples: Samples, chain: Chain) -> np.ndarray:
    """Standard deviation of the chain's residual, (n,) [N·m]."""
    residual = chain.effort(samples) - samples.effort
    left = np.sqrt(mean_square(residual, samples.seen))
    return np.maximum(left, NOISE_FLOOR * scales_of(samples).effort)


def _costed(samples: Samples, chain: Chain) -> Chain:
    return replace(chain, cost=float(chain.error(samples)[samples.seen.any(axis=0)].mean()))


def _chunks(samples: Samples) -> list[Samples]:
    return [samples.rows(np.arange(k, min(k + CHUNK, len(samples)))) for k in range(0, len(samples), CHUNK)]


def _error(samples: Samples, kinematics: Kinematics, noise: np.ndarray) -> Quadratic:
    """The error as a quadratic form, accumulated chunk by chunk."""
    parts = []
    for part in _chunks(samples):
        regressor = kinematics.regressor(part.position, part.velocity, part.acceleration)
        parts.append(quadratic(columns(regressor, part), part.effort, noise))
    return sum(parts[1:], parts[0])


def _normal(
    samples: Samples, chain: Chain, belief: Belief, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Newton's matrix and gradient for [twists, θ]."""
    theta, n = chain.parameters, samples.width
    inertials = theta[: PER_LINK * n].reshape(n, PER_LINK)
    edge, size = 6 * n, 6 * n + len(theta)
    hessian, gradient = np.zeros((size, size)), np.zeros(size)
    for part in _chunks(samples):
        motion = (part.position, part.velocity, part.acceleration)
        design = columns(chain.kinematics.regressor(*motion), part)
        slope = chain.kinematics.jacobian(inertials, *motion) * part.seen[:, :, None]
        full = np.concatenate([slope, design], axis=2)
        rows = (full / noise[:, None]).reshape(-1, size)
        hessian += rows.T @ rows
        gradient += rows.T @ ((design @ theta - part.effort) / noise).ravel()
    for joint in range(n):
        rows = slice(6 * joint, 6 * joint + 3)
        turned = chain.kinematics.rotations[joint].T @ chain.kinematics.translations[joint]
        gradient[rows] += turned / LONGEST**2
        hessian[rows, rows] += np.eye(3) / LONGEST**2
    believed, curvature = belief.slopes(theta)
    gradient[edge:] += believed
    hessian[edge:, edge:] += curvature
    return hessian, gradient
