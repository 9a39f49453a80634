"""Physically possible bodies, rotors and friction fitted to effort.

Parameters θ: inertials of n bodies (10 n), then armature, viscous, coulomb and offset of n joints. For given axes the effort
is linear in θ. The prior of a body is k (tr J₀⁻¹J − log det J) for its pseudo-inertia J and a reference J₀ (Lee, Wensing and
Park, "Geometric robot dynamic identification", IEEE T-RO 2020), and k (x / x₀ − log x) for positive quantities. It is convex,
the same in every frame, close to a Gaussian of relative spread 1/√k near the reference, and infinite at the boundary of what
is possible: whatever is fitted, M is positive-definite and friction dissipates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.bdnn.samples import Samples
from bdnn_ros.robot import PER_LINK
from bdnn_ros.robot.bodies import pseudo_inertia

PER_JOINT = 4
"""Armature, viscous, coulomb, offset."""
CONTINUATION = (1e6, 1e4, 1e2, 1.0)
"""Factors of the belief on the way to the solution: from the reference towards what the data say."""
NEWTON_STEPS = 60
DONE = 1e-4
"""Newton's decrement that counts as arrived [nats]."""
ROUNDING = 1e-13
"""Share of a pseudo-inertia's largest eigenvalue up to which its smallest is rounding: such a body is at the edge."""


_BASIS = pseudo_inertia(np.eye(PER_LINK))
"""Of each unit inertial parameter, (PER_LINK, 4, 4)."""


