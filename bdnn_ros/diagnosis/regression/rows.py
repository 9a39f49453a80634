"""Rows of a regression: what was measured at the samples that are kept, and which of them count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.diagnosis.regression.noise import moving_time


@dataclass(frozen=True)
class Rows:
    """R rows of n joints.

    Attributes:
        samples: which working samples are rows, (R,) int.
        time: their stamps, (R,) [s].
        target: measured effort minus the simulation's, low-passed, (R, n) [N·m].
        usable: rows that count in fits, (R, n) bool: without segments' ends and joints that rest or stick. A search holds some
            of them out (see `Equations.use_rows`); priors are scaled by all, also for what acts in held-out rows only.
        sticking_doubt: share of each row's low-pass window in which the joint reverses or creeps, so that it may stick, (R, n).
        dwelling: rows in which it creeps for so long that its dry friction appears smaller than it is, (R, n) bool.
        block, runs: held-out block of each row, (R,) int, ascending from 0; rows of each gap-free piece.
        effort_scale, effort_size: standard deviation and root mean square of each joint's effort, (n,) [N·m].
    """

    samples: np.ndarray
    time: np.ndarray
    target: np.ndarray
    usable: np.ndarray
    sticking_doubt: np.ndarray
    dwelling: np.ndarray
    block: np.ndarray
    runs: list[slice]
    effort_scale: np.ndarray
    effort_size: np.ndarray

    @property
    def width(self) -> int:
        """Number of joints n."""
        return self.target.shape[1]

    @property
    def blocks(self) -> int:
        """Number of held-out blocks."""
        return int(self.block.max()) + 1

    @property
    def moving(self) -> np.ndarray:
        """How long each joint moves, (n,) [s]."""
        return moving_time(self.usable, self.time)
