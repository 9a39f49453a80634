"""Whether a robot's description would fit its motion better with joints reversed, with other zeros, or in another order.

A payload beside the axis of the last link looks like another zero: what a payload explains is no reason to doubt the
description.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import lsq_linear, nnls

from bdnn_ros.checks.sampling import loud, some, telling
from bdnn_ros.effects.rigid import POINT, REACH
from bdnn_ros.errors import listed
from bdnn_ros.physical.links import relative_inertials
from bdnn_ros.physical.remark import Remark
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import Signals

MOST_ROWS = 500
"""Most samples to use."""
POOR, GOOD = 0.97, 0.9
"""Other readings are searched if the description explains less than the first share of the efforts, and accepted if they explain
more than the second."""
BAD = 0.85
"""Two joints at once are changed if it explains less than this."""
HARDLY = 0.3
"""Below this share, without a better reading, the description is probably of another robot."""
BETTER = 4.0
"""Least factor by which an accepted reading reduces the unexplained share."""
LINKS_OFF = 0.2
"""Relative error allowed to links: a joint that bears little beyond its own link would fit any zero otherwise."""
NEARLY_ALL = 0.01
"""An unexplained share below this is negligible."""
STEP = 0.7
"""Each change must reduce the unexplained share to this factor or less."""
TIED, MOST_TIED = 1.05, 2
"""Readings within this factor of the best unexplained share are reported too, up to so many: joints may be hard to tell apart."""
ZEROS = {90.0: "90 deg further", 180.0: "180 deg further", -90.0: "90 deg back"}
BASES = {
    (180.0, 0.0): "upside down",
    (90.0, 0.0): "on its side (roll 90 deg)",
    (-90.0, 0.0): "on its side (roll -90 deg)",
    (0.0, 90.0): "on its side (pitch 90 deg)",
    (0.0, -90.0): "on its side (pitch -90 deg)",
}


@dataclass(frozen=True)
class Reading:
    """A way to map recorded joints to those of a description.

    Attributes:
        order: recorded column of each joint, (n,).
        direction: 1 or -1, (n,).
        zero: added to the position, (n,) [deg].
        turns: whether a joint is revolute, (n,) bool; only these are tried with other zeros.
        base: roll and pitch of the base [deg].
        gravity: whether the efforts include gravity.
    """

    order: np.ndarray
    direction: np.ndarray
    zero: np.ndarray
    turns: np.ndarray
    base: tuple[float, float] = (0.0, 0.0)
    gravity: bool = True

    @classmethod
    def as_recorded(cls, robot: Robot) -> Reading:
        """The identity: joints as the description has them."""
        return cls(np.arange(robot.width), np.ones(robot.width), np.zeros(robot.width), ~robot.slides)

    def others(self) -> Iterator[Reading]:
        """Readings with one more change."""
        width = len(self.order)
        for j in range(width):
            yield from self.with_joint(j)
        for i, j in combinations(range(width), 2):
            order = self.order.copy()
            order[[i, j]] = order[[j, i]]
            yield replace(self, order=order)
        if self.gravity and not any(self.base):
            yield replace(self, gravity=False)
            for base in BASES:
                yield replace(self, base=base)

    def of_two_joints(self) -> Iterator[Reading]:
        """Readings with changes of two more joints."""
        for i, j in combinations(range(len(self.order)), 2):
            for one in self.with_joint(i):
                yield from one.with_joint(j)

    def with_joint(self, joint: int) -> Iterator[Reading]:
        """Readings with this joint reversed or with another zero."""
        chosen = np.arange(len(self.order)) == joint
        yield replace(self, direction=np.where(chosen, -self.direction, self.direction))
        for angle in ZEROS if self.turns[joint] else ():
            yield replace(self, zero=self.zero + angle * chosen)

    def words(self, joints: tuple[str, ...]) -> list[str]:
        """The changes, in words."""
        found = []
        for k, joint in enumerate(joints):
            angle = (self.zero[k] + 90.0) % 360.0 - 90.0
            found += [f"{joint} turning the other way"] if self.direction[k] < 0.0 else []
            found += [f"{joint} {ZEROS[angle]}"] if angle else []
            found += [f"{joint} recorded as {joints[self.order[k]]}"] if self.order[k] != k else []
        found += [] if self.gravity else ["gravity left out of them"]
        found += [f"the base {BASES[self.base]}"] if any(self.base) else []
        return found


class Motion:
    """Some samples of a motion, and how much of their effort a robot's description explains.

    Args:
        signals: with effort, joints in the robot's order.
    """

    def __init__(self, signals: Signals, robot: Robot) -> None:
        assert signals.effort is not None
        rows = some(np.flatnonzero(signals.interior & telling(signals).any(axis=1)), MOST_ROWS)
        self.robot = robot
        self.position, self.velocity = signals.position[rows], signals.velocity[rows]
        self.acceleration, self.effort = signals.acceleration[rows], signals.effort[rows]
        self.sign = signals.sign[rows]
        self.loud = loud(signals, robot, rows) if len(rows) else np.zeros(robot.width, bool)

    def explained(self, reading: Reading, bent: bool = False) -> float:
        """Share of the efforts' variance, mean of the joints, that bodies, rotor inertia and friction explain.

        Args:
            bent: with inertial parameters that deviate by up to `LINKS_OFF`, fitted to the efforts.
        """

        def read(values: np.ndarray) -> np.ndarray:
            return reading.direction * values[:, reading.order]

        robot = self.robot.tilted(*np.deg2rad(reading.base)) if any(reading.base) else self.robot
        robot = robot if reading.gravity else replace(robot, gravity_vector=np.zeros(3))
        position, velocity = read(self.position) + np.deg2rad(reading.zero), read(self.velocity)
        effort, acceleration, sign = read(self.effort), read(self.acceleration), read(self.sign)
        borne = robot.rigid_effort(position, velocity, acceleration)
        loud = self.loud[reading.order]
        if bent:
            columns = robot.regressor(position, velocity, acceleration) @ relative_inertials(robot)
            tall, target = _shared(
                (effort - borne)[:, loud],
                columns[:, loud],
                *(one[:, loud] for one in (acceleration, velocity, sign)),
            )
            borne = borne + columns @ _within(tall, target, LINKS_OFF)
        return explained(*(column[:, loud] for column in (effort, borne, acceleration, velocity, sign)))

    def explained_by_a_load(self) -> float:
        """As `explained`, for the motion as recorded, with the best payload on any one of the links."""
        robot, loud = self.robot, self.loud
        apart = [one[:, loud] for one in (self.acceleration, self.velocity, self.sign)]
        effort = self.effort[:, loud]
        borne = robot.rigid_effort(self.position, self.velocity, self.acceleration)[:, loud]
        columns = robot.regressor(self.position, self.velocity, self.acceleration)[:, loud]
        best = 0.0
        for link in range(robot.width):
            of_link = columns[:, :, PER_LINK * link : PER_LINK * (link + 1)]
            tall, target = _shared(effort - borne, of_link, *apart)
            load = np.linalg.lstsq(tall, target, rcond=1e-6)[0]
            if np.linalg.norm(load[1:POINT]) <= REACH * load[0]:
                best = max(best, explained(effort, borne + of_link @ load, *apart))
        return best


def misread(signals: Signals, robot: Robot) -> Iterator[Remark]:
    """How a robot's description differs from the way its motion was recorded."""
    motion = Motion(signals, robot)
    if len(motion.effort) < MOST_ROWS // 10 or not motion.loud.any():
        return
    recorded = Reading.as_recorded(robot)
    before = motion.explained(recorded)
    loaded = before if before > POOR else max(before, motion.explained_by_a_load())
    if loaded > POOR:
        return
    share, readings = _best(motion, recorded)
    if share > GOOD and BETTER * (1.0 - share) < 1.0 - loaded and not _bent(motion, recorded, readings[0]):
        words = " or ".join(listed(reading.words(robot.joints)) for reading in readings)
        yield (
            weightless()
            if not readings[0].gravity
            else Remark(
                "",
                f"The robot description explains {100 * before:.0f} % of the efforts as they are recorded, and "
                f"{100 * share:.0f} % with {words}.",
                "Correct the description's axes, zeros and base, or the driver; --rename a=b --rename b=a exchanges two.",
            )
        )
    elif loaded < HARDLY:
        yield Remark(
            "",
            f"The robot description explains only {100 * before:.0f} % of the efforts.",
            "Check that it is this robot's, with its axes, zeros, base and names of joints.",
        )


