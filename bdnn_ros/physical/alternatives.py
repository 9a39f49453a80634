"""Whether a robot's description would suit its motion better with joints turned, zeroed or named otherwise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import nnls

from bdnn_ros.errors import listed
from bdnn_ros.physical.remark import Remark
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals

MOST_ROWS = 500
"""Samples that it is judged by."""
POOR, GOOD = 0.97, 0.9
"""Other readings are looked for where the description explains less than the first share of the efforts, and taken where they
explain more than the second."""
HARDLY = 0.5
"""It is hardly this robot's where it explains less than this, and so does any other reading."""
BETTER = 4.0
"""And where they leave so many times less unexplained."""
STEP = 0.7
"""Each thing read otherwise leaves at most this share of what was unexplained."""
TIED, MOST_TIED = 1.05, 2
"""Others that leave hardly more are told as well, so many of them: what a joint does another may undo."""
ZEROS = {90.0: "90 deg further", -90.0: "90 deg back", 180.0: "180 deg further"}
BASES = {
    (180.0, 0.0): "upside down",
    (90.0, 0.0): "on its side (roll 90 deg)",
    (-90.0, 0.0): "on its side (roll -90 deg)",
    (0.0, 90.0): "on its side (pitch 90 deg)",
    (0.0, -90.0): "on its side (pitch -90 deg)",
}

WEIGHTLESS = "gravity left out of them"


@dataclass(frozen=True)
class Reading:
    """A way to read recorded joints as those of a description.

    Attributes:
        order: which recorded column each joint is, (n,).
        direction: 1 or -1, (n,).
        zero: what is added to the position, (n,) [rad].
        base: roll and pitch of the base [deg].
        gravity: whether the efforts hold it.
        told: what is read otherwise, in words.
    """

    order: np.ndarray
    direction: np.ndarray
    zero: np.ndarray
    base: tuple[float, float] = (0.0, 0.0)
    gravity: bool = True
    told: tuple[str, ...] = ()

    @property
    def only_weightless(self) -> bool:
        """Whether only gravity is not where it should be."""
        return not self.gravity and len(self.told) == 1

    def others(self, joints: tuple[str, ...]) -> Iterator[Reading]:
        """Readings with one thing more read otherwise."""
        for j, joint in enumerate(joints):
            sign = self.direction.copy()
            sign[j] *= -1.0
            yield replace(self, direction=sign, told=(*self.told, f"{joint} turning the other way"))
            for angle, words in ZEROS.items():
                zero = self.zero.copy()
                zero[j] += np.deg2rad(angle)
                yield replace(self, zero=zero, told=(*self.told, f"{joint} {words}"))
        for i, j in combinations(range(len(joints)), 2):
            order = self.order.copy()
            order[[i, j]] = order[[j, i]]
            yield replace(self, order=order, told=(*self.told, f"{joints[i]} and {joints[j]} exchanged"))
        if self.gravity and not any(self.base):
            yield replace(self, gravity=False, told=(*self.told, WEIGHTLESS))
            for base, words in BASES.items():
                yield replace(self, base=base, told=(*self.told, f"the base {words}"))


class Motion:
    """Some samples of a motion, and how much of their effort a robot's description explains.

    Args:
        signals: with effort, joints in the robot's order.
    """

    def __init__(self, signals: Signals, robot: Robot) -> None:
        assert signals.effort is not None
        rows = np.flatnonzero(signals.interior & (signals.seen & ~signals.at_rest).any(axis=1))
        rows = rows[:: max(len(rows) // MOST_ROWS, 1)]
        self.robot = robot
        self.position, self.velocity = signals.position[rows], signals.velocity[rows]
        self.acceleration, self.effort = signals.acceleration[rows], signals.effort[rows]
        self.sign = signals.sign[rows]

    def explained(self, reading: Reading) -> float:
        """Share of the efforts' variance, mean of the joints, that bodies, rotors and dry friction make."""

        def read(values: np.ndarray) -> np.ndarray:
            return reading.direction * values[:, reading.order]

        robot = self.robot.tilted(*np.deg2rad(reading.base)) if any(reading.base) else self.robot
        robot = robot if reading.gravity else replace(robot, gravity_vector=np.zeros(3))
        acceleration, sign, effort = read(self.acceleration), read(self.sign), read(self.effort)
        borne = robot.rigid_effort(read(self.position) + reading.zero, read(self.velocity), acceleration)
        return explained(effort, borne, acceleration, sign)


def misread(signals: Signals, robot: Robot) -> Iterator[Remark]:
    """What of a robot's description differs from how its motion was recorded."""
    motion = Motion(signals, robot)
    if len(motion.effort) < MOST_ROWS // 10:
        return
    as_recorded = Reading(np.arange(robot.width), np.ones(robot.width), np.zeros(robot.width))
    before = motion.explained(as_recorded)
    if before > POOR:
        return
    share, reading = _best(motion, as_recorded)
    if share > GOOD and BETTER * (1.0 - share) < 1.0 - before:
        yield weightless() if reading.only_weightless else _told(before, share, reading)
    elif before < HARDLY:
        yield Remark(
            "",
            f"The robot description explains only {100 * before:.0f} % of the efforts.",
            "Check that it is this robot's, with its axes, zeros, base and names of joints.",
        )


def _best(motion: Motion, reading: Reading) -> tuple[float, Reading]:
    """The reading that explains most, found by one thing after another, and how much that is."""
    share = motion.explained(reading)
    for _ in range(motion.robot.width):
        tried = [(motion.explained(other), other) for other in reading.others(motion.robot.joints)]
        best, chosen = max(tried, key=lambda one: one[0])
        if 1.0 - best > STEP * (1.0 - share):
            break
        alike = [
            one.told[-1] for found, one in tried if 1.0 - found <= TIED * (1.0 - best) and one is not chosen
        ]
        words = " or ".join([chosen.told[-1], *alike[:MOST_TIED]])
        share, reading = best, replace(chosen, told=(*reading.told, words))
    return share, reading


def _told(before: float, share: float, reading: Reading) -> Remark:
    return Remark(
        "",
        f"The robot description explains {100 * before:.0f} % of the efforts as they are recorded, and "
        f"{100 * share:.0f} % with {listed(reading.told)}.",
        "Correct the description's axes, zeros and base, or the driver; --rename maps joints that are exchanged.",
    )


def weightless() -> Remark:
    """That a controller adds gravity to what is recorded."""
    return Remark(
        "",
        "The efforts leave gravity out: they hold what motion asks for, but not what the links weigh.",
        "Pass --add-gravity (node: add_gravity) if the controller adds it, or correct how the description's base is mounted.",
    )


def explained(effort: np.ndarray, *columns: np.ndarray) -> float:
    """Share of the efforts' variance, mean of the joints, that columns explain by positive factors, (R, n) each."""
    return float(np.mean([_explained(*one) for one in zip(effort.T, *(c.T for c in columns), strict=True)]))


def _explained(effort: np.ndarray, *columns: np.ndarray) -> float:
    spread = float(np.sum((effort - effort.mean()) ** 2))
    if spread == 0.0:
        return 1.0
    matrix = np.stack([column - column.mean() for column in columns], axis=1)
    size = np.linalg.norm(matrix, axis=0)
    _, left = nnls(matrix / np.maximum(size, 1e-9 * np.sqrt(spread)), effort - effort.mean())
    return 1.0 - float(left**2 / spread)
