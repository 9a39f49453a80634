"""What is said where a diagnosis fails, without a trainer's process."""

from __future__ import annotations

import queue
from typing import Any

from bdnn_ros.errors import RecordingError
from bdnn_ros.online.analysis import Analyst
from bdnn_ros.online.channel import Message
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm2")
BEGUN = {"epoch": 3, "diagnosis_period": 0.0, "diagnosis_window": 0.0, "kept": 0, "start": 0}


class Broken:
    """A stream whose recording fails in one way after the other."""

    def __init__(self, *errors: Exception) -> None:
        self.errors = list(errors)

    def latest_time(self) -> float:
        return 1.0

    def recording(self, seconds: float) -> Any:
        raise self.errors.pop(0)


def test_every_question_is_answered_whatever_fails(capfd):
    said: queue.Queue[Message] = queue.Queue()
    analyst = Analyst(said.put)
    analyst.begin(ARM, Broken(ValueError("on purpose"), MemoryError(), RecordingError("No motion.")), BEGUN)
    for number in (1, 2, 3):
        analyst.ask(0.0, number)
    told = [said.get(timeout=5.0).info for _ in range(3)]
    assert [info["request"] for info in told] == [1, 2, 3] and all(info["epoch"] == 3 for info in told)
    errors = [info["error"] for info in told]
    assert errors == [
        "The diagnosis failed (ValueError).",
        "The diagnosis failed (MemoryError).",
        "No motion.",
    ]
    assert "on purpose" in capfd.readouterr().err
