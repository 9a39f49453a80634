"""Algorithm 1: gradients by hand against autograd, finite differences and an independent adjoint solver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torchdiffeq import odeint_adjoint

from bdnn_ros.bdnn.backtracking import Windows, backtrack, discrete_gradient, flat, roll_out
from bdnn_ros.bdnn.field import Field, Scales
from bdnn_ros.bdnn.networks import SPD_FLOOR, Network

N, BATCH = 3, 4
DURATION = 0.4


def scales() -> Scales:
    return Scales(
        np.array([1.0, 2.0, 1.5]),
        np.array([3.0, 5.0, 4.0]),
        np.array([10.0, 4.0, 1.0]),
        np.array([0.4, 0.5, 0.3]),
    )


def make_field(activation: str = "tanh", hidden: int = 8) -> Field:
    rng = np.random.default_rng(1)
    field = Field.random(scales(), hidden, rng, activation)
    return field.with_vector(field.vector() + 0.2 * rng.normal(size=field.vector().size))


def effort_at(t: float) -> np.ndarray:
    """A smooth effort of each window."""
    phase = np.arange(BATCH)[:, None] + np.arange(N)
    return scales().effort * np.sin(5.0 * t + phase)


def measured_at(t: float) -> np.ndarray:
    """A smooth motion to compare with, no solution of anything."""
    phase = 0.7 * np.arange(BATCH)[:, None] + np.arange(2 * N)
    return np.sin(3.0 * t + phase)


def make_windows(steps: int) -> Windows:
    times = np.linspace(0.0, DURATION, 2 * steps + 1)
    weights = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    return Windows(
        np.array([measured_at(t) for t in times]),
        np.array([effort_at(t) for t in times]),
        DURATION / steps,
        weights,
    )


class TorchField:
    """The same field, written once more for autograd, in float64."""

    def __init__(self, field: Field) -> None:
        self.field = field
        self.vector = torch.tensor(field.vector(), requires_grad=True)
        self.scales = {k: torch.tensor(getattr(field.scales, k)) for k in field.scales.__dataclass_fields__}

    def network(self, network: Network, start: int, x: torch.Tensor) -> torch.Tensor:
        parts = []
        for array in network.arrays:
            parts.append(self.vector[start : start + array.size].reshape(array.shape))
            start += array.size
        activation = {"tanh": torch.tanh, "sigmoid": torch.sigmoid, "softplus": torch.nn.functional.softplus}
        hidden = activation[network.activation](x @ parts[0].T + parts[1])
        return network.bound * torch.tanh((hidden @ parts[2].T + parts[3]) / network.bound)

    def inverse_inertia(self, q: torch.Tensor) -> torch.Tensor:
        vector = self.network(self.field.h, 0, torch.cat([q.sin(), q.cos()], -1))
        factor = torch.zeros(len(q), N, N, dtype=q.dtype)
        rows, columns = torch.tril_indices(N, N)
        factor[:, rows, columns] = vector
        factor = factor + torch.eye(N)
        shift = SPD_FLOOR * (1.0 + (factor**2).sum((1, 2)))
        gain = (self.scales["acceleration"] / self.scales["effort"]).sqrt()
        spd = factor @ factor.transpose(1, 2) + shift[:, None, None] * torch.eye(N)
        return gain[:, None] * spd * gain

    def bias(self, state: torch.Tensor) -> torch.Tensor:
        q, v = state[:, :N], state[:, N:]
        rates = [v / self.scales["velocity"], (v / self.scales["slow"]).tanh()]
        x = torch.cat([q.sin(), q.cos(), *rates], -1)
        return self.scales["effort"] * self.network(self.field.r, self.field.h.vector().size, x)

    def flow(self, state: torch.Tensor, effort: torch.Tensor) -> torch.Tensor:
        drive = (effort - self.bias(state))[..., None]
        return torch.cat([state[:, N:], (self.inverse_inertia(state[:, :N]) @ drive)[..., 0]], -1)


def relative(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


@pytest.mark.parametrize("activation", ["tanh", "sigmoid", "softplus"])
def test_equations_11_to_15_are_what_autograd_gives(activation):
    field = make_field(activation)
    twin = TorchField(field)
    rng = np.random.default_rng(2)
    state, effort, alpha = (
        rng.normal(size=(BATCH, 2 * N)),
        rng.normal(size=(BATCH, N)),
        rng.normal(size=(BATCH, 2 * N)),
    )
    x = torch.tensor(state, requires_grad=True)
    flow = twin.flow(x, torch.tensor(effort))
    done = field.acceleration(state, effort)
    assert relative(done.acceleration, flow.detach().numpy()[:, N:]) < 1e-13
    on_state, on_weights = torch.autograd.grad((flow * torch.tensor(alpha)).sum(), [x, twin.vector])
    pulled, deltas = field.pull(done, alpha)
    assert relative(pulled, on_state.numpy()) < 1e-10
    gradient, edge = flat(field.weight_gradient(done, deltas)), field.h.vector().size
    assert relative(gradient[:edge], on_weights.numpy()[:edge]) < 1e-10  # (12), (13)
    assert relative(gradient[edge:], on_weights.numpy()[edge:]) < 1e-10  # (14), (15)


def loss_by_autograd(twin: TorchField, windows: Windows) -> torch.Tensor:
    states, efforts = torch.tensor(windows.states), torch.tensor(windows.efforts)
    h, x, total = windows.step, states[0], 0.0
    for k in range(windows.steps):
        k1 = twin.flow(x, efforts[2 * k])
        k2 = twin.flow(x + 0.5 * h * k1, efforts[2 * k + 1])
        k3 = twin.flow(x + 0.5 * h * k2, efforts[2 * k + 1])
        k4 = twin.flow(x + h * k3, efforts[2 * k + 2])
        x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        total = (
            total
            + 0.5 * h * windows.share * (torch.tensor(windows.weights) * (x - states[2 * k + 2]) ** 2).sum()
        )
    return total


def test_the_discrete_gradient_is_autograd_through_the_solver():
    field, windows = make_field(), make_windows(6)
    twin = TorchField(field)
    loss = loss_by_autograd(twin, windows)
    (expected,) = torch.autograd.grad(loss, twin.vector)
    value, gradient = discrete_gradient(field, windows)
    assert value == pytest.approx(loss.item(), rel=1e-12)
    assert relative(gradient, expected.numpy()) < 1e-10


def test_backtracking_agrees_with_an_independent_adjoint_solver():
    field = make_field()
    twin = TorchField(field)

    class Augmented(torch.nn.Module):
        """State and running loss, so that the adjoint solver sees the same L = ∫ l dt."""

        def __init__(self) -> None:
            super().__init__()
            self.vector = torch.nn.Parameter(twin.vector.detach().clone())
            twin.vector = self.vector

        def forward(self, t: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
            windows = make_windows(1)
            x = y[:, : 2 * N]
            error = x - torch.tensor(measured_at(t.detach().item()))
            running = (
                0.5 / (BATCH * DURATION) * (torch.tensor(windows.weights) * error**2).sum(1, keepdim=True)
            )
            return torch.cat([twin.flow(x, torch.tensor(effort_at(t.detach().item()))), running], 1)

    module = Augmented()
    start = torch.cat([torch.tensor(measured_at(0.0)), torch.zeros(BATCH, 1, dtype=torch.float64)], 1)
    end = odeint_adjoint(
        module,
        start,
        torch.tensor([0.0, DURATION], dtype=torch.float64),
        rtol=1e-9,
        atol=1e-11,
        method="dopri5",
    )
    loss = end[-1, :, -1].sum()
    loss.backward()
    value, gradient = backtrack(field, make_windows(80))
    assert value == pytest.approx(loss.item(), rel=1e-7)
    assert relative(gradient, module.vector.grad.numpy()) < 1e-6


def test_a_loss_at_samples_makes_the_adjoint_jump():
    field = make_field()
    distance = []
    for steps in (20, 40):
        windows = make_windows(steps)
        value, gradient = backtrack(field, windows, running=False)
        expected_value, expected = discrete_gradient(field, windows)
        assert value == pytest.approx(expected_value, rel=1e-12)
        distance.append(relative(gradient, expected))
    assert distance[0] < 1e-4
    assert distance[1] < distance[0] / 8.0


def test_backtracking_converges_with_the_fourth_order():
    field = make_field()
    _, exact = backtrack(field, make_windows(160))
    errors = [relative(backtrack(field, make_windows(steps))[1], exact) for steps in (10, 20, 40)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert (orders > 3.7).all(), orders


@pytest.mark.parametrize("method", [backtrack, discrete_gradient])
def test_the_gradient_is_the_slope_of_the_loss(method):
    field, windows = make_field(), make_windows(40)
    _, gradient = method(field, windows)
    rng = np.random.default_rng(3)
    for _ in range(3):
        direction = rng.normal(size=gradient.size)
        step = 1e-5
        ahead, _ = method(field.with_vector(field.vector() + step * direction), windows)
        behind, _ = method(field.with_vector(field.vector() - step * direction), windows)
        assert (ahead - behind) / (2.0 * step) == pytest.approx(gradient @ direction, rel=1e-6)


def test_a_step_along_the_gradient_lowers_the_loss():
    field, windows = make_field(), make_windows(20)
    loss, gradient = backtrack(field, windows)
    after, _ = backtrack(
        field.with_vector(field.vector() - 1e-4 * gradient / np.linalg.norm(gradient)), windows
    )
    assert after < loss
    assert after == pytest.approx(loss - 1e-4 * np.linalg.norm(gradient), rel=0.01, abs=1e-6)


def test_a_perfect_rollout_has_no_gradient():
    field, windows = make_field(), make_windows(20)
    states = roll_out(field, windows).states
    truth = windows.states.copy()
    truth[::2] = states
    value, gradient = discrete_gradient(field, replace(windows, states=truth))
    assert value == 0.0
    assert np.abs(gradient).max() == 0.0


def test_single_precision_stays_single_and_close():
    field, windows = make_field(), make_windows(10)
    value, gradient = backtrack(field.astype(np.float32), windows.astype(np.float32))
    assert gradient.dtype == np.float32
    exact_value, exact = backtrack(field, windows)
    assert value == pytest.approx(exact_value, rel=1e-4)
    assert relative(gradient, exact) < 1e-3
