"""The rigid-body robot: closed forms, axioms and finite differences."""

from __future__ import annotations

import copy
import errno
import gc
import os
import threading
import weakref
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import torch
from cli_cases import sliding_arm, two_armed

from bdnn_ros.errors import RobotError, UsageError
from bdnn_ros.robot import BUNDLED, PER_LINK, Robot
from bdnn_ros.robot.links import link_inertial
from bdnn_ros.robot.rows import MANY
from bdnn_ros.robot.state import robot_from_state, robot_state
from bdnn_ros.robot.urdf import _overheard

G = 9.81
M1, M2, L1, C1, C2, I1, I2 = 3.0, 2.0, 0.8, 0.5, 0.3, 0.2, 0.07


def two_link(dynamics: str = "", kind: str = "revolute", order: str = "12") -> str:
    """A planar arm in the vertical plane: horizontal at zero, positive angles lift it."""
    limit = '<limit lower="-3" upper="3" effort="100" velocity="5"/>' if kind == "revolute" else ""
    joints = {
        "1": f"""<joint name="one" type="{kind}"><parent link="base"/><child link="upper"/>
            <axis xyz="0 -1 0"/>{limit}{dynamics}</joint>""",
        "2": f"""<joint name="two" type="{kind}"><parent link="upper"/><child link="lower"/>
            <axis xyz="0 -1 0"/><origin xyz="{L1} 0 0"/>{limit}</joint>""",
    }

    def link(name: str, mass: float, centre: float, inertia: float) -> str:
        return f"""<link name="{name}"><inertial><origin xyz="{centre} 0 0"/><mass value="{mass}"/>
            <inertia ixx="0.01" ixy="0" ixz="0" iyy="{inertia}" iyz="0" izz="{inertia}"/></inertial></link>"""

    return f"""<robot name="arm"><link name="base"/>{link("upper", M1, C1, I1)}{link("lower", M2, C2, I2)}
        {"".join(joints[k] for k in order)}
        <link name="tool"/><joint name="fixed" type="fixed"><parent link="lower"/><child link="tool"/>
        <origin xyz="0.4 0.1 0.2" rpy="0.3 0.2 0.1"/></joint></robot>"""


