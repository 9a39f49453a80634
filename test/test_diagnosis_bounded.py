"""Least squares inside bounds against the general solver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from bdnn_ros.diagnosis.regression.bounded import factored, gains_of, held, held_out_losses, raised, solved


def _drawn(seed: int, size: int, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Columns (rows, size) of very unlike sizes, a target, and bounds on all but the first two."""
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((rows, size)) * 10.0 ** rng.uniform(-3.0, 3.0, size)
    low = np.where(rng.random(size) < 0.6, 0.0, -np.inf)
    high = np.where(rng.random(size) < 0.2, 1e-3, np.inf)
    low[:2], high[:2] = -np.inf, np.inf
    low[2] = 0.0
    return columns, rng.standard_normal(rows), low, high


@pytest.mark.parametrize("seed", range(30))
def test_a_held_minimum_is_the_general_solvers(seed: int) -> None:
    columns, target, low, high = _drawn(seed, 12, 30)
    found = held(np.linalg.cholesky(columns.T @ columns), columns.T @ target, low, high)
    wanted = lsq_linear(columns, target, (low, high), method="bvls", tol=1e-14).x
    assert ((found >= low) & (found <= high)).all()
    losses = [float(np.sum((columns @ x - target) ** 2)) for x in (found, wanted)]
    assert losses[0] == pytest.approx(losses[1], rel=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_each_block_is_predicted_by_a_fit_to_the_others(seed: int) -> None:
    columns, target, low, high = _drawn(seed, 8, 60)
    blocks = np.arange(60) % 3
    parts = [(columns[blocks == b], target[blocks == b]) for b in range(3)]
    grams, moments = np.array([c.T @ c for c, _ in parts]), np.array([c.T @ t for c, t in parts])
    powers = np.array([t @ t for _, t in parts])
    prior = 1e-6 * np.diag(grams.sum(axis=0))
    losses = held_out_losses(grams, moments, powers, prior, low, high)
    for b, (own, wanted) in enumerate(parts):
        tall = np.concatenate([columns[blocks != b], np.diag(np.sqrt(prior))])
        flat = np.concatenate([target[blocks != b], np.zeros(8)])
        best = lsq_linear(tall, flat, (low, high), method="bvls", tol=1e-14).x
        assert losses[b] == pytest.approx(0.5 * np.sum((own @ best - wanted) ** 2), rel=1e-6)


def _one_direction(size: int) -> np.ndarray:
    """A matrix that says so much of one direction that what is believed of the others is lost in rounding."""
    return 1e20 * np.ones((size, size)) + 1e-3 * np.eye(size)


def test_what_is_singular_by_rounding_alone_is_solved() -> None:
    a, right = np.array([_one_direction(6), np.eye(6)]), np.ones((2, 6))
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.solve(a, right[..., None])
    found, volume = solved(a, right)
    np.testing.assert_allclose(a @ found[..., None], right[..., None], rtol=1e-6)
    assert np.isfinite(volume).all() and volume[1] == pytest.approx(0.0, abs=1e-9)


def test_what_is_indefinite_by_rounding_alone_has_a_factor() -> None:
    a = np.array([_one_direction(6), np.eye(6)])
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(a)
    factor = factored(a)
    np.testing.assert_allclose(factor @ np.swapaxes(factor, 1, 2), a, rtol=1e-9)


def test_what_rounding_makes_singular_gains_no_more_than_it_explains() -> None:
    """The determinant of such a matrix is nothing, which a gain must not be divided by."""
    a, ends = _one_direction(6)[None], np.full((1, 6), np.inf)
    gains, _ = gains_of(a, np.ones((1, 6)), np.full((1, 6), 1e-3), -ends, ends)
    assert gains[0] < 0.0


@pytest.mark.parametrize("seed", range(30))
def test_a_blocks_coefficients_leave_bounds_that_no_longer_hold_them(seed: int) -> None:
    """What is beyond its bounds at first may belong inside them once others are held at theirs."""
    rng = np.random.default_rng(seed)
    columns, target = rng.standard_normal((12, 4)) @ rng.standard_normal((4, 4)), rng.standard_normal(12)
    low, high = np.zeros((1, 4)), np.full((1, 4), 0.3)
    _, best = gains_of((columns.T @ columns)[None], (columns.T @ target)[None], np.ones((1, 4)), low, high)
    wanted = lsq_linear(columns, target, (0.0, 0.3), method="bvls", tol=1e-14).x
    losses = [float(np.sum((columns @ x - target) ** 2)) for x in (best[0], wanted)]
    assert losses[0] == pytest.approx(losses[1], rel=1e-9)


@pytest.mark.parametrize("lower", [-np.inf, 0.0])
def test_what_others_tell_as_well_gains_nothing_though_rounding_says_less_than_nothing(lower: float) -> None:
    """Of what links tell as well as a payload's inertia little is left but the rounding of both."""
    prior = np.array([[1.0, 1.0, 4.0]])
    schur = np.array([[[-1e-3, 0.0, 0.0], [0.0, -2.0, 1.0], [0.0, 1.0, 1e9]]])
    left = np.array([[1e-3, -1e-3, 1e4]])
    exact, size = raised(schur, prior)
    assert size == pytest.approx(np.linalg.slogdet(exact)[1])
    assert (np.linalg.eigvalsh(exact[0] - np.diag(prior[0])) > -1e-6).all()
    assert np.array_equal(raised(exact, prior)[0], exact)
    gain, best = gains_of(schur, left, prior, np.full((1, 3), lower), np.full((1, 3), np.inf))
    assert np.isfinite(gain).all() and (best >= lower).all()
    assert gain[0] < 0.0


def test_one_column_that_rounding_took_all_from_gains_nothing() -> None:
    ends = np.full((1, 1), -np.inf), np.full((1, 1), np.inf)
    gain, _ = gains_of(np.array([[[-1e-4]]]), np.array([[1e-3]]), np.array([[1.0]]), *ends)
    assert gain[0] == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_what_is_incidental_may_as_well_not_be_there(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns, target, prior = rng.normal(size=(12, 3)), rng.normal(size=12), rng.uniform(0.5, 2.0, 3)
    schur, left, ends = columns.T @ columns + np.diag(prior), columns.T @ target, np.full((1, 3), np.inf)
    kinds = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 1e8]])
    (full,), (free,) = gains_of(schur[None], left[None], prior[None], -ends, ends)
    two = slice(0, 2)
    alone = schur[None, two, two], left[None, two], prior[None, two], -ends[:, two], ends[:, two]
    (least,), (without,) = gains_of(*alone)
    (both,), (best,) = gains_of(schur[None], left[None], prior[None], -ends, ends, kinds)
    assert both == pytest.approx(np.logaddexp(full, least) - np.log(2.0), abs=1e-6)
    wanted = free if full > least else np.append(without, 0.0)
    np.testing.assert_allclose(best, wanted, atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_what_may_be_of_several_sizes_is_as_likely_as_each_of_them_on_average(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns, target, prior = rng.normal(size=(12, 2)), 5.0 * rng.normal(size=12), rng.uniform(5.0, 9.0, 2)
    kinds, ends = np.array([[1.0, 1.0], [1.0 / 9.0, 1.0 / 9.0]]), np.full((1, 2), np.inf)
    gram, left = columns.T @ columns, columns.T @ target

    def one(precision: np.ndarray) -> tuple[float, np.ndarray]:
        gain, best = gains_of((gram + np.diag(precision))[None], left[None], precision[None], -ends, ends)
        return float(gain[0]), best[0]

    (usual, small), (wide, large) = (one(prior * kind) for kind in kinds)
    (both,), (best,) = gains_of((gram + np.diag(prior))[None], left[None], prior[None], -ends, ends, kinds)
    assert both == pytest.approx(np.log((np.exp(usual) + np.exp(wide)) / 2.0))
    np.testing.assert_allclose(best, small if usual > wide else large, rtol=1e-9)


def test_what_one_block_tells_nearly_alone_is_left_to_what_is_believed_without_it() -> None:
    """A joint that hardly moves but in one block: less it, a sum of all blocks is rounding, and no matrix with a factor."""
    rng = np.random.default_rng(0)
    white = rng.normal(size=(4, 50, 3))
    white[0] *= 1e9
    white[1:, :, 2] = 0.0
    grams, moments = np.einsum("brp,brq->bpq", white, white), white.sum(axis=1)
    precision, free = np.full(3, 1e-3), np.full(3, np.inf)
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(grams.sum(axis=0) + np.diag(precision) - grams)
    losses = held_out_losses(grams, moments, np.full(4, 50.0), precision, -free, free)
    without = np.linalg.solve(grams[1:].sum(axis=0) + np.diag(precision), moments[1:].sum(axis=0))
    expected = 0.5 * (50.0 - 2.0 * without @ moments[0] + without @ grams[0] @ without)
    assert losses[0] == pytest.approx(expected, rel=1e-6) and np.isfinite(losses).all()
