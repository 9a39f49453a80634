"""Feasible inertias: what comes out could exist, and is the nearest that could."""

import numpy as np
import pytest

from bdnn_ros.physical.consistency import consistent, feasible
from bdnn_ros.physical.parameters import of_robot, prior, pseudo_inertia
from bdnn_ros.robot import PER_LINK, Robot


@pytest.fixture(scope="module")
def belief():
    robot = Robot.bundled("arm7")
    start = prior(robot)
    return robot, start.mean, np.linalg.inv(start.covariance)


def positive(width):
    return width * PER_LINK + np.arange(3 * width)


def test_possible_parameters_stay_as_they_are(belief):
    robot, mean, information = belief
    np.testing.assert_array_equal(consistent(mean, information, robot.width, positive(robot.width)), mean)


def test_impossible_parameters_become_possible_and_m_positive_definite(belief):
    robot, mean, information = belief
    generator = np.random.default_rng(0)
    for _ in range(5):
        wrong = mean + generator.normal(size=len(mean)) * 3.0 / np.sqrt(np.diagonal(information))
        assert not feasible(wrong[: robot.width * PER_LINK].reshape(-1, PER_LINK))
        right = consistent(wrong, information, robot.width, positive(robot.width))
        inertials = right[: robot.width * PER_LINK].reshape(-1, PER_LINK)
        assert all(np.linalg.eigvalsh(pseudo_inertia(values))[0] > 0.0 for values in inertials)
        assert (right[positive(robot.width)] >= 0.0).all()
        M = robot.with_inertials(inertials).mass_matrix(generator.uniform(-3.0, 3.0, (50, robot.width)))
        assert np.linalg.eigvalsh(M).min() > 0.0


def test_it_is_the_nearest_in_the_beliefs_own_distance(belief):
    """Of a mass that came out negative alone, the answer is known: a hair above zero."""
    _, _, _ = belief
    robot = Robot.bundled("arm2")
    mean = of_robot(robot).vector()
    mean[robot.width * PER_LINK] = -1.0  # armature of the first joint
    information = np.eye(len(mean)) * 1e4
    right = consistent(mean, information, robot.width, positive(robot.width))
    assert 0.0 < right[robot.width * PER_LINK] < 1e-4
    others = np.delete(np.arange(len(mean)), [robot.width * PER_LINK, *positive(robot.width)])
    np.testing.assert_allclose(right[others], mean[others], atol=0.02)


def test_a_belief_far_outside_does_not_end_at_the_edge_it_first_meets(belief):
    """However sure a belief is, the answer is near its nearest possible parameters."""
    robot, mean, information = belief
    generator = np.random.default_rng(1)
    for _ in range(3):
        wrong = mean + generator.normal(size=len(mean)) / np.sqrt(np.diagonal(information))
        costs = []
        for surer in (1.0, 1e2, 1e4):
            right = consistent(wrong, surer * information, robot.width, positive(robot.width))
            assert feasible(right[: robot.width * PER_LINK].reshape(-1, PER_LINK))
            costs.append(0.5 * (right - wrong) @ information @ (right - wrong))
        assert costs[1] < 1.1 * costs[0] and costs[2] < 1.5 * costs[0], costs
