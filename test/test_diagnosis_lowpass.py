"""What the steps of an encoder make of the effort that bodies seem to take."""

from __future__ import annotations

import numpy as np
import pytest

from bdnn_ros.diagnosis.recorded.lowpass import CUTOFFS, SLOWER, _steps, quiet_cutoff, slow_cutoff, stepping
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals.preparing import prepare

STEP, RATE, CUTOFF = 2.0 * np.pi / 2**14, 100.0, 3.0
ROBOT = Robot.bundled("arm2")


def creeping(speed: float, step: float = STEP) -> Recording:
    """Both joints go along at a speed, read in steps."""
    time = np.arange(3000) / RATE
    position = np.stack([speed * time, 0.5 - speed * time], axis=1)
    read = np.round(position / step) * step if step else position
    return Recording(time, ROBOT.joints, read, None, np.zeros_like(read))


def test_steps_are_found_where_there_are_any():
    generator = np.random.default_rng(0)
    assert _steps(creeping(0.03).position) == pytest.approx([STEP, STEP], rel=1e-6)
    assert (_steps(generator.uniform(size=(3000, 2))) < 1e-4).all()
    assert (_steps(np.full((100, 2), 0.3)) == 0.0).all()


@pytest.mark.parametrize("beat", [0.9, 0.98, 1.02, 1.1, 2.05])
def test_no_motion_makes_more_of_steps_than_is_allowed_for(beat):
    """A joint that goes by about a step from sample to sample: white noise of the same size would make far less."""
    recording = creeping(beat * STEP * RATE)
    signals = prepare(recording, CUTOFF)
    inside = signals.interior
    made = signals.smooth(signals.acceleration)[inside] @ ROBOT.mass_matrix(recording.position[0])
    allowed = stepping([recording], ROBOT, CUTOFF)
    assert (np.sqrt(np.mean(made**2, axis=0)) < allowed).all()


def test_what_is_allowed_for_grows_with_the_steps():
    fine, coarse = (stepping([creeping(0.03, step)], ROBOT, CUTOFF) for step in (STEP, 8.0 * STEP))
    assert coarse == pytest.approx(8.0 * fine, rel=0.1)


def swinging(frequency: float, noise: float = 1e-4, rate: float = 250.0) -> Recording:
    """Both joints swing by .15 rad, the base's as fast as told; efforts are by the description, hardly noisy."""
    time = np.arange(int(30.0 * rate)) / rate
    turning = 2.0 * np.pi * np.array([frequency, 0.1])
    angle = time[:, None] * turning
    effort = ROBOT.inverse_dynamics(
        0.15 * np.sin(angle), 0.15 * turning * np.cos(angle), -0.15 * turning**2 * np.sin(angle)
    )
    read = 0.15 * np.sin(angle) + noise * np.random.default_rng(1).standard_normal(angle.shape)
    return Recording(time, ROBOT.joints, read, None, effort)


def slow(*recordings: Recording) -> float | None:
    return slow_cutoff(recordings, ROBOT, quiet_cutoff(recordings, ROBOT))


def test_slow_motion_that_noise_drowns_is_looked_at_behind_a_lower_low_pass():
    chosen = slow(swinging(0.1))
    assert chosen in SLOWER
    assert slow(swinging(0.1, noise=1e-7)) is None


@pytest.mark.parametrize("others", [[], [0.1]])
def test_motion_of_one_joint_that_is_not_slow_keeps_the_usual_low_pass(others):
    assert slow(*(swinging(frequency) for frequency in (1.0, *others))) is None


@pytest.mark.parametrize("rate", [3.0, 8.0, 20.0])
def test_at_a_low_rate_none_is_asked_for_that_does_not_fit_it(rate):
    chosen = slow(swinging(0.1, rate=rate))
    assert chosen is None or chosen < min(CUTOFFS)
