"""How much of a motion is explained by bodies, rotors and friction that can exist, where others would explain it all."""

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
    """The likeliest bodies, rotors and friction that can exist, and what they leave.

    What none of them does, as a spring or a balancer, may look like some that cannot exist, a rotor of negative inertia for
    one: these leave nothing to explain.

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
        """Those nearest to a posterior, as far as its sums of motion tell."""
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
        """Joints of which something else has to explain most, (n,) bool."""
        return self.left > CLEARLY * self.least


def typical_friction(posterior_mean: np.ndarray, plain: Layout, statistics: Statistics) -> tuple[float, ...]:
    """Root mean square of each joint's viscous and Coulomb friction along the motion, n [N·m]."""
    result = []
    for joint, parameters in enumerate(plain.parameters):
        own = len(plain.columns) * PER_LINK + np.array([1, 2])
        sums = statistics.of_joint(joint, plain.columns[joint][own])
        x = posterior_mean[parameters[own]]
        result.append(float(np.sqrt(max(x @ sums.gram @ x, 0.0) / max(sums.count, 1.0))))
    return tuple(result)
