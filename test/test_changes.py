"""A robot that changes while it moves: payload, push and friction are told apart, nothing is made up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from live_support import motion, real_robot
from scipy.interpolate import CubicSpline

from bdnn_ros.online.changed.changes import Change, Monitor
from bdnn_ros.online.chunks import Chunks
from bdnn_ros.online.serving import nominal
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm6")
REAL = real_robot(ARM)
MOMENT = 10.0
"""When the robot changes [s]; five seconds later it must be named."""
RECORDING = motion(REAL, 15.5, 250.0, noise=0.003)


def carrying(robot: Robot, mass: float, centre: np.ndarray) -> Robot:
    """The robot with a point mass on its last link."""
    inertia = mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    inertials = robot.inertials.copy()
    inertials[-1] += [mass, *(mass * centre), *inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]]
    return robot.with_inertials(inertials)


def told(
    effort: np.ndarray,
    before: Robot = REAL,
    moved: Recording = RECORDING,
    arm: Robot = ARM,
    known: float = 1.0,
) -> list[Change]:
    """What is noticed in a stream with this effort by one who knows the robot as it was, this well."""
    model = nominal(before)
    monitor, model = Monitor(arm), replace(model, covariance=known**2 * model.covariance)
    changes = []
    recording: Recording = replace(moved, effort=effort)
    chunks = Chunks(arm.joints)
    parts = [*chunks.add(recording.time, recording.position, effort), *chunks.end()]
    for chunk in parts:
        assert chunk is not None
        found = monitor.look(*chunk, model)
        if found:
            changes += found
            break  # the model would now be another
    return changes


def switched(robot: Robot) -> np.ndarray:
    """Effort of the one robot until the moment, of the other after it."""
    after = motion(robot, 15.5, 250.0, noise=0.003).effort
    return np.where((RECORDING.time < MOMENT)[:, None], RECORDING.effort, after)


def value(change: Change, name: str) -> float:
    return change.finding["parameters"][name]["value"]


def test_nothing_is_made_up():
    assert told(RECORDING.effort) == []


@pytest.mark.parametrize("mass", [0.5, 2.0])
def test_a_payload_that_is_gripped(mass):
    centre = np.array([0.01, -0.02, 0.09])
    (change,) = told(switched(carrying(REAL, mass, centre)))
    finding = change.finding
    assert (finding["effect"], finding["link"]) == ("payload", ARM.moving_link(ARM.joints[-1]))
    assert value(change, "mass") == pytest.approx(mass, rel=0.05)
    assert [value(change, f"com_{axis}") for axis in "xyz"] == pytest.approx(centre, abs=0.02)
    assert value(change, "start") == pytest.approx(MOMENT, abs=0.5)
    assert change.explanation.end < MOMENT + 5.0
    assert "gripped" in finding["sentence"]


def test_a_payload_that_is_gripped_by_a_robot_found_to_hang_askew():
    """Its description is level: weighed by gravity from above the payload was a push."""
    tilted = REAL.tilted(0.5, -0.4)
    without, loaded = (
        motion(robot, 15.5, 250.0, noise=0.003).require_effort()
        for robot in (tilted, carrying(tilted, 2.0, np.array([0.01, -0.02, 0.09])))
    )
    (change,) = told(np.where((RECORDING.time < MOMENT)[:, None], without, loaded), before=tilted)
    assert change.finding["effect"] == "payload" and value(change, "mass") == pytest.approx(2.0, rel=0.05)


def test_a_payload_that_is_released():
    loaded = carrying(REAL, 1.0, np.array([0.0, 0.0, 0.08]))
    effort = motion(loaded, 15.5, 250.0, noise=0.003).effort
    effort = np.where((RECORDING.time < MOMENT)[:, None], effort, RECORDING.effort)
    (change,) = told(effort, before=loaded)
    assert change.finding["effect"] == "payload" and "released" in change.finding["sentence"]
    assert value(change, "mass") == pytest.approx(1.0, rel=0.05)
    assert value(change, "end") == pytest.approx(MOMENT, abs=0.5)


@pytest.mark.parametrize("late", [0.04, 0.1, 0.16, 0.22])
def test_a_payload_of_two_joints_is_soon_told_from_a_push_whenever_it_is_released(late):
    """A wrench that is another one in every block could stand for it, if the block in which it went spoke against it."""
    arm = Robot.bundled("arm2")
    real = real_robot(arm)
    loaded = carrying(real, 2.4, np.array([0.03, 0.0, 0.08]))
    with_it, without = (motion(robot, 18.0, 250.0, noise=0.003) for robot in (loaded, real))
    effort = np.where((with_it.time < MOMENT + late)[:, None], with_it.effort, without.effort)
    (change,) = told(effort, before=loaded, moved=with_it, arm=arm)
    assert change.finding["effect"] == "payload" and "released" in change.finding["sentence"]
    assert value(change, "mass") == pytest.approx(2.4, rel=0.1)
    assert value(change, "end") == pytest.approx(MOMENT + late, abs=0.3)
    assert change.explanation.end < MOMENT + late + 2.5


def test_a_push_is_no_payload():
    link = ARM.moving_link(ARM.joints[-1])
    force = np.array([25.0, -10.0, 20.0, 0.0, 0.0, 0.0])
    pushed = np.einsum("tij,i->tj", ARM.link_jacobian(RECORDING.position, link), force)
    during = (RECORDING.time > MOMENT + 0.3) & (RECORDING.time < MOMENT + 2.1)
    (change,) = told(RECORDING.effort - during[:, None] * pushed)
    assert (change.finding["effect"], change.finding["link"]) == ("external_wrench", link)
    assert value(change, "start") == pytest.approx(MOMENT + 0.3, abs=0.4)
    assert value(change, "force_x") == pytest.approx(25.0, rel=0.3)
    std = change.finding["parameters"]["force_x"]["std"]
    assert f"with ({value(change, 'force_x'):.1f} ± {std:.1f}, " in change.finding["sentence"]


WORN = REAL.with_joint_parameters(coulomb=3.0 * REAL.coulomb)


def standing(joints: list[int], start: float, end: float) -> Recording:
    """The worn robot's motion, but that some joints rest for a while, each held by any part of its dry friction."""
    time, step = RECORDING.time, RECORDING.time[1] - RECORDING.time[0]
    pace = np.interp(time, [start - 0.4, start, end, end + 0.4], [1.0, 0.0, 0.0, 1.0])
    course = np.cumsum(pace) * step
    position = RECORDING.position.copy()
    position[:, joints] = CubicSpline(time, RECORDING.position[:, joints])(course - course[0])
    velocity = np.gradient(position, step, axis=0)
    effort = WORN.inverse_dynamics(position, velocity, np.gradient(velocity, step, axis=0))
    held = np.zeros(effort.shape)
    held[np.ix_(pace == 0.0, joints)] = 1.0
    noise = np.random.default_rng(5).standard_normal(effort.shape)
    effort = effort + 0.9 * WORN.coulomb * held + 0.003 * np.abs(effort).max(axis=0) * noise
    return replace(RECORDING, position=position, velocity=velocity, effort=effort)


