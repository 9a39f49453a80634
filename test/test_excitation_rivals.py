"""What is read from a diagnosis: effects at their places, in their units, and rivals that are still open."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_cases import sliding_arm
from excitation_cases import finding, place, write_diagnosis

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.errors import UsageError
from bdnn_ros.excitation.rivals import Case, read_case
from bdnn_ros.excitation.separation import Design, left_out
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.simulate import simulate

JOINTS = ("arm2_joint1", "arm2_joint2")


def case_of(robot: Robot, tmp_path: Path, *findings: dict) -> Case:
    """What is read of some findings."""
    return read_case(write_diagnosis(tmp_path / "diagnosis.json", robot.joints, *findings), robot)


def test_a_diagnosis_of_a_joint_that_slides_is_read_again(tmp_path: Path) -> None:
    robot = sliding_arm()
    hidden = parse_spec("viscous_friction@arm2_joint2:viscous=30", robot)
    diagnosis = diagnose([simulate(robot, [hidden], seed=3, duration=15.0).recording], robot)
    diagnosis.save(tmp_path / "diagnosis.json")
    (question,) = read_case(tmp_path / "diagnosis.json", robot).questions
    assert question.finding.target == 1
    assert question.finding.values == {"viscous": pytest.approx(30.0, rel=0.1)}


def test_units_are_those_of_the_place(tmp_path: Path) -> None:
    drift = {**place("drift", JOINTS[1]), "rivals": [], "parameters": {}}
    for name in ("start_value", "end_value"):
        drift["parameters"][name] = {"value": 2.0, "std": 0.1, "unit": "N*s/m"}
    (question,) = case_of(sliding_arm(), tmp_path, drift).questions
    assert question.finding.effect.variant == "viscous"
    with pytest.raises(UsageError, match=r"at arm2_joint2 has start_value in N\*s/m, which is in"):
        case_of(Robot.bundled("arm2"), tmp_path, drift)


@pytest.mark.parametrize("beside", [0.0, 0.05])
def test_what_no_motion_settles_is_looked_for_as_the_diagnosis_advises(tmp_path: Path, beside: float) -> None:
    """A payload at the centre of a wrist, and one beside it that a motion tells."""
    robot, link = Robot.bundled("arm6"), "arm6_link6"
    centre = {"mass": 1.5, "com_x": beside, "com_y": 0.0, "com_z": 0.0}
    load = finding(place("payload", link=link), centre, place("payload", link="arm6_link5", p=0.3))
    case = case_of(robot, tmp_path, load)
    said = [
        "Whether arm6_link6 or arm6_link5 carries the payload, no motion shows, for its centre lies on the axes "
        "of the joints between them: look where it hangs."
    ]
    assert left_out(case, robot) == ([] if beside else said)
    assert Design(robot, np.ones(6), case).asked is bool(beside)


@pytest.mark.parametrize("dry", [True, False])
def test_an_offset_beside_dry_friction_is_not_asked(tmp_path: Path, dry: bool) -> None:
    robot = Robot.bundled("arm2")
    offset = finding(
        place("effort_offset", JOINTS[0]), {"offset": 0.2}, place("asymmetric_friction", JOINTS[0])
    )
    friction = finding(place("coulomb_friction", JOINTS[0 if dry else 1]), {"coulomb": 0.3})
    case = case_of(robot, tmp_path, offset, friction)
    assert any("while the drive is off" in one for one in left_out(case, robot)) is dry
    assert Design(robot, np.ones(2), case).asked is not dry


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"effect": "gremlins"}, "^No effect 'gremlins'"),
        ({"variant": "haunted"}, "^No coulomb_friction is known of the variant 'haunted'"),
        ({"joint": None}, "^No coulomb_friction is known that could be at the base"),
        ({"joint": None, "link": "arm2_link2"}, "^No coulomb_friction is known that could be at arm2_link2"),
        ({"parameters": {"spin": {"value": 1.0, "unit": "-"}}}, "has spin, which is none of its parameters"),
        ({"parameters": {}}, "lacks coulomb[.]"),
    ],
)
def test_what_is_not_known_is_refused_by_what_it_is(tmp_path: Path, change: dict, says: str) -> None:
    friction = {**finding(place("coulomb_friction", JOINTS[0]), {"coulomb": 0.3}), **change}
    with pytest.raises(UsageError, match=says) as refused:
        case_of(Robot.bundled("arm2"), tmp_path, friction)
    assert ("incomplete" in str(refused.value)) == ("lacks" in says)


def test_the_unit_of_all_efforts_is_not_asked(tmp_path: Path) -> None:
    """No motion tells it from links that are all off by one factor; that of one joint's is asked."""
    friction = place("coulomb_friction", JOINTS[0])
    asked = [
        case_of(
            Robot.bundled("arm2"), tmp_path, finding(friction, {"coulomb": 0.3}, place("effort_scale", at))
        )
        for at in (None, JOINTS[0])
    ]
    assert [case.open for case in asked] == [False, True]


def test_only_rivals_that_are_open_are_asked(tmp_path: Path) -> None:
    rivals = [
        place(name, JOINTS[0], p=p)
        for name, p in (("viscous_friction", 0.1), ("armature", 0.09), ("hysteresis", 1e-40))
    ]
    friction = finding(place("coulomb_friction", JOINTS[0]), {"coulomb": 0.3}, *rivals)
    excluded = finding(place("quadratic_drag", JOINTS[1]), {}, place("drift", JOINTS[1], p=1e-9))
    excluded["parameters"] = {"drag": {"value": 0.3, "unit": "N*m*s^2/rad^2"}}
    robot = Robot.bundled("arm2")
    case = case_of(robot, tmp_path, friction, excluded)
    assert case.open
    assert [[r.words(robot) for r in q.rivals] for q in case.questions] == [
        ["viscous_friction@arm2_joint1"],
        [],
    ]
    assert not left_out(case, robot)
    assert not case_of(robot, tmp_path, excluded).open
