"""What a trainer says where nothing can be learned, and that it goes on; without a process or ROS."""

from __future__ import annotations

import os
import select
import threading
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from live_support import motion, real_robot

from bdnn_ros.errors import UpdateRejected, UsageError
from bdnn_ros.online import learning
from bdnn_ros.online.channel import Channel, Message
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.online.learning import Learning
from bdnn_ros.online.serving import Settings
from bdnn_ros.online.session import Session
from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.online.trainer import Trainer
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm2")
REAL = real_robot(ARM)


class Beside:
    """A session and a trainer in one process, which works when told to."""

    def __init__(self, cutoff: float) -> None:
        self.session = Session(Settings(cutoff=cutoff, capacity=4000, diagnosis_period=0.0))
        self.session.set_robot(ARM)
        self.session.begin(ARM.joints)
        here, there = Channel.pair()
        self.here, self.trainer = here, Trainer(Channel(there))
        self.begin()

    def begin(self) -> None:
        (message,) = self.session._introduce()
        self.trainer._begin(replace(message, descriptors=tuple(os.dup(d) for d in message.descriptors)))

    def send(self, recording: Recording, start: int) -> None:
        assert self.session.intake is not None
        for row, moment in enumerate(recording.time):
            stamp = start + round(moment * 1e9)
            fields = (recording.position[row], recording.velocity[row], recording.effort[row])
            self.session.intake.take(list(recording.joints), *fields, stamp, stamp)

    def learn(self) -> list[Message]:
        """What the trainer says of all that came; the session hears it."""
        heard, over = list[Message](), threading.Event()

        def listen() -> None:
            while not over.is_set() or select.select([self.here], [], [], 0.0)[0]:
                if select.select([self.here], [], [], 0.01)[0]:
                    heard.append(self.here.receive())

        # a trainer waits while nobody reads what it says
        listening = threading.Thread(target=listen)
        listening.start()
        try:
            while self.trainer._learn():
                pass
        finally:
            over.set()
            listening.join()
        for message in heard:
            self.session._hear(message)
        return heard


@pytest.fixture
def beside(request: pytest.FixtureRequest) -> Iterator[Beside]:
    made = Beside(cutoff=getattr(request, "param", 100.0))
    yield made
    made.here.close()
    made.session.stop()


def test_a_cutoff_that_the_rate_does_not_allow_is_told_once(beside):
    """Learning stands still, the trainer lives; a reset, once the stream is faster, has it learn."""
    with pytest.raises(UsageError, match="does not fit"):
        list(Learning(ARM, 100.0).take(*_columns(motion(REAL, 2.0, 100.0))))
    beside.send(motion(REAL, 3.0, 100.0), 10**12)
    assert [message.kind for message in beside.learn()] == ["begun", "trouble"]
    told = beside.session.counts.trouble
    assert (
        told.startswith("A cut-off of 100 Hz does not fit") and "Choose up to 16" in told and "reset" in told
    )
    beside.send(motion(REAL, 3.0, 100.0), 10**12 + 10**10)
    assert beside.learn() == [] and beside.session.counts.trouble == told
    ring = beside.session.intake.ring
    assert ring.consumed == ring.written == 600 and ring.silence < 5.0
    beside.trainer._set_training(Message("training", {"on": False}))
    beside.trainer._set_training(Message("training", {"on": True}))
    beside.session.reset()
    beside.begin()
    beside.send(motion(REAL, 3.0, 400.0), 10**12 + 10**11)
    kinds = [message.kind for message in beside.learn()]
    assert kinds[0] == "begun" and "version" in kinds and "trouble" not in kinds
    assert beside.session.counts.trouble == "" and beside.session.served.number > 0


def test_the_trouble_is_told_at_the_end_of_a_short_stream_too(beside):
    beside.send(motion(REAL, 0.5, 100.0), 10**12)
    beside.learn()
    beside.trainer._set_training(Message("training", {"on": False}))
    assert [message.kind for message in beside.learn()] == ["trouble"]


