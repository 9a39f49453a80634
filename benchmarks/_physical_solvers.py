"""Feasible parameters by two ways of asking for them: the barrier that the package has, and log-Cholesky coordinates."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

import numpy as np
from _physical_data import motions, real
from scipy.optimize import minimize

from bdnn_ros.online.identifier import Identifier
from bdnn_ros.physical import handover
from bdnn_ros.physical.parameters import feasible_pseudo_inertia, inertial_parameters, pseudo_inertia
from bdnn_ros.robot import PER_LINK

PROBLEMS = ((0, 0.3), (1, 0.5), (2, 1.0))
"""Seeds and seconds of motion: after so little, the most probable bodies are none."""
REPEATS = 5
LONGEST = 5000
"""Iterations that L-BFGS may take."""
LEAST = 1e-6
"""Friction and rotors start at so much at least; their logarithm is what is searched."""
LOWER = np.tril_indices(4)
DIAGONAL = np.flatnonzero(LOWER[0] == LOWER[1])

Problem = tuple[np.ndarray, np.ndarray, int, np.ndarray]
"""Mean, information, number of bodies, parameters that cannot be negative."""


def solvers(args: argparse.Namespace) -> dict[str, Any]:
    """Processor time and cost of the most probable feasible parameters, seven links with friction and rotors."""
    rows = []
    print(f"{'seconds':>8} {'barrier':>10} {'log-Cholesky':>13} {'cost of feasibility':>20} {'and':>10}")
    for seed, seconds in PROBLEMS:
        problem = posed(seed, seconds)
        ours, ours_s = _timed(lambda p=problem: handover.consistent(*p))
        other, other_s = _timed(lambda p=problem: log_cholesky(*p))
        costs = [_cost(values, *problem[:2]) for values in (ours, other)]
        rows.append({"seconds": seconds, "times": [ours_s, other_s], "costs": costs})
        print(
            f"{seconds:6g} s {1e3 * ours_s:7.0f} ms {1e3 * other_s:10.0f} ms {costs[0]:15.3f} nats {costs[1]:5.3f} nats"
        )
    return {"rows": rows}


def posed(seed: int, seconds: float) -> Problem:
    """The belief after some seconds of motion, as it is handed over."""
    one, asked = real(seed, "matched"), list[Problem]()

    def remembered(*problem: Any) -> np.ndarray:
        asked.append(problem)
        return solved(*problem)

    solved = handover.consistent
    with patch.object(handover, "consistent", remembered):
        Identifier(one.nominal).fit(motions(one, seconds, seed))
    return asked[-1]


def log_cholesky(mean: np.ndarray, information: np.ndarray, bodies: int, positive: np.ndarray) -> np.ndarray:
    """The same by L-BFGS with exact gradients over factors of the pseudo-inertias, J = L Lᵀ with exp on L's diagonal.

    Source: Rucker and Wensing, IEEE RA-L 7(2), 2022. What cannot be negative is searched by its logarithm.
    """
    size, inertial = len(LOWER[0]), bodies * PER_LINK
    to_parameters = np.stack([inertial_parameters(_unit(*index)) for index in np.ndindex(4, 4)], axis=1)

    def unfolded(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        factors = np.zeros((bodies, 4, 4))
        factors[:, LOWER[0], LOWER[1]] = x[: bodies * size].reshape(bodies, size)
        corner = np.arange(4)
        factors[:, corner, corner] = np.exp(factors[:, corner, corner])
        theta = np.concatenate([np.zeros(inertial), x[bodies * size :]])
        theta[:inertial] = (
            (factors @ factors.transpose(0, 2, 1)).reshape(bodies, 16) @ to_parameters.T
        ).ravel()
        theta[positive] = np.exp(theta[positive])
        return theta, factors

    def cost(x: np.ndarray) -> tuple[float, np.ndarray]:
        theta, factors = unfolded(x)
        pull = information @ (theta - mean)
        slope = (pull[:inertial].reshape(bodies, PER_LINK) @ to_parameters).reshape(bodies, 4, 4)
        by_factor = _lower((slope + slope.transpose(0, 2, 1)) @ factors)
        by_factor[:, DIAGONAL] *= _lower(factors)[:, DIAGONAL]
        rest = pull.copy()
        rest[positive] *= theta[positive]
        gradient = np.concatenate([by_factor.ravel(), rest[inertial:]])
        return 0.5 * float((theta - mean) @ pull), gradient

    start = mean.copy()
    start[positive] = np.log(np.maximum(mean[positive], LEAST))
    first = []
    for values in mean[:inertial].reshape(bodies, PER_LINK):
        factor = np.linalg.cholesky(feasible_pseudo_inertia(pseudo_inertia(values)))
        factor[np.diag_indices(4)] = np.log(np.diag(factor))
        first.append(factor[LOWER])
    found = minimize(
        cost,
        np.concatenate([*first, start[inertial:]]),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": LONGEST, "maxfun": 2 * LONGEST, "ftol": 1e-12, "gtol": 1e-6, "maxcor": 50},
    )
    return unfolded(found.x)[0]


def _lower(factors: np.ndarray) -> np.ndarray:
    """Entries of the lower triangles (bodies, 4, 4), row by row, (bodies, 10)."""
    return np.asarray(factors[:, LOWER[0], LOWER[1]])


def _unit(row: int, column: int) -> np.ndarray:
    one = np.zeros((4, 4))
    one[row, column] += 0.5
    one[column, row] += 0.5
    return one


def _cost(values: np.ndarray, mean: np.ndarray, information: np.ndarray) -> float:
    """How much less probable than the most probable parameters, possible or not [nats]."""
    return 0.5 * float((values - mean) @ information @ (values - mean))


def _timed(action: Callable[[], np.ndarray]) -> tuple[np.ndarray, float]:
    seconds = []
    for _ in range(REPEATS):
        start = time.process_time()
        values = action()
        seconds.append(time.process_time() - start)
    return values, float(np.median(seconds))
