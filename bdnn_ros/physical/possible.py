"""How much of a motion physically possible bodies, rotors and friction explain, compared with unconstrained ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.physical.consistency import consistent
from bdnn_ros.physical.recursive import Posterior, Recursion
from bdnn_ros.physical.selection import NEGLIGIBLE
from bdnn_ros.physical.statistics import Statistics
from bdnn_ros.physical.structure import Layout
from bdnn_ros.robot import PER_LINK

CLEARLY = 2.0
"""They explain a joint where they leave less than so many times the error that is left by whatever fits best."""


@dataclass(frozen=True)
class Possible:
    """The most likely physically possible bodies, rotors and friction, and their residual.

    Effects outside this model, such as a spring or balancer, may be fitted by impossible parameters (a rotor with negative
    inertia, say), which leave no residual. The comparison reveals such effects.

    Attributes:
        inertials: of the bodies, flat, (n * PER_LINK,).
        left: root mean square error of each joint, (n,) [N·m].
        least: the same of the likeliest parameters of all, (n,) [N·m].
    """

    inertials: np.ndarray
    left: np.ndarray
    least: np.ndarray

    @classmethod
    def of(cls, recursion: Recursion, posterior: Posterior) -> Possible:
        """The feasible parameters nearest to a posterior, and their residual by its sums of motion."""
        assert recursion.total is not None
        layout = posterior.layout
        width = len(layout.columns)
        mean = consistent(posterior.mean, posterior.information, width, layout.positive)
        errors = np.empty((2, width))
        for joint, rows in enumerate(layout.parameters):
            sums = layout.regression(recursion.total, joint)
            for one, point in enumerate((mean, posterior.mean)):
                squared = sums.squared_error(point[rows]) + NEGLIGIBLE * sums.energy
                errors[one, joint] = np.sqrt(squared / max(sums.count, 1.0))
        return cls(mean[: width * PER_LINK], *errors)

    @property
    def unexplained(self) -> np.ndarray:
        """Joints most of whose effort must come from something else, (n,) bool."""
        return self.left > CLEARLY * self.least


def typical_friction(posterior_mean: np.ndarray, plain: Layout, statistics: Statistics) -> tuple[float, ...]:
    """RMS of each joint's viscous and Coulomb friction along the motion, n values [N·m]."""
    result = []
    for joint, parameters in enumerate(plain.parameters):
        own = len(plain.columns) * PER_LINK + np.array([1, 2])
        sums = statistics.of_joint(joint, plain.columns[joint][own])
        x = posterior_mean[parameters[own]]
        result.append(float(np.sqrt(max(x @ sums.gram @ x, 0.0) / max(sums.count, 1.0))))
    return tuple(result)
