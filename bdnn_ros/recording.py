"""What was measured: joint positions, velocities and efforts against time."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros import stamps
from bdnn_ros.errors import RecordingError, UsageError, listed
from bdnn_ros.readings import (
    incredible,
    of_dropped,
    refuse_all_left_out,
    refuse_incredible,
    refuse_not_finite,
)

GAP_FACTOR = 5.0
"""A pause longer than this many sample periods, and than `GAP_SECONDS`, is a gap, and not interpolated."""
GAP_SECONDS = 0.05
STILL_WIDTHS = 12.0
"""A joint that covers less than this many standard deviations of its position's noise does not move."""
STILL_RANGE = 5e-4
"""Nor does one that covers less than this [rad or m]: a gripper that holds something gives way by as much."""


@dataclass(frozen=True)
class Recording:
    """Joint states against time; the only data that enters the package from outside.

    Attributes:
        time: stamps [s], (N,), strictly increasing.
        joints: n joint names, the order of every column.
        position: [rad] (or [m]), (N, n).
        velocity: [rad/s], (N, n), or None where it was not measured.
        effort: [N·m] (or [N]), (N, n), or None where it was not measured.
        name: where it came from, for messages.
        urdf: robot description in the same source, usable or not, or None.
        notes: what was left out or repaired while reading, one sentence each.
        epoch: clock time at time 0 [ns]: stamps since 1970 would be too coarse as floats.

    Raises:
        RecordingError: shapes disagree, a value is not finite, or stamps do not increase.
    """

    time: np.ndarray
    joints: tuple[str, ...]
    position: np.ndarray
    velocity: np.ndarray | None = None
    effort: np.ndarray | None = None
    name: str = "recording"
    urdf: str | None = None
    notes: tuple[str, ...] = ()
    epoch: int = 0

    def __post_init__(self) -> None:
        count, width = len(self.time), len(self.joints)
        for field in ("position", "velocity", "effort"):
            values = getattr(self, field)
            if values is None:
                continue
            if values.shape != (count, width):
                raise RecordingError(
                    f"{self.name}: {field} has shape {values.shape}, {count} stamps and {width} joints need "
                    f"({count}, {width}).",
                    "Check the message's field lengths.",
                )
            refuse_not_finite(self.name, field, self.joints, self.time, values)
        if not np.isfinite(self.time).all() or (np.diff(self.time) <= 0).any():
            where = int(np.argmax(~(np.diff(self.time) > 0))) + 1 if count > 1 else 0
            raise RecordingError(
                f"{self.name}: time stamps do not increase (sample {where} of {count}).",
                "Check the publisher's clock, or pass --drop-invalid to leave late samples out "
                "and to join the parts of a clock that was set back.",
            )

    def __len__(self) -> int:
        return len(self.time)

    @property
    def width(self) -> int:
        """Number of joints n."""
        return len(self.joints)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0]) if len(self.time) else 0.0

    @property
    def recorded(self) -> float:
        """Duration of all segments together [s], without the gaps."""
        return float(self._clock()[-1]) if len(self.time) else 0.0

    def _clock(self, counted: np.ndarray | bool = True) -> np.ndarray:
        """Time of each sample without gaps and without samples that do not count [s], (N,)."""
        steps = np.diff(self.time, prepend=self.time[:1]) * counted
        steps[[rows.start for rows in self.segments()[1:]]] = 0.0
        return np.cumsum(steps)

    @property
    def rate(self) -> float:
        """Samples per second [Hz], from the median period (0 with fewer than two samples)."""
        return float(1.0 / np.median(np.diff(self.time))) if len(self.time) > 1 else 0.0

    def require_effort(self) -> np.ndarray:
        """The effort, (N, n) [N·m].

        Raises:
            RecordingError: the recording holds none.
        """
        if self.effort is None:
            raise RecordingError(
                f"{self.name}: the joint states carry no effort.",
                "Record a driver that fills JointState.effort, or the commands as well, for --effort command.",
            )
        return self.effort

    def select(self, joints: Sequence[str]) -> Recording:
        """The same recording with these joints, in this order.

        Raises:
            UsageError: a joint is not in the recording, or named twice.
        """
        missing = [joint for joint in joints if joint not in self.joints]
        if missing:
            raise UsageError(
                f"{self.name}: the recording lacks {listed(missing, 20)}; it has {listed(self.joints, 20)}.",
                "Name the joints with --joints, or map the names with --rename old=new.",
            )
        if len(set(joints)) != len(joints):
            raise UsageError(f"A joint is named twice in {listed(joints, 20)}.", "Name each joint once.")
        columns = [self.joints.index(joint) for joint in joints]
        return replace(
            self,
            joints=tuple(joints),
            position=self.position[:, columns],
            velocity=None if self.velocity is None else self.velocity[:, columns],
            effort=None if self.effort is None else self.effort[:, columns],
        )

    def rename(self, rules: Iterable[str]) -> Recording:
        """The same recording with joint names mapped by `old=new` or `s/pattern/replacement/` rules."""
        names = renamed(self.joints, rules)
        return replace(self, joints=names)

    def between(self, start: float, end: float) -> Recording:
        """The samples with start <= time < end [s]."""
        return self.part((self.time >= start) & (self.time < end))

    def split(self, holdout: float, counted: np.ndarray | bool = True) -> tuple[Recording, Recording]:
        """The first part and the last `holdout` share of the recorded time, or of the time of the samples `counted`, (N,) bool.

        Raises:
            UsageError: `holdout` is not in (0, 1).
        """
        if not 0.0 < holdout < 1.0:
            raise UsageError(f"The held-out share is {holdout}, not between 0 and 1.", "Use for example 0.2.")
        clock = self._clock(counted)
        last = clock >= (1.0 - holdout) * clock[-1:]
        return self.part(~last), self.part(last)

    def excerpt(self, share: float, piece: float, before: float = 0.0) -> Recording:
        """A share of the recorded time, as evenly spread pieces of so many seconds with gaps between them.

        Args:
            before: recorded time before this recording, over which the pieces are spread as well [s].
        """
        return self.part((before + self._clock()) % (piece / share) < piece)

    def segments(self) -> list[slice]:
        """Runs of samples without a gap (see `GAP_FACTOR`), as slices of rows."""
        if len(self.time) < 2:
            return [slice(0, len(self.time))]
        steps = np.diff(self.time)
        pause = max(GAP_FACTOR * float(np.median(steps)), GAP_SECONDS)
        edges = [0, *(np.flatnonzero(steps > pause) + 1).tolist(), len(self.time)]
        return [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]

    def part(self, rows: np.ndarray | slice) -> Recording:
        """The samples of these rows, (N,) bool, indices or a slice."""
        return replace(
            self,
            time=self.time[rows],
            position=self.position[rows],
            velocity=None if self.velocity is None else self.velocity[rows],
            effort=None if self.effort is None else self.effort[rows],
        )


