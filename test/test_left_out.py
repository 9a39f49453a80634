"""Joints that are not looked at, although the recording holds them, stand where they were; if they move, it is said."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from live_support import motion

from bdnn_ros import bags
from bdnn_ros.cli.main import main
from bdnn_ros.left_out import disturbing, standing
from bdnn_ros.models import save_model
from bdnn_ros.online.serving import nominal
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm6")
CHOSEN, WRIST = ARM.joints[:3], ARM.joints[3:]
HELD = dict(zip(WRIST, [0.6, -1.2, 0.3], strict=True))


@pytest.fixture(scope="module")
def recording() -> Recording:
    """Three joints move, the wrist stands somewhere."""
    moved = motion(ARM, 14.0, 250.0, seed=1)
    position = np.where(np.arange(6) < 3, moved.position, [0.0, 0.0, 0.0, *HELD.values()])
    velocity = np.gradient(position, moved.time, axis=0)
    effort = ARM.inverse_dynamics(position, velocity, np.gradient(velocity, moved.time, axis=0))
    noise = np.random.default_rng(0).standard_normal(effort.shape)
    return replace(moved, position=position, velocity=None, effort=effort + 0.02 * noise)


def test_they_stand_where_the_recording_has_them(recording):
    assert standing([recording], WRIST, ARM.urdf) == pytest.approx(HELD)
    assert standing([recording.select(CHOSEN)], WRIST, ARM.urdf) == {}


def test_only_those_count_that_others_feel(recording):
    robot = Robot.from_urdf(ARM.urdf, CHOSEN, HELD)
    assert disturbing(recording, ARM, robot) == []
    swinging = recording.position + np.where(np.arange(6) == 4, np.sin(5.0 * recording.time)[:, None], 0.0)
    assert disturbing(replace(recording, position=swinging), ARM, robot) == [ARM.joints[4]]
    turning = recording.position + np.where(np.arange(6) == 5, np.sin(recording.time)[:, None], 0.0)
    assert (
        disturbing(replace(recording, position=turning), ARM, robot) == []
    )  # the last link hardly weighs anything


SLIDES = """<robot name="slides"><link name="base"/>
<joint name="along" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="9" effort="100"/></joint><link name="cart">{body}</link>
<joint name="turn" type="revolute"><parent link="cart"/><child link="table"/><axis xyz="0 0 1"/>
<limit lower="1.5707963" upper="3" velocity="9" effort="100"/></joint><link name="table">{body}</link>
<joint name="out" type="prismatic"><parent link="table"/><child link="tip"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="9" effort="100"/></joint><link name="tip">{body}</link></robot>""".format(
    body='<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
"""A slide that a quarter turn makes square to another, and a joint between them that cannot turn back to zero."""


def test_what_no_message_holds_stands_at_zero_or_at_the_nearest_limit():
    whole = Robot.from_urdf(SLIDES)
    time = np.arange(0.0, 10.0, 0.005)
    position = 0.3 * np.column_stack([np.sin(3.0 * time), np.sin(5.0 * time)])
    effort = np.column_stack([-16.2 * np.sin(3.0 * time), -15.0 * np.sin(5.0 * time)])
    recording = Recording(time, ("along", "out"), position, None, effort)
    robot = Robot.from_urdf(SLIDES, ["along"], standing([recording], ["turn", "out"], SLIDES))
    assert disturbing(recording, whole, robot) == []
    turned = Robot.from_urdf(SLIDES.replace("1.5707963", "-1"), ["along"])
    assert disturbing(recording, Robot.from_urdf(turned.urdf), turned) == ["out"]


def test_what_a_model_knows_to_stand_somewhere_stands_there(recording, tmp_path, capsys):
    """The description is scored beside the model: both hold the wrist that the second bag lacks where the first had it."""
    model = save_model(tmp_path, nominal(Robot.from_urdf(ARM.urdf, CHOSEN, HELD)))
    few = replace(recording.select(CHOSEN), urdf=ARM.urdf)
    bags.write(few, tmp_path / "bag")
    assert main(["evaluate", str(model), str(tmp_path / "bag"), "--json"]) == 0
    told = capsys.readouterr()
    assert "held at zero" not in told.err
    scores = json.loads(told.out)
    assert scores["simulation"]["rmse"] == pytest.approx(scores["held_out"]["rmse"], rel=1e-6)


def test_nothing_is_named_for_where_they_stand(recording, tmp_path, capsys):
    bags.write(recording, tmp_path / "bag")
    asked = [str(tmp_path / "bag"), "--joints", ",".join(CHOSEN), "--out", str(tmp_path / "out")]
    assert main(["diagnose", *asked]) == 0
    assert "Nothing wrong was found" in capsys.readouterr().out


def test_a_diagnosis_is_refused_where_they_move(recording, tmp_path, capsys):
    swinging = recording.position + np.where(np.arange(6) == 4, np.sin(5.0 * recording.time)[:, None], 0.0)
    bags.write(replace(recording, position=swinging), tmp_path / "bag")
    asked = [str(tmp_path / "bag"), "--joints", ",".join(CHOSEN), "--out", str(tmp_path / "out")]
    assert main(["diagnose", *asked]) == 2
    told = capsys.readouterr().err
    assert f"{ARM.joints[4]} moves and is left out" in told and not (tmp_path / "out").exists()
    assert main(["identify", *asked]) == 0
    assert f"{ARM.joints[4]} moves and is left out" in capsys.readouterr().err


def test_several_that_move_are_told_as_several(recording, tmp_path, capsys):
    both = np.isin(np.arange(6), [3, 4]) * np.sin(5.0 * recording.time)[:, None]
    bags.write(replace(recording, position=recording.position + both), tmp_path / "bag")
    asked = [str(tmp_path / "bag"), "--joints", ",".join(CHOSEN), "--out", str(tmp_path / "out")]
    assert main(["diagnose", *asked]) == 2
    told = capsys.readouterr().err
    assert f"{ARM.joints[3]}, {ARM.joints[4]} move and are left out: what the others feel of them" in told
    assert "Take them in (--joints), or record the others while they stand still." in told
    assert main(["identify", *asked]) == 0
    assert "move and are left out; the model takes them to stand still." in capsys.readouterr().err
    model = str(tmp_path / "out")
    assert main(["evaluate", model, str(tmp_path / "bag"), "--joints", CHOSEN[0]]) == 0  # shows this one
    told = capsys.readouterr()
    assert CHOSEN[0] in told.out and CHOSEN[1] not in told.out
    assert f"{ARM.joints[3]}, {ARM.joints[4]} move and are left out" in told.err


@pytest.mark.slow
def test_efforts_that_joints_left_out_make_are_in_no_other_unit(tmp_path, capsys):
    """They were told to be many times what the simulation says: the wrist's, while the arm swings."""
    swung, few = motion(ARM, 14.0, 250.0, seed=1), ["--joints", f"{ARM.joints[0]},{ARM.joints[5]}"]
    true, small = str(tmp_path / "true"), str(tmp_path / "small")
    bags.write(swung, tmp_path / "true")
    bags.write(replace(swung, effort=0.01 * swung.effort), tmp_path / "small")
    for asked, said in (([true], False), ([true, *few], False), ([small], True)):
        assert main(["info", *asked]) == 0
        assert ("in another unit" in capsys.readouterr().out) == said
    assert main(["identify", true, *few, "--out", str(tmp_path / "out")]) == 0
    assert "in another unit" not in capsys.readouterr().err
