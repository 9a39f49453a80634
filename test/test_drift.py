"""Friction that changes over minutes is named through the online code; nothing else is taken for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from live_support import motion, real_robot

from bdnn_ros.online.changed.drift import Drift
from bdnn_ros.online.changed.scene import Scene
from bdnn_ros.online.chunks import Chunks
from bdnn_ros.online.learning import Learning
from bdnn_ros.online.serving import nominal
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm2")
REAL = real_robot(ARM, seed=3)
RATE, ONSET, LENGTH = 100.0, 15.0, 60.0
"""Friction grows by its own size from the onset on, over this length [s]."""
IN_TIME = 40.0
"""It is told so long after the onset, as docs/on_your_robot.md says [s]."""


def stream(duration: float, viscous: float = 0.0, coulomb: float = 0.0, joint: int = 0) -> Recording:
    """A robot whose friction grows by these shares of its own over `LENGTH`."""
    recording = motion(REAL, duration, RATE, seed=7, noise=0.003)
    ramp = np.clip((recording.time - ONSET) / LENGTH, 0.0, 1.0)
    velocity = recording.velocity[:, joint]
    more = viscous * REAL.viscous[joint] * velocity + coulomb * REAL.coulomb[joint] * np.sign(velocity)
    effort = recording.effort.copy()
    effort[:, joint] += ramp * more
    return replace(recording, effort=effort)


def told(recording: Recording, until_named: bool = True) -> list[tuple[float, dict]]:
    """When what was named."""
    learning, found = Learning(ARM), []
    for start in range(0, len(recording), 100):
        rows = slice(start, start + 100)
        for _ in learning.take(recording.time[rows], recording.position[rows], recording.effort[rows]):
            pass
        found += [(recording.time[rows][-1], change.finding) for change in learning.changes]
        learning.changes.clear()
        if found and until_named:
            break
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("joint", "viscous", "coulomb"), [(1, 0.0, 1.0), (0, -0.6, -0.6)])
def test_wear_and_warming_up_are_named(joint, viscous, coulomb):
    found = told(stream(ONSET + IN_TIME + 5.0, viscous, coulomb, joint))
    assert found, "nothing was named"
    time, finding = found[0]
    assert (finding["effect"], finding["joint"]) == ("drift", ARM.joints[joint])
    assert ONSET < time < ONSET + IN_TIME
    assert "drifts" in finding["sentence"] and finding["rivals"] == []
    values = {name: entry["value"] for name, entry in finding["parameters"].items()}
    assert (values["end_value"] > values["start_value"]) == (coulomb > 0)
    assert ONSET - 10.0 < values["start"] < time


def test_minutes_are_compared_where_no_moment_tells():
    """The ramp by itself, as where each chunk's residual is too usual to be suspicious."""
    recording, scene = stream(80.0, coulomb=0.4, joint=1), Scene(ARM)
    drift, model, noise = Drift(scene), nominal(REAL), np.full(2, 0.05)
    chunks = Chunks(ARM.joints)
    for signals, rows in [*chunks.add(recording.time, recording.position, recording.effort), *chunks.end()]:
        certain = np.ones((len(rows), ARM.width))
        told = drift.look(signals, rows, scene.columns(signals, rows), model, noise, certain)
        if told is not None:
            break
    assert told is not None, "nothing was named"
    (found,), _ = told
    assert (found.kind, ARM.joints[found.target]) == ("friction", "arm2_joint2")
    assert ONSET < found.end < ONSET + LENGTH + 10.0


@pytest.mark.slow
def test_a_robot_that_stays_the_same_is_told_nothing_of():
    assert told(stream(80.0), until_named=False) == []


@pytest.mark.slow
def test_motion_that_changes_is_no_drift():
    """A slower, smaller program from some moment on: friction is met in another range."""
    first = motion(REAL, 40.0, RATE, seed=7, noise=0.003)
    slow = motion(REAL, 40.0, RATE, seed=8, noise=0.003)
    position = 0.4 * slow.position
    velocity, acceleration = 0.4 * slow.velocity, np.gradient(0.4 * slow.velocity, slow.time, axis=0)
    effort = REAL.inverse_dynamics(position, velocity, acceleration)
    noise = 0.003 * np.abs(first.effort).max(axis=0)
    effort = effort + noise * np.random.default_rng(0).normal(size=effort.shape)
    # half a second of rest between them would be a jump: a pause of the stream instead
    both = Recording(
        np.concatenate([first.time, slow.time + 42.0]),
        ARM.joints,
        np.concatenate([first.position, position]),
        None,
        np.concatenate([first.effort, effort]),
    )
    assert told(both, until_named=False) == []


@pytest.mark.slow
def test_a_payload_is_not_taken_for_drift_afterwards():
    mass = 0.8
    inertials = REAL.inertials.copy()
    inertials[-1] += [mass, 0.0, 0.0, 0.1 * mass, *np.array([0.01, 0.0, 0.01, 0.0, 0.0, 0.0]) * mass]
    recording = motion(REAL, 60.0, RATE, seed=7, noise=0.003)
    loaded = motion(REAL.with_inertials(inertials), 60.0, RATE, seed=7, noise=0.003)
    effort = np.where((recording.time < 20.0)[:, None], recording.effort, loaded.effort)
    found = told(replace(recording, effort=effort), until_named=False)
    assert [finding["effect"] for _, finding in found] == ["payload"]
