"""Descriptions that would suit their motion with joints turned, zeroed, exchanged or mounted otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.checks.alternatives import Motion, misread
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare
from bdnn_ros.simulation.scenario import Scenario


@pytest.fixture(scope="module")
def arm() -> Robot:
    return Robot.bundled("arm6")


@pytest.fixture(scope="module")
def recording(arm: Robot) -> Recording:
    """Of a worn robot whose links are 5 % off."""
    return Scenario(arm, seed=6, duration=12.0, worn=True, wrong=0.05).run()[0].recording


def told(recording: Recording, robot: Robot) -> str:
    """What is read otherwise; empty where nothing is."""
    remarks = list(misread(prepare(recording), robot))
    return remarks[0].problem if remarks else ""


def turned(recording: Recording, joint: int) -> Recording:
    sign = np.where(np.arange(recording.width) == joint, -1.0, 1.0)
    return replace(
        recording,
        position=sign * recording.position,
        velocity=None,
        effort=sign * recording.require_effort(),
    )


def further(recording: Recording, joint: int, degrees: float) -> Recording:
    offset = np.where(np.arange(recording.width) == joint, np.deg2rad(degrees), 0.0)
    return replace(recording, position=recording.position + offset)


def exchanged(recording: Recording, one: int, other: int) -> Recording:
    names = list(recording.joints)
    names[one], names[other] = names[other], names[one]
    return replace(recording, joints=tuple(names)).select(recording.joints)


def mounted(recording: Recording, robot: Robot, roll: float, pitch: float) -> Recording:
    """The robot on a base that its description has level."""
    q = recording.position
    real = robot.tilted(np.deg2rad(roll), np.deg2rad(pitch)).gravity(q)
    return replace(recording, effort=recording.require_effort() - robot.gravity(q) + real)


def test_a_description_that_fits_is_left_alone(arm, recording):
    assert told(recording, arm) == ""


def test_a_joint_that_turns_the_other_way(arm, recording):
    assert "arm6_joint2 turning the other way" in told(turned(recording, 1), arm)


@pytest.mark.parametrize(
    "degrees, words", [(90.0, "90 deg back"), (-90.0, "90 deg further"), (180.0, "180 deg")]
)
def test_another_zero(arm, recording, degrees, words):
    assert f"arm6_joint3 {words}" in told(further(recording, 2, degrees), arm)


@pytest.mark.parametrize("joint", [2, 3, 4], ids=["parallel", "parallel, further out", "crossing"])
def test_two_things_at_once(arm, recording, joint):
    problem = told(further(turned(recording, 1), joint, 90.0), arm)
    assert "arm6_joint2 turning the other way" in problem and f"{arm.joints[joint]} 90 deg back" in problem


def test_exchanged_joints(arm, recording):
    assert "arm6_joint2 recorded as arm6_joint3, arm6_joint3 recorded as arm6_joint2" in told(
        exchanged(recording, 1, 2), arm
    )


@pytest.mark.parametrize(
    "roll, pitch, words", [(180.0, 0.0, "upside down"), (90.0, 0.0, "roll 90"), (0.0, -90.0, "pitch -90")]
)
def test_a_base_that_is_mounted_otherwise(arm, recording, roll, pitch, words):
    assert words in told(mounted(recording, arm, roll, pitch), arm)


def test_efforts_of_no_robot_are_not_this_robots(arm, recording):
    backwards = replace(recording, effort=recording.require_effort()[::-1])
    assert "explains only" in told(backwards, arm)


def test_readings_that_tie_are_told_together():
    """Turning joint 2 does to all but joint 1, whose angle nothing shows, what half a turn of joint 3 does."""
    robot = Robot.bundled("arm7")
    recording = Scenario(robot, seed=6, duration=12.0, worn=True, wrong=0.05).run()[0].recording
    problem = told(turned(recording, 1), robot)
    assert "arm7_joint2 turning the other way" in problem and " or " in problem
    assert "arm7_joint3 180 deg further" in problem


def test_a_last_link_that_hardly_turns_its_joint_is_no_reason_to_doubt_its_zero(arm):
    """Two millimetres, which hardly a description knows, turns its small moment anywhere."""
    scenario = Scenario(arm, seed=6, duration=12.0, wrong=0.0)
    motion = scenario.run()[0].recording
    described, real = arm.inertials.copy(), arm.inertials.copy()
    described[-1, 1], real[-1, 2] = 2e-3 * arm.inertials[-1, 0], 2e-3 * arm.inertials[-1, 0]
    described, real = arm.with_inertials(described), arm.with_inertials(real)
    signals = prepare(motion)
    effort = real.inverse_dynamics(signals.position, signals.velocity, signals.acceleration)
    noise = 1e-3 * effort.std(axis=0) * np.random.default_rng(0).standard_normal(effort.shape)
    exact = replace(
        motion.part(np.arange(len(signals))),
        time=signals.time,
        position=signals.position,
        velocity=None,
        effort=effort + noise,
    )
    assert told(exact, described) == ""
    assert "90 deg" in told(further(exact, 1, 90.0), described)


SLIDING = """<robot name="r"><link name="b"/>
<link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="6"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="cart"><inertial><origin xyz="0.1 0 0"/><mass value="4"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="b"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="200" velocity="3"/></joint>
<joint name="slide" type="prismatic"><parent link="arm"/><child link="cart"/><origin xyz="-0.5 0 0"/>
<axis xyz="1 0 0"/><limit lower="-0.2" upper="0.6" effort="100" velocity="1"/></joint></robot>"""


def test_a_slide_is_not_tried_by_degrees():
    """Its carriage is 1.2 m further out: that is near to 90 degrees' 1.57."""
    robot = Robot.from_urdf(SLIDING)
    time = np.arange(3000) / 100.0
    position = np.stack(
        [1.2 * np.sin(1.3 * time) + 0.3 * np.sin(2.9 * time), 0.2 + 0.25 * np.sin(1.9 * time + 1)], axis=1
    )
    velocity = np.gradient(position, time, axis=0)
    true = replace(robot, zeros=np.array([0.0, -1.2]))
    effort = true.rigid_effort(position, velocity, np.gradient(velocity, time, axis=0))
    said = told(Recording(time, robot.joints, position, None, effort), robot)
    assert said and "slide 90 deg" not in said and "slide 180 deg" not in said


