"""Parameters that some real robot can have: every body's mass somewhere, no friction that drives."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from bdnn_ros.physical.parameters import (
    feasible_pseudo_inertia,
    inertial_parameters,
    pseudo_inertia,
    tangent_basis,
)
from bdnn_ros.robot import PER_LINK

FIRST_BARRIER, LAST_BARRIER, SHRINKING = 1.0, 0.01, 0.1
"""Weights of the barrier, in nats, each that share of the one before; the last one costs a hundredth of a nat a body."""
MARGIN_COST = 1e-7
"""The last weight as a share of what the start costs, where that is more."""
NEWTON_STEPS = 40
SMALLEST_MARGIN = 1e-9
"""Smallest eigenvalue of a pseudo-inertia, relative to its largest, that counts as positive-definite."""
RAISED = 1e-3
"""Eigenvalues of a start are at least this share of the largest."""
_TRACE = np.array([1.0 if row == column else 0.0 for row in range(4) for column in range(row + 1)])


def feasible(inertials: np.ndarray) -> bool:
    """Whether every body (n, PER_LINK) could exist: then M(q) is positive-definite in every position."""
    for values in inertials:
        eigenvalues = np.linalg.eigvalsh(pseudo_inertia(values))
        if not eigenvalues[0] > SMALLEST_MARGIN * max(eigenvalues[-1], 0.0):
            return False
    return True


def consistent(mean: np.ndarray, information: np.ndarray, bodies: int, positive: np.ndarray) -> np.ndarray:
    """The most probable parameters among those a real robot can have, (P,).

    Minimises ½ (θ − mean)ᵀ information (θ − mean) under J(θ) ≻ 0 for the pseudo-inertia of every body and θ
    ≥ 0 for the `positive` ones, by Newton steps on a logarithmic barrier (Boyd and Vandenberghe, "Convex
    Optimization", chapter 11; the constraint is the linear matrix inequality of Wensing, Kim and Slotine,
    IEEE RA-L 2018).

    Args:
        mean, information: Gaussian belief, (P,) and (P, P); the first bodies · PER_LINK entries are
            inertials.
        bodies: number of bodies.
        positive: indices of parameters that cannot be negative.
    """
    inertials = mean[: bodies * PER_LINK].reshape(bodies, PER_LINK)
    if feasible(inertials) and (mean[positive] >= 0.0).all():
        return mean.copy()

    def cost(point: np.ndarray) -> float:
        return 0.5 * float((point - mean) @ information @ (point - mean))

    possible: list[np.ndarray] = []
    # a body of hardly any mass reaches far where its first moment is kept: then the second start is the better one
    for inside in (feasible_pseudo_inertia, _raised):
        point = _start(mean, information, bodies, positive, inside)
        for first in (max(FIRST_BARRIER, cost(point) / bodies), FIRST_BARRIER):
            found = _descended(point, mean, information, bodies, positive, _barriers(first, cost(point)))
            if found is not None:
                return min([*possible, found], key=cost)
        if feasible(point[: inertials.size].reshape(bodies, PER_LINK)):
            possible.append(point)
    return min(possible, key=cost)


def _start(
    mean: np.ndarray,
    information: np.ndarray,
    bodies: int,
    positive: np.ndarray,
    inside: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """A point (P,) well inside of what can be: the barrier's Newton steps are slow from one on the edge."""
    point = mean.copy()
    for body in range(bodies):
        rows = slice(body * PER_LINK, (body + 1) * PER_LINK)
        point[rows] = inertial_parameters(inside(pseudo_inertia(mean[rows])))
    least = 1e-3 / np.sqrt(np.diagonal(information)) + 1e-12
    point[positive] = np.maximum(point[positive], least[positive])
    return point


def _raised(pseudo: np.ndarray) -> np.ndarray:
    """A pseudo-inertia (4, 4) with every eigenvalue raised to a share of its largest."""
    values, vectors = np.linalg.eigh(pseudo)
    values = np.maximum(values, RAISED * max(values[-1], RAISED))
    return np.asarray(vectors * values @ vectors.T)


def _barriers(first: float, cost: float) -> Iterator[float]:
    """Weights of the barrier from a first one on, for a start that costs so much [nats].

    One as strong as what pulls out lets no step end at the edge it first meets; the last leaves a margin there.
    """
    barrier, last = first, max(LAST_BARRIER, MARGIN_COST * cost)
    while barrier > last / SHRINKING**0.5:
        yield barrier
        barrier *= SHRINKING
    yield last


def _descended(
    point: np.ndarray,
    mean: np.ndarray,
    information: np.ndarray,
    bodies: int,
    positive: np.ndarray,
    barriers: Iterator[float],
) -> np.ndarray | None:
    """The end of Newton's steps behind one barrier after another, (P,); None where rounding took it over the edge."""
    for barrier in barriers:
        for _ in range(NEWTON_STEPS):
            try:
                step, decrement = _newton(point, mean, information, bodies, positive, barrier)
            except LinAlgError:
                return None
            point = point + _largest(point, step, bodies, positive) * step
            if decrement < 1e-3 * barrier:
                break
    return point if feasible(point[: bodies * PER_LINK].reshape(bodies, PER_LINK)) else None


def _newton(
    point: np.ndarray,
    mean: np.ndarray,
    information: np.ndarray,
    bodies: int,
    positive: np.ndarray,
    barrier: float,
) -> tuple[np.ndarray, float]:
    """Newton step (P,) of the barrier problem and half its squared decrement."""
    gradient = information @ (point - mean)
    hessian = information.copy()
    for body in range(bodies):
        rows = slice(body * PER_LINK, (body + 1) * PER_LINK)
        # log det(L (1 + X) Lᵀ) has gradient tr X and Hessian −1 in the coordinates of X
        inverse = np.linalg.inv(tangent_basis(np.linalg.cholesky(pseudo_inertia(point[rows]))))
        gradient[rows] -= barrier * (_TRACE @ inverse)
        hessian[rows, rows] += barrier * inverse.T @ inverse
    gradient[positive] -= barrier / point[positive]
    hessian[positive, positive] += barrier / point[positive] ** 2
    size = 1.0 / np.sqrt(np.diagonal(hessian))
    factor = cho_factor(hessian * np.outer(size, size), lower=True, check_finite=False)
    step = -size * cho_solve(factor, size * gradient, check_finite=False)
    return step, -0.5 * float(gradient @ step)


def _largest(point: np.ndarray, step: np.ndarray, bodies: int, positive: np.ndarray) -> float:
    """Length of the step: full where that stays inside, else most of the way to the edge."""
    reach = 1.0
    for body in range(bodies):
        rows = slice(body * PER_LINK, (body + 1) * PER_LINK)
        inverse = np.linalg.inv(np.linalg.cholesky(pseudo_inertia(point[rows])))
        change = np.linalg.eigvalsh(inverse @ pseudo_inertia(step[rows]) @ inverse.T)[0]
        if change < 0.0:
            reach = min(reach, -0.9 / change)
    falling = step[positive] < 0.0
    if falling.any():
        reach = min(reach, float(np.min(-0.9 * point[positive][falling] / step[positive][falling])))
    return reach
