"""Identification from recordings beyond their samples: delays, low-passes, splitting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.diagnosis.recorded.lateness import Lateness, lateness
from bdnn_ros.diagnosis.recorded.velocity_filter import lag_of, reported_velocity
from bdnn_ros.errors import RecordingError
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare


def stretches(recording: Recording, seconds: float) -> list[slice]:
    """Slices of the recording of so many seconds each."""
    number = np.floor((recording.time - recording.time[0]) / seconds)
    bounds = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(recording)]
    return [slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]


def usual_lateness(recordings: Sequence[Recording], robot: Robot, cutoff: float | None) -> Lateness:
    """Median delay of the efforts of the recordings; zero if they are too short to estimate it."""
    found = []
    for recording in recordings:
        try:
            found.append(lateness(prepare(recording, cutoff), robot))
        except RecordingError:
            continue
    return sorted(found, key=lambda late: late.total)[len(found) // 2] if found else Lateness()


def as_recorded(
    model: PhysicalModel, recordings: Sequence[Recording], late: Lateness, cutoff: float | None
) -> PhysicalModel:
    """The model with the effects of the sensors in its recordings: delayed efforts, low-passed velocities."""
    try:
        told = reported_velocity(recordings, cutoff)
    except RecordingError:
        told = []
    passed = {str(one.joint): lag_of(one.parameters["cutoff"].value) for one in told}
    lags = tuple(passed.get(joint, 0.0) for joint in model.joints) if passed else ()
    return replace(model, lead=model.lead - late.delay, lag=late.lag, velocity_lags=lags)
