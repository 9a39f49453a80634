"""What the named effects leave: how much of it could still be predicted, and from what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.ndimage import binary_opening

from bdnn_ros.diagnosis.equations import Equations
from bdnn_ros.diagnosis.noise import rms
from bdnn_ros.diagnosis.predicting import Predictor, by_chance

ACCELERATION = ".acceleration"
TIME = "time"
HARMONICS = 9
WORTH = 0.1
"""Inputs are named when they predict at least this share of what is left, on blocks that had no say in them."""
GAUSSIAN = 1.4826
"""Standard deviation of normal noise per median of its size."""
LARGE_ERROR = 0.4
"""An error of the simulation, per spread of a joint's effort, that nobody would pass over."""
NOISE = 4.0
"""Nor is an effort far from the simulation's that so many times what motion leaves would account for."""
UNEVEN = 1.5
"""Noise is much the same throughout: what is so many times as large as its median tells was not noise at its loudest."""


@dataclass(frozen=True)
class Remainder:
    """What is left after the extended model.

    Attributes:
        floor: per joint, RMS of what no input predicts on held-out blocks, where that comes in bursts what is left
            between them, (n,) [N·m].
        inputs: of joints where the rest is larger than the floor, what each "joint.input" predicts of it [(N·m)²].
        predicted: per joint, what the inputs predict of the residual on held-out blocks, rows (R, n) [N·m].
        bursts: joints where what no input predicts comes in bursts, more than the position's steps can make.
        resting: joints that bear what nobody would pass over while they rest, where dry friction may hold anything.
    """

    floor: np.ndarray
    inputs: Mapping[str, Mapping[str, float]]
    predicted: np.ndarray
    bursts: tuple[str, ...] = ()
    resting: tuple[str, ...] = ()

    def depends_on(self, joints: Sequence[str] = ()) -> dict[str, str]:
        """What predicts the rest at some joints, or at all without any, strongest first, with the joint where it does most."""
        best: dict[str, tuple[float, str]] = {}
        for joint in joints or self.inputs:
            for key, much in self.inputs.get(joint, {}).items():
                best[key] = max(best.get(key, (0.0, joint)), (much, joint), key=lambda one: one[0])
        return {key: best[key][1] for key in sorted(best, key=lambda key: -best[key][0])}


def describe(
    equations: Equations,
    residual: np.ndarray,
    stepping: np.ndarray | float = 0.0,
    dry: np.ndarray | float = 0.0,
) -> Remainder:
    """Regress a residual, rows (R, n) [N·m], on every joint's position, velocity, acceleration and load, and on time.

    Args:
        stepping: what the steps in which the position is read may make of each joint, (n,) [N·m].
        dry: what dry friction that is known may hold of each joint while it rests, (n,) [N·m].
    """
    names = equations.motion.signals.joints
    groups = _inputs(equations)
    predicted = np.zeros_like(residual)
    inputs: dict[str, dict[str, float]] = {}
    for j, rows in enumerate(equations.usable.T):
        own = groups | {TIME: _ageing(equations, j)}
        guess, shares = Predictor(own, residual[:, j], rows, equations.block).predicted()
        left = residual[:, j] - guess
        before, after = float(np.sum(residual[rows, j] ** 2)), float(np.sum(left[rows] ** 2))
        if before - after <= WORTH * before + by_chance(left, rows, len(own)) * after:
            continue
        predicted[:, j] = guess
        inputs[names[j]] = {
            key: share * before / float(rows.sum()) for key, share in shares.items() if share > 0.0
        }
    rest = [(residual - predicted)[equations.usable[:, j], j] for j in range(equations.width)]
    floor, calm = np.array([rms(left) for left in rest]), np.array([_between_bursts(left) for left in rest])
    uneven = floor > np.maximum(UNEVEN * calm, stepping)
    return Remainder(
        np.where(uneven, calm, floor),
        inputs,
        predicted,
        tuple(name for name, one in zip(names, uneven, strict=True) if one),
        tuple(name for name, one in zip(names, _borne_at_rest(equations, residual, dry), strict=True) if one),
    )


def _borne_at_rest(equations: Equations, residual: np.ndarray, dry: np.ndarray | float) -> np.ndarray:
    """Joints with a large residual, rows (R, n), throughout one period of the low-pass in which they rest, (n,) bool.

    Beyond what dry friction that is known may hold, which is between both directions', and beyond the noise.
    """
    signals, usable = equations.motion.signals, equations.ever_usable
    noise = np.array([rms(residual[rows, j]) if rows.any() else 0.0 for j, rows in enumerate(usable.T)])
    held = 2.0 * dry + NOISE * noise
    resting = signals.seen[equations.rows] & ~usable
    large = resting & (np.abs(residual) > LARGE_ERROR * equations.effort_scale + held)
    step = float(np.median(np.diff(signals.time[equations.rows])))
    period = int(np.ceil(1.0 / (signals.cutoff * step)))
    return np.asarray(binary_opening(large, np.ones((period, 1), bool)).any(axis=0))


def _inputs(equations: Equations) -> dict[str, np.ndarray]:
    """Features of every input, rows (R, k) each, made like the columns of effects: at the working rate, then reduced."""
    motion = equations.motion
    groups: dict[str, np.ndarray] = {}
    for j, name in enumerate(motion.signals.joints):
        q, v, load = motion.position[:, j], motion.velocity[:, j], motion.load[:, j]
        groups[name + ACCELERATION] = motion.acceleration[:, j : j + 1]
        waves = [f(k * q) for k in range(1, HARMONICS + 1) for f in (np.sin, np.cos)]
        fast = np.abs(v) / max(float(np.std(v)), 1e-6)
        groups[f"{name}.position"] = np.stack(waves, axis=1)
        steps = [motion.signals.sign[:, j] * np.exp(-fast * k) for k in (0.0, 1.0, 4.0, 16.0)]
        groups[f"{name}.velocity"] = np.stack([v, v * np.abs(v), *steps], axis=1)
        groups[f"{name}.load"] = np.stack(
            [load, np.abs(load) * motion.signals.sign[:, j], load * np.abs(load)], axis=1
        )
    return {key: motion.signals.smooth(values)[equations.rows] for key, values in groups.items()}


def _ageing(equations: Equations, joint: int) -> np.ndarray:
    """Features (R, k) of time: what changes slowly of a joint's effort, at rest or with its velocity, as friction does."""
    motion = equations.motion
    span = max(float(np.ptp(motion.time)), 1e-9)
    slow = legvander(2.0 * (motion.time - motion.time[0]) / span - 1.0, 3)
    of = np.stack(
        [np.ones_like(motion.time), motion.velocity[:, joint], motion.signals.sign[:, joint]], axis=1
    )
    values = (slow[:, :, None] * of[:, None, :]).reshape(len(slow), -1)[:, 1:]
    return motion.signals.smooth(values)[equations.rows]


def _between_bursts(values: np.ndarray) -> float:
    """Standard deviation of most of some values, whatever the rest do."""
    return GAUSSIAN * float(np.median(np.abs(values))) if len(values) else 0.0
