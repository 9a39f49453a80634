"""Inertial parameters, pseudo-inertias and the prior at the URDF."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from bdnn_ros.physical.parameters import (
    Parameters,
    Spread,
    of_robot,
    parameter_names,
    prior,
    tangent_basis,
)
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.bodies import feasible_pseudo_inertia, inertial_parameters, pseudo_inertia, thickened


def some_inertial(generator):
    centre = generator.normal(size=3)
    values = generator.uniform(0.5, 2.0, 3)
    turn = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    moment = turn @ np.diag(values) @ turn.T
    inertia = np.trace(moment) * np.eye(3) - moment
    return pin.Inertia(generator.uniform(1.0, 5.0), centre, inertia).toDynamicParameters()


def test_a_pseudo_inertia_is_the_second_moment_of_its_points():
    generator = np.random.default_rng(0)
    masses, points = generator.uniform(0.1, 1.0, 8), generator.normal(size=(8, 3))
    homogeneous = np.concatenate([points, np.ones((8, 1))], axis=1)
    expected = np.einsum("k,ki,kj->ij", masses, homogeneous, homogeneous)
    body = pin.Inertia.Zero()
    for mass, point in zip(masses, points, strict=True):
        body += pin.Inertia(mass, point, np.zeros((3, 3)))
    np.testing.assert_allclose(pseudo_inertia(body.toDynamicParameters()), expected, atol=1e-12)


def test_pseudo_inertia_goes_both_ways():
    values = some_inertial(np.random.default_rng(1))
    np.testing.assert_allclose(inertial_parameters(pseudo_inertia(values)), values, atol=1e-12)


def test_pseudo_inertias_of_many_bodies_are_those_of_each():
    generator = np.random.default_rng(4)
    many = np.array([[some_inertial(generator) for _ in range(3)] for _ in range(2)])
    each = [[pseudo_inertia(values) for values in row] for row in many]
    np.testing.assert_array_equal(pseudo_inertia(many), each)


@pytest.mark.parametrize(
    "values",
    [
        np.zeros(10),
        np.array([1.0, 0, 0, 0, 0, 0, 0, 0, 0, 0]),
        np.array([1.0, 0, 0, 0, 1.0, 0, 0.1, 0, 0, 0.1]),
        np.array([-1.0, 0.2, 0, 0, 1.0, 0, 1.0, 0, 0, 1.0]),
    ],
    ids=["massless", "point", "violates the triangle inequality", "negative mass"],
)
def test_an_impossible_body_becomes_a_possible_one(values):
    result = feasible_pseudo_inertia(pseudo_inertia(values))
    assert np.linalg.eigvalsh(result)[0] > 0.0
    np.testing.assert_allclose(thickened(values), inertial_parameters(result))


def test_a_possible_body_stays_as_it_is():
    values = some_inertial(np.random.default_rng(2))
    pseudo = pseudo_inertia(values)
    np.testing.assert_array_equal(feasible_pseudo_inertia(pseudo), pseudo)
    assert thickened(values) is values


def test_the_prior_does_not_depend_on_the_links_frame():
    generator = np.random.default_rng(3)
    values = some_inertial(generator)
    frame = np.eye(4)
    frame[:3, :3] = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    frame[:3, 3] = generator.normal(size=3)
    moved = frame @ pseudo_inertia(values) @ frame.T
    change = np.array([inertial_parameters(frame @ pseudo_inertia(unit) @ frame.T) for unit in np.eye(10)]).T
    here, there = (
        basis @ basis.T
        for basis in (
            change @ tangent_basis(np.linalg.cholesky(pseudo_inertia(values))),
            tangent_basis(np.linalg.cholesky(moved)),
        )
    )
    np.testing.assert_allclose(here, there, rtol=1e-9)


def test_the_prior_says_thirty_per_cent_of_a_links_mass():
    robot = Robot.bundled("arm6")
    belief = prior(robot, Spread(inertial=0.3, load=0.0))
    masses = np.arange(robot.width) * PER_LINK
    deviation = np.sqrt(np.diagonal(belief.covariance))[masses]
    np.testing.assert_allclose(deviation, 0.3 * robot.inertials[:, 0], rtol=0.05)
    np.testing.assert_array_equal(belief.mean, of_robot(robot).vector())


def test_a_load_is_believed_whatever_is_believed_of_the_links():
    robot = Robot.bundled("arm6")
    for inertial in (1e-9, 1e-6):
        belief = prior(robot, Spread(inertial=inertial, load=0.1))
        deviation = np.sqrt(np.diagonal(belief.covariance))[: robot.width * PER_LINK : PER_LINK]
        np.testing.assert_allclose(deviation, 0.1 * robot.inertials[:, 0].mean(), rtol=1e-4)


@pytest.mark.parametrize("bare", [[], [1, 4]], ids=["as it is", "with frames that weigh nothing"])
@pytest.mark.parametrize("scale", [1e-6, 1e3])
def test_the_prior_does_not_depend_on_the_unit_of_mass(scale, bare):
    robot = Robot.bundled("arm6")
    inertials = robot.inertials.copy()
    inertials[bare] = 0.0
    usual, scaled = (prior(replace(robot, inertials=inertials * by)) for by in (1.0, scale))
    np.testing.assert_allclose(scaled.effort_scale, scale * usual.effort_scale)
    np.testing.assert_allclose(scaled.mean, scale * usual.mean)
    covariance, deviation = scaled.covariance / scale**2, np.sqrt(np.diagonal(usual.covariance))
    rounding = 1e-9 * np.outer(deviation, deviation)
    np.testing.assert_array_less(np.abs(covariance - usual.covariance), rounding)


def test_a_robot_without_mass_has_a_prior_all_the_same():
    robot = Robot.bundled("arm6")
    belief = prior(replace(robot, inertials=np.zeros_like(robot.inertials)))
    assert (belief.effort_scale > 0.0).all() and (np.diagonal(belief.covariance) > 0.0).all()


def test_parameters_go_through_a_vector():
    vector = np.arange(2 * 14, dtype=float)
    np.testing.assert_array_equal(Parameters.from_vector(vector).vector(), vector)
    names = parameter_names(("a", "b"))
    assert len(names) == len(vector)
    assert names[10] == "b.mass" and names[20] == "a.armature" and names[-1] == "b.offset"


def test_a_step_of_dry_friction_is_as_soft_in_the_column_as_in_the_effort():
    from bdnn_ros.recording import Recording
    from bdnn_ros.signals import prepare

    time = np.arange(0.0, 10.0, 0.002)
    position, velocity = np.sin(3.0 * time)[:, None], 3.0 * np.cos(3.0 * time)[:, None]
    signals = prepare(Recording(time, ("joint",), position, None, np.sign(velocity)))

    def error(column):
        residual = signals.smooth(signals.effort - column)[50:-50]
        return np.sqrt(np.mean(residual**2))

    assert error(signals.sign) < 0.01
    assert error(signals.direction) > 0.03
