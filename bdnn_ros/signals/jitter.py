"""Stamps that scatter about an even rate: samples that were taken evenly get their even times back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import uniform_filter1d

from bdnn_ros.recording import Recording

UNEVEN = 0.5
"""Stamps that are further than this share of a period from an even time were made late, or are of something else."""
MOST_LATE = 0.2
"""Share of such stamps above which they are of something else."""
CROWDED = 0.05
"""A sample that comes less than this share of a period before the next says nothing but its noise of how a joint moves."""
QUEUE = 15
"""So many messages in a row are never all late."""
ROUNDS = 3
"""In which the clock is found by the stamps that are not late, and those that are not by the clock."""
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
    the positions smoother is right. It is asked first of stamps that are later than others by far, then of all.
    """
    if len(recording) < FEWEST:
        return recording
    time = taken_at(recording.time, recording.position, recording.rate, recording.segments())
    off = recording.time - time
    if off.any():
        told = f"stamps scatter by {1e3 * off.std():.2g} ms about the even rate that positions were taken at; put right."
        if np.abs(off[off != 0.0]).min() > UNEVEN / recording.rate:
            told = f"{np.count_nonzero(off)} of {len(off)} stamps are late, by up to {1e3 * off.max():.2g} ms; put right."
        recording = replace(recording, time=time, notes=(*recording.notes, f"{recording.name}: {told}"))
    return _spread_out(recording)


def taken_at(stamps: np.ndarray, position: np.ndarray, rate: float, segments: Sequence[slice]) -> np.ndarray:
    """When samples were taken, (N,) [s]: at even times where their positions say so, else at their stamps.

    Args:
        stamps: increasing, (N,) [s].
        position: (N, n).
        rate: samples a second [Hz].
        segments: rows without gaps.
    """
    time, even = stamps, stamps.copy()
    for rows in segments:
        even[rows] = _evened(stamps[rows])
    for moved in (np.abs(stamps - even) > UNEVEN / rate, even != stamps):
        tried = _in_order(stamps, np.where(moved, even, stamps), segments)
        if (np.diff(tried) > 0.0).all() and _smoother(position, segments, time, tried):
            time = tried
    return time


def _in_order(stamps: np.ndarray, tried: np.ndarray, segments: Sequence[slice]) -> np.ndarray:
    """The times that are tried (N,) [s], but the stamps on both sides of a gap that they would turn round.

    Each segment has a clock of its own, and messages that waited in a queue make a gap that there is not.
    """
    result = tried.copy()
    for before, after in pairwise(segments):
        if result[after.start] <= result[before.stop - 1]:
            result[before], result[after] = stamps[before], stamps[after]
    return result


def _spread_out(recording: Recording) -> Recording:
    """Without samples that come so shortly before the next one that they were stamped late, or say nothing."""
    steps = np.diff(recording.time, append=np.inf)
    crowded = steps < CROWDED / recording.rate
    if not crowded.any():
        return recording
    note = f"{recording.name}: {np.count_nonzero(crowded)} of {len(crowded)} messages are stamped just before the next; left out."
    return replace(recording.part(~crowded), notes=(*recording.notes, note))


def _evened(stamps: np.ndarray) -> np.ndarray:
    """Times of a clock that ticks evenly but for a slow drift, (N,) [s]; the stamps where they are of no such clock."""
    if len(stamps) < FEWEST:
        return stamps
    period = float(np.median(np.diff(stamps)))
    around = min(round(AROUND / period), len(stamps) - 1) // 2 * 2 + 1
    clocks = []
    for ticks in _ticks(np.diff(stamps) / period):
        nominal = stamps[0] + period * np.concatenate([[0.0], np.cumsum(ticks)])
        clocks.append(nominal + _drift(stamps - nominal, around, UNEVEN * period))
    even = min(clocks, key=lambda clock: float(np.abs(stamps - clock).mean()))
    late = np.abs(stamps - even) > UNEVEN * period
    return stamps if late.mean() > MOST_LATE or (np.diff(even) <= 0.0).any() else even


def _ticks(steps: np.ndarray) -> list[np.ndarray]:
    """How often the clock may have ticked in each step, (N - 1,) periods: were no message late, none lost, or some of both."""
    # a message that is late makes up for it, as those that are lost do not: no later one is as little behind as before
    behind = np.pad(np.concatenate([[0.0], np.cumsum(steps - 1.0)]), (0, QUEUE - 1), mode="edge")
    lost = np.diff(sliding_window_view(behind, QUEUE).min(axis=1))
    both = np.where(steps > 1.0 + UNEVEN, 1.0 + np.maximum(np.rint(lost), 0.0), 1.0)
    ticks = [np.maximum(np.rint(steps), 1.0)]
    return ticks + [other for other in (np.ones(len(steps)), both) if (other != ticks[0]).any()]


def _drift(behind: np.ndarray, around: int, late: float) -> np.ndarray:
    """What stamps are behind an even clock for long (N,) [s], whatever few of them are late by more than others [s]."""
    drift = _line_by_line(behind, around)
    for _ in range(ROUNDS):
        odd = np.abs(behind - drift) > late
        if not odd.any():
            break
        drift = _line_by_line(np.where(odd, drift, behind), around)
    return drift


def _line_by_line(values: np.ndarray, around: int) -> np.ndarray:
    """Each value (N,) on the straight line that is nearest to the odd number around it (Savitzky and Golay 1964)."""
    half = around // 2
    result = uniform_filter1d(values, around)
    if half:
        result[:half], result[-half:] = _line(values[:around])[:half], _line(values[-around:])[-half:]
    return np.asarray(result)


def _line(values: np.ndarray) -> np.ndarray:
    """The straight line nearest to values (N,)."""
    at = np.arange(len(values)) - 0.5 * (len(values) - 1)
    return np.asarray(values.mean() + (at @ values / (at @ at)) * at)


def _smoother(position: np.ndarray, segments: Sequence[slice], stamps: np.ndarray, tried: np.ndarray) -> bool:
    """Whether positions depart less from a smooth course by the times that are tried, around those that are others."""
    rough, smooth = [], []
    for rows in segments:
        other = np.convolve(stamps[rows] != tried[rows], np.ones(5), mode="valid") > 0.0
        if other.any():
            rough.append(_roughness(stamps[rows], position[rows])[other])
            smooth.append(_roughness(tried[rows], position[rows])[other])
    if not rough:
        return False
    before, after = (np.concatenate(each).mean(axis=0) for each in (rough, smooth))
    moving = before > TINY
    return bool(
        moving.any()
        and np.log(np.maximum(after, TINY)[moving] / before[moving]).mean() <= 2.0 * np.log(SMOOTHER)
    )


def _roughness(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Squares by which values (N, n) depart from the cubic through their four neighbours, (N - 4, n)."""
    at, near = time[2:-2], [time[:-4], time[1:-3], time[3:-1], time[4:]]
    predicted = np.zeros_like(values[2:-2])
    for k, place in enumerate((slice(0, -4), slice(1, -3), slice(3, -1), slice(4, None))):
        others = [other for m, other in enumerate(near) if m != k]
        weight = np.prod([(at - other) / (near[k] - other) for other in others], axis=0)
        predicted += weight[:, None] * values[place]
    return np.asarray((values[2:-2] - predicted) ** 2)