def closed_form(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Effort of the two-link arm (Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, 7.4)."""
    mass = closed_mass(q)
    h = M2 * L1 * C2 * np.sin(q[1])
    coriolis = np.array([-h * (2.0 * v[0] * v[1] + v[1] ** 2), h * v[0] ** 2])
    outer = M2 * C2 * G * np.cos(q[0] + q[1])
    return mass @ a + coriolis + np.array([(M1 * C1 + M2 * L1) * G * np.cos(q[0]) + outer, outer])


def closed_mass(q: np.ndarray) -> np.ndarray:
    """Mass matrix of the two-link arm."""
    cross = M2 * L1 * C2 * np.cos(q[1])
    inner = I2 + M2 * C2**2
    return np.array(
        [[I1 + M1 * C1**2 + inner + M2 * L1**2 + 2.0 * cross, inner + cross], [inner + cross, inner]]
    )


def states(robot: Robot, count: int = 20, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random positions, velocities, accelerations, (count, n) each."""
    rng = np.random.default_rng(seed)
    q, v, a = rng.uniform(-1.5, 1.5, (3, count, robot.width))
    return q, 2.0 * v, 5.0 * a


@pytest.fixture(params=[*BUNDLED, "shuffled"])
def robot(request: pytest.FixtureRequest) -> Robot:
    """Every bundled robot, and one with its joints in another order and two of them locked."""
    if request.param != "shuffled":
        return Robot.bundled(request.param)
    return Robot.bundled("arm7", [f"arm7_joint{k}" for k in (6, 2, 4, 1, 7)])


def test_the_two_link_arm_is_the_textbooks() -> None:
    arm = Robot.from_urdf(two_link())
    q, v, a = states(arm)
    expected = np.array([closed_form(*row) for row in zip(q, v, a, strict=True)])
    np.testing.assert_allclose(arm.rigid_effort(q, v, a), expected, atol=1e-10)
    np.testing.assert_allclose(arm.mass_matrix(q), [closed_mass(row) for row in q], atol=1e-12)
    rest = np.zeros(2)
    np.testing.assert_allclose(arm.gravity(q), [closed_form(row, rest, rest) for row in q], atol=1e-10)
    np.testing.assert_allclose(
        arm.coriolis(q, v) + arm.gravity(q),
        [closed_form(*row, rest) for row in zip(q, v, strict=True)],
        atol=1e-10,
    )


def test_a_link_may_have_the_name_of_a_joint_where_others_are_left_out() -> None:
    """As legs and grippers of known robots have it."""
    text = Robot.bundled("arm7").urdf
    kept = [f"arm7_joint{k}" for k in (6, 2, 4)]
    plain, named = Robot.from_urdf(text, kept), Robot.from_urdf(text.replace("arm7_link", "arm7_joint"), kept)
    q, v, a = states(plain)
    np.testing.assert_allclose(named.rigid_effort(q, v, a), plain.rigid_effort(q, v, a), atol=1e-12)
    assert named.links == tuple(link.replace("link", "joint") for link in plain.links)


@pytest.mark.parametrize("text", [two_link(order="21"), two_link()])
def test_joints_come_in_any_order(text: str) -> None:
    straight = Robot.from_urdf(text, ["one", "two"])
    turned = Robot.from_urdf(text, ["two", "one"])
    q, v, a = states(straight)
    np.testing.assert_allclose(straight.rigid_effort(q, v, a)[0], closed_form(q[0], v[0], a[0]), atol=1e-10)
    turn = [1, 0]
    np.testing.assert_allclose(
        turned.rigid_effort(q[:, turn], v[:, turn], a[:, turn]),
        straight.rigid_effort(q, v, a)[:, turn],
        atol=1e-12,
    )
    np.testing.assert_allclose(
        turned.mass_matrix(q[:, turn]), straight.mass_matrix(q)[:, turn][:, :, turn], atol=1e-12
    )
    np.testing.assert_array_equal(turned.inertials, straight.inertials[turn])


def test_order_of_a_tree_does_not_matter() -> None:
    whole = Robot.bundled("arm7")
    order = np.random.default_rng(1).permutation(7)
    turned = Robot.bundled("arm7", [whole.joints[k] for k in order])
    q, v, a = states(whole)
    np.testing.assert_allclose(
        turned.inverse_dynamics(q[:, order], v[:, order], a[:, order]),
        whole.inverse_dynamics(q, v, a)[:, order],
        atol=1e-10,
    )
    for name in ("lower", "upper", "velocity", "effort"):
        np.testing.assert_array_equal(getattr(turned.limits, name), getattr(whole.limits, name)[order])


def test_a_joint_carries_those_after_it() -> None:
    assert Robot.bundled("arm6").carried.tolist() == [5, 4, 3, 2, 1, 0]
    assert Robot.bundled("arm6", ("arm6_joint6", "arm6_joint2")).carried.tolist() == [0, 1]


def test_the_regressor_is_linear_in_the_inertials(robot: Robot) -> None:
    rng = np.random.default_rng(2)
    q, v, a = states(robot)
    regressor = robot.regressor(q, v, a)
    assert regressor.shape == (20, robot.width, robot.width * PER_LINK)
    np.testing.assert_allclose(regressor @ robot.inertials.ravel(), robot.rigid_effort(q, v, a), atol=1e-9)
    other = robot.with_inertials(robot.inertials * rng.uniform(0.8, 1.2, robot.inertials.shape))
    np.testing.assert_allclose(regressor @ other.inertials.ravel(), other.rigid_effort(q, v, a), atol=1e-9)


def test_derivatives_of_the_effort_are_its_slopes(robot: Robot) -> None:
    point, step = states(robot), 1e-6
    for which, slope in enumerate(robot.effort_derivatives(*point)):
        for joint in range(robot.width):
            sides = []
            for side in (step, -step):
                moved = [values.copy() for values in point]
                moved[which][:, joint] += side
                sides.append(robot.rigid_effort(*moved))
            expected = (sides[0] - sides[1]) / (2.0 * step)
            np.testing.assert_allclose(slope[:, :, joint], expected, rtol=1e-6, atol=1e-6)


def test_the_mass_matrix_is_symmetric_and_positive(robot: Robot) -> None:
    q, _, _ = states(robot, 50)
    mass = robot.mass_matrix(q)
    np.testing.assert_allclose(mass, np.swapaxes(mass, 1, 2), atol=1e-12)
    assert np.linalg.eigvalsh(mass).min() > 0.0
    armature = np.arange(1.0, robot.width + 1.0)
    np.testing.assert_allclose(
        robot.with_joint_parameters(armature=armature).mass_matrix(q) - mass,
        np.tile(np.diag(armature), (50, 1, 1)),
        atol=1e-12,
    )


def test_mass_and_coriolis_belong_together(robot: Robot) -> None:
    """Christoffel symbols from M by finite differences: their C q̇ is the robot's, and Ṁ - 2C is skew."""
    q, v, _ = states(robot, 1)
    step, n = 1e-5, robot.width
    sides = [robot.mass_matrix(q[0] + sign * step * np.eye(n)) for sign in (1.0, -1.0)]
    slope = (sides[0] - sides[1]) / (2.0 * step)  # slope[k, i, j] = dM_ij / dq_k
    christoffel = 0.5 * (
        np.einsum("kij->ijk", slope) + np.einsum("jik->ijk", slope) - np.einsum("ijk->ijk", slope)
    )
    matrix = christoffel @ v[0]
    np.testing.assert_allclose(matrix @ v[0], robot.coriolis(q, v)[0], atol=1e-6)
    skew = np.einsum("kij,k->ij", slope, v[0]) - 2.0 * matrix
    np.testing.assert_allclose(skew, -skew.T, atol=1e-7)


def test_forward_undoes_inverse(robot: Robot) -> None:
    n = robot.width
    real = robot.with_joint_parameters(np.full(n, 0.1), np.full(n, 2.0), np.full(n, 1.5))
    q, v, a = states(real)
    effort = real.inverse_dynamics(q, v, a)
    np.testing.assert_allclose(real.forward_dynamics(q, v, effort), a, atol=1e-8)
    np.testing.assert_allclose(
        effort - robot.inverse_dynamics(q, v, a), 0.1 * a + 2.0 * v + 1.5 * np.sign(v) + 0.0, atol=1e-9
    )


def test_one_pose_none_and_many_have_their_shapes(robot: Robot) -> None:
    n = robot.width
    q, v, a = states(robot, 6)
    cube = tuple(x.reshape(2, 3, n) for x in (q, v, a))
    assert robot.inverse_dynamics(*cube).shape == (2, 3, n)
    np.testing.assert_allclose(robot.inverse_dynamics(q[0], v[0], a[0]), robot.inverse_dynamics(*cube)[0, 0])
    np.testing.assert_allclose(robot.mass_matrix(q[0]), robot.mass_matrix(cube[0])[0, 0])
    np.testing.assert_allclose(robot.forward_dynamics(q[0], v[0], a[0]), robot.forward_dynamics(*cube)[0, 0])
    none = np.empty((0, n))
    assert robot.inverse_dynamics(none, none, none).shape == (0, n)
    assert robot.mass_matrix(none).shape == (0, n, n)
    assert robot.regressor(none, none, none).shape == (0, n, n * PER_LINK)
    assert robot.link_jacobian(none, robot.moving_link(robot.joints[0])).shape == (0, 6, n)


def test_joints_left_out_are_held() -> None:
    whole = Robot.bundled("arm7")
    kept = ["arm7_joint6", "arm7_joint2"]
    part = Robot.bundled("arm7", kept)
    rest = np.clip(np.zeros(7), whole.limits.lower, whole.limits.upper)
    columns = [whole.joints.index(joint) for joint in kept]
    q, v, a = states(part)
    position, velocity, acceleration = np.tile(rest, (20, 1)), np.zeros((20, 7)), np.zeros((20, 7))
    position[:, columns], velocity[:, columns], acceleration[:, columns] = q, v, a
    expected = whole.rigid_effort(position, velocity, acceleration)[:, columns]
    np.testing.assert_allclose(part.rigid_effort(q, v, a), expected, atol=1e-9)


def test_a_link_of_a_single_joint_moves_as_it_does_in_the_whole_arm() -> None:
    arm = Robot.bundled("arm2")
    alone, link = Robot.from_urdf(arm.urdf, arm.joints[:1]), arm.moving_link(arm.joints[0])
    q = np.array([[0.3], [-1.1]])
    whole = arm.link_jacobian(np.pad(q, ((0, 0), (0, 1))), link)
    np.testing.assert_allclose(alone.link_jacobian(q, link), whole[:, :, :1], atol=1e-12)


def test_continuous_joints_are_angles_without_limits() -> None:
    turning, bounded = Robot.from_urdf(two_link(kind="continuous")), Robot.from_urdf(two_link())
    q, v, a = states(bounded)
    np.testing.assert_allclose(turning.rigid_effort(q, v, a), bounded.rigid_effort(q, v, a), atol=1e-12)
    np.testing.assert_allclose(turning.gravity(q + 2.0 * np.pi * 40.0), bounded.gravity(q), atol=1e-9)
    for limit in (
        turning.limits.upper,
        -turning.limits.lower,
        turning.limits.effort,
        turning.limits.velocity,
    ):
        np.testing.assert_array_equal(limit, np.inf)
    np.testing.assert_array_equal(bounded.limits.upper, 3.0)
    np.testing.assert_array_equal(bounded.limits.effort, 100.0)
    partly = Robot.from_urdf(two_link(kind="continuous"), ["two"])
    np.testing.assert_allclose(partly.mass_matrix(np.zeros(1)), [[I2 + M2 * C2**2]], atol=1e-12)


def test_tags_of_the_urdf_are_the_joints_friction() -> None:
    arm = Robot.from_urdf(two_link('<dynamics damping="0.7" friction="1.3"/>'))
    np.testing.assert_array_equal(arm.viscous, [0.7, 0.0])
    np.testing.assert_array_equal(arm.coulomb, [1.3, 0.0])
    v = np.array([[2.0, 2.0], [-2.0, 1.0], [0.0, 0.0]])
    np.testing.assert_allclose(arm.friction(np.zeros((3, 2)), v), [[2.7, 0.0], [-2.7, 0.0], [0.0, 0.0]])
    np.testing.assert_array_equal(Robot.from_urdf(two_link('<dynamics damping="0.7"/>')).coulomb, 0.0)
    with pytest.raises(RobotError, match="joint one has damping"):
        Robot.from_urdf(two_link('<dynamics damping="much"/>'))


def test_a_tilted_base_turns_gravity() -> None:
    arm = Robot.from_urdf(two_link(), ["one"])
    q = np.linspace(-1.0, 1.0, 7)[:, None]
    np.testing.assert_allclose(arm.tilted(0.0, 0.2).gravity(q), arm.gravity(q - 0.2), atol=1e-12)
    np.testing.assert_allclose(arm.tilted(0.3, 0.0).gravity(q), np.cos(0.3) * arm.gravity(q), atol=1e-12)
    roll, pitch = 0.3, 0.2
    vector = arm.tilted(roll, pitch).gravity_vector
    base = np.array([np.sin(pitch), -np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)])
    np.testing.assert_allclose(vector, G * base, atol=1e-12)
    np.testing.assert_allclose(arm.tilted(0.3, 0.2).mass_matrix(q), arm.mass_matrix(q))


