"""`bdnn replay`: the error goes down, the model is kept, and changes are named."""

from __future__ import annotations

import json
import re
import time
from dataclasses import replace

import numpy as np
import pytest
from live_support import motion, real_robot

from bdnn_ros import bags
from bdnn_ros.cli import replay
from bdnn_ros.cli.main import main
from bdnn_ros.models import load_model
from bdnn_ros.online.learning import Error
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm2")
REAL = real_robot(ARM)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A bag whose robot grips a kilogram at ten seconds."""
    inertials = REAL.inertials.copy()
    inertials[-1, 0] += 1.0
    before = motion(REAL, 14.0, 100.0, noise=0.002)
    after = motion(REAL.with_inertials(inertials), 14.0, 100.0, noise=0.002)
    effort = np.where((before.time < 10.0)[:, None], before.effort, after.effort)
    return bags.write(replace(before, effort=effort, urdf=ARM.urdf), tmp_path_factory.mktemp("bag") / "bag")


def test_error_against_time(bag, tmp_path, capsys):
    assert main(["replay", str(bag), "--json", "--out", str(tmp_path / "model")]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["joints"] == list(ARM.joints) and told["samples"] == 1400
    assert len(told["time"]) == len(told["nmse"]) == len(told["version"]) >= 13
    error = dict(zip(np.round(told["time"]), told["nmse_mean"], strict=True))
    assert error[1.0] > 0.05 and error[9.0] < 0.01 and told["version"][0] == 0
    (change,) = told["changes"]
    assert change["effect"] == "payload" and change["parameters"]["mass"]["value"] == pytest.approx(
        1.0, rel=0.1
    )
    q = np.array([0.3, -0.4])
    assert np.isfinite(load_model(tmp_path / "model").inverse_dynamics(q, q, q)).all()


def test_the_model_goes_into_a_directory_with_dots_in_its_name(bag, tmp_path):
    assert main(["replay", str(bag), "--json", "--out", str(tmp_path / "rep.v1")]) == 0
    assert [path.name for path in (tmp_path / "rep.v1").iterdir()] == ["model.bdnn"]


def test_without_a_model_that_passes_the_data_cannot_answer(bag, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("bdnn_ros.cli.replay.replayed", lambda *_: iter(()))
    assert main(["replay", str(bag), "--out", str(tmp_path / "model")]) == 1
    assert "No model passed its checks" in capsys.readouterr().err


def test_table_and_pace(bag, capsys):
    began = time.monotonic()
    assert main(["replay", str(bag), "--rate", "8"]) == 0
    assert time.monotonic() - began > 14.0 / 8.0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["time", "s", "version", "nMSE", "%", "worst", "%"]
    assert len(lines) > 14 and "gripped" in lines[-2] and "1400 samples" in lines[-1]


def test_a_pause_of_years_is_no_work(bag, tmp_path, capsys):
    recording = bags.read(bag)
    later = replace(recording, time=np.where(recording.time < 7.0, recording.time, recording.time + 1e9))
    assert main(["replay", str(bags.write(later, tmp_path / "bag", overwrite=True)), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["samples"] == 1400 and len(told["time"]) >= 12


def test_a_robot_that_weighs_nothing_is_said_to(bag, tmp_path, capsys):
    bare = re.sub("<inertial>.*?</inertial>", "", ARM.urdf, flags=re.DOTALL)
    (tmp_path / "bare.urdf").write_text(bare, encoding="utf-8")
    assert main(["replay", str(bag), "--urdf", str(tmp_path / "bare.urdf")]) == 0
    assert "none of the moving links a mass" in capsys.readouterr().err


@pytest.mark.parametrize("rate", ["-1", "0", "nan", "inf"])
def test_a_bad_rate_is_refused(bag, capsys, rate):
    assert main(["replay", str(bag), "--rate", rate]) == 2
    assert f"--rate {rate} is not a speed above 0." in capsys.readouterr().err


def test_an_error_that_is_no_number_is_null(bag, monkeypatch, capsys):
    """JSON has neither NaN nor infinity."""
    squared = np.array([[np.nan, np.inf], [0.5, 0.25]])
    errors = [Error(float(k), row, np.ones(2), k) for k, row in enumerate(squared)]
    monkeypatch.setattr(replay, "replayed", lambda *given: iter(errors))
    assert main(["replay", str(bag), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["nmse"] == [[None, None], [0.5, 0.25]] and told["nmse_mean"] == [None, 0.375]


def test_a_joint_whose_effort_never_changes_has_no_error(bag, tmp_path, capsys):
    """As of a driver that fills in zero where there is no sensor."""
    recording = bags.read(bag)
    effort = np.where([True, False], recording.effort, 0.0)
    path = str(bags.write(replace(recording, effort=effort), tmp_path / "bag"))
    assert main(["replay", path, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert all(other is None for _, other in told["nmse"])
    assert told["nmse_mean"] == [one for one, _ in told["nmse"]] and max(told["nmse_mean"][1:]) < 1.0
    nothing = Error(1.0, np.ones(2), np.zeros(2), 0)
    assert np.isnan(nothing.nmse_mean) and replay._row(nothing).split() == ["1.0", "0", "-", "-"]