@dataclass(frozen=True)
class Belief:
    """The prior of n bodies and joints.

    Attributes:
        inertials: reference bodies, (n, PER_LINK), feasible.
        joints: reference armature, viscous and coulomb, (3, n), positive.
        offset: standard deviation of the effort offset, (n,) [N·m].
        body_strength, joint_strength: k of bodies and of joints [nats].
    """

    inertials: np.ndarray
    joints: np.ndarray
    offset: np.ndarray
    body_strength: float
    joint_strength: float

    @property
    def reference(self) -> np.ndarray:
        """θ of the reference, without offset."""
        return np.concatenate([self.inertials.ravel(), self.joints.ravel(), np.zeros(len(self.offset))])

    def nats(self, theta: np.ndarray) -> float:
        """Negative log prior of θ relative to the reference; infinite outside the possible range."""
        n = len(self.offset)
        edge, last = PER_LINK * n, (PER_LINK + 3) * n
        positive = theta[edge:last]
        pseudo = pseudo_inertia(theta[:edge].reshape(n, PER_LINK))
        sizes = np.linalg.eigvalsh(pseudo)
        if (positive <= 0.0).any() or (sizes[:, 0] <= ROUNDING * np.maximum(sizes[:, -1], 0.0)).any():
            return np.inf
        reference = pseudo_inertia(self.inertials)
        ratio = np.linalg.solve(reference, pseudo)
        bodies = np.trace(ratio, axis1=1, axis2=2) - np.linalg.slogdet(ratio)[1] - 4.0
        scaled = positive / self.joints.ravel()
        offsets = theta[last:] / self.offset
        return float(
            self.body_strength * bodies.sum()
            + self.joint_strength * np.sum(scaled - np.log(scaled) - 1.0)
            + 0.5 * offsets @ offsets
        )

    def slopes(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and Hessian of `nats`."""
        n = len(self.offset)
        edge, last = PER_LINK * n, (PER_LINK + 3) * n
        gradient, hessian = np.zeros(len(theta)), np.zeros((len(theta), len(theta)))
        reference = np.linalg.inv(pseudo_inertia(self.inertials))
        inverse = np.linalg.inv(pseudo_inertia(theta[:edge].reshape(n, PER_LINK)))
        for body in range(n):
            rows = slice(body * PER_LINK, (body + 1) * PER_LINK)
            gradient[rows] = self.body_strength * np.einsum(
                "kij,ji->k", _BASIS, reference[body] - inverse[body]
            )
            turned = inverse[body] @ _BASIS
            hessian[rows, rows] = self.body_strength * np.einsum("kij,lji->kl", turned, turned)
        positive = theta[edge:last]
        gradient[edge:last] = self.joint_strength * (1.0 / self.joints.ravel() - 1.0 / positive)
        gradient[last:] = theta[last:] / self.offset**2
        diagonal = np.concatenate([self.joint_strength / positive**2, 1.0 / self.offset**2])
        hessian[edge:, edge:] = np.diag(diagonal)
        return gradient, hessian

    def stronger(self, factor: float) -> Belief:
        """The same prior, stronger by this factor."""
        strength = (factor * self.body_strength, factor * self.joint_strength)
        return Belief(self.inertials, self.joints, self.offset / np.sqrt(factor), *strength)


@dataclass(frozen=True)
class Quadratic:
    """Half the squared error over its noise, summed: ½ θᵀ G θ − rᵀ θ + c [nats]."""

    gram: np.ndarray
    right: np.ndarray
    constant: float

    def nats(self, theta: np.ndarray) -> float:
        """The error for parameters θ."""
        return float(theta @ (0.5 * self.gram @ theta - self.right) + self.constant)

    def __add__(self, other: Quadratic) -> Quadratic:
        return Quadratic(self.gram + other.gram, self.right + other.right, self.constant + other.constant)


def columns(regressor: np.ndarray, samples: Samples) -> np.ndarray:
    """All columns of the effort, (N, n, 10 n + 4 n): bodies, then armature, viscous, coulomb, offset; zero where unmeasured."""
    n = samples.width
    joint = [samples.acceleration, samples.velocity, samples.direction, np.ones_like(samples.effort)]
    blocks = [values[:, :, None] * np.eye(n) for values in joint]
    return np.concatenate([regressor, *blocks], axis=2) * samples.seen[:, :, None]


def quadratic(design: np.ndarray, effort: np.ndarray, noise: np.ndarray) -> Quadratic:
    """The error of columns (N, n, P) against effort (N, n), each joint relative to its noise (n,)."""
    rows = (design / noise[:, None]).reshape(-1, design.shape[2])
    target = (effort / noise).ravel()
    return Quadratic(rows.T @ rows, rows.T @ target, 0.5 * float(target @ target))


def fit(error: Quadratic, belief: Belief, start: np.ndarray | None = None) -> np.ndarray:
    """The most probable θ: a convex problem, solved by damped Newton steps without another pass over the data.

    Args:
        start: a feasible θ near the solution; None comes from the reference, in steps.
    """
    if start is not None:
        return _newton(error, belief, start)
    theta = belief.reference
    for factor in CONTINUATION:
        theta = _newton(error, belief.stronger(factor), theta)
    return theta


def _newton(error: Quadratic, belief: Belief, theta: np.ndarray) -> np.ndarray:
    value = error.nats(theta) + belief.nats(theta)
    for _ in range(NEWTON_STEPS):
        gradient, hessian = belief.slopes(theta)
        gradient += error.gram @ theta - error.right
        hessian += error.gram
        diagonal = np.diag(hessian)
        if not (np.isfinite(diagonal) & (diagonal > 0.0)).all():
            break  # curvature is lost in rounding: there is no step to take from here
        size = 1.0 / np.sqrt(diagonal)
        scaled = hessian * np.outer(size, size) + 1e-12 * np.eye(len(size))
        step = -size * np.linalg.solve(scaled, size * gradient)
        decrement = -0.5 * float(gradient @ step)
        length = 1.0
        while length > 1e-8:
            trial = error.nats(theta + length * step) + belief.nats(theta + length * step)
            if trial < value:
                break
            length *= 0.5
        else:
            break
        theta, value = theta + length * step, trial
        if decrement < DONE:
            break
    return theta
