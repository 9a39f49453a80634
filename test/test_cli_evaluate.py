"""`bdnn evaluate` of some of the joints: those that were measured, those that are asked for, those that slide."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_cases import JOINT_STATE, bag_of, joint_state, states, write_bag
from cli_cases import sliding_arm

from bdnn_ros import bags
from bdnn_ros.cli.main import main
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.models import save_model
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.simulate import simulate

ARM2 = Robot.bundled("arm2")


@pytest.fixture(scope="module")
def recording() -> Recording:
    """A motion of the two-axis arm."""
    return simulate(ARM2, [], seed=2, duration=8.0, rate=200.0).recording


@pytest.fixture
def model(tmp_path: Path) -> str:
    """The description as a model."""
    return str(save_model(tmp_path / "model", ExtendedModel(ARM2, (), np.zeros(2))))


def without_second(recording: Recording, path: Path) -> str:
    """A bag in which the second joint's effort is NaN."""
    made = []
    for (topic, _, stamp, _), q, v, u in zip(
        states(recording),
        recording.position,
        recording.velocity,
        recording.require_effort(),
        strict=True,
    ):
        message = joint_state(recording.joints, q, v, [u[0], np.nan], stamp)
        made.append((topic, JOINT_STATE, stamp, message))
    return str(write_bag(path, made))


