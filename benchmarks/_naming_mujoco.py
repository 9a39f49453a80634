"""Recordings of robots that MuJoCo moves, with something hidden in them: none of our simulation is in these."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import Trajectory, fourier

STEP = 0.001
ROBOTS = ("arm2", "arm6", "arm7")
HIDDEN = (
    "nothing",
    "coulomb_friction",
    "viscous_friction",
    "armature",
    "joint_spring",
    "payload",
    "base_tilt",
    "effort_offset",
    "effort_scale",
    "effort_delay",
    "external_wrench",
    "quadratic_drag",
    "cogging",
    "position_offset",
)
SHARE = (0.08, 0.4)
"""Size of what is hidden, per spread of the joint's effort."""
WEAR = (0.05, 0.2)
"""The same of each part of the wear."""
WORN = 0.5
"""Share of robots that are worn."""
CREEP = 0.05
"""The controller expects all of the friction above this speed [rad/s]."""


@dataclass(frozen=True)
class Drawn:
    """One recording to be made.

    Attributes:
        hidden: name of the effect, or nothing.
        wrong: links are off by about this share.
        worn: whether every joint has friction and a rotor besides.
        rate: of the recording [Hz].
        noise: of the effort, per spread of each joint's.
        encoder: noise of the position [rad].
    """

    seed: int
    robot: str
    hidden: str
    wrong: float
    worn: bool
    rate: int
    duration: float
    noise: float
    encoder: float


@dataclass
class Real:
    """What the robot in MuJoCo is like, beyond its description, (n,) each.

    Attributes:
        push: force on the last body's centre of mass in the world's axes, its start and its end.
        ripple: amplitude, periods a revolution and phase of each joint's cogging, (n, 3).
        late: steps after which a command acts.
        shift: of the measured position [rad].
    """

    friction: np.ndarray
    damping: np.ndarray
    rotor: np.ndarray
    spring: np.ndarray
    rest: np.ndarray
    drag: np.ndarray
    offset: np.ndarray
    scale: np.ndarray
    shift: np.ndarray
    ripple: np.ndarray
    payload: pin.Inertia | None = None
    gravity: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    late: int = 0
    push: tuple[np.ndarray, float, float] | None = None

    @classmethod
    def like(cls, width: int) -> Real:
        """As described."""
        wear, more, sensors = (np.zeros((count, width)) for count in (3, 3, 2))
        offset, shift = sensors
        return cls(*wear, *more, offset, np.ones(width), shift, np.zeros((width, 3)))


@dataclass(frozen=True)
class Usual:
    """Spread of each joint's effort along a motion, and that per spread of its velocity and of its acceleration, (n,)."""

    effort: np.ndarray
    per_speed: np.ndarray
    per_acceleration: np.ndarray


