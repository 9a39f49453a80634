"""How far learning has come in the stream, and where a restarted trainer resumes."""

from __future__ import annotations

from typing import Any

import numpy as np

from bdnn_ros.online.serving import Served
from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.physical.model import PhysicalModel

MOST_DEATHS = 3
"""Trainers that may end over the same samples before these are left out."""


class Course:
    """The progress of learning. A new course (epoch) begins whenever what was learned is discarded.

    Attributes:
        epoch: counts the courses; what a trainer says of another one is out of date.
        start: number of the first sample that a new trainer learns from.
        kept: number of the first sample that is diagnosed.
        resumed: the model that it goes on from; None where that is the robot description.
        trained: number of the first sample that the newest version has not seen.
    """

    def __init__(self) -> None:
        self.epoch = 0
        self.start = self.kept = 0
        self.resumed: PhysicalModel | None = None
        self._number = 0
        self.trained = self._told = self._repeated = 0
        self._deaths = 0

    def begin(
        self, start: int, number: int, resumed: PhysicalModel | None = None, kept: int | None = None
    ) -> None:
        """Start a new course at the sample `start`; versions count on from `number`, diagnoses look back to sample `kept`."""
        self.epoch += 1
        self.start = self.trained = self._told = self._repeated = start
        self.kept = start if kept is None else kept
        self._number, self.resumed = number, resumed
        self._deaths = 0

    def skip(self, written: int, served: Served | None) -> None:
        """Let a new trainer start at the present with the model in service: earlier samples are not all meant for learning."""
        self.start = written
        if served is not None and served.number and isinstance(served.model, PhysicalModel):
            self.resumed, self._number = served.model, served.number

    def _leave_behind(self, written: int, served: Served | None) -> None:
        """As `skip`, and exclude earlier samples from diagnoses, too: trainers keep dying of something in them."""
        self.skip(written, served)
        self.kept = self.trained = written
        self._deaths = 0

    def died(self) -> None:
        """A trainer ended; its successor will process again what this one had seen."""
        self._deaths += 1
        self._repeated = max(self.trained, self._told)

    def advance(self, info: dict[str, Any]) -> bool:
        """Whether a version belongs to this course and has seen more than the one before."""
        if info["epoch"] != self.epoch or info["end"] <= self.trained:
            return False
        self._deaths = 0  # it got over what others may have died of
        self.trained = int(info["end"])
        return True

    def tells(self, info: dict[str, Any]) -> bool:
        """Whether findings belong to this course and are no repetition of what an earlier trainer reported."""
        if info["epoch"] != self.epoch:
            return False
        if "end" not in info:  # a diagnosis
            return True
        self._told = max(self._told, int(info["end"]))
        return int(info["end"]) > self._repeated

    def introduction(
        self, ring: Ring, served: Served | None, training: bool
    ) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """The state that a new trainer starts from, as JSON-able information and arrays.

        Args:
            ring: the stream's joint states.
            served: what answers now.
            training: whether the trainer is to learn already.
        """
        if self._deaths >= MOST_DEATHS:
            self._leave_behind(ring.written, served)
        elif self._deaths and not training:
            self.skip(ring.written, served)
        resumed, start = self.resumed, self.start
        if start < ring.oldest and served is not None and isinstance(served.model, PhysicalModel):
            # what came before is no longer in the ring: go on from what is known of it
            resumed, start = served.model, max(self.trained, ring.oldest)
            self._number = served.number
        info: dict[str, Any] = {
            "start": start,
            "kept": self.kept,
            "number": self._number,
            "epoch": self.epoch,
            "training": training,
        }
        arrays: dict[str, np.ndarray] = {}
        if resumed is not None:
            arrays, info["resume"] = resumed.to_state()
        return info, arrays
