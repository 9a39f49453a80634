"""What the named effects leave: how much of it could still be predicted, and from what."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_opening

from bdnn_ros.diagnosis.equations import Equations
from bdnn_ros.diagnosis.noise import rms

ACCELERATION = ".acceleration"
HARMONICS = 6
RIDGE = 1e-3
VARIES = 1e-6
"""An input that varies by less than this share of itself is one value: of a joint that stands still."""
WORTH = 0.1
"""A group of inputs is named when it predicts at least this share of what is left, on blocks it was not fitted to."""
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
        depends_on: "joint.input" that predict the rest, strongest first.
        joints: joints where the rest is larger than the floor.
        predicted: per joint, what the inputs predict of the residual on held-out blocks, rows (R, n) [N·m].
        bursts: joints where what no input predicts comes in bursts, more than the position's steps can make.
        resting: joints that bear what nobody would pass over while they rest, where dry friction may hold anything.
    """

    floor: np.ndarray
    depends_on: tuple[str, ...]
    joints: tuple[str, ...]
    predicted: np.ndarray
    bursts: tuple[str, ...] = ()
    resting: tuple[str, ...] = ()


def describe(
    equations: Equations,
    residual: np.ndarray,
    stepping: np.ndarray | float = 0.0,
    dry: np.ndarray | float = 0.0,
) -> Remainder:
    """Regress a residual, rows (R, n) [N·m], on its own and the next joints' position, velocity and load, on every joint's
    acceleration, which inertia hands on to all, and on time.

    Args:
        stepping: what the steps in which the position is read may make of each joint, (n,) [N·m].
        dry: what dry friction that is known may hold of each joint while it rests, (n,) [N·m].
    """
    names = equations.motion.signals.joints
    groups = _inputs(equations)
    predicted = np.zeros_like(residual)
    scores: list[tuple[float, str]] = []
    dependent: list[str] = []
    for j in range(equations.width):
        rows = equations.usable[:, j]
        own = [key for key in groups if key.rpartition(".")[0] in (names[j], "")]
        close = names[max(j - 1, 0) : j + 2]
        near = [
            key
            for key in groups
            if key not in own and (key.rpartition(".")[0] in close or key.endswith(ACCELERATION))
        ]
        whole = np.concatenate([groups[key] for key in own + near], axis=1)
        predicted[:, j] = _cross_predicted(whole, residual[:, j], rows, equations.block)
        before = float(np.mean(residual[rows, j] ** 2)) if rows.any() else 0.0
        after = float(np.mean((residual[rows, j] - predicted[rows, j]) ** 2)) if rows.any() else 0.0
        if before <= 0.0 or after > (1.0 - WORTH) * before:
            predicted[:, j] = 0.0
            continue
        dependent.append(names[j])
        for key in own + near:
            alone = _cross_predicted(groups[key], residual[:, j], rows, equations.block)
            gain = 1.0 - float(np.mean((residual[rows, j] - alone[rows]) ** 2)) / before
            if gain > WORTH:
                scores.append((gain * before / equations.effort_scale[j] ** 2, key))
    rest = [(residual - predicted)[equations.usable[:, j], j] for j in range(equations.width)]
    floor, calm = np.array([rms(left) for left in rest]), np.array([_between_bursts(left) for left in rest])
    uneven = floor > np.maximum(UNEVEN * calm, stepping)
    order = [key for _, key in sorted(scores, key=lambda pair: -pair[0])]
    return Remainder(
        np.where(uneven, calm, floor),
        tuple(dict.fromkeys(order)),
        tuple(dependent),
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
    t = (motion.time - motion.time[0]) / max(float(np.ptp(motion.time)), 1e-9)
    groups["time"] = np.stack([t, t**2, t**3], axis=1)
    return {key: motion.signals.smooth(values)[equations.rows] for key, values in groups.items()}


def _cross_predicted(x: np.ndarray, y: np.ndarray, rows: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Ridge prediction of y (R,) from x (R, k), each of five folds of blocks from the others."""
    among = x[rows] if rows.any() else np.zeros((1, x.shape[1]))
    middle, spread = among.mean(axis=0), among.std(axis=0)
    varies = spread > VARIES * np.abs(among).max(axis=0)
    z = np.concatenate([(x - middle)[:, varies] / spread[varies], np.ones((len(x), 1))], axis=1)
    predicted = np.zeros_like(y)
    for fold in range(5):
        out = block % 5 == fold
        fit = rows & ~out
        if fit.sum() < 2 * z.shape[1]:
            continue
        a = z[fit].T @ z[fit] + RIDGE * fit.sum() * np.eye(z.shape[1])
        predicted[out] = z[out] @ np.linalg.solve(a, z[fit].T @ y[fit])
    return predicted


def _between_bursts(values: np.ndarray) -> float:
    """Standard deviation of most of some values, whatever the rest do."""
    return GAUSSIAN * float(np.median(np.abs(values))) if len(values) else 0.0