def drawn(seed: int) -> Drawn:
    """The recording of a seed; robots and effects take turns."""
    rng = np.random.default_rng([seed, *b"mujoco"])
    return Drawn(
        seed,
        ROBOTS[seed % len(ROBOTS)],
        HIDDEN[(seed // len(ROBOTS)) % len(HIDDEN)],
        float(rng.choice([0.0, 0.03, 0.05])),
        bool(rng.random() < WORN),
        int(rng.choice([100, 125, 200, 250, 500])),
        float(rng.choice([25.0, 30.0, 40.0])),
        float(np.exp(rng.uniform(np.log(0.002), np.log(0.015)))),
        float(np.exp(rng.uniform(np.log(5e-6), np.log(1e-4)))),
    )


def made(draw: Drawn) -> tuple[Recording, dict[str, Any]]:
    """The recording of a draw, and its truth in the form of truth.yaml."""
    robot = Robot.bundled(draw.robot)
    rng = np.random.default_rng([draw.seed, *b"robot"])
    time = np.arange(round(draw.duration / STEP)) * STEP
    plan = fourier(robot, time, rng)
    real, truth = _real(draw, robot, plan, rng)
    return _moved(draw, robot, real, plan, rng), truth


def _real(
    draw: Drawn, robot: Robot, plan: Trajectory, rng: np.random.Generator
) -> tuple[Real, dict[str, Any]]:
    """The robot with its wear and what is hidden in it."""
    real, n = Real.like(robot.width), robot.width
    effort = robot.rigid_effort(plan.position, plan.velocity, plan.acceleration).std(axis=0)
    usual = Usual(effort, effort / plan.velocity.std(axis=0), effort / plan.acceleration.std(axis=0))
    worn = None
    if draw.worn:
        real.friction, real.damping, real.rotor = (
            unit * rng.uniform(*WEAR, n) for unit in (usual.effort, usual.per_speed, usual.per_acceleration)
        )
        parts = zip(real.friction.tolist(), real.damping.tolist(), real.rotor.tolist(), strict=True)
        worn = {
            joint: dict(zip(("coulomb", "viscous", "armature"), values, strict=True))
            for joint, values in zip(robot.joints, parts, strict=True)
        }
    truth: dict[str, Any] = {"effects": [], "worn": worn, "links": {}}
    if draw.hidden == "nothing":
        return real, truth
    # a zero that is off shows neither about a vertical nor about the last link's own axis
    j = int(rng.integers(1, max(n - 1, 2)) if draw.hidden == "position_offset" else rng.integers(n))
    parameters = _hidden(draw.hidden, real, j, usual, plan, rng)
    on_link = draw.hidden in ("payload", "external_wrench")
    one = {"effect": draw.hidden, "variant": "link" if draw.hidden == "external_wrench" else ""}
    one |= {"link": robot.moving_link(robot.joints[-1]) if on_link else None}
    one |= {"joint": None if on_link or draw.hidden in ("base_tilt", "effort_delay") else robot.joints[j]}
    return real, {**truth, "effects": [{**one, "parameters": parameters}]}


def _hidden(
    name: str, real: Real, j: int, usual: Usual, plan: Trajectory, rng: np.random.Generator
) -> dict[str, float]:
    """Parameters of what is hidden at a joint, put into the robot."""
    share, sign = float(np.exp(rng.uniform(*np.log(SHARE)))), float(rng.choice([-1.0, 1.0]))
    effort, speed = share * float(usual.effort[j]), plan.velocity[:, j]
    match name:
        case "coulomb_friction":
            real.friction[j] += effort
            return {"coulomb": effort}
        case "viscous_friction":
            real.damping[j] += share * usual.per_speed[j]
            return {"viscous": share * float(usual.per_speed[j])}
        case "armature":
            real.rotor[j] += share * usual.per_acceleration[j]
            return {"armature": share * float(usual.per_acceleration[j])}
        case "quadratic_drag":
            real.drag[j] = effort / float(np.std(np.abs(speed) * speed))
            return {"drag": float(real.drag[j])}
        case "joint_spring":
            real.spring[j], real.rest[j] = effort / plan.position[:, j].std(), rng.uniform(-1.0, 1.0)
            return {"stiffness": float(real.spring[j]), "rest": float(real.rest[j])}
        case "cogging":
            real.ripple[j] = effort, rng.choice([6.0, 8.0, 12.0, 18.0]), rng.uniform(-3.0, 3.0)
            return dict(zip(("amplitude", "periods_per_rev", "phase"), real.ripple[j].tolist(), strict=True))
        case "effort_offset":
            real.offset[j] = sign * effort
            return {"offset": float(real.offset[j])}
        case "effort_scale":
            real.scale[j] = math.exp(sign * rng.uniform(0.1, 0.3))
            return {"scale": float(real.scale[j])}
        case "position_offset":
            real.shift[j] = sign * rng.uniform(0.03, 0.12)
            return {"offset": float(real.shift[j])}
        case "effort_delay":
            real.late = int(rng.integers(10, 20))
            return {"delay": real.late * STEP}
        case "payload":
            mass = float(rng.uniform(0.5, 2.0))
            centre = np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.0, 0.12)])
            real.payload = pin.Inertia(mass, centre, np.zeros((3, 3)))
            return {"mass": mass, **dict(zip(("com_x", "com_y", "com_z"), centre.tolist(), strict=True))}
        case "base_tilt":
            roll, pitch = rng.uniform(-5.0, 5.0, 2)
            about_x, about_y = ((math.radians(roll), 0.0, 0.0), (0.0, math.radians(pitch), 0.0))
            real.gravity = (pin.rpy.rpyToMatrix(*about_y) @ pin.rpy.rpyToMatrix(*about_x)).T @ real.gravity
            return {"roll_deg": float(roll), "pitch_deg": float(pitch)}
        case "external_wrench":
            force, start = rng.standard_normal(3), float(rng.uniform(3.0, 15.0))
            force *= rng.uniform(5.0, 15.0) / np.linalg.norm(force)
            real.push = (force, start, start + float(rng.uniform(2.0, 6.0)))
            components = dict(zip(("force_x", "force_y", "force_z"), force.tolist(), strict=True))
            return {"start": start, "end": real.push[2], **components}
    raise ValueError(name)