def renamed(names: Sequence[str], rules: Iterable[str]) -> tuple[str, ...]:
    """Joint names after `old=new` and `s/pattern/replacement/` rules, applied in order; a slash in one is written \\/.

    Consecutive `old=new` rules refer to the names before all of them, so that two can be exchanged; if `old` is none of these,
    to the result of the rules before it.

    Raises:
        UsageError: a rule is malformed, renames nothing, or makes two names equal.
    """
    result = list(names)
    waiting = list(names)  # names that consecutive `old=new` rules have not mapped yet
    for rule in rules:
        before = list(result)
        parts = [part.replace(r"\/", "/") for part in re.split(r"(?<!\\)/", rule)]
        if len(parts) == 4 and (parts[0], parts[3]) == ("s", ""):
            _, pattern, replacement, _ = parts
            try:
                waiting = result = [re.sub(pattern, replacement, name) for name in result]
            except (re.error, IndexError, OverflowError, RecursionError) as error:
                raise UsageError(f"--rename {rule}: {error}.", "Use s/pattern/replacement/.") from None
        elif rule.count("=") == 1 and all(rule.split("=")):
            old, new = rule.split("=")
            meant = [name == old for name in (waiting if old in waiting else result)]
            result = [new if one else name for one, name in zip(meant, result, strict=True)]
            waiting = ["" if one else name for one, name in zip(meant, waiting, strict=True)]
        else:
            raise UsageError(
                f"--rename {rule} is not a rule.",
                r"Use old=new or s/pattern/replacement/; a slash in one is \/.",
            )
        if result == before:
            raise UsageError(f"--rename {rule} matches none of {listed(before, 20)}.", "Check the names.")
    if len(set(result)) != len(result):
        raise UsageError(f"--rename makes two names equal: {listed(result, 20)}.", "Make the names differ.")
    return tuple(result)