@pytest.mark.parametrize("name", ["arm7", "sliding"])
def test_a_joint_that_reports_too_much_stands_further_back(name: str) -> None:
    """The inertias, the points and the slides too."""
    arm = sliding_arm() if name == "sliding" else Robot.bundled(name)
    zeros = np.random.default_rng(0).uniform(-0.3, 0.3, arm.width)
    off, (q, v, a) = replace(arm, zeros=zeros), np.random.default_rng(1).normal(size=(3, 20, arm.width))
    np.testing.assert_allclose(off.rigid_effort(q, v, a), arm.rigid_effort(q - zeros, v, a), atol=1e-9)
    np.testing.assert_allclose(off.mass_matrix(q), arm.mass_matrix(q - zeros), atol=1e-9)
    link = arm.moving_link(arm.joints[-1])
    np.testing.assert_allclose(off.link_jacobian(q, link), arm.link_jacobian(q - zeros, link), atol=1e-9)
    again = arm.set_up_as(off.tilted(0.1, 0.2))
    np.testing.assert_allclose(again.gravity(q), arm.tilted(0.1, 0.2).gravity(q - zeros), atol=1e-9)


@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4), (3, 0, 4, 2, 1)])
def test_a_tree_of_joints_in_any_order_is_pinocchios(order: tuple[int, ...]) -> None:
    whole = two_armed()
    robot = Robot.from_urdf(whole.urdf, [whole.joints[k] for k in order])
    model = pin.buildModelFromXML(whole.urdf)
    data, at = model.createData(), [model.idx_vs[model.getJointId(name)] for name in robot.joints]
    generator = np.random.default_rng(0)
    zeros = generator.uniform(-0.2, 0.2, 5)
    off = replace(robot, zeros=zeros)
    for q, v, a in generator.normal(size=(5, 3, 5)):
        own = np.empty((3, 5))
        own[:, at] = q - zeros, v, a
        wanted = pin.rnea(model, data, *own)[at]
        np.testing.assert_allclose(off.rigid_effort(q, v, a), wanted, atol=1e-9)
        regressor = off.regressor(q[None], v[None], a[None])[0]
        np.testing.assert_allclose(regressor @ off.inertials.ravel(), wanted, atol=1e-9)
        mass = pin.crba(model, data, own[0])
        mass = np.triu(mass) + np.triu(mass, 1).T
        np.testing.assert_allclose(off.mass_matrix(q), mass[np.ix_(at, at)], atol=1e-9)


