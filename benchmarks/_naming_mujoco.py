"""Recordings of robots that MuJoCo moves, with something hidden in them: none of our simulation is in these."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from _naming_motions import planned
from _naming_mujoco_robot import STEP, Real, moved, reported
from _naming_robots import bare

from bdnn_ros.effects.environment import FORCE, POINT
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import Trajectory

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
    "stribeck_friction",
    "asymmetric_friction",
    "load_dependent_friction",
    "hysteresis",
    "drift",
    "link_inertia",
    "velocity_filter",
    "joint_elasticity",
    "backlash",
)
OF_DRIVES = ("joint_elasticity", "backlash")
"""Where a motor and its link part, the motor has a rotor: such robots are worn."""
VARIANTS = {"external_wrench": "link", "drift": "coulomb"}
SHARE = (0.08, 0.4)
"""Size of what is hidden, per spread of the joint's effort."""
SWINGING = (25.0, 45.0)
"""A link on its soft transmission [rad/s]."""
GAP = (0.004, 0.03)
"""Between a motor and its link [rad]."""
WEAR = (0.05, 0.2)
"""The same of each part of the wear."""
WORN = 0.5
"""Share of robots that are worn."""
BANDWIDTH = (3.0, 6.0)
"""Of the controller [Hz]."""


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
        motion: one of `_naming_motions.MOTIONS`.
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
    motion: str = "fourier"


@dataclass(frozen=True)
class Usual:
    """Spread of each joint's effort along a motion, and that per spread of its velocity and of its acceleration, (n,)."""

    effort: np.ndarray
    per_speed: np.ndarray
    per_acceleration: np.ndarray


