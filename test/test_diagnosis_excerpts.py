"""Long recordings are looked at in pieces, and the user is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.diagnosis.recorded.excerpts import MOST_SECONDS, PIECE, excerpts
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.simulate import simulate

RATE = 50.0


def still(seconds: float, pause: float = 0.0) -> Recording:
    """A joint at rest, with a pause in the middle."""
    time = np.arange(round(seconds * RATE)) / RATE
    time[len(time) // 2 :] += pause
    return Recording(time, ("joint",), np.zeros((len(time), 1)), name="bag")


def test_a_recording_that_is_not_long_is_taken_whole():
    recordings = [still(0.5 * MOST_SECONDS), still(0.4 * MOST_SECONDS, pause=3600.0)]
    assert excerpts(recordings) == recordings


@pytest.mark.parametrize("pause", [0.0, 100.0])
def test_of_a_long_one_there_are_pieces_all_over_it_with_their_own_stamps(pause):
    whole = still(600.0, pause)
    (kept,) = excerpts([whole])
    assert kept.recorded == pytest.approx(MOST_SECONDS, abs=PIECE)
    assert np.isin(kept.time, whole.time).all()
    lengths = [float(np.ptp(kept.time[rows])) for rows in kept.segments()]
    assert max(lengths) == pytest.approx(PIECE, abs=2.0 / RATE)
    assert kept.time[0] == 0.0 and kept.time[-1] > 0.9 * whole.time[-1]
    (note,) = kept.notes
    assert note.startswith(f"bag: of 600 s of motion {kept.recorded:.0f} s are examined")


def test_several_are_shortened_alike():
    kept = excerpts([still(600.0), still(200.0)])
    assert sum(one.recorded for one in kept) == pytest.approx(MOST_SECONDS, abs=2 * PIECE)
    assert kept[0].recorded > 2.0 * kept[1].recorded


def test_of_many_short_ones_some_are_left_out_and_named():
    recordings = [replace(still(12.0), name=f"bag{k}") for k in range(60)]
    kept = excerpts(recordings)
    assert 0.6 * MOST_SECONDS < sum(one.recorded for one in kept) < 1.1 * MOST_SECONDS
    assert all(one.recorded > 4.0 for one in kept) and kept[-1].name > "bag50"
    said = kept[0].notes[-1]
    assert "Of 719 s of motion" in said and f"({60 - len(kept)} in all)" in said


@pytest.mark.slow
def test_what_drifts_all_the_while_is_named_as_it_was(monkeypatch):
    monkeypatch.setattr("bdnn_ros.diagnosis.recorded.excerpts.MOST_SECONDS", 40.0)
    monkeypatch.setattr("bdnn_ros.diagnosis.recorded.excerpts.PIECE", 5.0)
    robot = Robot.bundled("arm2")
    drift = parse_spec("drift@arm2_joint1:start_value=0.5,end_value=1.5", robot)
    recording = simulate(robot, [drift.within(160.0)], seed=4, duration=160.0, rate=50.0).recording
    told = diagnose([recording], robot)
    (finding,) = told.findings
    assert (finding.effect, finding.joint, finding.variant) == ("drift", "arm2_joint1", "coulomb")
    assert finding.parameters["start_value"].value == pytest.approx(0.5, rel=0.1)
    assert finding.parameters["end_value"].value == pytest.approx(1.5, rel=0.1)
    assert any("are examined" in note for note in told.notes)
    source = told.source  # of what was looked at: the note tells how long the whole is
    assert source["duration"] == pytest.approx(source["samples"] / source["rate"], rel=0.02)
    assert source["duration"] == pytest.approx(40.0, abs=5.0)
