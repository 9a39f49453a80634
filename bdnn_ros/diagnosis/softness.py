"""Efforts that were low-passed before they were recorded, as those of a driver or of a published data set often are.

Steps of dry friction are then softer than the motion says, which passes for hysteresis, delay or viscous friction. How soft
they are is read off the efforts; every sharp term is softened alike, and no more is compared than that low-pass let through.
Friction that gives way little by little is soft, too, but by how far a joint has moved, not by time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import qr

from bdnn_ros.checks.sampling import lowest, telling
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals

LOWPASSES = tuple(0.5 * 2.0 ** (k / 2.0) for k in range(8))
"""Low-passes tried [Hz]; wider ones soften less than a diagnosis' own."""
BETTER = 1.4
"""Efforts are soft where so many times less of how fast they change is left unexplained by softened steps, mean of the joints."""
ENOUGH = 60.0
"""So much motion tells [s]."""
NEW = 1e-6
"""Columns that add less than this share to others say nothing of their own."""
TINY = 1e-30


def softness(signals: Signals, robot: Robot) -> float | None:
    """The -3 dB frequency [Hz] of the low-pass that the efforts of a motion had passed, all alike; None where none shows."""
    if signals.time[-1] - signals.time[0] > ENOUGH:
        signals = signals.between(signals.time[0], signals.time[0] + ENOUGH)
    assert signals.effort is not None
    moves = telling(signals)
    rows = signals.interior & moves.any(axis=1)
    joints = np.flatnonzero(moves[rows].any(axis=0))
    if not len(joints):
        return None

    def rates(values: np.ndarray) -> np.ndarray:
        return np.asarray(np.gradient(signals.smooth(values), axis=0)[rows])

    bodies = rates(robot.regressor(signals.position, signals.velocity, signals.acceleration))
    drives = rates(np.stack([signals.acceleration, signals.velocity], axis=2))
    effort = rates(signals.effort)
    others = [_basis(np.concatenate([bodies[:, j], drives[:, j]], axis=1)) for j in joints]
    target = [_beyond(effort[:, j], other) for j, other in zip(joints, others, strict=True)]

    def left(direction: np.ndarray) -> float:
        steps = rates(direction)
        own = (_beyond(steps[:, j], other) for j, other in zip(joints, others, strict=True))
        return float(np.mean([np.log(_left(t, s)) for t, s in zip(target, own, strict=True)]))

    soft = np.array([left(signals.behind(signals.sign, cutoff)) for cutoff in LOWPASSES])
    if left(signals.sign) - soft.min() <= np.log(BETTER):
        return None
    return float(LOWPASSES[0] * (LOWPASSES[1] / LOWPASSES[0]) ** lowest(soft))


def softened(signals: Signals, own: float) -> Signals:
    """The signals of efforts that had passed a low-pass [Hz] of their own, compared behind no wider one."""
    return replace(signals, own=own, cutoff=min(signals.cutoff, own))


def noted(recordings: Sequence[Recording], own: float) -> list[Recording]:
    """The recordings with a note on the low-pass [Hz] that their efforts had passed."""
    return [replace(one, notes=(*one.notes, note(one, own))) for one in recordings]


def note(recording: Recording, own: float) -> str:
    """What a user should know of a recording whose efforts had passed a low-pass [Hz]."""
    return (
        f"{recording.name}: the efforts were low-passed at about {own:.1f} Hz before they were recorded; no more is compared. "
        "Record them as they are measured: what is fast tells most about friction and gears."
    )


def _basis(columns: np.ndarray) -> np.ndarray:
    """Orthonormal columns that span those (R, k), each counted alike."""
    size = np.linalg.norm(columns, axis=0)
    basis, triangle, _ = qr(columns[:, size > 0.0] / size[size > 0.0], mode="economic", pivoting=True)
    return np.asarray(basis[:, np.abs(np.diagonal(triangle)) > NEW])


def _beyond(values: np.ndarray, basis: np.ndarray) -> np.ndarray:
    return np.asarray(values - basis @ (basis.T @ values))


def _left(target: np.ndarray, steps: np.ndarray) -> float:
    """Share of a target's square (R,) that a positive multiple of steps (R,) leaves."""
    common = max(float(target @ steps), 0.0)
    return max(1.0 - common**2 / max(float(steps @ steps) * float(target @ target), TINY), NEW)
