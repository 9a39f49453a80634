"""Training samples: signals low-passed once more, motion and effort alike, thinned to independent samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bdnn_ros.bdnn.field import Scales
from bdnn_ros.errors import RecordingError
from bdnn_ros.signals import MINIMUM_SAMPLES, Signals

THINNING = 1.0
"""Distance of the samples kept, in standard deviations of the low-pass that all have passed."""
SLOW_SHARE = 0.03
"""Dry friction changes over within this share of a joint's typical velocity."""
FEWEST = 50
SAMPLES_PER_SECOND, WORKING_SAMPLES_PER_SECOND = 300.0, 1000.0
"""What the last fits may take per second of budget, so that they end within it."""


@dataclass(frozen=True)
class Samples:
    """Motion and effort, (N, n) each.

    Attributes:
        position, velocity, acceleration: [rad], [rad/s], [rad/s²].
        direction: of the motion, −1 to 1, as soft as the effort.
        effort: [N·m], zero where it was not measured.
        seen: where it was, bool; nothing is learned elsewhere.
    """

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    direction: np.ndarray
    effort: np.ndarray
    seen: np.ndarray

    def __len__(self) -> int:
        return len(self.effort)

    @property
    def width(self) -> int:
        """Number of joints n."""
        return self.effort.shape[1]

    def rows(self, chosen: np.ndarray) -> Samples:
        """The samples of these rows."""
        return Samples(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    def some(self, count: int, rng: np.random.Generator) -> Samples:
        """At most `count` samples, drawn at random."""
        if len(self) <= count:
            return self
        return self.rows(np.sort(rng.choice(len(self), count, replace=False)))


def samples_of(parts: Sequence[Signals], thinning: float = THINNING) -> Samples:
    """Samples of several recordings' signals.

    Raises:
        RecordingError: there is no effort, or too little is left.
    """
    pieces = []
    for signals in parts:
        if signals.effort is None:
            raise RecordingError("There is no effort to learn from.", "Use --effort command, or another bag.")
        every = max(int(thinning * np.sqrt(2.0) * signals.kernel_std * signals.rate), 1)
        rows = np.flatnonzero(signals.interior)[::every]
        rows = rows[signals.seen[rows].any(axis=1)]
        seen = signals.seen[rows]
        motion = (signals.position, signals.velocity, signals.acceleration, signals.sign)
        effort = np.where(seen, signals.smooth(signals.effort)[rows], 0.0)
        pieces.append([*(signals.smooth(values)[rows] for values in motion), effort, seen])
    result = Samples(*(np.concatenate(column) for column in zip(*pieces, strict=True)))
    if len(result) < FEWEST:
        raise RecordingError(
            f"{len(result)} independent samples are too few to learn from.", "Record some seconds of motion."
        )
    return result


def scales_of(samples: Samples) -> Scales:
    """Typical magnitudes of a motion; joints that hardly move get those of the others."""
    velocity = _typical(samples.velocity)
    return Scales(
        velocity,
        _typical(samples.acceleration),
        _typical(samples.effort, samples.seen),
        np.maximum(SLOW_SHARE * velocity, 1e-4),
    )


def mean_square(errors: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """By joint, (n,), of errors (N, n) that are zero where unmeasured; zero for a joint that was never measured."""
    return np.asarray(np.sum(errors**2, axis=0) / np.maximum(np.sum(seen, axis=0), 1))


def _typical(values: np.ndarray, seen: np.ndarray | None = None) -> np.ndarray:
    if seen is None or seen.all():
        spread = np.std(values, axis=0)
    else:
        spread = np.std(values, axis=0, where=seen | ~seen.any(axis=0))
    return np.maximum(spread, 1e-3 * max(float(spread.max()), 1e-6))


def joined(first: Samples, second: Samples) -> Samples:
    """Both samples, concatenated."""
    names = Samples.__dataclass_fields__
    return Samples(*(np.concatenate([getattr(first, name), getattr(second, name)]) for name in names))


def shortened(parts: Sequence[Signals], most: int) -> list[Signals]:
    """The beginnings of several recordings' signals, `most` working samples in all, or a single one if that is too short."""
    total = sum(len(signals) for signals in parts)
    if total <= most:
        return list(parts)
    shares = [int(most * len(signals) / total) for signals in parts]
    if max(shares) < MINIMUM_SAMPLES:
        parts, shares = [max(parts, key=len)], [max(most, MINIMUM_SAMPLES)]
    return [
        signals.rows(np.arange(len(signals)) < share)
        for signals, share in zip(parts, shares, strict=True)
        if share >= MINIMUM_SAMPLES
    ]


def most_samples(budget: float) -> int:
    """Number of samples for the last fit of the bodies within a budget [s]."""
    return int(min(SAMPLES_PER_SECOND * budget, 1e9))


def most_working_samples(budget: float) -> int:
    """Number of working samples for the fit of the local networks within a budget [s]."""
    return int(min(WORKING_SAMPLES_PER_SECOND * budget, 1e9))
