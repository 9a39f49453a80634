"""Causes hidden in another simulator than the one that draws them elsewhere: MuJoCo's own joints, its own integrator."""

from __future__ import annotations

from collections import deque

import mujoco
import numpy as np
import pytest
from mujoco_cases import sensed

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.diagnosis.result import Diagnosis
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import fourier

STEP, RATE, DURATION = 0.001, 500, 25.0
PUSH = (9.3, 14.6)
BANDWIDTH, CREEP = 2.0 * np.pi * 5.0, 0.05


def joint_values(robot: Robot, seed: int, share: float, motion: np.ndarray) -> np.ndarray:
    """About a share of each joint's usual effort, per unit of motion."""
    generator = np.random.default_rng(seed)
    return share * motion * generator.uniform(0.5, 1.5, robot.width)


def recorded(
    robot: Robot,
    friction: np.ndarray,
    damping: np.ndarray,
    armature: np.ndarray,
    drag: np.ndarray,
    late: int = 0,
    push: np.ndarray | None = None,
) -> Recording:
    """A robot whose links are off by up to 5 %, under computed torque along a Fourier motion, as sensors see it.

    Args:
        late: steps after which a command acts.
        push: force on the last body's centre of mass from `PUSH` on, in the world's axes [N].
    """
    generator = np.random.default_rng(3)
    model = mujoco.MjModel.from_xml_string(robot.urdf)
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.body_mass *= 1.0 + generator.uniform(-0.05, 0.05, model.nbody)
    model.dof_frictionloss[:], model.dof_damping[:], model.dof_armature[:] = friction, damping, armature
    time = np.arange(round(DURATION / STEP)) * STEP
    plan = fourier(robot, time, np.random.default_rng(4))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = plan.position[0], plan.velocity[0]
    rows, command, waiting = [], np.zeros(robot.width), deque([np.zeros(robot.width)] * (late + 1), late + 1)
    for k in range(len(time)):
        if k % round(1.0 / (RATE * STEP)) == 0:
            error, rate = plan.position[k] - data.qpos, plan.velocity[k] - data.qvel
            wanted = plan.acceleration[k] + BANDWIDTH**2 * error + 2.0 * BANDWIDTH * rate
            rigid = robot.rigid_effort(data.qpos[None], data.qvel[None], wanted[None])[0]
            ahead = friction * np.tanh(plan.velocity[k] / CREEP)
            command = rigid + armature * wanted + damping * data.qvel + ahead
            rows.append(np.concatenate([data.qpos, data.qvel, command]))
        waiting.append(command)
        data.qfrc_applied[:] = waiting[0] - drag * np.abs(data.qvel) * data.qvel
        if push is not None:
            data.xfrc_applied[-1, :3] = push * (PUSH[0] <= time[k] < PUSH[1])
        mujoco.mj_step(model, data)
    return sensed(robot, rows, RATE, generator)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.bundled("arm6")


def usual_of(robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spread of each joint's effort, and that per velocity and per acceleration."""
    time = np.arange(0.0, DURATION, 0.01)
    plan = fourier(robot, time, np.random.default_rng(4))
    effort = robot.rigid_effort(plan.position, plan.velocity, plan.acceleration).std(axis=0)
    return effort, effort / plan.velocity.std(axis=0), effort / plan.acceleration.std(axis=0)


@pytest.fixture(scope="module")
def usual(robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return usual_of(robot)


def of_kind(diagnosis: Diagnosis, effect: str) -> dict[str | None, float]:
    """The first parameter of each finding of a kind, by joint."""
    found = [finding for finding in diagnosis.findings if finding.effect == effect]
    return {finding.joint: next(iter(finding.parameters.values())).value for finding in found}


@pytest.mark.slow
def test_links_that_are_slightly_off_are_no_cause(robot):
    none = np.zeros(6)
    diagnosis = diagnose([recorded(robot, none, none, none, none)], robot)
    assert diagnosis.findings == () and diagnosis.verdict == "nothing_wrong"


@pytest.mark.slow
def test_wear_and_a_drag_are_all_that_is_named(robot, usual):
    friction, damping, armature = (
        joint_values(robot, seed, share, motion)
        for seed, share, motion in zip((1, 2, 3), (0.1, 0.1, 0.1), usual, strict=True)
    )
    drag = np.array([0.0, 0.0, 0.3 * usual[0][2], 0.0, 0.0, 0.0])
    diagnosis = diagnose([recorded(robot, friction, damping, armature, drag)], robot)
    assert {finding.effect for finding in diagnosis.findings} == {
        *("coulomb_friction", "viscous_friction", "armature", "quadratic_drag"),
    }
    assert of_kind(diagnosis, "quadratic_drag") == {robot.joints[2]: pytest.approx(drag[2], rel=0.1)}
    for effect, true in (("coulomb_friction", friction), ("armature", armature)):
        assert of_kind(diagnosis, effect) == {
            joint: pytest.approx(value, rel=0.05) for joint, value in zip(robot.joints, true, strict=True)
        }


@pytest.mark.slow
def test_a_push_at_the_centre_of_mass_is_one_finding(robot):
    """Simulators push there, not at the origin of the link's frame: the torque about that turns with the link."""
    none, force = np.zeros(6), np.array([-12.0, 7.0, -9.0])
    (finding,) = diagnose([recorded(robot, none, none, none, none, push=force)], robot).findings
    values = {name: quantity.value for name, quantity in finding.parameters.items()}
    assert (finding.effect, finding.link) == ("external_wrench", "arm6_link6")
    assert [values["start"], values["end"]] == pytest.approx(PUSH, abs=0.02)
    assert [values[f"force_{axis}"] for axis in "xyz"] == pytest.approx(force, rel=0.03)
    assert [values[f"torque_{axis}"] for axis in "xyz"] == pytest.approx([0.0, 0.0, 0.0], abs=0.02)
    assert values["point_z"] > 0.05


@pytest.mark.slow
def test_a_delay_is_as_long_as_it_is(robot):
    """The lead that is a nuisance takes nothing of it, and gives nothing to it."""
    none = np.zeros(6)
    (finding,) = diagnose([recorded(robot, none, none, none, none, late=14)], robot).findings
    delay = finding.parameters["delay"]
    assert (finding.effect, finding.joint) == ("effort_delay", None)
    assert delay.value == pytest.approx(0.014, abs=0.5 / RATE) and delay.std < 0.5 / RATE


@pytest.mark.slow
def test_a_delay_of_worn_joints_leaves_their_friction_what_it_is():
    """What sticks turns round late; ahead of the motion it does so earlier, and no bristle bends."""
    robot = Robot.bundled("arm2")
    friction, damping, armature = (
        joint_values(robot, seed, 0.2, motion)
        for seed, motion in zip((1, 2, 3), usual_of(robot), strict=True)
    )
    diagnosis = diagnose([recorded(robot, friction, damping, armature, np.zeros(2), late=19)], robot)
    assert {finding.effect for finding in diagnosis.findings} == {
        *("coulomb_friction", "viscous_friction", "armature", "effort_delay"),
    }
    assert of_kind(diagnosis, "coulomb_friction") == {
        joint: pytest.approx(value, rel=0.1) for joint, value in zip(robot.joints, friction, strict=True)
    }
