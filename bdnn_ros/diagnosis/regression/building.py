"""Build the regression of a recorded motion against a robot's simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_opening, maximum_filter1d

from bdnn_ros.diagnosis.regression.decimation import Decimation
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.errors import Errors
from bdnn_ros.diagnosis.regression.joint_errors import JointErrors
from bdnn_ros.diagnosis.regression.known import Known
from bdnn_ros.diagnosis.regression.load_friction import body_effort
from bdnn_ros.diagnosis.regression.noise import moving_time
from bdnn_ros.diagnosis.regression.rows import Rows
from bdnn_ros.effects.motion import Motion
from bdnn_ros.errors import RecordingError
from bdnn_ros.physical.links import relative_inertials
from bdnn_ros.physical.parameters import PER_JOINT
from bdnn_ros.recording import further
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.mounting import tilt_of
from bdnn_ros.scores import described_effort
from bdnn_ros.signals import Signals

ROWS_PER_CUTOFF = 2.5
"""Rows per second and Hz of cut-off: the rate that twice low-passed signals still carry."""
BLOCK_SECONDS, MOST_BLOCKS = 2.0, 40
"""Usual length of a held-out block [s], and most blocks: in a longer recording blocks are longer."""
SHORTEST_BLOCK, LEAST_MOTION = 0.5, 8.0
"""Shortest block [s], used where a joint moves for less than `LEAST_MOTION` [s]: it must move in several folds."""
FEWEST_ROWS = 10
"""A joint with fewer usable rows is not compared: any change that fits them would seem to leave no noise there."""
LEAST_VALUES = 100.0
"""Fewest independent low-passed values of a joint's motion: with fewer, a push or drift can fit anything and is not named."""
SLOWEST = 2.0
"""Lowest cut-off counted when motion is measured in independent values [Hz]: a lower one is chosen for slow motion only."""
IDENTIFIED = 0.01
"""Relative error that stands for one standard deviation of an identified parameter."""
TURNING_WIDTHS = 2.0
"""Reach of the low-pass in standard deviations of its kernel."""
DWELLING_WIDTHS, STICKING_WIDTHS = 0.5, 2.0
"""Creeping for so many standard deviations of the low-pass kernel is dwelling; for `STICKING_WIDTHS`, sticking."""


def build(
    signals: Signals,
    robot: Robot,
    simulated: np.ndarray | None = None,
    known: Known | None = None,
    tilt: tuple[float, float] | None = None,
) -> Equations:
    """Build the regression of a motion against a robot's simulation.

    Args:
        signals: motion with effort, joints in the robot's order.
        robot: as the simulation has it.
        simulated: the effort the simulation predicts, (N, n) [N·m]; None for the robot's own.
        known: of an earlier model in the simulation's place; None for a description.
        tilt: roll and pitch of the base beyond the description [rad], at which errors of the bodies are weighed; None for
            none.

    Raises:
        RecordingError: no joint moves, or no effort.
    """
    if signals.effort is None:
        raise RecordingError("The recording carries no effort.", "Record one, or use --effort command.")
    known = known or Known()
    resting = _resting(signals)
    drive = robot.drive_effort(signals.velocity, signals.acceleration, signals.sign)
    simulated = described_effort(robot, signals) if simulated is None else simulated
    simulated, passing = known.by_load.applied(signals, robot, simulated)
    rows = _rows(signals, simulated, resting)
    motion = _standing(Motion(signals, robot, simulated, drive), tilt)
    load = None if passing is None else body_effort(signals, robot, simulated, passing)
    decimation = Decimation(motion, rows.samples, passing, known.lead)
    return Equations(rows, decimation, _errors(known.unloaded or robot, known, load))


def _rows(signals: Signals, simulated: np.ndarray, resting: np.ndarray) -> Rows:
    """The rows of a motion, given the simulation's effort (N, n) [N·m] and the samples at which joints rest, (N, n) bool."""
    assert signals.effort is not None
    samples, runs = _samples(signals)
    usable = _usable(signals, resting, samples)
    scale, size = _usual(signals.smooth(signals.effort)[samples])
    return Rows(
        samples,
        signals.time[samples],
        target=signals.smooth(signals.effort - simulated)[samples],
        usable=usable,
        sticking_doubt=sticking_doubt_of(signals)[samples],
        dwelling=near_creeping(signals, DWELLING_WIDTHS)[samples],
        block=_blocks(usable, signals.time[samples]),
        runs=runs,
        effort_scale=scale,
        effort_size=size,
    )


def _standing(motion: Motion, tilt: tuple[float, float] | None) -> Motion:
    """The motion on a base tilted further by roll and pitch [rad]; unchanged if None."""
    if tilt is None:
        return motion
    standing = motion.robot.tilted(*np.add(tilt_of(motion.robot.gravity_vector), tilt))
    return replace(motion, robot=standing, level=motion.robot)


