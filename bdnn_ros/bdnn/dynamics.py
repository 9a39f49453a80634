"""The BDNN: forward and inverse dynamics from the same H and R."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from bdnn_ros.bdnn.cores import Core, NetworkCore, PriorCore
from bdnn_ros.bdnn.mechanics import coriolis_matrix
from bdnn_ros.bdnn.restoring import Build, prior_core, prior_core_state
from bdnn_ros.robot.entries import reading
from bdnn_ros.signals import Signals


@dataclass(frozen=True)
class BDNN:
    """A robot learned from its motion: q̈ = H(q) (u − R(q, q̇)), u = H(q)⁻¹ q̈ + R(q, q̇).

    H is positive-definite by construction. Every array is (..., n) in the order of `joints`, SI units.

    Attributes:
        core: networks alone (`NetworkCore`), or a learned chain and what it leaves out (`PriorCore`).
    """

    kind: ClassVar[str] = "bdnn"

    core: Core

    @property
    def joints(self) -> tuple[str, ...]:
        """n joint names, the order of every array."""
        return self.core.joints

    # -- both directions ---------------------------------------------------------------------------------

    def inverse_dynamics(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Effort [N·m], (..., n)."""
        q, v, a = (_rows(x) for x in (position, velocity, acceleration))
        effort = (self.core.mass_matrix(q) @ a[..., None])[..., 0] + self.core.bias(q, v)
        return effort.reshape(np.shape(position))

    def forward_dynamics(self, position: np.ndarray, velocity: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """Acceleration [rad/s²], (..., n)."""
        q, v, u = (_rows(x) for x in (position, velocity, effort))
        drive = u - self.core.bias(q, v)
        acceleration = np.linalg.solve(self.core.mass_matrix(q), drive[..., None])[..., 0]
        return acceleration.reshape(np.shape(position))

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort along a motion, (N, n) [N·m], low-passed as much as `signals.effort` is."""
        return self.core.predict(signals)

    # -- its parts ---------------------------------------------------------------------------------------

    def mass_matrix(self, position: np.ndarray) -> np.ndarray:
        """M(q) = H(q)⁻¹ [kg·m²], (..., n, n), symmetric positive-definite."""
        mass = self.core.mass_matrix(_rows(position))
        return mass.reshape(*np.shape(position), mass.shape[-1])

    def mass_matrix_derivative(self, position: np.ndarray) -> np.ndarray:
        """∂M/∂q_k at [..., k] [kg·m²/rad], (..., n, n, n)."""
        change = self.core.mass_matrix_derivative(_rows(position))
        return change.reshape(*np.shape(position), *change.shape[-2:])

    def coriolis(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """C(q, q̇) q̇ [N·m], (..., n), by Christoffel's symbols of M."""
        return (coriolis_matrix(self, position, velocity) @ np.asarray(velocity)[..., None])[..., 0]

    def gravity(self, position: np.ndarray) -> np.ndarray:
        """g(q) [N·m], (..., n): the bias at rest."""
        q = _rows(position)
        return self.core.bias(q, np.zeros_like(q)).reshape(np.shape(position))

    def friction(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """The part of the bias that is neither Coriolis nor gravity [N·m], (..., n)."""
        bias = self.core.bias(_rows(position), _rows(velocity)).reshape(np.shape(position))
        return bias - self.coriolis(position, velocity) - self.gravity(position)

    # -- files -------------------------------------------------------------------------------------------

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays and JSON-able rest that make the model again."""
        if isinstance(self.core, NetworkCore):
            arrays, info = self.core.to_state()
            return arrays, {**info, "core": "networks", "joints": list(self.joints)}
        assert isinstance(self.core, PriorCore)
        arrays, info = prior_core_state(self.core)
        return arrays, {**info, "core": "chain"}

    @classmethod
    def from_state(
        cls, arrays: dict[str, np.ndarray], info: dict[str, Any], build: Build | None = None
    ) -> BDNN:
        """The model of `to_state`.

        Args:
            build: makes a prior that is not a `Robot` from its kind, arrays and info.

        Raises:
            ModelFileError: something is missing or does not fit, or the prior's kind needs `build`.
        """
        with reading("The BDNN", "Identify it again.", arrays, info) as (arrays, info):
            if info["core"] == "networks":
                return cls(NetworkCore.from_state(tuple(info["joints"]), arrays, info))
            return cls(prior_core(arrays, info, build))


class BDNNOnPrior(BDNN):
    """A BDNN whose core is a prior given by the user (`cores.PriorCore`) and networks that learn the rest."""

    kind: ClassVar[str] = "bdnn_on_prior"


def _rows(values: np.ndarray) -> np.ndarray:
    """Values (..., n) as rows, (B, n)."""
    values = np.asarray(values, dtype=float)
    return values.reshape(-1, values.shape[-1])
