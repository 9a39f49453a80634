"""Independent errors of what is known before a recording: of links, of identified joints, and of joint effects found earlier."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.diagnosis.regression.columns import Columns
from bdnn_ros.diagnosis.regression.joint_errors import JointErrors
from bdnn_ros.diagnosis.regression.unsure import Unsure

USUAL_MASS_ERROR = 0.05
"""Smallest relative error of a described link mass that is believed, as far as twice `link_error` allows."""


@dataclass(frozen=True)
class Errors:
    """U independent errors; one unit is an error of 100 %, or a hundred standard deviations of what was identified.

    Attributes:
        relative: map from them to inertial parameters, (n * PER_LINK, U).
        masses: which of them are described masses, (U,) bool.
        joints: the same errors at the joints of an identified model; None against a description.
        unsure: errors of joint effects that an earlier diagnosis found, the last K of the U errors; None without.
    """

    relative: np.ndarray
    masses: np.ndarray
    joints: JointErrors | None = None
    unsure: Unsure | None = None

    def columns(self, columns: Columns) -> np.ndarray:
        """Effort per unit of each error, rows (R, n, U) [N·m]."""
        result = np.asarray(columns.decimation.regressor @ self.relative)
        if self.joints is not None:
            result += self.joints.columns(columns)
        if self.unsure is not None:
            result[:, :, self.unsure.last] = self.unsure.columns(columns)
        return result

    def spread(self, link_error: float) -> np.ndarray:
        """Prior standard deviations, (U,), given that of the links' relative errors.

        At a small link error masses are believed half as well: shapes are drawn to scale, masses are guessed.
        """
        spread = np.where(self.masses, max(link_error, min(2.0 * link_error, USUAL_MASS_ERROR)), link_error)
        if self.unsure is not None:
            spread[self.unsure.last] = 1.0
        return spread
