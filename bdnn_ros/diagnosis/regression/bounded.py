"""Least squares and evidence with bounded coefficients."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import lsq_linear

EXACT = 1e-12
"""Tolerance of the bounds."""
ROUNDING = 1e-12
"""Relative rounding error assumed of a matrix diagonal."""
MOST_SETS = 10
"""Most active sets that are tried before the general solver is used."""


def outside(coefficients: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Whether coefficients (..., P) leave their bounds (P,), (...) bool."""
    return np.asarray(((coefficients < low - EXACT) | (coefficients > high + EXACT)).any(axis=-1))


def firm(a: np.ndarray) -> np.ndarray:
    """Matrices (..., k, k) with diagonals raised by possible rounding errors.

    Where data determine some combination of columns far better than others, the prior of the others is lost in rounding.
    """
    return np.asarray(a * (1.0 + ROUNDING * np.eye(a.shape[-1])))


def factored(a: np.ndarray) -> np.ndarray:
    """Lower Cholesky factors of matrices (..., k, k) that are positive-definite up to rounding."""
    try:
        return np.asarray(np.linalg.cholesky(a))
    except LinAlgError:
        return np.asarray(np.linalg.cholesky(firm(a)))


def explained(gram: np.ndarray, moment: np.ndarray, precision: np.ndarray, power: float) -> float:
    """Log likelihood of the best unbounded coefficients, up to a constant; infinite where columns are too collinear.

    Args:
        gram, moment: of P columns, (P, P) and (P,).
        precision: of the coefficients' prior, (P,).
        power: sum of the target's squares.
    """
    try:
        factor = cho_factor(gram + np.diag(precision), lower=True)
    except LinAlgError:
        return np.inf
    return float(0.5 * (moment @ cho_solve(factor, moment) - power))


