"""The regression of a recorded motion against a robot's simulation, made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_opening, maximum_filter1d

from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.learned import Learned
from bdnn_ros.diagnosis.regression.load_friction import LoadFriction, carried
from bdnn_ros.diagnosis.regression.noise import moved
from bdnn_ros.diagnosis.regression.unsure import Unsure
from bdnn_ros.effects.motion import Motion
from bdnn_ros.errors import RecordingError
from bdnn_ros.physical.left_open import LeftOpen
from bdnn_ros.physical.links import relative_inertials
from bdnn_ros.physical.parameters import PER_JOINT
from bdnn_ros.recording import further
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.mounting import tilt_of
from bdnn_ros.scores import described_effort
from bdnn_ros.signals import Signals

ROWS_PER_CUTOFF = 2.5
"""Rows per second and Hz of cut-off: what the twice low-passed signals still carry."""
BLOCK_SECONDS, MOST_BLOCKS = 2.0, 40
"""Held-out blocks are about this long; longer in a recording that would have more of them."""
SHORTEST_BLOCK, LEAST_MOTION = 0.5, 8.0
"""And shorter, down to the first [s], where a joint moves for less than the second [s]: it has to move in some of all sets."""
LEAST_VALUES = 100.0
"""With fewer independent low-passed values of a joint's motion, a push or a drift can fit anything: neither is named."""
SLOWEST = 2.0
"""What is looked at behind a lower low-pass [Hz] was not passed by it before, and tells no less of time for being slow."""
IDENTIFIED = 0.01
"""One standard deviation of what was identified, where errors of a description's links are relative."""
TURNING_WIDTHS = 2.0
"""The low-pass reaches so many of its standard deviations."""
DWELLING_WIDTHS, STICKING_WIDTHS = 0.5, 2.0
"""A joint that creeps for so many standard deviations of the low-pass dwells; it sticks after so many."""


def build(
    signals: Signals,
    robot: Robot,
    simulated: np.ndarray | None = None,
    left_open: LeftOpen | None = None,
    tilt: tuple[float, float] | None = None,
    grows: LoadFriction | None = None,
    unloaded: Robot | None = None,
    unsure: Unsure | None = None,
) -> Equations:
    """The regression of a motion against a robot's simulation.

    Args:
        signals: motion with effort, joints in the robot's order.
        robot: what the simulation believes.
        simulated: the effort the simulation predicts, (N, n) [N·m]; None for the robot's own.
        left_open: what is not known of inertial parameters, `COMMON` and what joints may add, where they were identified.
        tilt: roll and pitch [rad] at which the base seems to stand, beyond what the robot says: what its bodies' errors
            weigh is counted as they hang then. None where nothing is known of one.
        grows: friction that the simulation has and that grows with the load.
        unloaded: whose links may be off, where the robot carries loads that were found on it; None for the robot.
        unsure: what is not known of what an earlier diagnosis found at joints.

    Raises:
        RecordingError: no joint moves, or no effort.
    """
    if signals.effort is None:
        raise RecordingError("The recording carries no effort.", "Record one, or use --effort command.")
    resting = _resting(signals)
    rows, runs = _rows(signals)
    drive = robot.drive_effort(signals.velocity, signals.acceleration, signals.sign)
    simulated = described_effort(robot, signals) if simulated is None else simulated
    simulated, passing = (grows or LoadFriction()).through(signals, robot, simulated)
    motion = _standing(Motion(signals, robot, simulated, drive), tilt)
    load = None if passing is None else carried(signals, robot, simulated, passing)
    relative, jointwise, learned = _errors(unloaded or robot, left_open, load)
    masses = (np.arange(relative.shape[1]) % PER_LINK == 0) & (left_open is None)
    more = (0, 0 if unsure is None else len(unsure.covariance))
    usable = _usable(signals, resting, rows)
    spread, size = _usual(signals.smooth(signals.effort)[rows])
    return Equations(
        motion,
        simulated,
        drive,
        rows,
        target=signals.smooth(signals.effort - simulated)[rows],
        usable=usable,
        doubt=turns(signals)[rows],
        dwelling=sticks(signals, DWELLING_WIDTHS)[rows],
        block=_blocks(usable, signals.time[rows]),
        runs=runs,
        relative=np.pad(relative, ((0, 0), more)),
        masses=np.pad(masses, more),
        effort_scale=spread,
        effort_size=size,
        jointwise=jointwise,
        learned=learned,
        passing=passing,
        unsure=unsure,
    )


def _standing(motion: Motion, tilt: tuple[float, float] | None) -> Motion:
    """A motion on a base that is tilted so further [rad]; None for nothing."""
    if tilt is None:
        return motion
    standing = motion.robot.tilted(*np.add(tilt_of(motion.robot.gravity_vector), tilt))
    return replace(motion, robot=standing, level=motion.robot)


