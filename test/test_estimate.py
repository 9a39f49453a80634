"""The newest instant of a stream, and the parts of its effort."""

from __future__ import annotations

import numpy as np
import pytest
from live_support import motion, real_robot

from bdnn_ros.online import estimate
from bdnn_ros.online.estimate import Smoother, parts
from bdnn_ros.online.serving import nominal
from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.online.stream.feed import Feed, Samples
from bdnn_ros.online.stream.intake import Intake
from bdnn_ros.recording import Recording
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import prepare

ARM = Robot.bundled("arm6")
MODEL = nominal(real_robot(ARM))


def test_the_parts_add_up():
    q, v, a = np.random.default_rng(0).normal(size=(3, 6))
    told = parts(MODEL, q, v, a)
    np.testing.assert_allclose(told.effort, MODEL.inverse_dynamics(q, v, a))
    total = told.inertial + told.coriolis + told.gravity + told.friction + told.learned
    np.testing.assert_allclose(total, told.effort, atol=1e-12)
    np.testing.assert_allclose(told.inertial, told.mass_matrix @ a)
    np.testing.assert_allclose(told.friction, MODEL.friction(q, v), atol=1e-9)
    regressor, bodies = ARM.regressor(q[None], v[None], a[None])[0], 6 * PER_LINK
    for joint, std in enumerate(told.std):
        index = [*range(bodies), *(bodies + 6 * np.arange(4) + joint)]
        row = np.array([*regressor[joint], a[joint], v[joint], np.sign(v[joint]), 1.0])
        variance = row @ MODEL.covariance[np.ix_(index, index)] @ row
        assert std == pytest.approx(np.sqrt(variance + MODEL.noise[joint] ** 2))


@pytest.mark.parametrize(("rate", "jitter"), [(1000.0, 0.0), (1000.0, 0.3), (125.0, 0.0), (50.0, 0.2)])
def test_the_newest_instant_is_what_the_offline_low_pass_gives(rate, jitter):
    recording = motion(real_robot(ARM), 3.0, rate)
    time = recording.time + jitter / rate * np.random.default_rng(1).uniform(-0.5, 0.5, len(recording))
    moved = [
        np.stack([np.interp(time, recording.time, x) for x in field.T], axis=1)
        for field in (recording.position, recording.effort)
    ]
    if jitter == 0.0:
        moved = [recording.position, recording.effort]
    smoother = Smoother()
    smoother.settle(1.0 / rate)
    end = len(time) - round(0.3 * rate)  # the stream has come so far; the recording goes on
    last = slice(end - smoother.count, end)
    samples = Samples(time[last], moved[0][last], moved[0][last], moved[1][last])
    instant = smoother.at(samples, np.round(time[last] * 1e9).astype(np.int64))
    assert instant is not None
    signals = prepare(Recording(time, ARM.joints, moved[0], None, moved[1]))
    moment = instant.stamp * 1e-9
    assert time[end - 1] - moment < 4.5 * signals.kernel_std + 3.0 / rate

    def offline(values: np.ndarray) -> np.ndarray:
        return np.array([np.interp(moment, signals.time, x) for x in values.T])

    for name, tolerance in (("position", 1e-3), ("velocity", 2e-2), ("acceleration", 0.5)):
        mine, theirs = getattr(instant, name), offline(getattr(signals, name))
        np.testing.assert_allclose(mine, theirs, atol=tolerance * (1.0 + 5.0 * jitter), err_msg=name)


def test_stamps_that_scatter_do_not_make_the_effort_worse():
    """A stamp late by a fraction of a millisecond, as without a real-time kernel, is no acceleration."""
    recording, rng = motion(real_robot(ARM), 4.0, 500.0), np.random.default_rng(2)
    scattered = np.sort(recording.time + 3e-4 * rng.standard_normal(len(recording)))
    smoother = Smoother()
    smoother.settle(0.002)
    errors = {"even": list[np.ndarray](), "scattered": list[np.ndarray]()}
    for name, time in (("even", recording.time), ("scattered", scattered)):
        for end in range(500, len(time), 40):
            last = slice(end - smoother.count, end)
            q, u = recording.position[last], recording.effort[last]
            instant = smoother.at(Samples(time[last], q, q, u), np.arange(smoother.count))
            assert instant is not None
            told = parts(MODEL, instant.position, instant.velocity, instant.acceleration)
            errors[name].append(told.effort - instant.effort)
    even, late = (np.sqrt(np.mean(np.square(errors[name]), axis=0)) for name in errors)
    assert (late < 1.3 * even + 2e-3 * np.std(recording.effort, axis=0)).all()


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_a_joint_is_followed_across_the_wrap_of_its_reading(jitter):
    """A velocity of 188 rad/s was told where it crossed pi."""
    smoother = Smoother()
    smoother.settle(0.002)
    time = 0.002 * (np.arange(300) + jitter * np.random.default_rng(1).uniform(-0.5, 0.5, 300))
    turned = np.stack([3.0 + 0.8 * time, 0.2 - 0.5 * time], axis=1)
    told = (turned + np.pi) % (2.0 * np.pi) - np.pi
    crossed = set()
    for end in range(smoother.count, len(time)):
        last = slice(end - smoother.count, end)
        samples = Samples(time[last], told[last], told[last], np.zeros_like(told[last]))
        instant = smoother.at(samples, np.arange(last.start, last.stop))
        assert instant is not None
        np.testing.assert_allclose(instant.velocity, [0.8, -0.5], atol=0.05)
        np.testing.assert_allclose(instant.position, told[instant.stamp], atol=0.01)
        crossed.add(told[instant.stamp, 0] < 0.0)
    assert crossed == {True, False}


