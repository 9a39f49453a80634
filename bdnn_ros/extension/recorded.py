"""Identification of the recordings that an extended model was diagnosed from; the times of its effects refer to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bdnn_ros.diagnosis.recorded.joining import starts
from bdnn_ros.recording import Recording

MARKS = 64
"""So many moments of a recording tell it from all others."""
FEWEST_MARKS = 3
"""With fewer of them a piece is not known to be of the same recording."""
SAME = 1e-5
"""Positions of one moment that are as near are the same, read again [rad] ([m]), and moments [s]: stamps are rounded."""


@dataclass(frozen=True)
class Recorded:
    """A fingerprint of a recording, however it is stored or cut, and its begin.

    Stamps alone would not suffice: all simulations begin at the same time.

    Attributes:
        begin: its first stamp on the model's clock [s].
        stamps: of moments all over it, the first and the last among them, (K,) int64 [ns].
        position: of the model's joints at them, (K, n) [rad] ([m]).
    """

    begin: float
    stamps: np.ndarray
    position: np.ndarray

    @classmethod
    def of(cls, recording: Recording, begin: float) -> Recorded:
        """The fingerprint of a recording that begins at `begin` on the model's clock [s]."""
        rows = np.unique(np.linspace(0, len(recording) - 1, MARKS).astype(int))
        stamps = recording.epoch + np.round(recording.time[rows] * 1e9).astype(np.int64)
        return cls(begin, stamps, recording.position[rows])

    @property
    def end(self) -> float:
        """Its last stamp on the model's clock [s]."""
        return self.begin + float(self.stamps[-1] - self.stamps[0]) * 1e-9

    def since(self, recording: Recording) -> float:
        """The model's clock at time zero of a recording [s]."""
        return self.begin + float(recording.epoch - int(self.stamps[0])) * 1e-9

    def holds(self, recording: Recording) -> bool:
        """Whether a recording is this one, a piece of it, or contains it; joints in the model's order."""
        if not len(recording):
            return False
        time = (self.stamps - recording.epoch) * 1e-9
        seen = (time >= recording.time[0] - SAME) & (time <= recording.time[-1] + SAME)
        theirs = [np.interp(time[seen], recording.time, of_joint) for of_joint in recording.position.T]
        apart = np.abs(np.transpose(theirs) - self.position[seen])
        return bool(np.count_nonzero(seen) >= FEWEST_MARKS and (apart <= SAME).all())

    def meets(self, start: float, end: float) -> bool:
        """Whether an interval on the model's clock [s] overlaps it."""
        return start <= self.end and end >= self.begin


def on_one_clock(recordings: Sequence[Recording]) -> tuple[Recorded, ...]:
    """Fingerprints of recordings that were diagnosed together, on the clock of that diagnosis."""
    begin = starts([recording.time for recording in recordings])
    return tuple(Recorded.of(one, at) for one, at in zip(recordings, begin, strict=True))
