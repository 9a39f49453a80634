"""What drivers report in another way than is taken for granted is recognised, and nothing else is."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.checks.conventions import Borne, Efforts, _turned, breaches, unlike
from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.errors import RecordingError
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare
from bdnn_ros.simulation.scenario import Scenario
from bdnn_ros.simulation.simulate import simulate

ARMS = ("arm2", "arm6", "arm7")
Spoiled = Callable[[Recording, Robot], Recording]


def worn(name: str, seed: int, wrong: float = 0.05) -> Recording:
    """A robot with friction and rotors that its description, itself off, leaves out."""
    return Scenario(Robot.bundled(name), seed=seed, duration=12.0, worn=True, wrong=wrong).run()[0].recording


def problems(recording: Recording, robot: Robot) -> list[str]:
    return [remark.problem for remark in breaches(prepare(recording), robot)]


def effort_times(factors: float | np.ndarray) -> Spoiled:
    return lambda recording, robot: replace(recording, effort=factors * recording.require_effort())


def one_turned(recording: Recording, robot: Robot) -> Recording:
    return effort_times(np.where(np.arange(robot.width) == 1, -1.0, 1.0))(recording, robot)


def currents(recording: Recording, robot: Robot) -> Recording:
    return effort_times(1.0 / np.linspace(8.0, 14.0, robot.width))(recording, robot)


def without_gravity(recording: Recording, robot: Robot) -> Recording:
    return replace(recording, effort=recording.require_effort() - robot.gravity(recording.position))


def in_degrees(recording: Recording, robot: Robot) -> Recording:
    return replace(recording, position=np.rad2deg(recording.position), velocity=None)


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize(
    "spoil, sentence",
    [
        (one_turned, "The efforts of {second} have the wrong sign"),
        (effort_times(-1.0), "The efforts of {first}, {second}"),
        (currents, "seem to be in another unit"),
        (effort_times(1000.0), "seem to be in another unit"),
        (without_gravity, "leave gravity out"),
        (in_degrees, "seem to be in degrees"),
    ],
    ids=["one turned", "all turned", "currents", "millis", "without gravity", "degrees"],
)
def test_what_is_recorded_otherwise_is_told(name, spoil, sentence):
    robot, recording = Robot.bundled(name), worn(name, seed=4)
    assert problems(recording, robot) == []
    (problem,) = problems(spoil(recording, robot), robot)
    assert sentence.format(first=robot.joints[0], second=robot.joints[1]) in problem
    with pytest.raises(RecordingError, match=re.escape(problem)):
        diagnose([spoil(recording, robot)], robot)


@pytest.mark.parametrize("joint", range(6))
def test_one_joint_in_degrees_is_told(joint):
    robot, recording = Robot.bundled("arm6"), worn("arm6", seed=4)
    position = recording.position.copy()
    position[:, joint] = np.rad2deg(position[:, joint])
    (problem,) = problems(replace(recording, position=position, velocity=None), robot)
    assert (
        problem.startswith(f"arm6_joint{joint + 1} covers") and "its positions seem to be in deg" in problem
    )


def test_a_joint_whose_limits_are_too_narrow_is_not_in_degrees():
    """Wrists turn twice as far as many a description allows."""
    robot, recording = Robot.bundled("arm6"), worn("arm6", seed=4)
    upper, covered = robot.limits.upper.copy(), np.ptp(recording.position, axis=0)
    upper[5] = robot.limits.lower[5] + covered[5] / 2.0
    limits = replace(robot.limits, upper=upper)
    assert not [p for p in problems(recording, replace(robot, limits=limits)) if "degrees" in p]


@pytest.mark.parametrize("seed", range(6))
def test_a_robot_that_is_far_from_its_description_breaks_no_convention(seed):
    name = ARMS[seed % 3]
    assert problems(worn(name, 40 + seed, wrong=0.2), Robot.bundled(name)) == []


@pytest.mark.parametrize(
    "spec",
    ["payload@arm2_link2:mass=2.0,com_x=0.1", "effort_scale@arm2_joint2:scale=2.5", "base_tilt:roll_deg=20"],
)
def test_large_causes_break_no_convention(spec):
    robot = Robot.bundled("arm2")
    recording = simulate(robot, [parse_spec(spec, robot)], seed=1, duration=12.0).recording
    assert problems(recording, robot) == []


@pytest.mark.parametrize("joint", range(6))
def test_rotors_of_a_small_wrist_are_no_other_unit(joint):
    """Alone, a wrist's rotor makes hundreds of times what its links do."""
    name = f"arm6_joint{1 + joint}"
    assert problems(worn("arm6", 6).select([name]), Robot.bundled("arm6", [name])) == []


