"""What keeps a trainer alive, with a stand-in for the trainer: a process that only answers."""

from __future__ import annotations

import errno
import os
import signal
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest
from live_support import wait_until

from bdnn_ros.errors import DataError
from bdnn_ros.online import supervisor as module
from bdnn_ros.online.channel import Channel, Message
from bdnn_ros.online.course import MOST_DEATHS
from bdnn_ros.online.serving import Settings
from bdnn_ros.online.session import Session
from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.online.supervisor import LOST, Supervisor

ANSWERS = """
import socket, sys
from bdnn_ros.online.channel import Channel, Message
channel = Channel(socket.socket(fileno=int(sys.argv[2])))
channel.send(Message("ready"))
while (message := channel.receive()).kind != "stop":
    if message.kind == "diagnose":
        channel.send(Message("findings", {"request": message.info["request"], "epoch": 0, "error": "nothing"}))
"""


BEGINNING = """
import os, socket, sys, time
import numpy as np
from bdnn_ros.online.channel import Channel, Message
channel = Channel(socket.socket(fileno=int(sys.argv[2])))
channel.send(Message("ready"))
"""
LARGE = """
channel.receive()
channel.send(Message("version", {}, {"covariance": np.ones(1 << 17)}))
channel.send(Message("got", {"sum": channel.receive().arrays["covariance"].sum()}))
channel.receive()
"""
"""Sends one megabyte before it reads on."""
DEAF = "time.sleep(600.0)"
HALF = "os.write(int(sys.argv[2]), bytes(5)); time.sleep(600.0)"


def test_a_terminal_s_signals_are_for_the_node_alone():
    """Sent to all of its session, they broke the trainer off while it was imported, with a traceback."""
    begun = Supervisor(lambda message: None, list, (sys.executable, "-c", ANSWERS))
    begun.start()
    try:
        wait_until(lambda: begun.pid, 10.0)
        assert os.getsid(begun.pid) != os.getsid(0)
    finally:
        begun.stop()


@pytest.mark.parametrize(
    "program, patience, done", [(ANSWERS, 10.0, True), (None, 0.2, False), (ANSWERS, 0.0, False)]
)
def test_a_trainer_has_so_long_to_end(program, patience, done):
    supervisor = Supervisor(
        lambda message: None, list, (sys.executable, "-c", program or f"import time\n{BEGINNING}{DEAF}")
    )
    supervisor.start()
    wait_until(lambda: supervisor.alive)
    assert supervisor.stop(patience) is done and supervisor.pid == 0


@pytest.fixture
def session() -> Iterator[Session]:
    session = Session(Settings())
    session.supervisor = Supervisor(session._hear, session._introduce, (sys.executable, "-c", ANSWERS))
    yield session
    session.stop()


def failing(calls: int, error: OSError, then):
    """A function that fails so many times, and works then."""
    left = [error] * calls

    def call(*arguments, **named):
        if left:
            raise left.pop()
        return then(*arguments, **named)

    return call


@pytest.mark.parametrize("where", ["pair", "spawn"])
def test_a_machine_without_room_is_told_of_and_tried_again(session, monkeypatch, where):
    monkeypatch.setattr(module, "RESTART_PAUSE", (0.1, 0.2))
    calls, supervisor = MOST_DEATHS + 1, session.supervisor
    if where == "pair":
        error = OSError(errno.EMFILE, os.strerror(errno.EMFILE))
        monkeypatch.setattr(Channel, "pair", failing(calls, error, Channel.pair))
    else:
        error = OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))
        monkeypatch.setattr(module.subprocess, "Popen", failing(calls, error, module.subprocess.Popen))
    session.start()
    wait_until(lambda: supervisor.restarts == 2)
    assert error.strerror in supervisor.trouble and not supervisor.alive and supervisor.pid == 0
    wait_until(lambda: supervisor.alive)
    assert supervisor.restarts == calls
    assert session._course._deaths == 0  # it is not the samples' fault: they are learned from all the same


def test_the_trouble_is_not_that_of_an_earlier_trainer(session, monkeypatch):
    supervisor = session.supervisor
    session.start()
    wait_until(lambda: supervisor.alive)
    error = OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))
    monkeypatch.setattr(module.subprocess, "Popen", failing(99, error, None))
    os.kill(supervisor.pid, signal.SIGKILL)
    wait_until(lambda: supervisor.restarts >= 2)
    assert error.strerror in supervisor.trouble and session._course._deaths == 1


