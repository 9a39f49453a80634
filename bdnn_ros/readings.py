"""Which numbers a sensor may report."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from bdnn_ros.errors import RecordingError, listed

MOST = 1e12
"""No robot's position, velocity or effort is beyond this, in whatever unit; powers of larger numbers overflow."""
LEAVE_OUT = "Fix the driver, or pass --drop-invalid to leave such samples out."


def credible(values: np.ndarray) -> np.ndarray:
    """Which readings are finite and not beyond any robot's, bool of the same shape."""
    return np.asarray(np.abs(values) <= MOST)


def incredible(position: np.ndarray, *others: np.ndarray | None) -> np.ndarray:
    """Where any of some readings (N, n) is not credible, (N, n) bool; None stands for not measured."""
    wrong = ~credible(position)
    for values in others:
        if values is not None:
            wrong |= ~credible(values)
    return wrong


def of_dropped(name: str, dropped: int, count: int, clocks: int) -> list[str]:
    """Notes on the samples of a recording that were dropped, and on clock resets."""
    notes = []
    if dropped:
        notes.append(
            f"{name}: {dropped} of {count} samples are not finite, beyond {MOST:g} or go back in time."
        )
    if clocks > 1:
        often = "once" if clocks == 2 else f"{clocks - 1} times"
        notes.append(f"{name}: the clock jumps back {often}; the parts are joined with a pause between them.")
    return notes


def refuse_not_finite(
    name: str, field: str, joints: Sequence[str], time: np.ndarray, values: np.ndarray
) -> None:
    """Refuse readings that are not finite; arguments as of `refuse_incredible`.

    Raises:
        RecordingError: there are some.
    """
    wrong = ~np.isfinite(values)

    def said(row: int, column: int) -> str:
        # a message may leave a velocity or effort empty, but not all positions
        return "missing" if field != "position" and np.isnan(values[row]).all() else "not finite"

    some = not wrong.any(axis=1).all()
    _refuse(name, field, joints, time, wrong, said, LEAVE_OUT if some else "Fix the driver.")


def refuse_incredible(
    name: str, field: str, joints: Sequence[str], time: np.ndarray, values: np.ndarray
) -> None:
    """Refuse readings that are beyond any robot's.

    Args:
        name, field: of the recording, and of what was read, for the message.
        joints: n names.
        time, values: (N,) [s], (N, n).

    Raises:
        RecordingError: there are some.
    """

    def said(row: int, column: int) -> str:
        return f"{values[row, column]:.2g}"

    otherwise, after = "Check its unit, and fix the driver.", ", as no robot's can be"
    _refuse(name, field, joints, time, ~credible(values), said, otherwise, after)


def refuse_all_left_out(name: str, joints: Sequence[str], wrong: np.ndarray) -> None:
    """Refuse samples of which none is usable.

    Args:
        wrong: readings that are not credible, (N, n) bool.

    Raises:
        RecordingError: always.
    """
    bad = _mostly(joints, wrong)
    who = f"in most what {listed(bad, 20)} reported" if 0 < len(bad) < len(joints) else "what is reported"
    raise RecordingError(
        f"{name}: no sample of {len(wrong)} is left: {who} is not finite, or beyond {MOST:g}.",
        _without(joints, bad) or "Fix the driver.",
    )


def _refuse(
    name: str,
    field: str,
    joints: Sequence[str],
    time: np.ndarray,
    wrong: np.ndarray,
    said: Callable[[int, int], str],
    otherwise: str,
    after: str = "",
) -> None:
    """Refuse a recording with wrong readings, (N, n) bool, naming the joint with most of them."""
    if not wrong.any():
        return
    column = int(np.argmax(wrong.sum(axis=0)))
    row = int(np.argmax(wrong[:, column]))
    count = np.count_nonzero(wrong.any(axis=1))
    few = 2 * count < len(wrong)
    raise RecordingError(
        f"{name}: {field} of {joints[column]} is {said(row, column)} at {time[row]:.3f} s{after} "
        f"({count} of {len(wrong)} samples).",
        LEAVE_OUT if few else _without(joints, _mostly(joints, wrong)) or otherwise,
    )


def _mostly(joints: Sequence[str], wrong: np.ndarray) -> list[str]:
    """Joints with mostly wrong readings."""
    return [joint for joint, often in zip(joints, 2 * wrong.sum(axis=0) >= len(wrong), strict=True) if often]


def _without(joints: Sequence[str], bad: Sequence[str]) -> str:
    """The remedy of leaving some joints out; empty if that is none or all of them."""
    if not 0 < len(bad) < len(joints):
        return ""
    kept = ",".join(joint for joint in joints if joint not in bad)
    return f"Fix the driver, or leave {listed(bad, 20)} out: --joints {kept}."
