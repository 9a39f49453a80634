"""Readings that stand out alone more often than seldom: mended where nothing else comes near, else told; no verdict is sure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_glitches import swing

from bdnn_ros import bags
from bdnn_ros.cli.main import main
from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals.glitches import jumping, without_glitches
from bdnn_ros.simulation.simulate import simulate


def wrong(recording: Recording, share: float, size: float, seed: int = 0, field: str = "effort") -> Recording:
    """A share of one joint's readings is replaced, at random, by this value or its negative."""
    rng = np.random.default_rng(seed)
    values = getattr(recording, field).copy()
    rows = rng.choice(len(values), int(share * len(values)), replace=False)
    values[rows, 0] = size * rng.choice([-1.0, 1.0], len(rows))
    return replace(recording, **{field: values})


@pytest.mark.parametrize("share", [0.005, 0.02, 0.05, 0.1])
@pytest.mark.parametrize("size", [20.0, 1000.0])
def test_what_stands_out_is_mended_up_to_one_in_ten(share, size):
    recording = swing()
    mended = without_glitches(wrong(recording, share, size))
    left = np.abs(mended.effort - recording.effort)
    assert np.mean(left[:, 0] > 0.5 * size) < 0.001 and not left[:, 1].any()
    (note,) = mended.notes
    assert "readings of a stood out alone (effort)" in note


@pytest.mark.parametrize("share, size", [(0.3, 1000.0), (0.04, 2.5)])
def test_what_jumps_more_often_or_no_further_than_the_effort_goes_is_told(share, size):
    mended = without_glitches(wrong(swing(), share, size))
    note = mended.notes[-1]
    assert "% of the efforts of a jump to and fro" in note
    assert without_glitches(mended).notes.count(note) == 1


@pytest.mark.parametrize("noise", [0.01, 0.3, 3.0, 30.0])
def test_noise_jumps_nowhere(noise):
    recording = swing(noise)
    assert without_glitches(recording) is recording
    coarse = replace(recording, effort=np.round(recording.effort), position=np.round(recording.position, 1))
    assert jumping(coarse) == []


def test_info_and_identify_tell_how_many_jump(tmp_path, capsys):
    robot = Robot.bundled("arm2")
    recording = simulate(robot, seed=3, duration=10.0, rate=200.0).recording
    bag = str(bags.write(wrong(recording, 0.2, 500.0), tmp_path / "bag"))
    for verb in (["info"], ["identify", "--out", str(tmp_path / "model")]):
        main([verb[0], bag, *verb[1:]])
        assert "of the efforts of arm2_joint1 jump to and fro for a sample or two" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.02, 0.2])
def test_a_diagnosis_is_right_or_says_that_nothing_is_sure(share, tmp_path):
    robot = Robot.bundled("arm2")
    recording = simulate(robot, seed=3, duration=20.0, rate=200.0).recording
    found = diagnose([wrong(recording, share, 1000.0)], robot)
    if share < 0.1:
        assert (found.verdict, found.findings) == ("nothing_wrong", ())
    else:
        assert found.verdict in ("partly_explained", "cannot_tell")
        assert any("jump to and fro" in note for note in found.notes)


def test_noise_of_a_joint_that_moves_is_no_jump():
    """It is quiet while it rests, most of the time, and its effort hardly changes but for its noise."""
    rng, time = np.random.default_rng(0), np.arange(0.0, 60.0, 0.01)
    moves = (time % 10.0) < 4.0
    position = np.where(moves, 0.5 * np.sin(0.5 * np.pi * (time % 10.0)), 0.0)[:, None]
    noise = np.where(moves, 0.1, 0.01) * rng.standard_normal(len(time))
    recording = Recording(time, ("a",), position, None, (0.2 * np.sin(time) + noise)[:, None])
    assert jumping(recording) == []