def test_what_was_not_measured_is_not_scored(
    recording: Recording, model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = without_second(recording, tmp_path / "bag")
    words = ["evaluate", model, bag, "--robot", "arm2"]
    assert main(words) == 0
    printed = capsys.readouterr()
    first, second, mean = (line.split() for line in printed.out.splitlines()[1:4])
    assert second == ["arm2_joint2", *5 * "-"]
    assert "-" in first[4] and first[1] != "-"
    assert " ".join(mean[:6]) == "mean of 1 of 2 joints" and mean[6] == first[2]
    assert "No motion is integrated: the effort of arm2_joint2 was not measured" in printed.err
    assert "nan" not in printed.out and "runs away" not in printed.err
    assert main([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["joints_in_mean"] == 1
    for scores in (told["held_out"], told["simulation"]):
        assert [scores[key][1] for key in ("rmse", "nrmse", "nmse")] == [None] * 3
        assert scores["nrmse_mean"] == scores["nrmse"][0]
    assert (told["rollout"]["windows"], told["rollout"]["position"]) == (0, [None, None])


def test_where_no_effort_is_measured_at_once_with_the_others_it_is_told(
    recording: Recording, model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One joint's sensor is at its limit while the other's is not, and at no time neither is."""
    effort, row, half = recording.require_effort(), np.arange(len(recording)), len(recording) // 2
    limited = np.stack([row < half + 100, row > half - 100], axis=1)
    effort = np.where(limited, effort.max(axis=0) + 1.0, effort)
    bag = str(bag_of(tmp_path / "bag", replace(recording, effort=effort)))
    assert main(["evaluate", model, bag]) == 0
    assert "No motion is integrated: at no time was the effort of every joint" in capsys.readouterr().err


def test_the_nmse_of_a_good_model_is_printed_as_what_it_is(
    recording: Recording, model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Three decimals made 0.000 of it."""
    words = ["evaluate", model, str(bag_of(tmp_path / "bag", recording))]
    assert main([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["held_out"]["nmse"]
    assert main(words) == 0
    head, *rows = [line.split() for line in capsys.readouterr().out.splitlines()[:3]]
    assert head[4] == "nMSE" and max(told) < 5e-4
    assert [float(row[3]) for row in rows] == pytest.approx(told, rel=0.01)


def test_identify_has_no_score_of_it_either(
    recording: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = without_second(recording, tmp_path / "bag")
    assert main(["identify", bag, "--robot", "arm2", "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "nan" not in printed and "mean of 1 of 2 joints" in printed
    assert json.loads((tmp_path / "out" / "metrics.json").read_text())["simulation"]["rmse"][1] is None


def test_where_all_is_measured_the_mean_is_of_all(
    recording: Recording, model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = str(bag_of(tmp_path / "bag", replace(recording, urdf=ARM2.urdf)))
    assert main(["evaluate", model, bag]) == 0
    printed = capsys.readouterr()
    assert "mean of" not in printed.out and printed.out.splitlines()[3].startswith("mean  ")
    assert "No motion" not in printed.err


def test_joints_pick_and_order_what_is_shown(
    recording: Recording, model: str, tmp_path: Path, capsys
) -> None:
    bag = str(bags.write(recording, tmp_path / "bag"))

    def told(*joints: str) -> dict[str, Any]:
        assert (
            main(["evaluate", model, bag, "--json", *(["--joints", ",".join(joints)] if joints else [])]) == 0
        )
        return json.loads(capsys.readouterr().out)

    whole, turned, second = told(), told("arm2_joint2", "arm2_joint1"), told("arm2_joint2")
    assert turned["held_out"]["joints"] == ["arm2_joint2", "arm2_joint1"]
    assert turned["held_out"]["rmse"] == whole["held_out"]["rmse"][::-1]
    assert turned["rollout"]["position"] == whole["rollout"]["position"][::-1]
    assert second["held_out"]["rmse"] == whole["held_out"]["rmse"][1:] and second["joints_in_mean"] == 1
    assert main(["predict", model, bag, "--joints", "arm2_joint2"]) == 0
    assert capsys.readouterr().out.startswith("time,arm2_joint2.effort,arm2_joint2.measured\n")


def test_the_model_knows_which_joints_slide(tmp_path: Path, capsys) -> None:
    """A bag without a description is read by the model alone."""
    robot = sliding_arm()
    made = simulate(robot, [], seed=2, duration=8.0, rate=200.0).recording
    bag = str(bags.write(replace(made, urdf=None), tmp_path / "bag"))
    saved = save_model(tmp_path / "model", ExtendedModel(robot, (), np.zeros(robot.width)))
    assert main(["evaluate", str(saved), bag]) == 0
    printed = capsys.readouterr().out
    assert "[N, m]" in printed


def picking(seconds: float) -> Recording:
    """A worn arm from pose to pose, each move of 1 s followed by so much rest, in which it sticks with any friction."""
    rate, generator = 200.0, np.random.default_rng(5)
    poses = generator.uniform(-1.2, 1.2, (12, 2))
    s = np.arange(0.0, 1.0 + seconds, 1.0 / rate).clip(max=1.0)[:, None]
    part = 10 * s**3 - 15 * s**4 + 6 * s**5, 30 * s**2 * (1 - s) ** 2, 60 * s * (1 - s) * (1 - 2 * s)
    q, v, a = (
        np.concatenate(
            [
                way * shape + from_ * (k == 0)
                for from_, way in zip(poses[:-1], np.diff(poses, axis=0), strict=True)
            ]
        )
        for k, shape in enumerate(part)
    )
    rests = (v == 0.0).all(axis=1)
    stuck = np.repeat(generator.uniform(-1.0, 1.0, (len(poses) - 1, 2)), len(s), axis=0)
    effort = WORN.inverse_dynamics(q, v, a) + np.where(rests[:, None], WORN.coulomb * stuck, 0.0)
    effort, seen = (
        clean + std * generator.normal(size=q.shape) for clean, std in ((effort, 0.02), (q, 1e-5))
    )
    return Recording(np.arange(len(q)) / rate, ARM2.joints, seen, None, effort, urdf=WORN.urdf)


WORN = ARM2.with_joint_parameters(np.full(2, 0.1), np.full(2, 1.0), np.full(2, 6.0))


@pytest.mark.parametrize(("seconds", "said"), [(1.0, True), (0.0, False)])
def test_rows_at_rest_that_make_the_error_are_told(tmp_path, capsys, seconds: float, said: bool) -> None:
    bag = str(bags.write(picking(seconds), tmp_path / "bag"))
    words = ["evaluate", str(save_model(tmp_path / "model", ExtendedModel(WORN, (), np.zeros(2)))), bag]
    assert main([*words, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert ("in_motion" in report["held_out"]) == ("in_motion" in report["simulation"]) == said
    assert main(words) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    if not said:
        assert "at rest" not in last
        return
    moved = report["held_out"]["in_motion"]
    assert report["held_out"]["nrmse_mean"] > 0.1 > 0.02 > moved["nrmse_mean"]
    assert moved["share"] == pytest.approx([0.5, 0.5], abs=0.15) and len(moved["rmse"]) == 2
    share = 100.0 * (1.0 - np.mean(moved["share"]))
    assert last == (
        f"{share:.0f} % of the scored rows are at rest, where dry friction may have any value; "
        f"NRMSE in motion: mean {moved['nrmse_mean']:.3f}."
    )


def test_identify_tells_of_rows_at_rest_as_well(tmp_path, capsys) -> None:
    out, bag = tmp_path / "out", str(bags.write(picking(1.0), tmp_path / "bag"))
    assert main(["identify", bag, "--out", str(out)]) == 0
    assert "of the scored rows are at rest" in capsys.readouterr().out
    held_out = json.loads((out / "metrics.json").read_text())["held_out"]
    assert held_out["in_motion"]["nrmse_mean"] < 0.05 < held_out["nrmse_mean"]
