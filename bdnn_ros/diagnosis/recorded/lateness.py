"""Efforts that are measured late: behind a low-pass of sensor or driver, or stamped after the positions.

An effort that acts later than it is measured is a cause, `effort_delay`. One measured later than it acts is not, and a lag of
some milliseconds is a nuisance of the regression (`Nuisances`); a longer one would pass for friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.checks.alternatives import explained
from bdnn_ros.checks.sampling import lowest, some, telling
from bdnn_ros.diagnosis.recorded.residuals import basis, projected_out, regret
from bdnn_ros.effects.bristles import bristles
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals, mended

LATEST = 0.2
"""Longest delay tried [s]."""
LEAST = 0.008
"""Shorter delays are left to the regression [s]."""
LEFT = 0.001
"""Part of a longer one that is left to it, too [s]: an effort moved too far would act later than it was measured."""
BETTER = 1.25
"""Efforts are late if moving them leaves this many times less unexplained."""
LAGS = tuple(0.005 * 1.15**k for k in range(27))
"""Time constants of low-passes tried [s]."""
BREAKAWAYS = (0.001, 0.004, 0.016)
"""Breakaway distances of pre-sliding friction allowed for [rad or m]."""
NEAR = tuple(1.08**k for k in range(-3, 6))
"""Time constants tried last, relative to the best one."""
NEARBY = range(-2, 4)
"""Delays tried last, in samples from the best one."""
MOST_ROWS = 500
TOLD_BY = 1500
"""Rows that the last step uses."""
TINY = 1e-30


@dataclass(frozen=True)
class Lateness:
    """Lateness of all efforts.

    Attributes:
        delay: by which they were stamped after they acted [s].
        lag: time constant of a first-order low-pass (exponential smoothing) that they had passed instead [s].
    """

    delay: float = 0.0
    lag: float = 0.0

    @property
    def total(self) -> float:
        """Lateness of slowly changing efforts [s]."""
        return self.delay + self.lag


def lateness(signals: Signals, robot: Robot) -> Lateness:
    """Lateness of the efforts of a motion; none if it is small or not certain.

    Joints that stand still are ignored.
    """
    efforts = _Efforts(signals)
    rows = some(efforts.rows, MOST_ROWS)
    if len(rows) < 0.1 * MOST_ROWS:
        return Lateness()
    velocity, acceleration = signals.velocity[rows], signals.acceleration[rows]
    borne = robot.rigid_effort(signals.position[rows], velocity, acceleration)
    bends = _bends(signals)
    speaks = telling(signals)[rows].any(axis=0)
    columns = [
        one[:, speaks]
        for one in (borne, acceleration, velocity, signals.sign[rows], *(bend[rows] for bend in bends))
    ]

    def left(effort: np.ndarray) -> float:
        return 1.0 - explained(effort[:, speaks], *columns)

    delayed = np.array([left(efforts.earlier(rows, k)) for k in range(efforts.most)])
    lagging = np.array([left(efforts.without_lag(rows, lag)) for lag in LAGS])
    if delayed[0] <= BETTER * min(delayed.min(), lagging.min()):
        return Lateness()
    samples, lag = int(np.argmin(delayed)), LAGS[int(np.argmin(lagging))]
    found = _refined(signals, robot, efforts, samples, lag, bends, np.flatnonzero(speaks))
    return found if found.total >= LEAST - LEFT else Lateness()


class _Efforts:
    """The efforts of a motion, shifted earlier.

    Attributes:
        rows: samples followed by at least the longest delay, (R,).
        most: delays are less than this many samples.
    """

    def __init__(self, signals: Signals) -> None:
        assert signals.effort is not None
        self.most = round(LATEST * signals.rate)
        inside = signals.interior & telling(signals).any(axis=1)
        rows = np.concatenate(
            [np.arange(s.start, max(s.stop - self.most, s.start)) for s in signals.segments]
        )
        self.rows = rows[inside[rows]]
        self._effort = signals.effort
        self._change = signals.derivative(signals.effort)

    def earlier(self, rows: np.ndarray, samples: int) -> np.ndarray:
        """Efforts stamped so many samples earlier, (R, n)."""
        return np.asarray(self._effort[rows + samples])

    def without_lag(self, rows: np.ndarray, lag: float) -> np.ndarray:
        """Efforts with a first-order low-pass of a time constant [s] undone, (R, n)."""
        return np.asarray(self._effort[rows] + lag * self._change[rows])


def _bends(signals: Signals) -> list[np.ndarray]:
    """Pre-sliding friction over several breakaway distances, (N, n) each, since it reverses late, too."""
    joints = range(signals.width)
    return [np.stack([bristles(signals, joint, over) for joint in joints], axis=1) for over in BREAKAWAYS]


def _refined(
    signals: Signals,
    robot: Robot,
    efforts: _Efforts,
    samples: int,
    lag: float,
    bends: Sequence[np.ndarray],
    speaking: np.ndarray,
) -> Lateness:
    """The better of a delay near so many samples and a lag near one [s], beside arbitrary bodies; none if not clear.

    Friction may reverse early, as in sticking (its direction's rate is a column), or late, as in pre-sliding.

    Args:
        speaking: indices of the joints that move.
    """
    rows = some(efforts.rows, TOLD_BY)
    direction = signals.derivative(signals.sign)[rows]
    position, velocity, acceleration = (
        signals.position[rows],
        signals.velocity[rows],
        signals.acceleration[rows],
    )
    bent = (bend[rows] for bend in bends)
    own = np.stack(
        [acceleration, velocity, signals.sign[rows], direction, np.ones_like(velocity), *bent], axis=2
    )
    columns = np.concatenate([robot.regressor(position, velocity, acceleration), own], axis=2)
    bases = [basis(columns[:, joint]) for joint in speaking]

    def left(effort: np.ndarray) -> np.ndarray:
        rest = [
            projected_out(effort[:, joint], spanned) for joint, spanned in zip(speaking, bases, strict=True)
        ]
        return np.log(np.maximum(np.mean(np.square(rest), axis=1), TINY))

    delays = [k for k in (samples + step for step in NEARBY) if 0 <= k < efforts.most]
    tried = [left(efforts.earlier(rows, k)) for k in delays]
    tried += [left(efforts.without_lag(rows, lag * k)) for k in NEAR]
    as_stamped, delayed, lagging = np.split(
        regret(np.array([left(efforts.earlier(rows, 0)), *tried])), [1, 1 + len(delays)]
    )
    if as_stamped[0] < min(delayed.min(), lagging.min()) + np.log(BETTER):
        return Lateness()
    if delayed.min() <= lagging.min():
        return Lateness(delay=max((delays[0] + lowest(delayed)) / signals.rate - LEFT, 0.0))
    return Lateness(lag=lag * NEAR[0] * (NEAR[1] / NEAR[0]) ** lowest(lagging) - LEFT)


def without_lateness(recordings: Sequence[Recording], late: Lateness) -> tuple[list[Recording], Lateness]:
    """Recordings with their efforts' lateness undone, with a note, and how much was undone.

    A delay is undone by whole samples; for several recordings the average is returned.
    """
    if late.lag:
        return [_without_lag(mended(recording), late) for recording in recordings], late
    if not late.delay:
        return list(recordings), late
    moved = [samples / one.rate if (samples := _samples(one, late)) else 0.0 for one in recordings]
    average = float(np.average(moved, weights=[len(one) for one in recordings]))
    return [_earlier(recording, late) for recording in recordings], Lateness(delay=average)


def note(recording: Recording, late: Lateness) -> str:
    """The note on a recording whose efforts come late."""
    if late.lag:
        return (
            f"{recording.name}: the efforts passed a low-pass of first order, of about {0.5 / np.pi / (late.lag + LEFT):.1f} "
            "Hz, before they were recorded; it is taken back. Record them as they are measured."
        )
    return (
        f"{recording.name}: the effort comes about {1e3 * (late.delay + LEFT):.0f} ms after the motion it belongs to; it is "
        "moved. Stamp position and effort where they are measured."
    )


def _samples(recording: Recording, late: Lateness) -> int:
    """Whole samples by which efforts are moved; none if no data would be left."""
    samples = round(late.delay * recording.rate)
    return samples if samples < max(s.stop - s.start for s in recording.segments()) else 0


def _earlier(recording: Recording, late: Lateness) -> Recording:
    samples = _samples(recording, late)
    if not samples:
        return recording
    rows = np.concatenate([np.arange(s.start, max(s.stop - samples, s.start)) for s in recording.segments()])
    effort = recording.require_effort()[rows + samples]
    return _with(recording, rows, effort, late)


def _without_lag(recording: Recording, late: Lateness) -> Recording:
    """A recording with exponential smoothing of its efforts undone: x[k] = y[k] + lag / period (y[k] - y[k - 1])."""
    rows = np.concatenate([np.arange(s.start + 1, s.stop) for s in recording.segments()])
    if not len(rows):
        return recording
    effort = recording.require_effort()
    acted = effort[rows] + late.lag * recording.rate * (effort[rows] - effort[rows - 1])
    return _with(recording, rows, acted, late)


def _with(recording: Recording, rows: np.ndarray, effort: np.ndarray, late: Lateness) -> Recording:
    return replace(recording.part(rows), effort=effort, notes=(*recording.notes, note(recording, late)))
