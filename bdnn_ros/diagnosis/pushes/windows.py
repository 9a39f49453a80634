"""When something pushed: the time window in which a constant wrench explains most."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from bdnn_ros.diagnosis.recorded.joining import owners, without_pauses
from bdnn_ros.diagnosis.regression.bounded import solved
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.effects.environment import SHORTEST, Push

COARSE = 0.5
"""Spacing of the window edges tried first [s]."""
LONGEST_SHARE = 0.9
"""A push over a larger share of a recording cannot be told from a constant cause."""


def best_window(pool: Pool, fit: Fit, term: Term) -> Term:
    """A push with the window that adds most evidence to a fit."""
    equations, where = pool.equations, dict(term.shape)
    time = equations.rows.time
    sums = _Sums.of(pool, fit, term)
    step = max(round(COARSE / max(float(np.median(np.diff(time))), 1e-6)), 1)
    marks = np.unique([*range(0, len(time), step), len(time)])
    begun = equations.motion.signals.begun
    clock = without_pauses(time, begun)
    start, end = sums.best(marks, marks, clock)
    near = [
        np.unique(np.clip(np.arange(mark - step, mark + step + 1), 0, len(time))) for mark in (start, end)
    ]
    start, end = sums.best(near[0], near[1], clock)
    owner, over = owners(time, begun), min(end, len(time) - 1)
    if owner[over] != owner[over - 1]:  # it is seen up to a recording's last row, not to the next one's first
        over -= 1
    return term.shaped({**where, "start": float(time[start]), "end": float(time[over])})


@dataclass(frozen=True)
class _Sums:
    """Running sums over rows, which give the gain of any window.

    Attributes:
        grams: of a wrench's k columns, (R + 1, k, k).
        cross: their products with the fit's columns, (R + 1, k, P).
        factor: lower Cholesky factor of the precision of the fit's coefficients, (P, P).
        moments: their products with what the fit leaves, (R + 1, k).
        prior: precision of their coefficients, (k,).
    """

    grams: np.ndarray
    cross: np.ndarray
    factor: np.ndarray
    moments: np.ndarray
    prior: np.ndarray

    @classmethod
    def of(cls, pool: Pool, fit: Fit, term: Term) -> _Sums:
        """Sums for a push that acts all the time."""
        effect, motion = term.effect, pool.equations.motion
        assert isinstance(effect, Push)
        columns = pool.equations.columns.pushed(
            term, np.ones(len(motion.time)), effect.mixing(dict(term.shape))
        )
        joints = np.flatnonzero(np.any(columns, axis=(0, 2)))
        white = pool.equations.whitening.of(columns[:, joints], pool.noise, joints)
        known, left = pool.known(fit, joints)
        return cls(
            _running(np.einsum("rjk,rjl->rkl", white, white)),
            _running(np.swapaxes(white, 1, 2) @ known),
            fit.factor,
            _running(np.einsum("rjk,rj->rk", white, left)),
            pool.equations.spread(term, columns) ** -2.0,
        )

    def best(self, starts: np.ndarray, ends: np.ndarray, time: np.ndarray) -> tuple[int, int]:
        """Rows (start, end) of the window of most evidence, with the fit's other terms projected out.

        Args:
            time: of the rows, on a clock that stands still between recordings, (R,) [s].
        """
        a, b = (grid.ravel() for grid in np.meshgrid(starts, ends, indexing="ij"))
        length = time[np.minimum(b, len(time) - 1)] - time[np.minimum(a, len(time) - 1)]
        allowed = (length >= SHORTEST) & (length <= LONGEST_SHARE * (time[-1] - time[0]))
        if not allowed.any():
            return int(starts[0]), int(ends[-1])
        a, b = a[allowed], b[allowed]
        inner = self.grams[b] - self.grams[a] + np.diag(self.prior) - self._seen_between(a, b)
        moment = self.moments[b] - self.moments[a]
        coefficients, volume = solved(inner, moment)
        best = int(np.argmax(0.5 * np.einsum("wk,wk->w", moment, coefficients) - 0.5 * volume))
        return int(a[best]), int(b[best])

    def _seen_between(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Part of the windows' Gram matrices that the fit's columns explain, (W, k, k), for row pairs (W,)."""
        marks, at = np.unique(np.concatenate([a, b]), return_inverse=True)
        start, end = at[: len(a)], at[len(a) :]
        count, size = len(marks), self.cross.shape[1]
        # in units in which the fit's columns are independent
        tall = solve_triangular(self.factor, self.cross[marks].reshape(count * size, -1).T, lower=True).T
        of = np.ascontiguousarray((tall @ tall.T).reshape(count, size, count, size).swapaxes(1, 2))
        return np.asarray(of[end, end] + of[start, start] - of[start, end] - of[end, start])


def _running(values: np.ndarray) -> np.ndarray:
    """Sums of the first 0, 1, 2 ... rows."""
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
