"""What sensors report of a motion that MuJoCo made, and motors before gears that give."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import fourier

STEP, RATE, DURATION = 0.0005, 500, 16.0
BANDWIDTH = 2.0 * np.pi * 4.0


def sensed(
    robot: Robot,
    rows: list[np.ndarray],
    rate: float,
    generator: np.random.Generator,
    stds: tuple[float, float, float] = (2e-5, 2e-3, 0.005),
    of: Callable[..., np.ndarray] = np.std,
) -> Recording:
    """A recording of rows of position, velocity and command, (3 n,) each, with noise.

    Args:
        stds: of the noise of positions, velocities, and the effort as a share of its size.
        of: that size, of each joint's effort.
    """
    position, velocity, effort = np.split(np.array(rows), 3, axis=1)
    noise = generator.standard_normal((3, *position.shape))
    return Recording(
        np.arange(len(rows)) / rate,
        robot.joints,
        position + stds[0] * noise[0],
        velocity + stds[1] * noise[1],
        effort + stds[2] * of(effort, axis=0) * noise[2],
    )


def geared(
    robot: Robot,
    joint: int,
    rotor: float,
    seed: int,
    wear: tuple[float, float] = (0.0, 0.0),
    spring: tuple[float, float] = (0.0, 0.0),
    duration: float = DURATION,
    **gear: Any,
) -> Recording:
    """A motor with a rotor of its own before a gear and its link, under computed torque, as sensors see it.

    Args:
        wear: Coulomb and viscous friction of the motor [N·m], [N·m·s/rad].
        spring: stiffness and damping of the joint between motor and link [N·m/rad], [N·m·s/rad].
        gear: what else that joint has, as MuJoCo calls it.
    """
    generator = np.random.default_rng(seed)
    spec = mujoco.MjSpec.from_string(robot.urdf)
    motor = spec.joint(robot.joints[joint])
    motor.armature = rotor
    motor.parent.add_joint(
        name="gear", type=mujoco.mjtJoint.mjJNT_HINGE, axis=list(motor.axis), pos=list(motor.pos), **gear
    )
    model = spec.compile()
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    worn, bent = (model.joint(name) for name in (robot.joints[joint], "gear"))
    worn.frictionloss, worn.damping = wear
    bent.stiffness, bent.damping = spring
    model.body_mass *= 1.0 + generator.uniform(-0.05, 0.05, model.nbody)
    names = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in robot.joints]
    at, moving = model.jnt_qposadr[names], model.jnt_dofadr[names]
    time = np.arange(round(duration / STEP)) * STEP
    plan = fourier(robot, time, np.random.default_rng(seed + 100))
    data = mujoco.MjData(model)
    data.qpos[at] = plan.position[0]
    rotors, rows = rotor * np.eye(robot.width)[joint], []
    for k in range(len(time)):
        if k % round(1.0 / (RATE * STEP)) == 0:
            q, v = data.qpos[at], data.qvel[moving]
            error, rate = plan.position[k] - q, plan.velocity[k] - v
            wanted = plan.acceleration[k] + BANDWIDTH**2 * error + 2.0 * BANDWIDTH * rate
            command = robot.rigid_effort(q[None], v[None], wanted[None])[0] + rotors * wanted
            rows.append(np.concatenate([q, v, command]))
        data.qfrc_applied[moving] = command
        mujoco.mj_step(model, data)
    return sensed(robot, rows, RATE, generator, (5e-5, 1e-3, 0.005), np.ptp)
