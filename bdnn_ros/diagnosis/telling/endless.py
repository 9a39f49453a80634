"""Pushes whose start or end is not seen, and which another cause that changed meanwhile may imitate."""

from __future__ import annotations

import numpy as np

from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.recorded.joining import stretches
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.telling.notes import DOWN
from bdnn_ros.effects.base import SHOWN
from bdnn_ros.effects.environment import EDGES, FORCE

UNSEEN = (
    "That the push on {where} {edge} is not seen: what changes once, or creeps, as the zero of a sensor that gets warm, would do "
    "the same."
)
"""Note on a push that may be no push."""
ONE_BY_ONE = (
    " It lasts all through a recording, and each may have drifted by itself: diagnose them one by one, too."
)
"""Added where whole recordings differ: drifts are only searched from start to end of all recordings together."""


def endless(estimate: Estimate, where: str, equations: Equations) -> list[str]:
    """The note on a push whose start or end no recording shows and that is no load; else none.

    A load that is put down was there from the start, one that is taken up may stay to the end: both pull as a weight does.

    Args:
        where: the name of its joint or link.
    """
    if not estimate.term.effect.timed or _pulls_down(estimate, equations):
        return []
    start, end = (estimate.quantities[edge] for edge in EDGES)
    pieces = stretches(equations.rows.time, equations.motion.signals.begun)
    # a time between two recordings is before the later one and after the earlier one
    begins = any(first < start.value - start.std <= start.value <= last for first, last in pieces)
    ends = any(first <= end.value <= end.value + end.std < last for first, last in pieces)
    unseen = ["begins"] * (not begins) + ["ends"] * (not ends)
    told = UNSEEN.format(where=where, edge=" or ".join(unseen))
    return [told + ONE_BY_ONE * (len(unseen) == len(EDGES) and len(pieces) > 1)] * bool(unseen)


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