def raised(a: np.ndarray, prior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information matrices (c, k, k) made no smaller than the prior precisions (c, k) they include, and log determinants (c,).

    Rounding makes them smaller where columns are nearly collinear with others: a small difference of large numbers.
    """
    sign, size = np.linalg.slogdet(a)
    wrong = (sign <= 0.0) | (np.diagonal(a, axis1=1, axis2=2) < prior).any(axis=1)
    if not wrong.any():
        return a, size
    unit = np.sqrt(prior[wrong])
    scale = unit[:, :, None] * unit[:, None, :]
    squares, directions = np.linalg.eigh(a[wrong] / scale)
    squares = np.maximum(squares, np.maximum(1.0, ROUNDING * squares[:, -1:]))
    result = a.copy()
    result[wrong] = scale * ((directions * squares[:, None, :]) @ directions.transpose(0, 2, 1))
    size[wrong] = np.linalg.slogdet(result[wrong])[1]
    return result, size


def solved(a: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solutions (..., k) of systems (..., k, k) that are regular up to rounding, and log determinants."""
    try:
        found = _solutions(a, right)
    except LinAlgError:
        a = firm(a)
        found = _solutions(a, right)
    return found, np.linalg.slogdet(a)[1]


def held(factor: np.ndarray, moment: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Minimum of ½ x'Ax - m'x inside bounds, with A's lower Cholesky factor.

    Coefficients before the first bounded one are free, so that the factor's last rows hold the reduced problem of the rest.
    """
    target = solve_triangular(factor, moment, lower=True)
    first = int(np.argmax(np.isfinite(low) | np.isfinite(high)))
    root = np.tril(factor[first:, first:]).T
    held = _inside(root[None], target[None, first:], low[None, first:], high[None, first:])[0]
    free = target[:first] - factor[first:, :first].T @ held
    return np.concatenate([solve_triangular(factor[:first, :first].T, free), held])


def _inside(root: np.ndarray, target: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Minima of |root x - target|² of c systems inside bounds, (c, k), with normalised columns.

    Args:
        root, target: (c, r, k), (c, r).
        low, high: (c, k).
    """
    size = np.linalg.norm(root, axis=1)
    root, bounds = root / size[:, None, :], (low * size, high * size)
    turned = root.transpose(0, 2, 1)
    found, ended = _active_sets(turned @ root, _times(turned, target), *bounds)
    for i in np.flatnonzero(~ended):
        found[i] = lsq_linear(root[i], target[i], (bounds[0][i], bounds[1][i]), method="bvls").x
    return np.clip(found / size, low, high)


def _held_in_few(a: np.ndarray, moment: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """As `held` for c small systems (c, k, k) in which rounding may have made A indefinite, (c, k)."""
    size = np.sqrt(np.diagonal(a, axis1=1, axis2=2))
    squares, directions = np.linalg.eigh(a / (size[:, :, None] * size[:, None, :]))
    roots = np.sqrt(np.maximum(squares, ROUNDING * squares[:, -1:]))
    turned = directions.transpose(0, 2, 1)
    target = _times(turned, moment / size) / roots
    return _inside(roots[:, :, None] * turned * size[:, None, :], target, low, high)


def _active_sets(
    a: np.ndarray, moment: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Minima of ½ x'Ax - m'x inside bounds, (c, k), by primal-dual active sets, and where these converged, (c,) bool.

    Converged when no free coefficient leaves its bounds and the gradient pushes each held one against its bound (Hintermüller,
    Ito and Kunisch, SIAM J. Optim. 13(3), 2002).
    """
    best = _solutions(a, moment)
    at_low, at_high = best < low, best > high
    still = np.arange(len(best))
    for _ in range(MOST_SETS):
        free = ~(at_low | at_high)
        held = np.where(at_low, low, np.where(at_high, high, 0.0))
        loose = np.where(free[:, :, None] & free[:, None, :], a, np.eye(a.shape[-1]))
        now = _solutions(loose, np.where(free, moment - _times(a, held), held))
        pull = moment - _times(a, now)
        now_low = (free & (now < low)) | (at_low & (pull < 0.0))
        now_high = (free & (now > high)) | (at_high & (pull > 0.0))
        moved = ((now_low != at_low) | (now_high != at_high)).any(axis=1)
        best[still] = now
        still, at_low, at_high = still[moved], now_low[moved], now_high[moved]
        if not len(still):
            break
        a, moment, low, high = (values[moved] for values in (a, moment, low, high))
    ended = np.ones(len(best), bool)
    ended[still] = False
    return best, ended


def _times(a: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Products (c, k) of matrices (c, l, k) with vectors."""
    return np.asarray((a @ x[..., None])[..., 0])


def _solutions(a: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions (c, k) of systems (c, k, k)."""
    return np.asarray(np.linalg.solve(a, right[..., None])[..., 0])


def pieces(block: np.ndarray) -> list[slice]:
    """Rows of each block, given the block of each row, (R,) int, ascending from 0."""
    edges = np.searchsorted(block, np.arange(block[-1] + 2)).tolist()
    return [slice(a, b) for a, b in pairwise(edges)]


def by_block(
    white: np.ndarray, target: np.ndarray, block: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gram matrices (B, P, P), moments (B, P) and powers (B,) of each block, from rows (R, n, P) and target (R, n)."""
    grams, moments, powers = [], [], []
    for rows in pieces(block):
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
    """Half the squared error on each of B blocks, predicted by a bounded fit to all others, (B,).

    Args:
        grams, moments, powers: of each block's columns (B, P, P), with its target (B, P), and of the target (B,).
        precision, low, high: prior precisions and bounds of the coefficients, (P,).
    """
    factors, others = factored(_of_others(grams) + np.diag(precision)), moments.sum(axis=0) - moments
    best = np.array([cho_solve((factor, True), other) for factor, other in zip(factors, others, strict=True)])
    for b in np.flatnonzero(outside(best, low, high)):
        best[b] = held(factors[b], others[b], low, high)
    squared = np.einsum("bi,bij,bj->b", best, grams, best, optimize=True)
    return np.asarray(0.5 * (powers - 2.0 * np.sum(best * moments, axis=1) + squared))


def _of_others(each: np.ndarray) -> np.ndarray:
    """Sums of all matrices but each, (B, P, P), from running sums: subtracting each from the total would cancel digits."""
    before, after = np.cumsum(each, axis=0), np.cumsum(each[::-1], axis=0)[::-1]
    result = np.zeros_like(each)
    result[1:] += before[:-1]
    result[:-1] += after[1:]
    return result


def mean_evidence(each: np.ndarray) -> np.ndarray:
    """Log of the mean evidence of m equally likely kinds, from the log evidence of each, (m, ...)."""
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
        schur: information of the columns with the rest projected out, prior included, (c, k, k).
        left: their moments with the residual of the rest, (c, k).
        prior: precisions of the coefficients, (c, k).
        kinds: equally likely prior precisions, relative to `prior`, (m, k); coefficients are those of the likeliest.
    """
    if kinds is not None and len(kinds) > 1:
        known = prior * kinds[:, None]
        information = schur + (known - prior)[..., None] * np.eye(prior.shape[1])
        alike = (
            np.broadcast_to(values, known.shape).reshape(-1, prior.shape[1])
            for values in (left, known, low, high)
        )
        each, best = gains_of(information.reshape(-1, *schur.shape[1:]), *alike)
        gains, found = each.reshape(known.shape[:2]), best.reshape(known.shape)
        return mean_evidence(gains), found[gains.argmax(axis=0), np.arange(len(left))]
    if left.shape[1] == 1:
        schur = np.maximum(schur, prior[..., None])
        best, size = np.clip(left / schur[..., 0], low, high), np.log(schur[:, 0, 0])
    else:
        schur, size = raised(schur, prior)
        best = _solutions(schur, left)
        beyond = np.flatnonzero(outside(best, low, high))
        if len(beyond):
            ends = (np.broadcast_to(end, best.shape)[beyond] for end in (low, high))
            best[beyond] = _held_in_few(schur[beyond], left[beyond], *ends)
    explained = np.sum(best * left, axis=1) - 0.5 * np.einsum("ck,ckl,cl->c", best, schur, best)
    volume = 0.5 * np.sum(np.log(prior), axis=1) - 0.5 * size
    return explained + volume, best
