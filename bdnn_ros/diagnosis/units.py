"""Whether an effort is in the unit that it should be in."""

from __future__ import annotations

import numpy as np

from bdnn_ros.errors import RecordingError

FURTHEST = 20.0
"""No robot's efforts are so many times what its simulation says, or as small a part of it: they are in another unit."""
CERTAIN = 10.0
"""A joint has a say where so many standard deviations tell how its effort goes with the simulation's."""
LEAST_ROWS = 20


def require_unit(effort: np.ndarray, simulated: np.ndarray, sign: np.ndarray, usable: np.ndarray) -> None:
    """Refuses efforts that are many times what the simulation says on most joints.

    Args:
        effort, simulated: rows (R, n) [N·m].
        sign: direction of motion, (R, n): dry friction must not pass for a factor.
        usable: rows that count, (R, n) bool.

    Raises:
        RecordingError: they are.
    """
    columns = range(effort.shape[1])
    factors = [
        _factor(effort[rows, j], simulated[rows, j], sign[rows, j])
        for j in columns
        for rows in [usable[:, j]]
    ]
    known = [factor for factor in factors if np.isfinite(factor)]
    if len(known) < 0.5 * len(factors) or not known:
        return
    factor = float(np.median(np.abs(known)))
    if not 1.0 / FURTHEST < factor < FURTHEST:
        raise RecordingError(
            f"The efforts are about {factor:.2g} times what the simulation says: they seem to be in another unit.",
            "Let the driver report N*m (of a prismatic joint N), not N*mm, a current or a share of the limit.",
        )


def _factor(effort: np.ndarray, simulated: np.ndarray, sign: np.ndarray) -> float:
    """How many times the simulated effort a joint's own is, beside friction and an offset; NaN where that is not sure."""
    if len(effort) < LEAST_ROWS:
        return np.nan
    columns = np.stack([simulated, sign, np.ones_like(sign)], axis=1)
    gram = columns.T @ columns
    if np.linalg.cond(gram) > 1e12:
        return np.nan
    coefficients = np.linalg.solve(gram, columns.T @ effort)
    left = float(np.mean((effort - columns @ coefficients) ** 2))
    doubt = np.sqrt(left * np.linalg.inv(gram)[0, 0])
    return float(coefficients[0]) if abs(coefficients[0]) > CERTAIN * doubt else np.nan
