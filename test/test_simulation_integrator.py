"""The integrator against closed forms: pendulum, energy, dry friction, elastic and loose gears."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipk

from bdnn_ros.effects.plant import Plant
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.integrator import Integrator, held_friction

PERIOD = 2e-3


def moved(
    plant: Plant, start, effort, seconds: float, speed=0.0
) -> tuple[np.ndarray, np.ndarray, Integrator]:
    """Positions and velocities every `PERIOD` from `start` at `speed` under a constant effort, (N, n)."""
    position = np.asarray(start, float)
    held = np.broadcast_to(np.asarray(effort, float), position.shape).copy()
    integrator = Integrator(plant, position, held, PERIOD)
    integrator.state.velocity = np.broadcast_to(np.asarray(speed, float), position.shape).copy()
    track = []
    for k in range(round(seconds / PERIOD)):
        track.append((integrator.state.position.copy(), integrator.state.velocity.copy()))
        integrator.advance(k * PERIOD, [held] * integrator.steps)
    return np.array([p for p, _ in track]), np.array([v for _, v in track]), integrator


@pytest.fixture(scope="module")
def pendulum():
    """The first axis of the 2-axis arm, the second held."""
    return Robot.bundled("arm2", ["arm2_joint1"])


def wheel(inertia: float = 0.5) -> Robot:
    """One joint about a vertical axis: no gravity."""
    return Robot.from_urdf(
        f"""<robot name="wheel"><link name="base"/><link name="disc"><inertial><mass value="1"/>
        <inertia ixx="{inertia}" ixy="0" ixz="0" iyy="{inertia}" iyz="0" izz="{inertia}"/></inertial></link>
        <joint name="axle" type="revolute"><parent link="base"/><child link="disc"/><axis xyz="0 0 1"/>
        <limit lower="-100" upper="100" velocity="50" effort="100"/></joint></robot>"""
    )


@pytest.mark.parametrize("amplitude", [0.01, 1.0, 2.5])
def test_a_pendulums_period_is_the_closed_forms(pendulum, amplitude):
    stiffness = pendulum.gravity(np.array([np.pi / 2]))[0]
    inertia = pendulum.mass_matrix(np.zeros(1))[0, 0]
    expected = 4.0 * np.sqrt(inertia / stiffness) * ellipk(np.sin(amplitude / 2.0) ** 2)
    position, _, _ = moved(Plant(pendulum), [amplitude], 0.0, 3.2 * expected)
    falling = np.flatnonzero((position[:-1, 0] > 0) & (position[1:, 0] <= 0))
    crossing = [PERIOD * (k + position[k, 0] / (position[k, 0] - position[k + 1, 0])) for k in falling]
    assert np.diff(crossing) == pytest.approx(expected, rel=2e-5)


@pytest.mark.parametrize("name", ["arm2", "arm6", "arm7"])
def test_an_undriven_frictionless_robot_keeps_its_energy(name):
    robot = Robot.bundled(name)
    start = np.linspace(0.3, -1.2, robot.width)
    position, velocity, _ = moved(Plant(robot), start, 0.0, 1.2, speed=0.5)
    model, order = robot.pinocchio_model()
    data, back = model.createData(), np.argsort(order)
    energy = np.array(
        [
            pin.computeKineticEnergy(model, data, q[back], v[back])
            + pin.computePotentialEnergy(model, data, q[back])
            for q, v in zip(position, velocity, strict=True)
        ]
    )
    kinetic = energy - [pin.computePotentialEnergy(model, data, q[back]) for q in position]
    assert kinetic.max() > 3.0 * kinetic[0]
    assert np.ptp(energy) < 1e-3 * kinetic.max()


def test_errors_fall_with_the_square_of_the_step(pendulum, monkeypatch):
    def end(step: float) -> float:
        monkeypatch.setattr("bdnn_ros.simulation.integrator.LONGEST_STEP", step)
        position, _, _ = moved(Plant(pendulum), [2.0], 1.0, 1.0)
        return float(position[-1, 0])

    exact = end(2e-5)
    coarse, fine = abs(end(1e-3) - exact), abs(end(5e-4) - exact)
    assert coarse / fine == pytest.approx(4.0, rel=0.2)


def test_friction_that_can_hold_a_joint_holds_it_still():
    plant = Plant(wheel().with_joint_parameters(coulomb=np.array([1.0])))
    position, velocity, _ = moved(plant, [0.2], 0.99, 1.0)
    assert (position == 0.2).all()
    assert (velocity == 0.0).all()


def test_friction_slows_a_joint_evenly_and_then_it_stays():
    inertia, friction, speed = 0.5, 1.0, 2.0
    plant = Plant(wheel(inertia).with_joint_parameters(coulomb=np.array([friction])))
    position, velocity, _ = moved(plant, [0.0], 0.0, 1.5, speed)
    stop = speed * inertia / friction
    time = PERIOD * np.arange(len(position))
    sliding = time < stop - PERIOD
    assert velocity[sliding, 0] == pytest.approx(speed - friction / inertia * time[sliding], abs=1e-9)
    assert (velocity[time > stop + PERIOD] == 0.0).all()
    assert position[-1, 0] == pytest.approx(0.5 * speed**2 * inertia / friction, rel=2e-3)


def test_friction_of_the_second_joint_holds_while_the_first_moves():
    robot = Robot.bundled("arm2").with_joint_parameters(coulomb=np.array([0.0, 3.0]))
    position, _, _ = moved(Plant(robot), [1.0, 0.5], 0.0, 1.0)
    assert np.ptp(position[:, 0]) > 0.5
    assert (position[:, 1] == 0.5).all()


@given(st.integers(0, 10_000), st.integers(1, 6))
@settings(max_examples=200, deadline=None)
def test_friction_at_rest_solves_its_complementarity_problem(seed, size):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((size, size))
    coupling = root @ root.T + 0.05 * np.eye(size)
    wanted = 5.0 * rng.standard_normal(size)
    lower, upper = -rng.uniform(0.0, 2.0, size), rng.uniform(0.0, 2.0, size)
    friction, held = held_friction(coupling, wanted, lower, upper)
    rate = wanted - coupling @ friction
    small = 1e-9 * (1.0 + np.abs(coupling).max())
    assert (friction >= lower - 1e-9).all()
    assert (friction <= upper + 1e-9).all()
    assert np.abs(rate[held]).max(initial=0.0) < small
    assert (rate[~held] * np.sign(friction[~held] - 0.5 * (lower + upper)[~held]) >= -small).all()


def test_asymmetric_friction_holds_less_on_its_weak_side():
    plant = Plant(wheel())
    parse_spec("asymmetric_friction@axle:positive=1,negative=0.2", wheel()).install(plant)
    forward, _, _ = moved(plant, [0.0], 0.5, 0.3)
    backward, _, _ = moved(plant, [0.0], -0.5, 0.3)
    assert (forward == 0.0).all()
    assert backward[-1, 0] == pytest.approx(-0.5 * 0.3 / 0.5 * 0.3**2, rel=0.02)


def test_viscous_friction_decays_exponentially():
    plant = Plant(wheel(0.5))
    parse_spec("viscous_friction@axle:viscous=2", wheel()).install(plant)
    _, velocity, _ = moved(plant, [0.0], 0.0, 1.0, speed=3.0)
    time = PERIOD * np.arange(len(velocity))
    assert velocity[:, 0] == pytest.approx(3.0 * np.exp(-4.0 * time), abs=3e-6)


def test_a_joint_in_thick_oil_reaches_its_speed_and_does_not_ring():
    """Its speed settles a hundred times within a step: what is seen is the speed at which the friction takes the effort."""
    plant = Plant(wheel(1e-4))
    parse_spec("viscous_friction@axle:viscous=10", wheel()).install(plant)
    position, velocity, _ = moved(plant, [0.0], 5.0, 0.5)
    assert velocity[1:, 0] == pytest.approx(0.5, rel=1e-9)
    assert np.diff(position[1:, 0]) == pytest.approx(0.5 * PERIOD, rel=1e-9)


def test_a_bristle_holds_like_a_spring_before_it_slides():
    plant = Plant(wheel(0.5))
    parse_spec("hysteresis@axle:force=1,breakaway=0.05", wheel()).install(plant)
    position, _, _ = moved(plant, [0.0], 0.01, 3.0)
    expected = 0.01 / (1.0 / 0.05)
    rate = np.sqrt(1.0 / 0.05 / 0.5)
    assert position.mean() == pytest.approx(expected, rel=0.1)
    assert np.flatnonzero(position[:, 0] > 1.9 * expected)[0] * PERIOD == pytest.approx(
        np.pi / rate, rel=0.15
    )


def test_an_elastic_gear_bends_by_load_over_stiffness(pendulum):
    plant = Plant(pendulum)
    parse_spec("joint_elasticity@arm2_joint1:stiffness=500", pendulum).install(plant)
    held = pendulum.gravity(np.array([0.7]))
    position, _, integrator = moved(plant, [0.7], held, 1.0)
    seen, speed = integrator.state.position.copy(), integrator.state.velocity.copy()
    integrator.motors.seen(seen, speed)
    assert position[-1, 0] == pytest.approx(0.7, abs=1e-6)
    assert seen - integrator.state.position == pytest.approx(held / 500.0, rel=1e-3)


@pytest.mark.parametrize(
    "spec", ["joint_spring@axle:stiffness=40", "external_wrench@axle:torque=-4,start=0,end=9"]
)
def test_what_acts_on_the_link_bends_its_gear(spec):
    plant = Plant(wheel(0.5), duration=9.0)
    plant.robot = plant.robot.with_joint_parameters(viscous=np.array([5.0]))
    parse_spec("joint_elasticity@axle:stiffness=500", plant.robot).install(plant)
    parse_spec(spec, plant.robot).install(plant)
    _, _, integrator = moved(plant, [0.1], 4.0, 3.0)  # 4 N·m hold it there
    seen, speed = integrator.state.position.copy(), integrator.state.velocity.copy()
    integrator.motors.seen(seen, speed)
    assert seen - integrator.state.position == pytest.approx(4.0 / 500.0, rel=1e-3)


def test_an_elastic_gear_rings_at_its_frequency():
    robot = wheel(0.5).with_joint_parameters(armature=np.array([0.25]))
    plant = Plant(robot)
    parse_spec("joint_elasticity@axle:stiffness=60", robot).install(plant)
    integrator = Integrator(plant, np.zeros(1), np.zeros(1), PERIOD)
    integrator.motors.motors[0].damping = 0.0
    integrator.motors.motors[0].position = 0.1
    twist = []
    for k in range(1500):
        twist.append(integrator.motors.motors[0].position - integrator.state.position[0])
        integrator.advance(k * PERIOD, [np.zeros(1)] * integrator.steps)
    spectrum = np.abs(np.fft.rfft(twist * np.hanning(len(twist)), 2**16))
    found = np.fft.rfftfreq(2**16, PERIOD)[np.argmax(spectrum)]
    assert found == pytest.approx(np.sqrt(60.0 * (1.0 / 0.5 + 1.0 / 0.25)) / (2.0 * np.pi), rel=0.01)


def test_a_loose_gear_lets_the_motor_cross_its_gap():
    robot = wheel(0.5).with_joint_parameters(armature=np.array([0.05]))
    plant = Plant(robot)
    parse_spec("backlash@axle:gap=0.02", robot).install(plant)
    integrator = Integrator(plant, np.zeros(1), np.array([1.0]), PERIOD)
    before = integrator.motors.motors[0].position
    for k in range(500):
        integrator.advance(k * PERIOD, [np.array([-1.0])] * integrator.steps)
    after = integrator.motors.motors[0].position - integrator.state.position[0]
    assert before == pytest.approx(0.01, rel=0.3)
    assert after == pytest.approx(-0.01, rel=0.3)
    momentum = 0.05 * integrator.motors.motors[0].velocity + 0.5 * integrator.state.velocity[0]
    assert momentum == pytest.approx(-1.0, rel=1e-3)


def test_joints_in_any_order_move_alike():
    robot = Robot.bundled("arm7")
    names = robot.joints
    order = [3, 0, 6, 1, 5, 2, 4]
    mixed = Robot.bundled("arm7", [names[k] for k in order])
    start = np.linspace(0.3, -1.2, 7)
    friction = np.linspace(0.1, 0.7, 7)
    plain, _, _ = moved(Plant(robot.with_joint_parameters(coulomb=friction)), start, 0.0, 0.5, 0.3)
    other, _, _ = moved(
        Plant(mixed.with_joint_parameters(coulomb=friction[order])), start[order], 0.0, 0.5, 0.3
    )
    assert other == pytest.approx(plain[:, order], abs=1e-9)
