"""Trajectory backtracking (Algorithm 1 of the paper): gradients of a rollout's error by hand, no autograd.

A window starts at a measured state and is integrated by Runge-Kutta's fourth order; the running loss l
compares it with the measured states. Two ways give the gradient of L by the weights w:

- `backtrack`: the paper's adjoint α integrated backwards, equations (19) to (22). It is the gradient of the
  continuous L = ∫ l dt up to the step's fourth order.
- `discrete_gradient`: the exact gradient of the discrete rollout, as autograd through the solver would give.

The paper's α has the sign of its Lagrangian (17): it is minus the usual adjoint ∂L/∂x.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from bdnn_ros.bdnn.field import Field, FieldDeltas, FieldPass


@dataclass(frozen=True)
class Windows:
    """Windows of T steps, all B at once, sampled every half step.

    Attributes:
        states: measured [q, q̇], (2T + 1, B, 2n); the first is where the rollout starts.
        efforts: [N·m], (2T + 1, B, n).
        step: h [s].
        weights: of the squared error of each entry of the state, (2n,).
    """

    states: np.ndarray
    efforts: np.ndarray
    step: float
    weights: np.ndarray

    @property
    def steps(self) -> int:
        """Number of steps T."""
        return len(self.states) // 2

    @property
    def share(self) -> float:
        """Factor that turns a sum over windows and an integral over time into a mean."""
        return 1.0 / (self.states.shape[1] * self.steps * self.step)

    def loss(self, index: int | slice, state: np.ndarray) -> float:
        """l at one sampling instant (or several), summed over the windows."""
        error = state - self.states[index]
        return float(0.5 * self.share * np.sum(self.weights * error * error))

    def loss_slope(self, index: int | slice, state: np.ndarray) -> np.ndarray:
        """∂l/∂x at one sampling instant, (B, 2n)."""
        return self.share * self.weights * (state - self.states[index])

    def astype(self, dtype: Any) -> Windows:
        """The same windows in another precision."""
        return Windows(
            self.states.astype(dtype), self.efforts.astype(dtype), self.step, self.weights.astype(dtype)
        )


@dataclass(frozen=True)
class Rollout:
    """A forward integration and the passes its derivatives need.

    Attributes:
        states: x at every whole step, (T + 1, B, 2n).
        stages: of each step, the passes at its four stages.
    """

    states: np.ndarray
    stages: list[list[FieldPass]]


def flow(field: Field, done: FieldPass) -> np.ndarray:
    """f(x, u) = [q̇, q̈], (B, 2n), from an evaluation."""
    return np.concatenate([done.state[:, field.width :], done.acceleration], axis=1)


def roll_out(field: Field, windows: Windows) -> Rollout:
    """Integrate every window by Runge-Kutta's fourth order from its first measured state."""
    h, u = windows.step, windows.efforts
    states = np.empty((windows.steps + 1, *windows.states.shape[1:]), windows.states.dtype)
    states[0] = windows.states[0]
    stages = []
    for k in range(windows.steps):
        x = states[k]
        first = field.acceleration(x, u[2 * k])
        k1 = flow(field, first)
        second = field.acceleration(x + 0.5 * h * k1, u[2 * k + 1])
        k2 = flow(field, second)
        third = field.acceleration(x + 0.5 * h * k2, u[2 * k + 1])
        k3 = flow(field, third)
        fourth = field.acceleration(x + h * k3, u[2 * k + 2])
        k4 = flow(field, fourth)
        states[k + 1] = x + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
        stages.append([first, second, third, fourth])
    return Rollout(states, stages)