def test_an_error_of_the_program_while_hearing_is_printed_and_goes_on(session, monkeypatch, capfd):
    monkeypatch.setattr(session, "_take_note", lambda message: {}["no such key"])
    session.start()
    wait_until(lambda: session.supervisor.alive)
    trainer = session.supervisor.pid
    session.diagnose(0.0)
    wait_until(lambda: "KeyError" in session.supervisor.trouble)
    assert session.supervisor.alive and session.supervisor.pid == trainer
    assert "no such key" in capfd.readouterr().err


def test_a_question_in_the_moment_the_trainer_dies_is_answered(session, monkeypatch):
    """The trainer was alive when it was looked at; all questions have failed before this one is one of them."""
    session.start()
    wait_until(lambda: session.supervisor.alive)
    new, restarts = session._requests.new, session.supervisor.restarts

    def late():
        os.kill(session.supervisor.pid, signal.SIGKILL)
        wait_until(lambda: session.supervisor.restarts > restarts)
        return new()

    monkeypatch.setattr(session._requests, "new", late)
    assert session.diagnose(0.0).result(10.0).info["error"] == "nothing"


def test_a_question_that_dies_with_its_trainer_is_not_asked_of_the_next(session):
    session.start()
    wait_until(lambda: session.supervisor.alive)
    os.kill(session.supervisor.pid, signal.SIGSTOP)
    asked = session.diagnose(0.0)
    os.kill(session.supervisor.pid, signal.SIGKILL)
    with pytest.raises(DataError, match="ended"):
        asked.result(10.0)
    assert not session.supervisor._outbox


@pytest.fixture
def conversation():
    """Starts a supervisor of a stand-in that goes on so; what it hears, and the supervisor."""
    started = []

    def start(program: str, introduction=()) -> tuple[list[Message], Supervisor]:
        heard: list[Message] = []
        command = (sys.executable, "-c", BEGINNING + program)
        supervisor = Supervisor(heard.append, lambda: introduction, command)
        started.append(supervisor)
        supervisor.start()
        return heard, supervisor

    yield start
    for supervisor in started:
        supervisor.stop(1.0)


def large() -> Message:
    return Message("begin", {}, {"covariance": np.ones(1 << 17)})


def test_both_sides_may_send_more_than_a_socket_holds_at_once(conversation):
    heard, supervisor = conversation(LARGE)
    supervisor.send(Message("training"))
    supervisor.send(large())
    wait_until(lambda: [message.kind for message in heard] == ["version", "got"])
    assert heard[-1].info["sum"] == heard[0].arrays["covariance"].sum() == 1 << 17
    assert supervisor.restarts == 0


@pytest.mark.slow
def test_a_trainer_that_hangs_while_it_is_written_to_is_replaced(conversation, monkeypatch):
    monkeypatch.setattr(module, "HANG", 2.0)
    heard, supervisor = conversation(DEAF)
    wait_until(lambda: supervisor.alive)
    supervisor.ring = Ring.create(16, 1)
    supervisor.ring.beat()
    supervisor.send(large())
    wait_until(lambda: supervisor.restarts == 1)
    lost = time.monotonic()
    assert "silent for" in supervisor.trouble and heard[0].kind == LOST
    wait_until(lambda: supervisor.restarts == 2)
    assert time.monotonic() - lost > module.HANG, "the next one has as much time to give a sign of life"


def test_a_message_that_cannot_be_sent_costs_the_trainer_and_no_more(conversation, capfd):
    _, supervisor = conversation(DEAF)
    wait_until(lambda: supervisor.alive)
    supervisor.send(Message("training", {"on": object()}))
    wait_until(lambda: supervisor.restarts == 1)
    wait_until(lambda: supervisor.alive)
    assert "not JSON serializable" in capfd.readouterr().err


def test_a_trainer_that_hangs_in_the_middle_of_a_message_is_replaced(conversation, monkeypatch):
    monkeypatch.setattr(module, "HANG", 1.0)
    _, supervisor = conversation(HALF)
    wait_until(lambda: supervisor.restarts >= 1)
    assert supervisor.trouble == "silent in the middle of a message"


def test_a_ring_that_waits_since_before_the_trainer_was_ready_is_not_sent_beside_the_introduction():
    """It may be given up, and is closed as soon as the trainer has begun with the one that it is introduced to."""
    supervisor = Supervisor(lambda message: None, lambda: (Message("begin", {"epoch": 2}),))
    supervisor.send(Message("begin", {"epoch": 1}, descriptors=(99,)))
    supervisor.send(Message("diagnose"))
    supervisor._acquaint()
    assert [message.kind for message in supervisor._outbox] == ["begin", "diagnose"]
    assert supervisor._outbox[0].info["epoch"] == 2
