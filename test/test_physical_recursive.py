"""Bayesian least squares: against batch least squares, and its own noise."""

import numpy as np
import pytest

from bdnn_ros.errors import RecordingError
from bdnn_ros.physical.linear import inverse, solve
from bdnn_ros.physical.parameters import Prior
from bdnn_ros.physical.recursive import FEWEST_BLOCKS, MOST_BLOCKS, Recursion
from bdnn_ros.physical.sensing import SensorNoise
from bdnn_ros.physical.statistics import Statistics, summed
from bdnn_ros.physical.structure import Layout

INDEX = np.array([[0, 1, 2], [0, 3, 4]])
TRUTH = np.array([1.0, -2.0, 0.5, 3.0, 0.1])
LAYOUT = Layout(
    columns=(np.arange(3), np.arange(3)),
    parameters=tuple(INDEX),
    deviation=np.empty(0),
    base=5,
    lead=5,
    setup=np.empty(0, int),
    positive=np.empty(0, int),
    motors=(),
    weights=(slice(5, 5), slice(5, 5)),
    straight=(np.empty((0, 3)), np.empty((0, 3))),
)


def problem(seed=0, rows=400, correlation=0.0):
    """Two joints with three coefficients each, the first of which they share."""
    generator = np.random.default_rng(seed)
    columns = np.cumsum(generator.normal(size=(rows, 2, 3)), axis=0) * 0.1
    columns -= columns.mean(axis=0)
    noise = generator.normal(size=(rows, 2))
    for k in range(1, rows):
        noise[k] = correlation * noise[k - 1] + np.sqrt(1 - correlation**2) * noise[k]
    noise *= np.array([0.1, 1.0])
    return columns, np.einsum("njk,jk->nj", columns, TRUTH[INDEX]) + noise


def recursion(spread=100.0, mean=None):
    mean = np.zeros(5) if mean is None else mean
    return Recursion(Prior(mean, spread**2 * np.eye(5), np.ones(2)))


def test_it_equals_weighted_least_squares_under_a_wide_prior():
    columns, effort = problem()
    sums = recursion(spread=1e5)
    for k in range(0, 400, 10):
        sums.update(columns[k : k + 10], effort[k : k + 10])
    sums.noise, sums.correlation = np.array([0.1, 1.0]), np.ones(2)
    mean = sums.solve(LAYOUT, iterations=0).mean
    full = np.zeros((400, 2, 5))
    for joint in range(2):
        full[:, joint, INDEX[joint]] = columns[:, joint] / sums.noise[joint]
    expected = np.linalg.lstsq(full.reshape(-1, 5), (effort / sums.noise).ravel(), rcond=None)[0]
    np.testing.assert_allclose(mean, expected, rtol=1e-6)


def test_with_no_data_worth_naming_the_prior_stays():
    sums = recursion(spread=1e-6, mean=TRUTH)
    sums.update(np.ones((5, 2, 3)), np.full((5, 2), 50.0))
    np.testing.assert_allclose(sums.solve(LAYOUT).mean, TRUTH, atol=1e-6)
    with pytest.raises(RecordingError, match="No motion"):
        recursion().solve(LAYOUT)


def test_the_noise_of_each_joint_is_found():
    columns, effort = problem(rows=4000)
    sums = recursion()
    for k in range(0, 4000, 100):
        sums.update(columns[k : k + 100], effort[k : k + 100])
    posterior = sums.solve(LAYOUT, 10)
    np.testing.assert_allclose(posterior.noise, [0.1, 1.0], rtol=0.05)
    assert (posterior.correlation < 2.5).all()


def test_correlated_noise_widens_the_intervals():
    columns, effort = problem(rows=4000, correlation=0.9)
    sums = recursion()
    for k in range(0, 4000, 100):
        sums.update(columns[k : k + 100], effort[k : k + 100])
    posterior = sums.solve(LAYOUT, 10)
    assert (posterior.correlation > 4.0).all()
    assert (np.abs(posterior.mean - TRUTH) < 4.0 * posterior.std).all()


