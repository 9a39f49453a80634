"""Stamps that scatter about an even rate: samples that were taken evenly get their even times back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import savgol_filter

from bdnn_ros.recording import Recording

UNEVEN = 0.5
"""Stamps that are further than this share of a period from an even time are of something else."""
AROUND = 2.0
"""A clock's own drift is followed over so long [s]."""
FEWEST = 20
"""In fewer samples the two kinds of time cannot be told apart."""
SMOOTHER = 0.9
"""Even times are taken where positions depart from a smooth course by less than this share of what they do by the stamps."""
TINY = 1e-30


def without_jitter(recording: Recording) -> Recording:
    """The recording at even times, where the positions say that it was sampled so; as it is otherwise.

    A stamp that is late by dt moves a joint by its velocity times dt, which passes for noise of the position and, differentiated
    twice, for noise of the acceleration. Where the samples themselves were taken late, even times do the same: whichever makes
    the positions smoother is right.
    """
    time, rough, smooth = recording.time.copy(), [], []
    for rows in recording.segments():
        stamps = recording.time[rows]
        even = _evened(stamps)
        if even is not None:
            time[rows] = even
            rough.append(_roughness(stamps, recording.position[rows]))
            smooth.append(_roughness(even, recording.position[rows]))
    if not rough:
        return recording
    before, after = (np.concatenate(each).mean(axis=0) for each in (rough, smooth))
    moving = before > TINY
    if not moving.any() or np.log(after[moving] / before[moving]).mean() > 2.0 * np.log(SMOOTHER):
        return recording
    scatter = 1e3 * float(np.std(recording.time - time))
    note = f"{recording.name}: stamps scatter by {scatter:.2g} ms about the even rate that positions were taken at; put right."
    return replace(recording, time=time, notes=(*recording.notes, note))


def _evened(stamps: np.ndarray) -> np.ndarray | None:
    """Times of a clock that ticks evenly but for a slow drift, (N,) [s]; None where the stamps are of no such clock."""
    if len(stamps) < FEWEST:
        return None
    steps = np.diff(stamps)
    period = float(np.median(steps))
    ticks = np.rint(steps / period)
    if (ticks < 1.0).any():
        return None
    nominal = stamps[0] + period * np.concatenate([[0.0], np.cumsum(ticks)])
    around = min(round(AROUND / period), len(stamps) - 1) // 2 * 2 + 1
    even = nominal + savgol_filter(stamps - nominal, around, 1)
    return even if (np.abs(stamps - even) < UNEVEN * period).all() else None


def _roughness(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Squares by which values (N, n) depart from the cubic through their four neighbours, (N - 4, n)."""
    at, near = time[2:-2], [time[:-4], time[1:-3], time[3:-1], time[4:]]
    predicted = np.zeros_like(values[2:-2])
    for k, place in enumerate((slice(0, -4), slice(1, -3), slice(3, -1), slice(4, None))):
        others = [other for m, other in enumerate(near) if m != k]
        weight = np.prod([(at - other) / (near[k] - other) for other in others], axis=0)
        predicted += weight[:, None] * values[place]
    return np.asarray((values[2:-2] - predicted) ** 2)
