"""A DeLaN-type network, the nearest peer: Lagrange's equation with a mass matrix and a potential learned."""

from __future__ import annotations

import numpy as np
import torch
from _bdnn_layers import Columns, Layers, Settings, Stopwatch, columns_of, few, fit
from _motion import Data
from torch import Tensor, nn

from bdnn_ros.bdnn.field import Scales
from bdnn_ros.bdnn.networks import vector_size
from bdnn_ros.bdnn.samples import samples_of, scales_of
from bdnn_ros.signals import Signals

LAGRANGIAN = {True: Settings(32, 1e-2, 256), False: Settings(64, 1e-2, 256)}
"""Of robots with few joints, and of others; 64 units were better than 128 at full time, the tuning's third
of it has it the other way round.
"""
FLOOR = 1e-3
"""Least of the diagonal of the factor of a mass matrix, in the motion's units."""


class Lagrangian(nn.Module):
    """A DeLaN-type network: M = S L Lᵀ S and V by networks, the effort by Lagrange's equation, and friction.

    After Lutter, Ritter and Peters, "Deep Lagrangian networks" (ICLR 2019), with viscous and Coulomb friction
    and an offset for each joint: what the robots of this benchmark have. The derivatives by the position
    are written out, so that a step needs one backward pass only.
    """

    flat: Tensor
    diagonal: Tensor
    velocity: Tensor
    effort: Tensor
    slow: Tensor
    gain: Tensor

    def __init__(self, scales: Scales, hidden: int) -> None:
        super().__init__()
        n = len(scales.effort)
        self.n = n
        self.factor = Layers(2 * n, hidden, vector_size(n))
        self.potential = Layers(2 * n, hidden, 1, last=1.0)
        self.friction = nn.Parameter(torch.full((2, n), -2.0))
        self.offset = nn.Parameter(torch.zeros(n))
        rows, columns = np.tril_indices(n)
        self.flat = torch.from_numpy(rows * n + columns)
        self.diagonal = torch.from_numpy(np.flatnonzero(rows == columns))
        for name in ("velocity", "effort", "slow"):
            self.register_buffer(name, torch.from_numpy(getattr(scales, name)).float())
        gain = np.sqrt(scales.effort / scales.acceleration)
        self.register_buffer("gain", torch.from_numpy(gain).float())

    def lower(self, q: Tensor) -> tuple[Tensor, Tensor, tuple[Tensor, Tensor]]:
        """L (B, n, n), the slope of its entries by the network's output, and the hidden values."""
        values = self.factor.hidden(torch.cat([q.sin(), q.cos()], 1))
        raw: Tensor = self.factor.last(values[1])
        slope = torch.ones_like(raw)
        slope[:, self.diagonal] = torch.sigmoid(raw[:, self.diagonal] + 0.5)
        entries = raw.clone()
        entries[:, self.diagonal] = nn.functional.softplus(raw[:, self.diagonal] + 0.5) + FLOOR
        return self.matrix(entries), slope, values

    def matrix(self, entries: Tensor) -> Tensor:
        """Entries (B, n(n+1)/2) as lower triangles, (B, n, n)."""
        full = torch.zeros(len(entries), self.n * self.n, dtype=entries.dtype)
        full[:, self.flat] = entries
        return full.reshape(-1, self.n, self.n)

    def on_angles(self, q: Tensor, cotangent: Tensor) -> Tensor:
        """Cotangent of q for one of [sin q, cos q]."""
        return cotangent[:, : self.n] * q.cos() - cotangent[:, self.n :] * q.sin()

    def gravity(self, q: Tensor) -> Tensor:
        """∂V/∂q and the offset, (B, n)."""
        values = self.potential.hidden(torch.cat([q.sin(), q.cos()], 1))
        slope = self.potential.pull(values, torch.ones(len(q), 1, dtype=q.dtype))
        return self.effort.max() * self.on_angles(q, slope) + self.effort * self.offset

    def inertial(self, q: Tensor, v: Tensor, a: Tensor) -> Tensor:
        """M q̈ + Ṁ q̇ − ∂(½ q̇ᵀ M q̇)/∂q, (B, n)."""
        lower, slope, values = self.lower(q)
        angles = torch.cat([q.cos() * v, -q.sin() * v], 1)
        rate = self.matrix(slope * self.factor.push(values, angles))
        sv, sa = (self.gain * v)[..., None], (self.gain * a)[..., None]
        turned, inner = lower.transpose(1, 2), lower.transpose(1, 2) @ sv
        moved = lower @ (turned @ sa + rate.transpose(1, 2) @ sv) + rate @ inner
        # T = ½ |Lᵀ S q̇|², so the cotangent of L is (S q̇) (Lᵀ S q̇)ᵀ
        on_factor = (sv * inner.transpose(1, 2)).reshape(len(q), -1)[:, self.flat]
        kinetic = self.on_angles(q, self.factor.pull(values, slope * on_factor))
        return self.gain * moved[..., 0] - kinetic

    def dry(self, v: Tensor, direction: Tensor) -> Tensor:
        """Viscous and Coulomb friction, (B, n)."""
        viscous, coulomb = nn.functional.softplus(self.friction)
        return self.effort * (viscous * v / self.velocity + coulomb * direction)

    def forward(self, q: Tensor, v: Tensor, a: Tensor, direction: Tensor) -> Tensor:
        """Effort, (B, n)."""
        return self.inertial(q, v, a) + self.gravity(q) + self.dry(v, direction)


