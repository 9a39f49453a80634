"""Recordings that a driver or a sensor spoiled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.recording import Recording


def glitched(recording: Recording, seed: int = 0) -> Recording:
    """A few efforts and positions read wrong, one or two in a row."""
    rng = np.random.default_rng(seed)
    position, effort = recording.position.copy(), recording.require_effort().copy()
    for row in rng.choice(len(recording) - 2, 6, replace=False):
        effort[row : row + 1 + row % 2, row % recording.width] = 10.0 * np.abs(effort).max()
    for row in rng.choice(len(recording) - 2, 2, replace=False):
        position[row, row % recording.width] += 0.3
    return replace(recording, position=position, effort=effort)


def clipped(recording: Recording, share: float) -> Recording:
    effort = recording.require_effort()
    limit = share * np.abs(effort).max(axis=0)
    return replace(recording, effort=np.clip(effort, -limit, limit))


def dropped(recording: Recording) -> Recording:
    """All efforts zero for 60 ms, five times."""
    effort = recording.require_effort().copy()
    for start in np.linspace(0.1, 0.9, 5) * recording.duration:
        effort[(recording.time > start) & (recording.time < start + 0.06)] = 0.0
    return replace(recording, effort=effort)


def without_effort(recording: Recording, joint: int) -> Recording:
    effort = recording.require_effort().copy()
    effort[:, joint] = 0.0
    return replace(recording, effort=effort)


def repeating(recording: Recording, joint: int, spans: Sequence[tuple[int, int]]) -> Recording:
    """All readings of a joint stay as they are at the first of rows [start, stop)."""
    fields = {"position": recording.position, "velocity": recording.velocity, "effort": recording.effort}
    held = {name: values.copy() for name, values in fields.items() if values is not None}
    for values in held.values():
        for start, stop in spans:
            values[start:stop, joint] = values[start, joint]
    return replace(recording, **held)


def held_effort(recording: Recording, joint: int, rows: slice) -> Recording:
    """One joint's effort stays as it is at the first of some rows."""
    effort = recording.require_effort().copy()
    effort[rows, joint] = effort[rows.start, joint]
    return replace(recording, effort=effort)
