"""Efforts that come late: behind a sensor's low-pass, or stamped after the positions.

An effort that acts later than it is measured is a cause, `effort_delay`. One that is measured later than it acts is none, and
up to some milliseconds the regression takes it for what it is (`Equations.nuisances`); what is later passes for friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.checks.alternatives import explained
from bdnn_ros.checks.sampling import lowest, some, telling
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals

LATEST = 0.2
"""Efforts may be so late [s]."""
LEAST = 0.015
"""Less is left to the regression [s]."""
LEFT = 0.002
"""So much is left to it of what is more, too: an effort that is moved too far would act later than it was measured."""
BETTER = 1.25
"""An effort is late where so many times less is left unexplained once it is not."""
MOST_ROWS = 500


def lateness(signals: Signals, robot: Robot) -> float:
    """How late the efforts of a motion are, all alike [s]; 0 where that is little, or not sure."""
    assert signals.effort is not None
    most = round(LATEST * signals.rate)
    inside = signals.interior & telling(signals).any(axis=1)
    rows = np.concatenate([np.arange(s.start, max(s.stop - most, s.start)) for s in signals.segments])
    rows = some(rows[inside[rows]], MOST_ROWS)
    if len(rows) < 0.1 * MOST_ROWS:
        return 0.0
    velocity, acceleration = signals.velocity[rows], signals.acceleration[rows]
    borne = robot.rigid_effort(signals.position[rows], velocity, acceleration)
    columns = borne, acceleration, velocity, signals.sign[rows]
    left = np.array([1.0 - explained(signals.effort[rows + k], *columns) for k in range(most)])
    late = lowest(left) / signals.rate
    return late - LEFT if late >= LEAST and left[0] > BETTER * left.min() else 0.0


def in_time(recordings: Sequence[Recording], late: float) -> list[Recording]:
    """Recordings with efforts that are so late [s] moved to when they acted, with a note."""
    return [_in_time(recording, late) for recording in recordings] if late else list(recordings)


def _in_time(recording: Recording, late: float) -> Recording:
    samples = round(late * recording.rate)
    rows = np.concatenate([np.arange(s.start, max(s.stop - samples, s.start)) for s in recording.segments()])
    if not samples or not len(rows):
        return recording
    note = (
        f"{recording.name}: the effort comes about {1e3 * (late + LEFT):.0f} ms after the motion it belongs to; it is moved. "
        "Stamp position and effort where they are measured."
    )
    kept = recording.part(rows)
    effort = recording.require_effort()[rows + samples]
    return replace(kept, effort=effort, notes=(*recording.notes, note))
