"""Causes outside the library as the benchmark makes and judges them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bdnn_ros.robot import Robot
from bdnn_ros.simulation.simulate import Simulated, simulate

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from _naming_outside import CAUSES, LARGEST, SMALLEST, hiding, judged, table

J1, J2 = "arm2_joint1", "arm2_joint2"
TRUTH = {"cause": "a spring between two joints", "joint": J1, "inputs": [f"{J1}.position", f"{J2}.position"]}


@pytest.fixture(scope="module")
def simulated() -> Simulated:
    return simulate(Robot.bundled("arm2"), duration=5.0)


@pytest.mark.parametrize("cause", CAUSES)
def test_a_cause_adds_its_share_to_one_joint_along_the_same_motion(simulated, cause):
    recording, truth = hiding(simulated, cause, seed=3)
    joint = recording.joints.index(truth["joint"])
    before = simulated.recording.require_effort()
    added = recording.require_effort() - before
    size = np.sqrt(np.mean(added[:, joint] ** 2)) / before[:, joint].std()
    assert SMALLEST <= size <= LARGEST and not np.delete(added, joint, axis=1).any()
    np.testing.assert_array_equal(recording.position, simulated.recording.position)
    quantities = {f"{name}.{of}" for name in recording.joints for of in ("position", "velocity", "load")}
    assert set(truth["inputs"]) <= quantities | {"time"}


def report(verdict: str, told: list[str], *findings: tuple[str, str]) -> dict[str, Any]:
    named = [{"effect": effect, "joint": joint} for effect, joint in findings]
    return {"verdict": verdict, "findings": named, "unexplained": {"depends_on": told}}


def test_what_it_depends_on_is_asked_of_all_inputs_and_of_the_first():
    both = judged(TRUTH, report("cannot_tell", [f"{J2}.position", "time", f"{J1}.position"]), worn=False)
    assert both == {
        "false": [],
        "nothing wrong": False,
        "explained": False,
        "first": True,
        "all": True,
        "learned": 0.0,
    }
    other = judged(TRUTH, report("nothing_wrong", ["time", f"{J1}.position"]), worn=False)
    assert other == {
        "false": [],
        "nothing wrong": True,
        "explained": False,
        "first": False,
        "all": False,
        "learned": 0.0,
    }


@pytest.mark.parametrize(
    "finding, worn, false",
    [
        (("cogging", J1), True, True),
        (("joint_spring", J1), False, False),
        (("joint_spring", J2), False, True),
        (("coulomb_friction", J1), False, False),
        (("coulomb_friction", J2), False, True),
        (("coulomb_friction", J2), True, False),
    ],
)
def test_a_name_is_false_but_of_friction_there_and_of_a_part(finding, worn, false):
    outcome = judged(TRUTH, report("explained", [], finding), worn)
    assert (bool(outcome["false"]), outcome["explained"]) == (false, false)


def test_a_row_for_each_cause_that_was_drawn_and_one_for_all():
    told = report("explained", [], ("cogging", J1))
    told["unexplained"]["learned"] = {"value": 0.9, "interval": [0.8, 0.95]}
    record = {"status": "diagnosed", "truth": TRUTH, "outcome": judged(TRUTH, told, False)}
    rows = table([record, record])
    assert [row[0] for row in rows] == ["cause", TRUTH["cause"], "all"]
    assert (
        rows[1][1:]
        == rows[2][1:]
        == ["2", "0 %", "0 %", "100 %", "cogging 2", "100 %", "0 %", "100 %", "90 %"]
    )
