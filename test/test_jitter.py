"""Stamps that scatter about an even rate, and samples that were taken unevenly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.recording import Recording
from bdnn_ros.signals import prepare
from bdnn_ros.signals.jitter import taken_at, without_jitter

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


@pytest.mark.parametrize("scatter, said", [(1e-8, False), (5e-7, False), (1e-5, True)])
def test_a_scatter_that_nobody_feels_is_put_right_without_a_word(even, scatter, said):
    """Stamps of a bag that were rounded to nanoseconds, or made by a sum of periods: less than a thousandth of one."""
    stamps = even + scatter * np.random.default_rng(1).standard_normal(len(even))
    smooth = replace(
        recorded(even, stamps), position=np.stack([np.sin(even), 0.5 * np.cos(2.3 * even)], axis=1)
    )
    mended = without_jitter(smooth)
    assert np.std(mended.time - even) < 0.1 * scatter
    assert bool(mended.notes) == said


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


def late(even: np.ndarray, share: float, seed: int = 0, most: int = 1) -> np.ndarray:
    """Stamps of which some were made as late as 10 µs before the next: `most` in a row, all at once, as a queue lets go."""
    generator, stamps = np.random.default_rng(seed), even.copy()
    for start in generator.choice(len(even) // 10, max(1, round(share * len(even))), replace=False) * 10 + 3:
        held = 1 + generator.integers(most)
        stamps[start : start + held] = even[start + held] - 1e-5 * np.arange(held, 0, -1)
    return stamps


@pytest.mark.parametrize("share", [0.0, 0.005, 0.03])
@pytest.mark.parametrize("most", [1, 4])
def test_stamps_that_are_late_are_put_right(even, share, most):
    """One alone would be an acceleration of thousands of rad/s²."""
    stamps = late(even, share, most=most)
    mended = without_jitter(recorded(even, stamps))
    np.testing.assert_allclose(mended.time, even, atol=0.05 * PERIOD)
    assert "put right" in mended.notes[-1]
    assert error_of(recorded(even, stamps)) < 3.0 * error_of(recorded(even, even))


def test_late_stamps_between_scattered_ones_and_lost_messages_are_put_right(even, scattered):
    kept = np.random.default_rng(3).random(len(even)) > 0.01
    stamps = late(scattered[kept], 0.005)
    mended = without_jitter(recorded(even[kept], stamps))
    assert np.std(mended.time - even[kept]) < 0.3 * SCATTER


def test_stamps_that_scatter_by_a_third_of_a_period_are_put_right(even):
    scattered = np.sort(even + 0.3 * PERIOD * np.random.default_rng(4).standard_normal(len(even)))
    scattered += 1e-9 * np.arange(len(even))
    mended = without_jitter(recorded(even, scattered))
    assert np.std(mended.time - even) < 0.05 * PERIOD


@pytest.mark.parametrize("lost", [0.002, 0.01, 0.05, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_lost_messages_are_counted_though_single_steps_do_not_tell(even, lost, seed):
    """Of single steps one in thirteen is nearer to two ticks or none than to the one that it is."""
    generator = np.random.default_rng(seed)
    scatter = 0.2 * PERIOD * generator.standard_normal(len(even)).clip(-2.3, 2.3)
    kept = generator.random(len(even)) > lost
    mended = without_jitter(recorded(even[kept], (even + scatter)[kept]))
    assert np.std(mended.time - even[kept]) < 0.2 * np.std(scatter)


def test_lost_messages_are_counted_by_a_clock_that_gains_and_loses_whole_ticks(even):
    generator = np.random.default_rng(0)
    taken = even + 0.006 * np.sin(even / 3.0)
    stamps = taken + 0.2 * PERIOD * generator.uniform(-1.0, 1.0, len(even))
    kept = generator.random(len(even)) > 0.01
    mended = without_jitter(recorded(taken[kept], stamps[kept]))
    assert np.std(mended.time - taken[kept]) < 0.3 * np.std(stamps - taken)


@pytest.mark.parametrize("count", [25, 60, 200, 5000])
@pytest.mark.parametrize("scatter", [0.3, 0.45, 1.0])
def test_stamps_are_never_made_worse(even, count, scatter):
    """As few as of a stream, and scattered evenly over up to two periods."""
    for seed in range(5):
        generator = np.random.default_rng(seed)
        stamps = even[:count] + scatter * PERIOD * generator.uniform(-1.0, 1.0, count)
        kept = np.diff(np.maximum.accumulate(stamps), prepend=-1.0) > 0.0
        kept &= generator.random(count) > 0.02
        taken, stamps = even[:count][kept], stamps[kept]
        time = taken_at(stamps, recorded(taken, taken).position, 1.0 / PERIOD, [slice(0, len(taken))])
        assert np.std(time - taken) <= np.std(stamps - taken)


def test_what_comes_just_before_the_next_of_no_clock_is_left_out():
    """Where no even times are known, it would be the slope of its noise."""
    generator = np.random.default_rng(5)
    taken = np.cumsum(PERIOD * generator.uniform(0.2, 2.0, 4000))
    stamps = taken.copy()
    stamps[100] = stamps[101] - 1e-7
    mended = without_jitter(recorded(taken, stamps))
    assert len(mended) == len(taken) - 1 and stamps[100] not in mended.time
    assert "1 of 4000" in mended.notes[-1] and "left out" in mended.notes[-1]


def test_messages_that_waited_in_a_queue_are_no_gap_that_turns_stamps_round():
    """Each side of a gap has a clock of its own, and what came before it may be late."""
    taken = 0.01 * np.arange(1000)
    stamps = taken.copy()
    stamps[399] += 0.02
    stamps[400:408] = taken[407] + 1e-4 * np.arange(-7, 1)
    recording = recorded(taken, stamps)
    assert len(recording.segments()) == 2
    assert (np.diff(without_jitter(recording).time) > 0.0).all()


@pytest.mark.parametrize("seed", range(12))
def test_whatever_is_late_no_stamps_turn_round(seed):
    generator = np.random.default_rng(seed)
    taken = 0.01 * np.arange(3000)
    waits = np.where(generator.random(3000) < 0.03, generator.exponential(0.03, 3000), 0.0)
    stamps = np.maximum.accumulate(taken + waits + 0.003 * generator.random(3000)) + 1e-6 * np.arange(3000)
    assert (np.diff(without_jitter(recorded(taken, stamps)).time) > 0.0).all()
