"""Sensors: size and colour of the noise, rounding, differentiated and low-passed velocities."""

from __future__ import annotations

import numpy as np
import pytest

from bdnn_ros.errors import UsageError
from bdnn_ros.simulation.sensors import Noise, measured_effort, measured_position, measured_velocity

RATE = 500.0
OPEN = np.full(2, np.inf)


def sweep() -> np.ndarray:
    time = np.arange(20_000) / RATE
    return np.stack([np.sin(time), 5.0 * np.cos(3.0 * time)], axis=1)


def test_no_noise_reports_what_is():
    true, quiet, rng = sweep(), Noise.of(0.0), np.random.default_rng(0)
    assert (measured_position(true, quiet, rng) == true).all()
    assert (measured_velocity(true, true, OPEN, 1 / RATE, quiet, rng) == true).all()
    assert (measured_effort(true, 1 / RATE, quiet, rng) == true).all()


def test_position_noise_has_its_standard_deviation_and_rounding_its_step():
    true, rng = sweep(), np.random.default_rng(0)
    noise = measured_position(true, Noise(position=1e-3), rng) - true
    assert np.std(noise, axis=0) == pytest.approx(1e-3, rel=0.03)
    rounded = measured_position(true, Noise(position=0.0, resolution=0.01), rng)
    assert np.abs(rounded - true).max() <= 0.005 + 1e-12
    assert rounded / 0.01 == pytest.approx(np.round(rounded / 0.01), abs=1e-6)


def test_coloured_noise_is_as_loud_and_as_coloured_from_the_first_sample_on():
    """Of many joints at once."""
    true, coloured = np.zeros((11, 20_000)), Noise(effort=1.0, correlation=0.05)
    true[5] = 1.0
    noise = measured_effort(true, 1 / RATE, coloured, np.random.default_rng(0)) - true
    keep = np.exp(-1 / RATE / 0.05)
    assert np.std(noise, axis=1) == pytest.approx(1.0, rel=0.03)
    assert np.mean(noise[1:] * noise[:-1], axis=1) == pytest.approx(keep, rel=0.03)


@pytest.mark.parametrize("coloured", [False, True])
def test_effort_noise_is_a_share_of_the_range(coloured):
    true, rng = sweep(), np.random.default_rng(1)
    noise = measured_effort(true, 1 / RATE, Noise.of(0.02, coloured), rng) - true
    assert np.std(noise, axis=0) == pytest.approx(0.02 * np.ptp(true, axis=0), rel=0.1)


def test_coloured_noise_forgets_at_its_correlation_time():
    rng = np.random.default_rng(2)
    true = np.zeros((400_000, 1))
    true[0] = 1.0
    noise = (measured_effort(true, 1 / RATE, Noise(effort=1.0, correlation=0.1), rng) - true)[:, 0]
    lag = round(0.1 * RATE)
    assert np.mean(noise[lag:] * noise[:-lag]) / np.var(noise) == pytest.approx(np.exp(-1.0), abs=0.03)


def test_effort_rounds_to_its_resolution():
    true = sweep()
    rounded = measured_effort(
        true, 1 / RATE, Noise(effort=0.0, effort_resolution=0.01), np.random.default_rng(0)
    )
    steps = 0.01 * np.ptp(true, axis=0)
    assert rounded / steps == pytest.approx(np.round(rounded / steps), abs=1e-6)


def test_a_differentiated_velocity_is_the_backward_difference_of_what_was_reported():
    reported, rng = sweep(), np.random.default_rng(0)
    noise = Noise(velocity_source="differentiated")
    velocity = measured_velocity(np.zeros_like(reported), reported, OPEN, 1 / RATE, noise, rng)
    assert velocity[1:] == pytest.approx(np.diff(reported, axis=0) * RATE)
    assert (velocity[0] == 0.0).all()
    assert measured_velocity(reported, reported, OPEN, 1 / RATE, Noise(velocity_source="none"), rng) is None


def test_a_low_passed_velocity_follows_a_ramp_one_time_constant_late():
    time = np.arange(2000) / RATE
    ramp = np.stack([2.0 * time, 2.0 * time], axis=1)
    cutoff = np.array([4.0, np.inf])
    velocity = measured_velocity(ramp, ramp, cutoff, 1 / RATE, Noise.of(0.0), np.random.default_rng(0))
    lag = 1.0 / (2.0 * np.pi * 4.0)
    assert velocity[-1, 0] == pytest.approx(2.0 * (time[-1] - lag), abs=1e-9)
    assert (velocity[:, 1] == ramp[:, 1]).all()


def test_a_low_passed_sine_is_3_db_down_at_the_cutoff():
    time = np.arange(5000) / RATE
    sine = np.sin(2.0 * np.pi * 4.0 * time)[:, None]
    velocity = measured_velocity(
        sine, sine, np.array([4.0]), 1 / RATE, Noise.of(0.0), np.random.default_rng(0)
    )
    assert np.abs(velocity[2500:]).max() == pytest.approx(np.sqrt(0.5), rel=2e-3)


@pytest.mark.parametrize("level", [-0.1, 0.5, float("nan")])
def test_a_noise_that_makes_no_sense_is_refused(level):
    with pytest.raises(UsageError, match="noise"):
        Noise.of(level)
