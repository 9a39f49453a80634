"""Most joint states are of no use: /diagnostics says why, whose fault it is, and what to do."""

from __future__ import annotations

from unittest.mock import MagicMock

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from bdnn_ros.nodes.diagnostics import Reporter
from bdnn_ros.nodes.error_now import ErrorNow
from bdnn_ros.nodes.publishing import Publishing
from bdnn_ros.online.channel import Message
from bdnn_ros.online.serving import Settings
from bdnn_ros.online.session import Session
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm2")
MS = 1_000_000
NAN = float("nan")


class Alive:
    """Stands in for the supervisor."""

    alive, restarts, trouble = True, 0, ""

    def send(self, message):
        pass

    def stop(self, patience):
        pass


class Stream:
    """A session that hears, and its reporter."""

    def __init__(self, settings=None, **others):
        self.session = Session(settings or Settings(), **others)
        self.session.supervisor = Alive()
        self.session.set_robot(ARM)
        self.session.begin(ARM.joints)
        self.logged: list[str] = []
        self.reporter = Reporter(self.session, self.logged.append, "/n")
        self._count = 0

    def status(
        self, messages=100, bad=100, effort=(1.0, 2.0), position=(0.1, 0.2), step=MS, names=ARM.joints
    ):
        """After so many messages, the last `bad` of them with these numbers."""
        for k in range(messages):
            self._count += 1
            stamp = 10**18 + self._count * MS
            if k < messages - bad:
                self.session.intake.take(list(ARM.joints), (0.1, 0.2), (), (1.0, 2.0), stamp, stamp)
            else:
                stamp = stamp if step else 10**18
                self.session.intake.take(list(names), position, (), effort, stamp, stamp)
        told = self.reporter.status(ErrorNow(), True, "", 0)
        return told.level, told.message


@pytest.fixture
def stream():
    made = Stream()
    yield made
    made.session.stop()


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"effort": (1.0, NAN)}, f"The effort of {ARM.joints[1]} is not finite in most joint states"),
        ({"position": (NAN, 0.2)}, f"The position of {ARM.joints[0]} is not finite"),
        ({"effort": (1e13, 1.0)}, f"The effort of {ARM.joints[0]} is beyond 1e+12"),
        ({"effort": (1.0, 2.0, 3.0)}, "their lists are not as long as their names"),
        (
            {"names": (*ARM.joints, ARM.joints[1]), "position": (0.1, 0.2, 0.2), "effort": (1.0, 2.0, 2.0)},
            f"they name {ARM.joints[1]} twice",
        ),
        ({"step": 0}, "their stamps repeat or go back"),
        ({"effort": ()}, "Most joint states carry no effort"),
        ({"effort": (NAN, NAN)}, "Most joint states carry no effort"),
    ],
)
def test_why_most_joint_states_are_of_no_use_is_told_and_logged_once(stream, fields, said):
    assert stream.status(bad=0) == (DiagnosticStatus.OK, "training")
    for _ in range(3):
        level, message = stream.status(bad=60, **fields)
        assert level == DiagnosticStatus.WARN and said in message and message.count(". ") == 1
    assert len(stream.logged) == 1 and said in stream.logged[0]
    assert stream.status(bad=40, **fields) == (DiagnosticStatus.OK, "training")


def test_a_joint_without_effort_is_named_and_its_error_is_none(stream):
    stream.status(messages=10_100, bad=10_100, effort=(1.0, NAN))
    told = ErrorNow()
    told.add(10**18, np.array([1.0, NAN]), np.array([1.5, 2.0]))
    told.add(10**18 + MS, np.array([2.0, NAN]), np.array([2.5, 2.0]))
    values = {pair.key: pair.value for pair in stream.reporter.status(told, True, "", 0).values}
    assert values["joints_without_effort"] == ARM.joints[1]
    assert values[f"effort_nrmse_{ARM.joints[1]}"] == "nan"
    assert values["effort_nrmse"] == values[f"effort_nrmse_{ARM.joints[0]}"] != "nan"
    assert f"No effort comes for {ARM.joints[1]}" in stream.logged[-1]
    assert stream.status(effort=(1.0, NAN)) == (DiagnosticStatus.OK, "training")


