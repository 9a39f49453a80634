"""Networks for what named causes leave: for a joint, of whatever motion of the robot its residual was seen to depend on.

Like the local networks on a prior (`local.py`) they have a random hidden layer and an output layer that is solved for, beside
harmonics and products of the inputs. But the network of a joint sees only the inputs it is given, of any joint: its
neighbour's position, say. No input is an acceleration or a time, so the mass matrix stays unchanged and the result holds on
another day. Outside the range of an input seen in training, the value at the end of that range is used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bdnn_ros.robot.entries import require_shapes

POSITION, VELOCITY, LOAD = QUANTITIES = ("position", "velocity", "load")
HARMONICS = 12
HIDDEN = 48
STEEPEST = 30.0
"""Largest gain of a hidden unit on a velocity, over that joint's typical one."""
NARROW = 3.0
"""Spread of a hidden unit's gains on the sine and the cosine of a position."""
MARGIN = 0.02
"""So far beyond what the motion showed of an input, by its range, a network still knows what to say."""
FALLING = (1.0, 4.0, 16.0)
"""How quickly friction may fall with the speed, per typical velocity."""


@dataclass(frozen=True)
class Input:
    """An input of a network.

    Attributes:
        joint: whose.
        quantity: one of `QUANTITIES`.
        low, high: what the motion showed of it.
        scale: of a velocity or a load, its typical size; of a position, radians of phase per unit.
    """

    joint: int
    quantity: str
    low: float
    high: float
    scale: float


