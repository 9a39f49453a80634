"""Whether something pushes one joint for a while: a contact that neither bodies nor friction explain.

Blocks of time in which a joint's residual after bodies, rotors and friction is far above its usual level are a push if they
are temporary, pull one way, and lie at positions that the joint also takes without them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bdnn_ros.checks.handling import Motion
from bdnn_ros.physical.remark import Remark
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals

ROUNDS = 4
"""In which the fit and the weights of blocks are found in turn."""
OFTEN = 20
"""Blocks in which a joint moves, at least, to tell what is usual of it."""
LOUD, QUIET = 10.0, 5.0
"""Error of a block, in usual ones, of a push; and of what is none, at most, which bounds the time of it."""
FEWEST, DENSE = 4, 0.1
"""Blocks of a push, at least, and their share of its time."""
LONGEST = 0.5
"""Share of the motion that a push lasts at most: what is there for longer may be the robot's own."""
EDGE = 0.05
"""And that is free of it before it and after it: what does not come and go may drift."""
OTHERS = 2.0
"""What is left of another joint meanwhile, in that of the rest of the time, at most: a load does something to all of them."""
ONE_WAY = 0.5
"""Mean of a push, in its root mean square: friction that changes pulls both ways."""
WORTH = 0.05
"""Root mean square of a push, in the spread of the effort: less is not worth another recording."""
KNOWN = 0.5
"""Share of a push, at least, at positions that the joint also takes without it: springs and cogging depend on the position."""
PLACES = 20
"""Stretches of a joint's range that count as positions."""
TINY = 1e-12


@dataclass(frozen=True)
class Push:
    """Something that pushes a joint: its index, and when it first and last does [s]."""

    joint: int
    begin: float
    end: float


def pushed(recording: Recording, signals: Signals, robot: Robot) -> Iterator[Remark]:
    """The remark on a contact."""
    found = push(signals, robot)
    if found is not None:
        joint = robot.joints[found.joint]
        yield Remark(
            joint,
            f"{recording.name}: from {found.begin:.3g} to {found.end:.3g} s something seems to push {joint}: neither bodies "
            "nor friction explain its effort there.",
            "Leave that time out, or have `bdnn diagnose` tell what it is.",
        )


def push(signals: Signals, robot: Robot) -> Push | None:
    """A push on one joint, continuous or intermittent; None if there surely is none, or without efforts.

    What several joints feel is not reported, since it may be a load.
    """
    if signals.effort is None or not signals.interior.any():
        return None
    motion = Motion(signals, robot)
    motion.weight = motion.weight * ~motion.holds
    left, ratio = _left(motion)
    loud = ratio > LOUD
    joints = np.flatnonzero(loud.any(axis=0))
    if len(joints) != 1:
        return None
    joint = int(joints[0])
    felt, count = np.flatnonzero(ratio[:, joint] > QUIET), len(ratio)
    first, last = int(felt[0]), int(felt[-1])
    lasts, often = last + 1 - first, int(loud[:, joint].sum())
    for_a_while = lasts <= LONGEST * count and min(first, count - 1 - last) >= EDGE * count
    if often < max(FEWEST, DENSE * lasts) or not for_a_while:
        return None
    # a push begins and ends within the blocks beside it
    outside = (np.arange(count) < first - 1) | (np.arange(count) > last + 1)
    meanwhile, usually = (
        np.sqrt(np.mean(part**2, axis=0)) for part in (ratio[first : last + 1], ratio[outside])
    )
    if (np.delete(meanwhile, joint) > OTHERS * np.delete(usually, joint)).any():
        return None
    moves = motion.weight[:, joint] > 0.0
    rows, free = loud[motion.block, joint] & moves, outside[motion.block] & moves
    if not free.any() or not _pushes(motion, joint, left[:, joint], rows, free):
        return None
    times = motion.time[(motion.block >= first) & (motion.block <= last)]
    return Push(joint, float(times[0]), float(times[-1]))


def _pushes(motion: Motion, joint: int, left: np.ndarray, rows: np.ndarray, free: np.ndarray) -> bool:
    """Whether a joint's residual (R,) on some rows, (R,) bool, looks like a push compared with the free rows."""
    size = float(np.sqrt(np.mean(left[rows] ** 2)))
    one_way = abs(float(left[rows].mean())) > ONE_WAY * size
    position = motion.position[:, joint]
    edges = np.linspace(position.min(), position.max(), PLACES + 1)
    places = np.digitize(position, edges[1:-1])
    known = float(np.isin(places[rows], places[free]).mean()) > KNOWN
    return one_way and known and size > WORTH * float(motion.effort[free, joint].std())


def _left(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Residual (R, n) after bodies, rotors and friction, and its level in each block relative to the usual, (B, n).

    The level is zero where a joint hardly moves. Blocks with a large residual get less weight, or a push would distort the
    bodies (iteratively reweighted least squares: Holland and Welsch, 1977).
    """
    moves = motion.weight > 0.0
    size = np.bincount(motion.block)[:, None]
    counts = np.zeros((len(size), moves.shape[1]))
    np.add.at(counts, motion.block, moves)
    whole = counts > 0.5 * size
    whole &= whole.sum(axis=0) >= OFTEN
    left, ratio = motion.target, np.zeros(counts.shape)
    for _ in range(ROUNDS):
        left, _ = motion.left(motion.columns, motion.precision)
        squared = np.zeros(counts.shape)
        np.add.at(squared, motion.block, np.where(moves, left**2, 0.0))
        error = np.sqrt(squared / np.maximum(counts, 1.0))
        for joint, told in enumerate(whole.T):
            if told.any():
                usual = max(float(np.median(error[told, joint])), TINY)
                ratio[told, joint] = error[told, joint] / usual
                share = np.minimum(usual / np.maximum(error[:, joint], usual), 1.0)
                motion.weight[:, joint] = moves[:, joint] * share[motion.block] / usual
    return left, ratio
