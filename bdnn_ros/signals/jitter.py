"""Stamps that scatter about an even rate: samples that were taken evenly get their even times back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import uniform_filter1d

from bdnn_ros.recording import Recording

UNEVEN = 0.5
"""Stamps that are further than this share of a period from an even time were made late, or are of something else."""
MOST_LATE = 0.2
"""Share of such stamps above which they are of something else."""
CROWDED = 0.05
"""A sample that comes less than this share of a period before the next says nothing but its noise of how a joint moves."""
CLEAR = 2.5
"""So many times as much as chance would, stamps agree how far they are past the ticks, where a clock ticks at all."""
QUEUE = 15
"""Messages are never late by so many on the whole."""
MOST_LOST = 2
"""More for each that came are never lost."""
ROUNDS = 3
"""In which the clock is found by the stamps that are not late, and those that are not by the clock."""
AROUND = 2.0
"""A clock's own drift is followed over so long [s]."""
FEWEST = 20
"""In fewer samples the two kinds of time cannot be told apart."""
SMOOTHER = 0.9
"""Even times are taken where positions depart from a smooth course by less than this share of what they do by the stamps."""
FELT = 1e-3
"""Stamps that scatter by less than this share of a period are not worth a word."""
EVEN = 1e-6
"""Stamps that are so near to even times throughout [share of a period] are those: they are rounded, no more."""
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
    off, period = recording.time - time, 1.0 / recording.rate
    if off.any():
        told = f"stamps scatter by {1e3 * off.std():.2g} ms about the even rate that positions were taken at; put right."
        late = np.abs(off[off != 0.0]).min() > UNEVEN * period
        if late:
            told = f"{np.count_nonzero(off)} of {len(off)} stamps are late, by up to {1e3 * off.max():.2g} ms; put right."
        said = [f"{recording.name}: {told}"] * bool(late or off.std() > FELT * period)
        recording = replace(recording, time=time, notes=(*recording.notes, *said))
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
        if not moved.any():
            continue
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
    straight = np.linspace(stamps[0], stamps[-1], len(stamps))
    if np.abs(stamps - straight).max() < EVEN * (straight[1] - straight[0]):
        return stamps
    period = _period(stamps)
    around = min(round(AROUND / period), len(stamps) - 1) // 2 * 2 + 1
    turned = _turned(_hand(stamps, period), min(2 * around, len(stamps)))
    lost = None if turned is None else _lost((stamps - stamps[0]) / period - turned - np.arange(len(stamps)))
    if lost is None:
        return stamps
    nominal = stamps[0] + period * (np.arange(len(stamps)) + lost)
    even = nominal + _drift(stamps - nominal, around, UNEVEN * period)
    late = np.abs(stamps - even) > UNEVEN * period
    return stamps if late.mean() > MOST_LATE or (np.diff(even) <= 0.0).any() else even


def _period(stamps: np.ndarray) -> float:
    """Of the clock that stamps (N,) are of [s], whatever few of them are late or lost: by what was lost, or as if nothing was.

    The latter holds where stamps are of whole steps of another clock, of which the most frequent is none of this one.
    """
    periods = _followed(stamps), float(np.mean(np.diff(stamps)))
    return max(
        periods, key=lambda period: float(np.abs(uniform_filter1d(_hand(stamps, period), FEWEST)).mean())
    )


def _followed(stamps: np.ndarray) -> float:
    """The period [s] that is next to the median step, which is off by as many ticks in a thousand as may be lost.

    How far the hand gets over ever longer spans tells it ever better, and lost messages change nothing of that.
    """
    period, lag = float(np.median(np.diff(stamps))), 1
    while lag <= len(stamps) // 2 and lag * period <= AROUND:
        hand = _hand(stamps, period)
        ahead = float(np.angle(np.vdot(hand[:-lag], hand[lag:]))) / (2.0 * np.pi)
        period *= 1.0 + ahead * period / float(np.mean(stamps[lag:] - stamps[:-lag]))
        lag *= 2
    return period


def _hand(stamps: np.ndarray, period: float) -> np.ndarray:
    """Where a hand that goes round once in a period points, (N,) of absolute value 1."""
    return np.asarray(np.exp(2j * np.pi * (stamps - stamps[0]) / period))


def _turned(hand: np.ndarray, most: int) -> np.ndarray | None:
    """How far stamps are past the ticks (N,) [periods], by as few hands around each as tell; None where not so many do."""
    around = FEWEST
    while around < 2 * most:
        turned = uniform_filter1d(hand, min(around, most))
        if np.abs(turned).min() > CLEAR / np.sqrt(min(around, most)):
            return np.asarray(np.unwrap(np.angle(turned)) / (2.0 * np.pi))
        around *= 2
    return None


def _lost(behind: np.ndarray) -> np.ndarray | None:
    """How many messages were lost before each of those that are so far behind an even clock (N,) [periods], but for a constant.

    A message that is late makes up for it, as those that are lost do not: of all whole numbers that never fall these are the
    nearest. One more is lost where those before are below a level and those after above it, of which no single one says much.
    None where so many are late or lost that this is no clock.
    """
    highest, lowest = np.maximum.accumulate(behind), np.minimum.accumulate(behind[::-1])[::-1]
    if np.mean(highest - lowest) > QUEUE or np.ptp(behind) > MOST_LOST * len(behind):
        return None
    first = np.zeros(len(behind) + 1)
    for level in np.arange(np.floor(behind.min()), behind.max()) + 0.5:
        start, stop = np.searchsorted(highest, level, side="right"), np.searchsorted(lowest, level)
        above = np.clip(behind[start:stop] - level, -UNEVEN, UNEVEN)
        first[start + np.argmin(np.concatenate([[0.0], np.cumsum(above)]))] += 1.0
    return np.asarray(np.cumsum(first[:-1]))


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
