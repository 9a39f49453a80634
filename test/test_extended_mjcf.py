"""extended.mjcf.xml against MuJoCo itself: the same inverse dynamics as the extended model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.mjcf import extended_mjcf
from bdnn_ros.robot import Robot

mujoco = pytest.importorskip("mujoco")

SPECS = (
    "coulomb_friction@arm7_joint4:coulomb=1.3",
    "viscous_friction@arm7_joint2:viscous=0.7",
    "armature@arm7_joint6:armature=0.05",
    "payload@arm7_link7:mass=1.5,com_x=0.02,com_y=-0.01,com_z=0.1",
    "link_inertia@arm7_link4:scale=1.2",
    "base_tilt:roll_deg=3,pitch_deg=-4",
    "joint_spring@arm7_joint4:stiffness=3.0,rest=-1.5",
    "joint_spring@arm7_joint4:stiffness=1.0,rest=0.5",
    "effort_scale@arm7_joint5:scale=0.8",
    "effort_offset@arm7_joint5:offset=0.4",
)


def model_of(robot: Robot, *specs: str) -> ExtendedModel:
    return ExtendedModel(robot, tuple(parse_spec(spec, robot) for spec in specs), np.zeros(robot.width))


def loaded(model: ExtendedModel):
    mj = mujoco.MjModel.from_xml_string(extended_mjcf(model))
    names = [mujoco.mj_id2name(mj, mujoco.mjtObj.mjOBJ_JOINT, k) for k in range(mj.njnt)]
    return mj, mujoco.MjData(mj), [names.index(name) for name in model.joints]


def inverse(mj, data, order, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """MuJoCo's inverse dynamics without its soft constraints (joint limits, frictionloss)."""
    mj.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    result = []
    for row in zip(q, v, a, strict=True):
        data.qpos[order], data.qvel[order], data.qacc[order] = row
        mujoco.mj_inverse(mj, data)
        result.append(data.qfrc_inverse[order].copy())
    return np.array(result)


def states(width: int, count: int = 40) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(5)
    return tuple(rng.uniform(-2.0, 2.0, (count, width)) for _ in range(3))


@pytest.mark.parametrize("name", ["arm2", "arm6", "arm7"])
def test_bundled_robots_as_they_are(name: str) -> None:
    model = model_of(Robot.bundled(name))
    state = states(len(model.joints))
    wanted = model.robot.rigid_effort(*state)
    np.testing.assert_allclose(inverse(*loaded(model), *state), wanted, atol=1e-7 * np.abs(wanted).max())


GIMBAL = """<robot name="gimbal"><link name="world"/>
<joint name="rail" type="prismatic"><parent link="world"/><child link="base"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="200"/></joint>
<link name="base"><inertial><mass value="6"/><inertia ixx=".05" ixy="0" ixz="0" iyy=".05" iyz="0" izz=".05"/></inertial></link>
<joint name="yaw" type="revolute"><parent link="base"/><child link="cross"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="3" effort="60"/></joint><link name="cross"/>
<joint name="pitch" type="revolute"><parent link="cross"/><child link="fore"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="3" effort="60"/></joint>
<link name="fore"><inertial><origin xyz=".2 0 .02"/><mass value="3"/>
<inertia ixx=".01" ixy="0" ixz="0" iyy=".05" iyz="0" izz=".05"/></inertial></link></robot>"""


def test_a_moving_base_and_a_link_without_mass() -> None:
    """MuJoCo knows one body of a name, and none that weighs nothing."""
    for text in (
        GIMBAL,
        GIMBAL.replace('"base"', '"odd"').replace('"world"', '"base"').replace('"odd"', '"world"'),
    ):
        model = model_of(Robot.from_urdf(text))
        state = states(3)
        wanted = model.robot.rigid_effort(*state)
        np.testing.assert_allclose(inverse(*loaded(model), *state), wanted, atol=1e-7 * np.abs(wanted).max())


def test_inverse_dynamics_with_effects() -> None:
    robot = Robot.bundled("arm7")
    model = model_of(robot.with_inertials(1.04 * robot.inertials), *SPECS)
    q, v, a = states(7)
    acting = model.plant.scale * model.inverse_dynamics(q, v, a) + model.plant.offset
    acting[:, 3] -= 1.3 * np.sign(v[:, 3])  # frictionloss is a constraint, checked below
    mj, data, order = loaded(model)
    np.testing.assert_allclose(inverse(mj, data, order, q, v, a), acting, atol=1e-7 * np.abs(acting).max())
    friction = mj.dof_frictionloss[[mj.jnt_dofadr[k] for k in order]]
    np.testing.assert_array_equal(friction, [0, 0, 0, 1.3, 0, 0, 0])


def test_a_spring_rests_where_its_joint_reports_it() -> None:
    """MuJoCo's positions are the true ones; the model's, and a spring's rest, hold the joint's offset."""
    robot = Robot.bundled("arm7")
    offset = "position_offset@arm7_joint4:offset=0.3"
    model = model_of(robot, "joint_spring@arm7_joint4:stiffness=3.0,rest=-1.5", offset)
    q, v, a = states(7)
    wanted = model.inverse_dynamics(q + model.plant.position_offset, v, a)
    np.testing.assert_allclose(inverse(*loaded(model), q, v, a), wanted, atol=1e-7 * np.abs(wanted).max())


