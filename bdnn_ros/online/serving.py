"""The settings of a live session, the model in service, and counts of the trainer."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from bdnn_ros.efforts import EffortConvention
from bdnn_ros.models import Model
from bdnn_ros.online.channel import Message
from bdnn_ros.online.estimate import Parts, parts
from bdnn_ros.online.order import places
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import prior
from bdnn_ros.robot import Robot

COMMANDED, MEASURED = "command", "measured"
LEARNED_HERE = "this stream"
"""Origin of what was learned from the stream."""


@dataclass(frozen=True)
class Settings:
    """The settings of a session, fixed at its start.

    Attributes:
        effort_source: "measured" takes the joint states' effort, "command" the effort commands.
        effort_factors: what efforts are multiplied by, `JOINT=FACTOR` each, or one `FACTOR` for all others.
        add_gravity: efforts leave out what the controller adds for gravity; the description's is added.
        cutoff: of the low-pass [Hz], None chooses by rate.
        capacity: joint states that are kept.
        niceness: how much the trainer yields to other processes, 0 to 19.
        diagnosis_period: stream time between diagnoses [s], 0 for none but those asked for.
        diagnosis_window: stream time each looks back [s].
    """

    effort_source: str = MEASURED
    effort_factors: tuple[str, ...] = ()
    add_gravity: bool = False
    cutoff: float | None = None
    capacity: int = 131072
    niceness: int = 10
    diagnosis_period: float = 30.0
    diagnosis_window: float = 60.0

    def for_trainer(self) -> dict[str, Any]:
        """The part that the trainer needs."""
        return {
            "effort_factors": self.effort_factors,
            "add_gravity": self.add_gravity,
            "cutoff": self.cutoff,
            "diagnosis_period": self.diagnosis_period,
            "diagnosis_window": self.diagnosis_window,
        }

    def convention(self, robot: Robot) -> EffortConvention:
        """The effort convention for a robot, or for some of its joints.

        Raises:
            UsageError: a factor is malformed.
        """
        ours = [
            rule for rule in self.effort_factors if "=" not in rule or rule.rpartition("=")[0] in robot.joints
        ]
        return EffortConvention.of(ours, robot.joints, replace(robot) if self.add_gravity else None)


@dataclass(frozen=True)
class Served:
    """The model in service, for one thread at a time: models keep working memory.

    Attributes:
        model: any model of the robot, in the order of joints in which it was identified.
        number: its version; 0 is the robot description.
        since: when it took over, `time.monotonic()` [s].
        samples: samples it has learned from.
        origin: where it is from, for messages.
        joints: the order of what is asked and answered; the model's own where nothing is said.
    """

    model: Model
    number: int
    since: float
    samples: int = 0
    origin: str = "robot description"
    joints: tuple[str, ...] = ()
    _turn: threading.Lock = field(default_factory=threading.Lock, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.joints:
            object.__setattr__(self, "joints", tuple(self.model.joints))

    @property
    def learned(self) -> bool:
        """Whether it was learned from the stream, not only loaded or described."""
        return self.origin == LEARNED_HERE

    @cached_property
    def _there(self) -> np.ndarray:
        return places(self.model.joints, self.joints)

    @cached_property
    def _back(self) -> np.ndarray:
        return places(self.joints, self.model.joints)

    def parts(self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> Parts:
        """As `estimate.parts`."""
        there = self._there
        with self._turn:
            told = parts(self.model, position[there], velocity[there], acceleration[there])
        return told if self.joints == self.model.joints else told.arranged(self._back)

    def forward_dynamics(self, position: np.ndarray, velocity: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """Acceleration, (n,) [rad/s²]."""
        there = self._there
        with self._turn:
            told = self.model.forward_dynamics(position[there], velocity[there], effort[there])
        return np.asarray(told[self._back])


@dataclass
class Counts:
    """What the trainer has reported.

    Attributes:
        updates_rejected, reason: updates that did not pass the checks, and why the last one did not.
        overrun: samples that were overwritten before they were learned from.
        trouble: why nothing can be learned; empty if it can.
        unlike: how the stream and the robot description differ, by the last diagnosis; empty if they go together.
        repeated: samples of each joint, where there are any, that were left out since its drive repeats its last reading.
    """

    updates_rejected: int = 0
    reason: str = ""
    overrun: int = 0
    trouble: str = ""
    unlike: str = ""
    repeated: dict[str, int] = field(default_factory=dict)

    def heed(self, message: Message) -> None:
        """Update the counts from a message of the trainer."""
        info = message.info
        if message.kind == "version":
            self.overrun = int(info["missed"])
        elif message.kind == "begun":
            self.trouble = ""
        elif message.kind == "trouble":
            self.trouble = str(info["reason"])
        elif message.kind == "rejected":
            self.updates_rejected, self.reason = self.updates_rejected + 1, str(info["reason"])
        elif message.kind == "repeated":
            self.repeated = dict(info["samples"])


def nominal(robot: Robot) -> PhysicalModel:
    """The robot description as a model, with the prior uncertainty before any motion."""
    return PhysicalModel(robot, np.zeros(robot.width), prior(robot).covariance, np.zeros(robot.width))
