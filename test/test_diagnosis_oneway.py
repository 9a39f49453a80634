"""Joints that move one way only: friction, an offset and what changes with time do the same there, and that is said."""

from __future__ import annotations

import numpy as np
import pytest

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.diagnosis.sentences import Kind
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm6")
JOINT = 2


def passed(extra, duration: float = 15.0) -> Recording:
    """One pass of every joint at a speed that hardly changes, with something more at one joint: of time [s] and position."""
    time = np.arange(0.0, duration, 0.005)
    rate, swing = 2.0 * np.pi * 0.21, 0.25
    way = (
        np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
        * np.array([0.9, 0.3, 0.6, 0.8, 0.7, 0.9])
        * 2.0
        / duration
    )
    along = time - swing / rate * np.cos(rate * time)
    position = along[:, None] * way - 0.5 * duration * way + np.array([0.0, -1.2, 1.0, 0.0, 0.5, 0.0])
    velocity = (1.0 + swing * np.sin(rate * time))[:, None] * way
    acceleration = (swing * rate * np.cos(rate * time))[:, None] * way
    effort = ARM.inverse_dynamics(position, velocity, acceleration)
    noise = np.random.default_rng(3)
    effort[:, JOINT] += extra(time / duration, position[:, JOINT])
    effort += 0.05 * noise.standard_normal(effort.shape)
    position = position + 2e-5 * noise.standard_normal(position.shape)
    return Recording(time, ARM.joints, position, None, effort)


@pytest.mark.parametrize("size", [-8.0, 8.0])
def test_friction_and_an_offset_are_a_tie(size):
    diagnosis = diagnose([passed(lambda share, position: np.full_like(share, size))], ARM)
    (found,) = diagnosis.findings
    causes = {found.effect: found.probability, **{one.effect: one.probability for one in found.rivals}}
    assert found.joint == ARM.joints[JOINT]
    assert causes["effort_offset"] > 0.2
    # dry friction of a joint that goes this way is never less than nothing
    assert (causes.get("coulomb_friction", 0.0) > 0.2) == (size > 0.0)
    assert bool(diagnosis.advice) == (size > 0.0)


@pytest.mark.parametrize(("duration", "told"), [(11.0, True), (15.0, False)])
def test_what_goes_along_with_time_may_be_a_drift_where_none_is_looked_for(duration, told):
    diagnosis = diagnose([passed(lambda share, position: 3.0 * position, duration)], ARM)
    assert [found.effect for found in diagnosis.findings] == ["joint_spring"]
    assert diagnosis.verdict == ("partly_explained" if told else "explained")
    assert (Kind.WITH_TIME in diagnosis.kinds) == told
