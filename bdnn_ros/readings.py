"""What a sensor may say: a number, and not any."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.errors import RecordingError

MOST = 1e12
"""No robot's position, velocity or effort is beyond this, in whatever unit; powers of larger numbers overflow."""


def credible(values: np.ndarray) -> np.ndarray:
    """Which readings are finite and no larger than a robot's can be, bool of the same shape."""
    return np.asarray(np.abs(values) <= MOST)


def refuse_incredible(
    name: str, field: str, joints: Sequence[str], time: np.ndarray, values: np.ndarray
) -> None:
    """Refuses readings that no robot can have.

    Args:
        name, field: of the recording, and of what was read, for the message.
        joints: n names.
        time, values: (N,) [s], (N, n).

    Raises:
        RecordingError: there are some.
    """
    wrong = ~credible(values)
    if not wrong.any():
        return
    row, column = np.argwhere(wrong)[0]
    count = np.count_nonzero(wrong.any(axis=1))
    remedy = (
        "Fix the driver, or pass --drop-invalid to leave such samples out."
        if 2 * count < len(values)
        else "Check its unit, and fix the driver."
    )
    raise RecordingError(
        f"{name}: {field} of {joints[column]} is {values[row, column]:.2g} at {time[row]:.3f} s, as no robot's can be "
        f"({count} of {len(values)} samples).",
        remedy,
    )
