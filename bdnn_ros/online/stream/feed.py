"""Reads samples from the ring buffers: joint states, each with its effort."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.efforts import COMMAND_AGE, EffortConvention
from bdnn_ros.errors import RecordingError
from bdnn_ros.online.stream.buffer import Chunk, Ring
from bdnn_ros.recording import Recording
from bdnn_ros.reported import reported_velocity, with_derived

AGE = int(COMMAND_AGE * 1e9)
"""[ns]."""
LONG = 1 << 60
"""Longer than any step of a stream [ns]."""
SET_BACK = 100_000_000
"""The clock of a middleware that goes back by more was set back; by less, messages overtook each other [ns]."""


@dataclass(frozen=True)
class Samples:
    """Joint states in order of stream time.

    Attributes:
        time: [s], (N,); counted from the ring's first sample.
        position, velocity, effort: (N, n); NaN where not measured.
        missed: samples that were overwritten before they were read.
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    missed: int = 0

    def __len__(self) -> int:
        return len(self.time)

    @property
    def silent(self) -> np.ndarray:
        """Joints without effort in any sample, although others have it (no sensor), (n,) bool."""
        known = np.isfinite(self.effort).any(axis=0)
        return ~known & known.any()

    def with_effort(self) -> Samples:
        """The samples whose effort is known; zero stands for joints that are `silent`, as in recordings.

        If a sensor starts late, all earlier samples are dropped: the zeros would be learned.
        """
        silent = self.silent
        known = np.isfinite(self.effort[:, ~silent]).all(axis=1)
        if known.all() and not silent.any():
            return self
        position, velocity = self.position[known], self.velocity[known]
        effort = np.where(silent, 0.0, self.effort[known])
        return Samples(self.time[known], position, velocity, effort, self.missed)


class Feed:
    """Reads the ring of joint states, and that of effort commands if these serve as effort, sample by sample.

    Attributes:
        next: number of the joint state that is read next.
        kept: number of the first joint state that a recording may hold.
        convention: what the efforts are; None where they drive the joints as they are.
    """

    def __init__(
        self,
        joints: tuple[str, ...],
        states: Ring,
        commands: Ring | None = None,
        start: int = 0,
        convention: EffortConvention | None = None,
        kept: int | None = None,
    ) -> None:
        self.joints = joints
        self.states = states
        self.commands = commands
        self.next = start
        self.kept = start if kept is None else kept
        self.convention = convention
        self._next_command = 0
        self._acted = np.zeros(len(joints), bool)

    def read(self, most: int) -> Samples:
        """The samples since the last call, at most `most`."""
        if self.commands is None:
            chunk = self.states.read(self.next, most)
            self.next = chunk.end
            return self._samples(chunk)
        commands = self.commands.read(self._next_command)
        chunk = self.states.read(self.next, self._ready(most, commands))
        self.next = chunk.end
        if len(chunk):  # the next joint states may still stand under the command in force now
            used = np.flatnonzero(commands.sent <= chunk.sent[-1])
            self._next_command = commands.first + (int(used[-1]) if len(used) else 0)
        return self._samples(chunk, commands)

    def latest(self, count: int) -> tuple[Samples, np.ndarray]:
        """The last `count` samples, or all if there are fewer, and their stamps [ns]; `next` does not move."""
        chunk = self.states.latest(count)
        return self._samples(chunk, self._commands_of(chunk)), chunk.stamp

    def latest_time(self) -> float:
        """Stream time of the newest joint state [s]; 0 before the first."""
        newest = self.states.latest(1)
        return float(newest.time[0] - self.states.origin) * 1e-9 if len(newest) else 0.0

    def recording(self, seconds: float) -> Recording:
        """The last `seconds` (0: all that is kept) as a recording; samples without effort are left out.

        It does not reach back beyond `kept`, for example to before a reset.

        Raises:
            RecordingError: there are none.
        """
        newest = self.states.latest(1)
        if newest.end <= self.kept:
            since = "since what was learned was forgotten" if newest.end else "yet"
            raise RecordingError(f"No joint state has come {since}.", "Check the topic joint_states.")
        start = self.states.oldest
        if 0.0 < seconds <= self.latest_time():  # a number beyond may be no whole one of nanoseconds
            start = min(self.states.first_after(int(newest.time[0] - seconds * 1e9)), newest.end - 1)
        chunk = self.states.read(max(start, self.kept))
        samples = self._samples(chunk, self._commands_of(chunk), alone=True).with_effort()
        if len(samples) == 0:
            raise RecordingError(
                "None of the joint states carries effort.",
                "Set effort_source to command, or use a driver that fills it.",
            )
        name, position, effort = "live stream", samples.position, samples.effort
        velocity = _whole(samples.velocity) if np.isfinite(samples.velocity).any() else None
        velocity, silent, notes = reported_velocity(name, self.joints, position, velocity)
        live = Recording(samples.time, self.joints, position, velocity, effort, name=name, notes=tuple(notes))
        return with_derived(live, silent)

    def _ready(self, most: int, commands: Chunk) -> int:
        """Number of joint states that can be read: those whose commands have arrived or are overdue.

        A clock that was set back would otherwise make earlier joint states wait until it has caught up.
        """
        chunk = self.states.read(self.next, most)
        if len(chunk) == 0:
            return 0
        settled = np.abs(chunk.sent - self.states.latest(1).sent[0]) >= AGE
        if len(commands):
            settled |= chunk.sent <= commands.sent[-1]
        return int(np.count_nonzero(np.logical_and.accumulate(settled)))

    def _commands_of(self, chunk: Chunk) -> Chunk | None:
        """All commands that may be in force at these joint states, whatever their rate."""
        if self.commands is None:
            return None
        newest = self.commands.latest(1)
        if len(chunk) == 0 or len(newest) == 0:
            return newest
        first = min(self._before(chunk).sent.min(initial=chunk.sent[0]), chunk.sent.min())
        # not by their stream time: that lengthens and shortens pauses, those of the commands and of the states apart
        return self.commands.read(self.commands.first_sent_after(int(first) - AGE - 1))

    def _before(self, chunk: Chunk) -> Chunk:
        """The joint states before these, from the earliest command that may still be in force on."""
        if len(chunk) == 0:
            return chunk
        first = max(self.states.first_after(int(chunk.time[0]) - AGE - 1) - 1, self.states.oldest)
        before = self.states.read(first, max(chunk.first - first, 0))
        count = max(min(chunk.first - before.first, len(before)), 0)  # the writer may have moved it on
        stamp, sent, time = (column[:count] for column in (before.stamp, before.sent, before.time))
        return Chunk(before.first, stamp, sent, time, before.values[:count], before.missed)

    def _samples(self, chunk: Chunk, commands: Chunk | None = None, alone: bool = False) -> Samples:
        """The samples of a chunk; `alone`: it may be older than what was looked at before."""
        n = len(self.joints)
        position, velocity, effort = (chunk.values[:, k * n : (k + 1) * n] for k in range(3))
        if commands is not None:
            effort = commanded(chunk, self._before(chunk), commands)
        if self.convention is not None:
            if self.convention.robot is not None and self.commands is None:
                effort = self._measured(effort, alone)
            effort = self.convention.acting(position, effort)
        time = (chunk.time - self.states.origin) * 1e-9
        return Samples(time, position, velocity, effort, chunk.missed)

    def _measured(self, effort: np.ndarray, alone: bool) -> np.ndarray:
        """Reported efforts, (N, n); NaN before the first value other than zero of each joint.

        A joint without a sensor reports zero throughout; with gravity added that would look measured.
        """
        acted = np.logical_or.accumulate(np.abs(effort) > 0.0, axis=0)
        if not alone:
            acted |= self._acted
            self._acted = acted[-1] if len(acted) else self._acted
        return np.where(acted, effort, np.nan)


