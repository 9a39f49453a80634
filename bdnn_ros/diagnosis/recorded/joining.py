"""Joining several recordings into one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from bdnn_ros.errors import UsageError
from bdnn_ros.recording import Recording
from bdnn_ros.signals import Signals, prepare, usual_cutoff
from bdnn_ros.signals.preparing import working_rate

SAME_RATE = 0.02
"""Relative difference up to which measured rates count as the same."""


def prepared_alike(recordings: Sequence[Recording], cutoff: float | None = None) -> list[Signals]:
    """Signals of several recordings behind one low-pass and, if rates differ, at one rate: those of the slowest.

    Args:
        cutoff: low-pass [Hz], None chooses.

    Raises:
        RecordingError: one is too short.
        UsageError: the cut-off does not fit a rate.
    """
    slowest = min(recording.rate for recording in recordings)
    cutoff = usual_cutoff(slowest) if cutoff is None else cutoff
    alike = all(recording.rate <= (1.0 + SAME_RATE) * slowest for recording in recordings)
    working = None if alike else working_rate(slowest, cutoff)
    return [prepare(recording, cutoff, working) for recording in recordings]


def concatenated(parts: list[Signals], recorded: Sequence[np.ndarray] | None = None) -> Signals:
    """Several signals of the same joints as one; stamps are shifted so that they follow one another.

    Args:
        recorded: stamps of the recordings that the parts were made of [s], which may begin earlier and define the common
            clock; None takes the parts' own.

    Raises:
        UsageError: their joints differ.
        ValueError: they were not prepared alike, so that one kernel does not fit all.
    """
    if len(parts) == 1:
        return parts[0]
    for part in parts[1:]:
        if part.joints != parts[0].joints:
            raise UsageError(
                f"The recordings hold different joints: {part.joints}.", "Choose them with --joints."
            )
        if part.cutoff != parts[0].cutoff or abs(part.rate / parts[0].rate - 1.0) > SAME_RATE:
            raise ValueError(
                f"signals of {parts[0].rate:.4g} Hz and {part.rate:.4g} Hz were not prepared alike"
            )
    rows = np.cumsum([0, *map(len, parts[:-1])]).tolist()
    times = [part.time for part in parts] if recorded is None else recorded
    moved = own_zeros(times)

    def joined(key: str) -> Any:
        values = [getattr(part, key) for part in parts]
        return None if any(v is None for v in values) else np.concatenate(values)

    keys = ("position", "velocity", "acceleration", "effort", "reported_velocity", "unmeasured")
    return replace(
        parts[0],
        time=np.concatenate([part.time + shift for part, shift in zip(parts, moved, strict=True)]),
        segments=tuple(
            slice(s.start + k, s.stop + k) for p, k in zip(parts, rows, strict=True) for s in p.segments
        ),
        raw_rate=min(p.raw_rate for p in parts),  # the slowest one's: no extra samples are counted on
        position_noise=np.max([p.position_noise for p in parts], axis=0),
        effort_noise=_largest([p.effort_noise for p in parts]),
        begun=tuple(float(part.time[0] + shift) for part, shift in zip(parts, moved, strict=True)),
        **{key: joined(key) for key in keys},
    )


def own_zeros(times: Sequence[np.ndarray]) -> list[float]:
    """Time on the common clock at the zero of each recording's own clock, from their stamps [s].

    The first keeps its clock; each other one's zero, or its first stamp if earlier, is a second after the last stamp before.
    So leaving samples out of a recording shifts none of its times.
    """
    result = [0.0]
    for before, time in pairwise(times):
        result.append(float(result[-1] + before[-1] + 1.0 - min(time[0], 0.0)))
    return result


def starts(times: Sequence[np.ndarray]) -> list[float]:
    """Time on the common clock at the first stamp of each recording [s]."""
    return [zero + float(time[0]) for zero, time in zip(own_zeros(times), times, strict=True)]


def owners(time: np.ndarray, begun: Sequence[float]) -> np.ndarray:
    """Number of the recording that each stamp (N,) belongs to, (N,) int, given their start times; all the same if none."""
    return np.searchsorted(np.asarray(begun, float), time, side="right")


def stretches(time: np.ndarray, begun: Sequence[float]) -> list[tuple[float, float]]:
    """First and last stamp of each recording, from all stamps (N,) and the times at which they began [s]."""
    pieces = np.split(time, np.flatnonzero(np.diff(owners(time, begun))) + 1)
    return [(float(piece[0]), float(piece[-1])) for piece in pieces]


def without_pauses(time: np.ndarray, begun: Sequence[float]) -> np.ndarray:
    """Stamps (N,) on a clock that stands still between recordings, (N,) [s]."""
    next_one = np.diff(owners(time, begun), prepend=0) > 0
    next_one[:1] = False
    return np.asarray(time - np.cumsum(np.where(next_one, np.diff(time, prepend=time[:1]), 0.0)))


def _largest(values: Sequence[np.ndarray | None]) -> np.ndarray | None:
    given = [value for value in values if value is not None]
    return np.max(given, axis=0) if len(given) == len(values) else None