def test_a_stream_that_slows_down_is_left_out_until_it_is_fast_again():
    """At 20 Hz the low-pass that suited 250 Hz does not fit: no reason to end the learning."""
    learning = Learning(ARM)
    end = 0.0
    numbers = []
    for duration, rate in ((4.0, 250.0), (20.0, 20.0), (10.0, 250.0)):
        time, position, effort = _columns(motion(REAL, duration, rate))
        versions = list(learning.take(end + time, position, effort))
        numbers.append(len(versions))
        end += time[-1] + 1.0 / rate
    assert numbers[0] >= 2 and numbers[2] >= 5
    assert 300 < learning.identifier.stream.left_out < 500


def test_a_stream_that_is_slower_after_a_pause_is_learned_from():
    """Nobody asked for the cut-off that suited it before."""
    learning = Learning(ARM)
    list(learning.take(*_columns(motion(REAL, 6.0, 250.0))))
    time, position, effort = _columns(motion(REAL, 12.0, 15.0, seed=1))
    assert list(learning.take(100.0 + time, position, effort))
    assert learning.identifier.stream.left_out == 0


@pytest.mark.parametrize(
    ("step", "error"),
    [
        ("_take_for", UpdateRejected("The identified parameters are not finite.")),
        ("_choose", np.linalg.LinAlgError("Singular matrix")),
    ],
)
def test_learning_goes_on_where_terms_cannot_be_chosen(beside, monkeypatch, step, error):
    """It ended the trainer; the update is rejected, and terms are chosen once there is more motion."""
    done, calls = getattr(Identifier, step), []

    def failing(*arguments):
        calls.append(arguments)
        if len(calls) == 1:
            raise error
        return done(*arguments)

    monkeypatch.setattr(Identifier, step, failing)
    monkeypatch.setattr(learning, "SETTLE_AT", 4)
    beside.session.settings = replace(beside.session.settings, cutoff=None)
    beside.begin()
    beside.send(motion(REAL, 12.0, 100.0), 10**12)
    heard = beside.learn()
    assert [message.info["reason"] for message in heard if message.kind == "rejected"][:1] == [str(error)]
    assert len(calls) > 1 and beside.session.counts.updates_rejected > 0
    after = [message.kind for message in heard][[message.kind for message in heard].index("rejected") :]
    assert after.count("version") > 3


@pytest.mark.parametrize("beside", [10.0], indirect=True)
def test_after_a_reset_nothing_was_missed_yet(beside):
    """The count came back with the next version."""
    beside.send(motion(REAL, 20.0, 250.0), 10**12)  # 5000 samples at once, where 4000 are kept
    beside.learn()
    assert beside.session.counts.overrun > 900
    beside.session.reset()
    beside.begin()
    beside.send(motion(REAL, 4.0, 250.0), 10**12 + 30 * 10**9)
    (*_, last) = (message for message in beside.learn() if message.kind == "version")
    assert last.info["missed"] == 0 and beside.session.counts.overrun == 0


def _columns(recording: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return recording.time, recording.position, recording.require_effort()


@pytest.mark.parametrize("beside", [5.0], indirect=True)
def test_what_takes_long_is_no_silence(beside, monkeypatch):
    """The trainer gives signs of life between the chunks of one batch, too."""
    beats: list[Ring] = []
    monkeypatch.setattr("bdnn_ros.online.trainer.BATCH", 500)
    monkeypatch.setattr(Ring, "beat", lambda ring: beats.append(ring))
    beside.begin()
    beside.send(motion(REAL, 4.5, 100.0), 10**18)
    assert beside.trainer._learn() and len(beats) >= 1 + 3


@pytest.mark.parametrize("wrong", [{"urdf": "<robot/>"}, {"resume": {"joints": list(ARM.joints)}}])
def test_a_start_that_cannot_be_is_told_and_leaves_nothing_open(beside, wrong):
    """The stream before goes on, and the trainer lives."""
    beside.learn()
    (message,) = beside.session._introduce()
    handed = tuple(os.dup(d) for d in message.descriptors)
    learning = beside.trainer.learning
    beside.trainer._begin(replace(message, info=message.info | wrong, descriptors=handed))
    assert [told.kind for told in beside.learn()] == ["trouble"]
    assert beside.trainer.learning is learning
    for descriptor in handed:
        with pytest.raises(OSError):
            os.fstat(descriptor)
