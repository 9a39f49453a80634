"""Laws that grow with time in recordings too short for drifts, which would do the same."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.regression.building import least_motion
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.sentences import Kind, Note

ALIKE = 0.9
"""Squared correlation with time above which an effect grows with time."""


def with_time(estimate: Estimate, where: str, equations: Equations) -> Iterator[Note]:
    """The note on a law that grows with time where no drift was searched for; else none.

    Args:
        where: the name of its joint or link.
    """
    joint = estimate.term.target
    if joint < 0 or estimate.term.effect.timed:
        return
    rows = equations.usable[:, joint]
    if not rows.any() or equations.rows.moving[joint] >= least_motion(equations.motion.signals):
        return
    does = (equations.columns.of(estimate.term)[rows, joint] @ estimate.coefficients).astype(float)
    time = equations.rows.time[rows]
    varies = does.std() > np.finfo(float).eps * np.abs(does).max() * len(does)
    if varies and np.corrcoef(time, does)[0, 1] ** 2 > ALIKE:
        yield Note(Kind.WITH_TIME, {"where": where})