def test_a_joint_whose_effort_never_changes_is_named_too(stream):
    for k in range(120):
        stream.status(effort=(1.0 + 0.1 * k, 0.0), position=(0.01 * k, 0.2))
    values = {pair.key: pair.value for pair in stream.reporter.status(ErrorNow(), True, "", 0).values}
    assert values["joints_without_effort"] == ARM.joints[1]
    (said,) = stream.logged
    assert f"The effort of {ARM.joints[1]} never changes" in said


def test_the_error_of_an_instant_is_noted_of_the_joints_that_have_an_effort(stream):
    stream.status(messages=11_000, bad=11_000, effort=(1.0, NAN))
    publishing = Publishing(MagicMock(), stream.session)
    publishing.compare()
    assert publishing._error._open.known.tolist() == [True, False]


def test_a_description_that_was_refused_is_told_of_beside_the_rest(stream):
    stream.status(bad=0)
    told = stream.reporter.status(ErrorNow(), True, "", 0, refused="No.")
    assert (told.level, told.message) == (DiagnosticStatus.WARN, "No.")
    stream.status(bad=0)
    stream.session.intake.received += 100
    stream.session.intake.rejected["effort_missing"] += 100
    message = stream.reporter.status(ErrorNow(), True, "", 0, refused="No.").message
    assert message.startswith("No. Most joint states carry no effort")


def test_a_buffer_too_small_for_the_low_pass_is_told_of():
    stream = Stream(Settings(cutoff=1.0, capacity=1000))
    stream.status(messages=600, bad=0)
    assert stream.session.instant() is None
    level, message = stream.status(messages=600, bad=0)
    assert level == DiagnosticStatus.WARN and message.startswith(
        "buffer_size keeps 999 joint states, and the"
    )
    needed = int(message.split("needs ")[1].split(":")[0])
    stream.session.stop()
    stream = Stream(Settings(cutoff=1.0, capacity=needed + 1))
    stream.status(messages=needed, bad=0)
    assert stream.session.instant() is not None
    assert stream.status(bad=0) == (DiagnosticStatus.OK, "training") and not stream.logged
    stream.session.stop()


def test_a_parameter_of_joints_without_the_culprit_helps(stream):
    assert "set the parameter joints" in stream.status(effort=(1.0, NAN))[1]
    stream.session.begin(ARM.joints[:1])
    assert stream.status(effort=(1.0, NAN)) == (DiagnosticStatus.OK, "training")


def test_who_does_not_learn_misses_no_effort():
    stream = Stream(training=False)
    assert stream.status(effort=())[0] == DiagnosticStatus.OK
    assert stream.status(effort=(1.0, NAN))[0] == DiagnosticStatus.WARN
    stream.session.stop()


def test_a_drive_that_repeats_itself_is_told_while_it_does_and_counted(stream, monkeypatch):
    told = {"samples": {ARM.joints[1]: 40}, "epoch": stream.session._course.epoch}
    stream.session._hear(Message("repeated", told | {"epoch": told["epoch"] - 1}))
    assert stream.status(bad=0) == (DiagnosticStatus.OK, "training")  # of a stream that was given up
    stream.session._hear(Message("repeated", told))
    level, message = stream.status(bad=0)
    assert level == DiagnosticStatus.WARN
    assert f"{ARM.joints[1]} repeated the last reading while the robot moved" in message
    assert stream.logged[-1] in message
    monkeypatch.setattr("bdnn_ros.nodes.diagnostics.PERSISTENCE", 0.0)
    assert stream.status(bad=0) == (DiagnosticStatus.OK, "training")
    values = stream.reporter.status(ErrorNow(), True, "", 0).values
    assert {one.key: one.value for one in values}[f"samples_repeated_{ARM.joints[1]}"] == "40"
