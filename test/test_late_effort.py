"""A joint whose effort comes late, or never, while that of the others comes: no zero is taken for measured."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from live_support import motion, real_robot

from bdnn_ros.nodes.conversions import estimate_message
from bdnn_ros.nodes.error_now import ErrorNow
from bdnn_ros.online.channel import Channel, Message
from bdnn_ros.online.estimate import Smoother
from bdnn_ros.online.serving import Served, Settings, nominal
from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.online.stream.feed import Feed
from bdnn_ros.online.stream.intake import Intake
from bdnn_ros.online.trainer import Trainer
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm2")
REAL = real_robot(ARM)
RATE = 200.0
LATE = 14.0
"""The effort of the second joint comes from here on [s]: later than a driver is waited for."""


@pytest.fixture(scope="module")
def moved() -> Recording:
    return motion(REAL, 24.0, RATE)


def taken(recording: Recording, late: float) -> Feed:
    """A feed of the stream whose second joint tells its effort from a moment on [s]."""
    intake = Intake(ARM.joints, Ring.create(8192, 6))
    effort = recording.require_effort().copy()
    effort[recording.time < late, 1] = np.nan
    for k, moment in enumerate(recording.time):
        stamp = 10**18 + round(moment * 1e9)
        intake.take(list(ARM.joints), recording.position[k], (), effort[k], stamp, stamp)
    return Feed(ARM.joints, intake.ring)


def test_a_recording_holds_nothing_from_before_an_effort_came(moved):
    feed = taken(moved, LATE)
    live = feed.recording(0.0)
    # ten seconds were waited for, and four were learned from without it
    assert feed.states.written == round(RATE * 14.0) and len(live) == round(RATE * 10.0)
    np.testing.assert_allclose(live.effort, moved.effort[moved.time >= LATE])
    feed.states.close()


def test_a_joint_that_never_has_an_effort_has_zero_as_from_a_recording(moved):
    feed = taken(moved, 1e9)
    live = feed.recording(0.0)
    assert len(live) == feed.states.written and not live.effort[:, 1].any() and live.effort[:, 0].std() > 0.1
    feed.states.close()


@pytest.mark.parametrize("batch", [500, 170])
def test_learning_begins_anew_where_an_effort_comes_late(moved, batch, monkeypatch):
    monkeypatch.setattr("bdnn_ros.online.trainer.BATCH", batch)
    here, there = Channel.pair()
    trainer = Trainer(Channel(there))
    told = []
    monkeypatch.setattr(trainer, "say", told.append)
    states = taken(moved, LATE).states
    info = {"urdf": ARM.urdf, "joints": list(ARM.joints), "start": 0, "kept": 0, "number": 3, "epoch": 0}
    info |= {"training": True, **Settings(diagnosis_period=0.0).for_trainer()}
    trainer._begin(Message("begin", info, {}, (os.dup(states.descriptor),)))
    while trainer._learn():
        pass
    trainer._finish()
    numbers = [message.info["number"] for message in told if message.kind == "version"]
    assert numbers == sorted(set(numbers)) and numbers[0] > 3  # counted on
    assert trainer.learning.identifier.samples == round(RATE * 10.0)
    assert not [
        message for message in told if message.kind == "findings"
    ]  # nothing about the robot has changed
    q = np.array([0.3, -0.5])
    model = trainer.learning.served.model
    np.testing.assert_allclose(
        model.inverse_dynamics(q, q, q), REAL.inverse_dynamics(q, q, q), rtol=0.03, atol=0.03
    )
    states.close()
    here.close()


def test_what_is_not_measured_is_nan_in_an_estimate(moved):
    feed = taken(moved, 1e9)
    instant = Smoother().newest(feed, 1.0 / RATE)
    parts = Served(nominal(ARM), 0, 0.0).parts(instant.position, instant.velocity, instant.acceleration)
    message = estimate_message(ARM.joints, instant, parts, 0)
    assert np.isnan(message.effort_measured).tolist() == [False, True]
    assert (
        list(
            estimate_message(
                ARM.joints, replace(instant, effort=np.full(2, np.nan)), parts, 0
            ).effort_measured
        )
        == []
    )
    feed.states.close()


def test_the_error_of_a_joint_begins_with_its_effort():
    error, estimated = ErrorNow(), np.array([1.0, 2.0])
    for k in range(100):
        measured = np.array([np.sin(k), np.nan if k < 50 else np.cos(k)])
        error.add(10**18 + k * 10_000_000, measured, estimated)
        begins = k in (0, 50)  # of one instant nobody knows whether its effort changes
        assert np.isnan(error.nrmse).tolist() == [begins, k <= 50]
