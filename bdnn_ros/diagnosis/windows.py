"""When something pushed: the time window in which a constant wrench explains most."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import solve_triangular

from bdnn_ros.diagnosis.bounded import solved
from bdnn_ros.diagnosis.evidence import Pool
from bdnn_ros.diagnosis.fit import Fit
from bdnn_ros.diagnosis.joining import owners, without_pauses
from bdnn_ros.diagnosis.term import Term
from bdnn_ros.effects.environment import SHORTEST, Push

COARSE = 0.5
"""Spacing of the first window edges [s]."""
LONGEST_SHARE = 0.9
"""A push over nearly all of a recording cannot be told from a constant cause."""


def best_window(pool: Pool, fit: Fit, term: Term) -> Term:
    """A term of a wrench with the window that adds most evidence to a fit."""
    equations, where = pool.equations, dict(term.shape)
    time = equations.motion.time[equations.rows]
    told = _Told.of(pool, fit, term)
    step = max(round(COARSE / max(float(np.median(np.diff(time))), 1e-6)), 1)
    marks = np.unique([*range(0, len(time), step), len(time)])
    begun = equations.motion.signals.begun
    clock = without_pauses(time, begun)
    start, end = told.best(marks, marks, clock)
    near = [
        np.unique(np.clip(np.arange(mark - step, mark + step + 1), 0, len(time))) for mark in (start, end)
    ]
    start, end = told.best(near[0], near[1], clock)
    owner, over = owners(time, begun), min(end, len(time) - 1)
    if owner[over] != owner[over - 1]:  # it is seen up to a recording's last row, not to the next one's first
        over -= 1
    return term.shaped({**where, "start": float(time[start]), "end": float(time[over])})


@dataclass(frozen=True)
class _Told:
    """What rows tell of a wrench that acts all the while, beside a fit: of their sums any window's gain follows.

    Attributes:
        white: a wrench's k columns, of the J joints that feel it, (R, J, k).
        known: the fit's columns, (R, J, P).
        left: what the fit leaves, (R, J).
        factor: lower Cholesky factor of the precision of the fit's coefficients, (P, P).
        prior: precision of the wrench's coefficients, (k,).
    """

    white: np.ndarray
    known: np.ndarray
    left: np.ndarray
    factor: np.ndarray
    prior: np.ndarray

    @classmethod
    def of(cls, pool: Pool, fit: Fit, term: Term) -> _Told:
        """Of a push, whenever it acts."""
        equations, effect = pool.equations, term.effect
        assert isinstance(effect, Push)
        always = np.ones(len(equations.motion.time))
        columns = equations.pushed(term, always, effect.mixing(dict(term.shape)))
        joints = np.flatnonzero(np.any(columns, axis=(0, 2)))
        white = equations.whiten(columns[:, joints], pool.noise, joints)
        prior = equations.spread(term, columns) ** -2.0
        return cls(white, *pool.known(fit, joints), fit.factor, prior)

    def best(self, starts: np.ndarray, ends: np.ndarray, time: np.ndarray) -> tuple[int, int]:
        """Rows (start, end) of the window of most evidence, correlation with the fit's other terms counted.

        Args:
            time: of the rows, on a clock that stands still between recordings, (R,) [s].
        """
        a, b = (grid.ravel() for grid in np.meshgrid(starts, ends, indexing="ij"))
        length = time[np.minimum(b, len(time) - 1)] - time[np.minimum(a, len(time) - 1)]
        allowed = (length >= SHORTEST) & (length <= LONGEST_SHARE * (time[-1] - time[0]))
        if not allowed.any():
            return int(starts[0]), int(ends[-1])
        a, b = a[allowed], b[allowed]
        marks, at = np.unique(np.concatenate([a, b]), return_inverse=True)
        start, end = at[: len(a)], at[len(a) :]
        grams, cross, moments = self._until(marks)
        inner = grams[end] - grams[start] + np.diag(self.prior) - self._seen_between(cross, start, end)
        moment = moments[end] - moments[start]
        coefficients, volume = solved(inner, moment)
        best = int(np.argmax(0.5 * np.einsum("wk,wk->w", moment, coefficients) - 0.5 * volume))
        return int(a[best]), int(b[best])

    def _until(self, marks: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sums from the first of some rows (M,), which increase, up to each: of the wrench's columns' products with each other,
        (M, k, k), with the fit's columns, (M, k, P), and with what the fit leaves, (M, k)."""
        size, sums = self.white.shape[2], []
        for first, last in pairwise(marks.tolist()):
            tall = self.white[first:last].reshape(-1, size).T
            known, left = self.known[first:last], self.left[first:last].ravel()
            sums.append((tall @ tall.T, tall @ known.reshape(-1, known.shape[2]), tall @ left))
        grams, cross, moments = (_running(np.array(each)) for each in zip(*sums, strict=True))
        return grams, cross, moments

    def _seen_between(self, cross: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Gram matrices of what the fit's columns see from mark to mark, (W, k, k) of marks (W,): of few many windows.

        Args:
            cross: products of the wrench's columns with the fit's, summed up to each mark, (M, k, P).
        """
        count, size = cross.shape[:2]
        # in units in which the fit's columns are independent
        tall = solve_triangular(self.factor, cross.reshape(count * size, -1).T, lower=True).T
        of = np.ascontiguousarray((tall @ tall.T).reshape(count, size, count, size).swapaxes(1, 2))
        return np.asarray(of[end, end] + of[start, start] - of[start, end] - of[end, start])


def _running(values: np.ndarray) -> np.ndarray:
    """Sums of the first 0, 1, 2 ... values."""
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
