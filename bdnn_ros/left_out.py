"""Joints of the robot that are not selected although recordings contain them: where they stand, and whether they matter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.recording import Recording, moving
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mimics import mimicking, ratios
from bdnn_ros.robot.urdf import Held
from bdnn_ros.signals import prepare
from bdnn_ros.signals.wraps import without_wraps

MATTERS = 0.02
"""Others' motion counts where it changes what bodies ask of a joint by this share of the spread of its effort."""
MOST_ROWS = 500


def beside(recording: Recording, others: Sequence[Recording]) -> Recording:
    """A recording with the positions of further joints, interpolated to its times and held at their ends.

    The effort of these joints is zero, and the result has no velocity.

    Args:
        others: by the same clock.
    """
    if not others:
        return recording
    positions, joints = [recording.position], recording.joints
    for other in map(without_wraps, others):
        time = recording.time + (recording.epoch - other.epoch) * 1e-9
        positions += [np.interp(time, other.time, column)[:, None] for column in other.position.T]
        joints += other.joints
    position, effort = np.concatenate(positions, axis=1), recording.effort
    if effort is not None:
        effort = np.pad(effort, ((0, 0), (0, len(joints) - recording.width)))
    return replace(recording, joints=joints, position=position, velocity=None, effort=effort)


def standing(recordings: Sequence[Recording], joints: Sequence[str], urdf: str) -> Held:
    """Median position of each of the joints that a recording contains, and of mimic joints whose leader one contains.

    Args:
        urdf: says which joints mimic others.
    """
    seen = {
        joint: [r.position[:, r.joints.index(joint)] for r in recordings if joint in r.joints]
        for joint in joints
    }
    held = {joint: float(np.median(np.concatenate(parts))) for joint, parts in seen.items() if parts}
    by = ratios(urdf)
    for joint, leader in mimicking(urdf).items():
        if joint in joints and joint not in held and leader in held:
            held[joint] = by[joint][0] * held[leader] + by[joint][1]
    return held


def led(robot: Robot, recordings: Sequence[Recording]) -> dict[str, str]:
    """Moving joints that a mimic joint follows, with that joint: one drive moves both. Not if the follower is seen to stand."""
    found = {}
    for recording in recordings:
        moves = dict(zip(recording.joints, moving(recording), strict=True))
        for joint, leader in mimicking(robot.urdf).items():
            if leader in robot.joints and moves.get(leader) and moves.get(joint, True):
                found[leader] = joint
    return found


def unseen(whole: Robot, robot: Robot) -> list[float]:
    """The position of each joint of the whole robot while nothing is seen of it [rad] ([m]).

    Args:
        robot: where it holds a joint that joint stands; the others at zero, or at the nearest limit.
    """
    nearest = np.clip(0.0, whole.limits.lower, whole.limits.upper).tolist()
    held = dict(robot.held)
    return [float(held.get(joint, at)) for joint, at in zip(whole.joints, nearest, strict=True)]


def disturbing(recording: Recording, whole: Robot, robot: Robot) -> list[str]:
    """Joints in the recording that are not selected and whose motion the selected joints feel.

    Args:
        recording: with all its joints.
        whole: the robot with all of its own.
        robot: the same with those that are looked at.
    """
    moves = dict(zip(recording.joints, moving(recording), strict=True))
    out = [joint for joint in whole.joints if joint not in robot.joints and moves.get(joint)]
    if not out:
        return []
    out_of_it = {joint for joint in whole.joints if joint not in (*robot.joints, *recording.joints)}
    signals = prepare(recording)
    rows = slice(None, None, max(len(signals) // MOST_ROWS, 1))
    looked_at = [recording.joints.index(joint) for joint in robot.joints]
    own = [whole.joints.index(joint) for joint in robot.joints]
    motion = np.zeros((3, len(signals.time[rows]), whole.width))
    motion[0] = unseen(whole, robot)
    recorded = np.stack([signals.position, signals.velocity, signals.acceleration])[:, rows]
    motion[:, :, own] = recorded[:, :, looked_at]
    usual = whole.rigid_effort(*motion)[:, own]
    effort = usual if signals.effort is None else signals.effort[rows][:, looked_at]
    limit = MATTERS * np.std(effort, axis=0)
    by = ratios(whole.urdf)
    follow = {joint: leader for joint, leader in mimicking(whole.urdf).items() if joint in out_of_it}

    def felt(joint: str) -> bool:
        moved = motion.copy()
        course = recorded[:, :, recording.joints.index(joint)]
        moved[:, :, whole.joints.index(joint)] = course
        for follower, leader in follow.items():
            if leader == joint:
                multiplier, offset = by[follower]
                moved[:, :, whole.joints.index(follower)] = multiplier * course
                moved[0, :, whole.joints.index(follower)] += offset
        return bool((np.std(whole.rigid_effort(*moved)[:, own] - usual, axis=0) > limit).any())

    return [joint for joint in out if felt(joint)]
