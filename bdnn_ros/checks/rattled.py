"""Times left out because a drive rattles (its effort oscillates)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bdnn_ros.physical.remark import Remark
from bdnn_ros.recording import Recording
from bdnn_ros.signals.rattling import rattling


def rattled(recording: Recording) -> Iterator[Remark]:
    """The joint that rattles the longest, if any does."""
    samples = rattling(recording)
    if not samples.any():
        return
    worst = int(np.argmax(samples.sum(axis=0)))
    rows = np.flatnonzero(samples[:, worst])
    seconds = len(rows) / max(recording.rate, 1e-9)
    yield Remark(
        recording.joints[worst],
        f"{recording.name}: {recording.joints[worst]} rattles for {seconds:.2g} s, first at "
        f"{recording.time[rows[0]]:.2f} s: its effort goes to and fro faster than the robot moves.",
        "Look for play in its gear, or lower the gains of its controller; such moments do not count.",
    )
