"""Motors that turn with two joints at once, as in the wrists of many robots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bdnn_ros.physical.dictionary import CURVE_FEATURES, curve
from bdnn_ros.physical.presliding import COUPLING_SIGNS

PER_COUPLING = 3
"""Armature [kg·m²], viscous [N·m·s/rad] and Coulomb [N·m] friction of such a motor."""


@dataclass(frozen=True)
class Coupling:
    """The motor of joint `joint` + 1 also turns with joint `joint`: at q̇[joint + 1] + sign · q̇[joint]."""

    joint: int
    sign: int


@dataclass(frozen=True)
class CoupledMotors:
    """Inertia and friction of coupled motors, which act on both their joints.

    Attributes:
        couplings: which joints, c of them.
        parameters: armature, viscous and Coulomb friction of each, none negative, (c, PER_COUPLING).
        weights: of the features of each motor's friction curve, (c, CURVE_FEATURES) [N·m].
        limit: velocity limit of each motor, (c,) [rad/s].
    """

    couplings: tuple[Coupling, ...] = ()
    parameters: np.ndarray = field(default_factory=lambda: np.zeros((0, PER_COUPLING)))
    weights: np.ndarray = field(default_factory=lambda: np.zeros((0, CURVE_FEATURES)))
    limit: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def speeds(self, values: np.ndarray) -> np.ndarray:
        """Velocities (or accelerations) of the motors from those of the joints (..., n), (..., c)."""
        if not self.couplings:
            return np.zeros((*np.shape(values)[:-1], 0))
        parts = [values[..., c.joint + 1] + c.sign * values[..., c.joint] for c in self.couplings]
        return np.stack(parts, axis=-1)

    def of_pairs(self, values: np.ndarray) -> np.ndarray:
        """The coupled motors' entries of values for all pairs and signs, (N, n - 1, signs), as (N, c)."""
        chosen = [values[:, c.joint, COUPLING_SIGNS.index(c.sign)] for c in self.couplings]
        return np.stack(chosen, axis=-1) if chosen else np.zeros((len(values), 0))

    def on_joints(self, efforts: np.ndarray, width: int) -> np.ndarray:
        """Efforts of the motors (..., c) as efforts of the joints, (..., width)."""
        result = np.zeros((*np.shape(efforts)[:-1], width))
        for k, coupling in enumerate(self.couplings):
            result[..., coupling.joint + 1] += efforts[..., k]
            result[..., coupling.joint] += coupling.sign * efforts[..., k]
        return result

    def inertial(self, acceleration: np.ndarray) -> np.ndarray:
        """Effort of the rotors' inertia, (..., n) [N·m]."""
        return self.on_joints(self.parameters[:, 0] * self.speeds(acceleration), acceleration.shape[-1])

    def viscous(self, velocity: np.ndarray) -> np.ndarray:
        """Effort of viscous friction, (..., n) [N·m]."""
        return self.on_joints(self.parameters[:, 1] * self.speeds(velocity), velocity.shape[-1])

    def dry(self, velocity: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Effort of Coulomb friction and its speed-dependent part, from the motors' directions (..., c), (..., n) [N·m]."""
        speed = self.speeds(velocity) / self.limit
        learned = sum(w * phi for w, phi in zip(self.weights.T, curve(speed, direction), strict=True))
        return self.on_joints(self.parameters[:, 2] * direction + learned, velocity.shape[-1])

    def friction(self, velocity: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Effort of viscous friction, Coulomb friction and its speed-dependent part, (..., n) [N·m]."""
        return self.viscous(velocity) + self.dry(velocity, direction)

    def mass_matrix(self, width: int) -> np.ndarray:
        """Contribution of the rotors to M, positive semi-definite, (width, width) [kg·m²]."""
        ways = self.on_joints(np.eye(len(self.couplings)), width)
        return np.asarray((ways * self.parameters[:, :1]).T @ ways)

    def to_state(self) -> tuple[dict[str, np.ndarray], list[list[int]]]:
        """Arrays and JSON-able rest that make them again."""
        arrays = {"parameters": self.parameters, "weights": self.weights, "limit": self.limit}
        return arrays, [[coupling.joint, coupling.sign] for coupling in self.couplings]

    @classmethod
    def from_state(cls, arrays: dict[str, np.ndarray], pairs: Sequence[Sequence[int]]) -> CoupledMotors:
        """Those of `to_state`."""
        couplings = tuple(Coupling(int(joint), int(sign)) for joint, sign in pairs)
        shapes = [arrays[key].shape for key in ("parameters", "weights", "limit")]
        count = len(couplings)
        if shapes != [(count, PER_COUPLING), (count, CURVE_FEATURES), (count,)]:
            raise ValueError("couplings")
        if any(coupling.sign not in COUPLING_SIGNS for coupling in couplings):
            raise ValueError("signs of couplings")
        return cls(couplings, arrays["parameters"], arrays["weights"], arrays["limit"])
