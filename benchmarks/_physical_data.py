"""Data of the identification's benchmark: a 7-axis robot whose description is wrong, along Fourier motions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals, prepare
from bdnn_ros.simulation.excitation import BLEND, Trajectory, fourier
from bdnn_ros.simulation.perturbation import worn_robot, wrong_robot
from bdnn_ros.simulation.sensors import Noise, measured_position

ROBOT = "arm7"
WRONG = 0.2
RATE = 500.0
PIECE = 20.0
"""Every so many seconds a new random motion [s]: a Fourier series repeats itself."""
ROUGH, ROUGH_RATE = 2e-4, 100.0
"""Noise of a shaky encoder [rad] and its rate [Hz]."""
TESTED = 60.0
"""Seconds of other motions to judge by."""

Extra = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""(position, velocity, effort of the rigid bodies), (N, n) each -> further effort, (N, n) [N·m]."""


@dataclass(frozen=True)
class Real:
    """A robot as it really is.

    Attributes:
        nominal: the description, the prior.
        robot: bodies, rotors, viscous and Coulomb friction.
        beside: what else its joints do.
        reach: range of each joint's effort, (n,) [N·m], that the noise is a share of.
    """

    nominal: Robot
    robot: Robot
    beside: Extra
    reach: np.ndarray

    def effort(self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """Effort along a motion without noise, (N, n) [N·m]."""
        load = self.robot.rigid_effort(position, velocity, acceleration)
        exact = self.robot.inverse_dynamics(position, velocity, acceleration)
        return np.asarray(exact + self.beside(position, velocity, load))


def real(seed: int, effects: str = "matched") -> Real:
    """The robot of a seed: links off by 20 %, worn joints, and effects beside them."""
    rng = np.random.default_rng([seed, 1])
    nominal = Robot.bundled(ROBOT)
    plan = fourier(nominal, np.arange(0.0, PIECE, 0.02), rng)
    effort = nominal.inverse_dynamics(plan.position, plan.velocity, plan.acceleration)
    robot = worn_robot(wrong_robot(nominal, WRONG, rng), np.std(effort, axis=0), rng)
    made = Real(nominal, robot, EFFECTS[effects](robot, np.std(effort, axis=0), rng), np.ones(nominal.width))
    reach = np.ptp(made.effort(plan.position, plan.velocity, plan.acceleration), axis=0)
    return Real(nominal, robot, made.beside, reach)


def motions(
    one: Real, seconds: float, seed: int, coloured: bool = False, size: float = 1.0
) -> list[Recording]:
    """What sensors report of so many seconds of motion, from the first one already in full swing.

    Args:
        size: of the motion, about where it starts; 1 is as wide as the limits allow.
    """
    rng = np.random.default_rng([seed, 2])
    result = []
    for start in np.arange(0.0, seconds, PIECE):
        plan = fourier(one.nominal, np.arange(round((PIECE + BLEND) * RATE)) / RATE, rng)
        rows = slice(round(BLEND * RATE), round((BLEND + min(PIECE, seconds - start)) * RATE))
        q, v, a = plan.position[rows], size * plan.velocity[rows], size * plan.acceleration[rows]
        moved = Trajectory(plan.time[rows], q[:1] + size * (q - q[:1]), v, a)
        result.append(sensed(one, moved, rng, coloured))
    return result


def sensed(one: Real, motion: Trajectory, rng: np.random.Generator, coloured: bool = False) -> Recording:
    """What sensors report of a motion."""
    noise, q = Noise.of(Noise.effort, coloured), motion.position
    rate = 1.0 / float(motion.time[1] - motion.time[0])
    felt = one.effort(q, motion.velocity, motion.acceleration)
    felt = felt + noise.effort * one.reach * _noise(q.shape, noise.correlation * rate, rng)
    seen = measured_position(q, noise, rng)
    return Recording(motion.time, one.robot.joints, seen, None, felt, urdf=one.nominal.urdf)


def rough(recording: Recording, seed: int) -> Recording:
    """The same by a slow and shaky encoder: at `ROUGH_RATE`, with `ROUGH` more on its positions."""
    rng, position = np.random.default_rng([seed, 4]), recording.position
    seen = replace(recording, position=position + ROUGH * rng.standard_normal(position.shape))
    return seen.part(slice(None, None, round(RATE / ROUGH_RATE)))


def tests(one: Real, seed: int) -> list[Signals]:
    """Signals of other motions of the same robot."""
    return [prepare(recording) for recording in motions(one, TESTED, 1_000_000 + seed)]


def true_motion(one: Real, seed: int) -> Trajectory:
    """Other motions once more, as they are: without sensors, at 100 Hz."""
    plans = true_motions(one, seed, 100.0)
    time = np.arange(0.0, TESTED, 0.01)
    parts = (np.concatenate([getattr(p, k) for p in plans]) for k in ("position", "velocity", "acceleration"))
    return Trajectory(time, *parts)


def true_motions(one: Real, seed: int, rate: float) -> list[Trajectory]:
    """The single motions of `true_motion`."""
    rng = np.random.default_rng([seed, 3])
    time = np.arange(round(PIECE * rate)) / rate
    return [fourier(one.nominal, time, rng) for _ in range(round(TESTED / PIECE))]


def _noise(shape: tuple[int, ...], correlation: float, rng: np.random.Generator) -> np.ndarray:
    """Noise of unit variance, white or correlated over so many samples, (N, n)."""
    white = rng.standard_normal(shape)
    if correlation == 0.0:
        return white
    keep = float(np.exp(-1.0 / correlation))
    start = keep * rng.standard_normal((1, shape[1]))
    return np.asarray(lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], white, axis=0, zi=start)[0])


