"""Speed of the gradient of a rollout: ours by hand against torchdiffeq's adjoint and autograd through RK4.

The same windows, weights, loss, precision and one thread for all; a step is one loss and its gradient by all
weights. Methods take turns, so that a busy machine slows all alike; the median of the turns is shown.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from _results import keep
from torchdiffeq import odeint_adjoint

from bdnn_ros.bdnn.backtracking import Windows, backtrack, discrete_gradient
from bdnn_ros.bdnn.field import Field, Scales
from bdnn_ros.bdnn.networks import SPD_FLOOR, Network

STEPS, BATCH, STEP = 10, 256, 0.008
RESULTS = Path(__file__).parent / "results" / "adjoint.json"


class TorchField(torch.nn.Module):
    """The same f(x, u) for autograd: effort between its samples is interpolated linearly."""

    def __init__(self, field: Field, windows: Windows) -> None:
        super().__init__()
        self.n, self.step, self.hidden = field.width, windows.step, field.h.hidden_bias.size
        self.h = torch.nn.ParameterList(
            [torch.nn.Parameter(torch.from_numpy(a.copy())) for a in field.h.arrays]
        )
        self.r = torch.nn.ParameterList(
            [torch.nn.Parameter(torch.from_numpy(a.copy())) for a in field.r.arrays]
        )
        self.gain = torch.from_numpy(field.gain)
        self.velocity, self.slow, self.effort = (
            torch.from_numpy(s) for s in (field.scales.velocity, field.scales.slow, field.scales.effort)
        )
        self.table = torch.from_numpy(windows.efforts)
        rows, columns = torch.tril_indices(self.n, self.n)
        self.lower = (slice(None), rows, columns)
        self.unit = torch.eye(self.n)

    def network(self, parts: torch.nn.ParameterList, x: torch.Tensor, bound: float) -> torch.Tensor:
        hidden = torch.tanh(torch.nn.functional.linear(x, parts[0], parts[1]))
        return bound * torch.tanh(torch.nn.functional.linear(hidden, parts[2], parts[3]) / bound)

    def forward(self, t: torch.Tensor, state: torch.Tensor) -> torch.Tensor:
        place = t.item() / self.step * 2.0
        index = min(max(int(place), 0), len(self.table) - 2)
        share = place - index
        u = self.table[index] if share == 0.0 else torch.lerp(self.table[index], self.table[index + 1], share)
        q, v = state[:, : self.n], state[:, self.n :]
        x = torch.cat([q.sin(), q.cos(), v / self.velocity, (v / self.slow).tanh()], 1)
        factor = torch.zeros(len(q), self.n, self.n)
        factor[self.lower] = self.network(self.h, x[:, : 2 * self.n], Network.bound)
        factor = factor + self.unit
        shift = SPD_FLOOR * (1.0 + (factor * factor).sum((1, 2)))
        drive = self.gain * (u - self.effort * self.network(self.r, x, Network.bound))
        inner = factor.transpose(1, 2) @ drive[..., None]
        acceleration = self.gain * ((factor @ inner)[..., 0] + shift[:, None] * drive)
        return torch.cat([v, acceleration], 1)


def make(n: int, hidden: int, seed: int = 0) -> tuple[Field, Windows]:
    """A field and windows of random smooth motion, float32."""
    rng = np.random.default_rng(seed)
    scales = Scales(np.full(n, 1.0), np.full(n, 3.0), np.linspace(20.0, 2.0, n), np.full(n, 0.1))
    times = np.arange(2 * STEPS + 1)[:, None, None] * STEP / 2.0
    phase = rng.uniform(0.0, 6.0, (1, BATCH, 3 * n))
    waves = np.sin(6.0 * times + phase)
    states = np.concatenate([waves[..., :n], 6.0 * np.cos(6.0 * times + phase[..., :n])], axis=2)
    windows = Windows(states, scales.effort * waves[..., 2 * n :], STEP, np.repeat([1.0, 0.05], n))
    return Field.random(scales, hidden, rng).astype(np.float32), windows.astype(np.float32)


def methods(field: Field, windows: Windows) -> dict[str, Callable[[], object]]:
    """Each way to one gradient."""
    module = TorchField(field, windows)
    parameters = tuple(module.parameters())
    measured, weights = torch.from_numpy(windows.states[::2]), torch.from_numpy(windows.weights)
    times = torch.arange(STEPS + 1) * windows.step

    def loss(states: torch.Tensor) -> torch.Tensor:
        error = states[1:] - measured[1:]
        return 0.5 * windows.step * windows.share * (weights * error * error).sum()

    def adjoint(method: str) -> list[torch.Tensor]:
        states = odeint_adjoint(module, measured[0], times, rtol=1e-5, atol=1e-6, method=method)
        return list(torch.autograd.grad(loss(states), parameters))

    def through_solver() -> list[torch.Tensor]:
        x, states, h = measured[0], [measured[0]], windows.step
        for t in times[:-1]:
            k1 = module(t, x)
            k2 = module(t + 0.5 * h, x + 0.5 * h * k1)
            k3 = module(t + 0.5 * h, x + 0.5 * h * k2)
            k4 = module(t + h, x + h * k3)
            x = x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
            states.append(x)
        return list(torch.autograd.grad(loss(torch.stack(states)), parameters))

    return {
        "ours, Algorithm 1": lambda: backtrack(field, windows, running=False)[1],
        "ours, exact discrete adjoint": lambda: discrete_gradient(field, windows)[1],
        "autograd through RK4": through_solver,
        "torchdiffeq adjoint, rk4": lambda: adjoint("rk4"),
        "torchdiffeq adjoint, dopri5": lambda: adjoint("dopri5"),
    }


def measure(ways: dict[str, Callable[[], object]], turns: int) -> dict[str, float]:
    """Gradients a second of process time, by method."""
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    for way in ways.values():
        way()
    for _ in range(turns):
        for name, way in ways.items():
            start = time.process_time()
            way()
            seconds[name].append(time.process_time() - start)
    return {name: 1.0 / float(np.median(values)) for name, values in seconds.items()}


def disagreement(ways: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Relative distance of each gradient from autograd's."""

    def flat(gradient: object) -> np.ndarray:
        if isinstance(gradient, np.ndarray):
            return gradient
        return np.concatenate([part.numpy().ravel() for part in gradient])  # type: ignore[attr-defined]

    reference = flat(ways["autograd through RK4"]())
    return {
        k: float(np.linalg.norm(flat(w()) - reference) / np.linalg.norm(reference)) for k, w in ways.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few turns")
    args = parser.parse_args()
    torch.set_num_threads(1)
    results = []
    for n, hidden in ((2, 64), (6, 64), (7, 128)):
        ways = methods(*make(n, hidden))
        rates, errors = measure(ways, 5 if args.quick else 25), disagreement(ways)
        print(f"\n{n} joints, {hidden} hidden units: {BATCH} windows of {STEPS} steps, float32, one thread")
        print(f"{'gradient by':32} {'per second':>10} {'ours faster by':>15} {'off autograd by':>16}")
        for name, rate in rates.items():
            ratio = rates["ours, Algorithm 1"] / rate
            print(f"{name:32} {rate:10.1f} {ratio:14.1f}x {errors[name]:16.1e}")
        results.append({"joints": n, "hidden": hidden, "gradients_per_second": rates, "off_autograd": errors})
    keep(RESULTS, {"windows": BATCH, "steps": STEPS, "results": results})


if __name__ == "__main__":
    main()