def _whole(velocity: np.ndarray) -> np.ndarray:
    """Velocities (N, n), NaN for joints that lack some while others have theirs: these are derived from the position then."""
    absent = np.isnan(velocity)
    lacking = (absent & ~absent.all(axis=1, keepdims=True)).any(axis=0)
    return np.where(lacking, np.nan, velocity)


def commanded(states: Chunk, before: Chunk, commands: Chunk) -> np.ndarray:
    """The last command sent before each joint state, (N, n); NaN if it is too old in stream time.

    The middleware's clock tells between which joint states a command came (a simulation may take long over one). Joint states
    from before a reset of that clock have no command.

    Args:
        before: joint states that came just before these.
    """
    effort = np.full((len(states), commands.values.shape[1]), np.nan)
    if len(states) == 0 or len(commands) == 0:
        return effort
    told = _since_set_back(commands.sent)
    ordered, values = commands.sent[told:], commands.values[told:]
    sent, time = np.concatenate([before.sent, states.sent]), np.concatenate([before.time, states.time])
    told = _since_set_back(sent)
    sent, time = np.maximum.accumulate(sent[told:]), time[told:]
    step = np.diff(time, prepend=time[0] - LONG)
    under = np.minimum(np.searchsorted(sent, ordered), len(sent) - 1)
    since = time[under] - np.minimum(sent[under] - ordered, step[under])
    last = np.maximum(np.searchsorted(ordered, states.sent, side="right") - 1, 0)
    valid = (ordered[last] <= states.sent) & (states.time - since[last] <= AGE)
    valid[: max(told - len(before), 0)] = False
    effort[valid] = values[last[valid]]
    return effort


def _since_set_back(sent: np.ndarray) -> int:
    """Index of the first of the times [ns], (N,), since the clock was last set back."""
    back = np.flatnonzero(np.diff(sent) < -SET_BACK)
    return int(back[-1]) + 1 if len(back) else 0
