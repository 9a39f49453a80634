"""A black-box neural ODE: an MLP gives the acceleration, torchdiffeq integrates and differentiates it."""

from __future__ import annotations

import numpy as np
import torch
from _bdnn_effort import ReadOut
from _bdnn_layers import Columns, Layers, Settings, Stopwatch, columns_of, few, fit
from _motion import Data
from torch import Tensor
from torchdiffeq import odeint

from bdnn_ros.bdnn.backtracking import Windows
from bdnn_ros.bdnn.field import Scales
from bdnn_ros.bdnn.network_training import WINDOWS, Rollouts
from bdnn_ros.bdnn.samples import samples_of, scales_of

ODE = {True: Settings(16, 5e-3, 256), False: Settings(128, 2e-3, 256)}
MATCH_SHARE = 0.5
"""Share of the time in which accelerations alone are matched, before windows are rolled out as well."""
WINDOWS_EVERY = 4
SOLVER_STEPS = 30
LIMIT = 1.2
"""Efforts are looked for within this multiple of the largest seen."""


class Acceleration(torch.nn.Module):
    """q̈ of state and effort by an MLP, any function of them."""

    velocity: Tensor
    acceleration: Tensor
    effort: Tensor
    slow: Tensor
    limit: Tensor

    def __init__(self, scales: Scales, limit: np.ndarray, hidden: int) -> None:
        super().__init__()
        self.scales = scales
        self.register_buffer("limit", torch.from_numpy(limit).float())
        n = len(scales.effort)
        self.n, self.layers = n, Layers(5 * n, hidden, n)
        for name in ("velocity", "acceleration", "effort", "slow"):
            self.register_buffer(name, torch.from_numpy(getattr(scales, name)).float())

    def forward(self, q: Tensor, v: Tensor, direction: Tensor, effort: Tensor) -> Tensor:
        """q̈, (B, n)."""
        x = [q.sin(), q.cos(), v / self.velocity, direction, effort / self.effort]
        result: Tensor = self.acceleration * self.layers(torch.cat(x, 1))
        return result

    def by_effort(self, q: Tensor, v: Tensor, direction: Tensor, effort: Tensor) -> tuple[Tensor, Tensor]:
        """q̈ and ∂q̈/∂u, (B, n, n)."""
        x = torch.cat([q.sin(), q.cos(), v / self.velocity, direction, effort / self.effort], 1)
        values = self.layers.hidden(x)
        moved = torch.zeros(self.n, 1, 5 * self.n, dtype=x.dtype)
        moved[range(self.n), 0, range(4 * self.n, 5 * self.n)] = 1.0 / self.effort
        slope = self.layers.push(values, moved).permute(1, 2, 0) * self.acceleration[:, None]
        return self.acceleration * self.layers.last(values[1]), slope


class Flow(torch.nn.Module):
    """f(t, x) with the effort between its samples."""

    def __init__(self, module: Acceleration, windows: Windows) -> None:
        super().__init__()
        self.module, self.spacing = module, windows.step / 2.0
        self.efforts = torch.from_numpy(windows.efforts)

    def forward(self, t: Tensor, state: Tensor) -> Tensor:
        place = min(max(t.item() / self.spacing, 0.0), len(self.efforts) - 1.0)
        index = min(int(place), len(self.efforts) - 2)
        effort = torch.lerp(self.efforts[index], self.efforts[index + 1], place - index)
        q, v = state[:, : self.module.n], state[:, self.module.n :]
        return torch.cat([v, self.module(q, v, torch.tanh(v / self.module.slow), effort)], 1)


def rollout_loss(module: Acceleration, windows: Windows) -> Tensor:
    """Weighted squared error of the states along windows, mean; gradients through the solver.

    That is twice as fast as `odeint_adjoint` on such short windows (see benchmarks/adjoint.py).
    """
    measured = torch.from_numpy(windows.states[::2])
    times = torch.arange(windows.steps + 1) * windows.step
    states = odeint(Flow(module, windows), measured[0], times, method="rk4")
    return (torch.from_numpy(windows.weights) * (states - measured)[1:] ** 2).mean()


class OdeModel(ReadOut):
    """A trained neural ODE as dynamics: the effort is what makes its acceleration."""

    def __init__(self, joints: tuple[str, ...], module: Acceleration) -> None:
        super().__init__(joints, module.scales)
        self._module = module.double().requires_grad_(False)

    def forward_dynamics(self, position: np.ndarray, velocity: np.ndarray, effort: np.ndarray) -> np.ndarray:
        q, v, u = (torch.from_numpy(x) for x in (position, velocity, effort))
        return np.asarray(self._module(q, v, torch.tanh(v / self._module.slow), u))

    def effort(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """The effort within `limit` whose acceleration is nearest to a goal, by Levenberg-Marquardt."""
        module = self._module
        angle, rate, side, goal = (torch.from_numpy(x) for x in (q, v, direction, a))
        effort, damping = torch.zeros_like(goal), torch.full((len(q), 1, 1), 1e-3, dtype=goal.dtype)
        reached, slope = module.by_effort(angle, rate, side, effort)
        for _ in range(SOLVER_STEPS):
            scaled = slope * module.effort / module.acceleration[:, None]
            missing = ((goal - reached) / module.acceleration)[..., None]
            turned = scaled.transpose(1, 2)
            step = torch.linalg.solve(turned @ scaled + damping * torch.eye(module.n), turned @ missing)
            moved = (effort + step[..., 0] * module.effort).clamp(-module.limit, module.limit)
            there, along = module.by_effort(angle, rate, side, moved)
            left = ((goal - there) / module.acceleration)[..., None]
            better = (left**2).sum(1, keepdim=True) < (missing**2).sum(1, keepdim=True)
            effort = torch.where(better[..., 0], moved, effort)
            reached = torch.where(better[..., 0], there, reached)
            slope = torch.where(better, along, slope)
            damping = torch.where(better, 0.1 * damping, 10.0 * damping).clamp(1e-9, 1e6)
        return effort.numpy()

    def mass_matrix(self, position: np.ndarray) -> np.ndarray:
        rest = np.zeros_like(position)
        q, zero, effort = (torch.from_numpy(x) for x in (position, rest, self.gravity(position)))
        return np.asarray(torch.linalg.pinv(self._module.by_effort(q, zero, zero, effort)[1]))


def neural_ode(data: Data, budget: float, seed: int, settings: Settings | None = None) -> OdeModel:
    """A neural ODE: accelerations first, then windows, which alone would not get so far in the time."""
    used, n = Stopwatch(budget), data.truth.width
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    samples, held = samples_of(data.train), samples_of(data.validation)
    scales, chosen = scales_of(samples), settings or ODE[few(n)]
    module = Acceleration(scales, LIMIT * np.abs(samples.effort).max(axis=0), chosen.hidden)
    rollouts = Rollouts(data.train, scales.velocity)

    def loss(columns: Columns) -> Tensor:
        q, v, a, direction, effort = columns
        return (((module(q, v, direction, effort) - a) / module.acceleration) ** 2).mean()

    def windows(step: int, share: float) -> Tensor | None:
        if share < MATCH_SHARE or step % WINDOWS_EVERY:
            return None
        drawn = rollouts.draw(WINDOWS, rng)
        return None if drawn is None else rollout_loss(module, drawn)

    fit(
        module,
        loss,
        columns_of(samples),
        columns_of(held),
        chosen,
        used,
        joints=n,
        rng=rng,
        more=windows,
    )
    return OdeModel(data.truth.joints, module)