def place(robot: Robot, q: np.ndarray, link: str, point: np.ndarray | None = None) -> np.ndarray:
    """Where a point of a link is (its origin without one), by Pinocchio, (3,) [m]."""
    model, order = robot.pinocchio_model()
    data, values = model.createData(), np.empty(robot.width)
    values[order] = q
    pin.framesForwardKinematics(model, data, values)
    there = data.oMf[model.getFrameId(link, pin.FrameType.BODY)]
    return np.array(there.act(np.zeros(3) if point is None else point))


@pytest.mark.parametrize("point", [None, np.array([0.1, -0.2, 0.3])])
def test_the_jacobian_is_the_slope_of_the_position(robot: Robot, point: np.ndarray | None) -> None:
    q, _, _ = states(robot, 1)
    link = robot.links[-1]
    jacobian = robot.link_jacobian(q, link, point)[0]
    step = 1e-6
    for k, direction in enumerate(np.eye(robot.width)):
        slope = (
            place(robot, q[0] + step * direction, link, point)
            - place(robot, q[0] - step * direction, link, point)
        ) / (2.0 * step)
        np.testing.assert_allclose(jacobian[:3, k], slope, atol=1e-8)


def test_a_point_mass_pulls_through_the_jacobian(robot: Robot) -> None:
    q, _, _ = states(robot, 5)
    link = robot.links[-1]
    body, _, translation = robot.body_of(link)
    mass, (x, y, z) = 1.7, translation
    outer = np.array([y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y])
    inertials = robot.inertials.copy()
    inertials[body] += mass * np.concatenate([[1.0], translation, outer])
    pull = robot.with_inertials(inertials).gravity(q) - robot.gravity(q)
    np.testing.assert_allclose(pull, mass * G * robot.link_jacobian(q, link)[:, 2], atol=1e-9)