def test_a_row_of_half_weight_counts_half():
    columns, effort = problem()
    half = Statistics.of(columns, effort, np.full(effort.shape, 0.5))
    whole = Statistics.of(columns, effort)
    np.testing.assert_allclose(2.0 * half.gram, whole.gram)
    np.testing.assert_allclose(2.0 * half.moment, whole.moment)
    np.testing.assert_allclose(2.0 * half.energy, whole.energy)
    np.testing.assert_allclose(2.0 * half.count, whole.count)


def test_blocks_are_joined_and_nothing_is_lost():
    columns, effort = problem(rows=1000)
    sums = recursion()
    for k in range(1000):
        sums.update(columns[k : k + 1], effort[k : k + 1])
        if k == 0:
            (first,) = sums.blocks
    assert np.shares_memory(first.gram, next(iter(sums.blocks)).gram)  # a stream of days takes no more
    assert MOST_BLOCKS / 2 <= len(sums.blocks) <= MOST_BLOCKS + 1
    *whole, last = [block.count.max() for block in sums.blocks]
    assert len({*whole}) == 1 and last <= whole[0]  # folds of held-out blocks are as long as each other
    kept = summed(list(sums.blocks))
    expected = Statistics.of(columns, effort)
    np.testing.assert_allclose(kept.gram, expected.gram, rtol=1e-9)
    np.testing.assert_allclose(kept.energy, expected.energy, rtol=1e-9)


@pytest.mark.parametrize(("fit", "most"), [(20, 20), (1, 2 * FEWEST_BLOCKS), (1000, MOST_BLOCKS)])
def test_large_blocks_are_fewer_and_nothing_is_lost(fit, most, monkeypatch):
    """Those of 24 joints took 2 GB; enough are left to tell how the residual is correlated."""
    columns, effort = problem(rows=1000)
    expected = Statistics.of(columns, effort)
    monkeypatch.setattr("bdnn_ros.physical.statistics.MOST_BYTES", fit * expected.gram.nbytes)
    sums, counts = recursion(), []
    for k in range(0, 1000, 5):
        sums.update(columns[k : k + 5], effort[k : k + 5])
        counts.append(len(sums.blocks))
    assert max(counts) == most + 1
    assert min(counts[most:]) > most / 2 >= FEWEST_BLOCKS
    np.testing.assert_allclose(summed(list(sums.blocks)).gram, expected.gram, rtol=1e-9)


def test_squared_error_and_score_are_those_of_the_rows():
    columns, effort = problem()
    statistics = Statistics.of(columns, effort)
    chosen = np.array([0, 2])
    for joint in range(2):
        coefficients = np.array([0.7, -0.2])
        residual = effort[:, joint] - columns[:, joint, chosen] @ coefficients
        regression = statistics.of_joint(joint, chosen)
        error = regression.squared_error(coefficients)
        np.testing.assert_allclose(error, (residual**2).sum(), rtol=1e-6)
        score = statistics.score(joint, chosen, coefficients)
        np.testing.assert_allclose(score, columns[:, joint, chosen].T @ residual, rtol=1e-6, atol=1e-8)


def test_what_the_other_joints_say_is_the_posterior_without_one():
    columns, effort = problem()
    sums = recursion()
    sums.update(columns, effort)
    information, vector = sums.without_joint(LAYOUT, 0)
    weight = sums.weights()[1]
    sums_of_joint = sums.total.of_joint(1, np.arange(3))
    full = np.eye(5) / 100.0**2
    full[np.ix_(INDEX[1], INDEX[1])] += weight * sums_of_joint.gram
    right = np.zeros(5)
    right[INDEX[1]] = weight * sums_of_joint.moment
    covariance = np.linalg.inv(full)[:3, :3]
    np.testing.assert_allclose(np.linalg.inv(information), covariance, rtol=1e-6)
    np.testing.assert_allclose(
        np.linalg.solve(information, vector), np.linalg.solve(full, right)[:3], rtol=1e-6, atol=1e-9
    )


