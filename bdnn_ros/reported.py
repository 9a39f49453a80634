"""Velocities that messages really report, as opposed to placeholders of a driver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.errors import listed
from bdnn_ros.readings import credible
from bdnn_ros.recording import GAP_SECONDS, Recording
from bdnn_ros.signals.wraps import wraps

MOVES = 0.01
"""A joint that covers this much [rad] and reports a velocity of zero throughout does not report it."""


def reported_velocity(
    name: str, joints: Sequence[str], position: np.ndarray, velocity: np.ndarray | None
) -> tuple[np.ndarray | None, np.ndarray, list[str]]:
    """The velocity that the messages report.

    Args:
        name: what they came from.
        position, velocity: (N, n); a velocity that a message lacks is NaN.

    Returns:
        It, (N, n), or None where no joint's is reported, or not in every message; whose is to be derived from the
        position, zero in it, (n,) bool; what there is to say.
    """
    silent = np.zeros(len(joints), bool)
    if velocity is None:
        return None, silent, []
    absent = np.isnan(velocity).all(axis=0)
    unknown = ~(np.isfinite(velocity) & (velocity != 0.0)).any(axis=0)
    moves = _covered(position) > MOVES if len(position) else unknown
    silent = (unknown & moves) | absent
    partly = np.isnan(velocity[:, ~absent]).all(axis=1) & (not absent.all())
    if partly.any():
        which = f"{partly.sum()} samples"
    elif silent.any():
        which = listed(np.array(joints)[silent])
    else:
        return velocity, silent, []
    notes = [f"{name}: no velocity is reported for {which}; it is derived from the position."]
    if partly.any() or unknown.all():
        return None, np.zeros_like(silent), notes
    return np.where(silent, 0.0, velocity), silent, notes


def _covered(position: np.ndarray) -> np.ndarray:
    """Range that each joint covers, (n,) [rad], over credible positions (N, n); -inf without any."""
    seen = credible(position)
    return np.where(seen, position, -np.inf).max(axis=0) - np.where(seen, position, np.inf).min(axis=0)


def with_derived(recording: Recording, silent: np.ndarray) -> Recording:
    """The recording with the velocity of joints that report none, (n,) bool, derived from their position.

    A message that repeats the one before repeats the derived velocity, too, by which it is recognised as a repeat.
    """
    if recording.velocity is None or not silent.any():
        return recording
    velocity = recording.velocity.copy()
    for rows in recording.segments():
        position = recording.position[rows][:, silent]
        position = position - 2.0 * np.pi * np.cumsum(wraps(position), axis=0)
        seen = np.concatenate([position, velocity[rows][:, ~silent]], axis=1)
        kept, held = _fresh(recording.time[rows], seen)
        if len(kept) > 1:
            slope = np.gradient(position[kept], recording.time[rows][kept], axis=0)
            velocity[rows.start : rows.stop, silent] = slope[held]
    return replace(recording, velocity=velocity)


def _fresh(time: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows (K,) that differ from the one before, or from whose last such one it is long, and which of them each repeats, (N,)."""
    differs = np.append(True, (np.diff(seen, axis=0) != 0.0).any(axis=1))[: len(time)]
    last = np.maximum.accumulate(np.where(differs, np.arange(len(time)), 0))
    differs |= time - time[last] > GAP_SECONDS
    return np.flatnonzero(differs), np.cumsum(differs) - 1
