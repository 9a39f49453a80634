"""Features for the effort of a joint beyond rigid bodies: speed-dependent friction, load, position, neighbouring joints.

Each joint has a small network of its own: a hidden layer of fixed features (below) and output weights, which are identified
together with the rigid bodies, so that neither absorbs what the other explains.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

CURVE = (0.003, 0.0065, 0.014, 0.03, 0.065, 0.14, 0.3)
"""Speeds, in units of the limit, below which friction may differ from Coulomb and viscous friction."""
HARMONICS = 30
"""Highest number of periods per radian of an effort that depends on the position."""
LONG_WAVE = 4
"""Fewer periods per radian than these are believed less, the fewer the less."""
DIRECTED_HARMONICS = 1
"""The same, of an effort that also depends on the direction."""
CURVE_FEATURES = len(CURVE) + 1
GROUPS = {
    "curve": CURVE_FEATURES,
    "load": 2,
    "direction": 2 * DIRECTED_HARMONICS,
    "position": 2 * HARMONICS,
    "neighbours": 4,
}
"""Groups of features that are switched on together, and how many features each has."""
FEATURES = sum(GROUPS.values())
SPREAD = {"curve": 0.3, "load": 1.0, "direction": 0.1, "position": 1.0, "neighbours": 0.3}
"""Prior standard deviation of the weights of each group, per friction of the joint, or per what that leaves if it is more."""


@dataclass(frozen=True)
class Scales:
    """Units of the features: typical effort [N·m] and velocity limit [rad/s] of each joint, (n,)."""

    effort: np.ndarray
    velocity: np.ndarray


@cache
def group_slices() -> dict[str, slice]:
    """The slice of each group among the features."""
    edges = np.cumsum([0, *GROUPS.values()])
    return {name: slice(int(a), int(b)) for name, a, b in zip(GROUPS, edges[:-1], edges[1:], strict=True)}


def features(
    position: np.ndarray, velocity: np.ndarray, direction: np.ndarray, load: np.ndarray, scales: Scales
) -> np.ndarray:
    """All features of each joint, (N, n, FEATURES), of order one.

    Args:
        position, velocity: (N, n).
        direction: state of dry friction, (N, n), -1 to 1.
        load: effort that the rigid bodies ask of each joint, (N, n) [N·m].
    """
    speed = velocity / scales.velocity
    burden = np.abs(load) / scales.effort
    sines, cosines = _waves(position)
    directed = [direction * wave[:, k] for k in range(DIRECTED_HARMONICS) for wave in (sines, cosines)]
    neighbours = [_shifted(values, step) for values in (speed, direction) for step in (-1, 1)]
    own = [*curve(speed, direction), burden * direction, burden * speed, *directed]
    # in memory the joints come last, as they do in what the features are made of
    parts = [np.stack(own, axis=1), sines, cosines, np.stack(neighbours, axis=1)]
    return np.swapaxes(np.concatenate(parts, axis=1), 1, 2)


def curve(speed: np.ndarray, direction: np.ndarray) -> list[np.ndarray]:
    """Features of the friction curve: its deviation from Coulomb and viscous friction, CURVE_FEATURES of them.

    Args:
        speed: velocity in units of its limit.
        direction: state of dry friction, -1 to 1.
    """
    # what is left of a step when a softer one is taken from it
    return [*(direction - np.tanh(speed / width) for width in CURVE), speed * np.abs(speed)]


def feature_spread() -> np.ndarray:
    """Prior standard deviation of each feature's weight, in units of `SPREAD`, (FEATURES,)."""
    where, spread = group_slices(), np.empty(FEATURES)
    waves = largest_waves() / np.arange(1, HARMONICS + 1)
    for name, values in SPREAD.items():
        spread[where[name]] = np.tile(waves, 2) if name == "position" else values
    return spread


def largest_waves() -> np.ndarray:
    """Upper bound of the prior deviation of each position harmonic, as `feature_spread`, (HARMONICS,).

    Low harmonics resemble gravity, which is known better.
    """
    return SPREAD["position"] * np.minimum((np.arange(1, HARMONICS + 1) / LONG_WAVE) ** 2, 1.0)


def _waves(position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """sin(k q) and cos(k q) of positions (N, n) for all `HARMONICS` k, (N, HARMONICS, n) each, by angle-sum formulas."""
    sines, cosines = (np.stack([wave(position)], axis=1) for wave in (np.sin, np.cos))
    known = 1
    while known < HARMONICS:
        more = min(known, HARMONICS - known)
        s, c, last_s, last_c = sines[:, :more], cosines[:, :more], sines[:, -1:], cosines[:, -1:]
        sines = np.concatenate([sines, s * last_c + c * last_s], axis=1)
        cosines = np.concatenate([cosines, c * last_c - s * last_s], axis=1)
        known += more
    return sines, cosines


def _shifted(values: np.ndarray, step: int) -> np.ndarray:
    """Values of the joint before (step -1) or after (1); zero beyond the ends."""
    result = np.zeros_like(values)
    if step < 0:
        result[:, 1:] = values[:, :-1]
    else:
        result[:, :-1] = values[:, 1:]
    return result
