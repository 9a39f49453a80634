"""Joints that mimic another: held still unless they are named, which is said."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from bag_cases import JOINT_STATE, STRING, joint_state, text, write_bag

from bdnn_ros import bags
from bdnn_ros.checks.conventions import breaches
from bdnn_ros.cli.main import main
from bdnn_ros.excitation import choice
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.mjcf import extended_mjcf
from bdnn_ros.models import load_model
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mimics import held_mimics, with_mimics
from bdnn_ros.signals import prepare

ARM = Robot.bundled("arm2")
FOLLOWS = "right mimics left"


def with_fingers(tag: str = '<mimic joint="left"/>') -> str:
    """The two-axis arm with two fingers that slide, of which the second follows the first."""

    def finger(name: str, way: int, mimic: str) -> str:
        return f"""<link name="{name}_tip"><inertial><origin xyz="0 0 0.02"/><mass value="0.1"/>
            <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
            <joint name="{name}" type="prismatic"><parent link="arm2_tool"/><child link="{name}_tip"/>
            <axis xyz="{way} 0 0"/><limit lower="0.01" upper="0.04" effort="20" velocity="0.2"/>{mimic}</joint>"""

    fingers = finger("left", 1, "") + finger("right", -1, tag)
    return ARM.urdf.replace("</robot>", f"{fingers}</robot>")


FREE = (*ARM.joints, "left")
ALL = (*FREE, "right")


@pytest.fixture
def urdf(tmp_path: Path) -> str:
    """A file of it."""
    file = tmp_path / "hand.urdf"
    file.write_text(with_fingers())
    return str(file)


def test_they_are_joints_of_the_robot_only_where_they_are_named() -> None:
    robot, named = Robot.from_urdf(with_fingers()), Robot.from_urdf(with_fingers(), ALL)
    assert robot.joints == FREE and Robot.from_urdf(with_fingers("")).joints == ALL
    assert (held_mimics(robot), held_mimics(named)) == ({"right": "left"}, {})
    assert with_mimics(robot) == with_mimics(named) == ALL
    pose = np.array([0.3, -0.4, 0.02])
    held = named.mass_matrix(np.append(pose, 0.01))[:3, :3]  # at the limit that is nearest to zero
    np.testing.assert_allclose(robot.mass_matrix(pose), held, atol=1e-12)


@pytest.mark.parametrize("led", [True, False])
def test_fingers_that_balance_are_in_no_other_unit(led: bool) -> None:
    named, time = Robot.from_urdf(with_fingers(), ALL), np.arange(0.0, 20.0, 0.01)
    rates = np.array([1.3, 2.1, 3.7])
    waves = np.stack([np.sin(rates * time[:, None]), rates * np.cos(rates * time[:, None])])
    acceleration = -(rates**2) * waves[0]
    size = np.array([0.8, 0.9, 0.003])
    moving = [part * size for part in (*waves, acceleration)]
    moving[0][:, 2] += 0.005
    every = [np.concatenate([part, part[:, 2:]], axis=1) for part in moving]
    effort = named.inverse_dynamics(*every) + 0.005 * np.random.default_rng(1).standard_normal((len(time), 4))
    effort[:, 2] += 0.3 * moving[2][:, 2] + 0.02 * np.sign(moving[1][:, 2]) + effort[:, 3]
    recording = Recording(time, FREE, moving[0], velocity=None, effort=effort[:, :3])
    robot = Robot.from_urdf(with_fingers() if led else with_fingers(""), FREE)
    said = [remark.problem for remark in breaches(prepare(recording), robot)]
    assert any("effort of left holds only" in one for one in said) != led


def test_a_robot_of_nothing_else_keeps_them() -> None:
    assert Robot.from_urdf(with_fingers(), ["right"]).joints == ("right",)
    circle = with_fingers().replace(
        'velocity="0.2"/></joint>', 'velocity="0.2"/><mimic joint="right"/></joint>'
    )
    assert Robot.from_urdf(circle).joints == ARM.joints


@pytest.mark.slow
def test_a_motion_leaves_them_alone_and_says_so(urdf: str, tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(choice, "DRAWS", 20)
    monkeypatch.setattr(choice, "CHANGES", 5)
    assert main(["excite", "--urdf", urdf, "--duration", "5", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().err
    assert f"{FOLLOWS}: held still" in said
    arm = ",".join(ARM.joints)
    assert "left will be left out of a bag of this motion" in said and f"--joints {arm} leaves" in said
    assert "right" not in (tmp_path / "trajectory.csv").read_text().splitlines()[0]
    assert "right" not in (tmp_path / "trajectory.yaml").read_text()
    motion_ = ["--trajectory", str(tmp_path / "trajectory.csv")]
    assert main(["simulate", "--urdf", urdf, "--rate", "100", *motion_, "--out", str(tmp_path)]) == 0
    assert f"{FOLLOWS}: held still" in capsys.readouterr().err
    assert bags.read(tmp_path / "bag").joints == FREE
    words = ["excite", "--urdf", urdf, "--joints", arm, "--duration", "5", "--out", str(tmp_path / "arm")]
    assert main(words) == 0
    said = capsys.readouterr().err
    assert f"{FOLLOWS}: held still" in said and "left out" not in said
    assert "left" not in (tmp_path / "arm" / "trajectory.yaml").read_text()


def test_a_mujoco_model_has_none_of_them() -> None:
    root = ElementTree.fromstring(
        extended_mjcf(ExtendedModel(Robot.from_urdf(with_fingers()), (), np.zeros(3)))
    )
    assert [joint.get("name") for joint in root.iter("joint") if joint.get("type")] == list(FREE)


def recorded(bag: Path, moves: float = 0.0) -> str:
    """A bag of all four joints, whose follower moves or not; most drivers give none of its effort."""
    time = np.round(np.arange(1500) / 100.0, 9)
    q = np.sin(time[:, None] * [1.0, 1.7, 2.3, 2.9])
    position = q * [1.0, 1.0, 0.01, moves] + [0.0, 0.0, 0.025, 0.03]
    effort = np.where(np.arange(4) == 3, np.nan, 3.0 * q)
    rows = enumerate(zip(position, effort, strict=True))
    stamps = [(round(k * 1e7), *row) for k, row in rows]
    described = ("/robot_description", STRING, 0, text(with_fingers()))
    messages = [
        ("/joint_states", JOINT_STATE, stamp, joint_state(ALL, *row, effort=u, stamp=stamp))
        for stamp, *row, u in stamps
    ]
    return str(write_bag(bag, [described, *messages]))


def test_a_recording_is_of_the_others_unless_they_are_named(urdf: str, tmp_path: Path, capsys) -> None:
    bag = recorded(tmp_path / "bag")
    for given in ([], ["--urdf", urdf]):
        assert main(["info", bag, *given]) == 0
        captured = capsys.readouterr()
        assert "samples of 3 joints" in captured.out and "joint right" not in captured.out
        assert f"{FOLLOWS}: held still, unless --joints names it." in captured.err
    assert main(["info", bag, "--joints", "left,right"]) == 0
    captured = capsys.readouterr()
    assert "samples of 2 joints" in captured.out and "mimics" not in captured.err


@pytest.mark.slow
def test_they_stand_where_the_recording_has_them_and_are_told_to_move(tmp_path: Path, capsys) -> None:
    model = tmp_path / "model"
    for moves, told in ((0.0, False), (1.0, True)):
        bag = recorded(tmp_path / f"bag{moves:g}", moves)
        assert main(["identify", bag, "--out", str(model), "--budget", "1"]) == 0
        assert ("left is left out: it moves right as well" in capsys.readouterr().err) is told
        robot = load_model(model).robot
        assert robot.joints == (ARM.joints if told else FREE)
        stand = {"right": 0.03, **({"left": 0.025} if told else {})}
        assert dict(robot.held) == pytest.approx(stand, abs=0.025)


def test_a_gripper_that_moves_is_one_drive(tmp_path: Path, capsys) -> None:
    """The arm feels both fingers, which go apart and together, and nothing is named for it."""
    robot = Robot.from_urdf(with_fingers(), ALL)
    time = np.arange(9000) / 300.0
    arm = np.sin(time[:, None] * [1.3, 2.1]) + 0.5 * np.sin(time[:, None] * [3.1, 0.7])
    finger = 0.025 + 0.01 * np.sin(2.9 * time)
    position = np.column_stack([arm, finger, finger])
    velocity = np.gradient(position, time, axis=0)
    effort = robot.inverse_dynamics(position, velocity, np.gradient(velocity, time, axis=0))
    noise = np.random.default_rng(0).standard_normal(effort.shape)
    effort[:, 2] += effort[:, 3]
    effort += 0.005 * effort.std(axis=0) * noise
    recording = Recording(time, ALL, position, None, effort, urdf=with_fingers()).select(FREE)
    bags.write(recording, tmp_path / "bag")
    assert main(["diagnose", str(tmp_path / "bag"), "--out", str(tmp_path / "out")]) == 0
    captured = capsys.readouterr()
    assert "left is left out: it moves right as well" in captured.err
    assert "Nothing wrong was found" in captured.out and "no message" not in captured.out