# -- effects -------------------------------------------------------------------------------------------------


def _matched(robot: Robot, effort: np.ndarray, rng: np.random.Generator) -> Extra:
    return lambda position, velocity, load: np.zeros_like(position)


def _unmodelled(robot: Robot, effort: np.ndarray, rng: np.random.Generator) -> Extra:
    """Stribeck and load-dependent friction, quadratic drag and cogging on every joint."""
    n = robot.width
    stick, width = robot.coulomb * rng.uniform(0.3, 0.8, n), rng.uniform(0.03, 0.15, n)
    ratio, drag = rng.uniform(0.02, 0.06, n), robot.viscous / robot.limits.velocity * rng.uniform(0.2, 0.6, n)
    ripple, periods = robot.coulomb * rng.uniform(0.1, 0.4, n), np.floor(rng.uniform(4.0, 24.0, n))
    phase = rng.uniform(-np.pi, np.pi, n)

    def extra(position: np.ndarray, velocity: np.ndarray, load: np.ndarray) -> np.ndarray:
        way = np.sign(velocity)
        dry = (stick * np.exp(-((velocity / width) ** 2)) + ratio * np.abs(load)) * way
        smooth = drag * velocity * np.abs(velocity) + ripple * np.sin(periods * position + phase)
        return np.asarray(dry + smooth)

    return extra


def _foreign(robot: Robot, effort: np.ndarray, rng: np.random.Generator) -> Extra:
    """A bump at a position of every joint, and an effort by the position of the next joint."""
    n = robot.width
    bump, place, width = robot.coulomb * rng.uniform(0.5, 1.0, n), rng.uniform(-0.5, 0.5, n), 0.1
    middle = 0.5 * (np.maximum(robot.limits.lower, -np.pi) + np.minimum(robot.limits.upper, np.pi))
    coupling, phase = robot.coulomb * rng.uniform(0.2, 0.6, n), rng.uniform(-np.pi, np.pi, n)

    def extra(position: np.ndarray, velocity: np.ndarray, load: np.ndarray) -> np.ndarray:
        beyond = np.roll(position, -1, axis=1)
        hill = bump * np.exp(-(((position - middle - place) / width) ** 2))
        return np.asarray(hill + coupling * np.sin(3.0 * beyond + phase))

    return extra


EFFECTS = {"matched": _matched, "unmodelled": _unmodelled, "foreign": _foreign}
