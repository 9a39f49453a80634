"""Limits of a motion: those of the robot, less a reserve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bdnn_ros.dynamics import Dynamics
from bdnn_ros.errors import UsageError, article, listed
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import ACCELERATION_PER_VELOCITY, Trajectory

TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Bounds:
    """Limits of a motion, (n,) each: position range, and magnitudes of velocity, acceleration and effort.

    Attributes:
        model: what tells the effort.
    """

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    effort: np.ndarray
    model: Dynamics

    @property
    def width(self) -> int:
        """Number of joints n."""
        return len(self.lower)

    @classmethod
    def of(
        cls,
        robot: Robot,
        *,
        margin: float = 0.05,
        velocity: float = 0.8,
        acceleration: float | None = None,
        effort: float = 0.8,
        ranges: Mapping[str, tuple[float, float]] | None = None,
        model: Dynamics | None = None,
    ) -> Bounds:
        """The robot's limits, less a reserve.

        A joint that may turn by more than a revolution gets one revolution about the middle, unless a range is given.

        Args:
            margin: share of each joint's range kept free at both ends.
            velocity, effort: share of the limits that may be used.
            acceleration: [rad/s²] of every joint; None takes a multiple of its velocity.
            ranges: position ranges by joint, of which what is inside the limits counts [rad].
            model: tells the effort, where more is known than the robot's description.

        Raises:
            UsageError: a share makes no sense, or a range is empty or of no joint.
        """
        for name, share, most in (("margin", margin, 0.49), ("velocity", velocity, 1), ("effort", effort, 1)):
            if not (0.0 <= share <= most and (share > 0.0 or name == "margin")):
                from_where = "from 0 to" if name == "margin" else "above 0, at most"
                raise UsageError(
                    f"{article(name).capitalize()} of {share:g} makes no sense.",
                    f"Use a share {from_where} {most}.",
                )
        if acceleration is not None and not acceleration > 0.0:
            raise UsageError(f"An acceleration of {acceleration:g} makes no sense.", "Use rad/s² above zero.")
        low, high = robot.limits.lower.copy(), robot.limits.upper.copy()
        narrowed = np.zeros(robot.width, bool)
        for joint, (least, most_) in (ranges or {}).items():
            if joint not in robot.joints:
                raise UsageError(
                    f"There is no joint {joint!r} to narrow.", f"There are {listed(robot.joints, 20)}."
                )
            if not least < most_:  # also where one is no number, which no comparison would keep
                raise UsageError(
                    f"The range {least:g} to {most_:g} of {joint} is none.",
                    "Give a lower and a higher number.",
                )
            k = robot.joints.index(joint)
            low[k], high[k], narrowed[k] = max(low[k], least), min(high[k], most_), True
        low, high = _room(low, high, robot.slides | narrowed)
        reserve = margin * (high - low)
        low, high = low + reserve, high - reserve
        if (low >= high).any():
            joint = robot.joints[int(np.argmax(low >= high))]
            raise UsageError(f"{joint} has no room to move.", "Widen its range, or lower the margin.")
        speed = velocity * robot.limits.usual_velocity
        quick = ACCELERATION_PER_VELOCITY * speed
        if acceleration is not None:
            quick = np.full_like(speed, acceleration)
        return cls(low, high, speed, quick, effort * robot.limits.effort, robot if model is None else model)

    def kept_by(self, motion: Trajectory, slack: float = 1e-6) -> bool:
        """Whether a motion stays within the limits."""
        inside = (motion.position >= self.lower - slack) & (motion.position <= self.upper + slack)
        slow = np.abs(motion.velocity) <= self.velocity * (1.0 + slack)
        gentle = np.abs(motion.acceleration) <= self.acceleration * (1.0 + slack)
        if not (inside & slow & gentle).all():
            return False
        effort = self.model.inverse_dynamics(motion.position, motion.velocity, motion.acceleration)
        return bool((np.abs(effort) <= self.effort * (1.0 + slack)).all())


def _room(low: np.ndarray, high: np.ndarray, whole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest position of each joint, (n,) each [rad] ([m]).

    A missing limit is taken to be half a turn (π m) from zero, or a whole turn from the other limit. A joint with more than
    one turn uses one turn about the middle of its range, unless the whole range was asked for.

    Args:
        low, high: limits, infinite where there are none, (n,) each.
        whole: joints that may use all of their range, however long, (n,) bool.
    """
    neither = np.isinf(low) & np.isinf(high)
    low, high = np.where(neither, -np.pi, low), np.where(neither, np.pi, high)
    low = np.where(np.isinf(low), high - TURN, low)
    high = np.where(np.isinf(high), low + TURN, high)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    half = np.where(whole, half, np.minimum(half, 0.5 * TURN))
    return middle - half, middle + half
