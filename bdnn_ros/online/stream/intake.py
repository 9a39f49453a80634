"""From messages to samples: names, lengths, values and stamps are validated without waiting.

Samples are ordered by stamp, not by arrival. Messages that cannot be used are counted by reason and left out.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bdnn_ros.errors import listed
from bdnn_ros.online.stream.assembly import Assembly, Group, Kind, Kinds
from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.online.stream.clock import NONE, SINCE_ZERO, Clock
from bdnn_ros.online.stream.publishers import Holding, Publishers
from bdnn_ros.online.stream.silent import Silent
from bdnn_ros.readings import MOST, credible

BACKWARDS = "stamp_backwards"
NO_STAMP = "stamp_missing"
JOINTS = "joints_missing"
TWICE = "joint_twice"
SECOND = "second_publisher"
LENGTH = "wrong_length"
NOT_FINITE = "not_finite"
OUT_OF_RANGE = "out_of_range"
NO_EFFORT = "effort_missing"
FIELDS = ("position", "velocity", "effort")


class Intake:
    """Writes joint states to a ring as position, velocity, effort (3n numbers, NaN where not measured).

    A sample has the effort of every joint (except those without a sensor) or none. Messages that hold only some of the joints are
    merged (see `Assembly`).

    Attributes:
        joints: n names, the order in the ring.
        kinds: of the messages that came, and how many of each.
        received: samples, and messages with any of the joints that did not become one.
        rejected: messages left out, by reason.
        culprit: whose number made the last of these unusable, as "effort of joint2", or which name comes twice in it;
            empty before the first.
        unstamped: messages whose stamp is zero, and no time, of a driver that gives none; when they were sent stands for it.
        silent: which joints have no sensor for their effort.
        publishers: whose messages are taken where two send the same joints.
    """

    def __init__(self, joints: Sequence[str], ring: Ring, needs_effort: bool = True) -> None:
        self.joints = tuple(joints)
        self.ring = ring
        self.clock = Clock()
        self.kinds = Kinds(joints)
        self.received = 0
        self.rejected: Counter[str] = Counter()
        self.needs_effort = needs_effort
        self.culprit = ""
        self.unstamped = 0
        self.silent = Silent(len(self.joints))
        self.publishers = Publishers()
        self._stamped = False
        self._assembly = Assembly(len(self.joints))
        self._kind = self.kinds.of(())

    def take(
        self, names: Sequence[str], position: Any, velocity: Any, effort: Any, stamp: int, sent: int
    ) -> bool:
        """Write one message to the ring; False if it was left out, or waits for the other joints.

        Args:
            names: joints of the message, any order, others between.
            position, velocity, effort: their numbers (buffers or sequences); the last two may be empty.
            stamp: of the header [ns].
            sent: by the middleware's clock [ns].
        """
        kind = self._kind
        if names != kind.names:
            kind = self._kind = self.kinds.of(names)
        if stamp < 0 or (stamp == 0 and not self.clock.since_zero):
            if kind.group.bare():
                return False if kind.foreign else self._reject(NO_STAMP, NONE)
            self.unstamped += 1
            stamp = sent
        else:
            kind.group.stamped()
            if not self._stamped and stamp < SINCE_ZERO and self.ring.written <= 1:
                self._begin_at_zero()
            self._stamped = True
        kind.group.came(names, effort, stamp)
        if kind.foreign:
            return False
        if kind.unusable:
            self.culprit = next((name for name in names if names.count(name) > 1), "")
            return self._reject(TWICE if names else JOINTS, stamp)
        count = len(names)
        if len(position) != count or len(velocity) not in (0, count) or len(effort) not in (0, count):
            return self._reject(LENGTH, stamp)
        if not kind.whole:
            return self._take_part(kind, position, velocity, effort, stamp, sent)
        if not self.publishers.takes(Holding(kind.group, len(effort) > 0, len(velocity) > 0), stamp, sent):
            return self._leave_to_another()
        self._leave_out(self._assembly.give_up())
        row = self.ring.slot().reshape(3, -1)
        fault = self._fill(row, kind, position, velocity, effort, stamp)
        return self._reject(fault, stamp) if fault else self._commit(row, stamp, sent)

    def _begin_at_zero(self) -> None:
        """The second message shows that the stamp 0 of the first was simulated time, not a missing stamp."""
        self.unstamped = 0
        if self.ring.written:
            self.clock.began_at_zero()
            self.ring.restamp(0, 0)

    def _take_part(
        self, kind: Kind, position: Any, velocity: Any, effort: Any, stamp: int, sent: int
    ) -> bool:
        """Let a part wait for the other joints, or complete a sample with it."""
        part = np.empty((3, len(kind.index)))
        fault = self._fill(part, kind, position, velocity, effort, stamp)
        if fault:
            return self._reject(fault, stamp)
        assembly = self._assembly
        self._leave_out(assembly.add(kind.group, stamp))
        assembly.row[:, kind.joints] = part
        if not assembly.take():
            return False
        _, velocities, efforts = np.isfinite(assembly.row).any(axis=1).tolist()
        if not self.publishers.takes(Holding(None, efforts, velocities), assembly.stamp, sent):
            return self._leave_to_another()
        row = self.ring.slot().reshape(3, -1)
        row[:] = assembly.row
        if self.needs_effort:  # of a part whose joints all lack it, the others' show that theirs never comes
            self.silent.look(row[0], row[2], np.arange(len(self.joints)), assembly.stamp)
        if (np.isnan(row[2]) & ~self.silent.joints).any():
            row[2] = math.nan  # what one controller does not measure, the robot does not
        return self._commit(row, assembly.stamp, sent)

    def _fill(
        self, row: np.ndarray, kind: Kind, position: Any, velocity: Any, effort: Any, stamp: int
    ) -> str:
        """Write the numbers of a message to `row` in our order, (3, m); returns why they are unusable, empty if they are not."""
        index = kind.index
        row[0] = np.asarray(position)[index]
        row[1] = np.asarray(velocity)[index] if len(velocity) else math.nan
        row[2] = np.asarray(effort)[index] if len(effort) else math.nan
        if self.needs_effort:
            self.silent.look(row[0], row[2], kind.joints, stamp)
        if credible(row).all():
            return ""
        # drivers fill what is not measured with NaN; a velocity follows from the position, an effort from nothing
        unusable, absent = ~np.isfinite(row), np.isnan(row)
        unusable[1] &= ~absent[1]
        if absent[2].all() or not self.needs_effort:
            unusable[2] &= ~absent[2]
        unusable[2] &= ~(absent[2] & self.silent.joints[kind.joints])
        reason = NOT_FINITE
        if not unusable.any():
            reason, unusable = OUT_OF_RANGE, np.abs(row) > MOST
            if not unusable.any():
                return ""
        field, joint = np.argwhere(unusable)[0]
        self.culprit = f"{FIELDS[field]} of {self.joints[kind.joints[joint]]}"
        return reason

    def _commit(self, row: np.ndarray, stamp: int, sent: int) -> bool:
        stream_time = self.clock.advance(stamp)
        if stream_time < 0:
            return self._reject(BACKWARDS, stamp)
        self.received += 1
        if self.needs_effort and math.isnan(row[2, 0]) and np.isnan(row[2]).all():
            self.rejected[NO_EFFORT] += 1
        self.ring.commit(stamp, sent, stream_time)
        return True

    def _reject(self, reason: str, stamp: int) -> bool:
        self.received += 1
        self.rejected[reason] += 1
        self.clock.refuse(stamp)
        return False

    def _leave_to_another(self) -> bool:
        """Count a sample of a second publisher, so that it does not make the first one's look lost."""
        self.received += 1
        self.rejected[SECOND] += 1
        return False

    def _leave_out(self, waited: Mapping[Group, int]) -> None:
        """Count messages that waited for others in vain, with their stamps [ns]."""
        for group, stamp in waited.items():
            self.received += 1
            self.rejected[JOINTS] += 1
            if not group.paired:  # else one that should have come with it is missing
                self.clock.refuse(stamp)


