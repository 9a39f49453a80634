"""Stamps that scatter about an even rate: evenly taken samples get their even times back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import uniform_filter1d

from bdnn_ros.recording import Recording

UNEVEN = 0.5
"""A stamp further than this share of a period from its even time is late, or the clock is not even."""
MOST_LATE = 0.2
"""Share of such stamps above which the clock is not even."""
CROWDED = 0.05
"""Samples closer than this share of a period show nothing but noise of how a joint moved in between."""
CLEAR = 2.5
"""How much better than by chance stamps must agree in phase to be those of a clock."""
QUEUE = 15
"""Mean lateness, in messages, above which there is no clock."""
MOST_LOST = 2
"""Lost messages per received one above which there is no clock."""
ROUNDS = 3
"""Iterations between finding the drift from punctual stamps and finding these from the drift."""
AROUND = 2.0
"""Time over which a clock's drift counts as linear [s]."""
FEWEST = 20
"""Fewer samples cannot tell even times from stamps."""
SMOOTHER = 0.9
"""Even times are taken if they reduce the positions' deviation from a smooth course to this share or less."""
FELT = 1e-3
"""Scatter, as a share of a period, below which no note is made."""
EVEN = 1e-6
"""Stamps that are all this close to even times [share of a period] are even up to rounding."""
TINY = 1e-30


def without_jitter(recording: Recording) -> Recording:
    """The recording at even times, if its positions show that it was sampled evenly; else unchanged.

    A stamp that is late by dt shifts the position by velocity times dt, which looks like noise of the position and,
    differentiated twice, of the acceleration. If the samples themselves were taken late, evening the times does the same
    harm. So the times that make the positions smoother are taken, first for the stamps that are far too late only, then for
    all.
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
    """When samples were taken, (N,) [s]: at even times if that makes the positions smoother, else at their stamps.

    Args:
        stamps: increasing, (N,) [s].
        position: (N, n).
        rate: samples per second [Hz].
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
    """The corrected times (N,) [s], but the original stamps of segments that would overlap with them.

    Each segment is evened separately, and messages that were delayed in a queue look like a gap.
    """
    result = tried.copy()
    for before, after in pairwise(segments):
        if result[after.start] <= result[before.stop - 1]:
            result[before], result[after] = stamps[before], stamps[after]
    return result


def _spread_out(recording: Recording) -> Recording:
    """Without samples that are stamped just before the next one: they are late, or add nothing but noise."""
    steps = np.diff(recording.time, append=np.inf)
    crowded = steps < CROWDED / recording.rate
    if not crowded.any():
        return recording
    note = f"{recording.name}: {np.count_nonzero(crowded)} of {len(crowded)} messages are stamped just before the next; left out."
    return replace(recording.part(~crowded), notes=(*recording.notes, note))


def _evened(stamps: np.ndarray) -> np.ndarray:
    """Times of an evenly ticking clock with slow drift, (N,) [s]; the stamps themselves if they fit no such clock."""
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
    """Period of the clock behind stamps (N,) [s], robust to some late or lost messages.

    The better of two estimates, by how well stamps agree in phase: one that allows for lost messages, and the mean step. The
    latter holds where stamps are rounded to another clock's ticks, so the most frequent step is not the period.
    """
    periods = _followed(stamps), float(np.mean(np.diff(stamps)))
    return max(
        periods, key=lambda period: float(np.abs(uniform_filter1d(_hand(stamps, period), FEWEST)).mean())
    )


def _followed(stamps: np.ndarray) -> float:
    """The period [s] nearest the median step, which may be off by a little for every lost message.

    The phase advance over ever longer lags refines it; whole lost periods do not change the phase.
    """
    period, lag = float(np.median(np.diff(stamps))), 1
    while lag <= len(stamps) // 2 and lag * period <= AROUND:
        hand = _hand(stamps, period)
        ahead = float(np.angle(np.vdot(hand[:-lag], hand[lag:]))) / (2.0 * np.pi)
        period *= 1.0 + ahead * period / float(np.mean(stamps[lag:] - stamps[:-lag]))
        lag *= 2
    return period


def _hand(stamps: np.ndarray, period: float) -> np.ndarray:
    """Phase of stamps within a period as unit complex numbers, (N,), like a clock hand."""
    return np.asarray(np.exp(2j * np.pi * (stamps - stamps[0]) / period))


def _turned(hand: np.ndarray, most: int) -> np.ndarray | None:
    """Phase of stamps relative to the ticks, (N,) [periods], averaged over just enough stamps; None if they do not agree."""
    around = FEWEST
    while around < 2 * most:
        turned = uniform_filter1d(hand, min(around, most))
        if np.abs(turned).min() > CLEAR / np.sqrt(min(around, most)):
            return np.asarray(np.unwrap(np.angle(turned)) / (2.0 * np.pi))
        around *= 2
    return None


def _lost(behind: np.ndarray) -> np.ndarray | None:
    """Number of messages lost before each message, up to a constant; None if so many are late or lost that there is no clock.

    A late message is followed by ones that are on time, a lost one is never made up for. So this is the nearest non-
    decreasing sequence of integers: it rises where the messages before lie below a half-integer level and those after above
    it, on the whole.

    Args:
        behind: how far each message is behind an even clock, (N,) [periods].
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
    """Slow drift of stamps from an even clock (N,) [s], robust to the few that are off by more than `late` [s]."""
    drift = _line_by_line(behind, around)
    for _ in range(ROUNDS):
        odd = np.abs(behind - drift) > late
        if not odd.any():
            break
        drift = _line_by_line(np.where(odd, drift, behind), around)
    return drift


def _line_by_line(values: np.ndarray, around: int) -> np.ndarray:
    """Moving linear fit to values (N,) over an odd number of samples (Savitzky and Golay 1964)."""
    half = around // 2
    result = uniform_filter1d(values, around)
    if half:
        result[:half], result[-half:] = _line(values[:around])[:half], _line(values[-around:])[-half:]
    return np.asarray(result)


def _line(values: np.ndarray) -> np.ndarray:
    """Straight line fitted to values (N,)."""
    at = np.arange(len(values)) - 0.5 * (len(values) - 1)
    return np.asarray(values.mean() + (at @ values / (at @ at)) * at)


def _smoother(position: np.ndarray, segments: Sequence[slice], stamps: np.ndarray, tried: np.ndarray) -> bool:
    """Whether the corrected times make positions smoother, around the samples that they change."""
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
    """Squared deviations of values (N, n) from the cubic through their four neighbours, (N - 4, n)."""
    at, near = time[2:-2], [time[:-4], time[1:-3], time[3:-1], time[4:]]
    predicted = np.zeros_like(values[2:-2])
    for k, place in enumerate((slice(0, -4), slice(1, -3), slice(3, -1), slice(4, None))):
        others = [other for m, other in enumerate(near) if m != k]
        weight = np.prod([(at - other) / (near[k] - other) for other in others], axis=0)
        predicted += weight[:, None] * values[place]
    return np.asarray((values[2:-2] - predicted) ** 2)
