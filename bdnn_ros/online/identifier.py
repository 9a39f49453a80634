"""Identification from samples as they come; a recording is only samples that came earlier."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from bdnn_ros.errors import RecordingError, UpdateRejected, UsageError
from bdnn_ros.physical.columns import parameter_columns, parameter_index
from bdnn_ros.physical.consistency import consistent, feasible
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import Parameters, Prior, Spread, prior
from bdnn_ros.physical.recursive import Posterior, Recursion
from bdnn_ros.recording import Recording
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import CUTOFF_PER_RATE, DEFAULT_CUTOFF, KERNEL_WIDTHS, Signals, gaussian_std, prepare

CHUNK_SECONDS = 1.0
CHUNK_SAMPLES = 40
"""A chunk lasts at least one second and this many samples."""
ROWS_PER_CUTOFF = 5.0
"""Rows kept per second and Hz of the cut-off: what passes the low-pass has no more to say."""
Progress = Callable[[float, str], None]
"""(share done, what is being done)."""


class Identifier:
    """Identifies a robot from raw samples fed in order, live or from recordings, with the same result.

    Samples are gathered into chunks of time counted from the first stamp, each low-passed with the samples
    around it; how many samples a call brings makes no difference.

    Args:
        robot: the simulation's robot, the prior.
        cutoff: of the low-pass [Hz], None for the recording's default.
        spread: how far the real robot may be from the prior.
        belief: what is known already, instead of the robot and the spread.

    Attributes:
        latest: motion of the last chunk and its rows, until somebody takes them; None before.
    """

    def __init__(
        self,
        robot: Robot,
        cutoff: float | None = None,
        spread: Spread | None = None,
        belief: Prior | None = None,
    ) -> None:
        self.robot = robot
        self.cutoff = cutoff
        belief = belief or prior(robot, spread)
        self.recursion = Recursion(
            belief.mean, belief.covariance, parameter_index(robot.width), belief.effort_scale
        )
        self.version = 0
        self.samples = 0
        self.chunks = 0
        self.left_out = 0
        self.latest: tuple[Signals, np.ndarray] | None = None
        self._pending: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._chunk: float | None = None
        self._start = 0.0
        self._due = np.inf

    # -- samples in --------------------------------------------------------------------------------

    def feed(self, time: np.ndarray, position: np.ndarray, effort: np.ndarray) -> int:
        """Take in samples in order of their stamps.

        Args:
            time: [s], (N,), later than all before.
            position, effort: [rad], [N·m], (N, n) in the order of the robot's joints.

        Returns:
            The number of chunks that were completed: above zero, `model` has news.
        """
        if len(time) == 0:
            return 0
        self._pending.append((time, position, effort))
        self.samples += len(time)
        if self._chunk is None and not self._settle(final=False):
            return 0
        before = self.chunks
        while time[-1] >= self._due:
            self._complete()
        return self.chunks - before

    def finish(self) -> None:
        """Take in what is left: the recording ends here, and what comes next may have any stamps."""
        if self._pending and (self._chunk is not None or self._settle(final=True)):
            last = self._pending[-1][0][-1]
            while self._pending and self._start <= last:
                self._complete()
        self._pending, self._chunk, self._due = [], None, np.inf

    def fit(self, recordings: Sequence[Recording], progress: Progress | None = None) -> PhysicalModel:
        """The model of one or several recordings of the robot.

        Raises:
            RecordingError: there is no effort, or nothing that could be used.
            UsageError: the joints are not the robot's.
        """
        total = sum(recording.duration for recording in recordings) or 1.0
        done = 0.0
        for recording in recordings:
            if recording.joints != self.robot.joints:
                raise UsageError(
                    f"{recording.name} has other joints than the robot.", "Select the robot's joints."
                )
            effort = recording.require_effort()
            for rows in _stretches(recording, 10.0):
                self.feed(recording.time[rows], recording.position[rows], effort[rows])
                if progress:
                    share = (done + float(recording.time[rows][-1] - recording.time[0])) / total
                    progress(0.9 * share, f"reading {recording.name}")
            self.finish()
            done += recording.duration
        model = self.model(iterations=10)
        if progress:
            progress(1.0, "done")
        return model

    # -- models out --------------------------------------------------------------------------------

    def model(self, iterations: int = 1) -> PhysicalModel:
        """The robot as known now, checked.

        Raises:
            RecordingError: no motion came yet.
            UpdateRejected: the result is not finite or not feasible.
        """
        posterior = self.recursion.solve(iterations)
        self.version += 1
        return physical_model(self.robot, posterior, self.version)

    # -- chunks ------------------------------------------------------------------------------------

    def _settle(self, final: bool) -> bool:
        """Fix the chunk's length from the first second of samples; False while there are too few."""
        time = np.concatenate([part[0] for part in self._pending])
        if not final and (len(time) < CHUNK_SAMPLES or time[-1] - time[0] < CHUNK_SECONDS):
            return False
        if len(time) < 2:
            return False
        early = np.diff(time[: max(int(np.searchsorted(time, time[0] + CHUNK_SECONDS)), CHUNK_SAMPLES)])
        rate = 1.0 / float(np.median(early))
        if self.cutoff is None:
            self.cutoff = min(DEFAULT_CUTOFF, rate * CUTOFF_PER_RATE)
        self._chunk = max(CHUNK_SECONDS, CHUNK_SAMPLES / rate)
        self._margin = 2.0 * KERNEL_WIDTHS * gaussian_std(self.cutoff) + 2.0 / rate
        self._start = float(time[0])
        self._due = self._start + self._chunk + self._margin
        return True

    def _complete(self) -> None:
        """Take in the chunk that starts at `_start`."""
        assert self._chunk is not None
        end = self._start + self._chunk
        time, position, effort = (np.concatenate(parts) for parts in zip(*self._pending, strict=True))
        inside = (time >= self._start - self._margin) & (time < end + self._margin)
        if np.count_nonzero(inside) > 3:
            window = Recording(time[inside], self.robot.joints, position[inside], None, effort[inside])
            try:
                signals = prepare(window, self.cutoff)
            except RecordingError:
                self.left_out += int(np.count_nonzero((time >= self._start) & (time < end)))
            else:
                self._take_in(signals, self._start, end)
        keep = time >= end - self._margin
        self._pending = [(time[keep], position[keep], effort[keep])] if keep.any() else []
        self.chunks += 1
        self._start = end
        self._due = end + self._chunk + self._margin

    def _take_in(self, signals: Signals, start: float, end: float) -> None:
        assert signals.effort is not None
        thinning = max(int(signals.rate / (ROWS_PER_CUTOFF * signals.cutoff)), 1)
        own = signals.interior & (signals.time >= start) & (signals.time < end)
        rows = np.flatnonzero(own)[::thinning]
        if len(rows) == 0:
            return
        columns = signals.smooth(parameter_columns(self.robot, signals))
        self.recursion.update(columns[rows], signals.smooth(signals.effort)[rows])
        self.latest = signals, rows