def _usual(effort: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Spread of each joint's effort (R, n), never quite nothing, and its root mean square, (n,) each [N·m]."""
    spread = np.maximum(np.std(effort, axis=0), 1e-5 * max(float(np.std(effort)), 1e-9))
    return spread, np.hypot(effort.mean(axis=0), spread)


def _resting(signals: Signals) -> np.ndarray:
    """Samples at which joints rest, (N, n) bool.

    Raises:
        RecordingError: no joint moves.
    """
    resting = signals.at_rest | ~further(signals.position, signals.position_noise)
    if resting.all(axis=1).mean() > 0.98:
        raise RecordingError(
            "No joint moves in this recording.", "Move the joints, each over a good part of its range."
        )
    return np.asarray(resting)


def _rows(signals: Signals) -> tuple[np.ndarray, list[slice]]:
    """Which samples are rows, (R,), and the rows of each gap-free piece."""
    step = max(round(signals.rate / (ROWS_PER_CUTOFF * signals.cutoff)), 1)
    rows = np.concatenate([np.arange(s.start, s.stop, step) for s in signals.segments])
    rows = rows[signals.interior[rows]]
    owner = np.zeros(len(signals), int)
    for k, segment in enumerate(signals.segments):
        owner[segment] = k
    edges = [0, *(np.flatnonzero(np.diff(owner[rows])) + 1).tolist(), len(rows)]
    return rows, [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]


def _usable(signals: Signals, resting: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Rows that count, (R, n) bool.

    Raises:
        RecordingError: none does.
    """
    usable = (signals.seen & ~(resting | sticks(signals, STICKING_WIDTHS)))[rows]
    if not usable.any():
        raise RecordingError(
            "Wherever the robot moves its effort is at a limit or stands still.",
            "Check that the driver reports it, or move the robot more gently.",
        )
    return np.asarray(usable)


def _errors(
    robot: Robot, left_open: LeftOpen | None, load: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray | None, Learned | None]:
    """What errors do to parameters of links and, where they were identified, of joints and what they add: see `Equations`."""
    if left_open is None:
        return relative_inertials(robot), None, None
    links = robot.width * PER_LINK
    base = links + robot.width * PER_JOINT
    relative, jointwise, weights = np.split(identified(left_open.covariance), [links, base])
    # identified offsets add to the measured effort, the contract's to what acts
    jointwise[-robot.width :] *= -1.0
    return relative, jointwise, Learned(left_open, weights, load)


def _blocks(usable: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Held-out block of each row, (R,) int, by the rows that count, (R, n) bool, and their time [s]."""
    steps = np.diff(time, prepend=time[0])
    since = np.cumsum(np.minimum(steps, BLOCK_SECONDS))  # a long pause must not make the blocks long
    moving = moved(usable, time)
    seldom = float(moving[moving > 0.0].min()) / LEAST_MOTION
    length = float(np.clip(seldom * BLOCK_SECONDS, SHORTEST_BLOCK, BLOCK_SECONDS))
    most = MOST_BLOCKS * min(BLOCK_SECONDS / length, 2.0)
    block = since // max(length, since[-1] / (most - 1e-6))
    return np.unique(block, return_inverse=True)[1].astype(int)


def least_motion(signals: Signals) -> float:
    """How long a joint has to move for what changes with time to be told from what differs from place to place [s]."""
    cutoff = signals.cutoff if signals.own is not None else max(signals.cutoff, SLOWEST)
    return max(LEAST_MOTION, LEAST_VALUES / (2.0 * cutoff))


def identified(covariance: np.ndarray) -> np.ndarray:
    """Map from independent errors to those of all parameters that were identified, (P, P).

    One hundredth of a unit is one standard deviation of what was identified, so that a spread of 0.02 doubts it twofold.
    """
    variances, directions = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return np.asarray(directions * np.sqrt(np.maximum(variances, 0.0)) / IDENTIFIED)


def turns(signals: Signals) -> np.ndarray:
    """How much of the low-pass at each sample a joint turns round or creeps in, (N, n).

    A joint that sticks has any effort between both directions' friction; no motion tells which. When it turned is known to
    about what motion was softened by.
    """
    turning = signals.hardly_moves | (
        np.abs(signals.velocity) < np.abs(signals.acceleration) * signals.motion_std
    )
    for rows in signals.segments:
        v = signals.velocity[rows]
        turning[rows][1:] |= v[1:] * v[:-1] <= 0.0
    return np.abs(signals.smooth(signals.soften(turning.astype(float))))


def sticks(signals: Signals, widths: float) -> np.ndarray:
    """Samples near which a joint creeps for so many standard deviations of the low-pass, (N, n) bool."""
    width = signals.kernel_std * signals.rate
    reach = 2 * int(np.ceil(TURNING_WIDTHS * width)) + 1
    result = signals.hardly_moves.copy()
    for rows in signals.segments:
        stuck = binary_opening(result[rows], np.ones((int(np.ceil(widths * width)), 1), bool))
        result[rows] = maximum_filter1d(stuck, reach, axis=0)
    return result
