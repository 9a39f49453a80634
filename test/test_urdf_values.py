"""URDFs that hold what no robot can have are refused by name; those of real robots are not."""

from __future__ import annotations

from importlib import resources

import numpy as np
import pytest

from bdnn_ros.errors import RobotError
from bdnn_ros.robot import BUNDLED, Robot
from bdnn_ros.robot.urdf_values import refuse_impossible

MASS, INERTIA = '<mass value="2"/>', '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>'
AXIS, LIMIT = '<axis xyz="0 1 0"/>', '<limit lower="-3" upper="3" effort="9" velocity="5"/>'
ARM = f"""<robot name="arm"><link name="base"/>
<joint name="lift" type="revolute"><parent link="base"/><child link="frame"/><origin xyz="0 0 1"/>{AXIS}{LIMIT}
<dynamics damping="0.1"/></joint>
<joint name="bolts" type="fixed"><parent link="frame"/><child link="bar"/><axis xyz="0 0 0"/></joint>
<link name="frame"/><link name="bar"><inertial>{MASS}{INERTIA}</inertial></link></robot>"""


@pytest.mark.parametrize(
    ("text", "wrong", "sentence"),
    [
        (MASS, '<mass value="2,5"/>', '<mass> of link bar has value="2,5", not a finite number. Write a point'),
        (MASS, '<mass value="${m}3"/>', 'link bar has value="${m}3", not a finite number. Run xacro first'),
        (MASS, '<mass value="nan"/>', 'link bar has value="nan", not a finite number. Correct'),
        (MASS, '<mass value="1e999"/>', 'link bar has value="1e999", not a finite number'),
        (MASS, '<mass value="-1"/>', "The mass of link bar is negative (value=-1 kg)"),
        (MASS, "", "The <mass> of link bar lacks value: the link would count as massless"),
        ('izz="0.1"', "", "The <inertia> of link bar lacks izz"),
        ('ixx="0.1"', 'ixx="-0.1"', "<inertia> of link bar (ixx=-0.1) has a negative principal moment"),
        ('iyz="0"', 'iyz="0.3"', "<inertia> of link bar (ixx to izz) has a negative principal moment, -0.2"),
        ('ixz="0"', 'ixz="inf"', 'The <inertia> of link bar has ixz="inf"'),
        (MASS, MASS + '<origin xyz="0 0"/>', '<origin> of link bar has xyz="0 0", not 3 finite numbers'),
        (AXIS, '<axis xyz="0 0 0"/>', 'The <axis> of joint lift has xyz="0 0 0", which is no direction'),
        (AXIS, '<axis xyz="0 a 0"/>', 'The <axis> of joint lift has xyz="0 a 0", not 3 finite numbers'),
        ('upper="3"', 'upper="${pi}"', '<limit> of joint lift has upper="${pi}", not a finite number. Run xacro'),
        ('effort="9"', 'effort="nan"', 'The <limit> of joint lift has effort="nan"'),
        ('damping="0.1"', 'damping="nan"', 'The <dynamics> of joint lift has damping="nan"'),
        (MASS, '<mass value="1e300"/>', 'The <mass> of link bar has value="1e300", as no robot has. Correct the URDF'),
        ('iyy="0.1"', 'iyy="1e12"', 'The <inertia> of link bar has iyy="1e12", as no robot has'),
        ('damping="0.1"', 'damping="1e200"', 'The <dynamics> of joint lift has damping="1e200", as no robot has'),
        ('"0 0 1"', '"0 0 nan"', 'The <origin> of joint lift has xyz="0 0 nan"'),
    ],
)  # fmt: skip
def test_what_no_robot_can_have_is_named(text: str, wrong: str, sentence: str) -> None:
    assert ARM.count(text) == 1
    with pytest.raises(RobotError) as refused:
        Robot.from_urdf(ARM.replace(text, wrong))
    assert sentence in str(refused.value)
    assert refused.value.exit_status == 2