@pytest.mark.parametrize("size, told", [(1.0, ["c"]), (0.02, [])])
def test_a_link_that_hangs_in_its_axis_has_no_wrong_sign(size, told):
    """Where its described centre is by a hair to the wrong side of the axis gravity is many times what it should be, and less."""
    rng = np.random.default_rng(0)
    own, coupled, gravity, sign = rng.standard_normal((4, 500, 3))
    sign = np.sign(sign)
    measured = own + coupled + gravity + 0.1 * sign
    measured[:, 2] *= -1.0
    one = np.where(np.arange(3) == 2, size, 1.0)
    borne = Borne(Efforts(measured, sign, np.ones(sign.shape, bool)), own * one, coupled * one, gravity * one)
    assert [remark.about for remark in _turned(borne, ("a", "b", "c"))[0]] == told


def test_a_model_of_other_units_is_told_by_what_it_predicts():
    robot = Robot.bundled("arm2")
    signals = prepare(simulate(robot, seed=1, duration=12.0).recording)
    predicted = robot.rigid_effort(signals.position, signals.velocity, signals.acceleration)
    assert list(unlike(signals, predicted, robot)) == []
    (remark,) = unlike(signals, 0.05 * predicted, robot)
    assert "about 20 times" in remark.problem


def test_nothing_is_said_of_a_robot_that_stands_still_or_reports_no_effort():
    robot = Robot.bundled("arm2")
    recording = simulate(robot, seed=1, duration=12.0).recording
    assert problems(replace(recording, effort=None), robot) == []
    still = replace(recording, position=np.zeros_like(recording.position), velocity=None)
    assert problems(still, robot) == []


def test_one_joint_in_another_unit_is_told():
    """A current of one joint among torques: what it and those behind it bear took the blame."""
    robot, recording = Robot.bundled("arm6"), worn("arm6", seed=4)
    for joint, factor, said in ((1, 0.1, "times what gravity and"), (5, 1000.0, "lets the drive give")):
        effort = recording.require_effort().copy()
        effort[:, joint] *= factor
        (problem,) = problems(replace(recording, effort=effort), robot)
        assert problem.startswith(f"The effort of arm6_joint{joint + 1} ") and said in problem


def continuous(name: str) -> Robot:
    """An arm whose joints all turn on and on."""
    return Robot.from_urdf(Robot.bundled(name).urdf.replace('type="revolute"', 'type="continuous"'))


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("described", [True, False])
def test_degrees_are_told_where_joints_have_no_limits(name, described):
    robot, recording = continuous(name), worn(name, seed=4)
    if not described:
        robot = replace(robot, limits=replace(robot.limits, velocity=np.full(robot.width, np.inf)))
    assert problems(recording, robot) == []
    (problem,) = problems(in_degrees(recording, robot), robot)
    assert problem.startswith(robot.joints[0]) and "positions seem to be in degrees" in problem


@pytest.mark.parametrize("limit", [1.0, np.inf])
def test_what_spins_in_radians_is_told_in_radians(limit):
    """Wheels of a mobile robot, all of them or one on an arm, and an arm much quicker than somebody guessed."""
    robot, recording = continuous("arm2"), worn("arm2", seed=4)
    robot = replace(robot, limits=replace(robot.limits, velocity=np.full(2, limit)))
    spinning = 35.0 * recording.time[:, None] + 5.0 * recording.position
    quick = 8.0 * recording.position
    one = np.stack([spinning[:, 0], recording.position[:, 1]], axis=1)
    for position in (spinning, -3.0 * spinning, quick, one):
        told = replace(recording, position=position, velocity=None)
        assert not [p for p in problems(told, robot) if "degrees" in p]


def test_a_slide_is_told_in_millimetres():
    urdf = Robot.bundled("arm2").urdf.replace('type="revolute"', 'type="prismatic"')
    robot = Robot.from_urdf(urdf)
    recording = simulate(robot, duration=8.0, rate=200.0).recording
    assert not [p for p in problems(recording, robot) if "seem" in p]
    (problem,) = problems(replace(recording, position=1e3 * recording.position, velocity=None), robot)
    assert problem.startswith("arm2_joint1, arm2_joint2 cover") and "in millimetres" in problem