def _bent(motion: Motion, recorded: Reading, other: Reading) -> bool:
    """Whether slightly wrong links explain the efforts as recorded nearly completely, or about as well as another reading."""
    straight, bent = (1.0 - motion.explained(one, bent=True) for one in (other, recorded))
    return bent < NEARLY_ALL or bent <= BETTER * straight


def weightless() -> Remark:
    """The remark that the efforts leave gravity out, perhaps because the controller adds it."""
    return Remark(
        "",
        "The efforts leave gravity out: they hold what motion asks for, but not what the links weigh.",
        "Pass --add-gravity (node: add_gravity) if the controller adds it, or correct how the description's base is mounted.",
    )


def _best(motion: Motion, reading: Reading) -> tuple[float, list[Reading]]:
    """The readings that explain most, found by one change after another, and their share.

    On joints with parallel axes a single change may not help; then two are tried at once.
    """
    share, found = motion.explained(reading), [reading]
    for _ in range(motion.robot.width):
        best, better = _better(motion, found[0].others())
        if 1.0 - best > STEP * (1.0 - share) and share < BAD and motion.robot.width > 1:
            best, better = _better(motion, found[0].of_two_joints())
        if 1.0 - best > STEP * (1.0 - share):
            break
        share, found = best, better
    return share, found