def drawn(seed: int, motion: str = "fourier", robots: Sequence[str] = ROBOTS) -> Drawn:
    """The recording of a seed; robots and effects take turns."""
    rng = np.random.default_rng([seed, *b"mujoco"])
    return Drawn(
        seed,
        robots[seed % len(robots)],
        HIDDEN[(seed // len(robots)) % len(HIDDEN)],
        float(rng.choice([0.0, 0.03, 0.05])),
        bool(rng.random() < WORN),
        int(rng.choice([100, 125, 200, 250, 500])),
        float(rng.choice([25.0, 30.0, 40.0])),
        float(np.exp(rng.uniform(np.log(0.002), np.log(0.015)))),
        float(np.exp(rng.uniform(np.log(5e-6), np.log(1e-4)))),
        motion,
    )


def made(draw: Drawn) -> tuple[Recording, dict[str, Any]]:
    """The recording of a draw, and its truth in the form of truth.yaml."""
    robot = bare(draw.robot)
    rng = np.random.default_rng([draw.seed, *b"robot"])
    time = np.arange(round(draw.duration / STEP)) * STEP
    plan = planned(draw.motion, robot, time, rng)
    real, truth = _real(draw, robot, plan, rng)
    every = round(1.0 / (draw.rate * STEP))
    rows = moved(robot, real, (draw.wrong, rng), plan, 2.0 * math.pi * rng.uniform(*BANDWIDTH))
    if real.slow is not None:
        j, cutoff = real.slow
        rows[:, robot.width + j] = reported(rows[:, robot.width + j], cutoff)
    return _sensed(draw, robot, real, rows[::every], rng), truth


def _real(
    draw: Drawn, robot: Robot, plan: Trajectory, rng: np.random.Generator
) -> tuple[Real, dict[str, Any]]:
    """The robot with its wear and what is hidden in it."""
    real, n = Real.like(robot.width), robot.width
    effort = robot.rigid_effort(plan.position, plan.velocity, plan.acceleration).std(axis=0)
    usual = Usual(effort, effort / plan.velocity.std(axis=0), effort / plan.acceleration.std(axis=0))
    worn = None
    if draw.worn or draw.hidden in OF_DRIVES:
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
    j = int(rng.integers(*_among(draw.hidden, n)))
    parameters = _hidden(draw.hidden, real, j, robot, usual, plan, rng)
    on_link = {"payload": n - 1, "external_wrench": n - 1, "link_inertia": j}
    one = {"effect": draw.hidden, "variant": VARIANTS.get(draw.hidden, "")}
    one |= {"link": robot.moving_link(robot.joints[on_link[draw.hidden]]) if draw.hidden in on_link else None}
    one |= {"joint": None if one["link"] or draw.hidden in ("base_tilt", "effort_delay") else robot.joints[j]}
    return real, {**truth, "effects": [{**one, "parameters": parameters}]}


def _among(name: str, n: int) -> tuple[int, int]:
    """The first joint that something may be hidden at, and the one after the last."""
    if name == "position_offset":  # shows neither about a vertical nor about the last link's own axis
        return 1, max(n - 1, 2)
    if name in ("link_inertia", "joint_elasticity"):  # where a link is heavy
        return int(name == "link_inertia"), n // 2 + 1
    return 0, n


def _hidden(
    name: str, real: Real, j: int, robot: Robot, usual: Usual, plan: Trajectory, rng: np.random.Generator
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
            real.payload = pin.Inertia.FromBox(mass, *rng.uniform(0.04, 0.3, 3).tolist())
            real.payload.lever = centre
            return {"mass": mass, **dict(zip(("com_x", "com_y", "com_z"), centre.tolist(), strict=True))}
        case "base_tilt":
            roll, pitch = rng.uniform(-5.0, 5.0, 2)
            about_x, about_y = ((math.radians(roll), 0.0, 0.0), (0.0, math.radians(pitch), 0.0))
            real.gravity = (pin.rpy.rpyToMatrix(*about_y) @ pin.rpy.rpyToMatrix(*about_x)).T @ real.gravity
            return {"roll_deg": float(roll), "pitch_deg": float(pitch)}
        case "stribeck_friction":
            coulomb, static, slow = 0.5 * effort, 1.5 * effort, float(rng.uniform(0.1, 0.4) * speed.std())
            real.level = j, lambda t, v, load: coulomb + (static - coulomb) * math.exp(-((v / slow) ** 2))
            return {"coulomb": coulomb, "static": static, "velocity": slow}
        case "asymmetric_friction":
            ahead, back = (1.0 + 0.4 * sign) * effort, (1.0 - 0.4 * sign) * effort
            real.level = j, lambda t, v, load: ahead if v > 0.0 else back
            return {"positive": ahead, "negative": back}
        case "load_dependent_friction":
            ratio = float(rng.uniform(0.08, 0.3))
            real.level = j, lambda t, v, load: ratio * abs(load)
            return {"ratio": ratio}
        case "drift":
            early, late, end = 0.4 * effort, 1.6 * effort, float(plan.time[-1])
            real.level = j, lambda t, v, load: early + (late - early) * t / end
            return {"start_value": early, "end_value": late, "start": 0.0, "end": end}
        case "hysteresis":
            real.bristle = j, effort, float(rng.uniform(0.01, 0.06))
            return {"force": effort, "breakaway": real.bristle[2]}
        case "link_inertia":
            link, scale = robot.moving_link(robot.joints[j]), math.exp(sign * rng.uniform(0.25, 0.45))
            real.link, mass = (link, scale), float(robot.inertials[j, 0])
            return {"mass": scale * mass, "nominal_mass": mass, "scale": scale}
        case "velocity_filter":
            real.slow = j, float(rng.uniform(3.0, 12.0))
            return {"cutoff": real.slow[1]}
        case "joint_elasticity":
            inertia = float(robot.mass_matrix(plan.position)[:, j, j].mean())
            real.give = j, inertia * rng.uniform(*SWINGING) ** 2, 0.0
            return {"stiffness": real.give[1]}
        case "backlash":
            real.give = j, 0.0, float(np.exp(rng.uniform(*np.log(GAP))))
            return {"gap": real.give[2], "crossing": real.give[2]}
        case "external_wrench":
            force, start = rng.standard_normal(3), float(rng.uniform(3.0, 15.0))
            force *= rng.uniform(5.0, 15.0) / np.linalg.norm(force)
            end = start + float(rng.uniform(2.0, 6.0))
            mass, *moment = robot.inertials[-1][:4]
            point = np.array(moment) / mass
            real.push = force, point, start, end
            there = zip(FORCE + POINT, (*force, *point), strict=True)
            return {"start": start, "end": end, **{name: float(value) for name, value in there}}
    raise ValueError(name)


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