def test_what_is_left_out_is_predicted_by_all_else():
    columns, effort = problem()
    sums = recursion()
    parts = [slice(0, 150), slice(150, 400)]
    for rows in parts:
        sums.update(columns[rows], effort[rows])
    folds = [Statistics.of(columns[rows], effort[rows]) for rows in parts]
    errors = np.zeros(2)
    for out, other in (parts, parts[::-1]):
        alone = recursion()
        alone.noise, alone.correlation = sums.noise, sums.correlation
        alone.update(columns[other], effort[other])
        x = alone.solve(LAYOUT, 0).mean[INDEX]
        errors += ((effort[out] - np.einsum("njk,jk->nj", columns[out], x)) ** 2).sum(axis=0)
    np.testing.assert_allclose(sums.left_out(LAYOUT, folds), errors, rtol=1e-6)


def test_badly_scaled_systems_are_solved():
    generator = np.random.default_rng(0)
    root = generator.normal(size=(6, 6)) * 10.0 ** np.arange(-6, 6, 2)
    matrix, x = root.T @ root, generator.normal(size=(6, 2))
    np.testing.assert_allclose(solve(matrix, matrix @ x), x, rtol=1e-4)
    np.testing.assert_allclose(solve(matrix, matrix @ x[:, 0]), x[:, 0], rtol=1e-4)
    np.testing.assert_allclose(inverse(matrix) @ matrix, np.eye(6), atol=1e-3)


def shaken(size, rows=20000, seed=0):
    """The problem with noise of a size on its columns, and a recursion that knows of it."""
    columns, effort = problem(seed, rows)
    noise = size * np.random.default_rng(seed + 1).normal(size=columns.shape)
    sums = recursion()
    known = np.array([size**2 * rows * np.eye(3)] * 2)
    sensors = SensorNoise(np.full(2, 1e-4 * rows), np.full(2, 1e-4 * rows), known, float(rows))
    sums.update(columns + noise, effort, None, sensors)
    return sums


def test_noise_in_the_columns_makes_no_coefficient_smaller():
    size = 0.5 * problem(rows=20000)[0].std()
    sums = shaken(size)
    posterior = sums.solve(LAYOUT, 10)
    error = posterior.mean - TRUTH
    sums.sensors = None
    attenuated = sums.solve(LAYOUT, 0).mean - TRUTH
    assert np.abs(attenuated).max() > 0.2 and np.abs(error).max() < 0.1 * np.abs(attenuated).max()
    assert (np.abs(error) < 3.0 * posterior.std).all()
    # whoever knows of no noise, or hears hardly any, is told the same as ever
    quiet = shaken(1e-4)
    told = quiet.solve(LAYOUT, 10)
    quiet.sensors = None
    plain = quiet.solve(LAYOUT, 0)
    np.testing.assert_allclose(told.mean, plain.mean, atol=0.01 * plain.std.min())
    np.testing.assert_allclose(told.std, plain.std, rtol=1e-3)


@pytest.mark.parametrize("louder", [1.0, 3.0])
def test_columns_of_nothing_but_noise_blow_nothing_up(louder):
    generator = np.random.default_rng(0)
    sums, rows = recursion(), 1000
    known = np.array([louder * rows * np.eye(3)] * 2)
    sensors = SensorNoise(np.full(2, rows), np.full(2, rows), known, float(rows))
    sums.update(generator.normal(size=(rows, 2, 3)), generator.normal(size=(rows, 2)), None, sensors)
    posterior = sums.solve(LAYOUT, 10)
    assert np.linalg.eigvalsh(posterior.information)[0] > 0.0
    assert np.abs(posterior.mean).max() < 1.0