def test_links_know_the_body_that_carries_them() -> None:
    arm = Robot.from_urdf(two_link())
    assert arm.links == ("base", "upper", "lower", "tool")
    assert [arm.moving_link(joint) for joint in arm.joints] == ["upper", "lower"]
    body, rotation, translation = arm.body_of("tool")
    assert body == 1
    np.testing.assert_allclose(translation, [0.4, 0.1, 0.2])
    np.testing.assert_allclose(rotation, pin.rpy.rpyToMatrix(0.3, 0.2, 0.1))
    assert Robot.from_urdf(two_link(), ["two", "one"]).body_of("tool")[0] == 0
    with pytest.raises(UsageError, match=r"'base' does not move.*upper, lower"):
        arm.body_of("base")
    with pytest.raises(UsageError, match=r"'upper' does not move.*Moving links are lower"):
        Robot.from_urdf(two_link(), ["two"]).body_of("upper")
    for ask in (arm.body_of, lambda link: arm.link_jacobian(np.zeros((1, 2)), link)):
        with pytest.raises(UsageError, match=r"no link 'hand'.*base, upper, lower, tool"):
            ask("hand")
    with pytest.raises(UsageError, match="no joint 'three'"):
        arm.moving_link("three")


@pytest.mark.parametrize("name", BUNDLED)
def test_links_make_up_their_bodies(name: str) -> None:
    arm = Robot.bundled(name)
    total = np.zeros_like(arm.inertials)
    for link in arm.links:
        try:
            body, inertials = link_inertial(arm, link)
        except UsageError:
            continue
        total[body] += inertials
    np.testing.assert_allclose(total, arm.inertials, atol=1e-10)