class LagrangianModel:
    """A trained `Lagrangian` as dynamics."""

    def __init__(self, joints: tuple[str, ...], module: Lagrangian) -> None:
        self.joints, self._module = joints, module.double().requires_grad_(False)

    def mass_matrix(self, position: np.ndarray) -> np.ndarray:
        lower = self._module.lower(torch.from_numpy(position))[0].numpy()
        gain = self._module.gain.numpy()
        return np.asarray(gain[:, None] * (lower @ np.swapaxes(lower, 1, 2)) * gain)

    def gravity(self, position: np.ndarray) -> np.ndarray:
        return np.asarray(self._module.gravity(torch.from_numpy(position)))

    def coriolis(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        q, v = torch.from_numpy(position), torch.from_numpy(velocity)
        return np.asarray(self._module.inertial(q, v, torch.zeros_like(v)))

    def friction(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        v = torch.from_numpy(velocity)
        return np.asarray(self._module.dry(v, torch.tanh(v / self._module.slow)))

    def inverse_dynamics(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        q, v, a = (torch.from_numpy(x) for x in (position, velocity, acceleration))
        return np.asarray(self._module(q, v, a, torch.tanh(v / self._module.slow)))

    def forward_dynamics(self, position: np.ndarray, velocity: np.ndarray, effort: np.ndarray) -> np.ndarray:
        bias = self.inverse_dynamics(position, velocity, np.zeros_like(position))
        return np.asarray(np.linalg.solve(self.mass_matrix(position), (effort - bias)[..., None])[..., 0])

    def predict(self, signals: Signals) -> np.ndarray:
        columns = (signals.position, signals.velocity, signals.acceleration, signals.sign)
        return np.asarray(self._module(*(torch.from_numpy(x) for x in columns)))


def lagrangian(data: Data, budget: float, seed: int, settings: Settings | None = None) -> LagrangianModel:
    """A DeLaN-type network trained on the effort."""
    used, n = Stopwatch(budget), data.truth.width
    torch.manual_seed(seed)
    samples, held = samples_of(data.train), samples_of(data.validation)
    chosen = settings or LAGRANGIAN[few(n)]
    module = Lagrangian(scales_of(samples), chosen.hidden)

    def loss(columns: Columns) -> Tensor:
        q, v, a, direction, effort = columns
        return (((module(q, v, a, direction) - effort) / module.effort) ** 2).mean()

    fit(
        module,
        loss,
        columns_of(samples),
        columns_of(held),
        chosen,
        used,
        joints=n,
        rng=np.random.default_rng(seed),
    )
    return LagrangianModel(data.truth.joints, module)
