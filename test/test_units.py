"""Units as they are printed, and those of joints that slide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.effects.registry import ALL, parse_spec
from bdnn_ros.physical.combinations import combinations, unit_of
from bdnn_ros.robot import Robot
from bdnn_ros.robot.units import ALONG, along, printed
from bdnn_ros.simulation.simulate import simulate


@pytest.fixture(scope="module")
def robot() -> Robot:
    """Two joints, of which the second slides."""
    plain = Robot.bundled("arm2").urdf
    second = plain.index('name="arm2_joint2"')
    return Robot.from_urdf(plain[:second] + plain[second:].replace('"revolute"', '"prismatic"', 1))


@pytest.mark.parametrize(
    ("unit", "text"), [("N*m*s^2/rad^2", "N·m·s²/rad²"), ("kg*m^2", "kg·m²"), ("-", ""), ("deg", "°")]
)
def test_units_are_printed_as_they_are_written_by_hand(unit: str, text: str) -> None:
    assert printed(unit) == text


def test_a_joint_slides_in_metres_and_newtons(robot: Robot) -> None:
    assert robot.slides.tolist() == [False, True]
    assert (along("N*m", False), along("N*m", True), along("s", True)) == ("N*m", "N", "s")


def test_every_unit_of_a_joint_has_one_along_it() -> None:
    """Radians and torques are of joints that turn; a phase is an angle anywhere."""
    units = {p.unit: p for effect in ALL if effect.on == "joint" for p in effect.parameters if not p.phase}
    assert {unit for unit in units if "rad" in unit or "N*m" in unit or unit.startswith("kg")} <= set(ALONG)
    (phase,) = {p.name for effect in ALL for p in effect.parameters if p.phase}
    assert phase == "phase"


def test_identified_parameters_have_them(robot: Robot) -> None:
    assert [unit_of(f"{joint}.viscous", robot) for joint in robot.joints] == ["N*m*s/rad", "N*s/m"]
    assert unit_of(f"{robot.moving_link(robot.joints[1])}.Ixx", robot) == "kg*m^2"
    assert [one.unit for one in combinations(robot) if one.words.startswith("Coulomb")] == ["N*m", "N"]


def test_findings_have_them(robot: Robot) -> None:
    hidden = parse_spec("viscous_friction@arm2_joint2:viscous=30", robot)
    assert hidden.sentence(robot).endswith("(viscous 30 N·s/m).")
    (finding,) = diagnose([simulate(robot, [hidden], seed=3, duration=15.0).recording], robot).findings
    assert finding.joint == "arm2_joint2"
    assert finding.parameters["viscous"].unit == "N*s/m" and "N·s/m)" in finding.sentence
    np.testing.assert_allclose(finding.parameters["viscous"].value, 30.0, rtol=0.05)


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("backlash:gap=0.002", "0.002 m."),
        ("position_offset:offset=0.01", "+0.01 m off"),
        ("joint_elasticity:stiffness=9000", "9e+03 N/m."),
        (
            "external_wrench:torque=7,start=1,end=2",
            "Something pushes arm2_joint2 from 1.00 s to 2.00 s with 7 N.",
        ),
        ("drift:of=viscous,start_value=1,end_value=2", "to 2 N·s/m over"),
        ("cogging:amplitude=2,periods_per_rev=9,phase=0.5", "phase 0.5 rad"),
    ],
)
def test_sentences_have_them(robot: Robot, spec: str, words: str) -> None:
    name, _, rest = spec.partition(":")
    assert words in parse_spec(f"{name}@arm2_joint2:{rest}", robot).sentence(robot)


def test_what_gives_less_than_in_a_model_has_them(robot: Robot) -> None:
    gives = parse_spec("joint_elasticity@arm2_joint2:stiffness=9000", robot)
    assert "by 0.000111 m/N." in replace(gives, values={"stiffness": -9000.0}).sentence(robot)
