"""Cuts a stream of samples into chunks of time, each with the neighbouring samples that its low-pass needs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bdnn_ros.errors import RecordingError, UsageError
from bdnn_ros.recording import Recording
from bdnn_ros.signals import Signals, prepare, suitable_cutoff, without_copies
from bdnn_ros.signals.kernels import KERNEL_WIDTHS, gaussian_std
from bdnn_ros.signals.repeats import without_repeats
from bdnn_ros.signals.stuck import stuck

CHUNK_SECONDS = 1.0
CHUNK_SAMPLES = 40
"""A chunk lasts at least one second and this many samples."""
CONTEXT_SECONDS = 4.0
"""Samples kept from before a chunk: repeated messages are judged by those before them."""
ROWS_PER_CUTOFF = 5.0
"""Rows kept per second and Hz of the cut-off: what passes the low-pass has no more to say."""


class Chunks:
    """Cuts samples into chunks of time counted from the first stamp, independently of how many samples arrive at once.

    Args:
        joints: the columns of the samples.
        cutoff: of the low-pass [Hz], None for what suits the rate of the first second of each stretch.

    Attributes:
        asked: the cut-off that was asked for [Hz], None where none was.
        cutoff: of the low-pass [Hz] in this stretch, None before it is known.
        left_out: samples in chunks too short, or too slow, for the low-pass.
        repeated: samples left out since their drive repeated its last reading in motion, (n,).
    """

    def __init__(self, joints: tuple[str, ...], cutoff: float | None = None) -> None:
        self.joints = joints
        self.cutoff = self.asked = cutoff
        self.left_out = 0
        self.repeated = np.zeros(len(joints), int)
        self._pending: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._length: float | None = None
        self._margin = self._start = 0.0
        self._due = np.inf
        self._stuck_at = np.full(len(joints), np.nan)  # positions that a drive repeats, as far as is known

    def add(
        self, time: np.ndarray, position: np.ndarray, effort: np.ndarray
    ) -> Iterator[tuple[Signals, np.ndarray] | None]:
        """Take in samples; yields for each complete chunk the motion around it and the rows of the chunk.

        Yields None for a chunk without usable motion.

        Args:
            time: [s], (N,), later than all before.
            position, effort: [rad], [N·m], (N, n).

        Raises:
            UsageError: the rate of the first second does not allow the cut-off that was asked for.
        """
        if len(time) == 0:
            return
        self._pending.append((time, position, effort))
        if self._length is None and not self._settled(final=False):
            return
        while time[-1] >= self._due:
            yield self._next()

    def end(self) -> Iterator[tuple[Signals, np.ndarray] | None]:
        """End the stream: yields the remaining chunks; later samples may have any stamps."""
        if self._pending and (self._length is not None or self._settled(final=True)):
            last = self._pending[-1][0][-1]
            while self._start <= last:
                yield self._next()
        self._pending, self._length, self._due = [], None, np.inf
        self._stuck_at[:] = np.nan

    def _settled(self, final: bool) -> bool:
        """Choose the chunk length from the first second of samples; False while there are too few."""
        recording = self._known()
        time = recording.time
        if len(time) < 2 or (not final and (len(time) < CHUNK_SAMPLES or time[-1] - time[0] < CHUNK_SECONDS)):
            return False
        early = max(int(np.searchsorted(time, time[0] + CHUNK_SECONDS)), CHUNK_SAMPLES)
        rate = without_copies(recording.part(slice(early))).rate
        # chosen anew after a pause: what is summed so far holds under any low-pass that efforts and motion share, and
        # rows are as many as their cut-off lets be independent; only how loud they are may differ
        self.cutoff = suitable_cutoff(rate, self.asked)
        self._length = max(CHUNK_SECONDS, CHUNK_SAMPLES / rate)
        self._margin = 2.0 * KERNEL_WIDTHS * gaussian_std(self.cutoff) + 2.0 / rate
        self._start = float(time[0])
        self._due = self._start + self._length + self._margin
        return True

    def _known(self) -> Recording:
        """The samples that are kept, as a recording."""
        time, position, effort = (np.concatenate(parts) for parts in zip(*self._pending, strict=True))
        return Recording(time, self.joints, position, None, effort)

    def _next(self) -> tuple[Signals, np.ndarray] | None:
        """The chunk that starts at `_start`."""
        assert self._length is not None
        start, end = self._start, self._start + self._length
        recording = self._known()
        time = recording.time
        known = slice(0, int(np.searchsorted(time, end + self._margin)))
        keep = int(np.searchsorted(time, end - self._margin - CONTEXT_SECONDS))
        self._pending = [(time[keep:], recording.position[keep:], recording.require_effort()[keep:])]
        self._start, self._due = end, end + self._length + self._margin
        recording = self._unstuck(without_repeats(without_copies(recording.part(known))), start, end)
        chunk = self._signals(recording.between(start - self._margin, end + self._margin), start, end)
        if chunk is None:
            self.left_out += int(np.count_nonzero((time >= start) & (time < end)))
        return chunk

    def _unstuck(self, recording: Recording, start: float, end: float) -> Recording:
        """The recording without samples in which a drive repeated its reading; those from start to end [s] are counted."""
        samples = stuck(recording)
        same = recording.position == self._stuck_at
        since = np.logical_or.accumulate(same, axis=0)
        samples |= since & ~np.logical_or.accumulate(since & ~same, axis=0)
        if len(samples):
            self._stuck_at = np.where(samples[-1], recording.position[-1], np.nan)
            self.repeated += samples[(recording.time >= start) & (recording.time < end)].sum(axis=0)
        return recording.part(~np.asarray(samples.any(axis=1))) if samples.any() else recording

    def _signals(self, window: Recording, start: float, end: float) -> tuple[Signals, np.ndarray] | None:
        if len(window) < 4:
            return None
        try:
            signals = prepare(window, self.cutoff)
        except (RecordingError, UsageError):  # UsageError: slower by now than the low-pass allows
            return None
        thinning = max(int(signals.rate / (ROWS_PER_CUTOFF * signals.cutoff)), 1)
        own = signals.interior & (signals.time >= start) & (signals.time < end)
        rows = np.flatnonzero(own)[::thinning]
        return (signals, rows) if len(rows) else None
