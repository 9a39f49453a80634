"""Errors of link parameters in relative units, given by the described bodies themselves."""

from __future__ import annotations

import numpy as np

from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.bodies import feasible_pseudo_inertia, heaviness, inertial_parameters, pseudo_inertia

THIN = 0.3
"""No link is described better across than this share of its length would tell."""


def relative_inertials(robot: Robot) -> np.ndarray:
    """Map from relative errors of each link to its inertial parameters, (n * PER_LINK, n * PER_LINK).

    Each link has ten units. The first scales mass and inertia together. The next three move the centre of mass, each relative
    to the extent of the link's mass from the joint's frame in that direction. The last six change its second moments about
    the centre, each relative to its own size. An error of 0.1 thus means "10 % off" in each of these senses.
    """
    result = np.zeros((robot.width * PER_LINK, robot.width * PER_LINK))
    heavy = heaviness(robot.inertials)
    for i, values in enumerate(robot.inertials):
        pseudo = feasible_pseudo_inertia(pseudo_inertia(values), heavy)
        mass = float(pseudo[3, 3])
        centre = pseudo[:3, 3] / mass
        columns = [pseudo]
        for step_of_centre in _axes(pseudo[:3, :3] / mass).T:
            step = np.zeros((4, 4))
            step[:3, :3] = mass * (np.outer(centre, step_of_centre) + np.outer(step_of_centre, centre))
            step[:3, 3] = step[3, :3] = mass * step_of_centre
            columns.append(step)
        axes = _axes(pseudo[:3, :3] - mass * np.outer(centre, centre))
        for row in range(3):
            for column in range(row + 1):
                step = np.zeros((4, 4))
                along = np.outer(axes[:, row], axes[:, column])
                step[:3, :3] = along if row == column else along + along.T
                columns.append(step)
        rows = slice(i * PER_LINK, (i + 1) * PER_LINK)
        result[rows, rows] = np.stack([inertial_parameters(column) for column in columns], axis=1)
    return result


def _axes(moments: np.ndarray) -> np.ndarray:
    """Principal axes of second moments (3, 3) as columns, scaled by the extent along them; no link is thinner than `THIN`."""
    reach, axes = np.linalg.eigh(moments)
    return np.asarray(axes * np.sqrt(np.maximum(reach, THIN**2 * reach.max())))
