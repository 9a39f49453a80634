"""Learning from a stream, sample for sample the same in the live trainer and in `bdnn replay`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from bdnn_ros.dynamics import Dynamics
from bdnn_ros.errors import DataError, UpdateRejected
from bdnn_ros.online.changed.changes import Change, Monitor
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.online.order import belief, predicted
from bdnn_ros.online.stream.silent import LEAST_VARIANCE, changes, relative
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot
from bdnn_ros.scores import described_effort
from bdnn_ros.signals import Signals

PAUSE_SECONDS = 1.0
"""A longer step of the stamps ends a stretch: nothing before is joined to what follows."""
STEP_SECONDS = 0.2
"""Samples are fed in pieces of this length, so that every chunk of the identifier gives its own model."""
SETTLE_AT = 32
"""Chunks before terms are chosen for the first time: it takes seconds, and a stream does not wait."""
WORSE = 1.2
"""A new model may err so many times as much as the one that serves, on motion neither has seen."""
NEGLIGIBLE = 0.02
"""Errors under this share of the effort's spread count as equal."""
POSES = 12
"""Poses of the last chunk at which the mass matrix is tried."""


@dataclass(frozen=True)
class Version:
    """A model that passed the checks and was handed over.

    Attributes:
        model: the robot as known.
        number: counts the versions handed over.
        samples: samples taken in so far.
        time: stamp of the last of them [s].
    """

    model: PhysicalModel
    number: int
    samples: int
    time: float


@dataclass(frozen=True)
class Error:
    """How well the model in service predicted a chunk before anything was learned from it.

    Attributes:
        time: end of the chunk [s].
        squared: mean squared error of the effort, (n,) [N²·m²].
        variance: of the measured effort over all chunks so far, (n,) [N²·m²].
        number: version that predicted; 0 is the robot description.
    """

    time: float
    squared: np.ndarray
    variance: np.ndarray
    number: int

    @property
    def nmse(self) -> np.ndarray:
        """Squared error over the variance of the effort, (n,); NaN for a joint whose effort has not changed yet."""
        return relative(self.squared, self.variance)

    @property
    def nmse_mean(self) -> float:
        """Mean over the joints whose effort changes; NaN without any."""
        told = self.nmse[changes(self.variance)]
        return float(told.mean()) if len(told) else math.nan

    @property
    def nmse_worst(self) -> float:
        """The largest of these; NaN without any."""
        told = self.nmse[changes(self.variance)]
        return float(told.max()) if len(told) else math.nan


class Learning:
    """An identifier with the rule by which its models replace the one in service.

    A candidate waits for the next chunk, which neither model has seen. It is handed over if it is finite, its mass matrix is
    positive-definite, and its error on that chunk is not larger. The first model, and the first after a change of the robot,
    need not wait: they take over as soon as they explain their own chunk better.

    Args:
        robot: the robot description, known before any motion.
        cutoff: of the low-pass [Hz], None chooses by the rate.
        resume: a model of the robot to go on from, instead of the robot description; its joints in any order.
        number: of the version before the first.
        beat: called at every step of what takes long.

    Attributes:
        served: the last version handed over, or None.
        errors: of each chunk, the latest last, for the caller to take.
        rejected: reasons why updates were not handed over, the latest last.
        changes: of the robot that were noticed, the latest last, for the caller to take.
    """

    def __init__(
        self,
        robot: Robot,
        cutoff: float | None = None,
        resume: PhysicalModel | None = None,
        number: int = 0,
        beat: Callable[[], None] = lambda: None,
    ) -> None:
        self._anew = partial(Learning, robot, cutoff, resume, beat=beat)
        self._before: Dynamics = robot if resume is None else resume
        self._number = number
        known = None
        if resume is not None:
            known = belief(resume, robot)
            robot = robot.set_up_as(resume.robot)
        self.identifier = Identifier(robot, cutoff, belief=known, settle_at=SETTLE_AT, beat=beat)
        self.served: Version | None = None
        self.errors: list[Error] = []
        self.rejected = self.identifier.rejected
        self.changes: list[Change] = []
        self._monitor = Monitor(robot)
        self._eager = True
        self._candidate: Version | None = None
        self._end: float | None = None
        self._spread = _Spread(robot.width)

    def take(self, time: np.ndarray, position: np.ndarray, effort: np.ndarray) -> Iterator[Version]:
        """Learn from samples in order of their stamps; yields each version that is handed over.

        Args:
            time: [s], (N,), later than all before.
            position, effort: [rad], [N·m], (N, n).
        """
        for rows in _pieces(time):
            if self._end is not None and time[rows.start] - self._end > PAUSE_SECONDS:
                yield from self.finish()
            self._end = float(time[rows.stop - 1])
            if self.identifier.feed(time[rows], position[rows], effort[rows]):
                yield from self._review(final=False)

    def finish(self) -> Iterator[Version]:
        """End the stretch of motion: learn from the rest of it."""
        chunks = self.identifier.chunks
        self.identifier.finish()
        self._end = None
        if self.identifier.chunks > chunks:
            yield from self._review(final=True)

    def anew(self) -> Learning:
        """A new learner from the initial belief of this one; it keeps nothing learned, but version numbers count on."""
        return self._anew(self._number if self.served is None else self.served.number)

    # -- handing over ------------------------------------------------------------------------------

    @property
    def _serving(self) -> Dynamics:
        return self._before if self.served is None else self.served.model

    def _review(self, final: bool) -> Iterator[Version]:
        latest, self.identifier.latest = self.identifier.latest, None
        if latest is None:
            return
        signals, rows = latest
        rows = rows[signals.seen[rows].any(axis=1)]
        if not len(rows):  # on its brakes, say: nothing here tells a good model from a bad one
            return
        assert signals.effort is not None
        measured = signals.smooth(signals.effort)[rows]
        self._spread.add(measured)
        before = squared_error(self._serving, signals, rows, measured)
        number = self._number if self.served is None else self.served.number
        self.errors.append(Error(float(signals.time[rows[-1]]), before, self._spread.variance, number))
        changes = self._monitor.look(signals, rows, None if self.served is None else self.served.model)
        if changes:
            self.changes += changes
            self.identifier = self.identifier.restarted(changes[-1].belief)
            self._candidate, self._eager = None, True
            return
        if self._candidate is not None:
            yield from self._hand_over(self._candidate, signals, rows, measured, before)
        self._candidate = self._propose(float(signals.time[rows[-1]]))
        if self._candidate is not None and (self._eager or final):
            yield from self._hand_over(self._candidate, signals, rows, measured, before)

    def _propose(self, time: float) -> Version | None:
        try:
            model = self.identifier.model()
        except (DataError, np.linalg.LinAlgError) as error:
            self.rejected.append(str(error))
            return None
        return Version(model, self._number + model.version, self.identifier.samples, time)

    def _hand_over(
        self, candidate: Version, signals: Signals, rows: np.ndarray, measured: np.ndarray, before: np.ndarray
    ) -> Iterator[Version]:
        self._candidate = None
        try:
            check(candidate.model, signals, rows, measured, before, self._spread.variance)
        except UpdateRejected as error:
            self.rejected.append(str(error))
            return
        self.served, self._eager = candidate, False
        yield candidate


