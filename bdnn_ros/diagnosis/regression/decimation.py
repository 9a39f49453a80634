"""From values at the working rate to rows: low-passed as both sides of the regression are, and decimated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from bdnn_ros.diagnosis.regression.pushing import Pushing
from bdnn_ros.effects.motion import Motion


@dataclass(frozen=True)
class Decimation:
    """The way from N working samples to R rows.

    Attributes:
        simulated: the motion at the working rate, with the robot and the load of the simulation.
        samples: which working samples are rows, (R,) int.
        load_friction_factor: factor on efforts by an earlier model's load-dependent friction, (N, n); None without.
        lead: how far the recorded effort is known to be ahead of the motion [s].
    """

    simulated: Motion
    samples: np.ndarray
    load_friction_factor: np.ndarray | None = None
    lead: float = 0.0

    def as_rows(self, values: np.ndarray, borne: bool = True) -> np.ndarray:
        """Values at the working rate (N, ...) low-passed and decimated to rows (R, ...); `borne` ones `with_load_friction`."""
        flat = (self.with_load_friction(values) if borne else values).reshape(len(values), -1)
        acting, result = (
            np.ones(len(flat)) @ np.abs(flat) != 0.0,
            np.zeros((len(self.samples), flat.shape[1])),
        )
        acting = slice(None) if acting.all() else acting  # without a copy
        if self.lead:
            smooth = self.simulated.advanced(self.simulated.signals.smooth(flat[:, acting]), self.lead)
            result[:, acting] = smooth[self.samples]
        else:
            result[:, acting] = self._smoothing @ flat[:, acting]
        return result.reshape(len(self.samples), *values.shape[1:])

    def with_load_friction(self, values: np.ndarray) -> np.ndarray:
        """Efforts at the working rate (N, n, ...) multiplied by the load-dependent friction that an earlier model has."""
        factor = self.load_friction_factor
        return values if factor is None else np.einsum("ij,ij...->ij...", factor, values)

    def pushing(self, pulls: np.ndarray) -> Pushing:
        """Columns of a push at one place as rows, given what it pulls there, (N, n, K); for a decimation without lead."""
        return Pushing.of(self.with_load_friction(pulls), self._smoothing, self.samples)

    @cached_property
    def regressor(self) -> np.ndarray:
        """Regressor of all inertial parameters as rows, (R, n, n * PER_LINK)."""
        return self.as_rows(self.simulated.regressor)

    @cached_property
    def _smoothing(self) -> csr_array:
        """The low-pass at the rows, (R, N)."""
        return self.simulated.signals.smoothing_at(self.samples)