@pytest.mark.parametrize(
    ("text", "unexpanded", "name"),
    [
        ("</robot>", '<xacro:gripper parent="bar"/></robot>', "gripper"),
        (f"<inertial>{MASS}{INERTIA}</inertial>", '<xacro:box_inertia m="1"/>', "box_inertia"),
        (ARM[ARM.index("<link") :], '<xacro:include filename="$(find it)/it.xacro"/></robot>', "include"),
    ],
    ids=["beside the links", "within a link", "nothing else"],
)
@pytest.mark.parametrize("address", ["http://www.ros.org/wiki/xacro", "http://ros.org/xacro", None])
def test_what_xacro_has_not_expanded_is_refused_in_one_sentence(
    text: str, unexpanded: str, name: str, address: str | None
) -> None:
    declared = f'<robot xmlns:xacro="{address}"' if address else "<robot"
    with pytest.raises(RobotError) as refused:
        Robot.from_urdf(ARM.replace(text, unexpanded).replace("<robot", declared, 1))
    assert (
        refused.value.problem == f"The robot description holds <xacro:{name}>, which xacro has not expanded."
    )
    assert refused.value.remedy == "Run xacro first, and give what it writes."


def test_what_xacro_has_written_may_still_declare_and_tell_of_it() -> None:
    written = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="arm"><!-- was <xacro:gripper parent="bar"/> -->'
    assert Robot.from_urdf(ARM.replace('<robot name="arm">', written)).joints == ("lift",)


@pytest.mark.parametrize(
    ("text", "odd"),
    [
        ('ixx="0.1"', 'ixx="-0.005"'),
        (MASS + INERTIA, '<mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>'),
        (f"<inertial>{MASS}{INERTIA}</inertial>", ""),
        (AXIS, ""),
        ('<link name="base"/>', '<link name="base"><inertial><mass value="-1"/></inertial></link>'),
    ],
    ids=["an estimate just below zero", "massless frame", "no inertial", "no axis", "what does not move"],
)
def test_what_cannot_matter_passes(text: str, odd: str) -> None:
    assert ARM.count(text) == 1
    assert Robot.from_urdf(ARM.replace(text, odd)).joints == ("lift",)


@pytest.mark.parametrize("text", ['value="2"', 'ixx="0.1"', 'lower="-3"', 'effort="9"', 'damping="0.1"'])
def test_a_number_behind_spaces_is_read_as_the_parsers_do(text: str) -> None:
    assert ARM.count(text) == 1
    plain, spaced = Robot.from_urdf(ARM), Robot.from_urdf(ARM.replace(text, text.replace('="', '="  ')))
    assert np.array_equal(spaced.inertials, plain.inertials)
    assert np.array_equal(spaced.viscous, plain.viscous)
    for limit in ("lower", "effort"):
        assert np.array_equal(getattr(spaced.limits, limit), getattr(plain.limits, limit))


def test_a_range_that_a_continuous_joint_does_not_have_is_not_read() -> None:
    endless = ARM.replace('"revolute"', '"continuous"').replace(
        'lower="-3" upper="3"', 'lower="-inf" upper="inf"'
    )
    assert Robot.from_urdf(endless).limits.upper[0] == float("inf")


@pytest.mark.parametrize("name", BUNDLED)
def test_robots_that_come_along_pass(name: str) -> None:
    refuse_impossible((resources.files("bdnn_ros") / "robots" / f"{name}.urdf").read_text(encoding="utf-8"))


@pytest.mark.parametrize("limit", ["effort", "velocity", "upper"])
def test_a_limit_that_nothing_reaches_is_none(limit: str) -> None:
    sizes = {"effort": "9", "velocity": "5", "upper": "3"}
    limits = Robot.from_urdf(ARM.replace(f'{limit}="{sizes[limit]}"', f'{limit}="1.79e308"')).limits
    assert getattr(limits, limit) == [float("inf")]
