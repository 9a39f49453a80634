"""Checks whether the reported velocity is the derivative of the reported position or a low-pass of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.checks.sampling import brisk
from bdnn_ros.diagnosis.recorded.joining import concatenated, prepared_alike
from bdnn_ros.diagnosis.result import Finding, Quantity
from bdnn_ros.effects.sensing import VelocityFilter
from bdnn_ros.recording import Recording, further
from bdnn_ros.signals import Signals
from bdnn_ros.signals.kernels import trailing

SAMPLES_OF_LAG = 1.5
"""Lag in sample periods that differentiation itself causes; more is a filter."""
HALF_SAMPLE = 1.0 / np.sqrt(12.0)
"""Standard deviation of a lag in sample periods: how a driver's filter takes samples is unknown by half a period."""
BLOCKS = 12
CUTOFF = VelocityFilter.parameters[0]
"""Bounds of the cut-off: beyond the upper one there is no filter, below the lower one something else is wrong."""


def reported_velocity(
    recordings: Sequence[Recording], cutoff: float | None = None, before: np.ndarray | None = None
) -> list[Finding]:
    """A finding for each joint whose reported velocity lags behind its motion like a first-order low-pass.

    Args:
        recordings: those without a velocity are ignored.
        cutoff: low-pass [Hz]; None chooses.
        before: cut-offs known already, (n,) [Hz], infinite for none; only differences from these are found.
    """
    reporting = [recording for recording in recordings if recording.velocity is not None]
    if not reporting:
        return []
    signals = concatenated(prepared_alike(reporting, cutoff))
    moving = np.flatnonzero(further(signals.position, signals.position_noise))
    known = np.full(signals.width, np.inf) if before is None else before
    return [finding for j in moving.tolist() if (finding := _filtered(signals, j, known[j])) is not None]


def none_is_left(cutoff: float, rate: float) -> bool:
    """Whether a low-pass [Hz] at a sample rate [Hz] lags no more than differentiation does."""
    return lag_of(cutoff) < SAMPLES_OF_LAG / rate


def lag_of(cutoff: float) -> float:
    """Time constant [s] of a first-order low-pass [Hz]."""
    return 1.0 / (2.0 * np.pi * cutoff)


def _filtered(signals: Signals, joint: int, known: float) -> Finding | None:
    assert signals.reported_velocity is not None
    rows = signals.interior & ~signals.at_rest[:, joint]
    if rows.sum() < 10 * BLOCKS or not brisk(signals, rows)[joint]:
        return None
    parts = np.array_split(np.flatnonzero(rows), BLOCKS)
    lags = [_lag(signals, joint, part) for part in parts]
    lag = _lag(signals, joint, np.flatnonzero(rows))
    std = float(np.std(lags) / np.sqrt(BLOCKS))
    least = SAMPLES_OF_LAG / signals.raw_rate
    if abs(lag - lag_of(known)) - 3.0 * std < least:
        return None
    reported = signals.reported_velocity[rows, joint]
    before = float(np.mean((reported - _delayed(signals, joint, lag_of(known))[rows]) ** 2))
    after = float(np.mean((reported - _delayed(signals, joint, lag)[rows]) ** 2))
    nothing = float(np.mean(reported**2))
    # a velocity of the wrong sign, or of another joint, is predicted best by zero
    if after > 0.5 * min(before, nothing) or lag > lag_of(CUTOFF.lower):
        return None
    lag = max(lag, lag_of(CUTOFF.upper))
    cutoff = 1.0 / (2.0 * np.pi * lag)
    unknown = cutoff * float(np.hypot(std, HALF_SAMPLE / signals.raw_rate)) / lag
    name = signals.joints[joint]
    return Finding(
        effect="velocity_filter",
        joint=name,
        link=None,
        parameters={"cutoff": Quantity(cutoff, unknown, "Hz")},
        share=1.0 - after / before,
        probability=0.99,
        rivals=(),
        sentence=_sentence(name, cutoff, known, none_is_left(cutoff, signals.raw_rate)),
    )


def _sentence(name: str, cutoff: float, known: float, none: bool) -> str:
    derivative = f"The reported velocity of {name} is the derivative of its position"
    if np.isinf(known):
        return f"{derivative} behind a low-pass of {cutoff:.3g} Hz."
    if none:
        return f"{derivative}, no longer behind a low-pass of {known:.3g} Hz."
    return f"{derivative} behind a low-pass of {cutoff:.3g} Hz, no longer of {known:.3g} Hz."


def _lag(signals: Signals, joint: int, rows: np.ndarray) -> float:
    """Time constant [s] of the first-order low-pass between velocity and reported velocity, by least squares."""
    assert signals.reported_velocity is not None
    lag = 0.0
    for _ in range(8):
        model = _delayed(signals, joint, lag)
        slope = (_delayed(signals, joint, lag + 1e-4) - model)[rows] / 1e-4
        error = (signals.reported_velocity[:, joint] - model)[rows]
        lag = max(lag + float(slope @ error) / max(float(slope @ slope), 1e-18), 0.0)
    return lag


def _delayed(signals: Signals, joint: int, lag: float) -> np.ndarray:
    """The derived velocity behind a first-order low-pass of time constant `lag` [s], (N,)."""
    velocity = signals.velocity[:, joint]
    if lag <= 0.0:
        return velocity
    return np.concatenate([trailing(velocity[rows], lag, signals.rate) for rows in signals.segments])
