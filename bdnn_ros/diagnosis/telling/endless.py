"""Pushes whose start or end no recording shows: loads that are taken up or put down, or another cause that changed meanwhile."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.pushes.pushes import ENDS
from bdnn_ros.diagnosis.recorded.joining import stretches
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.result import Finding
from bdnn_ros.diagnosis.sentences import Kind, Note
from bdnn_ros.effects.base import SHOWN
from bdnn_ros.effects.environment import EDGES, FORCE, ExternalWrench
from bdnn_ros.robot import Robot

DOWN = math.cos(math.radians(30.0))
"""Cosine of the largest angle to gravity of a force that may be a weight: a swung load pulls sideways, too."""


def endless(estimate: Estimate, where: str, equations: Equations) -> Iterator[Note]:
    """The note on a push whose start or end no recording shows and that is no load; else none.

    A load that is put down was there from the start, one that is taken up may stay to the end: both pull as a weight does.

    Args:
        where: the name of its joint or link.
    """
    if not estimate.term.effect.timed or _pulls_down(estimate, equations):
        return
    start, end = (estimate.quantities[edge] for edge in EDGES)
    pieces = stretches(equations.rows.time, equations.motion.signals.begun)
    # a time between two recordings is before the later one and after the earlier one
    begins = any(first < start.value - start.std <= start.value <= last for first, last in pieces)
    ends = any(first <= end.value <= end.value + end.std < last for first, last in pieces)
    if not (begins and ends):
        edges = ["begins"] * (not begins) + ["ends"] * (not ends)
        more = Note(Kind.ONE_BY_ONE) if len(edges) == len(EDGES) and len(pieces) > 1 else ""
        yield Note(Kind.ENDLESS, {"where": where, "edges": edges, "more": more})


def _pulls_down(estimate: Estimate, equations: Equations) -> bool:
    """Whether a push is a force that may be a weight, within its uncertainty."""
    if estimate.term.link is None:
        return False
    force, std = np.array([(q.value, q.std) for q in (estimate.quantities[axis] for axis in FORCE)]).T
    gravity = equations.motion.robot.gravity_vector
    down = gravity / max(float(np.linalg.norm(gravity)), 1e-9)
    weight = float(force @ down)
    sideways = (np.abs(force - weight * down) > SHOWN * std).any()
    return weight > (DOWN * float(np.linalg.norm(force)) if sideways else 0.0)


def loads(
    robot: Robot, findings: Sequence[Finding], time: np.ndarray, begun: Sequence[float] = ()
) -> Iterator[Note]:
    """Notes on pushes that may be loads: present from a recording's start, kept to its end, or both.

    Args:
        time: of the rows, (R,) [s].
        begun: when each of several recordings begins, see `Signals`.
    """
    gravity, pieces = float(np.linalg.norm(robot.gravity_vector)), stretches(time, begun)
    for finding in findings:
        if finding.effect != ExternalWrench.name or finding.link is None:
            continue
        force = np.array([finding.parameters[axis].value for axis in FORCE])
        start, end = (finding.parameters[edge].value for edge in EDGES)
        weight = float(force @ robot.gravity_vector) / max(gravity, 1e-9)
        if weight > DOWN * float(np.linalg.norm(force)):
            yield from _load(finding.link, weight / gravity, start, end, pieces)


def _load(
    where: str, mass: float, start: float, end: float, pieces: Sequence[tuple[float, float]]
) -> Iterator[Note]:
    """The note on what pulls as a mass [kg] would between two times [s], given each recording's first and last time."""
    first = next((begin for begin, last in pieces if last >= start), pieces[-1][0])
    last = next((last for begin, last in reversed(pieces) if begin <= end), pieces[0][1])
    from_start, to_end = start < first + ENDS, end > last - ENDS
    at_first, at_last = first == pieces[0][0], last == pieces[-1][1]
    values = {"where": where, "mass": mass, "start": start, "end": end}
    if from_start and to_end:
        if not (at_first and at_last):
            yield Note(Kind.CARRIED, {**values, "when": Note(Kind.BETWEEN)})
    elif from_start or to_end:
        when = Kind.FROM if to_end and at_last else Kind.UNTIL if from_start and at_first else Kind.BETWEEN
        done = "taken up" if to_end else "put down"
        yield Note(Kind.LIKE_A_LOAD, {**values, "when": Note(when), "done": done})