@dataclass(frozen=True)
class RestNetwork:
    """Effort of one joint as a function of some inputs.

    Attributes:
        joint: where the effort acts.
        inputs: what it depends on.
        hidden_weights, hidden_bias: of what `_seen` makes of the inputs, (HIDDEN, k) and (HIDDEN,).
        output_weights: of the features, (F,) [N·m]; the first is of a constant.
    """

    joint: int
    inputs: tuple[Input, ...]
    hidden_weights: np.ndarray
    hidden_bias: np.ndarray
    output_weights: np.ndarray

    @classmethod
    def silent(cls, joint: int, inputs: Sequence[Input]) -> RestNetwork:
        """A network with zero output."""
        rng = np.random.default_rng(0)
        gains: list[np.ndarray] = []
        for each in inputs:
            if each.quantity == POSITION:
                gains += list(NARROW * rng.normal(size=(2, HIDDEN)))
            elif each.quantity == VELOCITY:
                steep = np.exp(rng.uniform(0.0, np.log(STEEPEST), HIDDEN))
                gains += [steep * rng.normal(size=HIDDEN), rng.normal(size=HIDDEN)]
            else:
                gains.append(rng.normal(size=HIDDEN))
        weights = np.stack(gains, axis=1) / np.sqrt(len(inputs))
        network = cls(joint, tuple(inputs), weights, rng.normal(size=HIDDEN), np.zeros(0))
        return network.with_weights(np.zeros(len(network.penalties)))

    def with_weights(self, weights: np.ndarray) -> RestNetwork:
        """The same network with other output weights, (F,)."""
        return RestNetwork(self.joint, self.inputs, self.hidden_weights, self.hidden_bias, weights)

    def effort(
        self, position: np.ndarray, velocity: np.ndarray, direction: np.ndarray, load: np.ndarray
    ) -> np.ndarray:
        """Its effort, (B,) [N·m]; arguments as of `features`."""
        return self.features(position, velocity, direction, load) @ self.output_weights

    def features(
        self, position: np.ndarray, velocity: np.ndarray, direction: np.ndarray, load: np.ndarray
    ) -> np.ndarray:
        """The features that the output layer weighs, (B, F): 1, features of each input, products of two inputs, hidden units.

        Args:
            position, velocity: of the robot, (B, n).
            direction: of its joints' motion, -1 to 1, (B, n).
            load: gravity's effort, (B, n) [N·m].
        """
        given = {POSITION: position, VELOCITY: velocity, LOAD: load}
        own, seen = [], []
        for each in self.inputs:
            value = np.minimum(np.maximum(given[each.quantity][:, each.joint], each.low), each.high)
            alone, told = _of_input(each, value, direction[:, each.joint])
            own += alone
            seen.append(told)
        products = [a * b for k, one in enumerate(seen) for other in seen[:k] for a in one for b in other]
        base = np.stack([value for told in seen for value in told], axis=1)
        hidden = np.tanh(base @ self.hidden_weights.T + self.hidden_bias)
        first = np.stack([0.0 * own[0] + 1.0, *own, *products], axis=1)
        return np.concatenate([first, hidden], axis=1)

    def beyond(self, position: np.ndarray, velocity: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Where an input is outside the range seen in training, (B,) bool; arguments as of `features`."""
        given = {POSITION: position, VELOCITY: velocity, LOAD: load}
        result = np.zeros(len(position), bool)
        for each in self.inputs:
            value, margin = given[each.quantity][:, each.joint], MARGIN * (each.high - each.low)
            result |= (value < each.low - margin) | (value > each.high + margin)
        return result

    @property
    def penalties(self) -> np.ndarray:
        """Ridge penalty of each feature's weight, (F,): larger for high harmonics."""
        found, widths = [1e-3], []
        for each in self.inputs:
            if each.quantity == POSITION:
                found += [1.0 + 0.3 * order for order in range(HARMONICS) for _ in range(2)]
            else:
                found += [1.0] * (3 + len(FALLING) if each.quantity == VELOCITY else 3)
            widths.append(1 if each.quantity == LOAD else 2)
        pairs = sum(wide * other for k, wide in enumerate(widths) for other in widths[:k])
        return np.array(found + [1.0] * (pairs + HIDDEN))

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays and JSON-able rest."""
        arrays = {
            "hidden_weights": self.hidden_weights,
            "hidden_bias": self.hidden_bias,
            "output_weights": self.output_weights,
        }
        inputs = [[one.joint, one.quantity, one.low, one.high, one.scale] for one in self.inputs]
        return arrays, {"joint": self.joint, "inputs": inputs}

    @classmethod
    def from_state(cls, arrays: Mapping[str, np.ndarray], info: Mapping[str, Any], width: int) -> RestNetwork:
        """The network of `to_state`, of a robot of n = `width` joints.

        Raises:
            KeyError, TypeError, ValueError: something is missing or does not fit.
        """
        joint = int(info["joint"])
        inputs = [
            Input(int(place), str(quantity), float(low), float(high), float(scale))
            for place, quantity, low, high, scale in info["inputs"]
        ]
        if not inputs or any(one.quantity not in QUANTITIES for one in inputs):
            raise ValueError("inputs")
        if not all(0 <= place < width for place in (joint, *(one.joint for one in inputs))):
            raise ValueError("joint")
        network = cls.silent(joint, inputs)
        names = ("hidden_weights", "hidden_bias", "output_weights")
        require_shapes(arrays, {name: getattr(network, name).shape for name in names})
        return cls(joint, tuple(inputs), *(np.asarray(arrays[name], float) for name in names))


def _of_input(
    each: Input, value: np.ndarray, direction: np.ndarray
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Features of an input alone, and what the hidden units and products see of it, (B,) each.

    Args:
        direction: of its joint's motion, -1 to 1, (B,).
    """
    if each.quantity == POSITION:
        phase = each.scale * value
        waves = [wave(order * phase) for order in range(1, HARMONICS + 1) for wave in (np.sin, np.cos)]
        return waves, waves[:2]
    part = value / each.scale
    if each.quantity == LOAD:
        return [part, np.abs(part) * direction, part * np.abs(part)], [part]
    speed = np.abs(part)
    falling = [direction * np.exp(-rate * speed) for rate in FALLING]
    return [part, part * speed, direction, *falling], [part, direction]


def effort_of(
    networks: Sequence[RestNetwork],
    position: np.ndarray,
    velocity: np.ndarray,
    direction: np.ndarray,
    load: np.ndarray,
) -> np.ndarray:
    """What networks add to the effort of all joints, (..., n) [N·m]; arguments (..., n), as of `RestNetwork.features`."""
    width = np.shape(position)[-1]
    given = [np.reshape(values, (-1, width)) for values in (position, velocity, direction, load)]
    result = np.zeros((len(given[0]), width))
    for network in networks:
        result[:, network.joint] += network.effort(*given)
    return result.reshape(np.shape(position))
