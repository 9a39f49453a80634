"""Fits the local networks by ridge regression; its strength is cross-validated on blocks of time, joint by joint."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.bdnn.cores import PriorCore
from bdnn_ros.bdnn.local import LocalNetworks, penalties
from bdnn_ros.signals import Signals

STRENGTHS = tuple(10.0**power for power in range(-6, 2))
"""Ridge strengths tried, relative to the features' mean square."""
LEAST_GAIN = 0.02
"""A joint keeps its network if the error on blocks left out falls by this share at least ..."""
CERTAINTY = 2.0
"""... and by so many standard errors over the blocks."""
BLOCKS = 10
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

    def __sub__(self, other: Sums) -> Sums:
        gram, right = self.gram - other.gram, self.right - other.right
        return Sums(gram, right, self.square - other.square, self.count - other.count)

    def error(self, weights: np.ndarray) -> float:
        """Mean squared residual with output weights (F,)."""
        return float(weights @ (self.gram @ weights - 2.0 * self.right) + self.square) / self.count


def fit_local(core: PriorCore, parts: Sequence[Signals]) -> LocalNetworks:
    """Networks for what the core's prior leaves out; only an offset where more does not help.

    Features and residual are low-passed alike.
    """
    silent = replace(core.local, output_weights=np.zeros_like(core.local.output_weights))
    blocks = sums_of(replace(core, local=silent), parts)
    weights = np.array([chosen_weights(of_joint, penalties(core.local)) for of_joint in blocks])
    return replace(core.local, output_weights=weights)


def sums_of(core: PriorCore, parts: Sequence[Signals]) -> list[list[Sums]]:
    """Sums for every joint over blocks of time, `BLOCKS` of them or one for each part."""
    each = max(round(BLOCKS / len(parts)), 1)
    result: list[list[Sums]] = [[] for _ in core.joints]
    for signals in parts:
        assert signals.effort is not None
        residual = signals.smooth(signals.effort - core.predict(signals))
        load = core.prior.gravity(signals.position)
        for joint, sums in enumerate(result):
            sums += _joint_sums(core.local, signals, residual[:, joint], load, joint, each)
    return result


def _joint_sums(
    networks: LocalNetworks, signals: Signals, residual: np.ndarray, load: np.ndarray, joint: int, blocks: int
) -> list[Sums]:
    motion = (signals.position, signals.velocity, signals.sign, load)
    pieces = [
        networks.features(joint, *(values[k : k + PIECE] for values in motion))
        for k in range(0, len(signals), PIECE)
    ]
    features = signals.smooth(np.concatenate(pieces))
    result = []
    # signals of a few samples give fewer blocks, or none; so do those without an effort of this joint
    inside = np.flatnonzero(signals.interior & signals.seen[:, joint])
    for rows in np.array_split(inside, min(blocks, len(inside))) if len(inside) else []:
        x, y = features[rows], residual[rows]
        result.append(Sums(x.T @ x, x.T @ y, float(y @ y), len(rows)))
    return result


def chosen_weights(blocks: list[Sums], penalty: np.ndarray) -> np.ndarray:
    """Output weights (F,) of one joint; zero if there is nothing to learn from."""
    if not blocks:
        return np.zeros_like(penalty)
    everything = sum(blocks[1:], blocks[0])
    plain = _left_out(blocks, everything, _offset)
    trials = {s: _left_out(blocks, everything, _Ridge(penalty, s)) for s in STRENGTHS}
    strength = min(STRENGTHS, key=lambda s: float(np.mean(trials[s])))
    gains = plain - trials[strength]
    doubt = CERTAINTY * float(np.std(gains)) / np.sqrt(max(len(gains) - 1, 1))
    if float(np.mean(gains)) > max(doubt, LEAST_GAIN * float(np.mean(plain))):
        return _Ridge(penalty, strength)(everything)
    still = np.array([block.error(np.zeros_like(penalty)) for block in blocks])
    return _offset(everything) if np.mean(plain) < np.mean(still) else np.zeros_like(penalty)


def _left_out(blocks: list[Sums], everything: Sums, solve: Callable[[Sums], np.ndarray]) -> np.ndarray:
    """Error on each block with the weights solved without it; with a single block, on that block itself."""
    if len(blocks) == 1:
        return np.array([blocks[0].error(solve(blocks[0]))])
    return np.array([block.error(solve(everything - block)) for block in blocks])


def _offset(sums: Sums) -> np.ndarray:
    weights = np.zeros_like(sums.right)
    weights[0] = sums.right[0] / sums.gram[0, 0]
    return weights


@dataclass(frozen=True)
class _Ridge:
    penalty: np.ndarray
    strength: float

    def __call__(self, sums: Sums) -> np.ndarray:
        size = self.strength * float(np.mean(np.diag(sums.gram)))
        return np.linalg.solve(sums.gram + size * np.diag(self.penalty), sums.right)
