"""The recorded bags in test/data still read, and hold what their truth says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from bdnn_ros import bags
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import get
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals, prepare

DATA = Path(__file__).parent / "data"
BAGS = {"arm2_coulomb": (2000, 2), "arm7_worn_payload": (1200, 7)}


def opened(name: str) -> tuple[Signals, Robot, dict]:
    """Signals, robot and truth of a recorded bag."""
    recording = bags.read(DATA / name / "bag")
    return (
        prepare(recording),
        Robot.from_urdf(recording.urdf or ""),
        yaml.safe_load((DATA / name / "truth.yaml").read_text()),
    )


@pytest.mark.parametrize("name", BAGS)
def test_a_recorded_bag_reads(name):
    recording = bags.read(DATA / name / "bag")
    count, width = BAGS[name]
    assert len(recording) == count
    assert recording.rate == pytest.approx(100.0)
    assert recording.joints == tuple(f"{name[:4]}_joint{k + 1}" for k in range(width))
    assert Robot.from_urdf(recording.urdf or "").joints == recording.joints
    assert recording.velocity is not None
    assert recording.effort is not None
    truth = yaml.safe_load((DATA / name / "truth.yaml").read_text())
    assert (truth["format"], truth["version"]) == ("bdnn_ros/truth", 1)


def fitted(signals: Signals, robot: Robot, columns: np.ndarray) -> np.ndarray:
    """Least squares of measured less described effort on columns (N, n, k), each joint by its spread."""
    rigid = robot.rigid_effort(signals.position, signals.velocity, signals.acceleration)
    rows = signals.interior
    weight = 1.0 / np.std(rigid[rows], axis=0)
    left = (signals.smooth(signals.effort - rigid)[rows] * weight).ravel()
    matrix = (signals.smooth(columns)[rows] * weight[:, None]).reshape(len(left), -1)
    return np.linalg.lstsq(matrix, left, rcond=None)[0]


def test_the_arm_with_friction_shows_it():
    signals, robot, truth = opened("arm2_coulomb")
    motion = Motion(signals, robot, signals.effort)
    friction = get("coulomb_friction").columns(motion, 0, {})
    found = fitted(signals, robot, np.concatenate([friction, motion.load_rate[..., None]], axis=2))
    assert found[0] == pytest.approx(truth["effects"][0]["parameters"]["coulomb"], rel=0.05)
    assert found[1] == pytest.approx(0.005, abs=0.003)


def test_the_worn_arm_shows_its_payload_friction_and_rotors():
    signals, robot, truth = opened("arm7_worn_payload")
    motion = Motion(signals, robot, signals.effort)
    values = truth["effects"][0]["parameters"]
    _, shape = get("payload").coefficients(values)
    carried = get("payload").columns(motion, 6, shape, "arm7_hand")
    columns = [carried, motion.load_rate[..., None]]
    for joint in range(7):
        columns += [
            get(name).columns(motion, joint, {})
            for name in ("coulomb_friction", "viscous_friction", "armature")
        ]
    found = fitted(signals, robot, np.concatenate(columns, axis=2))
    assert found[0] == pytest.approx(values["mass"], rel=0.1)
    assert found[3] / found[0] == pytest.approx(values["com_z"], abs=0.02)
    for name, joint in zip(robot.joints, found[carried.shape[2] + 1 :].reshape(7, 3), strict=True):
        worn = truth["worn"][name]
        assert joint[0] == pytest.approx(worn["coulomb"], rel=0.25)
        assert joint[1] == pytest.approx(worn["viscous"], rel=0.25)
