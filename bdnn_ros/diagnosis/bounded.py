"""Least squares and evidence where coefficients have bounds."""

from __future__ import annotations

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import cho_solve, solve_triangular
from scipy.optimize import lsq_linear

EXACT = 1e-12
"""Coefficients may leave their bounds by this much."""
ROUNDING = 1e-12
"""Share of a diagonal that rounding may have taken of it."""
MOST_SETS = 10
"""So many sets of held coefficients are tried before the general solver is asked."""


def outside(coefficients: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Whether coefficients (..., P) leave their bounds (P,), (...) bool."""
    return np.asarray(((coefficients < low - EXACT) | (coefficients > high + EXACT)).any(axis=-1))


def firm(a: np.ndarray) -> np.ndarray:
    """Matrices (..., k, k) with diagonals raised by what rounding may have taken.

    Where the data say much of some combination of columns and nothing of others, what is believed of these is lost in the
    rounding of that.
    """
    return np.asarray(a * (1.0 + ROUNDING * np.eye(a.shape[-1])))


def factored(a: np.ndarray) -> np.ndarray:
    """Lower Cholesky factors of matrices (..., k, k) that are positive-definite but for rounding."""
    try:
        return np.asarray(np.linalg.cholesky(a))
    except LinAlgError:
        return np.asarray(np.linalg.cholesky(firm(a)))


def raised(a: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Information matrices (c, k, k) that rounding made less than the prior precisions in them, (c, k), raised to those.

    What columns tell beside others that tell the same is a small difference of large numbers.
    """
    wrong = (np.linalg.slogdet(a)[0] <= 0.0) | (np.diagonal(a, axis1=1, axis2=2) < prior).any(axis=1)
    if not wrong.any():
        return a
    size = np.sqrt(prior[wrong])
    scale = size[:, :, None] * size[:, None, :]
    squares, directions = np.linalg.eigh(a[wrong] / scale)
    squares = np.maximum(squares, np.maximum(1.0, ROUNDING * squares[:, -1:]))
    result = a.copy()
    result[wrong] = scale * ((directions * squares[:, None, :]) @ directions.transpose(0, 2, 1))
    return result


def solved(a: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solutions (..., k) of systems (..., k, k) that are regular but for rounding, and the logarithms of their determinants."""
    try:
        found = np.linalg.solve(a, right[..., None])
    except LinAlgError:
        a = firm(a)
        found = np.linalg.solve(a, right[..., None])
    return found[..., 0], np.linalg.slogdet(a)[1]


def held(factor: np.ndarray, moment: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Minimum of ½ x'Ax - m'x inside bounds, with A's lower Cholesky factor.

    What comes before the first bound is free, so that the factor's last rows hold the problem of the rest by itself.
    """
    target = solve_triangular(factor, moment, lower=True)
    first = int(np.argmax(np.isfinite(low) | np.isfinite(high)))
    held = _inside(np.tril(factor[first:, first:]).T, target[first:], low[first:], high[first:])
    free = target[:first] - factor[first:, :first].T @ held
    return np.concatenate([solve_triangular(factor[:first, :first].T, free), held])


def _inside(root: np.ndarray, target: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Minimum of |root x - target|² inside bounds, with columns brought to one size."""
    size = np.linalg.norm(root, axis=0)
    root, bounds = root / size, (low * size, high * size)
    found = _active_set(root.T @ root, root.T @ target, *bounds)
    if found is None:
        found = lsq_linear(root, target, bounds, method="bvls").x
    return np.clip(found / size, low, high)


def _held_in_few(a: np.ndarray, moment: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The minimum of `held` where rounding may have made A indefinite."""
    size = np.sqrt(np.diag(a))
    squares, directions = np.linalg.eigh(a / np.outer(size, size))
    roots = np.sqrt(np.maximum(squares, ROUNDING * squares[-1]))
    target = directions.T @ (moment / size) / roots
    return _inside(roots[:, None] * directions.T * size, target, low, high)


def _active_set(a: np.ndarray, moment: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray | None:
    """Minimum of ½ x'Ax - m'x inside bounds, by changing at once all that is held wrongly; None where that does not end.

    It ends where nothing leaves its bounds and all that is held there is pushed against them, which is the minimum
    (primal-dual active set; Hintermüller, Ito and Kunisch, SIAM J. Optim. 13(3), 2002).
    """
    best = np.linalg.solve(a, moment)
    at_low, at_high = best < low, best > high
    for _ in range(MOST_SETS):
        best = np.where(at_low, low, np.where(at_high, high, 0.0))
        free = ~(at_low | at_high)
        best[free] = np.linalg.solve(a[np.ix_(free, free)], (moment - a @ best)[free])
        pull = moment - a @ best
        now_low = (free & (best < low)) | (at_low & (pull < 0.0))
        now_high = (free & (best > high)) | (at_high & (pull > 0.0))
        if (now_low == at_low).all() and (now_high == at_high).all():
            return best
        at_low, at_high = now_low, now_high
    return None


def by_block(
    white: np.ndarray, target: np.ndarray, block: np.ndarray, blocks: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gram matrices (B, P, P), moments (B, P) and powers (B,) of each block of rows (R, n, P) and their target (R, n)."""
    grams, moments, powers = [], [], []
    for b in range(blocks):
        rows = block == b
        tall, flat = white[rows].reshape(-1, white.shape[2]), target[rows].ravel()
        grams.append(tall.T @ tall)
        moments.append(tall.T @ flat)
        powers.append(float(flat @ flat))
    return np.array(grams), np.array(moments), np.array(powers)


def held_out_losses(
    grams: np.ndarray,
    moments: np.ndarray,
    powers: np.ndarray,
    precision: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Half the squared error on each of B blocks, fitted to all others inside bounds, (B,).

    Args:
        grams, moments, powers: of each block's columns (B, P, P), with its target (B, P), and of the target (B,).
        precision, low, high: prior precisions and bounds of the coefficients, (P,).
    """
    gram, moment = grams.sum(axis=0) + np.diag(precision), moments.sum(axis=0)
    factors, others = factored(gram - grams), moment - moments
    best = np.array([cho_solve((factor, True), other) for factor, other in zip(factors, others, strict=True)])
    for b in np.flatnonzero(outside(best, low, high)):
        best[b] = held(factors[b], others[b], low, high)
    squared = np.einsum("bi,bij,bj->b", best, grams, best, optimize=True)
    return np.asarray(0.5 * (powers - 2.0 * np.sum(best * moments, axis=1) + squared))


def mean_evidence(each: np.ndarray) -> np.ndarray:
    """Log evidence of what may be of any of m kinds, from that of each, (m, ...)."""
    return np.asarray(np.logaddexp.reduce(each, axis=0) - np.log(len(each)))


def gains_of(
    schur: np.ndarray,
    left: np.ndarray,
    prior: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    kinds: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Evidence gained by each of c blocks of k columns, (c,), and coefficients inside their bounds, (c, k).

    Args:
        schur: what the columns add to the information matrix beside the rest, (c, k, k).
        left: their moments with what the rest leaves, (c, k).
        prior: precisions of the coefficients, (c, k).
        kinds: precisions that are as likely, in units of those, (m, k): the blocks' coefficients are by the likeliest.
    """
    if kinds is not None and len(kinds) > 1:
        each = []
        for kind in kinds:
            known = prior * kind
            information = schur + (known - prior)[:, :, None] * np.eye(prior.shape[1])
            each.append(gains_of(information, left, known, low, high))
        gains, found = (np.array(parts) for parts in zip(*each, strict=True))
        return mean_evidence(gains), found[gains.argmax(axis=0), np.arange(len(left))]
    schur = raised(schur, prior)
    if left.shape[1] == 1:
        best, size = np.clip(left / schur[..., 0], low, high), np.log(schur[:, 0, 0])
    else:
        best, size = solved(schur, left)
        for i in np.flatnonzero(outside(best, low, high)):
            best[i] = _held_in_few(schur[i], left[i], low[i], high[i])
    explained = np.sum(best * left, axis=1) - 0.5 * np.einsum("ck,ckl,cl->c", best, schur, best)
    volume = 0.5 * np.sum(np.log(prior), axis=1) - 0.5 * size
    return explained + volume, best
