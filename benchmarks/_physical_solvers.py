"""Feasible parameters by two ways of asking for them: the barrier that the package has, and log-Cholesky coordinates."""

from __future__ import annotations

import argparse
from typing import Any
from unittest.mock import patch

import numpy as np
from _physical_data import motions, real
from _physical_speed import median_time
from scipy.optimize import least_squares

from bdnn_ros.online.identifier import Identifier
from bdnn_ros.physical import handover
from bdnn_ros.robot import PER_LINK
from bdnn_ros.robot.bodies import feasible_pseudo_inertia, inertial_parameters, pseudo_inertia

PROBLEMS = ((0, 0.3), (1, 0.5), (2, 1.0))
"""Seeds and seconds of motion: after so little, the most probable bodies are none."""
REPEATS = 10
CLOSE = 1e-3
"""Least squares end where a step would lower the cost by no more than this part of it."""
LEAST = 1e-6
"""Friction and rotors start at so much at least; their logarithm is what is searched."""
LOWER = np.tril_indices(4)

Problem = tuple[np.ndarray, np.ndarray, int, np.ndarray]
"""Mean, information, number of bodies, parameters that cannot be negative."""


def solvers(args: argparse.Namespace) -> dict[str, Any]:
    """Processor time and cost of the most probable feasible parameters, seven links with friction and rotors."""
    rows, ways = [], (handover.consistent, log_cholesky)
    print(f"{'seconds':>8} {'barrier':>10} {'log-Cholesky':>13} {'cost of feasibility':>20} {'and':>10}")
    for seed, seconds in PROBLEMS:
        problem = posed(seed, seconds)
        costs = [_cost(solve(*problem), *problem[:2]) for solve in ways]
        times = [median_time(lambda s=solve, p=problem: s(*p), REPEATS) for solve in ways]
        rows.append({"seconds": seconds, "times": times, "costs": costs})
        print(
            f"{seconds:6g} s {1e3 * times[0]:7.0f} ms {1e3 * times[1]:10.0f} ms {costs[0]:15.3f} nats {costs[1]:5.3f} nats"
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
    """The same by least squares over factors of the pseudo-inertias, J = L Lᵀ with exp on L's diagonal.

    Levenberg-Marquardt (MINPACK) with the exact Jacobian; what cannot be negative is searched by its logarithm.
    Source: Rucker and Wensing, IEEE RA-L 7(2), 2022.
    """
    inertial, corner = bodies * PER_LINK, np.arange(4)
    root = np.linalg.cholesky(information).T
    to_parameters = np.stack([inertial_parameters(_unit(*index)) for index in np.ndindex(4, 4)], axis=1)

    def factors(x: np.ndarray) -> np.ndarray:
        found = np.zeros((bodies, 4, 4))
        found[:, LOWER[0], LOWER[1]] = x[:inertial].reshape(bodies, PER_LINK)
        found[:, corner, corner] = np.exp(found[:, corner, corner])
        return found

    def parameters(x: np.ndarray) -> np.ndarray:
        lower, theta = factors(x), x.copy()
        theta[:inertial] = ((lower @ lower.transpose(0, 2, 1)).reshape(bodies, 16) @ to_parameters.T).ravel()
        theta[positive] = np.exp(x[positive])
        return theta

    def slopes(x: np.ndarray) -> np.ndarray:
        lower, slope = factors(x), np.eye(len(x))
        for k, (row, column) in enumerate(zip(*LOWER, strict=True)):
            step = np.zeros((bodies, 4, 4))
            step[:, row, column] = lower[:, row, column] if row == column else 1.0
            half = step @ lower.transpose(0, 2, 1)
            change = (half + half.transpose(0, 2, 1)).reshape(bodies, 16) @ to_parameters.T
            for body in range(bodies):
                slope[PER_LINK * body : PER_LINK * (body + 1), PER_LINK * body + k] = change[body]
        slope[positive, positive] = np.exp(x[positive])
        return root @ slope

    start = mean.copy()
    start[positive] = np.log(np.maximum(mean[positive], LEAST))
    for body, values in enumerate(mean[:inertial].reshape(bodies, PER_LINK)):
        factor = np.linalg.cholesky(feasible_pseudo_inertia(pseudo_inertia(values)))
        factor[corner, corner] = np.log(factor[corner, corner])
        start[PER_LINK * body : PER_LINK * (body + 1)] = factor[LOWER]
    found = least_squares(
        lambda x: root @ (parameters(x) - mean), start, jac=slopes, method="lm", x_scale="jac", ftol=CLOSE
    )
    return parameters(found.x)


def _unit(row: int, column: int) -> np.ndarray:
    one = np.zeros((4, 4))
    one[row, column] += 0.5
    one[column, row] += 0.5
    return one


def _cost(values: np.ndarray, mean: np.ndarray, information: np.ndarray) -> float:
    """How much less probable than the most probable parameters, possible or not [nats]."""
    return 0.5 * float((values - mean) @ information @ (values - mean))
