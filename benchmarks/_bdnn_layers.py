"""Layers and training that all peers of the BDNN share.

They learn from the samples that ours learn from (`bdnn_ros.bdnn.samples`: low-passed alike, thinned, direction
of motion as soft as the effort), in units of the motion's own sizes, with sines and cosines of the angles,
and by the schedule of our networks: Adam, early stopping, and L-BFGS where ours has it. Width, rate and batch
of each were chosen by the held-out error on motions of another seed; `python benchmarks/_bdnn_tuning.py`
repeats that.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import minimize
from torch import Tensor, nn

from bdnn_ros.bdnn.network_training import LOOKS, POLISH_JOINTS, POLISH_SAMPLES, POLISH_SHARE, WARM_STEPS
from bdnn_ros.bdnn.samples import Samples

Columns = Sequence[Tensor]
Loss = Callable[[Columns], Tensor]


@dataclass(frozen=True)
class Settings:
    """What was tuned, for each peer.

    Attributes:
        hidden: units of each of the two hidden layers.
        rate: Adam's learning rate at the start; it falls to nothing like a cosine.
        batch: samples a step.
    """

    hidden: int
    rate: float
    batch: int


class Layers(nn.Module):
    """Two hidden layers of tanh, with the derivatives that a Lagrangian needs written out."""

    def __init__(self, inputs: int, hidden: int, outputs: int, last: float = 0.1) -> None:
        super().__init__()
        self.first, self.second = nn.Linear(inputs, hidden), nn.Linear(hidden, hidden)
        self.last = nn.Linear(hidden, outputs)
        for layer, gain in ((self.first, 1.0), (self.second, 1.0), (self.last, last)):
            nn.init.normal_(layer.weight, std=gain / np.sqrt(layer.in_features))
            nn.init.zeros_(layer.bias)
        nn.init.uniform_(self.first.bias, -1.0, 1.0)

    def hidden(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Values of both hidden layers."""
        one = torch.tanh(self.first(x))
        return one, torch.tanh(self.second(one))

    def forward(self, x: Tensor) -> Tensor:
        """y, (B, outputs)."""
        result: Tensor = self.last(self.hidden(x)[1])
        return result

    def push(self, values: tuple[Tensor, Tensor], change: Tensor) -> Tensor:
        """Change of y for a change of x (..., inputs)."""
        one, two = values
        moved = (1.0 - one * one) * (change @ self.first.weight.T)
        moved = (1.0 - two * two) * (moved @ self.second.weight.T)
        return moved @ self.last.weight.T

    def pull(self, values: tuple[Tensor, Tensor], cotangent: Tensor) -> Tensor:
        """Cotangent of x for one of y."""
        one, two = values
        back = (1.0 - two * two) * (cotangent @ self.last.weight)
        back = (1.0 - one * one) * (back @ self.second.weight)
        return back @ self.first.weight


class Stopwatch:
    """Share of a budget of processor time that is spent; begins when it is made."""

    def __init__(self, budget: float) -> None:
        self._budget, self._start = budget, time.process_time()

    def __call__(self) -> float:
        return (time.process_time() - self._start) / self._budget


class _TimeUp(Exception):
    """The budget is spent."""


def fit(
    module: nn.Module,
    loss: Loss,
    learn: Sequence[np.ndarray],
    judge: Sequence[np.ndarray],
    settings: Settings,
    used: Stopwatch,
    *,
    joints: int,
    rng: np.random.Generator,
    more: Callable[[int, float], Tensor | None] | None = None,
) -> None:
    """Train until the budget is spent; the weights that did best on held-out data stay, in float64.

    The schedule is that of `bdnn_ros.bdnn.network_training`: warm-up, cosine, fifty looks at the held-out
    error, and for robots of few joints L-BFGS in float64 after 40 % of the budget.

    Args:
        loss: of columns of samples.
        more: a loss to add at a step, told its number and the share of the time, or None.
    """
    few = joints <= POLISH_JOINTS
    end = POLISH_SHARE if few else 1.0
    columns, held = ([torch.from_numpy(x.astype(np.float32)) for x in group] for group in (learn, judge))
    parameters = list(module.parameters())
    optimizer = torch.optim.Adam(parameters, settings.rate)
    best, weights = np.inf, nn.utils.parameters_to_vector(parameters).detach().clone()
    step, looked = 0, 0.0
    while (now := used() / end) < 0.98:
        for group in optimizer.param_groups:
            group["lr"] = (
                settings.rate * 0.5 * (1.0 + np.cos(np.pi * now)) * min(1.0, (step + 1) / WARM_STEPS)
            )
        rows = torch.from_numpy(rng.integers(len(columns[0]), size=settings.batch))
        value = loss([x[rows] for x in columns])
        extra = more(step, now) if more is not None else None
        optimizer.zero_grad()
        (value if extra is None else value + extra).backward()
        nn.utils.clip_grad_norm_(parameters, 10.0)
        optimizer.step()
        step += 1
        if now - looked > 1.0 / LOOKS or (now > 0.95 and step % 50 == 0):
            looked = now
            error = float(loss(held).detach())
            if error < best:
                best, weights = error, nn.utils.parameters_to_vector(parameters).detach().clone()
    module.double()
    nn.utils.vector_to_parameters(weights.double(), module.parameters())
    if few:
        chosen = rng.permutation(len(learn[0]))[:POLISH_SAMPLES]
        _polish(module, loss, [x[chosen] for x in learn], judge, used, best)


def _polish(
    module: nn.Module,
    loss: Loss,
    learn: Sequence[np.ndarray],
    judge: Sequence[np.ndarray],
    used: Stopwatch,
    best: float,
) -> None:
    """L-BFGS on all samples at once."""
    columns, held = ([torch.from_numpy(x.astype(np.float64)) for x in group] for group in (learn, judge))
    parameters = list(module.parameters())
    kept = nn.utils.parameters_to_vector(parameters).detach().clone()

    def cost(vector: np.ndarray) -> tuple[float, np.ndarray]:
        nn.utils.vector_to_parameters(torch.from_numpy(vector.copy()), parameters)
        value = loss(columns)
        slopes = torch.autograd.grad(value, parameters, allow_unused=True, materialize_grads=True)
        return float(value.detach()), torch.cat([s.reshape(-1) for s in slopes]).numpy()

    def look(vector: np.ndarray) -> None:
        nonlocal best, kept
        nn.utils.vector_to_parameters(torch.from_numpy(vector.copy()), parameters)
        error = float(loss(held).detach())
        if error < best:
            best, kept = error, torch.from_numpy(vector.copy())
        if used() > 0.99:
            raise _TimeUp

    try:
        options = {"maxiter": 100_000, "maxfun": 1_000_000, "maxcor": 30, "ftol": 1e-12, "gtol": 1e-9}
        minimize(cost, kept.numpy(), jac=True, method="L-BFGS-B", callback=look, options=options)
    except _TimeUp:
        pass
    nn.utils.vector_to_parameters(kept, parameters)


def columns_of(samples: Samples) -> list[np.ndarray]:
    """Position, velocity, acceleration, direction and effort."""
    return [samples.position, samples.velocity, samples.acceleration, samples.direction, samples.effort]


def few(joints: int) -> bool:
    """Whether the settings of small robots are meant."""
    return joints <= 3
