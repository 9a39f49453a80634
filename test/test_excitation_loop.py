"""The loop closed in simulation: ambiguous data, the motion that would tell, a new recording, settled."""

from __future__ import annotations

from pathlib import Path

import pytest

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.diagnosis.result import Diagnosis
from bdnn_ros.excitation.choice import excite
from bdnn_ros.excitation.rivals import read_case
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.scenario import Scenario

EFFECT = "asymmetric_friction@arm2_joint1:positive=0.9,negative=0.5"
CLEAR = 0.1
"""A rival at least this probable makes a tie."""


def tied(diagnosis: Diagnosis) -> bool:
    """Joint 1 has some dry friction, and it is open which."""
    at_joint = [f for f in diagnosis.findings if f.joint == "arm2_joint1" and "friction" in f.effect]
    return any(max((r.probability for r in f.rivals), default=0.0) >= CLEAR for f in at_joint)


def test_a_tie_is_settled_by_the_motion_it_asks_for(tmp_path: Path) -> None:
    """A slow small motion hardly tells dry frictions apart; the proposed one names the right one."""
    robot = Robot.bundled("arm2")
    for seed in (4, 2, 6, 7, 8):
        poor = Scenario(robot, effects=[EFFECT], seed=seed, duration=20.0, rate=200.0, wrong=0.03, poor=True)
        before = diagnose([poor.run()[0].recording], robot)
        if tied(before):
            break
    assert tied(before)
    assert any("excite" in sentence for sentence in before.advice)
    before.save(tmp_path / "diagnosis.json")
    case = read_case(tmp_path / "diagnosis.json", robot)
    found = excite(robot, case, duration=20.0, rate=200.0, seed=seed)
    assert found.separations and all(one.settled for one in found.separations)
    rich = Scenario(robot, effects=[EFFECT], seed=seed, rate=200.0, wrong=0.03, plan=found.trajectory)
    after = diagnose([rich.run()[0].recording], robot)
    first = after.findings[0]
    assert (first.effect, first.joint) == ("asymmetric_friction", "arm2_joint1")
    assert first.probability > 0.8 and not tied(after)
    assert first.parameters["positive"].value == pytest.approx(0.9, rel=0.1)
    assert first.parameters["negative"].value == pytest.approx(0.5, rel=0.1)
