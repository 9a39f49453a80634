"""Noise model of a residual: its colour, its size, and the extra noise of joints that may stick."""

from __future__ import annotations

import numpy as np

from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.noise import ORDER, Noise, rms, slipping, stable

SURE_DOUBT = 1e-3
"""Doubt below which a joint surely moves on."""
LEAST_ROWS = 10 * ORDER
"""Fewest rows for an autoregressive fit."""


def white_noise_of(equations: Equations, residual: np.ndarray, floor: np.ndarray) -> Noise:
    """White noise model of a residual (R, n), each row independent."""
    std = np.array([rms(residual[equations.usable[:, j], j]) for j in range(equations.rows.width)])
    return Noise(np.zeros((equations.rows.width, ORDER)), np.maximum(std, floor))


def noise_of(equations: Equations, residual: np.ndarray, floor: np.ndarray, steady: bool = False) -> Noise:
    """Autoregressive noise model of a residual (R, n), by least squares on its own past (Yule-Walker with usable rows only).

    With `steady`, the trend of every block is removed first.
    """
    if steady:
        residual = without_trends(equations, residual)
    coefficients, full, doubt = (
        np.zeros((equations.rows.width, ORDER)),
        equations.whitening.full(),
        equations.whitening.recent_sticking_doubt(),
    )
    for j in range(equations.rows.width):
        rows = np.flatnonzero(_steady(doubt[:, j], full[:, j]))
        if len(rows) >= LEAST_ROWS:
            y = residual[rows, j]
            x = np.stack([residual[rows - lag, j] for lag in range(1, ORDER + 1)], axis=1)
            ridge = 1e-3 * float(np.sum(y**2)) + 1e-18
            coefficients[j] = stable(np.linalg.solve(x.T @ x + ridge * np.eye(ORDER), x.T @ y))
    white = equations.whitening.of(residual, Noise(coefficients, np.ones(equations.rows.width)))
    std, slip = np.empty(equations.rows.width), np.empty(equations.rows.width)
    for j in range(equations.rows.width):
        moving = _steady(doubt[:, j], equations.usable[:, j])
        rest = equations.usable[:, j] & ~moving
        std[j] = max(rms(white[moving, j]), floor[j])
        slip[j] = slipping(white[rest, j], doubt[rest, j], std[j])
    return Noise(coefficients, std, slip)


def without_trends(equations: Equations, values: np.ndarray) -> np.ndarray:
    """Values (R, n) without the straight line through each block."""
    result = values.astype(float).copy()
    for b in range(equations.rows.blocks):
        rows = np.flatnonzero(equations.rows.block == b)
        if len(rows) > 4:
            slope = np.linspace(-1.0, 1.0, len(rows))
            result[rows] -= values[rows].mean(axis=0)
            result[rows] -= np.outer(slope, slope @ result[rows] / (slope @ slope))
    return result


def _steady(doubt: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Rows (R,) bool in which a joint surely moves on, or the steadiest ones if there are too few."""
    known = np.sort(doubt[rows])
    return rows & (doubt <= max(SURE_DOUBT, known[min(LEAST_ROWS, len(known)) - 1] if len(known) else 0.0))
