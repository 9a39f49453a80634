"""Trajectories from CSV: exact where they come from a smooth motion, refused where they make no sense."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from bdnn_ros.cli.excite import csv_lines
from bdnn_ros.cli.main import main
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.errors import UsageError
from bdnn_ros.extension.effects_file import effects_text
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import Trajectory
from bdnn_ros.simulation.trajectory_file import HOLD, read_trajectory

ROBOT = Robot.bundled("arm2")


def smooth(duration: float = 3.0, rate: float = 50.0) -> Trajectory:
    """1 - cos: from rest to rest over whole periods."""
    time = np.arange(round(duration * rate) + 1) / rate
    w = 2.0 * np.pi / duration * np.array([1.0, 2.0])
    angle = time[:, None] * w
    return Trajectory(time, 0.3 * (1.0 - np.cos(angle)), 0.3 * w * np.sin(angle), 0.3 * w**2 * np.cos(angle))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "trajectory.csv"
    path.write_text("".join(csv_lines(smooth(), ROBOT.joints)))
    return path


def test_sampled_anew_it_is_the_same_motion(file: Path) -> None:
    found = read_trajectory(file, ROBOT, 500.0)
    np.testing.assert_allclose(np.diff(found.time), 0.002, atol=1e-12)
    at = found.time - HOLD
    inside = (at > 0.01) & (at < 2.99)
    w = 2.0 * np.pi / 3.0 * np.array([1.0, 2.0])
    angle = at[inside, None] * w
    np.testing.assert_allclose(found.position[inside], 0.3 * (1.0 - np.cos(angle)), atol=1e-8)
    np.testing.assert_allclose(found.acceleration[inside], 0.3 * w**2 * np.cos(angle), atol=1e-4)
    assert not found.velocity[0].any() and not found.velocity[-1].any()


@pytest.mark.parametrize("ends", ["", "\n", "\r\n \r\n", ",,,,,,\n"])
def test_what_spreadsheets_add_changes_nothing(file: Path, ends: str) -> None:
    """A byte order mark and an empty line were said to make it a table that lacks time, or one that cannot be read."""
    before = read_trajectory(file, ROBOT, 500.0)
    file.write_text("\ufeff" + file.read_text() + ends)
    after = read_trajectory(file, ROBOT, 500.0)
    np.testing.assert_array_equal(after.time, before.time)
    np.testing.assert_array_equal(after.position, before.position)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("arm2_joint2.velocity", "elbow.velocity", "lacks arm2_joint2.velocity"),
        ("\n0.02,", "\n0.9,", "increase"),
        ("\n0.04,", "\nnan,", "not a number"),
        ("\n0.06,", "\nlater,", "cannot be read"),
        ("\n0.08,", "\n0.08,1,", "cannot be read"),
    ],
)
def test_bad_tables_are_refused(file: Path, old: str, new: str, says: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(UsageError, match=says):
        read_trajectory(file, ROBOT, 500.0)


def test_a_missing_or_empty_table_is_refused(tmp_path: Path) -> None:
    for content in (None, "", "time\n"):
        path = tmp_path / "x.csv"
        if content is not None:
            path.write_text(content)
        with pytest.raises(UsageError):
            read_trajectory(path, ROBOT, 500.0)


@pytest.mark.parametrize("rate", [np.nan, np.inf, -5.0, 0.0])
def test_a_rate_that_is_none_is_refused(file: Path, rate: float) -> None:
    with pytest.raises(UsageError, match="cannot be simulated"):
        read_trajectory(file, ROBOT, rate)


def test_a_table_that_lasts_for_ages_is_refused(file: Path) -> None:
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join(lines[:-1]) + "1e12" + lines[-1][lines[-1].index(",") :])
    with pytest.raises(UsageError, match="cannot be simulated"):
        read_trajectory(file, ROBOT, 500.0)


def test_an_endless_field_is_refused(file: Path) -> None:
    file.write_text(file.read_text() + "1" * 140_000 + "\n")
    with pytest.raises(UsageError, match="cannot be read"):
        read_trajectory(file, ROBOT, 500.0)


def test_simulate_follows_a_trajectory_with_the_effects_of_a_file(file: Path, tmp_path: Path) -> None:
    effects = [parse_spec("coulomb_friction@arm2_joint1:coulomb=0.5", ROBOT)]
    (tmp_path / "effects.yaml").write_text(effects_text(effects, ROBOT))
    words = ["simulate", "--robot", "arm2", "--rate", "200", "--out", str(tmp_path / "out")]
    words += ["--effects", str(tmp_path / "effects.yaml"), "--trajectory", str(file)]
    assert main(words) == 0
    truth = yaml.safe_load((tmp_path / "out" / "truth.yaml").read_text())
    assert [one["effect"] for one in truth["effects"]] == ["coulomb_friction"]
    assert truth["excitation"] == "given"
    assert truth["duration"] == pytest.approx(3.0 + HOLD, abs=0.01)
    from bdnn_ros import bags

    recording = bags.read(tmp_path / "out" / "bag")
    assert np.ptp(recording.position[:, 0]) == pytest.approx(0.6, abs=0.02)
    assert main([*words, "--overwrite", "--poor"]) == 2