def test_there_is_none_across_a_gap_or_too_early():
    smoother = Smoother()
    smoother.settle(0.01)
    time = 0.01 * np.arange(smoother.count)
    values = np.zeros((len(time), 6))
    assert smoother.at(Samples(time, values, values, values), (time * 1e9).astype(int)) is not None
    gap = time + np.where(np.arange(len(time)) > len(time) // 2, 1.0, 0.0)
    assert smoother.at(Samples(gap, values, values, values), (gap * 1e9).astype(int)) is None
    few = slice(0, 4)
    assert smoother.at(Samples(time[few], values[few], values[few], values[few]), np.arange(4)) is None


def test_missing_effort_is_told_as_missing():
    smoother = Smoother()
    smoother.settle(0.01)
    time = 0.01 * np.arange(smoother.count)
    values, missing = np.zeros((len(time), 6)), np.full((len(time), 6), np.nan)
    instant = smoother.at(Samples(time, values, values, missing), (time * 1e9).astype(int))
    assert instant is not None and np.isnan(instant.effort).all() and np.isfinite(instant.velocity).all()


def test_how_many_samples_are_needed_may_be_asked_while_a_rate_is_settled_on(monkeypatch):
    """Another thread tells what a buffer is too short for."""
    smoother, kernel, told = Smoother(), estimate.gaussian_kernel, []

    def asked_meanwhile(*words):
        told.append(smoother.count)
        return kernel(*words)

    monkeypatch.setattr(estimate, "gaussian_kernel", asked_meanwhile)
    smoother.settle(0.01)
    first = smoother.count
    smoother.settle(0.001)
    assert told == [0, first] and smoother.count > 0


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_an_effort_that_a_message_lacks_now_and_then_is_bridged(jitter):
    """By what is known around it: one of fifty made the effort unknown, and its error, for good."""
    smoother = Smoother()
    smoother.settle(0.002)
    time = 0.002 * (np.arange(400) + jitter * np.random.default_rng(1).uniform(-0.5, 0.5, 400))
    values = np.stack([np.sin(7.0 * time), 3.0 * np.cos(5.0 * time)], axis=1)
    lacking = values.copy()
    lacking[7::50] = np.nan
    for end in range(smoother.count, len(time)):
        last = slice(end - smoother.count, end)
        told = [
            smoother.at(Samples(time[last], values[last], values[last], effort[last]), np.arange(400)[last])
            for effort in (values, lacking)
        ]
        assert told[0] is not None and told[1] is not None
        np.testing.assert_allclose(told[1].effort, told[0].effort, atol=1e-4)
    lacking[300:330] = np.nan  # 60 ms, longer than the low-pass
    last = slice(330 - smoother.count, 330)
    instant = smoother.at(
        Samples(time[last], values[last], values[last], lacking[last]), np.arange(400)[last]
    )
    assert instant is not None and np.isnan(instant.effort).all()


@pytest.mark.parametrize("step", [1, 1000])
def test_stamps_in_another_unit_are_told_of_and_cost_nothing(step, monkeypatch):
    """As of a driver that writes milliseconds into nanoseconds: a kernel of five gigabytes was made of it."""
    monkeypatch.setattr(estimate, "gaussian_kernel", None)
    ring = Ring.create(131072, 6)
    intake = Intake(("a", "b"), ring)
    for k in range(200):
        intake.take(["a", "b"], [0.1 * k, 0.0], (), [1.0, 2.0], 10**18 + k * step, 10**18 + k * 10**6)
    smoother = Smoother()
    assert smoother.newest(Feed(intake.joints, ring), intake.clock.period * 1e-9) is None
    told = smoother.complaint(ring.most)
    assert f"go on by {step} ns" in told and "stamp.nanosec" in told and "buffer_size" not in told
    ring.close()


def test_no_kernel_is_made_that_is_longer_than_the_buffer(monkeypatch):
    monkeypatch.setattr(estimate, "gaussian_kernel", None)
    ring = Ring.create(1000, 6)
    smoother = Smoother(0.1)
    assert smoother.newest(Feed(("a", "b"), ring), 0.001) is None
    assert f"Set buffer_size to {2 * smoother.count}" in smoother.complaint(ring.most)
    ring.close()