def check(
    model: PhysicalModel,
    signals: Signals,
    rows: np.ndarray,
    measured: np.ndarray,
    before: np.ndarray,
    variance: np.ndarray,
) -> None:
    """Refuse a model that must not be put in service.

    Args:
        signals, rows: motion the model has not seen, and the samples of it that count.
        measured: low-passed effort at those samples, (len(rows), n) [N·m].
        before: mean squared error of the model that serves, (n,).
        variance: of the effort, (n,).

    Raises:
        UpdateRejected: it is not finite, its mass matrix is not positive-definite, or it errs more.
    """
    after = squared_error(model, signals, rows, measured)
    if not np.isfinite(after).all():
        raise UpdateRejected("The update predicts efforts that are not finite.")
    poses = signals.position[rows[:: max(len(rows) // POSES, 1)]]
    matrices = model.mass_matrix(poses)
    try:
        np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        raise UpdateRejected("The update's mass matrix is not positive-definite.") from None
    scale, told = np.maximum(variance, LEAST_VARIANCE), changes(variance)
    told = told if told.any() else np.ones(len(scale), bool)  # what never changes is of no sensor
    old, new = (np.sqrt(np.mean((error / scale)[told])) for error in (before, after))
    if new > WORSE * old + NEGLIGIBLE:
        raise UpdateRejected(
            f"The update errs {new:.1%} on motion it has not seen, the model that serves {old:.1%}."
        )


def squared_error(model: Dynamics, signals: Signals, rows: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Mean squared error of a model's effort, low-passed like the measured one, (n,) [N²·m²]."""
    effort = described_effort(model, signals) if isinstance(model, Robot) else predicted(model, signals)
    return np.asarray(np.mean((signals.smooth(effort)[rows] - measured) ** 2, axis=0))


class _Spread:
    """Running variance of each joint's effort (Chan, Golub and LeVeque 1979)."""

    def __init__(self, width: int) -> None:
        self._count = 0
        self._mean = np.zeros(width)
        self._sum = np.zeros(width)

    def add(self, values: np.ndarray) -> None:
        count, mean = len(values), values.mean(axis=0)
        together = self._count + count
        shift = mean - self._mean
        self._sum += ((values - mean) ** 2).sum(axis=0) + shift**2 * self._count * count / together
        self._mean += shift * count / together
        self._count = together

    @property
    def variance(self) -> np.ndarray:
        return self._sum / max(self._count, 1)


def _pieces(time: np.ndarray) -> Iterator[slice]:
    """Rows in pieces of `STEP_SECONDS`, split at pauses."""
    if len(time) == 0:
        return
    cuts = set((np.flatnonzero(np.diff(time) > PAUSE_SECONDS) + 1).tolist())
    start = 0
    for row in range(1, len(time)):
        if row in cuts or time[row] - time[start] >= STEP_SECONDS:
            yield slice(start, row)
            start = row
    yield slice(start, len(time))
