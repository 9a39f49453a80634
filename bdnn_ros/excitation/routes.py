"""Trajectories: pieces of motion joined by straight transitions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.excitation.bounds import Bounds
from bdnn_ros.excitation.motions import ATTEMPTS, Piece
from bdnn_ros.simulation.excitation import Trajectory, smooth_step


def way(bounds: Bounds, start: np.ndarray, end: np.ndarray) -> tuple[float, bool]:
    """Duration of a straight transition between two poses (n,) from rest to rest [s], and whether the effort suffices."""
    distance = np.abs(end - start)
    time = max(
        float((1.875 * distance / bounds.velocity).max()),
        float(np.sqrt((5.7736 * distance / bounds.acceleration).max())),
        0.3,
    )
    for _ in range(ATTEMPTS):
        if bounds.kept_by(straight(start, end, time, np.linspace(0.0, time, 25)), 1e-3):
            return time, True
        time *= 1.3
    return time, False


def straight(start: np.ndarray, end: np.ndarray, duration: float, time: np.ndarray) -> Trajectory:
    """From pose to pose, (n,) [rad], from rest to rest within `duration` [s]; at rest there before and after, (N,) [s]."""
    step, slope, bend = smooth_step(time / duration)
    distance = end - start
    return Trajectory(
        time,
        start + step[:, None] * distance,
        slope[:, None] / duration * distance,
        bend[:, None] / duration**2 * distance,
    )


def joined(bounds: Bounds, pieces: Sequence[Piece], rate: float) -> Trajectory | None:
    """Pieces joined by straight transitions, at `rate` [Hz]; None if no transition is possible."""
    parts: list[Trajectory] = []
    begin, here = 0.0, pieces[0].centre
    spans: list[tuple[float, Piece | tuple[np.ndarray, np.ndarray], float]] = []
    for piece in pieces:
        time, possible = way(bounds, here, piece.centre)
        if not possible:
            return None
        if (here != piece.centre).any():
            spans.append((begin, (here, piece.centre), time))
            begin += time
        spans.append((begin, piece, piece.duration))
        begin += piece.duration
        here = piece.end
    stamps = np.arange(int(np.ceil(begin * rate)) + 1) / rate  # the last one is at rest, past the end
    for k, (start, what, length) in enumerate(spans):
        last = k == len(spans) - 1
        mine = stamps[(stamps >= start) & ((stamps < start + length) | last)]
        local = np.minimum(mine - start, length)
        part = what.at(local) if isinstance(what, Piece) else straight(*what, length, local)
        parts.append(replace(part, time=mine))
    return Trajectory(
        *(np.concatenate([getattr(p, key) for p in parts]) for key in Trajectory.__dataclass_fields__)
    )