@pytest.mark.parametrize("joint", [0, 3])
def test_a_load_is_seen_though_a_joint_reports_no_effort(arm: Robot, joint: int) -> None:
    """What is constant has no spread to be a share of."""
    link = arm.moving_link(arm.joints[-1])
    load = f"payload@{link}:mass=2.0,com_x=0.2,com_y=0.0,com_z=0.0"
    recording = Scenario(arm, effects=[load], seed=4, rate=250.0, duration=12.0).run()[0].recording
    effort = recording.require_effort() * (np.arange(arm.width) != joint)
    for one in (recording, replace(recording, effort=effort)):
        assert Motion(prepare(one), arm).explained_by_a_load() > 0.99


@pytest.mark.parametrize("off, explained", [(0.5, True), (0.7, False)])
def test_no_load_hangs_further_off_than_a_metre_in_all(arm: Robot, off: float, explained: bool) -> None:
    """Though it does not along any axis."""
    time = np.arange(0.0, 16.0, 0.01)
    angle = np.sin(time[:, None] * np.linspace(0.7, 1.7, 6)) + 0.3 * np.sin(
        3.0 * time[:, None] + np.arange(6)
    )
    velocity = np.gradient(angle, time, axis=0)
    loaded = arm.inertials.copy()
    loaded[-1, :4] += 3.0 * np.array([1.0, off, off, off])
    real = arm.with_inertials(loaded)
    effort = real.rigid_effort(angle, velocity, np.gradient(velocity, time, axis=0))
    share = Motion(prepare(Recording(time, arm.joints, angle, None, effort)), arm).explained_by_a_load()
    assert share > 0.99 if explained else share < 0.7