def test_a_joint_without_mass_carries_nothing() -> None:
    text = (
        two_link()
        .replace('<mass value="2.0"/>', '<mass value="0"/>')
        .replace('iyy="0.07" iyz="0" izz="0.07"', 'iyy="0" iyz="0" izz="0"')
        .replace('ixx="0.01"', 'ixx="0"')
    )
    arm = Robot.from_urdf(text)
    q, v, a = states(arm)
    np.testing.assert_allclose(arm.rigid_effort(q, v, a)[:, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(arm.gravity(q)[:, 0], M1 * C1 * G * np.cos(q[:, 0]), atol=1e-10)


def test_a_copy_is_the_same_robot() -> None:
    arm = Robot.bundled("arm7").with_joint_parameters(armature=np.ones(7))
    q, v, a = states(arm)
    before = arm.inverse_dynamics(q, v, a)
    np.testing.assert_array_equal(copy.deepcopy(arm).inverse_dynamics(q, v, a), before)


def test_threads_that_read_descriptions_leave_stderr_where_it_was() -> None:
    """Each put back what it had found, which may have been the other's."""
    before, said, entered = os.readlink("/proc/self/fd/2"), [], threading.Event()

    def other() -> None:
        with _overheard(said):
            entered.set()
            os.write(2, b"Error: theirs\n")

    thread = threading.Thread(target=other)
    with _overheard([]):
        thread.start()
        assert not entered.wait(0.2)
    thread.join()
    assert os.readlink("/proc/self/fd/2") == before and said == ["theirs"]


def test_what_others_write_while_a_description_is_read_comes_out(capfd: pytest.CaptureFixture[str]) -> None:
    """Log lines of other threads were lost."""
    said: list[str] = []
    with _overheard(said):
        os.write(2, b"a log line\nError:   a complaint\n         at line 7 in model.cpp\nhalf")
    assert said == ["a complaint"] and capfd.readouterr().err == "a log line\nhalf"


def test_a_description_is_read_where_no_file_can_be_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A disk without room ended every command and the node."""
    with monkeypatch.context() as patch:  # pytest itself needs files later
        patch.setattr("tempfile.tempdir", str(tmp_path / "nowhere"))
        assert Robot.from_urdf(two_link() + "<!-- on no disk -->").joints == ("one", "two")
        with pytest.raises(RobotError, match="No link elements"):
            Robot.from_urdf("<robot name='on_no_disk'/>")
    assert capfd.readouterr().err == ""


def test_without_any_file_a_description_is_refused_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def none_left(*_: object) -> int:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    monkeypatch.setattr(os, "memfd_create", none_left)
    with pytest.raises(RobotError, match=r"cannot be read \(Too many open files\)"):
        Robot.from_urdf(two_link() + "<!-- no file left -->")


def test_a_system_without_files_in_memory_takes_one_on_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "memfd_create")
    with pytest.raises(RobotError, match="No link elements"):
        Robot.from_urdf("<robot name='on_disk'/>")


def test_a_description_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each change of a robot's parameters read it anew, and took the process's stderr for as long."""
    read, build, text = [], pin.buildModelFromXML, two_link() + "<!-- read nowhere else -->"

    def counted(xml: str) -> pin.Model:
        read.append(xml)
        return build(xml)

    monkeypatch.setattr(pin, "buildModelFromXML", counted)
    arm = Robot.from_urdf(text)
    q, v, a = states(arm)
    before = arm.rigid_effort(q, v, a)
    others = [arm.with_inertials(2.0 * arm.inertials), arm.tilted(0.3, 0.4), Robot.from_urdf(text, ["one"])]
    for other in others:
        other.rigid_effort(*states(other))
    for same in (Robot.from_urdf(text), replace(arm)):  # nobody changed what is kept
        np.testing.assert_array_equal(same.rigid_effort(q, v, a), before)
    assert len(read) == 1


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("garbage", "syntax error"),
        ("", "description is empty"),
        ("<html/>", "not <robot>"),
        ("<robot name='x'/>", "No link elements"),
        (two_link().replace('type="revolute"', 'type="wobbly"'), "no known type"),
        (
            two_link().replace('<limit lower="-3" upper="3" effort="100" velocity="5"/>', ""),
            "does not specify limits",
        ),
        (two_link().replace('type="revolute"', 'type="floating"'), "more than one degree of freedom"),
        (two_link().replace('type="revolute"', 'type="fixed"'), "no movable joint"),
    ],
)
def test_an_unusable_description_says_why(text: str, reason: str, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RobotError, match=reason) as caught:
        Robot.from_urdf(text)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""


