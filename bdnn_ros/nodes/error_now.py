"""How well the model in service explains the effort at present (`effort_nrmse` on /diagnostics)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from bdnn_ros.online.stream.silent import relative

MEMORY = 3.0
"""Time the error is of [s]."""
SPREAD_MEMORY = 120.0
"""Time the spread is of, with which it is compared [s]: a robot at rest has none."""
BLOCK = 0.25
"""Instants of so long [s] are put together; a wrong reading, low-passed, is felt in two such at most."""
STANDS_OUT, STANDS_OUT_OF_SPREAD = 20.0, 5.0
"""A block whose error, or effort, is so many times that of the others is of wrong readings, not of the robot."""
ALONE, ALONE_IN_SPREAD = 2, 8
"""Unless there are more such blocks than this, or than a third of all."""


@dataclass(frozen=True)
class _Block:
    """Sums over some consecutive instants.

    Attributes:
        start: of the first [s].
        count: how many.
        known: joints whose effort is measured, (n,) bool.
        first: measured effort of the first, (known joints,): squares of what is added to it would hide how little that is.
        sums: of squared error, measured effort less the first, and the square of that, (3, known joints).
    """

    start: float
    count: int
    known: np.ndarray
    first: np.ndarray
    sums: np.ndarray


class ErrorNow:
    """NRMSE of the estimated effort: RMSE over the last seconds divided by the spread of the effort over the last minutes.

    One thread adds while another may read. Single implausible readings are left out: one in thousands would dominate.
    """

    def __init__(self) -> None:
        self._stamp = 0
        self._elapsed = 0.0
        self._blocks: deque[_Block] = deque()
        self._open: _Block | None = None

    def add(self, stamp: int, measured: np.ndarray, estimated: np.ndarray) -> None:
        """Add one instant: efforts (n,) [N·m], NaN where not measured, and its stamp [ns]."""
        known = np.isfinite(measured)
        measured, estimated = measured[known], estimated[known]
        with np.errstate(over="ignore", invalid="ignore"):
            squares = np.array([(measured - estimated) ** 2, measured**2])
        if not known.any() or not np.isfinite(squares).all():
            return
        self._elapsed += min(max((stamp - self._stamp) * 1e-9, 0.0), 1.0)
        self._stamp = stamp
        block = self._open
        if block is not None and not np.array_equal(block.known, known):
            self._blocks.clear()
        elif block is not None and self._elapsed - block.start < BLOCK:
            apart = measured - block.first
            sums = block.sums + np.array([squares[0], apart, apart**2])
            self._open = _Block(block.start, block.count + 1, known, block.first, sums)
            return
        elif block is not None:
            self._blocks.append(block)
        while self._blocks and self._elapsed - self._blocks[0].start > SPREAD_MEMORY:
            self._blocks.popleft()
        still = np.zeros_like(measured)
        self._open = _Block(self._elapsed, 1, known, measured, np.array([squares[0], still, still]))

    @property
    def nrmse(self) -> np.ndarray:
        """NRMSE of each joint, (n,), NaN where the effort was not measured or never changed; empty before the first instant."""
        last = self._open
        if last is None:
            return np.zeros(0)
        blocks = [block for block in (*self._blocks, last) if np.array_equal(block.known, last.known)]
        counts = np.array([block.count for block in blocks], float)
        first = np.array([block.first for block in blocks])
        squared, mean, power = (np.array([block.sums for block in blocks]) / counts[:, None, None]).swapaxes(
            0, 1
        )
        recent = [last.start - block.start < MEMORY for block in blocks]
        error = _mean(squared[recent], counts[recent], _usual(squared[recent], STANDS_OUT, ALONE))
        middle = np.median(first + mean, axis=0)
        away = first - middle
        apart = np.maximum(power + 2.0 * away * mean + away**2, 0.0)
        usual = _usual(apart, STANDS_OUT_OF_SPREAD, ALONE_IN_SPREAD)
        variance = _mean(apart, counts, usual) - _mean(away + mean, counts, usual) ** 2
        nrmse = np.full(len(last.known), np.nan)
        nrmse[last.known] = np.sqrt(relative(error, variance))
        return nrmse


def _usual(squared: np.ndarray, times: float, alone: int) -> np.ndarray:
    """Mask of mean squares, (N, n), whose root is at most `times` the largest one apart from the `alone` largest."""
    rest = np.sort(squared, axis=0)[-1 - min(alone, (len(squared) - 1) // 3)]
    return np.asarray(squared <= times**2 * rest)


def _mean(values: np.ndarray, counts: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Mean of the values (N, n) that are used, each of so many instants, (n,)."""
    weights = counts[:, None] * used
    return np.asarray((weights * values).sum(axis=0) / weights.sum(axis=0))
