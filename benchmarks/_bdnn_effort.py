"""Peers that know only the effort of a motion: an MLP, and least squares on the regressor."""

from __future__ import annotations

import numpy as np
import torch
from _bdnn_layers import Layers, Settings, Stopwatch, columns_of, few, fit
from _motion import Data

from bdnn_ros.bdnn.bodies import columns
from bdnn_ros.bdnn.field import Scales
from bdnn_ros.bdnn.samples import Samples, samples_of, scales_of
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals

PERCEPTRON = {True: Settings(32, 5e-3, 256), False: Settings(64, 5e-3, 256)}
"""Of robots with few joints, and of others."""


class ReadOut:
    """What can be read out of an effort: column j of M is what an acceleration of joint j adds; of the bias,
    what is even in the velocity counts as Coriolis, as in every machine, and what is odd as friction.

    Attributes:
        joints: n joint names.
        scales: typical sizes of the motion.
    """

    def __init__(self, joints: tuple[str, ...], scales: Scales) -> None:
        self.joints, self.scales = joints, scales

    def effort(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Effort, (N, n) [N·m]."""
        raise NotImplementedError

    def inverse_dynamics(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        return self.effort(position, velocity, acceleration, np.tanh(velocity / self.scales.slow))

    def gravity(self, position: np.ndarray) -> np.ndarray:
        rest = np.zeros_like(position)
        return self.inverse_dynamics(position, rest, rest)

    def mass_matrix(self, position: np.ndarray) -> np.ndarray:
        return self._mass(position, np.zeros_like(position), self.gravity(position))

    def _mass(self, q: np.ndarray, v: np.ndarray, bias: np.ndarray) -> np.ndarray:
        steps = np.diag(self.scales.acceleration)
        sides = [(self.inverse_dynamics(q, v, np.tile(a, (len(q), 1))) - bias) / a.max() for a in steps]
        return np.stack(sides, axis=-1)

    def coriolis(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        still = np.zeros_like(position)
        ahead, back = (self.inverse_dynamics(position, v, still) for v in (velocity, -velocity))
        return np.asarray(0.5 * (ahead + back)) - self.gravity(position)

    def friction(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        bias = self.inverse_dynamics(position, velocity, np.zeros_like(position))
        return bias - self.coriolis(position, velocity) - self.gravity(position)

    def forward_dynamics(self, position: np.ndarray, velocity: np.ndarray, effort: np.ndarray) -> np.ndarray:
        bias = self.inverse_dynamics(position, velocity, np.zeros_like(position))
        mass = self._mass(position, velocity, bias)
        mass = np.nan_to_num(mass, nan=0.0, posinf=0.0, neginf=0.0)
        lost = np.linalg.matrix_rank(mass) < len(self.joints)
        mass[lost] = np.eye(len(self.joints))
        result = np.linalg.solve(mass, (effort - bias)[..., None])[..., 0]
        result[lost] = np.inf  # the rollout has run away
        return np.asarray(result)

    def predict(self, signals: Signals) -> np.ndarray:
        return self.effort(signals.position, signals.velocity, signals.acceleration, signals.sign)


class PerceptronModel(ReadOut):
    """An MLP from motion to effort."""

    def __init__(self, joints: tuple[str, ...], module: Layers, scales: Scales) -> None:
        super().__init__(joints, scales)
        self._module = module.double().requires_grad_(False)

    def effort(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, direction: np.ndarray) -> np.ndarray:
        x = _inputs(self.scales, q, v, a, direction)
        return np.asarray(self.scales.effort * self._module(torch.from_numpy(x)).numpy())


def perceptron(data: Data, budget: float, seed: int, settings: Settings | None = None) -> PerceptronModel:
    """An inverse-dynamics MLP."""
    used, n = Stopwatch(budget), data.truth.width
    torch.manual_seed(seed)
    samples, held = samples_of(data.train), samples_of(data.validation)
    scales, chosen = scales_of(samples), settings or PERCEPTRON[few(n)]
    module = Layers(5 * n, chosen.hidden, n)

    def pairs(samples: Samples) -> list[np.ndarray]:
        *motion, effort = columns_of(samples)
        return [_inputs(scales, *motion), effort / scales.effort]

    fit(
        module,
        lambda c: ((module(c[0]) - c[1]) ** 2).mean(),
        pairs(samples),
        pairs(held),
        chosen,
        used,
        joints=n,
        rng=np.random.default_rng(seed),
    )
    return PerceptronModel(data.truth.joints, module, scales)


def _inputs(scales: Scales, q: np.ndarray, v: np.ndarray, a: np.ndarray, direction: np.ndarray) -> np.ndarray:
    sizes = [v / scales.velocity, direction, a / scales.acceleration]
    return np.concatenate([np.sin(q), np.cos(q), *sizes], axis=1)


class LeastSquaresModel(ReadOut):
    """The URDF's axes with parameters that need not be those of bodies."""

    def __init__(self, robot: Robot, parameters: np.ndarray, scales: Scales) -> None:
        super().__init__(robot.joints, scales)
        self._robot, self._parameters = robot, parameters

    def effort(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, direction: np.ndarray) -> np.ndarray:
        motion = Samples(q, v, a, direction, np.zeros_like(q), np.ones(q.shape, bool))
        return np.asarray(columns(self._robot.regressor(q, v, a), motion) @ self._parameters)


def least_squares(data: Data, budget: float, seed: int) -> LeastSquaresModel:
    """Ordinary least squares on the regressor, rotors, viscous and Coulomb friction and offsets.

    It knows the true axes and the true kinds of friction; each joint weighs by its effort's spread.
    """
    samples = samples_of([*data.train, *data.validation])
    scales = scales_of(samples)
    regressor = data.nominal.regressor(samples.position, samples.velocity, samples.acceleration)
    rows = (columns(regressor, samples) / scales.effort[:, None]).reshape(len(samples) * samples.width, -1)
    parameters = np.linalg.lstsq(rows, (samples.effort / scales.effort).ravel(), rcond=1e-8)[0]
    return LeastSquaresModel(data.nominal, parameters, scales)
