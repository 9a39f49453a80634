"""Conversion of recorded efforts to the effort that drives each joint, in N·m."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.errors import UsageError, listed
from bdnn_ros.readings import credible
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

EVERY_JOINT = None
"""In the place of a joint's name: all joints."""
COMMAND_AGE = 0.5
"""An effort command acts for so long [s] at most; a joint state later than that has no effort."""


def in_force(times: np.ndarray, commands: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which command is in force at each time: the last one before it, unless that is too old.

    Args:
        times, commands: [ns], (N,) any and (M,) in order, both by one clock.

    Returns:
        Rows of the commands, (N,), and whether there is one, (N,) bool.
    """
    if not len(commands):
        return np.zeros(len(times), int), np.zeros(len(times), bool)
    last = np.searchsorted(commands, times, side="right") - 1
    valid = (last >= 0) & (times - commands[np.maximum(last, 0)] <= COMMAND_AGE * 1e9)
    return np.maximum(last, 0), valid


@dataclass(frozen=True)
class EffortConvention:
    """How the effort that a driver reports becomes the effort that drives the joints.

    Attributes:
        factors: what a reported effort is multiplied by, (n,) [N·m, or N, a reported unit].
        robot: whose gravity a controller adds to the reported effort, or None where all of it is reported.
    """

    factors: np.ndarray
    robot: Robot | None = None

    @classmethod
    def of(cls, rules: Sequence[str], joints: Sequence[str], robot: Robot | None = None) -> EffortConvention:
        """The convention given by rules: `JOINT=FACTOR` for a joint, or `FACTOR` for all joints without a rule of their own.

        Raises:
            UsageError: as `factors_by_joint`, or a rule names none of the joints.
        """
        given = factors_by_joint(rules)
        for name, factor in given.items():
            if name not in joints and name is not EVERY_JOINT:
                raise UsageError(
                    f"Effort factor '{name}={factor:g}': there is no joint {name!r}.",
                    f"Name one of {listed(joints, 20)}.",
                )
        general = given.get(EVERY_JOINT, 1.0)
        return cls(np.array([given.get(joint, general) for joint in joints], float), robot)

    def acting(self, position: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """The effort that drives the joints [N·m], from a reported one, (N, n) at positions (N, n) [rad].

        An effort that was not measured must be NaN and stays NaN: no gravity is added for a joint without a sensor.
        """
        effort = self.factors * effort
        return effort if self.robot is None else effort + self.robot.gravity(position)

    def applied(self, recording: Recording, commanded: bool = False) -> Recording:
        """The recording with the effort that drives the joints; unchanged if it has none.

        Args:
            commanded: the efforts are commands, which may be zero throughout; where a measured one is, there is no sensor.
        """
        if recording.effort is None:
            return recording
        return replace(recording, effort=self.sensed(recording.position, recording.effort, commanded))

    def sensed(self, position: np.ndarray, effort: np.ndarray, commanded: bool) -> np.ndarray:
        """As `acting`, for a whole recording: an effort that is zero throughout is no measurement and stays zero."""
        there = commanded | np.nan_to_num(effort).any(axis=0)
        return np.where(there, self.acting(position, effort), effort)


def factors_by_joint(rules: Sequence[str]) -> dict[str | None, float]:
    """The factors of rules by joint; that of `EVERY_JOINT` applies to joints without one of their own.

    Raises:
        UsageError: a rule is malformed, its factor is zero or not finite, or there are two for the same.
    """
    given: dict[str | None, float] = {}
    for rule in rules:
        name, equals, number = rule.rpartition("=")
        joint = name if equals else EVERY_JOINT
        if joint in given:
            whom = "all joints" if joint is EVERY_JOINT else joint
            raise UsageError(
                f"Two effort factors are given for {whom}.", "Give one, the product where both hold."
            )
        given[joint] = _number(rule, number)
    return given


def _number(rule: str, text: str) -> float:
    try:
        factor = float(text)
    except ValueError:
        factor = np.nan
    if not credible(np.array(factor)) or factor == 0.0:
        raise UsageError(
            f"Effort factor {rule!r} is not a number other than zero.",
            "Use JOINT=FACTOR, or FACTOR for all others.",
        )
    return factor