def physical_model(robot: Robot, posterior: Posterior, version: int = 1) -> PhysicalModel:
    """The feasible model of a posterior.

    Raises:
        UpdateRejected: the posterior is not finite, or no feasible robot is near it.
    """
    width = robot.width
    if not np.isfinite(posterior.mean).all():
        raise UpdateRejected("The identified parameters are not finite.", "Check the efforts for outliers.")
    positive = width * PER_LINK + np.arange(3 * width)
    vector = consistent(posterior.mean, posterior.information, width, positive)
    values = Parameters.from_vector(vector)
    if not feasible(values.inertials):
        raise UpdateRejected("The identified inertias are not physically possible.", "Check units and signs.")
    identified = robot.with_inertials(values.inertials).with_joint_parameters(
        values.armature, values.viscous, values.coulomb
    )
    return PhysicalModel(identified, values.offset, posterior.covariance, posterior.noise, version)


def _stretches(recording: Recording, seconds: float) -> list[slice]:
    """Rows of the recording in stretches of time."""
    count = max(int(np.ceil(recording.duration / seconds)), 1)
    edges = np.searchsorted(recording.time, recording.time[0] + seconds * np.arange(1, count))
    bounds = [0, *edges.tolist(), len(recording)]
    return [slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True) if b > a]
