"""Physical consistency: inertias that a body can have, and friction that dissipates."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from bdnn_ros.physical.parameters import tangent_basis
from bdnn_ros.robot import PER_LINK
from bdnn_ros.robot.bodies import feasible_pseudo_inertia, inertial_parameters, pseudo_inertia

FIRST_BARRIER, LAST_BARRIER, SHRINKING = 1.0, 0.01, 0.1
"""Weights of the barrier, in nats, each that share of the one before."""
LAST_OF_POSITIVE, SHARPER = 1e-8, 1e-2
"""And on of the positive parameters' alone, until of one that no motion told the square root of that is left in standard
deviations: behind the bodies' last, a joint that stood so far would have a tenth of all the friction it might have."""
NEWTON_STEPS = 40
SMALLEST_MARGIN = 1e-9
"""Smallest eigenvalue of a pseudo-inertia, relative to its largest, that counts as positive-definite."""
RAISED = 1e-3
"""Eigenvalues of a start are at least this share of the largest."""
_MARGIN = SMALLEST_MARGIN * np.outer(
    inertial_parameters(np.eye(4)), [1.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.5, 0.0, 0.0, 0.5]
)
_INSIDE, _OUTSIDE = np.eye(PER_LINK) - _MARGIN, np.eye(PER_LINK) + _MARGIN / (1.0 - 4.0 * SMALLEST_MARGIN)
"""From a body's parameters to those of J − margin · tr J · 1, and back: that is positive-definite only where the body is
feasible. Behind a barrier of J itself thin bodies end between the edge and the margin, and count for nothing."""
_TRACE = np.array([1.0 if row == column else 0.0 for row in range(4) for column in range(row + 1)])


def feasible(inertials: np.ndarray) -> bool:
    """Whether every body (n, PER_LINK) is physically possible, so that M(q) is positive-definite in every position."""
    for values in inertials:
        eigenvalues = np.linalg.eigvalsh(pseudo_inertia(values))
        if not eigenvalues[0] > SMALLEST_MARGIN * max(eigenvalues[-1], 0.0):
            return False
    return True


