"""Parameter uncertainty beyond noise and the scatter of blocks."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from bdnn_ros.diagnosis.pushes.pushes import unseen
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.leads import hold_spread
from bdnn_ros.effects.environment import EDGES

TINY = 1e-300
MOST_SEEN = 0.99
"""Quantile over usable rows that counts as the most of a law they show."""


def widened(pool: Pool, chosen: int, coefficients: np.ndarray, shapes: int) -> np.ndarray:
    """Covariance added to coefficients and shapes, (k, k): of a delay's hold, a push's unseen times, a law's extrapolation.

    No time is known better than to a sample.
    """
    term, count = pool.terms[chosen], len(pool.slots[chosen])
    beyond = np.zeros((count + shapes, count + shapes))
    beyond[0, 0] = hold_spread(pool, chosen) ** 2
    if term.effect.timed:
        told = count + np.arange(shapes)
        spread = unseen(pool, term)
        beyond[told, told] = [spread.get(name, 0.0) ** 2 / 3.0 for name, _ in term.shape]
        moments = told[[name in EDGES for name, _ in term.shape]]
        beyond[moments, moments] += 1.0 / pool.equations.motion.signals.raw_rate**2
    if term.effect.excess is not None and shapes:
        extra = np.arange(count)[term.effect.excess > 0.0]
        beyond[extra, extra] += ((1.0 - _seen(pool, term)) * coefficients)[extra] ** 2 / 3.0
    return beyond


def _seen(pool: Pool, term: Term) -> np.ndarray:
    """Share of each coefficient's largest effort along the motion that usable rows show, (k,).

    A static friction read off the beginning of its decay is an extrapolation, however precisely that is seen.
    """
    equations = pool.equations
    does = np.abs(term.effect.columns(equations.motion, term.target, dict(term.shape), term.link))
    does = does[:, term.target]
    counted = does[equations.rows.samples][pool.sure[:, term.target]]
    shown = np.quantile(counted, MOST_SEEN, axis=0) if len(counted) else 0.0
    return np.asarray(np.clip(shown / np.maximum(does.max(axis=0), TINY), 0.0, 1.0))


def mirrored(pool: Pool, fit: Fit, term: Term, coefficients: np.ndarray) -> np.ndarray | None:
    """Variance of each angle of a tilted base (k,) by how likely its mirror image is; None for other terms.

    Tilting across the plane in which an arm moves only takes from its weight, to either side alike.
    """
    if term.effect.on != "base":
        return None
    equations, left, result = pool.equations, pool.white_residual(fit), np.zeros(len(coefficients))
    as_found = equations.columns.fresh(term) @ coefficients
    for one, angle in enumerate(coefficients):
        turned = np.where(np.arange(len(coefficients)) == one, -coefficients, coefficients)
        other = term.shaped(term.effect.relinearised(turned, dict(term.shape)))
        moved = left + equations.whitening.of(as_found - equations.columns.fresh(other) @ turned, pool.noise)
        result[one] = (2.0 * angle) ** 2 * expit(0.5 * float(np.sum(left**2) - np.sum(moved**2)))
    return result
