"""Integration of a model's forward dynamics under the measured effort."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bdnn_ros.dynamics import Dynamics
from bdnn_ros.signals import Signals

DIVERGED = 1e3
"""A rollout faster than this [rad/s] is given up."""
GAMMA = 1.0 - 1.0 / np.sqrt(2.0)
NUDGE = 1e-4
"""Change of a velocity that tells how the acceleration depends on it [rad/s]."""

Step = Callable[
    [Dynamics, np.ndarray, np.ndarray, np.ndarray, np.ndarray, float], tuple[np.ndarray, np.ndarray]
]


def integrated(
    model: Dynamics, signals: Signals, effort: np.ndarray, starts: np.ndarray, steps: int
) -> np.ndarray:
    """Positions `steps` samples after each start, (W, n) [rad]; infinite where the motion diverges.

    Fourth-order Runge-Kutta at the working rate, all windows at once. Where that diverges, as with friction that stops a
    light link within less than a sample, the window is repeated with an L-stable method for stiff systems.

    Args:
        effort: (N, n) [N·m].
        starts: samples at which the motion is as measured, (W,).
    """
    end = _run(_runge_kutta, model, signals, effort, starts, steps)
    lost = ~np.isfinite(end).all(axis=1)
    if lost.any():
        end[lost] = _run(_rosenbrock, model, signals, effort, starts[lost], steps)
    return end


def _run(
    step: Step, model: Dynamics, signals: Signals, effort: np.ndarray, starts: np.ndarray, steps: int
) -> np.ndarray:
    q, v = signals.position[starts].copy(), signals.velocity[starts].copy()
    lost = np.zeros(len(starts), bool)
    with np.errstate(all="ignore"):  # a rollout may diverge; that is an answer
        for k in range(steps):
            q, v = step(model, q, v, effort[starts + k], effort[starts + k + 1], 1.0 / signals.rate)
            lost |= ~(np.abs(v) < DIVERGED).all(axis=1) | ~np.isfinite(q).all(axis=1)
            q[lost], v[lost] = signals.position[starts[lost]], 0.0
    q[lost] = np.inf
    return q


def _runge_kutta(
    model: Dynamics, q: np.ndarray, v: np.ndarray, u0: np.ndarray, u1: np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray]:
    """One classical step of `h` seconds under an effort that goes from u0 to u1, (W, n) each."""
    half = 0.5 * (u0 + u1)
    a0 = model.forward_dynamics(q, v, u0)
    v1 = v + 0.5 * h * a0
    a1 = model.forward_dynamics(q + 0.5 * h * v, v1, half)
    v2 = v + 0.5 * h * a1
    a2 = model.forward_dynamics(q + 0.5 * h * v1, v2, half)
    v3 = v + h * a2
    a3 = model.forward_dynamics(q + h * v2, v3, u1)
    return q + h / 6.0 * (v + 2.0 * v1 + 2.0 * v2 + v3), v + h / 6.0 * (a0 + 2.0 * a1 + 2.0 * a2 + a3)


def _rosenbrock(
    model: Dynamics, q: np.ndarray, v: np.ndarray, u0: np.ndarray, u1: np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray]:
    """The same, linearly implicit in the velocity: ROS2, of second order whatever the Jacobian, L-stable.

    Verwer, Spee, Blom and Hundsdorfer, SIAM J. Sci. Comput. 20(4), 1999.
    """
    width = q.shape[1]
    a0 = model.forward_dynamics(q, v, u0)
    nudged = [model.forward_dynamics(q, v + NUDGE * unit, u0) for unit in np.eye(width)]
    slope = np.stack([(one - a0) / NUDGE for one in nudged], axis=2)
    grows = ~np.isfinite(slope).all(axis=(1, 2))
    slope[grows] = 0.0
    grows |= h * np.linalg.eigvals(slope).real.max(axis=1) >= 1.0
    slope[grows] = 0.0
    v = np.where(grows[:, None], np.inf, v)  # it runs away indeed: the method would damp that, too
    matrix = np.eye(width) - GAMMA * h * slope

    def solved(of_q: np.ndarray, of_v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rate = np.linalg.solve(matrix, of_v[..., None])[..., 0]
        return of_q + GAMMA * h * rate, rate

    q1, v1 = solved(v, a0)
    after = model.forward_dynamics(q + h * q1, v + h * v1, u1)
    q2, v2 = solved(v + h * v1 - 2.0 * q1, after - 2.0 * v1)
    return q + h * (1.5 * q1 + 0.5 * q2), v + h * (1.5 * v1 + 0.5 * v2)
