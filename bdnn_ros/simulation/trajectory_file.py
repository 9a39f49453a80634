"""Trajectories from CSV files, as `bdnn excite` writes them."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from scipy.interpolate import BPoly

from bdnn_ros.errors import UsageError, listed
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import Trajectory
from bdnn_ros.simulation.simulate import check

QUANTITIES = ("position", "velocity", "acceleration")
HOLD = 0.5
"""Time for which the first pose is held before the motion starts [s]."""


def read_trajectory(path: Path, robot: Robot, rate: float) -> Trajectory:
    """The trajectory of a CSV file, resampled.

    Columns are `time`, then NAME.position, NAME.velocity and NAME.acceleration of every joint. Between points it is the
    polynomial that matches all three at both ends, so it is as smooth as the points are. Empty lines are ignored.

    Args:
        rate: of the new samples [Hz].

    Raises:
        UsageError: the file cannot be read or is not such a table, lacks a joint, its stamps do not increase, or it is too
            long or too short to be simulated, or the rate is out of range.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:  # spreadsheets begin with a byte order mark
            header, *lines = [line for line in csv.reader(file) if any(map(str.strip, line))]
        table = np.array([[float(x) for x in line] for line in lines], dtype=float)
    except (OSError, ValueError, csv.Error) as error:
        raise UsageError(
            f"The trajectory {path} cannot be read ({error}).", "Give a CSV of bdnn excite."
        ) from None
    wanted = ["time", *(f"{joint}.{what}" for what in QUANTITIES for joint in robot.joints)]
    missing = [name for name in wanted if name not in header]
    if missing or table.ndim != 2 or table.shape[1] != len(header) or len(table) < 2:
        raise UsageError(
            f"{path} is not a trajectory of this robot: it lacks {listed(missing) or 'points'}.",
            "Give a CSV of bdnn excite for the same robot.",
        )
    values = table[:, [header.index(name) for name in wanted]]
    time, points = values[:, 0] - values[0, 0], values[:, 1:].reshape(len(values), 3, robot.width)
    if not np.isfinite(values).all() or (np.diff(time) <= 0.0).any():
        raise UsageError(f"{path}: stamps do not increase, or a value is not a number.", "Correct the file.")
    check(float(time[-1]) + HOLD, rate)
    path_ = BPoly.from_derivatives(time, points)
    stamps = np.arange(int(np.ceil((time[-1] + HOLD) * rate)) + 1) / rate
    inside = np.clip(stamps - HOLD, 0.0, time[-1])
    position = path_(inside)
    moving = ((stamps > HOLD) & (stamps < time[-1] + HOLD))[:, None]
    velocity, acceleration = (np.where(moving, path_.derivative(k)(inside), 0.0) for k in (1, 2))
    return Trajectory(stamps, position, velocity, acceleration)
