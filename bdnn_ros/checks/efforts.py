"""Times or joints whose efforts say nothing: not reported, held by brakes, or saturated."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bdnn_ros.errors import listed
from bdnn_ros.physical.remark import Remark
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals.powerless import powerless, usual_effort
from bdnn_ros.signals.unmeasured import absent, at_limit, held, held_alone

SATURATED = 0.01
"""Share of saturated samples that is worth a word."""
HELD_SECONDS = 0.05
"""Efforts that stand still for less than this are not worth a word [s]."""
HEAVY = 0.1
"""Links weigh on a joint where they ask for so much of what its efforts come to, and more than its friction holds."""


def unread(recording: Recording) -> Iterator[Remark]:
    """Joints whose driver reports no effort, and for how long it repeated all of them."""
    effort = recording.require_effort()
    missing = [joint for joint, gone in zip(recording.joints, absent(effort), strict=True) if gone]
    if missing:
        yield Remark(
            listed(missing),
            f"{recording.name}: the effort of {listed(missing)} never changes.",
            "Check that the driver reports it: nothing can be said about it.",
        )
    rate, of_all = max(recording.rate, 1e-9), held(effort)
    seconds = float((of_all & ~powerless(recording)).sum() / rate)
    if seconds > HELD_SECONDS and len(missing) < recording.width:
        yield Remark(
            "",
            f"{recording.name}: all efforts stand still for {seconds:.2g} s, longer than usual.",
            "If the robot moved meanwhile, check the driver; such moments do not count.",
        )
    alone = (held_alone(recording) & ~of_all[:, None]).sum(axis=0) / rate
    for joint, seconds in zip(recording.joints, alone, strict=True):
        if seconds > HELD_SECONDS:
            yield Remark(
                joint,
                f"{recording.name}: the effort of {joint} stands still for {seconds:.2g} s while the joint moves.",
                "Check its driver and the bus; such moments of it do not count.",
            )


def braked(recording: Recording, robot: Robot) -> Iterator[Remark]:
    """How long the brakes must have held the robot."""
    effort = recording.require_effort()
    heavy = np.maximum(HEAVY * usual_effort(effort), robot.coulomb)
    held_up = (np.abs(robot.gravity(recording.position[powerless(recording)])) > heavy).any(axis=1)
    seconds = float(held_up.sum() / max(recording.rate, 1e-9))
    if seconds > HELD_SECONDS:
        yield Remark(
            "",
            f"{recording.name}: for {seconds:.2g} s the robot stands without an effort, though its links weigh on it.",
            "Its brakes seem to hold it, or its driver reports no efforts then: such moments do not count.",
        )


def saturated(recording: Recording, robot: Robot) -> Iterator[Remark]:
    """Joints at their effort limit."""
    shares = at_limit(recording.require_effort(), robot.limits.effort).mean(axis=0)
    for joint, share in zip(robot.joints, shares, strict=True):
        if share > SATURATED:
            yield Remark(
                joint,
                f"{recording.name}: {joint} is at its effort limit {100 * share:.0f} % of the time.",
                "Move it more gently: what is cut off cannot be identified.",
            )
