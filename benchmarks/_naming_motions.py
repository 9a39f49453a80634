"""Motions as labs record them, beside Fourier series: from point to point, one sine a joint, one joint after the other; and those
of `bdnn excite`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from bdnn_ros.errors import DataError
from bdnn_ros.excitation.choice import excite
from bdnn_ros.excitation.routes import straight
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import (
    Trajectory,
    fourier,
    position_range,
    smooth_step,
)

TRIALS = 200
WIDEST = 1.4
"""So far from the middle of its range a joint may go [rad]."""
SLOWEST = 1.0
"""No move between two points is shorter [s]."""
DWELL = (0.1, 0.7)
"""Between two moves [s]."""
FREQUENCIES = (0.08, 0.5)
"""Of a sine [Hz]."""
DESIGNS = 8
"""Motions that are made for each robot."""
SHARE = 0.9
"""What a motion may use of the limits of effort."""

Motion = Callable[[Robot, np.ndarray, np.random.Generator], Trajectory]


def points(robot: Robot, time: np.ndarray, rng: np.random.Generator, in_turn: bool = False) -> Trajectory:
    """All joints from point to point, each move a quintic; or one joint after the other."""
    middle, half, fastest = _room(robot)
    position, velocity, acceleration = (np.zeros((len(time), robot.width)) for _ in range(3))
    at, start, joint = middle + half * rng.uniform(-0.5, 0.5, robot.width), 0.0, 0
    position[:] = at
    while start < time[-1]:
        goal = middle + half * rng.uniform(-1.0, 1.0, robot.width)
        way = (
            np.where(np.arange(robot.width) == joint % robot.width, goal - at, 0.0) if in_turn else goal - at
        )
        takes = max(SLOWEST, float((np.abs(way) / (0.45 * fastest)).max()))
        rows = (time >= start) & (time < start + takes)
        move = straight(at, at + way, takes, time[rows] - start)
        position[rows], velocity[rows], acceleration[rows] = move.position, move.velocity, move.acceleration
        at, joint = at + way, joint + 1
        position[time >= start + takes] = at
        start += takes + float(rng.uniform(*DWELL))
    return Trajectory(time, position, velocity, acceleration)


def in_turn(robot: Robot, time: np.ndarray, rng: np.random.Generator) -> Trajectory:
    """One joint after the other from point to point."""
    return points(robot, time, rng, in_turn=True)


def sines(robot: Robot, time: np.ndarray, rng: np.random.Generator) -> Trajectory:
    """One sine a joint, swelling from rest."""
    middle, half, fastest = _room(robot)
    rate = 2.0 * np.pi * rng.uniform(*FREQUENCIES, robot.width)
    size = np.minimum(half * rng.uniform(0.4, 1.0, robot.width), 0.6 * fastest / rate)
    angle = rate * time[:, None] + rng.uniform(0.0, 2.0 * np.pi, robot.width)
    w, dw, ddw = (part[:, None] for part in smooth_step(0.5 * time))
    dw, ddw = 0.5 * dw, 0.25 * ddw
    sine, cosine = np.sin(angle), rate * np.cos(angle)
    return Trajectory(
        time,
        middle + size * w * sine,
        size * (w * cosine + dw * sine),
        size * (ddw * sine + 2.0 * dw * cosine - w * rate**2 * sine),
    )


def designed(robot: Robot, time: np.ndarray, rng: np.random.Generator) -> Trajectory:
    """What `bdnn excite` makes for identification, held at its end."""
    rate = 1.0 / float(time[1] - time[0])
    plan = _designed(robot.urdf, robot.joints, float(time[-1]), rate, int(rng.integers(DESIGNS)))
    at = np.minimum(np.arange(len(time)), len(plan.time) - 1)
    return Trajectory(time, plan.position[at], plan.velocity[at], plan.acceleration[at])


@cache
def _designed(urdf: str, joints: tuple[str, ...], duration: float, rate: float, seed: int) -> Trajectory:
    return excite(Robot.from_urdf(urdf, joints), duration=duration, rate=rate, seed=seed).trajectory


MOTIONS: dict[str, Motion] = {
    "fourier": fourier,
    "points": points,
    "sines": sines,
    "in_turn": in_turn,
    "designed": designed,
}


def planned(name: str, robot: Robot, time: np.ndarray, rng: np.random.Generator) -> Trajectory:
    """A motion of a kind that keeps the robot's limits.

    Raises:
        DataError: none was found.
    """
    for _ in range(TRIALS):
        plan = MOTIONS[name](robot, time, rng)
        some = slice(None, None, 50)
        effort = robot.rigid_effort(plan.position[some], plan.velocity[some], plan.acceleration[some])
        if (np.abs(effort) <= SHARE * robot.limits.effort).all():
            return plan
    raise DataError(f"No motion {name} keeps the limits of effort.")


def _room(robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middle and half of each joint's range [rad], and its largest speed [rad/s], (n,) each."""
    lower, upper = position_range(robot)
    return 0.5 * (lower + upper), np.minimum(0.4 * (upper - lower), WIDEST), robot.limits.usual_velocity
