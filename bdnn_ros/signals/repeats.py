"""Joint states that were published twice: a driver slower than its publisher repeats the last one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bdnn_ros.recording import Recording, position_noise

MOST_REPEATS = 0.1
"""Above this share, equal positions mean a coarse encoder or a slow driver, and nothing is changed."""
NOISE_WIDTHS = 8.0
"""A joint moves if a step exceeds this many standard deviations of its noise."""
CATCHING_UP = 1.5
"""The position catches up if the step after a repeated message is this many times the step before it."""


def without_repeats(recording: Recording) -> Recording:
    """The recording without messages that repeat the one before while the robot moves.

    If the position then catches up, the repeated message was stale and is left out. If it continues as if nothing had
    happened, the driver's clock is slower than the publisher's: each repeat sets the stamps ahead by a period, which they
    lose again gradually. These are spread evenly from one repeat to the next; otherwise every repeat would be a jolt of the
    acceleration.
    """
    runs = _runs(recording)
    if not runs:
        return recording
    slips = [(start, stop) for start, stop, catches_up in runs if not catches_up]
    keep = np.ones(len(recording), bool)
    for start, stop, _ in runs:
        keep[start:stop] = False
    time = (recording.time - _ahead(recording.time, slips))[keep]
    if (np.diff(time) <= 0.0).any():
        time = recording.time[keep]  # no clock behaves like that
    note = f"{recording.name}: {np.count_nonzero(~keep)} messages repeat the one before in motion; left out."
    return replace(recording.part(keep), time=time, notes=(*recording.notes, note))


def _runs(recording: Recording) -> list[tuple[int, int, bool]]:
    """Rows [start, stop) that repeat the row before during motion, and whether the position then catches up."""
    if len(recording) < 4:
        return []
    steps = np.diff(recording.position, axis=0, prepend=np.nan)
    same = (steps == 0.0).all(axis=1)
    witness = _witness(recording)
    if witness is not None:
        same[1:] &= (witness[1:] == witness[:-1]).all(axis=1)
    edges = np.diff(np.concatenate([[False], same, [False]]).astype(int))
    starts, stops = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    if not len(starts):
        return []
    noise = NOISE_WIDTHS * position_noise(recording)
    runs = []
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        if start < 2 or stop >= len(same):
            continue
        before, after = steps[start - 1], steps[stop]
        moves = (np.minimum(np.abs(before), np.abs(after)) > noise) & (before * after > 0.0)
        if moves.any():
            ratio = float(np.median(after[moves] / before[moves]))
            runs.append((start, stop, ratio > 1.0 + (CATCHING_UP - 1.0) * (stop - start)))
    repeated = sum(stop - start for start, stop, _ in runs)
    return runs if repeated <= MOST_REPEATS * len(recording) else []


def _witness(recording: Recording) -> np.ndarray | None:
    """A signal that repeats whenever a message does, (N, n): the velocity, else the effort, which may be read separately."""
    moving = recording.velocity is not None and bool((np.ptp(recording.velocity, axis=0) > 0.0).all())
    return recording.velocity if moving else recording.effort


def _ahead(time: np.ndarray, slips: list[tuple[int, int]]) -> np.ndarray:
    """How far stamps are ahead of the driver's clock, (N,) [s]: a period after a slip, then decreasing."""
    ahead = np.zeros(len(time))
    if not slips:
        return ahead
    last = np.array([time[start - 1] for start, _ in slips])
    again = np.array([time[stop - 1] for _, stop in slips])
    usual = float(np.median(last[1:] - again[:-1])) if len(slips) > 1 else float(time[-1] - time[0])
    which = np.searchsorted(again, time, side="left")
    since = np.concatenate([last[:1] - usual, again])[which]
    until = np.concatenate([last, again[-1:] + usual])[which]
    phase = np.clip((time - since) / (until - since), 0.0, 1.0)
    return np.concatenate([(again - last)[:1], again - last])[which] * (1.0 - phase)