def test_motors_take_the_measured_effort() -> None:
    robot = Robot.bundled("arm7")
    model = model_of(robot, *SPECS)
    mj, data, order = loaded(model)
    command = np.linspace(-5.0, 5.0, 7)
    data.ctrl[:] = command  # one motor a joint, in the joints' order
    mujoco.mj_forward(mj, data)
    acting = model.plant.scale * command + model.plant.offset
    np.testing.assert_allclose(data.qfrc_actuator[order], acting)
    np.testing.assert_allclose(mj.actuator_ctrlrange[:, 1], robot.limits.effort)


def test_a_limit_on_one_side_is_kept() -> None:
    robot = Robot.bundled("arm2")
    lower, upper = np.array([-0.5, -np.inf]), np.array([np.inf, np.inf])
    one_sided = replace(robot, limits=replace(robot.limits, lower=lower, upper=upper))
    mj, data, order = loaded(model_of(one_sided))
    assert mj.jnt_limited[order].tolist() == [True, False]
    for position, pushed_back in ((-0.6, True), (-0.4, False), (50.0, False)):
        data.qpos[order[0]] = position
        mujoco.mj_forward(mj, data)
        assert bool(data.qfrc_constraint[order[0]] > 0.0) == pushed_back


def test_limits_and_chosen_joints() -> None:
    robot = Robot.from_urdf(Robot.bundled("arm7").urdf, ("arm7_joint4", "arm7_joint2"))
    model = model_of(robot, "viscous_friction@arm7_joint4:viscous=2")
    mj, data, order = loaded(model)
    np.testing.assert_allclose(mj.jnt_range[order, 0], robot.limits.lower)
    assert mj.dof_damping[mj.jnt_dofadr[order[0]]] == 2.0
    state = states(2)
    wanted = robot.rigid_effort(*state)
    wanted[:, 0] += 2.0 * state[1][:, 0]
    np.testing.assert_allclose(inverse(mj, data, order, *state), wanted, atol=1e-7 * np.abs(wanted).max())


def test_joints_that_slide_and_turn_without_end() -> None:
    urdf = """<robot name="cart"><link name="rail"/>
      <link name="cart"><inertial><mass value="2"/>
        <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <link name="pole"><inertial><origin xyz="0 0 0.5"/><mass value="1"/>
        <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="0.6 0.8 0"/>
        <limit lower="-1" upper="1" velocity="1" effort="10"/></joint>
      <joint name="turn" type="continuous"><parent link="cart"/><child link="pole"/>
        <origin xyz="0 0.2 0.1" rpy="0.3 0 0"/><axis xyz="0 1 0"/></joint></robot>"""
    model = model_of(Robot.from_urdf(urdf))
    mj, data, order = loaded(model)
    assert [bool(limited) for limited in mj.jnt_limited[order]] == [True, False]
    state = states(2)
    wanted = model.robot.rigid_effort(*state)
    np.testing.assert_allclose(inverse(mj, data, order, *state), wanted, atol=1e-7 * np.abs(wanted).max())


def test_it_says_what_it_leaves_out(tmp_path: Path) -> None:
    robot = Robot.bundled("arm2")
    text = extended_mjcf(model_of(robot, "backlash@arm2_joint1:gap=0.01"))
    assert "leaves out backlash" in text
    assert "leaves out" not in extended_mjcf(model_of(robot, "armature@arm2_joint1:armature=0.01"))


@pytest.mark.parametrize(
    ("body", "spec", "off"),
    [
        ('mass value="1"/><inertia ixx="0" iyy="0" izz="0"', "", 1e-3),
        ('mass value="1"/><inertia ixx="0" iyy="0.01" izz="0.01"', "", 1e-3),
        ('mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.03"', "", 0.2),
        ('mass value="0"/><inertia ixx="0.01" iyy="0.01" izz="0.01"', "", 0.1),
        ('mass value="0"/><inertia ixx="0" iyy="0" izz="0"', "payload@l2:mass=1,com_x=0.1", 1e-3),
    ],
    ids=["point", "rod", "more inertia than a body has", "no mass", "payload on nothing"],
)
def test_bodies_that_cannot_exist_are_thickened_and_said_to_be(body: str, spec: str, off: float) -> None:
    """MuJoCo refuses them as they are; points and rods then move as before."""
    joint = (
        '<joint name="j{0}" type="revolute"><parent link="l{1}"/><child link="l{0}"/><axis xyz="0 1 0"/>{2}'
    )
    limit = '<limit lower="-2" upper="2" effort="9" velocity="3"/></joint>'
    whole = '<inertial><mass value="2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
    robot = Robot.from_urdf(
        f'<robot name="r"><link name="l0"/><link name="l1">{whole}</link>'
        f'<link name="l2"><inertial><origin xyz="0.2 0 0"/><{body} ixy="0" ixz="0" iyz="0"/></inertial></link>'
        + joint.format(1, 0, limit)
        + joint.format(2, 1, f'<origin xyz="0.3 0 0"/>{limit}')
        + "</robot>"
    )
    model = model_of(robot, *filter(None, [spec]))
    assert extended_mjcf(model).count("thickened") == 1
    found, expected = inverse(*loaded(model), *states(2)), model.inverse_dynamics(*states(2))
    np.testing.assert_allclose(found, expected, atol=off)
