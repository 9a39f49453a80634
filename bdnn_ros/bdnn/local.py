"""One small network per joint for what a prior's bias leaves out: the shape of friction, cogging, springs.

The network of a joint sees only that joint: its position with harmonics, its velocity, its direction of motion and its
gravity load; of its neighbours, which may share a gear, only velocity and direction. So little data suffices, and nothing is
learned that the motion did not show joint by joint. The hidden layer is random and the output layer is solved for (a random-
vector functional-link network: Pao and Takefuji, "Functional-link net computing", Computer 25(5), 1992): no iterations, no
local minima.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from bdnn_ros.robot.entries import require_shapes

HARMONICS = 20
HIDDEN = 24
INPUTS = 5
PLAIN = 10
"""Features that are neither harmonics nor hidden units."""
STEEPEST = 30.0
"""Largest gain of a hidden unit on the velocity, over the joint's typical velocity."""


@dataclass(frozen=True)
class LocalNetworks:
    """Effort of each joint as a function of its own motion.

    Attributes:
        hidden_weights, hidden_bias: of the inputs [sin q, cos q, q̇ / velocity, direction, load],
            (n, hidden, 5) and (n, hidden).
        output_weights: of the features, (n, F).
        velocity, load: typical sizes, (n,) [rad/s] and [N·m].
        harmonics: of the position, among the features.
    """

    hidden_weights: np.ndarray
    hidden_bias: np.ndarray
    output_weights: np.ndarray
    velocity: np.ndarray
    load: np.ndarray
    harmonics: int = HARMONICS

    @classmethod
    def silent(cls, velocity: np.ndarray, load: np.ndarray) -> LocalNetworks:
        """Networks with zero output."""
        n, rng = len(velocity), np.random.default_rng(0)
        weights = rng.normal(size=(n, HIDDEN, INPUTS)) * np.array([1.0, 1.0, 1.0, 0.5, 0.5])
        weights[:, :, 2] *= np.exp(rng.uniform(0.0, np.log(STEEPEST), (n, HIDDEN)))
        bias = rng.normal(size=(n, HIDDEN))
        return cls(weights, bias, np.zeros((n, PLAIN + 2 * HARMONICS + HIDDEN)), velocity, load)

    def with_offset(self, offset: np.ndarray) -> LocalNetworks:
        """The same networks with a constant effort added, (n,) [N·m]."""
        weights = self.output_weights.copy()
        weights[:, 0] += offset
        return replace(self, output_weights=weights)

    def __call__(
        self, position: np.ndarray, velocity: np.ndarray, direction: np.ndarray, load: np.ndarray
    ) -> np.ndarray:
        """Effort, (B, n) [N·m].

        Args:
            position, velocity: (B, n).
            direction: of the motion, -1 to 1, (B, n).
            load: gravity's effort, (B, n) [N·m].
        """
        if not self.output_weights[:, 1:].any():
            return np.broadcast_to(self.output_weights[:, 0], position.shape)
        efforts = [
            self.features(joint, position, velocity, direction, load) @ weights
            for joint, weights in enumerate(self.output_weights)
        ]
        return np.stack(efforts, axis=1)

    def features(
        self, joint: int, position: np.ndarray, velocity: np.ndarray, direction: np.ndarray, load: np.ndarray
    ) -> np.ndarray:
        """What a joint's output layer weighs, (B, F): 1, velocities, neighbours, harmonics, hidden units."""
        rates = velocity / self.velocity
        rate, turn, carried = rates[:, joint], direction[:, joint], load[:, joint] / self.load[joint]
        phase = position[:, joint, None] * np.arange(1, self.harmonics + 1)
        sine, cosine = np.sin(phase), np.cos(phase)
        plain = [np.ones_like(rate), rate, turn, rate * np.abs(rate), np.abs(carried) * turn, carried]
        for other in (joint - 1, joint + 1):
            there = 0 <= other < position.shape[1]
            plain += [values[:, other] if there else np.zeros_like(rate) for values in (rates, direction)]
        inputs = np.stack([sine[:, 0], cosine[:, 0], rate, turn, carried], axis=1)
        hidden = np.tanh(inputs @ self.hidden_weights[joint].T + self.hidden_bias[joint])
        return np.concatenate([np.stack(plain, axis=1), sine, cosine, hidden], axis=1)

    array_names: ClassVar[tuple[str, ...]] = (
        "hidden_weights",
        "hidden_bias",
        "output_weights",
        "velocity",
        "load",
    )

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays and JSON-able rest."""
        arrays = {f"local.{name}": getattr(self, name) for name in self.array_names}
        return arrays, {"harmonics": self.harmonics}

    @classmethod
    def from_state(cls, arrays: dict[str, np.ndarray], info: dict[str, Any], width: int) -> LocalNetworks:
        """The networks of `to_state`, of n = `width` joints.

        Raises:
            KeyError, TypeError, ValueError: something is missing or does not fit.
        """
        harmonics = int(info["harmonics"])
        _, hidden = arrays["local.hidden_bias"].shape
        features = PLAIN + 2 * harmonics + hidden
        shapes: dict[str, tuple[int, ...]] = {
            "hidden_bias": (width, hidden),
            "hidden_weights": (width, hidden, INPUTS),
            "output_weights": (width, features),
            "velocity": (width,),
            "load": (width,),
        }
        require_shapes(arrays, {f"local.{name}": shape for name, shape in shapes.items()})
        held: dict[str, Any] = {name: arrays[f"local.{name}"] for name in cls.array_names}
        return cls(**held, harmonics=harmonics)


def penalties(networks: LocalNetworks) -> np.ndarray:
    """Ridge penalty of each feature's weight, (F,): larger for high harmonics, small for plain friction."""
    orders = np.arange(1, networks.harmonics + 1)
    wavy = 1.0 + 0.3 * (orders - 1.0)
    plain = np.array([1e-3, 1e-2, 1e-2, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    return np.concatenate([plain, wavy, wavy, np.ones(networks.hidden_bias.shape[1])])
