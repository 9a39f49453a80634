"""Measures of the identification's benchmark, and least squares to compare with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from _physical_data import PIECE, RATE, Real, true_motion, true_motions

from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.presliding import USUAL, directions
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import Predictor, Scores, rollout_error, score, score_model
from bdnn_ros.signals import Signals, prepare

HORIZON = 1.0
"""Length of a rollout [s]."""
SMALLEST = 1e-8
"""Singular values below this, relative to the largest, tell least squares nothing."""
REWEIGHTED = 3


def poses(robot: Robot, count: int, seed: int = 0) -> np.ndarray:
    """Random positions within the limits, (count, n) [rad]."""
    low, high = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    return np.random.default_rng(seed).uniform(low, high, (count, robot.width))


def torque_error(model: Predictor, parts: Sequence[Signals]) -> float:
    """Mean over the joints of squared error / variance of the torque."""
    return float(score_model(model, parts).nmse.mean())


def true_error(model: PhysicalModel, one: Real, seed: int) -> float:
    """The same of the effort that the model gives for a motion known exactly, against the exact effort.

    No sensor, no low-pass: what is left is the model's own error.
    """
    motion = true_motion(one, seed)
    at = motion.position, motion.velocity, motion.acceleration
    exact_effort = one.effort(*at)
    error = model.inverse_dynamics(*at) - exact_effort
    return float(np.mean(np.mean(error**2, axis=0) / np.var(exact_effort, axis=0)))


def mechanics_errors(model: PhysicalModel, one: Real) -> tuple[float, float]:
    """Relative errors of M and of g over random poses, in the Frobenius norm."""
    q = poses(one.nominal, 500)
    pairs = (
        (model.mass_matrix(q), one.robot.mass_matrix(q)),
        (model.gravity(q), one.robot.gravity(q)),
    )
    errors = [float(np.linalg.norm(ours - true) / np.linalg.norm(true)) for ours, true in pairs]
    return errors[0], errors[1]


def gravity_std(model: PhysicalModel, one: Real) -> float:
    """How far off g is by the model's own covariance, as `mechanics_errors` measures it: what the motion can tell of it."""
    q = poses(one.nominal, 500)
    regressor = one.robot.regressor(q, 0.0 * q, 0.0 * q)
    links = slice(regressor.shape[2])
    variance = np.einsum("tja,ab,tjb->", regressor, model.covariance[links, links], regressor, optimize=True)
    return float(np.sqrt(variance) / np.linalg.norm(one.robot.gravity(q)))


def rollout(model: PhysicalModel, signals: Signals) -> float:
    """Root mean square error of the positions after `HORIZON`, over joints and starts [rad]."""
    return float(np.sqrt(np.mean(rollout_error(model, signals, HORIZON).position ** 2)))


def true_rollout(model: PhysicalModel, one: Real, seed: int) -> float:
    """The same along motions known exactly, from the exact state and driven by the exact effort: the model's own error."""
    errors = []
    for plan in true_motions(one, seed, RATE):
        effort = one.effort(plan.position, plan.velocity, plan.acceleration)
        recording = Recording(plan.time, one.robot.joints, plan.position, plan.velocity, effort)
        signals = prepare(recording)
        at = np.rint(signals.time * RATE).astype(int)  # it keeps fewer samples a second
        known = replace(signals, position=plan.position[at], velocity=plan.velocity[at], effort=effort[at])
        errors.append(rollout_error(model, known, HORIZON).position)
    return float(np.sqrt(np.mean(np.square(errors))))


def first_seconds(recordings: Sequence[Recording], seconds: float) -> list[Recording]:
    """The first seconds of motions that last `PIECE` each."""
    lengths = np.clip(seconds - PIECE * np.arange(len(recordings)), 0.0, PIECE)
    return [r.between(r.time[0], r.time[0] + s) for r, s in zip(recordings, lengths, strict=True) if s > 0.0]