def consistent(mean: np.ndarray, information: np.ndarray, bodies: int, positive: np.ndarray) -> np.ndarray:
    """The most probable physically consistent parameters, (P,).

    Minimises ½ (θ − mean)ᵀ information (θ − mean) under J(θ) ≻ 0 for the pseudo-inertia of every body, by the margin of
    `feasible`, and θ ≥ 0 for the `positive` ones, by Newton steps on a logarithmic barrier (Boyd and Vandenberghe, "Convex
    Optimization", chapter 11; the constraint is the linear matrix inequality of Wensing, Kim and Slotine, IEEE RA-L 2018).
    The result exceeds the minimum by at most `LAST_BARRIER` times four for each body and `LAST_OF_POSITIVE` for each positive
    parameter.

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
        first = max(FIRST_BARRIER, cost(point) / bodies)
        last = LAST_OF_POSITIVE if len(positive) else LAST_BARRIER
        found, whole = _descended(point, mean, information, bodies, positive, _barriers(first, last))
        if feasible(found[: inertials.size].reshape(bodies, PER_LINK)):
            possible.append(found)
            if whole:
                break
    return min(possible, key=cost)


def _start(
    mean: np.ndarray,
    information: np.ndarray,
    bodies: int,
    positive: np.ndarray,
    inside: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """A strictly feasible point (P,), well inside: Newton steps of the barrier problem are slow from the boundary."""
    point = mean.copy()
    for body in range(bodies):
        rows = slice(body * PER_LINK, (body + 1) * PER_LINK)
        point[rows] = inertial_parameters(inside(pseudo_inertia(mean[rows])))
    least = 1e-3 / np.sqrt(np.diagonal(information)) + 1e-12
    point[positive] = np.maximum(point[positive], least[positive])
    return point


def _raised(pseudo: np.ndarray) -> np.ndarray:
    """A pseudo-inertia (4, 4) with its eigenvalues raised to at least a share of the largest."""
    values, vectors = np.linalg.eigh(pseudo)
    values = np.maximum(values, RAISED * max(values[-1], RAISED))
    return np.asarray(vectors * values @ vectors.T)


def _barriers(first: float, last: float) -> Iterator[tuple[float, float]]:
    """Decreasing weights of the bodies' and the positive parameters' barriers, from `first` to `last`.

    The first ones balance the pull of the data, so that no Newton step ends at the first boundary it meets.
    """
    barrier = first
    while barrier > LAST_BARRIER / SHRINKING**0.5:
        yield barrier, barrier
        barrier *= SHRINKING
    barrier = LAST_BARRIER
    while barrier > last / SHARPER**0.5:
        yield LAST_BARRIER, barrier
        barrier *= SHARPER
    yield LAST_BARRIER, last


def _descended(
    point: np.ndarray,
    mean: np.ndarray,
    information: np.ndarray,
    bodies: int,
    positive: np.ndarray,
    barriers: Iterator[tuple[float, float]],
) -> tuple[np.ndarray, bool]:
    """Newton steps for one barrier weight after another: the end point, (P,), and whether the last weight was reached.

    Rounding may carry the steps over the boundary: then it is the end point of the barrier before.
    """
    reached = point
    for barrier in barriers:
        for _ in range(NEWTON_STEPS):
            try:
                step, decrement = _newton(point, mean, information, bodies, positive, barrier)
                point = point + _largest(point, step, bodies, positive) * step
            except LinAlgError:
                return reached, False
            if decrement < 1e-3 * min(barrier):
                break
        reached = point
    return reached, True


def _newton(
    point: np.ndarray,
    mean: np.ndarray,
    information: np.ndarray,
    bodies: int,
    positive: np.ndarray,
    barrier: tuple[float, float],
) -> tuple[np.ndarray, float]:
    """Newton step (P,) of the barrier problem, and half its squared decrement.

    Computed in coordinates in which the Hessian of the barrier is the identity, so that close to the boundary its rounding
    errors do not swamp the information on the other parameters.
    """
    of_bodies, of_positive = barrier
    gradient, hessian = information @ (point - mean), information.copy()
    axes = []
    for body in range(bodies):
        rows = slice(body * PER_LINK, (body + 1) * PER_LINK)
        # log det(L (1 + X) Lᵀ) has gradient tr X and Hessian −1 in the coordinates of X
        own = _OUTSIDE @ tangent_basis(np.linalg.cholesky(pseudo_inertia(_INSIDE @ point[rows])))
        hessian[rows] = own.T @ hessian[rows]
        hessian[:, rows] = hessian[:, rows] @ own
        gradient[rows] = own.T @ gradient[rows] - of_bodies * _TRACE
        axes.append((rows, own))
    hessian[positive] *= point[positive, None]
    hessian[:, positive] *= point[positive]
    gradient[positive] = gradient[positive] * point[positive] - of_positive
    held = np.zeros(len(point))
    held[: bodies * PER_LINK], held[positive] = of_bodies, of_positive
    np.einsum("ii->i", hessian)[:] += held
    size = 1.0 / np.sqrt(np.diagonal(hessian))
    factor = cho_factor(hessian * np.outer(size, size), lower=True, check_finite=False)
    step = -size * cho_solve(factor, size * gradient, check_finite=False)
    decrement = -0.5 * float(gradient @ step)
    for rows, own in axes:
        step[rows] = own @ step[rows]
    step[positive] *= point[positive]
    return step, decrement


def _largest(point: np.ndarray, step: np.ndarray, bodies: int, positive: np.ndarray) -> float:
    """Step length: 1 if the full step stays inside, otherwise most of the way to the boundary."""
    reach = 1.0
    for body in range(bodies):
        rows = slice(body * PER_LINK, (body + 1) * PER_LINK)
        inverse = np.linalg.inv(np.linalg.cholesky(pseudo_inertia(_INSIDE @ point[rows])))
        change = np.linalg.eigvalsh(inverse @ pseudo_inertia(_INSIDE @ step[rows]) @ inverse.T)[0]
        if change < 0.0:
            reach = min(reach, -0.9 / change)
    falling = step[positive] < 0.0
    if falling.any():
        reach = min(reach, float(np.min(-0.9 * point[positive][falling] / step[positive][falling])))
    return reach
