"""When something pushed: the time window in which a constant wrench explains most."""

from __future__ import annotations

import numpy as np

from bdnn_ros.diagnosis.equations import Term
from bdnn_ros.diagnosis.evidence import Fit, Pool

COARSE = 0.5
"""Spacing of the first window edges [s]."""
SHORTEST = 0.3
LONGEST_SHARE = 0.9
"""A push over nearly all of a recording cannot be told from a constant cause."""


def best_window(pool: Pool, fit: Fit, term: Term) -> Term:
    """A term of a wrench with the window that adds most evidence to a fit (correlation with other terms left out)."""
    equations = pool.equations
    time = equations.motion.time[equations.rows]
    always = term.shaped({"start": float(time[0]) - 1.0, "end": float(time[-1]) + 1.0})
    columns = equations.columns(always)
    white = equations.whiten(columns, pool.noise)
    index = pool.columns_of(fit.terms)
    left = pool.white_target - pool.white[:, :, index] @ fit.coefficients
    precision = 1.0 / equations.spread(term, columns) ** 2
    grams = _running(np.einsum("rjk,rjl->rkl", white, white))
    moments = _running(np.einsum("rjk,rj->rk", white, left))
    step = max(round(COARSE / max(float(np.median(np.diff(time))), 1e-6)), 1)
    marks = np.unique([*range(0, len(time), step), len(time)])
    start, end = _best(marks, marks, time, grams, moments, precision)
    near = [
        np.unique(np.clip(np.arange(mark - step, mark + step + 1), 0, len(time))) for mark in (start, end)
    ]
    start, end = _best(near[0], near[1], time, grams, moments, precision)
    return term.shaped({"start": float(time[start]), "end": float(time[min(end, len(time) - 1)])})


def _running(values: np.ndarray) -> np.ndarray:
    """Sums of the first 0, 1, 2 ... rows."""
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])


def _best(
    starts: np.ndarray,
    ends: np.ndarray,
    time: np.ndarray,
    grams: np.ndarray,
    moments: np.ndarray,
    precision: np.ndarray,
) -> tuple[int, int]:
    """Rows (start, end) of the window of most evidence."""
    a, b = (grid.ravel() for grid in np.meshgrid(starts, ends, indexing="ij"))
    length = time[np.minimum(b, len(time) - 1)] - time[np.minimum(a, len(time) - 1)]
    allowed = (length >= SHORTEST) & (length <= LONGEST_SHARE * (time[-1] - time[0]))
    if not allowed.any():
        return int(starts[0]), int(ends[-1])
    a, b = a[allowed], b[allowed]
    inner = grams[b] - grams[a] + np.diag(precision)
    moment = moments[b] - moments[a]
    explained = 0.5 * np.einsum("wk,wk->w", moment, np.linalg.solve(inner, moment[..., None])[..., 0])
    evidence = explained - 0.5 * np.linalg.slogdet(inner)[1]
    best = int(np.argmax(evidence))
    return int(a[best]), int(b[best])
