"""The direction of dry friction: what noise on the position leaves of it, and how much that is in doubt."""

import numpy as np
import pytest

from bdnn_ros.physical.presliding import BREAKAWAYS, USUAL, directions, slide
from bdnn_ros.recording import Recording
from bdnn_ros.signals import prepare

NOISE = 5e-5
SECONDS = 60.0


def slow_motion(seed, size):
    """A joint that turns round every second or so, as an encoder reports it, and its velocity in truth."""
    generator = np.random.default_rng(seed)
    time = np.arange(0.0, SECONDS, 0.002)
    rate = 2.0 * np.pi * generator.uniform(0.2, 1.0, (5, 1))
    angle = rate * time + generator.uniform(0.0, 2.0 * np.pi, (5, 1))
    position = (size * np.sin(angle) / rate).sum(axis=0)
    seen = position + NOISE * generator.standard_normal(len(time))
    signals = prepare(Recording(time, ("joint",), seen[:, None], None, np.zeros((len(time), 1))))
    return signals, np.interp(signals.time, time, (size * np.cos(angle)).sum(axis=0))


def low_passed(signals, values):
    return signals.smooth(signals.smooth(values[:, None]))[signals.interior, 0]


@pytest.mark.parametrize("size", [0.03, 0.1])
def test_the_doubt_of_a_direction_is_how_far_it_is_off(size):
    off, doubt, hard = [], [], []
    for seed in range(4):
        signals, velocity = slow_motion(seed, size)
        state, truth = directions(signals), np.sign(velocity)
        direction, told = state.joints[:, 0, USUAL], state.doubt[:, 0]
        # slower for long, a joint counts as resting
        moving = low_passed(signals, (told == 1.0).astype(float)) < 1e-9
        off.append(low_passed(signals, direction - truth)[moving])
        hard.append(low_passed(signals, np.sign(signals.velocity[:, 0]) - truth)[moving])
        doubt.append(low_passed(signals, told)[moving])
    off, doubt, hard = (np.concatenate(values) for values in (off, doubt, hard))
    told, actual = (np.sqrt(np.mean(values**2)) for values in (doubt, off))
    assert 0.5 < actual / told < 1.5
    assert actual < 0.95 * np.sqrt(np.mean(hard**2))
    assert np.sqrt(np.mean(off[doubt < 0.01] ** 2)) < 0.02


def test_when_friction_turned_round_is_known_to_a_sample_of_the_effort():
    """Without any noise: what the direction at the samples, low-passed, differs from what is expected of it."""
    off, doubt = [], []
    for rate in (200.0, 331.0, 500.0, 521.0):
        time = np.arange(0.0, SECONDS, 1.0 / rate)
        angle = 2.0 * np.pi * 0.37 * time
        signals = prepare(
            Recording(time, ("joint",), np.sin(angle)[:, None], None, np.sign(np.cos(angle))[:, None])
        )
        state, felt = directions(signals), signals.smooth(signals.effort)[signals.interior, 0]
        off.append(felt - low_passed(signals, state.joints[:, 0, USUAL]))
        doubt.append(low_passed(signals, state.doubt[:, 0]))
    told, actual = (np.sqrt(np.mean(np.concatenate(values) ** 2)) for values in (doubt, off))
    assert told == pytest.approx(actual, rel=0.3)


def test_a_joint_that_has_not_moved_or_rests_may_hold_any_friction():
    time = np.arange(0.0, 4.0, 0.002)
    moved = np.where(time < 1.0, 0.2 * (1.0 - np.cos(np.pi * time)), 0.4)
    still = np.zeros_like(time)
    position = np.stack([moved, still], axis=1)
    signals = prepare(Recording(time, ("moved", "still"), position, None, np.zeros_like(position)))
    state, rows = directions(signals), signals.time
    assert (state.doubt[:, 1] == 1.0).all()
    assert (state.joints[:, 1] == 0.0).all()
    assert (state.doubt[(rows > 0.2) & (rows < 0.8), 0] == 0.0).all()
    assert (state.joints[(rows > 0.2) & (rows < 0.8), 0, USUAL] == 1.0).all()
    assert (state.doubt[rows > 2.0, 0] == 1.0).all()


@pytest.mark.parametrize("slows", [0.5, 3.0])
def test_a_stop_leaves_as_much_doubt_as_the_low_pass_has_of_it(slows):
    """Slowing down evenly, a joint stops at once; its low-passed velocity goes on for a while."""
    time = np.arange(0.0, 4.0, 0.002)
    position = np.where(time < 2.0, -0.5 * slows * (2.0 - time) ** 2, 0.0)[:, None]
    signals = prepare(Recording(time, ("joint",), position, None, np.zeros_like(position)))
    told = low_passed(signals, directions(signals).doubt[:, 0])
    stopped = low_passed(signals, (signals.time > 2.0).astype(float))
    shows = stopped > 0.01
    assert (told[shows] > 0.98 * stopped[shows]).all()
    assert (told[signals.time[signals.interior] < 2.0 - 6.0 * signals.kernel_std] < 0.01).all()


@pytest.mark.parametrize("count", [1, 2, 3, 7, 8, 1105])
def test_the_state_is_that_of_going_step_by_step(count):
    generator = np.random.default_rng(count)
    path, start = (
        np.cumsum(1e-4 * generator.normal(size=(count, 3)), axis=0),
        generator.uniform(-1, 1, (3, 1)),
    )
    state = np.broadcast_to(start, (3, len(BREAKAWAYS) - 1))
    found = slide(path, BREAKAWAYS[1:], start)
    assert found.shape == (count, *state.shape)
    np.testing.assert_array_equal(found[0], state)
    for step, after in zip(np.diff(path, axis=0), found[1:], strict=True):
        keep = np.exp(-np.abs(step)[:, None] / np.array(BREAKAWAYS[1:]))
        state = np.sign(step)[:, None] * (1.0 - keep) + keep * state
        np.testing.assert_allclose(after, state, atol=1e-13)
