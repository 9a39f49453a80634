"""Whether the identified bodies are further from the description than the prior allows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import chdtrc

from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import WIDEST_SPREAD, Spread, prior
from bdnn_ros.physical.remark import Remark
from bdnn_ros.robot import PER_LINK, Robot

SURPRISING = 1e-4
"""Bodies as far off as these are found, if what is believed were right, so seldom at most."""
TOLD = 0.1
"""Directions of the bodies' parameters of which the motion takes away this share of the variance at least are asked."""
ROUNDING = 1e-12


def further_off(robot: Robot, model: PhysicalModel, spread: Spread | None = None) -> Iterator[Remark]:
    """Whether bodies were found further from the description than their prior allows.

    In units of the prior standard deviation, the identified deviation of a parameter has, under the prior, the variance that
    the motion removed; the squares add up to chi-squared (prior predictive check: Box, J. R. Stat. Soc. A 1980).

    Args:
        robot: the simulation's, the prior of the model.
        model: identified with it.
        spread: that it was identified with.
    """
    found, left = _in_units_of_belief(robot, model, spread)
    kept, directions = np.linalg.eigh(left)
    told = 1.0 - kept > TOLD
    squares = (directions.T @ found)[told] ** 2 / (1.0 - kept[told])
    if not told.any() or chdtrc(told.sum(), squares.sum()) > SURPRISING:
        return
    times = float(np.sqrt(squares.mean()))
    wider = min(times * (spread or Spread()).inertial, WIDEST_SPREAD)
    yield Remark(
        "",
        f"The links are some {times:.1f} times as far from the description as is believed of them: "
        "what the motion says little of stays too near to the description, with errors larger than told.",
        f"Mend the description, or pass --spread inertial={wider:.1g} to bdnn identify.",
    )


def _in_units_of_belief(
    robot: Robot, model: PhysicalModel, spread: Spread | None
) -> tuple[np.ndarray, np.ndarray]:
    """Deviation of the bodies from the description, (n·PER_LINK,), and its covariance, in units of the prior."""
    belief, size = prior(robot, spread), robot.width * PER_LINK
    believed = belief.covariance[:size, :size]
    factor = np.linalg.cholesky(believed + ROUNDING * np.diag(np.diagonal(believed)))
    apart = model.parameters.vector()[:size] - belief.mean[:size]
    half = solve_triangular(factor, model.covariance[:size, :size], lower=True)
    return solve_triangular(factor, apart, lower=True), solve_triangular(factor, half.T, lower=True)
