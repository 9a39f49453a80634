"""What the named effects leave: how much of it could still be predicted, and from what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_opening

from bdnn_ros.aside import in_two
from bdnn_ros.diagnosis.recorded.joining import owners
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.noise import rms
from bdnn_ros.diagnosis.telling.inputs import Key, ageing, names, pairs, single
from bdnn_ros.diagnosis.telling.predicting import Predictor, by_chance

WORTH = 0.1
"""Inputs are named when they predict at least this share of what is left, on blocks that had no say in them."""
MATTERS = 0.02
"""What single inputs leave of a joint's error matters beyond this share of its effort's spread."""
GAUSSIAN = 1.4826
"""Standard deviation of normal noise per median of its size."""
LARGE_ERROR = 0.4
"""An error of the simulation, per spread of a joint's effort, that nobody would pass over."""
NOISE = 4.0
"""Nor is an effort far from the simulation's that so many times what motion leaves would account for."""
UNEVEN = 1.5
"""Noise is much the same throughout a recording: what is so many times as large as its median tells was not noise at its
loudest."""


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
    """Regress a residual, rows (R, n) [N·m], on every joint's position, velocity, acceleration and load, on time, and on pairs.

    Args:
        stepping: what the steps in which the position is read may make of each joint, (n,) [N·m].
        dry: what dry friction that is known may hold of each joint while it rests, (n,) [N·m].
    """
    joints, groups = equations.motion.signals.joints, single(equations)
    predicted = np.zeros_like(residual)
    inputs: dict[str, dict[str, float]] = {}
    told = in_two(lambda j: _told(equations, groups, residual[:, j], j), range(equations.width))
    for j, found in enumerate(told):
        if found is not None:
            predicted[:, j], inputs[joints[j]] = found
    left, each = residual - predicted, range(equations.width)
    floor = np.array([rms(left[equations.usable[:, j], j]) for j in each])
    calm = np.array([_between_bursts(equations, left[:, j], j) for j in each])
    uneven = floor > np.maximum(UNEVEN * calm, stepping)
    return Remainder(
        np.where(uneven, calm, floor),
        inputs,
        predicted,
        tuple(name for name, one in zip(joints, uneven, strict=True) if one),
        tuple(
            name for name, one in zip(joints, _borne_at_rest(equations, residual, dry), strict=True) if one
        ),
    )


def _told(
    equations: Equations, groups: Mapping[Key, np.ndarray], residual: np.ndarray, joint: int
) -> tuple[np.ndarray, dict[str, float]] | None:
    """What inputs predict of a joint's residual (R,), and how much each does [(N·m)²]; None where that is not certain.

    Pairs of inputs are asked only where single ones leave what matters, and believed where they predict much of that.
    """
    rows = equations.usable[:, joint]
    own = {**groups, **ageing(equations, joint)}
    guess, shares = _guess(equations, own, residual, rows)
    before = float(np.sum(residual[rows] ** 2))
    if rms((residual - guess)[rows]) > MATTERS * equations.effort_scale[joint]:
        more, of_more = _guess(equations, {**own, **pairs(equations, joint)}, residual, rows)
        if shares and rms((residual - more)[rows]) ** 2 > (1.0 - WORTH) * rms((residual - guess)[rows]) ** 2:
            more, of_more = guess, shares
        guess, shares = more, of_more
    if not shares:
        return None
    much: dict[str, float] = {}
    for key, share in shares.items():
        for name in names(key):
            much[name] = much.get(name, 0.0) + share * before / float(rows.sum())
    return guess, much


def _guess(
    equations: Equations, groups: Mapping[Key, np.ndarray], residual: np.ndarray, rows: np.ndarray
) -> tuple[np.ndarray, dict[Key, float]]:
    """What groups predict of a residual (R,), and the shares that help; nothing where chance would do as much."""
    guess, shares = Predictor(groups, residual, rows, equations.block).predicted()
    left = residual - guess
    before, after = float(np.sum(residual[rows] ** 2)), float(np.sum(left[rows] ** 2))
    if before - after <= WORTH * before + by_chance(left, rows, len(groups)) * after:
        return np.zeros_like(residual), {}
    return guess, {key: share for key, share in shares.items() if share > 0.0}


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


def _between_bursts(equations: Equations, left: np.ndarray, joint: int) -> float:
    """Standard deviation of most of what is left of a joint (R,), whatever the rest does: of each recording by itself.

    One that was recorded elsewhere, or along a faster motion, may have more noise all through.
    """
    signals, rows = equations.motion.signals, equations.usable[:, joint]
    whose = owners(equations.motion.time[equations.rows], signals.begun)[rows]
    variances = np.zeros(len(whose))
    for one in np.unique(whose):
        own = whose == one
        variances[own] = (GAUSSIAN * np.median(np.abs(left[rows][own]))) ** 2
    return float(np.sqrt(variances.mean())) if len(variances) else 0.0
