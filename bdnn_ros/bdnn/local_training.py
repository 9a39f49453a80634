"""Fitting the local networks: a ridge whose strength the held-out blocks choose, joint by joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bdnn_ros.bdnn.cores import PriorCore
from bdnn_ros.bdnn.local import LocalNetworks, penalties
from bdnn_ros.signals import Signals

STRENGTHS = tuple(10.0**power for power in range(-6, 2))
"""Ridge strengths tried, relative to the features' mean square."""
LEAST_GAIN = 0.02
"""A joint keeps its network if the held-out error falls by this share at least."""
PIECE = 20_000
"""Samples at a time: features are many."""


@dataclass(frozen=True)
class Sums:
    """Second moments of features and residual of one joint.

    Attributes:
        gram: (F, F).
        right: (F,).
        square: of the residual.
        count: number of samples.
    """

    gram: np.ndarray
    right: np.ndarray
    square: float
    count: int

    def __add__(self, other: Sums) -> Sums:
        return Sums(
            self.gram + other.gram,
            self.right + other.right,
            self.square + other.square,
            self.count + other.count,
        )

    def error(self, weights: np.ndarray) -> float:
        """Mean squared residual with output weights (F,)."""
        return float(weights @ (self.gram @ weights - 2.0 * self.right) + self.square) / self.count


def fit_local(core: PriorCore, train: Sequence[Signals], validation: Sequence[Signals]) -> LocalNetworks:
    """Networks for what the core's prior leaves out; silent but for an offset where they do not help.

    Features and residual are low-passed alike. Once the strength is chosen, the weights are those of all
    data.
    """
    silent = replace(core.local, output_weights=np.zeros_like(core.local.output_weights))
    learn, judge = (sums_of(replace(core, local=silent), parts) for parts in (train, validation))
    weights = np.array([_chosen(a, b, penalties(core.local)) for a, b in zip(learn, judge, strict=True)])
    return replace(core.local, output_weights=weights)


def sums_of(core: PriorCore, parts: Sequence[Signals]) -> list[Sums]:
    """Sums of every joint over several recordings' signals."""
    total: list[Sums] = []
    for signals in parts:
        assert signals.effort is not None
        residual = signals.smooth(signals.effort - core.predict(signals))
        load = core.prior.gravity(signals.position)
        found = [_joint_sums(core.local, signals, residual, load, joint) for joint in range(signals.width)]
        total = [a + b for a, b in zip(total, found, strict=True)] if total else found
    return total


def _joint_sums(
    networks: LocalNetworks, signals: Signals, residual: np.ndarray, load: np.ndarray, joint: int
) -> Sums:
    held: dict[str, Any] = {k: getattr(networks, k)[joint : joint + 1] for k in networks.array_names}
    one = LocalNetworks(**held, harmonics=networks.harmonics)
    column = slice(joint, joint + 1)
    inputs = (signals.position, signals.velocity, signals.sign, load)
    features = signals.smooth(_features(one, [values[:, column] for values in inputs]))[signals.interior]
    target = residual[signals.interior, joint]
    return Sums(features.T @ features, features.T @ target, float(target @ target), len(target))


def _features(networks: LocalNetworks, inputs: list[np.ndarray]) -> np.ndarray:
    pieces = [
        networks.features(*(values[k : k + PIECE] for values in inputs))[:, 0]
        for k in range(0, len(inputs[0]), PIECE)
    ]
    return np.concatenate(pieces)


def _chosen(learn: Sums, judge: Sums, penalty: np.ndarray) -> np.ndarray:
    """Output weights (F,) of one joint."""
    both = learn + judge
    offset = np.zeros_like(penalty)
    offset[0] = learn.right[0] / learn.gram[0, 0]
    best = min((judge.error(_ridge(learn, penalty, s)), s) for s in STRENGTHS)
    if best[0] < (1.0 - LEAST_GAIN) * min(judge.error(offset), judge.error(0.0 * offset)):
        return _ridge(both, penalty, best[1])
    offset[0] = both.right[0] / both.gram[0, 0]
    return offset if judge.error(offset) < judge.error(0.0 * offset) else 0.0 * offset


def _ridge(sums: Sums, penalty: np.ndarray, strength: float) -> np.ndarray:
    size = float(np.mean(np.diag(sums.gram)))
    return np.linalg.solve(sums.gram + strength * size * np.diag(penalty), sums.right)
