"""From the posterior to the model that is handed over; refused if it is not physically consistent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bdnn_ros.errors import UpdateRejected
from bdnn_ros.physical.consistency import consistent, feasible
from bdnn_ros.physical.couplings import PER_COUPLING, CoupledMotors
from bdnn_ros.physical.dictionary import CURVE_FEATURES, Scales
from bdnn_ros.physical.left_open import left_open
from bdnn_ros.physical.linear import inverse, solve
from bdnn_ros.physical.local import LocalResiduals, spread_weights
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import PER_JOINT, Parameters
from bdnn_ros.physical.recursive import Posterior, Recursion
from bdnn_ros.physical.structure import TILT, Layout, Structure
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.mounting import tilt_of

FRICTION_LAW = 0.01
"""Coulomb and viscous friction are idealisations, good to this share of the friction."""
USUAL_SPEED = 0.25
"""Speed at which that share is meant, in units of the limit."""


def physical_model(
    robot: Robot,
    posterior: Posterior,
    structure: Structure,
    scales: Scales,
    version: int = 1,
    motion: Recursion | None = None,
) -> PhysicalModel:
    """The most probable physically consistent model.

    Bodies and friction are moved into the feasible set; the learned weights follow as far as the posterior correlates them.

    Args:
        motion: sums of what tells, by which what they leave open of all that its joints may add is told as well; None where
            nobody asks.

    Raises:
        UpdateRejected: the posterior is not finite, or no feasible robot is near it.
    """
    layout, lead = posterior.layout, posterior.layout.lead
    if not np.isfinite(posterior.mean).all():
        raise UpdateRejected("The identified parameters are not finite.", "Check the efforts for outliers.")
    vector, information = _most_probable(posterior, robot.width)
    values = Parameters.from_vector(vector[: layout.base])
    if not feasible(values.inertials):
        raise UpdateRejected("The identified inertias are not physically possible.", "Check units and signs.")
    identified = robot.with_inertials(values.inertials)
    identified = identified.with_joint_parameters(values.armature, values.viscous, values.coulomb)
    further, doubt = np.zeros((2, len(TILT) + robot.width))
    covariance = inverse(information)
    std = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    for k, at in zip(structure.setup, layout.setup, strict=True):
        further[k], doubt[k] = vector[at], std[at]
    idealised = _idealised(structure, scales)
    left = None if motion is None else left_open(motion, structure, posterior, scales).wider(idealised)
    tilt, zeros = np.split(further, [len(TILT)])
    if tilt.any():
        identified = identified.tilted(*(tilt_of(robot.gravity_vector) + tilt))
    return PhysicalModel(
        replace(identified, zeros=robot.zeros + zeros),
        values.offset,
        covariance[: layout.base, : layout.base] + idealised,
        posterior.noise,
        version,
        structure.breakaway,
        _motors(vector, layout, structure, scales),
        _learned_effort(vector, layout, structure, scales),
        float(vector[lead]),
        float(std[lead]),
        tilt_std=(float(doubt[0]), float(doubt[1])),
        zeros_std=tuple(doubt[len(TILT) :].tolist()),
        open=left,
    )


def _most_probable(posterior: Posterior, width: int) -> tuple[np.ndarray, np.ndarray]:
    """The most probable feasible parameters, (P,), and the information on those that are not weights."""
    layout = posterior.layout
    physical = np.arange(layout.lead + 1 + len(layout.setup))
    learned = np.arange(len(physical), layout.size)
    cross = posterior.information[np.ix_(learned, physical)]
    follow = solve(posterior.information[np.ix_(learned, learned)], cross) if len(learned) else cross
    information = posterior.information[np.ix_(physical, physical)] - cross.T @ follow
    mean = posterior.mean[physical]
    vector = consistent(mean, information, width, layout.positive)
    weights = posterior.mean[learned] - follow @ (vector - mean)
    return np.concatenate([vector, weights]), information


def _motors(vector: np.ndarray, layout: Layout, structure: Structure, scales: Scales) -> CoupledMotors:
    """The coupled motors of the parameters (P,)."""
    pairs = structure.couplings
    return CoupledMotors(
        pairs,
        vector[layout.base : layout.lead].reshape(-1, PER_COUPLING),
        np.array([vector[where] for where in layout.motors]).reshape(-1, CURVE_FEATURES),
        np.array([scales.velocity[pair.joint] + scales.velocity[pair.joint + 1] for pair in pairs]),
    )


def _learned_effort(
    vector: np.ndarray, layout: Layout, structure: Structure, scales: Scales
) -> LocalResiduals | None:
    """The learned residual networks of the parameters (P,); None if nothing was learned."""
    if not any(structure.groups):
        return None
    of_joint = [vector[where] for where in layout.weights]
    taken = [w @ straight for w, straight in zip(of_joint, layout.straight, strict=True)]
    return LocalResiduals(
        structure.groups, spread_weights(structure.groups, of_joint), np.array(taken), scales
    )


def _idealised(structure: Structure, scales: Scales) -> np.ndarray:
    """Covariance of the base parameters that comes from the idealisation in the friction laws, (P, P)."""
    width = len(structure.friction)
    bodies = width * PER_LINK
    friction = FRICTION_LAW * np.array(structure.friction)
    added = np.zeros(bodies + PER_JOINT * width)
    added[bodies + width : bodies + 2 * width] = friction / (USUAL_SPEED * scales.velocity)
    added[bodies + 2 * width : bodies + 3 * width] = friction
    return np.diag(added**2)