def exact(model: PhysicalModel, one: Real) -> PhysicalModel:
    """The model that knows the bodies and joints, and nothing of further effects: what noise leaves."""
    return replace(
        model, robot=one.robot, offset=np.zeros(one.robot.width), learned=None, breakaway=(), lead=0.0
    )


@dataclass(frozen=True)
class Itself:
    """The real robot, every effect known, along measured motion: what knowing the truth reaches with these sensors."""

    one: Real

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort, (N, n) [N·m]; dry friction turns round as the models' does."""
        robot, q, v, a = self.one.robot, signals.position, signals.velocity, signals.acceleration
        load, speed = robot.rigid_effort(q, v, a), np.maximum(np.abs(v), np.finfo(float).tiny)
        way = directions(signals).joints[:, :, USUAL]
        ahead, back = (self.one.beside(q, sign * speed, load) for sign in (1.0, -1.0))
        sharp = robot.coulomb * way + 0.5 * (ahead + back) + 0.5 * way * (ahead - back)
        return np.asarray(load + robot.armature * a + robot.viscous * v + signals.soften(sharp))


@dataclass(frozen=True)
class LeastSquares:
    """Least squares on the regressor with rotors, viscous and Coulomb friction and offset; no prior.

    Attributes:
        robot: whose regressor it is.
        coefficients: of the bodies, then of the four others joint by joint, then of coupled motors.
        coupled: joints j whose motor turns with joint j + 1 as well, which somebody has to tell it.
    """

    robot: Robot
    coefficients: np.ndarray
    coupled: tuple[int, ...] = ()

    @classmethod
    def fit(cls, robot: Robot, parts: Sequence[Signals], coupled: tuple[int, ...] = ()) -> LeastSquares:
        """Joints weighed by what is left of them."""
        inside = [signals.interior for signals in parts]
        columns = np.concatenate(
            [_columns(robot, s, coupled)[rows] for s, rows in zip(parts, inside, strict=True)], axis=0
        )
        effort = np.concatenate([_effort(s)[rows] for s, rows in zip(parts, inside, strict=True)])
        weight = np.ones(robot.width)
        for _ in range(REWEIGHTED):
            rows = (columns * weight[:, None]).reshape(-1, columns.shape[-1])
            size = np.linalg.norm(rows, axis=0) + 1e-12
            x = np.linalg.lstsq(rows / size, (effort * weight).ravel(), rcond=SMALLEST)[0] / size
            weight = 1.0 / np.sqrt(np.mean((effort - columns @ x) ** 2, axis=0))
        return cls(robot, x, coupled)

    def score(self, parts: Sequence[Signals]) -> Scores:
        """Its errors."""
        measured = [_effort(signals)[signals.interior] for signals in parts]
        predicted = [(_columns(self.robot, s, self.coupled) @ self.coefficients)[s.interior] for s in parts]
        return score(np.concatenate(measured), np.concatenate(predicted), self.robot.joints)


def _effort(signals: Signals) -> np.ndarray:
    assert signals.effort is not None
    return signals.smooth(signals.effort)


def _columns(robot: Robot, signals: Signals, coupled: tuple[int, ...]) -> np.ndarray:
    """Columns of least squares, low-passed as the effort is, (N, n, K)."""
    q, v, a = signals.position, signals.velocity, signals.acceleration
    own = np.stack([a, v, np.sign(v), np.ones_like(q)], axis=-1)
    placed = np.einsum("tjk,ji->tjik", own, np.eye(robot.width)).reshape(*q.shape, -1)
    motors = []
    for joint in coupled:
        acceleration, velocity = (x[:, joint] + x[:, joint + 1] for x in (a, v))
        for value in (acceleration, velocity, np.sign(velocity)):
            column = np.zeros((*q.shape, 1))
            column[:, joint : joint + 2, 0] = value[:, None]
            motors.append(column)
    return signals.smooth(np.concatenate([robot.regressor(q, v, a), placed, *motors], axis=-1))
