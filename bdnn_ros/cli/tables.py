"""Cells of the tables that verbs print."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence

from bdnn_ros.cli.options import counted
from bdnn_ros.robot import Robot
from bdnn_ros.robot.units import along, printed
from bdnn_ros.scores import Scores


def csv_header(names: Sequence[str]) -> str:
    """The first line of a CSV; joints may have commas and quotes in their names."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(names)
    return line.getvalue()


def cell(value: float, width: int, digits: str) -> str:
    """A number as a format says, in a column; `-` for what is not known."""
    return f"{'-' if math.isnan(value) else format(value, digits):>{width}}"


def headed(robot: Robot | None, title: str, unit: str) -> str:
    """The head of a column with its unit, which the rows have where a joint slides."""
    return title if some_slide(robot) else f"{title} [{printed(unit)}]"


def labels(robot: Robot | None, joints: Sequence[str], *units: str) -> list[str]:
    """What the rows of joints begin with: their names; and where one slides, the units of each, given for those that turn."""
    if robot is None or not some_slide(robot):
        return list(joints)
    width = max(map(len, joints))
    slides = [bool(robot.slides[robot.joints.index(joint)]) for joint in joints]
    own = [", ".join(printed(along(unit, one)) for unit in units) for one in slides]
    return [f"{joint:{width}} [{one}]" for joint, one in zip(joints, own, strict=True)]


def some_slide(robot: Robot | None) -> bool:
    """Whether a table has rows of joints that are known to slide."""
    return robot is not None and bool(robot.slides.any())


def mean_of(scores: Scores) -> str:
    """What the row of the means is called: of which joints, where those are not all."""
    count = len(scores.joints)
    if scores.in_mean == count:
        return "mean"
    return f"mean of {scores.in_mean} of {counted(count, 'joint')}"
