"""Blind: an effect is drawn from a seed, its bag holds no truth, and the findings are compared afterwards.

Seeds count from 0, and none is left out for what came of it. The last test is not blind: its draws are some that a search missed.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest
from diagnosis_cases import check_contract

from bdnn_ros import bags
from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.scenario import Scenario

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from _naming_judging import judge

WORN = {"coulomb_friction", "viscous_friction", "armature"}


def recorded(folder: Path, robot: str, **options: Any) -> tuple[Path, dict[str, Any]]:
    """A bag without the truth, and the truth."""
    simulated, truth = Scenario(Robot.bundled(robot), name=robot, **options).run()
    return bags.write(simulated.recording, folder / "bag"), truth


def diagnosed(bag: Path) -> dict[str, Any]:
    """What a diagnosis says that has nothing but the bag."""
    recording = bags.read(bag)
    assert recording.urdf is not None
    report = diagnose([recording], Robot.from_urdf(recording.urdf, recording.joints)).as_json()
    check_contract(report)
    return report


def words(report: dict[str, Any]) -> list[str]:
    """The findings, for the message of a test that fails."""
    return [f"{f['effect']}@{f['link'] or f['joint']}" for f in report["findings"]]


@pytest.mark.parametrize("robot, seed", [*(("arm2", seed) for seed in range(6)), ("arm7", 0), ("arm7", 1)])
def test_a_hidden_effect_is_named_first_with_its_parameters(tmp_path, robot, seed):
    options = {"hide": 1, "seed": seed, "duration": 20.0, "wrong": 0.05, "coloured": seed % 2 == 1}
    bag, truth = recorded(tmp_path, robot, **options)
    report = diagnosed(bag)
    outcome = judge(truth, report["findings"], Robot.bundled(robot))
    (hidden,) = outcome["hidden"]
    assert hidden["first"], f"{truth['effects']} was named {words(report)}"
    assert outcome["false"] == [], f"{truth['effects']} was named {words(report)}"
    assert report["gain"]["interval"][0] > 0.0 or hidden["effect"] == "velocity_filter"


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("wrong", [0.0, 0.05])
def test_nothing_is_wrong_with_a_robot_as_described(tmp_path, seed, wrong):
    options = {"seed": seed, "duration": 20.0, "wrong": wrong, "coloured": seed % 2 == 1}
    bag, _ = recorded(tmp_path, "arm2", **options)
    report = diagnosed(bag)
    assert words(report) == []
    assert report["verdict"] == "nothing_wrong"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_wear_is_found_on_every_joint_and_nothing_else(tmp_path, seed):
    bag, truth = recorded(tmp_path, "arm2", seed=seed, duration=20.0, wrong=0.05, worn=True)
    report = diagnosed(bag)
    assert {f["effect"] for f in report["findings"]} == WORN, words(report)
    for finding in report["findings"]:
        ((name, quantity),) = finding["parameters"].items()
        true, value, std = truth["worn"][finding["joint"]][name], quantity["value"], quantity["std"]
        assert abs(value - true) < 3.0 * std, finding["sentence"]
        if std < 0.05 * value:  # else its interval says that it is known no better
            assert value == pytest.approx(true, rel=0.1), finding["sentence"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "effect, seed, robot, worn",
    [
        ("backlash", 116000, "arm7", False),  # slow noise passed for what a small gap leaves
        ("payload", 118038, "arm2", False),  # links that nobody believes left less
        ("stribeck_friction", 118340, "arm6", True),  # white noise showed less than its prior cost
    ],
)
def test_what_a_search_once_missed_is_named(tmp_path, effect, seed, robot, worn):
    truth, report = _of_one(tmp_path, effect, seed, robot, worn)
    (hidden,) = judge(truth, report["findings"], Robot.bundled(robot))["hidden"]
    assert hidden["first"], f"{truth['effects']} was named {words(report)}"


@pytest.mark.slow
def test_a_law_that_is_hardly_seen_but_where_its_joint_dwells_is_told_as_the_plain_one(tmp_path):
    """5.2 standard deviations in all rows, 1.6 where no joint dwells: how friction turns round looks like that, too."""
    truth, report = _of_one(tmp_path, "stribeck_friction", 121900, "arm6", False)
    (told,) = report["findings"]
    assert (told["effect"], told["joint"]) == ("coulomb_friction", truth["effects"][0]["joint"])


def _of_one(tmp_path, effect, seed, robot, worn):
    """The truth of a recording with one hidden effect, and what a diagnosis says of it."""
    options = {
        "hide": 1,
        "hidden_names": (effect,),
        "seed": seed,
        "duration": 30.0,
        "wrong": 0.05,
        "worn": worn,
    }
    bag, truth = recorded(tmp_path, robot, coloured=True, **options)
    return truth, diagnosed(bag)
