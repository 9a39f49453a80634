"""Robots that MuJoCo moves: their links, joints, transmissions and sensors are not as described."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import mujoco
import numpy as np
import pinocchio as pin
from scipy.signal import lfilter

from bdnn_ros.errors import DataError
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import Trajectory

STEP = 0.001
"""Of the integrator [s]; the controller acts at every second one."""
CREEP = 0.05
"""The controller expects all of the friction above this speed [rad/s]."""
SOFTLY = (0.02, 0.002)
"""Damping of a soft transmission per stiffness [s], and time in which the side of a gap stops a link [s]."""

Level = Callable[[float, float, float], float]
"""Dry friction [N·m] at a time [s], a speed [rad/s] and under an effort [N·m]."""
LOST = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)
"""Warnings after which MuJoCo begins anew from rest."""


@dataclass
class Real:
    """What the robot in MuJoCo is like, beyond its description, (n,) each.

    Attributes:
        push: force in the world's axes, the point of the last body that it acts at, its start and its end.
        ripple: amplitude, periods a revolution and phase of each joint's cogging, (n, 3).
        late: steps after which a command acts.
        shift: of the measured position [rad].
        level: a joint and its dry friction, instead of a constant.
        bristle: a joint, the force of its pre-sliding friction and the way it takes.
        give: a joint, the stiffness of its transmission, and its gap [rad], each with none of the other.
        slow: a joint and the cutoff of its reported velocity [Hz].
        link: a link and by how much it is heavier than described.
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
    push: tuple[np.ndarray, np.ndarray, float, float] | None = None
    level: tuple[int, Level] | None = None
    bristle: tuple[int, float, float] | None = None
    give: tuple[int, float, float] | None = None
    slow: tuple[int, float] | None = None
    link: tuple[str, float] | None = None

    @classmethod
    def like(cls, width: int) -> Real:
        """As described."""
        wear, more, sensors = (np.zeros((count, width)) for count in (3, 3, 2))
        offset, shift = sensors
        return cls(*wear, *more, offset, np.ones(width), shift, np.zeros((width, 3)))


def moved(
    robot: Robot, real: Real, heavier: tuple[float, np.random.Generator], plan: Trajectory, bandwidth: float
) -> np.ndarray:
    """Position, velocity and command at every step under computed torque, (N, 3 n).

    The controller knows the wear, as a tuned one does.

    Args:
        heavier: by what share masses and centres are off, and what draws that.
        bandwidth: of the controller [rad/s].
    """
    model = _model(robot, real, *heavier)
    data = mujoco.MjData(model)
    at, to = (addresses[_motors(model, robot)] for addresses in (model.jnt_qposadr, model.jnt_dofadr))
    data.qpos[at], data.qvel[to] = plan.position[0], plan.velocity[0]
    waiting = deque([np.zeros(robot.width)] * (real.late + 1), real.late + 1)
    command, rows, bend = np.zeros(robot.width), np.empty((len(plan.time), 3 * robot.width)), 0.0
    for k, time in enumerate(plan.time.tolist()):
        q, v = data.qpos[at].copy(), data.qvel[to].copy()
        if k % 2 == 0:
            wanted = plan.acceleration[k] + bandwidth**2 * (plan.position[k] - q)
            wanted += 2.0 * bandwidth * (plan.velocity[k] - v)
            command = robot.rigid_effort(q[None], v[None], wanted[None])[0] + real.rotor * wanted
            command += real.damping * v + real.friction * np.tanh(plan.velocity[k] / CREEP)
        rows[k] = np.concatenate([q, v, command])
        waiting.append(command)
        amplitude, periods, phase = real.ripple.T
        acting = waiting[0] - real.drag * np.abs(v) * v - amplitude * np.sin(periods * q + phase)
        if real.bristle is not None:
            j, force, way = real.bristle
            turn = math.copysign(1.0, v[j])
            bend = turn + (bend - turn) * math.exp(-abs(v[j]) * STEP / way)
            acting[j] -= force * bend
        if real.level is not None:
            j, level = real.level
            speed = v[j] if abs(v[j]) > 1e-6 else command[j]
            model.dof_frictionloss[to[j]] = real.friction[j] + level(time, speed, float(waiting[0][j]))
        data.qfrc_applied[to] = acting
        if real.push is not None:
            force, point, start, end = real.push
            pushing = force * (start <= time < end)
            turn = data.xmat[-1].reshape(3, 3)
            arm = data.xpos[-1] + turn @ point - data.xipos[-1]
            data.xfrc_applied[-1] = np.concatenate([pushing, np.cross(arm, pushing)])
        mujoco.mj_step(model, data)
    if any(data.warning[kind].number for kind in LOST):
        raise DataError("MuJoCo lost the robot: its simulation is unstable.")
    return rows


