"""Dry friction before it slides: a bristle that bends (Dahl, A solid friction model, Aerospace Corporation TOR-0158, 1968)."""

from __future__ import annotations

import numpy as np

from bdnn_ros.signals import Signals


def bristle(position: np.ndarray, breakaway: float) -> np.ndarray:
    """Bend of a Dahl bristle along positions (N,), in [-1, 1], from 0; exact while the direction stays."""
    if len(position) < 2:
        return np.zeros(len(position))
    direction = np.sign(np.diff(position))
    turns = np.flatnonzero(np.diff(direction)) + 1
    starts, ends = np.array([0, *turns]), np.array([*turns, len(direction)])
    ways, counts = direction[starts], ends - starts
    fade = np.exp(-np.abs(position[1:] - np.repeat(position[starts], counts)) / breakaway)
    bends, bend = np.empty(len(starts)), 0.0
    for k, (way, last) in enumerate(zip(ways.tolist(), fade[ends - 1].tolist(), strict=True)):
        bends[k] = bend
        bend = way + (bend - way) * last if way else bend
    way = np.repeat(ways, counts)
    bent = way + (np.repeat(bends, counts) - way) * np.where(way, fade, 1.0)
    return np.concatenate([[0.0], bent])


def bristles(motion: Signals, joint: int, breakaway: float) -> np.ndarray:
    """Bend of a joint's bristle along a motion, (N,): each gap-free segment begins unbent."""
    return np.concatenate([bristle(motion.position[rows, joint], breakaway) for rows in motion.segments])
