"""The two cores of a BDNN: networks alone, or a prior with networks for the rest.

Both have the seed form q̈ = H (u − R). A core provides M = H⁻¹, its derivative and R; `dynamics.BDNN` does the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from bdnn_ros.bdnn.field import Field, Scales
from bdnn_ros.bdnn.local import LocalNetworks
from bdnn_ros.bdnn.networks import ACTIVATIONS, Network, spd_derivative, spd_factor, spd_matrix, vector_size
from bdnn_ros.dynamics import Dynamics
from bdnn_ros.robot import Robot
from bdnn_ros.robot.entries import require_shapes
from bdnn_ros.signals import Signals

DIFFERENCE = 1e-5
"""Step of central differences by position [rad]: of a prior's M that gives no derivative of its own, of gravity."""


class Core(Protocol):
    """Mass matrix and bias of the seed form; positions and velocities are (B, n)."""

    @property
    def joints(self) -> tuple[str, ...]:
        """n joint names."""

    def mass_matrix(self, position: np.ndarray) -> np.ndarray:
        """M(q), (B, n, n), positive-definite whatever the weights."""

    def mass_matrix_derivative(self, position: np.ndarray) -> np.ndarray:
        """∂M/∂q_k at [..., k], (B, n, n, n)."""

    def bias(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """R(q, q̇), (B, n) [N·m]."""

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort along a motion, (N, n) [N·m], low-passed as much as `signals.effort` is."""


@dataclass(frozen=True)
class NetworkCore:
    """H and R networks alone, as in the paper.

    Attributes:
        joints: n joint names.
        field: the networks, in float64.
    """

    joints: tuple[str, ...]
    field: Field

    def mass_matrix(self, position: np.ndarray) -> np.ndarray:
        """M = H⁻¹, (B, n, n)."""
        inverse = np.linalg.inv(self.field.inverse_inertia(position))
        return 0.5 * (inverse + np.swapaxes(inverse, -1, -2))

    def mass_matrix_derivative(self, position: np.ndarray) -> np.ndarray:
        """∂M/∂q = −M ∂H/∂q M, (B, n, n, n)."""
        mass = self.mass_matrix(position)
        return -np.einsum("bij,bjlk,blm->bimk", mass, self.field.inverse_inertia_derivative(position), mass)

    def bias(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """R(q, q̇), (B, n) [N·m]."""
        return self.field.bias(np.concatenate([position, velocity], axis=1))

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort along a motion, (N, n) [N·m], low-passed as much as `signals.effort` is."""
        state = np.concatenate([signals.position, signals.velocity], axis=1)
        return self.field.effort(state, signals.acceleration, signals.sign).effort

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays and JSON-able rest."""
        arrays = {f"scales.{k}": getattr(self.field.scales, k) for k in Scales.__dataclass_fields__}
        info: dict[str, Any] = {}
        for name, network in (("h", self.field.h), ("r", self.field.r)):
            put_network(name, network, arrays, info)
        return arrays, info

    @classmethod
    def from_state(
        cls, joints: tuple[str, ...], arrays: dict[str, np.ndarray], info: dict[str, Any]
    ) -> NetworkCore:
        """The core of `to_state`."""
        n = len(joints)
        require_shapes(arrays, {f"scales.{k}": (n,) for k in Scales.__dataclass_fields__})
        scales = Scales(*(arrays[f"scales.{k}"] for k in Scales.__dataclass_fields__))
        h = get_network("h", arrays, info, 2 * n, vector_size(n))
        return cls(joints, Field(h, get_network("r", arrays, info, 4 * n, n), scales))


@dataclass(frozen=True)
class PriorCore:
    """The dynamics of a prior, with networks for what it leaves out.

    M = L P(h(q))⁻¹ Lᵀ with the prior's M = L Lᵀ: a product of positive-definite factors, so positive-definite whatever the
    weights of h; h = 0 leaves the prior as it is. R is the prior's bias plus the local networks'.

    Attributes:
        prior: any dynamics; its M must be positive-definite.
        local: per joint, what the prior's bias leaves out.
        h: [sin q, cos q] -> vector of P, or None: the prior's M stands.
        slow: speed below which a `Robot`'s dry friction changes over, (n,) [rad/s].
    """

    prior: Dynamics
    local: LocalNetworks
    h: Network | None
    slow: np.ndarray

    @property
    def joints(self) -> tuple[str, ...]:
        """n joint names."""
        return self.prior.joints

    def mass_matrix(self, position: np.ndarray) -> np.ndarray:
        """M(q), (B, n, n)."""
        mass = self.prior.mass_matrix(position)
        return mass if self.h is None else self._corrected(position, np.linalg.cholesky(mass))

    def mass_matrix_derivative(self, position: np.ndarray) -> np.ndarray:
        """∂M/∂q_k at [..., k], (B, n, n, n)."""
        change = prior_derivative(self.prior, position)
        if self.h is None:
            return change
        n = position.shape[1]
        root = np.linalg.cholesky(self.prior.mass_matrix(position))
        inverse_root = np.linalg.inv(root)
        done = self.h.run(angles(position))
        jacobian = self.h.input_jacobian(done)
        slope = (
            jacobian[:, :, :n] * np.cos(position)[:, None, :]
            - jacobian[:, :, n:] * np.sin(position)[:, None, :]
        )
        factor = spd_factor(done.output, n)
        middle = np.linalg.inv(spd_matrix(factor))
        result = np.empty_like(change)
        for k in range(n):
            # dL = L Φ(L⁻¹ dM L⁻ᵀ), Φ: lower triangle with half its diagonal
            inner = inverse_root @ change[..., k] @ np.swapaxes(inverse_root, -1, -2)
            root_step = root @ (np.tril(inner) - 0.5 * inner * np.eye(n))
            middle_step = -middle @ spd_derivative(factor, slope[:, :, k]) @ middle
            side = root_step @ middle @ np.swapaxes(root, -1, -2)
            turned = root @ middle_step @ np.swapaxes(root, -1, -2)
            result[..., k] = side + np.swapaxes(side, -1, -2) + turned
        return result

    def bias(
        self, position: np.ndarray, velocity: np.ndarray, direction: np.ndarray | None = None
    ) -> np.ndarray:
        """R(q, q̇), (B, n) [N·m].

        Args:
            direction: of the motion, −1 to 1, (B, n); None takes it from the velocity.
        """
        direction = np.tanh(velocity / self.slow) if direction is None else direction
        smooth, load = self._prior_bias(position, velocity, direction)
        return smooth + self.local(position, velocity, direction, load)

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort along a motion, (N, n) [N·m], low-passed as much as `signals.effort` is."""
        q, v = signals.position, signals.velocity
        smooth, load = self._prior_bias(q, v, signals.sign)
        bias = smooth + self.local(q, v, signals.sign, load)
        return (self.mass_matrix(q) @ signals.acceleration[..., None])[..., 0] + bias

    def _corrected(self, position: np.ndarray, root: np.ndarray) -> np.ndarray:
        assert self.h is not None
        spd = spd_matrix(spd_factor(self.h.run(angles(position)).output, position.shape[1]))
        half = np.linalg.solve(np.linalg.cholesky(spd), np.swapaxes(root, -1, -2))
        return np.swapaxes(half, -1, -2) @ half

    def _prior_bias(
        self, position: np.ndarray, velocity: np.ndarray, direction: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The prior's bias and its gravity, (B, n) each; a robot's dry friction follows `direction`."""
        load = self.prior.gravity(position)
        if isinstance(self.prior, Robot):
            rigid = self.prior.rigid_effort(position, velocity, np.zeros_like(position))
            return rigid + self.prior.viscous * velocity + self.prior.coulomb * direction, load
        return self.prior.coriolis(position, velocity) + load + self.prior.friction(position, velocity), load


def angles(position: np.ndarray) -> np.ndarray:
    """[sin q, cos q], (B, 2n)."""
    return np.concatenate([np.sin(position), np.cos(position)], axis=1)


def prior_derivative(prior: Dynamics, position: np.ndarray) -> np.ndarray:
    """∂M/∂q_k at [..., k] of a prior, (B, n, n, n): exact for a `Robot`, else by central differences."""
    if isinstance(prior, Robot):
        return robot_derivative(prior, position)
    steps = []
    for k in range(position.shape[1]):
        step = np.zeros(position.shape[1])
        step[k] = DIFFERENCE
        steps.append(prior.mass_matrix(position + step) - prior.mass_matrix(position - step))
    return np.stack(steps, axis=-1) / (2.0 * DIFFERENCE)


def robot_derivative(robot: Robot, position: np.ndarray) -> np.ndarray:
    """∂M/∂q of a robot, (B, n, n, n), from the exact derivatives of its inverse dynamics.

    Column j of M is the effort that a unit acceleration of joint j takes, less gravity (Carpentier and
    Mansard, "Analytical derivatives of rigid body dynamics algorithms", RSS 2018).
    """
    model, order = robot.pinocchio_model()
    model.gravity.linear = np.zeros(3)
    data, n = model.createData(), robot.width
    inverse = np.argsort(order)
    rest, units = np.zeros(n), np.eye(n)
    result = np.empty((*position.shape, n, n))
    for row, q in enumerate(np.ascontiguousarray(position[:, inverse], dtype=float)):
        for j in range(n):
            pin.computeRNEADerivatives(model, data, q, rest, units[order[j]])
            result[row, :, j, :] = data.dtau_dq[order][:, order]
    return result


def put_network(name: str, network: Network, arrays: dict[str, np.ndarray], info: dict[str, Any]) -> None:
    """Add a network to a model's state."""
    for key, value in zip(("w1", "b1", "w2", "b2"), network.arrays, strict=True):
        arrays[f"{name}.{key}"] = value
    info[name] = {"activation": network.activation, "bound": network.bound}


def get_network(
    name: str, arrays: dict[str, np.ndarray], info: dict[str, Any], inputs: int, outputs: int
) -> Network:
    """The network of `put_network`, which has so many inputs and outputs.

    Raises:
        KeyError, TypeError, ValueError: something is missing or does not fit.
    """
    (hidden,) = arrays[f"{name}.b1"].shape
    shapes = {"w1": (hidden, inputs), "b1": (hidden,), "w2": (outputs, hidden), "b2": (outputs,)}
    require_shapes(arrays, {f"{name}.{key}": shape for key, shape in shapes.items()})
    w1, b1, w2, b2 = (arrays[f"{name}.{key}"] for key in ("w1", "b1", "w2", "b2"))
    network = replace(Network(w1, b1, w2, b2), **info[name])
    if network.activation not in ACTIVATIONS:
        raise ValueError(name)
    return network
