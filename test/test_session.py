"""What a session keeps and gives up where another model is loaded, without a trainer."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bdnn_cases import black_box, scales

from bdnn_ros.diagnosis.judging.attempt import EVERY_TEST_BLOCK
from bdnn_ros.diagnosis.recorded.excerpts import ENOUGH, SHORTEST, refuse_short
from bdnn_ros.diagnosis.regression.building import BLOCK_SECONDS
from bdnn_ros.errors import RecordingError
from bdnn_ros.models import save_model
from bdnn_ros.online.channel import Message
from bdnn_ros.online.serving import Counts, Settings, nominal
from bdnn_ros.online.session import Session
from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.online.stream.feed import Feed
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm2")
OTHER = Robot.from_urdf(ARM.urdf.replace("<robot", "<!-- new --><robot", 1))
MS = 1_000_000


@pytest.fixture
def session() -> Iterator[Session]:
    session = Session(Settings(capacity=4000))
    session.set_robot(ARM)
    session.begin(ARM.joints)
    yield session
    session.stop()


@pytest.fixture
def models(tmp_path) -> dict[str, Path]:
    return {
        "physical": save_model(tmp_path / "physical", nominal(ARM)),
        "networks": save_model(tmp_path / "networks", black_box(ARM.joints, scales(2), hidden=4)),
    }


def introduced(session: Session) -> dict[str, Any]:
    """What a trainer is told last."""
    (message,) = session._introduce()
    return message.info


def send(session: Session, count: int) -> None:
    assert session.intake is not None
    first = 1000 + session.intake.ring.written
    for k in range(first, first + count):
        session.intake.take(list(ARM.joints), [0.1, 0.2], [], [1.0, 2.0], k * MS, k * MS)


@pytest.mark.parametrize("remedy", ["load", "reset", "description"])
def test_training_comes_back_after_a_model_it_cannot_go_on_from(session, models, remedy):
    session.load_now(models["networks"])
    assert session.training and not session.learning and not introduced(session)["training"]
    session.set_training(True)
    assert not session.learning
    if remedy == "load":
        session.load_now(models["physical"])
        assert "resume" in introduced(session)
    elif remedy == "reset":
        session.reset()
    else:
        session.set_robot(OTHER)
    assert session.learning and introduced(session)["training"]


@pytest.mark.parametrize("begun", [True, False])
def test_a_model_of_another_description_is_not_gone_on_from(models, begun):
    """The description that serves is believed, not how sure a model was of the one before."""
    session = Session(Settings(capacity=4000))
    session.set_robot(ARM)
    if begun:
        session.begin(ARM.joints)
    session.load_now(models["physical"])
    session.set_robot(OTHER)
    if not begun:
        session.begin(ARM.joints)
    assert "resume" not in introduced(session)
    session.stop()


def test_training_that_was_switched_off_stays_off(session, models):
    session.set_training(False)
    for model in models.values():
        session.load_now(model)
        assert not session.training and not introduced(session)["training"]
    session.reset()
    assert not introduced(session)["training"]
    session.set_training(True)
    assert introduced(session)["training"]


@pytest.mark.parametrize("anew", ["reset", "description", "joints"])
def test_what_was_counted_of_the_robot_before_is_forgotten(session, anew):
    """A corrected description answered, and /diagnostics went on saying what was wrong with the one before."""
    told = {"request": 0, "epoch": session._course.epoch, "error": "The wrong sign.", "unlike": True}
    session._hear(Message("findings", told))
    session._hear(Message("rejected", {"reason": "errs"}))
    assert session.counts.unlike and session.counts.updates_rejected == 1
    if anew == "reset":
        session.reset()
    elif anew == "description":
        session.set_robot(OTHER)
    else:
        session.begin(ARM.joints[:1])
    assert session.counts == Counts() and session.forgotten == 1


def learned(session: Session, number: int) -> None:
    """As if a trainer had handed over a version that has seen all samples so far."""
    arrays, info = nominal(ARM).to_state()
    told = {"kind": "physical", "model": info, "number": number, "samples": 1, "missed": 0}
    told |= {"end": session._written, "epoch": session._course.epoch}
    session._hear(Message("version", told, arrays))
    assert session.served is not None and session.served.number == number


@pytest.mark.parametrize("lost", ["meanwhile", "afterwards"])
def test_what_came_while_training_was_paused_is_not_learned_by_a_new_trainer_either(session, lost):
    """It goes on from what was known by then."""
    send(session, 100)
    learned(session, 3)
    session.set_training(True)  # it is on: nothing is left out
    assert introduced(session)["start"] == 0 and "resume" not in introduced(session)
    session.set_training(False)
    send(session, 200)
    if lost == "meanwhile":
        session._hear(Message("lost", {"ran": True}))
        assert not introduced(session)["training"] and introduced(session)["start"] == 300
        assert "resume" in introduced(session) and introduced(session)["number"] == 3
    session.set_training(True)
    send(session, 50)
    told = introduced(session)
    assert told["training"] and told["start"] == 300 and told["number"] == 3 and "resume" in told
    assert told["kept"] == 0  # it can be diagnosed
    learned(session, 4)
    session.reset()
    assert introduced(session)["start"] == 350 and "resume" not in introduced(session)


def test_a_trainer_that_ends_waits_for_what_is_being_changed(session):
    """Its end was counted for the stream that just began."""
    died = threading.Thread(target=session._hear, args=(Message("lost", {"ran": True}),))
    with session._turn:
        died.start()
        died.join(0.1)
        assert died.is_alive() and session._course._deaths == 0
    died.join()
    assert session._course._deaths == 1


def test_a_pause_before_anything_was_learned_leaves_the_robot_description(session):
    session.set_training(False)
    send(session, 200)
    session.set_training(True)
    assert introduced(session)["start"] == 200 and "resume" not in introduced(session)


def test_what_came_before_a_model_was_loaded_can_be_diagnosed(session, models):
    send(session, 300)
    for model in models.values():
        session.load_now(model)
    assert introduced(session)["start"] == 300 and introduced(session)["kept"] == 0
    session.reset()
    assert introduced(session)["start"] == introduced(session)["kept"] == 300
    send(session, 50)
    session.load_now(models["physical"])
    assert introduced(session)["start"] == 350 and introduced(session)["kept"] == 300


def test_a_velocity_that_a_driver_only_fills_in_is_none_of_a_recording():
    def fed(velocity, missing=()):
        states = Ring.create(1000, 6)
        for k in range(200):
            said = [np.nan, velocity[1]] if k in missing else velocity
            states.slot()[:] = [0.001 * k, 0.002 * k, *said, 1.0, 1.0]
            states.commit(k * MS, k * MS, k * MS)
        recording = Feed(ARM.joints, states).recording(0.0)
        states.close()
        return recording

    assert fed([0.0, 0.0]).velocity is None and "no velocity is reported" in fed([0.0, 0.0]).notes[0]
    for absent in (0.0, np.nan):  # that of the other joint is kept
        half = fed([absent, 2.0])
        assert half.velocity == pytest.approx(np.tile([1.0, 2.0], (200, 1)))
        assert ARM.joints[0] in half.notes[0]
    assert fed([5.0, 2.0], missing=(3, 7)).velocity == pytest.approx(np.tile([1.0, 2.0], (200, 1)))
    assert fed([np.nan, np.nan]).velocity is None and not fed([np.nan, np.nan]).notes


def test_a_tiny_window_holds_the_newest_sample(session):
    """It blamed the driver, which was said to send no effort."""
    send(session, 3000)
    for window, count in ((0.0, 3000), (1e-9, 1), (1e-300, 1)):
        recording = session._feed.recording(window)
        assert len(recording) == count
        with pytest.raises(
            RecordingError, match=r"live stream: \d.0 s of motion are too short for a diagnosis"
        ):
            refuse_short([recording])
    assert SHORTEST == (EVERY_TEST_BLOCK - 1) * BLOCK_SECONDS <= ENOUGH


def test_a_feed_gives_what_is_kept():
    states = Ring.create(1000, 6)
    for k in range(100):
        states.slot()[:] = float(k)
        states.commit(k * MS, k * MS, 1000 * MS + k * MS)
    feed = Feed(ARM.joints, states, start=100, kept=40)
    assert len(feed.read(1000)) == 0
    assert feed.recording(0.0).position[0].tolist() == [40.0, 40.0] and len(feed.recording(0.0)) == 60
    assert len(feed.recording(0.01)) == 10
    assert (
        len(feed.recording(1e6)) == len(feed.recording(1e300)) == 60
    )  # a day's nanoseconds, and no number's
    with pytest.raises(RecordingError, match="has come since what was learned was forgotten"):
        Feed(ARM.joints, states, start=100).recording(0.0)
    states.close()
