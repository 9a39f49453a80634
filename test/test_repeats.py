"""Messages published twice: left out, and the stamps put right."""

import numpy as np
import pytest

from bdnn_ros.recording import Recording
from bdnn_ros.signals import prepare
from bdnn_ros.signals.repeats import without_repeats

PERIOD = 1.0 / 30.0


def state(time):
    position = np.stack([np.sin(time), 0.5 * np.cos(1.3 * time)], axis=1)
    return position, np.stack([np.cos(2.0 * time), np.sin(time)], axis=1)


def slow_driver(duration=20.0, ratio=1.02):
    """A publisher takes the oldest state not yet sent from a driver whose period is longer."""
    stamps, taken = [], []
    time, index = 0.0, 0
    while time < duration:
        fresh = index * PERIOD * ratio <= time
        if not fresh:
            index -= 1
        stamps.append(time)
        taken.append(index * PERIOD * ratio)
        index += 1
        time += PERIOD
    position, effort = state(np.array(taken))
    return Recording(np.array(stamps), ("a", "b"), position, None, effort)


def test_a_slow_drivers_clock_is_put_right():
    recording = slow_driver()
    repeats = np.flatnonzero((np.diff(recording.position, axis=0) == 0.0).all(axis=1)) + 1
    repeats = repeats[repeats > 1]
    assert len(repeats) >= 10
    mended = without_repeats(recording)
    assert len(mended) == len(recording) - len(repeats)
    before, after = (
        np.abs(signals.acceleration[:, 0] + np.sin(signals.time)).max()
        for signals in (_prepared(recording), prepare(mended))
    )
    assert after < 0.1 * before
    np.testing.assert_allclose(np.diff(mended.time)[20:-60], 1.02 * PERIOD, rtol=1e-3)
    assert "repeat" in mended.notes[-1]


def _prepared(recording):
    """Signals as they are without the repair."""
    import bdnn_ros.signals.preparing as module

    repair, module.without_repeats = module.without_repeats, lambda same: same
    try:
        return prepare(recording)
    finally:
        module.without_repeats = repair


def test_a_stale_message_whose_position_catches_up_is_left_out_and_no_stamp_moves():
    time = np.arange(0.0, 5.0, PERIOD)
    position, effort = state(time)
    stale = [40, 80, 81]
    for row in stale:
        position[row], effort[row] = position[row - 1], effort[row - 1]
    mended = without_repeats(Recording(time, ("a", "b"), position, None, effort))
    np.testing.assert_array_equal(mended.time, np.delete(time, stale))


def test_a_robot_at_rest_and_coarse_encoders_are_left_alone():
    time = np.arange(0.0, 5.0, PERIOD)
    rest = np.concatenate([np.sin(time[:75]), np.full(len(time) - 75, np.sin(time[75]))])
    still = Recording(time, ("a",), rest[:, None])
    assert without_repeats(still) is still
    coarse = Recording(time, ("a",), np.round(np.sin(0.2 * time)[:, None] / 0.01) * 0.01)
    assert without_repeats(coarse) is coarse
    smooth = Recording(time, ("a",), np.sin(time)[:, None])
    assert without_repeats(smooth) is smooth


@pytest.mark.parametrize("repeats", [(300, 301, 302, 306), (300, 301, 303)])
def test_repeats_close_to_each_other_never_set_stamps_back(repeats):
    recording = slow_driver()
    position, effort = recording.position.copy(), recording.effort.copy()
    for row in repeats:
        position[row:], effort[row:] = position[row - 1 : -1].copy(), effort[row - 1 : -1].copy()
    repeating = Recording(recording.time, recording.joints, position, None, effort)
    mended = without_repeats(repeating)
    assert (np.diff(mended.time) > 0.0).all() and len(mended) <= len(repeating) - len(repeats)
