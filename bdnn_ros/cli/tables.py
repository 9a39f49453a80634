"""Formatting of the tables that verbs print."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence

from bdnn_ros.cli.options import counted
from bdnn_ros.robot import Robot
from bdnn_ros.robot.units import along, printed
from bdnn_ros.scores import RESTS, Scores

MAKES = 1.5
"""Rows at rest make the error where it is so many times that of the rows in motion."""


def csv_header(names: Sequence[str]) -> str:
    """The first line of a CSV; joint names may contain commas and quotes."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(names)
    return line.getvalue()


def cell(value: float, width: int, digits: str) -> str:
    """A formatted number of a column; `-` if unknown."""
    return f"{'-' if math.isnan(value) else format(value, digits):>{width}}"


def headed(robot: Robot | None, title: str, unit: str) -> str:
    """The head of a column with its unit; if any joint slides, the units stand in the rows instead."""
    return title if some_slide(robot) else f"{title} [{printed(unit)}]"


def labels(robot: Robot | None, joints: Sequence[str], *units: str) -> list[str]:
    """The first cells of the joints' rows: the name, and if any joint slides, its units (given for revolute joints)."""
    if robot is None or not some_slide(robot):
        return list(joints)
    width = max(map(len, joints))
    slides = [bool(robot.slides[robot.joints.index(joint)]) for joint in joints]
    own = [", ".join(printed(along(unit, one)) for unit in units) for one in slides]
    return [f"{joint:{width}} [{one}]" for joint, one in zip(joints, own, strict=True)]


def some_slide(robot: Robot | None) -> bool:
    """Whether any joint is known to be prismatic."""
    return robot is not None and bool(robot.slides.any())


def mean_of(scores: Scores) -> str:
    """The label of the row of means, with the number of joints if it is not all of them."""
    count = len(scores.joints)
    if scores.in_mean == count:
        return "mean"
    return f"mean of {scores.in_mean} of {counted(count, 'joint')}"


def resting(scores: Scores) -> list[str]:
    """A sentence on rows at rest that make a good part of the error; empty list if none do."""
    moved = scores.in_motion
    if moved is None or not scores.resting > RESTS or not scores.nrmse_mean > MAKES * moved.nrmse_mean:
        return []
    return [
        f"{100.0 * scores.resting:.0f} % of the scored rows are at rest, where dry friction may have any value; "
        f"NRMSE in motion: mean {moved.nrmse_mean:.3f}."
    ]
