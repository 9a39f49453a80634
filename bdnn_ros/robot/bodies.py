"""Physically possible bodies: those whose pseudo-inertia is positive-definite."""

from __future__ import annotations

import numpy as np

SMALLEST_SPREAD = 1e-4
"""Least principal second moment of a body, relative to its largest: thinner bodies are thickened."""
LIGHTEST, SHORTEST = 1e-3, 1e-6
"""Least mass of a body [kg], and least second moment per mass [m²]."""
USUAL_MASS = 3.0
"""Mean mass of an arm's links [kg]."""


def pseudo_inertia(inertials: np.ndarray) -> np.ndarray:
    """Pseudo-inertia [[Σ, m·c], [m·cᵀ, m]] of bodies from their inertial parameters (..., PER_LINK), (..., 4, 4).

    Σ = ½ tr(I)·1 − I is the second moment of the mass. Positive-definite if and only if some distribution of
    mass has these parameters (Wensing, Kim and Slotine, IEEE RA-L 2018).
    """
    inertia = inertials[..., [4, 5, 7, 5, 6, 8, 7, 8, 9]].reshape(*inertials.shape[:-1], 3, 3)
    result = np.empty((*inertials.shape[:-1], 4, 4))
    result[..., :3, :3] = 0.5 * np.trace(inertia, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - inertia
    result[..., :3, 3] = result[..., 3, :3] = inertials[..., 1:4]
    result[..., 3, 3] = inertials[..., 0]
    return result


def inertial_parameters(pseudo: np.ndarray) -> np.ndarray:
    """Inertial parameters (PER_LINK,) of a pseudo-inertia (4, 4): the inverse of `pseudo_inertia`."""
    moment = pseudo[:3, :3]
    inertia = np.trace(moment) * np.eye(3) - moment
    return np.array([pseudo[3, 3], *pseudo[:3, 3], *inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])


def heaviness(inertials: np.ndarray) -> float:
    """What a robot's bodies (n, PER_LINK) weigh in terms of usual ones: what is next to nothing of them goes by it.

    1 where they weigh nothing.
    """
    return max(float(np.mean(inertials[:, 0])), 0.0) / USUAL_MASS or 1.0


def feasible_pseudo_inertia(pseudo: np.ndarray, heavy: float = 1.0) -> np.ndarray:
    """The pseudo-inertia itself, or the nearest one that is safely positive-definite, (4, 4).

    URDFs hold massless links, points, thin rods and inertias that no body can have.

    Args:
        pseudo: (4, 4).
        heavy: `heaviness` of the robot that it is a body of.
    """
    mass = max(float(pseudo[3, 3]), LIGHTEST * heavy)
    centre = pseudo[:3, 3] / mass
    moment = pseudo[:3, :3] - mass * np.outer(centre, centre)
    values, vectors = np.linalg.eigh(moment)
    floor = max(SMALLEST_SPREAD * float(values[-1]), SHORTEST * mass)
    if pseudo[3, 3] >= mass and values[0] >= floor:
        return pseudo
    moment = (vectors * np.maximum(values, floor)) @ vectors.T
    result = np.empty((4, 4))
    result[:3, :3] = moment + mass * np.outer(centre, centre)
    result[:3, 3] = result[3, :3] = mass * centre
    result[3, 3] = mass
    return result


def thickened(inertial: np.ndarray, heavy: float = 1.0) -> np.ndarray:
    """Inertial parameters (PER_LINK,) of a body, or of the nearest one that can safely exist; as `feasible_pseudo_inertia`."""
    pseudo = pseudo_inertia(inertial)
    possible = feasible_pseudo_inertia(pseudo, heavy)
    return inertial if possible is pseudo else inertial_parameters(possible)
