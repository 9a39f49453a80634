"""Effort commands in a bag, for use in place of measured efforts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.bags.cdr import MalformedMessage, decode_float64_multi_array
from bdnn_ros.bags.joint_states import Samples
from bdnn_ros.bags.storage import MULTI_ARRAY, Topic
from bdnn_ros.efforts import COMMAND_AGE, in_force
from bdnn_ros.errors import BagError, RecordingError, UsageError, listed


def commands_among(topics: Sequence[Topic]) -> list[str]:
    """Names of the topics that may carry effort commands."""
    return [t.name for t in topics if t.type == MULTI_ARRAY and t.count]


class Commands:
    """Effort commands with the times at which they were recorded.

    Attributes:
        malformed: why messages are left out that cannot be decoded, one each.
    """

    def __init__(self, name: str, topic: str | None, available: Sequence[Topic]) -> None:
        suitable = commands_among(available)
        if topic is None and len(suitable) == 1:
            topic = suitable[0]
        if topic not in suitable:
            raise _not_there(name, topic, suitable)
        self.name = name
        self.topic: str = str(topic)
        self._logs: list[int] = []
        self._values: list[np.ndarray] = []
        self.malformed: list[MalformedMessage] = []

    def add(self, log: int, data: bytes) -> None:
        """Add one message: its log time [ns] and its bytes."""
        try:
            values = decode_float64_multi_array(data)
        except MalformedMessage as error:
            self.malformed.append(error)
            return
        self._values.append(values)
        self._logs.append(log)

    def checked(self) -> list[str]:
        """Notes on messages that could not be decoded, after all were added: one sentence or none.

        Raises:
            BagError: no message can be decoded.
        """
        if not self.malformed:
            return []
        first = self.malformed[0]
        why = first.problem.rstrip(".")
        if not self._values:
            raise BagError(f"{self.name}: no message on {self.topic} can be decoded ({why}).", first.remedy)
        every = len(self.malformed) + len(self._values)
        return [
            f"{self.name}: {len(self.malformed)} of {every} commands on {self.topic} cannot be decoded ({why}); left out."
        ]

    @property
    def _widths(self) -> set[int]:
        return {len(values) for values in self._values}

    def recorded(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """Log times [ns], (M,) in order, and the values of each command, (k,)."""
        logs = np.array(self._logs, np.int64)
        order = np.argsort(logs, kind="stable")
        return logs[order], [self._values[k] for k in order]

    def stand_for(self, joints: int) -> bool:
        """Whether most commands have one value for each of this many joints."""
        return 2 * sum(len(values) == joints for values in self._values) > len(self._values)

    def aligned(
        self, samples: Samples, orders: Sequence[tuple[str, ...]], every: bool = False
    ) -> tuple[Samples, list[str]]:
        """The samples with the command in force at each of them as effort; samples without one are dropped.

        The few commands whose length differs from most are ignored, as in the node.

        Args:
            orders: joint names the commands may stand for, the likeliest first.
            every: leave out no sample; the effort where no command is in force is NaN.

        Raises:
            RecordingError: the commands stand for other joints, or none is in force at any sample.
        """
        fitting = [names for names in orders if self.stand_for(len(names)) and {*samples.joints} <= {*names}]
        if not fitting:
            raise RecordingError(
                f"{self.name}: the commands on {self.topic} have {listed(sorted(self._widths))} values, "
                f"the joints chosen are {listed(samples.joints, 20)}.",
                "Name the joints of the commands in their order with --joints.",
            )
        columns = [fitting[0].index(joint) for joint in samples.joints]
        logs, recorded = self.recorded()
        whole = np.array([len(values) == len(fitting[0]) for values in recorded])
        values = np.array([recorded[k] for k in np.flatnonzero(whole)])[:, columns]
        latest, rows = in_force(samples.log, logs[whole])
        notes = [f"{self.name}: effort is commanded on {self.topic}, in the order {listed(fitting[0], 20)}."]
        if not whole.all():
            notes.append(
                f"{self.name}: {np.count_nonzero(~whole)} of {len(whole)} commands on {self.topic} do not have "
                f"{len(fitting[0])} values; left out."
            )
        if not rows.any() and not every:
            raise RecordingError(
                f"{self.name}: no joint state was recorded within {COMMAND_AGE:g} s after a command on {self.topic}.",
                "Record both topics together, or use --effort measured.",
            )
        if not rows.all():
            notes.append(
                f"{self.name}: {np.count_nonzero(~rows)} samples before the first command, or more than "
                f"{COMMAND_AGE:g} s after one, {'have no effort' if every else 'are left out'}."
            )
        if every:
            return replace(samples, effort=np.where(rows[:, None], values[latest], np.nan)), notes
        return replace(samples.part(rows), effort=values[latest[rows]]), notes


def _not_there(name: str, topic: str | None, suitable: Sequence[str]) -> UsageError:
    kind = "effort commands (std_msgs/Float64MultiArray)"
    if not suitable:
        return UsageError(
            f"{name}: the bag has no {kind}.", "Use --effort measured, or record the commands as well."
        )
    if topic is None:
        return UsageError(
            f"{name}: {kind} are on {listed(suitable)}.", "Choose one of them with --effort-commands."
        )
    return UsageError(
        f"{name}: no {kind} on {topic}, but on {listed(suitable)}.",
        f"Choose with --effort-commands {suitable[0]}, or use --effort measured.",
    )
