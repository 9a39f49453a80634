"""Nuisance of creeping dry friction: the velocity at which all of it is there may be a little off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals

DOUBT = 0.01
"""Relative standard deviation of that velocity."""


def onset_columns(signals: Signals, reduced: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Effort per N·m of friction and relative change of that velocity, of the k joints whose friction creeps, (R, n, k).

    Args:
        reduced: makes rows (R, n) of efforts (N, n).
    """
    change = np.zeros_like(signals.velocity)
    if signals.creep is not None:
        other = replace(signals, creep=signals.creep * [1.0 + DOUBT, 1.0 + DOUBT, 1.0])
        change = signals.soften(other.direction - signals.direction) / DOUBT
    return np.asarray(reduced(change)[..., None] * _each(signals))


def onset_spread(signals: Signals, robot: Robot, effort: np.ndarray) -> np.ndarray:
    """Prior standard deviations of these columns' coefficients, (k,) [N·m], given the spread of each joint's effort, (n,).

    Described friction counts if larger: it may be many times what the motion takes.
    """
    return np.asarray(DOUBT * np.maximum(robot.coulomb, effort) @ _each(signals))


def _each(signals: Signals) -> np.ndarray:
    """Selection of the k joints whose friction creeps, (n, k) of 0 and 1."""
    every = np.eye(signals.width)
    return every[:, :0] if signals.creep is None else every[:, signals.creep[:, :2].any(axis=1)]