def _moved(draw: Drawn, robot: Robot, real: Real, plan: Trajectory, rng: np.random.Generator) -> Recording:
    """What sensors see of the robot under computed torque; its controller knows the wear, as a tuned one does."""
    model = _model(draw, robot, real, rng)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = plan.position[0], plan.velocity[0]
    bandwidth, every = 2.0 * math.pi * rng.uniform(3.0, 6.0), round(1.0 / (draw.rate * STEP))
    rows, waiting = [], deque([np.zeros(robot.width)] * (real.late + 1), real.late + 1)
    command = np.zeros(robot.width)
    for k in range(len(plan.time)):
        q, v = data.qpos.copy(), data.qvel.copy()
        if k % 2 == 0:
            wanted = plan.acceleration[k] + bandwidth**2 * (plan.position[k] - q)
            wanted += 2.0 * bandwidth * (plan.velocity[k] - v)
            command = robot.rigid_effort(q[None], v[None], wanted[None])[0] + real.rotor * wanted
            command += real.damping * v + real.friction * np.tanh(plan.velocity[k] / CREEP)
        if k % every == 0:
            rows.append(np.concatenate([q, v, command]))
        waiting.append(command)
        amplitude, periods, phase = real.ripple.T
        data.qfrc_applied[:] = (
            waiting[0] - real.drag * np.abs(v) * v - amplitude * np.sin(periods * q + phase)
        )
        if real.push is not None:
            data.xfrc_applied[-1, :3] = real.push[0] * (real.push[1] <= plan.time[k] < real.push[2])
        mujoco.mj_step(model, data)
    return _sensed(draw, robot, real, np.array(rows), rng)


def _model(draw: Drawn, robot: Robot, real: Real, rng: np.random.Generator) -> mujoco.MjModel:
    """MuJoCo's robot: its links are off, and it has the wear, the spring, the payload and the tilt of the real one."""
    model = mujoco.MjModel.from_xml_string(robot.urdf)
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.gravity[:] = real.gravity
    heavier = 1.0 + draw.wrong * np.clip(rng.standard_normal(model.nbody), -2.0, 2.0)
    model.body_mass *= heavier
    model.body_inertia *= heavier[:, None]
    model.body_ipos *= 1.0 + draw.wrong * np.clip(rng.standard_normal((model.nbody, 3)), -2.0, 2.0)
    if real.payload is not None:
        turn = pin.Quaternion(*model.body_iquat[-1]).toRotationMatrix()
        own = turn @ np.diag(model.body_inertia[-1]) @ turn.T
        both = pin.Inertia(float(model.body_mass[-1]), model.body_ipos[-1].copy(), own) + real.payload
        sizes, axes = np.linalg.eigh(both.inertia)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        model.body_mass[-1], model.body_ipos[-1], model.body_inertia[-1] = both.mass, both.lever, sizes
        model.body_iquat[-1] = pin.Quaternion(axes).coeffs()[[3, 0, 1, 2]]
    model.dof_frictionloss[:], model.dof_damping[:], model.dof_armature[:] = (
        real.friction,
        real.damping,
        real.rotor,
    )
    model.jnt_stiffness[:], model.qpos_spring[:] = real.spring, real.rest
    return model


def _sensed(draw: Drawn, robot: Robot, real: Real, rows: np.ndarray, rng: np.random.Generator) -> Recording:
    """Rows of position, velocity and command (M, 3 n) as the sensors report them."""
    position, velocity, command = np.split(rows, 3, axis=1)
    noise = rng.standard_normal((3, *position.shape))
    measured = (command - real.offset) / real.scale
    return Recording(
        np.arange(len(rows)) / draw.rate,
        robot.joints,
        position + real.shift + draw.encoder * noise[0],
        velocity + 2e-3 * noise[1],
        measured + draw.noise * measured.std(axis=0) * noise[2],
    )