def test_joints_and_files_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="no movable joint three; it has one, two"):
        Robot.from_urdf(two_link(), ["one", "three"])
    with pytest.raises(RobotError, match="cannot be read"):
        Robot.from_file(tmp_path / "none.urdf")
    with pytest.raises(UsageError, match="No bundled robot 'arm9'"):
        Robot.bundled("arm9")
    (tmp_path / "arm.urdf").write_text(two_link())
    assert Robot.from_file(tmp_path / "arm.urdf").joints == ("one", "two")


@pytest.mark.parametrize("name", ["it's", 'a "b"', "x]/y['z"])
def test_names_may_hold_quotes_and_brackets(name: str) -> None:
    quoted = name.replace("'", "&apos;").replace('"', "&quot;")
    robot = Robot.from_urdf(two_link().replace('<joint name="one"', f'<joint name="{quoted}"'))
    assert robot.moving_link(name) == Robot.from_urdf(two_link()).moving_link("one")
    link = robot.moving_link("two")
    renamed = Robot.from_urdf(two_link().replace(f'"{link}"', f'"{quoted}"'))
    assert link_inertial(renamed, name)[1] == pytest.approx(link_inertial(robot, link)[1])


@pytest.mark.parametrize("kind", ["planar", "floating"])
@pytest.mark.parametrize(("joints", "held"), [(("two", "one"), {}), (("two",), {"one": 0.4})])
def test_joints_of_more_degrees_of_freedom_are_held_where_others_are_named(
    kind: str, joints: tuple[str, ...], held: dict[str, float]
) -> None:
    """A base that may roam, before the arm, and what hangs at its end, as if they were fixed."""

    def text(kind: str) -> str:
        return two_link().replace(
            "</robot>",
            f"""<link name="world"/><joint name="base_joint" type="{kind}"><parent link="world"/><child link="base"/>
            <origin xyz="0 0 1" rpy="0.3 0.2 0"/><axis xyz="0 0 1"/></joint>
            <link name="camera"><inertial><origin xyz="0.1 0 0"/><mass value="0.7"/>
            <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
            <joint name="mount" type="{kind}"><parent link="lower"/><child link="camera"/>
            <origin xyz="0.2 0.1 0"/><axis xyz="0 0 1"/></joint></robot>""",
        )

    free, fixed = (Robot.from_urdf(text(one), joints, held) for one in (kind, "fixed"))
    assert free.joints == joints
    np.testing.assert_array_equal(free.limits.upper, fixed.limits.upper)
    np.testing.assert_allclose(free.inertials, fixed.inertials, atol=1e-12)
    motion = states(free)
    np.testing.assert_allclose(free.rigid_effort(*motion), fixed.rigid_effort(*motion), atol=1e-10)
    assert Robot.from_urdf(text(kind)).joints == ("one", "two")
    with pytest.raises(RobotError, match=r"more than one degree of freedom \(base_joint, mount\).*--joints"):
        Robot.from_urdf(text(kind), ("one", "mount"))


def test_joints_that_are_left_out_stand_where_they_are_held() -> None:
    whole = Robot.bundled("arm7")
    chosen, out = whole.joints[:3], whole.joints[3:]
    held = dict(zip(out, [-2.0, 0.3, 1.8, 0.7], strict=True))
    robot = Robot.from_urdf(whole.urdf, chosen, held)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3))
    pose = np.concatenate([q, np.tile(list(held.values()), (20, 1))], axis=1)
    np.testing.assert_allclose(robot.gravity(q), whole.gravity(pose)[:, :3], atol=1e-10)
    np.testing.assert_allclose(
        robot.mass_matrix(q) - np.diag(robot.armature), (whole.mass_matrix(pose))[:, :3, :3], atol=1e-10
    )
    again = robot_from_state(*robot_state(robot))
    assert again.held == robot.held
    np.testing.assert_array_equal(again.gravity(q), robot.gravity(q))