def reported(velocity: np.ndarray, cutoff: float) -> np.ndarray:
    """A velocity at every step (N,) as a first-order low-pass reports it, its cutoff in Hz."""
    kept = math.exp(-2.0 * math.pi * cutoff * STEP)
    return np.asarray(lfilter([1.0 - kept], [1.0, -kept], velocity, zi=[kept * velocity[0]])[0])


def _model(robot: Robot, real: Real, wrong: float, rng: np.random.Generator) -> mujoco.MjModel:
    """MuJoCo's robot: its links are off, and it has the wear, the spring, the payload and the tilt of the real one."""
    spec = mujoco.MjSpec.from_string(robot.urdf)
    if real.give is not None:
        j, stiffness, gap = real.give
        _loosen(spec.joint(robot.joints[j]), stiffness, gap, float(real.rotor[j]))
    model = spec.compile()
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.gravity[:] = real.gravity
    heavier, longer = 1.0 + wrong * np.clip(rng.standard_normal((2, model.nbody, 3)), -2.0, 2.0)
    heavier = heavier[:, 0]
    if real.link is not None:
        body = model.body(real.link[0]).id
        heavier[body], longer[body] = real.link[1], 1.0
    model.body_mass *= heavier
    model.body_inertia *= heavier[:, None]
    model.body_ipos *= longer
    if real.payload is not None:
        _carry(model, real.payload)
    motors = _motors(model, robot)
    to = model.jnt_dofadr[motors]
    model.dof_frictionloss[to], model.dof_damping[to], model.dof_armature[to] = (
        real.friction,
        real.damping,
        real.rotor,
    )
    model.jnt_stiffness[motors] = real.spring
    model.qpos_spring[model.jnt_qposadr[motors]] = real.rest
    return model


def _motors(model: mujoco.MjModel, robot: Robot) -> list[int]:
    """MuJoCo's numbers of the robot's joints: a soft or loose one has a second."""
    return [model.joint(name).id for name in robot.joints]


def _loosen(motor: mujoco.MjsJoint, stiffness: float, gap: float, rotor: float) -> None:
    """Let a link move against the motor of its joint, a rotor by then: on a spring, or freely within a gap."""
    damping, stopping = SOFTLY
    motor.armature = rotor
    motor.parent.add_joint(
        name=f"{motor.name}_link",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=motor.axis,
        pos=motor.pos,
        stiffness=stiffness,
        damping=damping * stiffness,
        limited=bool(gap),
        range=(-0.5 * gap, 0.5 * gap),
        solref_limit=(stopping, 1.0),
    )


def _carry(model: mujoco.MjModel, payload: pin.Inertia) -> None:
    """Fix a payload to the last body."""
    turn = pin.Quaternion(*model.body_iquat[-1]).toRotationMatrix()
    own = turn @ np.diag(model.body_inertia[-1]) @ turn.T
    both = pin.Inertia(float(model.body_mass[-1]), model.body_ipos[-1].copy(), own) + payload
    sizes, axes = np.linalg.eigh(both.inertia)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    model.body_mass[-1], model.body_ipos[-1], model.body_inertia[-1] = both.mass, both.lever, sizes
    model.body_iquat[-1] = pin.Quaternion(axes).coeffs()[[3, 0, 1, 2]]
