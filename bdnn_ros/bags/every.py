"""Every joint state of a bag, with the motion of those that have a position and a stamp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bdnn_ros import stamps
from bdnn_ros.bags.clock import told
from bdnn_ros.bags.joint_states import Samples
from bdnn_ros.bags.reading import EVERYTHING, Progress, samples_of
from bdnn_ros.bags.selection import Selection
from bdnn_ros.errors import RecordingError, UsageError
from bdnn_ros.readings import credible, refuse_all_left_out
from bdnn_ros.recording import Recording
from bdnn_ros.reported import reported_velocity, with_derived


@dataclass(frozen=True)
class EveryState:
    """All joint states, sorted by stamp; none is left out.

    Attributes:
        stamp: (N,) int64 [ns]; stamps may repeat.
        position, effort: (N, n) [rad] ([m]), [N·m] ([N]), NaN where a message does not hold them.
        motion: what they show, each stamp once; with the joints' order and the notes of reading.
        row: the sample of the motion that is of each state's moment, (N,) int, -1 where there is none: the state holds
            a position that is not credible, or no stamp.
    """

    stamp: np.ndarray
    position: np.ndarray
    effort: np.ndarray
    motion: Recording
    row: np.ndarray

    def __len__(self) -> int:
        return len(self.stamp)

    def select(self, joints: Sequence[str]) -> EveryState:
        """The same states with these joints, in this order; positions of all joints are required as before.

        Raises:
            UsageError: as `Recording.select`.
        """
        motion = self.motion.select(joints)
        columns = [self.motion.joints.index(joint) for joint in joints]
        return replace(
            self, position=self.position[:, columns], effort=self.effort[:, columns], motion=motion
        )


def read_every(
    path: str | Path,
    selection: Selection = EVERYTHING,
    *,
    drop_invalid: bool = False,
    progress: Progress | None = None,
) -> EveryState:
    """Read every message that holds the joints, also those for which `read` would refuse the bag or drop them.

    Late messages are sorted in by their stamps. Only messages that cannot be decoded, or that name no joint or hold no
    position, are dropped, with a note.

    Args:
        drop_invalid: append what follows a clock reset after what came before, instead of refusing the bag.

    Raises:
        UsageError, BagError: as `read`.
        RecordingError: the clock was reset, or no position is finite.
    """
    samples, urdf, notes = samples_of(path, selection, progress, every=True)
    name = str(path)
    if len(set(samples.joints)) < len(samples.joints):
        raise UsageError(f"{name}: a joint is named twice.", "Name each joint once.")
    shows = _shows(name, samples)
    if not shows.all():
        notes.append(
            f"{name}: {len(samples) - np.count_nonzero(shows)} of {len(samples)} joint states show no motion: "
            "their position is not finite or beyond any robot's, or they have no stamp."
        )
    stamp = samples.stamp.copy()
    stamp[shows] = _one_clock(name, stamp[shows], drop_invalid)
    order = np.argsort(stamp, kind="stable")
    samples, stamp, shows = samples.part(order), stamp[order], shows[order]
    moments, first, which = np.unique(stamp[shows], return_index=True, return_inverse=True)
    row = np.full(len(samples), -1)
    row[shows] = which
    shown = replace(samples.part(np.flatnonzero(shows)[first]), stamp=moments)
    acting = np.full(samples.position.shape, np.nan) if samples.effort is None else samples.effort
    return EveryState(stamp, samples.position, acting, _motion(name, shown, urdf, notes), row)


def _shows(name: str, samples: Samples) -> np.ndarray:
    """Which joint states belong to the motion, (N,) bool: those with a stamp and a credible position.

    Raises:
        RecordingError: none does.
    """
    possible = credible(samples.position)
    shows = told(samples.stamp) & possible.all(axis=1)
    if not possible.all(axis=1).any():
        refuse_all_left_out(name, samples.joints, ~possible)
    if not shows.any():
        raise RecordingError(
            f"{name}: no joint state has a stamp and a position that a robot can have.", "Fix the driver."
        )
    return np.asarray(shows)


def _motion(name: str, shown: Samples, urdf: str | None, notes: Sequence[str]) -> Recording:
    """The motion of samples with increasing stamps."""
    velocity, silent, more = reported_velocity(name, shown.joints, shown.position, shown.velocity)
    motion = Recording(
        (shown.stamp - shown.epoch) * 1e-9,
        shown.joints,
        shown.position,
        _if_credible(velocity),
        _if_credible(shown.effort),
        name=name,
        urdf=urdf,
        notes=(*notes, *more),
        epoch=shown.epoch,
    )
    return with_derived(motion, silent)


def _if_credible(values: np.ndarray | None) -> np.ndarray | None:
    return values if values is not None and credible(values).all() else None


def _one_clock(name: str, stamp: np.ndarray, join: bool) -> np.ndarray:
    """Stamps (N,) [ns], in order of arrival, on one clock: what follows a clock reset is appended to what came before.

    Raises:
        RecordingError: the clock starts anew, and it is not asked to join the parts.
    """
    fresh = np.flatnonzero(np.append(True, np.diff(stamp) != 0))
    kept, starts = stamps.runs(stamp[fresh])
    if len(starts) == 1:
        return stamp
    if not join:
        raise RecordingError(
            f"{name}: time stamps do not increase: the clock is set back (sample {fresh[starts[1]]} of {len(stamp)}).",
            "Check the publisher's clock, or pass --drop-invalid to join the parts.",
        )
    seconds = (stamp[fresh] - stamp[0]) * 1e-9
    joined = stamps.joined(seconds, kept, starts)
    moved = stamp.copy()
    edges = [*fresh[starts].tolist(), len(stamp)]
    places = np.searchsorted(np.flatnonzero(kept), starts)
    for first, place, start, stop in zip(starts, places, edges[:-1], edges[1:], strict=True):
        moved[start:stop] += round((joined[place] - seconds[first]) * 1e9)
    return moved
