"""Feasible inertias: what comes out could exist, and is the nearest that could."""

import numpy as np
import pytest

from bdnn_ros.physical.consistency import LAST_BARRIER, consistent, feasible
from bdnn_ros.physical.parameters import of_robot, prior, tangent_basis
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.bodies import feasible_pseudo_inertia, inertial_parameters, pseudo_inertia


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


def test_what_no_motion_told_stays_as_described_where_another_parameter_comes_out_negative(belief):
    """A joint that stood so far had a tenth of all the friction and rotor it might have, and erred as it moved at last."""
    robot, mean, information = belief
    wrong, rows = mean.copy(), positive(robot.width)
    wrong[rows[0]] = -1e-3
    right = consistent(wrong, information, robot.width, rows)
    std = np.sqrt(np.diagonal(np.linalg.inv(information)))
    assert (mean[rows] == 0.0).all() and (right[rows] >= 0.0).all()
    np.testing.assert_array_less(right[rows], 2e-4 * std[rows])


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


def described(generator, kind):
    """A body (PER_LINK,) as a URDF may have it: some have no mass, no width, or more inertia than a body can."""
    mass = {"massless": 0.0, "speck": 1e-6}.get(kind, 10.0 ** generator.uniform(-2.0, 1.3))
    width = 0.05 * np.exp(generator.normal(size=3))
    width[: {"point": 3, "rod": 2, "lamina": 1}.get(kind, 0)] = 0.0
    axes = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    centre = np.append(generator.normal(size=3) * 0.2, 1.0)
    pseudo = mass * np.outer(centre, centre)
    pseudo[:3, :3] += mass * (axes * width**2) @ axes.T
    values = inertial_parameters(pseudo)
    values[9] += (kind == "triangle") * (values[4] + values[6])
    return values


def thickened(values):
    """Bodies that can exist, like this one but for some mass at its centre and some width all round."""
    for share in 10.0 ** np.arange(-9, 1):
        for more in (0.0, *10.0 ** np.arange(-9.0, 0.0)):
            pseudo = pseudo_inertia(values)
            pseudo[3, 3] += more
            if pseudo[3, 3] > 0.0:
                offset = np.outer(pseudo[:3, 3], pseudo[:3, 3]) / pseudo[3, 3]
                size, axes = np.linalg.eigh(pseudo[:3, :3] - offset)
                pseudo[:3, :3] = offset + (axes * np.maximum(size, share * pseudo[3, 3])) @ axes.T
                found = inertial_parameters(pseudo)
                if feasible(found[None]):
                    yield found


@pytest.mark.parametrize("seed", range(8, 20))
def test_no_body_that_cannot_be_moves_the_others_further_than_its_own_thickening_would(seed):
    """However thin the bodies are, and however sure the belief: up to what the last barrier takes by theory."""
    generator = np.random.default_rng(seed)
    count = int(generator.integers(1, 5))
    kinds = ["massless", "speck", "point", "rod", "lamina", "triangle", "usual"]
    bodies = np.array([described(generator, kind) for kind in generator.choice(kinds, count)])
    spread = np.zeros((bodies.size, bodies.size))
    for k, values in enumerate(bodies):
        rows = slice(k * PER_LINK, (k + 1) * PER_LINK)
        factor = np.linalg.cholesky(feasible_pseudo_inertia(pseudo_inertia(values)))
        spread[rows, rows] = 0.3 * tangent_basis(factor)
    back = np.linalg.inv(spread)
    seen = 10.0 ** generator.uniform(0.0, 2.0) * generator.normal(size=(8, bodies.size)) @ back
    information = back.T @ back + seen.T @ seen
    mean = bodies.ravel() + generator.choice([0.0, 0.1, 1.0]) * spread @ generator.normal(size=bodies.size)

    def cost(point):
        return 0.5 * (point - mean) @ information @ (point - mean)

    near = mean.copy()
    for k, values in enumerate(mean.reshape(-1, PER_LINK)):
        if not feasible(values[None]):
            others = [
                np.concatenate([near[: k * PER_LINK], one, near[(k + 1) * PER_LINK :]])
                for one in thickened(values)
            ]
            near = min(others, key=cost)
    found = consistent(mean, information, count, np.array([], dtype=int))
    assert feasible(found.reshape(-1, PER_LINK))
    assert cost(found) <= cost(near) + LAST_BARRIER * 4 * count
