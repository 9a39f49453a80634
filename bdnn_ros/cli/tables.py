"""Cells of the tables that verbs print."""

from __future__ import annotations

import math

from bdnn_ros.cli.options import counted
from bdnn_ros.scores import Scores


def cell(value: float, width: int, digits: str) -> str:
    """A number as a format says, in a column; `-` for what is not known."""
    return f"{'-' if math.isnan(value) else format(value, digits):>{width}}"


def mean_of(scores: Scores) -> str:
    """What the row of the means is called: of which joints, where those are not all."""
    count = len(scores.joints)
    if scores.in_mean == count:
        return "mean"
    return f"mean of {scores.in_mean} of {counted(count, 'joint')}"
