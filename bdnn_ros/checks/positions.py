"""Whether positions are in radians and metres: not if they far exceed their range, or are faster than any robot."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bdnn_ros.errors import listed
from bdnn_ros.physical.remark import Remark
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals

BEYOND = 1.5
"""Positions are not in radians if most joints cover this many times their whole range, ..."""
FAR_BEYOND = 4.0
"""... or one joint this many times (its limits alone may be too narrow): in degrees, 7 % of its range suffice, ..."""
FASTER = 5.0
"""... or joints without a range, most joints being suspect, reach this many times their described velocity, and `QUICK`."""
QUICK = 20.0
"""Velocity of the fastest wrists [rad/s]: described velocities are often guesses."""
QUICKEST = 60.0
"""Velocity that a joint without a described one reaches only if in degrees [rad/s], ..."""
WIDEST = 720.0
"""... unless it covers more than this, as spinning wheels do [rad]: two turns in degrees."""
USUAL = 2.0
"""Percentage of the fastest samples, each way, to ignore [%]."""


def in_other_units(signals: Signals, robot: Robot) -> Iterator[Remark]:
    """Joints whose positions seem to be in degrees, or in millimetres where they slide."""
    whole = robot.limits.upper - robot.limits.lower
    limited = np.isfinite(whole) & (whole > 0.0)
    covered = np.divide(np.ptp(signals.position, axis=0), whole, out=np.zeros_like(whole), where=limited)
    most = np.count_nonzero(covered > BEYOND) > 0.5 * limited.sum()
    beyond = covered > (BEYOND if most else FAR_BEYOND)
    speed = _both_ways(signals)
    fast = ~limited & _too_fast(speed, signals, robot)
    fast &= np.count_nonzero(beyond | fast) > 0.5 * robot.width
    for slides, unit in ((False, "degrees"), (True, "millimetres")):
        alike = robot.slides == slides
        wide, quick = np.flatnonzero(beyond & alike), np.flatnonzero(fast & alike)
        if len(wide):
            joints = listed(signals.joints[k] for k in wide)
            cover, its, more = ("covers", "its", "") if len(wide) == 1 else ("cover", "their", ", and more")
            saying = f"{joints} {cover} {_rounded(covered[wide].min())} times {its} whole range{more}"
            yield _told(joints, saying, its, unit)
        if len(quick):
            joints = listed(signals.joints[k] for k in quick)
            reach, its, more = ("reaches", "its", "") if len(quick) == 1 else ("reach", "their", ", and more")
            saying = (
                f"{joints} {reach} {speed[quick].min():.0f} {'m/s' if slides else 'rad/s'} both ways{more}"
            )
            yield _told(joints, saying, its, unit)


def _both_ways(signals: Signals) -> np.ndarray:
    """Velocity that each joint reaches in both directions, (n,) [rad/s]: wheels and rotors spin one way."""
    low, high = np.percentile(signals.velocity, (USUAL, 100.0 - USUAL), axis=0)
    return np.asarray(np.minimum(-low, high))


def _too_fast(speed: np.ndarray, signals: Signals, robot: Robot) -> np.ndarray:
    """Joints that are faster than any robot, (n,) bool; a single joint is judged by its description only."""
    limit = robot.limits.velocity
    told = np.isfinite(limit)
    most = np.where(told, np.maximum(FASTER * limit, QUICK), QUICKEST if robot.width > 1 else np.inf)
    return np.asarray((speed > most) & (np.ptp(signals.position, axis=0) < WIDEST))


def _told(joints: str, saying: str, its: str, unit: str) -> Remark:
    return Remark(
        joints,
        f"{saying}: {its} positions seem to be in {unit}.",
        "Let the driver report radians (metres), and check that this is the robot's description.",
    )


def _rounded(value: float) -> str:
    """A number with at least two digits and no exponent."""
    return f"{value:.2g}" if value < 10.0 else f"{value:.0f}"