def test_a_description_without_a_joint_that_moves_is_refused_in_one_clean_sentence():
    with pytest.raises(RobotError, match=r"^The URDF has no movable joint\."):
        Robot.from_urdf('<robot name="box"><link name="box"/></robot>')


def test_what_ros2_control_says_of_a_joint_is_not_the_joint_itself():
    urdf = two_link('<dynamics damping="0.5" friction="0.7"/>')
    control = '<ros2_control name="s" type="system"><joint name="one"/></ros2_control>'
    robot = Robot.from_urdf(urdf.replace("</robot>", control + "</robot>"))
    assert robot.viscous[0] == 0.5 and robot.coulomb[0] == 0.7


def test_zeros_are_taken_over_by_the_joint_s_name():
    robot = Robot.from_urdf(two_link())
    other = replace(Robot.from_urdf(two_link(), ("two", "one")), zeros=np.array([0.2, 0.1]))
    assert robot.set_up_as(other).zeros.tolist() == [0.1, 0.2]


def test_bindings_without_openmp_have_all_that_a_robot_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a Linux distribution may be built without: they have neither the loop over rows nor its memory."""
    many = np.random.default_rng(0).normal(size=(3, MANY, 7))
    expected = Robot.bundled("arm7").rigid_effort(*many)
    monkeypatch.delattr(pin, "ModelPool")
    monkeypatch.delattr(pin, "rneaInParallel")
    monkeypatch.setattr("bdnn_ros.robot.rows.HAS_LOOP", False)
    np.testing.assert_array_equal(Robot.bundled("arm7").rigid_effort(*many), expected)


def test_a_robot_that_nobody_holds_is_gone_without_the_collector() -> None:
    """A node has one with each version it serves, and takes what outlives a collection for lasting."""
    robot, many = Robot.bundled("arm7"), np.zeros((3, MANY, 7))
    gc.collect()
    gc.disable()
    try:
        robot.rigid_effort(*many), robot.mass_matrix(many[0]), robot.coriolis(many[0], many[1])
        held = weakref.ref(robot)
        del robot
        assert held() is None
    finally:
        gc.enable()


@pytest.mark.parametrize("name", ["arm2", "arm7"])
def test_the_effort_of_many_rows_is_that_of_each_and_leaves_torch_its_threads(name: str) -> None:
    robot, rng, threads = Robot.bundled(name), np.random.default_rng(0), torch.get_num_threads()
    q, v, a = rng.normal(size=(3, MANY + 10, robot.width))
    torch.set_num_threads(3)
    try:
        many = robot.rigid_effort(q, v, a)
        assert torch.get_num_threads() == 3
    finally:
        torch.set_num_threads(threads)
    np.testing.assert_array_equal(many, [robot.rigid_effort(*row) for row in zip(q, v, a, strict=True)])
    np.testing.assert_array_equal(many[:5], robot.rigid_effort(q[:5], v[:5], a[:5]))
    alone = Robot.bundled(name, robot.joints[:1])
    assert alone.rigid_effort(q[:, :1], v[:, :1], a[:, :1]).shape == (MANY + 10, 1)
    assert robot.rigid_effort(*np.zeros((3, 0, robot.width))).shape == (0, robot.width)


@pytest.mark.parametrize("joints", [(), ("arm2_joint2",)])
def test_derivatives_by_the_setup_are_those_of_positions_and_of_gravity(joints: tuple[str, ...]) -> None:
    robot = Robot.bundled("arm2", joints).tilted(0.3, -0.2)
    motion = np.random.default_rng(0).normal(size=(3, 4, robot.width))
    by_position, by_gravity = robot.setup_derivatives(*motion)
    np.testing.assert_allclose(by_position, robot.effort_derivatives(*motion)[0])
    for axis, unit in enumerate(np.eye(3)):
        gained = replace(robot, gravity_vector=unit).gravity(motion[0])
        np.testing.assert_allclose(by_gravity[:, :, axis], gained, atol=1e-12)
