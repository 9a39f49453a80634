"""Outliers: single readings that a bus or a sensor got wrong for a sample or two."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.ndimage import median_filter

from bdnn_ros.errors import listed
from bdnn_ros.recording import Recording, moving

WINDOW = 5
"""Samples of the median filter: it bridges an outlier of two samples and keeps steps."""
STANDS_OUT = 20.0
"""An outlier is this many times as far from the median as nine of ten readings around it,"""
AROUND = 25
"""of so many readings on either side,"""
RARE = 5.0
"""this many times as far as all but one in a hundred of the recording,"""
OFTEN, SAME = 5, 1.01
"""(the resolution is the smallest change between samples, if so many changes are within this factor of it)"""
RESOLUTIONS = 1.5
"""further than this many times the sensor's resolution, as a reading at rest flips its last digit now and then,"""
BEYOND = 1.0
"""Frequent outliers are removed only if they are further from the median than this share of the medians' range, and not
velocities, which impacts in a gear throw as far:"""
PASSES = 3
"""in so many passes, as some are seen only when their neighbours are gone,"""
WIDE = 11
"""by a wider median, as three of five samples may be wrong, and more than one in ten around,"""
MOST = {WINDOW: 90.0, WIDE: 75.0}
"""so each is compared with three in four of the readings around, not nine in ten [%], by the median's width."""
JUMPS, MUCH = 0.3, 0.01
"""Readings this far from the median (per that range) jump; a note reports them if this share of all do, ..."""
UNUSUAL = 10.0
"""... and are this many times as far from it as half of the readings around: noise is not."""
SHARES = {"position": 0.01, "velocity": 0.5, "effort": 0.5}
"""and further than this share of the readings' range: positions do not jump, but impacts in a gear last a sample."""


def without_glitches(recording: Recording) -> Recording:
    """The recording with isolated outliers replaced by the median of the five readings around them.

    A low-pass spreads a single wrong reading, which then looks like a push. What lasts three samples is kept, as such a brief
    contact may be real; so are frequent outliers, unless they are far outside the range of all other readings. A note reports
    what still jumps.
    """
    found: dict[str, int] = {}
    mended: dict[str, Any] = {}
    for field, share in SHARES.items():
        values = getattr(recording, field)
        if values is None or len(values) <= 2 * AROUND:
            continue
        moves = np.ones(recording.width, bool) if field == "effort" else moving(recording)
        far = np.zeros_like(moves) if field == "velocity" else moves
        clean, counts = _bridged(values, share, recording.segments(), moves, far)
        if counts.any():
            mended[field] = clean
            for joint, count in zip(recording.joints, counts, strict=True):
                found[joint] = found.get(joint, 0) + int(count)
    told = []
    if mended:
        joints = listed(joint for joint, count in found.items() if count)
        readings = "1 reading" if sum(found.values()) == 1 else f"{sum(found.values())} readings"
        told.append(
            f"{recording.name}: {readings} of {joints} stood out alone ({listed(mended)}); "
            "replaced by the median of the readings around. Check the driver and its bus."
        )
        recording = replace(recording, **mended)
    told += [note for note in jumping(recording) if note not in recording.notes]
    return replace(recording, notes=(*recording.notes, *told)) if told else recording


def jumping(recording: Recording) -> list[str]:
    """Notes on moving joints whose positions or efforts jump back and forth for a sample or two."""
    found, moves = [], moving(recording)
    for field in ("position", "effort"):
        values = getattr(recording, field)
        if values is None or len(values) <= 2 * AROUND:
            continue
        apart, usual = _apart(values, recording.segments())
        least = JUMPS * _range(usual)
        for joint in np.flatnonzero(moves & ((apart > least).mean(axis=0) > MUCH)):
            own, finest = apart[:, joint], RESOLUTIONS * resolution(values[:, joint])
            rows = np.flatnonzero(own > max(least[joint], finest))
            around = (own[max(row - AROUND, 0) : row + AROUND + 1] for row in rows)
            often = [own[row] > UNUSUAL * np.median(some) for row, some in zip(rows, around, strict=True)]
            share = np.count_nonzero(often) / len(own)
            if share > MUCH:
                found.append(
                    f"{recording.name}: {100.0 * share:.2g} % of the {field}s of {recording.joints[joint]} jump to and fro for "
                    "a sample or two: nothing sure can be said with them. Check the driver and its bus."
                )
    return found


def _apart(values: np.ndarray, segments: list[slice], window: int = WINDOW) -> tuple[np.ndarray, np.ndarray]:
    """Distance of values (N, n) from the median around them, and that median, (N, n) each."""
    usual = np.concatenate([median_filter(values[rows], (window, 1), mode="nearest") for rows in segments])
    return np.abs(values - usual), usual


def _range(values: np.ndarray) -> np.ndarray:
    """Range of values (N, n) without the few most extreme, (n,)."""
    low, high = np.percentile(values, [0.5, 99.5], axis=0)
    return np.asarray(high - low)


def _bridged(
    values: np.ndarray, share: float, segments: list[slice], moves: np.ndarray, far: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Values (N, n) without outliers, and how many each column had, (n,).

    Args:
        moves: columns that move, (n,) bool; at rest outliers are ignored.
        far: columns in which frequent outliers count too, if they are beyond the range of the others, (n,) bool.
    """
    wrong, usual, often = _standing_out(values, share, segments, moves, far)
    if not wrong.any():
        return values, np.zeros(values.shape[1], int)
    wrong &= ~often
    clean, counts = np.where(wrong, usual, values), wrong.sum(axis=0)
    for _ in range(PASSES if often.any() else 0):
        wrong, usual, _ = _standing_out(clean, share, segments, often, often, WIDE)
        clean = np.where(wrong, usual, clean)
        counts += wrong.sum(axis=0)
    return clean, counts


def _standing_out(
    values: np.ndarray,
    share: float,
    segments: list[slice],
    moves: np.ndarray,
    far: np.ndarray,
    window: int = WINDOW,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Outliers among values (N, n), (N, n) bool; the median around each, (N, n); columns with frequent ones, (n,) bool."""
    apart, usual = _apart(values, segments, window)
    least = np.where(moves, share * _range(values), np.inf)
    beyond = np.where(far, BEYOND * _range(usual), np.inf)
    wrong, often = np.zeros(values.shape, bool), np.zeros(len(moves), bool)
    for joint in np.flatnonzero((apart > np.minimum(least, beyond)).any(axis=0)):  # seldom any
        rare, finest = np.percentile(apart[:, joint], 99.0), RESOLUTIONS * resolution(values[:, joint])
        seldom, ever = max(least[joint], RARE * rare, finest), max(beyond[joint], finest)
        for row in np.flatnonzero(apart[:, joint] > min(seldom, ever)):
            around = apart[max(row - AROUND, 0) : row + AROUND + 1, joint]
            wrong[row, joint] = apart[row, joint] > STANDS_OUT * np.percentile(around, MOST[window])
        often[joint] = (wrong[:, joint] & (apart[:, joint] <= seldom)).any()
    return wrong, usual, often


def resolution(readings: np.ndarray) -> float:
    """The smallest change of readings (N,), if it occurs again and again; else 0."""
    steps = np.abs(np.diff(readings))
    steps = steps[steps > 0.0]
    least = float(steps.min(initial=np.inf))
    return least if np.count_nonzero(steps <= SAME * least) >= OFTEN else 0.0
