"""What every model of a robot answers, whatever it is made of."""

from __future__ import annotations

from typing import Protocol

import numpy as np


class Dynamics(Protocol):
    """What every model of a robot answers; arrays are (..., n) in the order of `joints`, SI units."""

    @property
    def joints(self) -> tuple[str, ...]:
        """n joint names."""

    def inverse_dynamics(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Effort [N·m], (..., n)."""

    def forward_dynamics(self, position: np.ndarray, velocity: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """Acceleration [rad/s²], (..., n)."""

    def mass_matrix(self, position: np.ndarray) -> np.ndarray:
        """M(q) [kg·m²], (..., n, n), symmetric positive-definite."""

    def coriolis(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """C(q, q̇) q̇ [N·m], (..., n)."""

    def gravity(self, position: np.ndarray) -> np.ndarray:
        """g(q) [N·m], (..., n)."""

    def friction(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """What in the effort is neither inertial, Coriolis nor gravity, at zero acceleration (..., n)."""