def cleaned(
    time: np.ndarray,
    joints: Sequence[str],
    position: np.ndarray,
    velocity: np.ndarray | None = None,
    effort: np.ndarray | None = None,
    *,
    name: str = "recording",
    urdf: str | None = None,
    drop_invalid: bool = False,
) -> tuple[Recording, np.ndarray]:
    """A recording from raw samples, and the rows it holds: repeated stamps are left out with a note.

    A velocity or effort that is NaN throughout counts as not measured.

    Args:
        time: stamps [s], (N,), in any order.
        drop_invalid: leave out samples that are not credible or late, and shift what follows a clock restart behind what came
            before, with notes, instead of refusing the recording.

    Raises:
        RecordingError: as `Recording`; or a value is beyond what any robot has, or no sample is left.
    """
    velocity, effort = (None if x is None or np.isnan(x).all() else x for x in (velocity, effort))
    notes: list[str] = []
    wrong = incredible(position, velocity, effort) if drop_invalid else np.zeros(position.shape, bool)
    valid = np.flatnonzero(np.isfinite(time) & ~wrong.any(axis=1)) if drop_invalid else np.arange(len(time))
    # of two samples with the same stamp the valid one is kept
    rows = valid[np.append(True, time[valid][1:] != time[valid][:-1])[: len(valid)]]
    if len(rows) < len(valid):
        notes.append(
            f"{name}: {len(valid) - len(rows)} of {len(time)} samples repeat the stamp before; left out."
        )
    stamp = time[rows]
    if drop_invalid:
        if len(time) and not len(rows):
            refuse_all_left_out(name, joints, wrong)
        kept, starts = stamps.runs(stamp)
        dropped = len(time) - len(valid) + len(rows) - np.count_nonzero(kept)
        notes += of_dropped(name, int(dropped), len(time), len(starts))
        rows, stamp = rows[kept], stamps.joined(stamp, kept, starts)
    chosen = slice(None) if len(rows) == len(time) else rows
    recording = Recording(
        stamp,
        tuple(joints),
        position[chosen],
        None if velocity is None else velocity[chosen],
        None if effort is None else effort[chosen],
        name=name,
        urdf=urdf,
        notes=tuple(notes),
    )
    for field, values in (("position", position), ("velocity", velocity), ("effort", effort)):
        if values is not None:
            refuse_incredible(name, field, joints, stamp, values[chosen])
    return recording, rows


def position_noise(recording: Recording) -> np.ndarray:
    """Standard deviation of white noise (and rounding) on the position, by third differences, (n,) [rad]."""
    return white_noise(recording.position)


def white_noise(values: np.ndarray) -> np.ndarray:
    """Standard deviation of white noise (and rounding) on evenly sampled values (N, n), by third differences, (n,)."""
    if len(values) < 8:
        return np.zeros(values.shape[1])
    third = np.diff(values, n=3, axis=0)
    return np.asarray(np.median(np.abs(third), axis=0) / 0.6745 / np.sqrt(20.0))


def moving(recording: Recording) -> np.ndarray:
    """Joints that move further than noise and rounding, (n,) bool."""
    if not len(recording):
        return np.zeros(recording.width, bool)
    return further(recording.position, position_noise(recording))


def further(position: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Joints whose positions (N, n) cover more than noise, standard deviations (n,), and rounding, (n,) bool."""
    return np.asarray(np.ptp(position, axis=0) > np.maximum(STILL_RANGE, STILL_WIDTHS * noise))
