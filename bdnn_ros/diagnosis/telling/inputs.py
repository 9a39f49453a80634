"""Inputs that an unexplained effort may depend on: position, velocity, acceleration and load of joints, time, and pairs."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.polynomial.legendre import legvander

from bdnn_ros.diagnosis.regression.equations import Equations

Key = tuple[str, ...]
"""Inputs that a group of features is made of: "joint.quantity" each, or "time"."""

TIME = "time"
HARMONICS = 9
PLACES = 24
"""Hat functions along a joint's range, for what occurs at one place only."""
DEGREE, AGEING = 4, 3
"""Degrees of polynomials: of a position multiplied with another input, and (`AGEING`) of time."""


def single(equations: Equations) -> dict[Key, np.ndarray]:
    """Features of every joint's position, velocity, acceleration and load, rows (R, k) each.

    Made at the working rate and then low-passed and decimated, as columns of effects are.
    """
    motion = equations.motion
    groups: dict[str, np.ndarray] = {}
    for j, name in enumerate(motion.signals.joints):
        q, v, load = motion.position[:, j], motion.velocity[:, j], motion.load[:, j]
        groups[f"{name}.acceleration"] = motion.acceleration[:, j : j + 1]
        waves = [f(k * q) for k in range(1, HARMONICS + 1) for f in (np.sin, np.cos)]
        fast = np.abs(v) / max(float(np.std(v)), 1e-6)
        groups[f"{name}.position"] = np.stack(waves, axis=1)
        steps = [motion.signals.sign[:, j] * np.exp(-fast * k) for k in (0.0, 1.0, 4.0, 16.0)]
        groups[f"{name}.velocity"] = np.stack([v, v * np.abs(v), *steps], axis=1)
        groups[f"{name}.load"] = np.stack(
            [load, np.abs(load) * motion.signals.sign[:, j], load * np.abs(load)], axis=1
        )
    return {(key,): _reduced(equations, values) for key, values in groups.items()}


def ageing(equations: Equations, joint: int) -> dict[Key, np.ndarray]:
    """Features (R, k) of time: slow changes of a joint's offset, viscous and Coulomb friction."""
    motion = equations.motion
    slow = legvander(_along(motion.time), AGEING)
    of = np.stack(
        [np.ones_like(motion.time), motion.velocity[:, joint], motion.signals.sign[:, joint]], axis=1
    )
    return {(TIME,): _reduced(equations, _products(slow, of)[:, 1:])}


def pairs(equations: Equations, joint: int) -> dict[Key, np.ndarray]:
    """Features (R, k) of products of two inputs, one of them of this joint.

    Friction that differs along the way, say, or an effort by the product of two velocities. A joint's position paired with
    itself stands for what occurs at a place.
    """
    every = {
        key: values for j in range(equations.rows.width) for key, values in _factors(equations, j).items()
    }
    own = _factors(equations, joint)
    found: dict[Key, np.ndarray] = {}
    for key, values in own.items():
        for other, beside in every.items():
            if other not in own or other > key:
                found[key, other] = _reduced(equations, _products(values, beside))
    name = equations.motion.signals.joints[joint]
    position, velocity, load = f"{name}.position", f"{name}.velocity", f"{name}.load"
    found[position, position] = _reduced(equations, _places(equations.motion.position[:, joint]))
    found[velocity, velocity] = _reduced(
        equations, np.stack([own[velocity][:, 0] ** 2, own[velocity][:, 1]], axis=1)
    )
    found[load, load] = _reduced(equations, own[load] ** 2)
    return found


def names(key: Key) -> Iterable[str]:
    """Inputs of a group, without repetition."""
    return dict.fromkeys(key)


def _factors(equations: Equations, joint: int) -> dict[str, np.ndarray]:
    """Factors of each input of a joint for products, (N, k) each."""
    motion, name = equations.motion, equations.motion.signals.joints[joint]
    v = motion.velocity[:, joint]
    return {
        f"{name}.position": legvander(_along(motion.position[:, joint]), DEGREE)[:, 1:],
        f"{name}.velocity": np.stack([v, np.abs(v), motion.signals.sign[:, joint]], axis=1),
        f"{name}.load": motion.load[:, joint : joint + 1],
    }


def _along(values: np.ndarray) -> np.ndarray:
    """Values scaled to their range, -1 to 1."""
    low, high = float(values.min()), float(values.max())
    return np.asarray(2.0 * (values - low) / max(high - low, 1e-9) - 1.0)


def _places(position: np.ndarray) -> np.ndarray:
    """Hat functions of a position, denser where the joint is more often, (N, at most `PLACES`)."""
    at = np.unique(np.quantile(position, np.linspace(0.0, 1.0, PLACES)))
    return np.stack([np.interp(position, at, one) for one in np.eye(len(at))], axis=1)


def _products(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Products of all features of one with all of the other, (N, k) and (N, m) to (N, k m)."""
    return np.asarray((one[:, :, None] * other[:, None, :]).reshape(len(one), -1))


def _reduced(equations: Equations, values: np.ndarray) -> np.ndarray:
    return np.asarray(equations.motion.signals.smooth(values)[equations.rows.samples])
