"""A joint that holds still, as a gripper does, flips its reading's last digit: nothing is learned of it, nothing breaks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cli_cases import sliding_arm

from bdnn_ros.checks.velocities import odd_velocity
from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.diagnosis.recorded.velocity_filter import reported_velocity
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.telling.predicting import Predictor
from bdnn_ros.effects.motion import CALM, Motion
from bdnn_ros.effects.registry import get
from bdnn_ros.recording import Recording, moving
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare
from bdnn_ros.signals.glitches import without_glitches

DIGIT = 2e-6
VISCOUS = np.array([4.0, 2.0, 0.0])


def holding(robot: Robot, joint: int, gives: float = 0.0) -> Recording:
    """Viscous friction along a motion during which one joint holds still but for its reading's last digit, and what it gives."""
    rng, time = np.random.default_rng(0), np.arange(5000) / 250.0
    phase = np.outer(time, [2.1, 3.7, 2.9][: robot.width]) + np.arange(robot.width)
    position, rate = 0.8 * np.sin(phase), np.array([2.1, 3.7, 2.9][: robot.width])
    velocity, acceleration = 0.8 * rate * np.cos(phase), -0.8 * rate**2 * np.sin(phase)
    for values in (position, velocity, acceleration):
        values[:, joint] = 0.0
    effort = robot.rigid_effort(position, velocity, acceleration) + VISCOUS[: robot.width] * velocity
    effort += (0.005 * np.std(effort, axis=0) + 0.01) * rng.standard_normal(effort.shape)
    flips = DIGIT * (rng.random(len(time)) < 0.004)
    position[:, joint] = 0.2 + gives * np.sin(3.0 * time) + flips
    velocity[:, joint] = 0.9 * np.gradient(position[:, joint], time)
    position += 1e-5 * rng.standard_normal(position.shape) * (np.arange(robot.width) != joint)
    return Recording(time, robot.joints, position, velocity, effort)


@pytest.mark.parametrize("gives", [0.0, 6e-5])
def test_nothing_is_learned_of_a_joint_that_holds(gives):
    robot = Robot.bundled("arm2")
    recording = holding(robot, 1, gives)
    assert moving(recording).tolist() == [True, False]
    signals = prepare(recording)
    assert not build(signals, robot).usable[:, 1].any()
    assert list(odd_velocity(recording, signals)) == [] == reported_velocity([recording])
    diagnosis = diagnose([recording], robot)
    (found,) = diagnosis.findings
    assert (found.effect, found.joint) == ("viscous_friction", robot.joints[0])
    assert found.parameters["viscous"].value == pytest.approx(VISCOUS[0], rel=0.01)
    assert not any(robot.joints[1] in said for said in (*diagnosis.advice, *diagnosis.unexplained_depends_on))


def test_its_last_digit_is_no_glitch():
    recording = holding(Robot.bundled("arm2"), 1)
    assert without_glitches(recording).notes == ()
    wrong = recording.position.copy()
    wrong[2000, 0] += 0.5
    (note,) = without_glitches(Recording(recording.time, recording.joints, wrong)).notes
    assert "1 reading of arm2_joint1" in note


def test_a_slide_that_hardly_moves_shows_no_ripple_of_its_screw():
    """Whatever pitch is tried on so short a stroke is finer than any."""
    robot = sliding_arm()
    for gives, shown in ((1e-3, False), (0.3, True)):
        equations = build(prepare(holding(robot, 1, gives)), robot)
        ripples = [t for t in Candidates.of(robot).terms if t.effect.name == "cogging" and t.target == 1]
        assert all(t.effect.shapes(equations.motion, t.target) for t in ripples)
        terms = Candidates.shown_by(equations).terms
        assert any(t.effect.name == "cogging" and t.target == 1 for t in terms) is shown


@pytest.mark.parametrize("size", [0.0, 1e-17])
def test_an_input_that_never_varies_predicts_nothing(size):
    rng = np.random.default_rng(1)
    inputs = np.stack(
        [1.0 + size * rng.standard_normal(400), np.zeros(400), rng.standard_normal(400)], axis=1
    )
    values = 2.0 * inputs[:, 2] + 0.1 * rng.standard_normal(400)
    predicted, _ = Predictor({"inputs": inputs}, values, np.ones(400, bool), np.arange(400) // 40).predicted()
    assert np.std(values - predicted) == pytest.approx(0.1, rel=0.15)


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_a_velocity_that_never_changes_is_as_slow_as_the_recording_is_short(speed):
    """Its own frequency is none at all: no low-pass is as low."""
    robot, time = Robot.bundled("arm2"), np.arange(4000) / 200.0
    position = np.stack([speed * time - 1.0, np.full_like(time, 0.3)], axis=1)
    effort = robot.gravity(position)
    signals = prepare(Recording(time, robot.joints, position, effort=effort))
    still = np.zeros_like(signals.position)
    exact = replace(signals, velocity=still + np.array([speed, 0.0]), acceleration=still)
    for each in (signals, exact):
        motion = Motion(each, robot, each.effort)
        assert motion.calm == pytest.approx(CALM / (len(each) / each.rate))
        assert motion.calmed(np.ones(len(each))) == pytest.approx(1.0)
        shapes = get("joint_elasticity").shapes(motion, 0)
        softest = max(shape["compliance"] for shape in shapes)
        assert 0.0 < softest < 1.0 / (motion.usual_inertia[0] * motion.calm**2)