def backtrack(field: Field, windows: Windows, running: bool = True) -> tuple[float, np.ndarray]:
    """L = ∫ l dt and dL/dw by Algorithm 1.

    α_T = 0 and α̇ᵀ = ∂l/∂xᵀ − αᵀ ∂f/∂xᵀ (19) are integrated from T to 0 by Runge-Kutta's fourth order;
    G_T = 0 and Ġ = αᵀ ∂f/∂w (22) along with it, so that dL/dw = G₀. The states come from the forward
    rollout, halfway through a step by Hermite's cubic. The networks' δ are linear in α, so those of one
    state are added before they meet the weights.

    Args:
        running: l runs along the whole window, as in the paper; else it counts at the whole steps 1 … T only,
            as in `discrete_gradient`, and α jumps there.

    Returns:
        The loss and its gradient by all weights, in the order of `Field.vector`.
    """
    h, batch = windows.step, windows.states.shape[1]
    rollout = roll_out(field, windows)
    whole = [stages[0] for stages in rollout.stages]
    whole.append(field.acceleration(rollout.states[-1], windows.efforts[-1]))
    between = _midway(field, windows, rollout.states, [flow(field, done) for done in whole])
    gradient = [np.zeros_like(part) for part in field.arrays]
    alpha = np.zeros_like(rollout.states[-1])
    ahead: FieldDeltas | None = None
    for k in range(windows.steps - 1, -1, -1):
        end, start = whole[k + 1], whole[k]
        middle = _rows(between, slice(k * batch, (k + 1) * batch))
        slopes = [windows.loss_slope(2 * k + i, p.state) for i, p in enumerate((start, middle, end))]
        if not running:
            alpha = alpha - h * slopes[2]
            slopes = [np.zeros_like(alpha)] * 3
        pulled, at_end = field.pull(end, alpha)
        k1 = slopes[2] - pulled
        pulled, at_second = field.pull(middle, alpha - 0.5 * h * k1)
        k2 = slopes[1] - pulled
        pulled, at_third = field.pull(middle, alpha - 0.5 * h * k2)
        k3 = slopes[1] - pulled
        pulled, at_start = field.pull(start, alpha - h * k3)
        k4 = slopes[0] - pulled
        alpha = alpha - (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
        _add(gradient, -h / 6.0, field.weight_gradient(end, at_end if ahead is None else at_end + ahead))
        _add(gradient, -h / 3.0, field.weight_gradient(middle, at_second + at_third))
        ahead = at_start
    assert ahead is not None
    _add(gradient, -h / 6.0, field.weight_gradient(whole[0], ahead))
    loss = _simpson(windows, rollout.states, between.state) if running else _sampled(windows, rollout.states)
    return loss, flat(gradient)


def discrete_gradient(field: Field, windows: Windows) -> tuple[float, np.ndarray]:
    """L = h Σ l at the whole steps 1 … T, and its exact gradient by all weights.

    Runs the solver's own steps backwards, stage by stage.
    """
    h = windows.step
    rollout = roll_out(field, windows)
    gradient = [np.zeros_like(part) for part in field.arrays]
    on_state = np.zeros_like(rollout.states[-1])
    for k in range(windows.steps - 1, -1, -1):
        on_state = on_state + h * windows.loss_slope(2 * k + 2, rollout.states[k + 1])
        first, second, third, fourth = rollout.stages[k]
        back4, deltas4 = field.pull(fourth, (h / 6.0) * on_state)
        back3, deltas3 = field.pull(third, (h / 3.0) * on_state + h * back4)
        back2, deltas2 = field.pull(second, (h / 3.0) * on_state + (0.5 * h) * back3)
        back1, deltas1 = field.pull(first, (h / 6.0) * on_state + (0.5 * h) * back2)
        on_state = on_state + back1 + back2 + back3 + back4
        for done, deltas in ((first, deltas1), (second, deltas2), (third, deltas3), (fourth, deltas4)):
            _add(gradient, 1.0, field.weight_gradient(done, deltas))
    return _sampled(windows, rollout.states), flat(gradient)


def flat(parts: list[np.ndarray]) -> np.ndarray:
    """Gradients by array as one vector."""
    return np.concatenate([part.ravel() for part in parts])


def _midway(field: Field, windows: Windows, states: np.ndarray, flows: list[np.ndarray]) -> FieldPass:
    """Evaluation halfway through every step, all steps and windows as one batch (T · B)."""
    slopes = np.stack(flows)
    middle = 0.5 * (states[:-1] + states[1:]) + (windows.step / 8.0) * (slopes[:-1] - slopes[1:])
    efforts = windows.efforts[1::2]
    return field.acceleration(middle.reshape(-1, states.shape[2]), efforts.reshape(-1, efforts.shape[2]))


def _simpson(windows: Windows, states: np.ndarray, between: np.ndarray) -> float:
    """∫ l dt over the windows by Simpson's rule."""
    middle = between.reshape(windows.steps, *states.shape[1:])
    ends = windows.loss(slice(None, None, 2), states)
    ends -= 0.5 * (windows.loss(0, states[0]) + windows.loss(-1, states[-1]))
    return windows.step / 3.0 * (ends + 2.0 * windows.loss(slice(1, None, 2), middle))


def _sampled(windows: Windows, states: np.ndarray) -> float:
    """h Σ l at the whole steps 1 … T."""
    return windows.step * windows.loss(slice(2, None, 2), states[1:])


def _add(total: list[np.ndarray], factor: float, parts: list[np.ndarray]) -> None:
    for held, part in zip(total, parts, strict=True):
        held += factor * part


def _rows(done: Any, rows: slice) -> Any:
    """The same pass for part of its batch."""
    parts = [getattr(done, f.name) for f in fields(done)]
    return type(done)(*(p[rows] if isinstance(p, np.ndarray) else _rows(p, rows) for p in parts))