def _better(motion: Motion, readings: Iterable[Reading]) -> tuple[float, list[Reading]]:
    """The readings that explain most, with ties, and their share."""
    tried = sorted(((motion.explained(reading), reading) for reading in readings), key=lambda one: -one[0])
    best = tried[0][0]
    return best, [one for share, one in tried if 1.0 - share <= TIED * (1.0 - best)][: 1 + MOST_TIED]


def _shared(effort: np.ndarray, columns: np.ndarray, *apart: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns (R, n, k) and efforts (R, n) of all joints stacked, each per the effort's spread, without what each joint's own
    columns (R, n) explain.

    Returns:
        (R n, k) and (R n,).
    """
    tall, target = [], []
    for j in range(effort.shape[1]):
        own = np.stack([*(one[:, j] for one in apart), np.ones(len(effort))], axis=1)
        basis = np.linalg.svd(own, full_matrices=False)[0]
        scale = max(float(np.std(effort[:, j])), 1e-12)
        tall.append((columns[:, j] - basis @ (basis.T @ columns[:, j])) / scale)
        target.append((effort[:, j] - basis @ (basis.T @ effort[:, j])) / scale)
    return np.concatenate(tall), np.concatenate(target)


def _within(tall: np.ndarray, target: np.ndarray, most: float) -> np.ndarray:
    """Coefficients of columns (R, k) that explain most of a target (R,), limited to `most` in magnitude."""
    q, r = np.linalg.qr(tall)
    return np.asarray(lsq_linear(r, q.T @ target, (-most, most)).x)


def explained(effort: np.ndarray, *columns: np.ndarray) -> float:
    """Share of the efforts' variance, mean of the joints, that columns (R, n) explain with positive coefficients."""
    return float(np.mean([_explained(*one) for one in zip(effort.T, *(c.T for c in columns), strict=True)]))


def _explained(effort: np.ndarray, *columns: np.ndarray) -> float:
    spread = float(np.sum((effort - effort.mean()) ** 2))
    if spread == 0.0:
        return 1.0
    matrix = np.stack([column - column.mean() for column in columns], axis=1)
    size = np.linalg.norm(matrix, axis=0)
    _, left = nnls(matrix / np.maximum(size, 1e-9 * np.sqrt(spread)), effort - effort.mean())
    return 1.0 - float(left**2 / spread)