class CommandIntake:
    """Writes effort commands to a ring of their own (n numbers).

    The message has no stamp, so commands are aligned with the joint states by the time of sending.

    Attributes:
        joints: n names, the order of the numbers.
        received: commands that came.
        rejected: commands left out, by reason.
        complaint: what was wrong with the last of these, and what to do.
    """

    def __init__(self, joints: Sequence[str], ring: Ring) -> None:
        self.joints = tuple(joints)
        self.ring = ring
        self.clock = Clock()
        self.received = 0
        self.rejected: Counter[str] = Counter()
        self.complaint = ""

    def take(self, values: Any, sent: int) -> bool:
        """Write one command [N·m], in the order of `joints`, sent at `sent` [ns]; False if it was refused."""
        self.received += 1
        count = len(self.joints)
        if len(values) != count:
            remedy = f"Send {count}, in the order of the parameter joints: {listed(self.joints, 20)}."
            return self._reject(LENGTH, f"An effort command has {len(values)} numbers, not {count}. {remedy}")
        row = self.ring.slot()
        row[:] = values
        finite = np.isfinite(row)
        if not finite.all():
            culprit = self.joints[int(np.argmin(finite))]
            remedy = "Send a finite number for every joint; 0 commands no effort."
            return self._reject(NOT_FINITE, f"An effort command of {culprit} is not finite. {remedy}")
        small = credible(row)
        if not small.all():
            culprit = self.joints[int(np.argmin(small))]
            remedy = f"Send efforts up to {MOST:g}."
            return self._reject(OUT_OF_RANGE, f"An effort command of {culprit} is out of range. {remedy}")
        stream_time = self.clock.advance(sent)
        if stream_time < 0:
            remedy = "Let one controller command these joints."
            return self._reject(BACKWARDS, f"An effort command was sent before the last one. {remedy}")
        self.ring.commit(sent, sent, stream_time)
        return True

    def _reject(self, reason: str, complaint: str) -> bool:
        self.complaint = complaint
        self.rejected[reason] += 1
        return False