def _usual(effort: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviation, never quite zero, and root mean square of each joint's effort (R, n), (n,) each [N·m]."""
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


def _samples(signals: Signals) -> tuple[np.ndarray, list[slice]]:
    """Samples that are rows, (R,), and the rows of each gap-free piece."""
    step = max(round(signals.rate / (ROWS_PER_CUTOFF * signals.cutoff)), 1)
    rows = np.concatenate([np.arange(s.start, s.stop, step) for s in signals.segments])
    rows = rows[signals.interior[rows]]
    owner = np.zeros(len(signals), int)
    for k, segment in enumerate(signals.segments):
        owner[segment] = k
    edges = [0, *(np.flatnonzero(np.diff(owner[rows])) + 1).tolist(), len(rows)]
    return rows, [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]


def _usable(signals: Signals, resting: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Usable rows, (R, n) bool.

    Raises:
        RecordingError: there are none.
    """
    usable = (signals.seen & ~(resting | near_creeping(signals, STICKING_WIDTHS)))[rows]
    usable &= usable.sum(axis=0) >= min(FEWEST_ROWS, usable.sum(axis=0).max())
    if not usable.any():
        raise RecordingError(
            "Wherever the robot moves its effort is at a limit or stands still.",
            "Check that the driver reports it, or move the robot more gently.",
        )
    return np.asarray(usable)


def _errors(robot: Robot, known: Known, load: np.ndarray | None) -> Errors:
    """Independent errors of a robot's links and, where they are known to be open, of its joints.

    Args:
        load: see `JointErrors`.
    """
    left_open, joints = known.left_open, None
    if left_open is None:
        relative = relative_inertials(robot)
    else:
        links = robot.width * PER_LINK
        base = links + robot.width * PER_JOINT
        relative, of_joints, weights = np.split(identified(left_open.covariance), [links, base])
        # identified offsets add to the measured effort, the contract's to what acts
        of_joints[-robot.width :] *= -1.0
        joints = JointErrors(left_open, of_joints, weights, load)
    masses = (np.arange(relative.shape[1]) % PER_LINK == 0) & (left_open is None)
    more = (0, 0 if known.unsure is None else len(known.unsure.covariance))
    return Errors(np.pad(relative, ((0, 0), more)), np.pad(masses, more), joints, known.unsure)


def _blocks(usable: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Held-out block of each row, (R,) int, from the usable rows (R, n) bool and their times [s]."""
    steps = np.diff(time, prepend=time[0])
    since = np.cumsum(np.minimum(steps, BLOCK_SECONDS))  # a long pause must not make the blocks long
    moving = moving_time(usable, time)
    seldom = float(moving[moving > 0.0].min()) / LEAST_MOTION
    length = float(np.clip(seldom * BLOCK_SECONDS, SHORTEST_BLOCK, BLOCK_SECONDS))
    most = MOST_BLOCKS * min(BLOCK_SECONDS / length, 2.0)
    block = since // max(length, since[-1] / (most - 1e-6))
    return np.unique(block, return_inverse=True)[1].astype(int)


def least_motion(signals: Signals) -> float:
    """Least motion of a joint for effects that change with time or place to be told apart (drifts, pushes, cogging) [s]."""
    cutoff = signals.cutoff if signals.own is not None else max(signals.cutoff, SLOWEST)
    return max(LEAST_MOTION, LEAST_VALUES / (2.0 * cutoff))


def identified(covariance: np.ndarray) -> np.ndarray:
    """Map from independent errors to those of all identified parameters, (P, P).

    A hundredth of a unit is one standard deviation of what was identified, so that a spread of 0.02 doubles the uncertainty.
    """
    variances, directions = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return np.asarray(directions * np.sqrt(np.maximum(variances, 0.0)) / IDENTIFIED)


def sticking_doubt_of(signals: Signals) -> np.ndarray:
    """Doubt: share of the low-pass window at each sample in which a joint reverses or creeps, (N, n).

    A joint that sticks bears any effort between the friction of either direction; its motion does not tell which. The moment
    of reversal is known to about the width of the motion's own low-pass.
    """
    turning = signals.hardly_moves | (
        np.abs(signals.velocity) < np.abs(signals.acceleration) * signals.motion_std
    )
    for rows in signals.segments:
        v = signals.velocity[rows]
        turning[rows][1:] |= v[1:] * v[:-1] <= 0.0
    return np.abs(signals.smooth(signals.soften(turning.astype(float))))


def near_creeping(signals: Signals, widths: float) -> np.ndarray:
    """Samples within reach of where a joint creeps for so many standard deviations of the low-pass, (N, n) bool."""
    width = signals.kernel_std * signals.rate
    reach = 2 * int(np.ceil(TURNING_WIDTHS * width)) + 1
    result = signals.hardly_moves.copy()
    for rows in signals.segments:
        stuck = binary_opening(result[rows], np.ones((int(np.ceil(widths * width)), 1), bool))
        result[rows] = maximum_filter1d(stuck, reach, axis=0)
    return result