@pytest.mark.parametrize("joints", [[0], [1], [2], [1, 2]])
def test_a_joint_that_sticks_is_not_pushed(joints):
    moved = standing(joints, MOMENT + 0.3, MOMENT + 2.1)
    assert told(moved.effort, before=WORN, moved=moved, known=0.01) == []


def test_a_push_at_a_robot_that_stands_still_is_stronger_than_its_friction():
    link = ARM.moving_link(ARM.joints[-1])
    moved = standing(list(range(ARM.width)), MOMENT, MOMENT + 3.0)
    force = np.array([120.0, -60.0, 100.0, 0.0, 0.0, 0.0])
    pushed = np.einsum("tij,i->tj", ARM.link_jacobian(moved.position, link), force)
    during = (moved.time > MOMENT + 0.6) & (moved.time < MOMENT + 2.4)
    (change,) = told(moved.effort - during[:, None] * pushed, before=WORN, moved=moved, known=0.01)
    assert (change.finding["effect"], change.finding["link"]) == ("external_wrench", link)
    assert value(change, "start") == pytest.approx(MOMENT + 0.6, abs=0.4)
    assert value(change, "end") == pytest.approx(MOMENT + 2.4, abs=0.4)


def test_friction_is_neither():
    joint = 2
    more = REAL.coulomb.copy()
    more[joint] *= 2.5
    (change,) = told(switched(REAL.with_joint_parameters(coulomb=more)))
    assert (change.finding["effect"], change.finding["joint"]) == ("drift", ARM.joints[joint])
    assert value(change, "start_value") == pytest.approx(REAL.coulomb[joint], rel=0.1)
    assert value(change, "end_value") == pytest.approx(more[joint], rel=0.15)


def test_what_is_known_afterwards_is_the_changed_robot():
    loaded = carrying(REAL, 1.5, np.array([0.0, 0.02, 0.1]))
    (change,) = told(switched(loaded))
    mass = change.belief.mean[: ARM.inertials.size].reshape(ARM.inertials.shape)[-1, 0]
    assert mass == pytest.approx(loaded.inertials[-1, 0], rel=0.05)
    assert np.linalg.eigvalsh(change.belief.covariance).min() > 0
