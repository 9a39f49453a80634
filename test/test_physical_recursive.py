"""Bayesian least squares: against batch least squares, and its own noise."""

import numpy as np

from bdnn_ros.physical.recursive import MOST_BLOCKS, Recursion, Statistics, solve


def problem(seed=0, rows=400, correlation=0.0):
    """Two joints with three coefficients each, the first of which they share."""
    generator = np.random.default_rng(seed)
    index = np.array([[0, 1, 2], [0, 3, 4]])
    truth = np.array([1.0, -2.0, 0.5, 3.0, 0.1])
    columns = np.cumsum(generator.normal(size=(rows, 2, 3)), axis=0) * 0.1
    columns -= columns.mean(axis=0)
    noise = generator.normal(size=(rows, 2))
    for k in range(1, rows):
        noise[k] = correlation * noise[k - 1] + np.sqrt(1 - correlation**2) * noise[k]
    noise *= np.array([0.1, 1.0])
    effort = np.einsum("njk,jk->nj", columns, truth[index]) + noise
    return index, truth, columns, effort


def recursion(index, size=5, spread=100.0):
    return Recursion(np.zeros(size), spread**2 * np.eye(size), index, np.ones(len(index)))


def test_it_equals_weighted_least_squares_under_a_wide_prior():
    index, _, columns, effort = problem()
    filter_ = recursion(index, spread=1e5)
    for k in range(0, 400, 10):
        filter_.update(columns[k : k + 10], effort[k : k + 10])
    noise = np.array([0.1, 1.0])
    assert filter_.total is not None
    mean = solve(filter_.total, filter_, noise, np.ones(2)).mean
    full = np.zeros((400, 2, 5))
    for joint in range(2):
        full[:, joint, index[joint]] = columns[:, joint] / noise[joint]
    expected = np.linalg.lstsq(full.reshape(-1, 5), (effort / noise).ravel(), rcond=None)[0]
    np.testing.assert_allclose(mean, expected, rtol=1e-6)


def test_with_no_data_worth_naming_the_prior_stays():
    index = np.array([[0, 1]])
    filter_ = Recursion(np.array([1.0, 2.0]), 1e-12 * np.eye(2), index, np.ones(1))
    filter_.update(np.ones((5, 1, 2)), np.full((5, 1), 50.0))
    np.testing.assert_allclose(filter_.solve().mean, [1.0, 2.0], atol=1e-6)


def test_the_noise_of_each_joint_is_found():
    index, _, columns, effort = problem(rows=4000)
    filter_ = recursion(index)
    for k in range(0, 4000, 100):
        filter_.update(columns[k : k + 100], effort[k : k + 100])
    posterior = filter_.solve(10)
    np.testing.assert_allclose(posterior.noise, [0.1, 1.0], rtol=0.05)
    assert (posterior.correlation < 2.5).all()


def test_correlated_noise_widens_the_intervals():
    index, truth, columns, effort = problem(rows=4000, correlation=0.9)
    filter_ = recursion(index)
    for k in range(0, 4000, 100):
        filter_.update(columns[k : k + 100], effort[k : k + 100])
    posterior = filter_.solve(10)
    assert (posterior.correlation > 4.0).all()
    assert (np.abs(posterior.mean - truth) < 4.0 * posterior.std).all()


def test_blocks_are_joined_and_nothing_is_lost():
    index, _, columns, effort = problem(rows=1000)
    filter_ = recursion(index)
    for k in range(1000):
        filter_.update(columns[k : k + 1], effort[k : k + 1])
    assert len(filter_.blocks) <= MOST_BLOCKS
    kept = filter_.blocks[0]
    for block in [*filter_.blocks[1:], *filter_._parts]:
        kept = kept + block
    expected = Statistics.of(columns, effort)
    np.testing.assert_allclose(kept.gram, expected.gram, rtol=1e-9)
    np.testing.assert_allclose(kept.energy, expected.energy, rtol=1e-9)


def test_squared_error_and_score_are_those_of_the_rows():
    index, truth, columns, effort = problem()
    coefficients = truth[index] + 0.1
    residual = effort - np.einsum("njk,jk->nj", columns, coefficients)
    statistics = Statistics.of(columns, effort)
    np.testing.assert_allclose(statistics.squared_error(coefficients), (residual**2).sum(axis=0), rtol=1e-6)
    np.testing.assert_allclose(
        statistics.score(coefficients), np.einsum("njk,nj->jk", columns, residual), rtol=1e-6, atol=1e-8
    )
