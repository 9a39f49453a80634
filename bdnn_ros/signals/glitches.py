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
SHARES = {"position": 0.01, "velocity": 0.5, "effort": 0.5}
"""And than this share of the range that the readings cover: nothing jumps, but an impact in a gear is felt for a sample."""


def without_glitches(recording: Recording) -> Recording:
    """The recording with every reading that stands out alone replaced by the median of five around it.

    One wrong reading among thousands passes for a push, and a low-pass spreads it. What lasts three samples is kept: so
    brief a contact is real, as far as anyone can tell; and so is what happens often.
    """
    found: dict[str, int] = {}
    mended: dict[str, Any] = {}
    for field, share in SHARES.items():
        values = getattr(recording, field)
        if values is None or len(values) <= 2 * AROUND:
            continue
        moves = np.ones(recording.width, bool) if field == "effort" else moving(recording)
        clean, counts = _bridged(values, share, recording.segments(), moves)
        if counts.any():
            mended[field] = clean
            for joint, count in zip(recording.joints, counts, strict=True):
                found[joint] = found.get(joint, 0) + int(count)
    if not mended:
        return recording
    joints = listed(joint for joint, count in found.items() if count)
    readings = "1 reading" if sum(found.values()) == 1 else f"{sum(found.values())} readings"
    note = (
        f"{recording.name}: {readings} of {joints} stood out alone ({listed(mended)}); "
        "replaced by the median of the readings around. Check the driver and its bus."
    )
    return replace(recording, **mended, notes=(*recording.notes, note))


def _bridged(
    values: np.ndarray, share: float, segments: list[slice], moves: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Values (N, n) without glitches, and how many each column had, (n,); where nothing moves (n,) it does not matter."""
    usual = np.concatenate([median_filter(values[rows], (WINDOW, 1), mode="nearest") for rows in segments])
    apart = np.abs(values - usual)
    low, high = np.percentile(values, [0.5, 99.5], axis=0)
    least = np.where(moves, share * (high - low), np.inf)
    clean, counts = values, np.zeros(values.shape[1], int)
    for joint in np.flatnonzero((apart > least).any(axis=0)):  # seldom any: the rest is asked of these alone
        rare, finest = np.percentile(apart[:, joint], 99.0), resolution(values[:, joint])
        least[joint] = max(least[joint], RARE * rare, RESOLUTIONS * finest)
    for row, joint in np.argwhere(apart > least):
        around = apart[max(row - AROUND, 0) : row + AROUND + 1, joint]
        if apart[row, joint] > STANDS_OUT * np.percentile(around, 90.0):
            clean = values.copy() if clean is values else clean
            clean[row, joint] = usual[row, joint]
            counts[joint] += 1
    return clean, counts


def resolution(readings: np.ndarray) -> float:
    """The least by which readings (N,) differ, if they do by that again and again; else nothing."""
    steps = np.abs(np.diff(readings))
    steps = steps[steps > 0.0]
    least = float(steps.min(initial=np.inf))
    return least if np.count_nonzero(steps <= SAME * least) >= OFTEN else 0.0
