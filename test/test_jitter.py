"""Stamps that scatter about an even rate, and samples that were taken unevenly."""

from __future__ import annotations

import numpy as np
import pytest

from bdnn_ros.recording import Recording
from bdnn_ros.signals import prepare
from bdnn_ros.signals.jitter import without_jitter

PERIOD, SCATTER, NOISE = 0.004, 3e-4, 1e-6
JOINTS = ("a", "b")


def recorded(taken: np.ndarray, stamps: np.ndarray, seed: int = 0) -> Recording:
    """A motion that was sampled at some times and stamped with others."""
    position = np.stack([np.sin(taken), 0.5 * np.cos(2.3 * taken)], axis=1)
    position += NOISE * np.random.default_rng(seed).standard_normal(position.shape)
    return Recording(stamps, JOINTS, position, None, np.zeros_like(position))


@pytest.fixture
def even() -> np.ndarray:
    return PERIOD * np.arange(5000)


@pytest.fixture
def scattered(even: np.ndarray) -> np.ndarray:
    return even + SCATTER * np.random.default_rng(1).standard_normal(len(even))


def error_of(recording: Recording) -> float:
    """Of the acceleration, root mean square [rad/s²]."""
    signals = prepare(recording)
    wanted = np.stack([-np.sin(signals.time), -0.5 * 2.3**2 * np.cos(2.3 * signals.time)], axis=1)
    return float(np.sqrt(np.mean((signals.acceleration - wanted)[signals.interior] ** 2)))


def test_even_samples_get_their_even_times_back(even, scattered):
    mended = without_jitter(recorded(even, scattered))
    off = mended.time - even
    assert np.std(off) < 0.1 * SCATTER and abs(np.mean(off)) < 0.1 * SCATTER
    assert "scatter by 0.3 ms" in mended.notes[-1]
    assert error_of(recorded(even, scattered)) < 3.0 * error_of(recorded(even, even))


def test_samples_that_were_taken_when_their_stamps_say_are_left_alone(scattered):
    recording = recorded(scattered, scattered)
    assert without_jitter(recording) is recording


def test_even_stamps_are_left_alone(even):
    recording = recorded(even, even)
    assert without_jitter(recording) is recording


def test_lost_messages_a_pause_and_a_slow_clock_are_no_jitter(even, scattered):
    """A clock that is .5 ms/s fast, one message in fifty lost, and two seconds without any."""
    kept = np.random.default_rng(2).random(len(even)) > 0.02
    kept[2000:2500] = False
    drift = 1.0 + 5e-4
    mended = without_jitter(recorded(even[kept], drift * scattered[kept]))
    assert np.std(mended.time - drift * even[kept]) < 0.15 * SCATTER


@pytest.mark.parametrize("count", [2, 10])
def test_a_few_samples_are_left_alone(even, scattered, count):
    recording = recorded(even[:count], scattered[:count])
    assert without_jitter(recording) is recording


def test_a_robot_at_rest_has_no_say(even, scattered):
    still = Recording(scattered, JOINTS, np.ones((len(even), 2)))
    assert without_jitter(still) is still
