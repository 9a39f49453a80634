"""Readings that stand out alone: a bus or a sensor that was wrong for a sample or two."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.ndimage import median_filter

from bdnn_ros.errors import listed
from bdnn_ros.recording import Recording, moving

WINDOW = 5
"""The median of so many samples bridges a glitch of two; a step stays a step."""
STANDS_OUT = 20.0
"""A glitch is further from the median than so many times what nine of ten readings around it are."""
AROUND = 25
"""Readings on either side that it is compared with."""
RARE = 5.0
"""And than so many times what one in a hundred of all are."""
OFTEN, SAME = 5, 1.01
"""Changes of a reading from sample to sample that are as small as any, within this, are the sensor's resolution if so many."""
RESOLUTIONS = 1.5
"""And than so many times the sensor's resolution: a joint that stands still flips a reading's last digit now and then."""
BEYOND = 1.0
"""What happens more often is a glitch where it is further from the median than this share of the range that medians cover,
unless it is a velocity, which impacts in a gear throw as far:"""
PASSES = 3
"""so many rounds, as one that others are close to is seen when they are gone,"""
WIDE = 11
"""by the median of so many: three of five may be wrong then, and more than one in ten around,"""
MOST = {WINDOW: 90.0, WIDE: 75.0}
"""so that it is compared with that of three in four, not of nine in ten, in percent."""
JUMPS, MUCH = 0.3, 0.01
"""Readings that are this share of that range from the median jump, and are told where so many do, ..."""
UNUSUAL = 10.0
"""... if they are so many times as far from it as half of the readings around are: noise jumps no further."""
SHARES = {"position": 0.01, "velocity": 0.5, "effort": 0.5}
"""And than this share of the range that the readings cover: nothing jumps, but an impact in a gear is felt for a sample."""


def without_glitches(recording: Recording) -> Recording:
    """The recording with every reading that stands out alone replaced by the median of five around it.

    One wrong reading among thousands passes for a push, and a low-pass spreads it. What lasts three samples is kept: so
    brief a contact is real, as far as anyone can tell; and so is what happens often, unless nothing else comes near it. What
    then is left that jumps is told.
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
    """What there is to say of joints that move, and whose positions or efforts jump to and fro for a sample or two."""
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
    """How far values (N, n) are from the median of those around, and that median, (N, n) each."""
    usual = np.concatenate([median_filter(values[rows], (window, 1), mode="nearest") for rows in segments])
    return np.abs(values - usual), usual


def _range(values: np.ndarray) -> np.ndarray:
    """What values (N, n) cover but for the few most extreme, (n,)."""
    low, high = np.percentile(values, [0.5, 99.5], axis=0)
    return np.asarray(high - low)


def _bridged(
    values: np.ndarray, share: float, segments: list[slice], moves: np.ndarray, far: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Values (N, n) without glitches, and how many each column had, (n,); where nothing moves (n,) it does not matter.

    Args:
        far: columns (n,) in which what happens more often may be one, too.
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
    """Where values (N, n) stand out alone, (N, n) bool, the median of those around, (N, n), and whose do often, (n,) bool."""
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
    """The least by which readings (N,) differ, if they do by that again and again; else nothing."""
    steps = np.abs(np.diff(readings))
    steps = steps[steps > 0.0]
    least = float(steps.min(initial=np.inf))
    return least if np.count_nonzero(steps <= SAME * least) >= OFTEN else 0.0
