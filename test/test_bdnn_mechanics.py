"""Mechanics by closed form and by axiom: a pendulum's energies, skewness, power, passivity."""

from __future__ import annotations

import numpy as np
import pytest
from bdnn_cases import random_field, worn
from test_bdnn_dynamics import prior_core

from bdnn_ros.bdnn import mechanics
from bdnn_ros.bdnn.cores import NetworkCore
from bdnn_ros.bdnn.dynamics import BDNN
from bdnn_ros.effects.registry import Installed, get
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.robot import Robot

PENDULUM = """<robot name="pendulum"><link name="base"/><link name="bob"><inertial><origin xyz="0 0 -0.5"/>
<mass value="2"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/></joint>
</robot>"""


def test_a_pendulums_energies_are_those_of_the_textbook():
    robot = Robot.from_urdf(PENDULUM)
    angle, rate = np.linspace(-3.0, 3.0, 7)[:, None], np.linspace(-2.0, 5.0, 7)[:, None]
    mass, length = 2.0, 0.5
    kinetic = 0.5 * mass * length**2 * rate[:, 0] ** 2
    np.testing.assert_allclose(mechanics.kinetic_energy(robot, angle, rate), kinetic)
    potential = mass * 9.81 * length * (1.0 - np.cos(angle[:, 0]))
    np.testing.assert_allclose(mechanics.potential_energy(robot, angle), potential, atol=1e-9)
    assert mechanics.potential_energy(robot, np.array([1.0]), np.array([1.0])) == pytest.approx(0.0)


def test_christoffel_coriolis_is_pinocchios():
    robot = worn("arm7")
    rng = np.random.default_rng(0)
    q, v = rng.normal(size=(2, 5, 7))
    matrix = mechanics.coriolis_matrix(robot, q, v)
    np.testing.assert_allclose((matrix @ v[..., None])[..., 0], robot.coriolis(q, v), rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize(
    "model",
    [worn("arm6"), BDNN(prior_core(worn("arm2"), 2)), BDNN(NetworkCore(("a", "b", "c"), random_field(3)))],
    ids=["robot", "on prior", "networks"],
)
def test_rate_of_m_less_twice_c_is_skew(model):
    n = len(model.joints)
    q, v = np.random.default_rng(1).normal(size=(2, 6, n))
    rate = np.einsum("...ijk,...k->...ij", mechanics.mass_matrix_derivative(model, q), v)
    skew = rate - 2.0 * mechanics.coriolis_matrix(model, q, v)
    np.testing.assert_allclose(skew, -np.swapaxes(skew, -1, -2), atol=1e-9 * np.abs(rate).max())
    assert np.abs(rate).max() > 1e-3


def test_power_goes_into_energies_and_friction():
    model = BDNN(NetworkCore(("a", "b", "c"), random_field(3)))
    q, v, a = np.random.default_rng(2).normal(size=(3, 8, 3))
    power = mechanics.power_balance(model, q, v, a)
    np.testing.assert_allclose(power["left"], 0.0, atol=1e-8 * np.abs(power["drive"]).max())
    step = 1e-6

    def energy(side: float) -> np.ndarray:
        return mechanics.kinetic_energy(model, q + side * step * v, v + side * step * a)

    np.testing.assert_allclose(power["kinetic"], (energy(1.0) - energy(-1.0)) / (2.0 * step), rtol=1e-5)


def test_the_potential_is_the_robots():
    robot = worn("arm6")
    q = np.random.default_rng(3).normal(size=(4, 6))
    step, velocity = 1e-6, np.ones(6)

    def energy(side: float) -> np.ndarray:
        return mechanics.potential_energy(robot, q + side * step * velocity)

    slope = (energy(1.0) - energy(-1.0)) / (2.0 * step)
    np.testing.assert_allclose(slope, robot.gravity(q) @ velocity, rtol=1e-5, atol=1e-5)


def test_parts_and_friction_add_up():
    robot = worn("arm2")
    q, v, a = np.random.default_rng(4).normal(size=(3, 5, 2))
    parts = mechanics.parts(robot, q, v, a)
    np.testing.assert_allclose(parts.effort, robot.inverse_dynamics(q, v, a))
    np.testing.assert_allclose(mechanics.odd_friction(robot, q, v), robot.friction(q, v), atol=1e-12)


def test_parts_add_up_where_a_load_makes_friction_and_a_sensor_reads_in_another_scale():
    robot = Robot.bundled("arm2")
    effects = (
        Installed(get("load_dependent_friction"), 0, None, {"ratio": 0.3}),
        Installed(get("effort_scale"), 1, None, {"scale": 1.2}),
    )
    model = ExtendedModel(robot, effects, np.zeros(2))
    q, v, a = np.random.default_rng(5).normal(size=(3, 6, 2))
    parts = mechanics.parts(model, q, v, a)
    np.testing.assert_allclose(parts.effort, model.inverse_dynamics(q, v, a))
    power = mechanics.power_balance(model, q, v, a)
    np.testing.assert_allclose(power["left"], 0.0, atol=1e-8 * np.abs(power["drive"]).max())
    # friction of 0.3 of what the first drive gives brakes it; the second's sensor tells a 1.2th
    load = robot.inverse_dynamics(q, v, a)
    way = np.sign(v[:, 0] * load[:, 0])
    load /= np.stack([1.0 - 0.3 * way, np.full(6, 1.2)], axis=1)
    np.testing.assert_allclose(parts.effort, load)


def summary(model: object, n: int) -> mechanics.Consistency:
    return mechanics.consistency(model, np.full(n, -2.0), np.full(n, 2.0), np.full(n, 1.5), poses=60)


def test_a_robot_is_found_sound():
    found = summary(worn("arm7"), 7)
    assert found.sound
    assert found.skewness < 1e-9
    assert found.gravity_curl < 1e-6
    assert found.passive == 1.0
    assert found.created_power == 0.0
    assert found.sound


def test_friction_that_drives_is_found():
    robot = worn("arm2")
    driven = robot.with_joint_parameters(viscous=-robot.viscous, coulomb=-robot.coulomb)
    found = summary(driven, 2)
    assert not found.sound
    assert found.passive == 0.0
    assert found.created_power > 1.0


def test_gravity_without_a_potential_is_found():
    assert summary(BDNN(NetworkCore(("a", "b", "c"), random_field(3))), 3).gravity_curl > 0.01
