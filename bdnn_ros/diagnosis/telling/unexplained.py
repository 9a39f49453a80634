"""What the named effects leave unexplained, and how much of it is predictable from which inputs."""

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
"""Share of the residual that inputs must predict on held-out blocks to be named."""
MATTERS = 0.02
"""Pairs of inputs are tried where single ones leave more than this share of the effort's spread."""
GAUSSIAN = 1.4826
"""Standard deviation of normal noise per median absolute value."""
LARGE_ERROR = 0.4
"""Error, relative to the spread of a joint's effort, that nobody would overlook."""
NOISE = 4.0
"""Multiple of the residual in motion that an error at rest must exceed as well."""
UNEVEN = 1.5
"""Ratio to a robust estimate above which a residual comes in bursts, since noise is about even throughout a recording."""


@dataclass(frozen=True)
class Remainder:
    """The residual of the extended model.

    Attributes:
        floor: noise floor of each joint: RMS of what no input predicts on held-out blocks, between bursts if it comes in
            such, (n,) [N·m].
        inputs: for joints with a predictable residual, the mean square that each "joint.input" predicts [(N·m)²].
        predicted: prediction of the residual on held-out blocks, rows (R, n) [N·m].
        bursts: joints whose unpredictable residual comes in bursts larger than quantised positions can cause.
        resting: joints with a large residual at rest, where dry friction may hold anything.
    """

    floor: np.ndarray
    inputs: Mapping[str, Mapping[str, float]]
    predicted: np.ndarray
    bursts: tuple[str, ...] = ()
    resting: tuple[str, ...] = ()

    def depends_on(self, joints: Sequence[str] = ()) -> dict[str, str]:
        """Inputs that predict the residual at some joints (all by default), strongest first, each with its main joint."""
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
    """Regress a residual, rows (R, n) [N·m], on position, velocity, acceleration and load of joints, on time, and on pairs.

    Args:
        stepping: apparent effort that quantised positions may cause at each joint, (n,) [N·m].
        dry: known dry friction of each joint, which may hold it at rest, (n,) [N·m].
    """
    joints, groups = equations.motion.signals.joints, single(equations)
    predicted = np.zeros_like(residual)
    inputs: dict[str, dict[str, float]] = {}
    told = in_two(lambda j: _told(equations, groups, residual[:, j], j), range(equations.rows.width))
    for j, found in enumerate(told):
        if found is not None:
            predicted[:, j], inputs[joints[j]] = found
    left, each = residual - predicted, range(equations.rows.width)
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
    """Prediction of a joint's residual (R,) from inputs, and how much each explains [(N·m)²]; None if not certain.

    Pairs of inputs are tried only where single ones leave much, and accepted if they explain much of that.
    """
    rows = equations.usable[:, joint]
    own = {**groups, **ageing(equations, joint)}
    guess, shares = _guess(equations, own, residual, rows)
    before = float(np.sum(residual[rows] ** 2))
    if rms((residual - guess)[rows]) > MATTERS * equations.rows.effort_scale[joint]:
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
    """Prediction of a residual (R,) and the shares of groups that help; zero and none if chance would do as well."""
    guess, shares = Predictor(groups, residual, rows, equations.rows.block).predicted()
    left = residual - guess
    before, after = float(np.sum(residual[rows] ** 2)), float(np.sum(left[rows] ** 2))
    if before - after <= WORTH * before + by_chance(left, rows, len(groups)) * after:
        return np.zeros_like(residual), {}
    return guess, {key: share for key, share in shares.items() if share > 0.0}


def _borne_at_rest(equations: Equations, residual: np.ndarray, dry: np.ndarray | float) -> np.ndarray:
    """Joints at rest with a large residual, rows (R, n), throughout a period of the low-pass, (n,) bool.

    Large beyond known dry friction, which at rest may be anywhere between both directions', and beyond the noise.
    """
    signals, usable = equations.motion.signals, equations.rows.usable
    noise = np.array([rms(residual[rows, j]) if rows.any() else 0.0 for j, rows in enumerate(usable.T)])
    held = 2.0 * dry + NOISE * noise
    resting = signals.seen[equations.rows.samples] & ~usable
    large = resting & (np.abs(residual) > LARGE_ERROR * equations.rows.effort_scale + held)
    step = float(np.median(np.diff(signals.time[equations.rows.samples])))
    period = int(np.ceil(1.0 / (signals.cutoff * step)))
    return np.asarray(binary_opening(large, np.ones((period, 1), bool)).any(axis=0))


def _between_bursts(equations: Equations, left: np.ndarray, joint: int) -> float:
    """Robust standard deviation of a joint's residual (R,), with the noise of each recording estimated apart.

    Another place or a faster motion may have more noise throughout.
    """
    signals, rows = equations.motion.signals, equations.usable[:, joint]
    whose = owners(equations.rows.time, signals.begun)[rows]
    variances = np.zeros(len(whose))
    for one in np.unique(whose):
        own = whose == one
        variances[own] = (GAUSSIAN * np.median(np.abs(left[rows][own]))) ** 2
    return float(np.sqrt(variances.mean())) if len(variances) else 0.0
