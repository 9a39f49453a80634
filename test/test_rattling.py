"""A drive that rattles is seen, and nothing else is taken for it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bdnn_ros import bags
from bdnn_ros.checks.rattled import rattled
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare
from bdnn_ros.signals.rattling import rattling
from bdnn_ros.simulation.simulate import simulate

JOINT = 1
TX40 = Path(__file__).resolve().parents[2] / "shared" / "data" / "tx40_figaroh" / "tx40.mcap"


@pytest.fixture(scope="module")
def calm() -> Recording:
    return simulate(Robot.bundled("arm6"), duration=20.0, rate=250.0, seed=3).recording


def added(recording: Recording, effort: np.ndarray) -> Recording:
    """The recording with more effort at one joint, (N,) per spread of it."""
    more = recording.effort.copy()
    more[:, JOINT] += effort * more[:, JOINT].std()
    return replace(recording, effort=more)


def going_to_and_fro(
    recording: Recording, size: float, frequency: float, start: float, end: float
) -> Recording:
    """With a rectangular oscillation of that size between two times."""
    inside = (recording.time >= start) & (recording.time < end)
    return added(recording, inside * size * np.sign(np.sin(2.0 * np.pi * frequency * recording.time + 0.1)))


@pytest.mark.parametrize(("size", "frequency"), [(0.5, 25.0), (1.0, 40.0), (5.0, 125.0)])
def test_a_stretch_in_which_a_drive_rattles_is_seen_and_counts_for_no_joint(calm, size, frequency):
    shaken = going_to_and_fro(calm, size, frequency, 8.0, 9.5)
    seen = rattling(shaken)
    inside = (calm.time > 8.2) & (calm.time < 9.3)
    outside = (calm.time < 7.8) | (calm.time > 9.7)
    assert seen[inside, JOINT].all() and not seen[outside].any()
    assert not np.delete(seen, JOINT, axis=1).any()
    signals = prepare(shaken)
    within = (signals.time > 8.2) & (signals.time < 9.3)
    assert signals.unmeasured[within].all() and not signals.unmeasured[signals.time < 7.8].any()
    (remark,) = rattled(shaken)
    assert remark.about == calm.joints[JOINT] and "rattles for 1.5 s, first at 8.0" in remark.problem


def test_what_is_no_rattling(calm):
    time, rng = calm.time, np.random.default_rng(0)
    blocks = np.zeros(len(time))
    for start in rng.uniform(1.0, 19.0, 25):  # a gantry's accelerations, or somebody who knocks
        blocks[(time > start) & (time < start + 0.12)] = rng.choice([-2.0, 2.0])
    assert not rattling(added(calm, blocks)).any()
    assert not rattling(added(calm, rng.standard_normal(len(time)))).any()  # a sensor's noise
    fast = np.abs(calm.velocity[:, JOINT]) > np.median(np.abs(calm.velocity[:, JOINT]))
    assert not rattling(
        added(calm, fast * rng.standard_normal(len(time)))
    ).any()  # that of a drive that moves
    assert not rattling(going_to_and_fro(calm, 0.5, 3.0, 8.0, 12.0)).any()  # a quick motion
    step = 2.0 * calm.effort.std(axis=0)
    assert not rattling(replace(calm, effort=step * np.round(calm.effort / step))).any()  # a coarse sensor


def test_what_happens_most_of_the_time_is_usual(calm):
    assert not rattling(going_to_and_fro(calm, 1.0, 40.0, 1.0, 19.0)).any()
    assert not list(rattled(calm))


@pytest.mark.parametrize("rest", [0.0, 20.0, 60.0])
def test_what_a_joint_does_whenever_it_moves_is_usual_however_long_it_rests(calm, rest):
    """Of a gantry that stands still most of the time every brisk motion was left out."""
    shaken = going_to_and_fro(calm, 0.4, 25.0, 1.0, 19.0)
    still = round(rest * 250.0)
    rng = np.random.default_rng(0)
    position = np.concatenate([calm.position, np.repeat(calm.position[-1:], still, axis=0)])
    effort = np.concatenate([shaken.effort, np.repeat(shaken.effort[-1:], still, axis=0)])
    effort += 1e-3 * effort.std(axis=0) * rng.standard_normal(effort.shape)
    paused = Recording(np.arange(len(position)) / 250.0, calm.joints, position, effort=effort)
    assert not rattling(paused).any()
    assert rattling(going_to_and_fro(paused, 3.0, 25.0, 8.0, 9.5)).any()


@pytest.mark.skipif(not TX40.is_file(), reason="the real recordings are not here")
@pytest.mark.parametrize("held_out", [0.0, 0.2, 0.4, 0.6])
def test_a_real_arm_that_moves_briskly_and_then_rests_does_not_rattle(held_out):
    recording = bags.read(TX40)
    assert not rattling(recording.split(held_out)[1] if held_out else recording).any()
