"""Merging of pushes: one push on one link, from its start to its end, in place of several that stand for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bdnn_ros.diagnosis.pushes.contact import distance
from bdnn_ros.diagnosis.pushes.pushes import (
    follows,
    lasting,
    nearest,
    pushes_but,
    reshaped,
    tie_margin,
    together,
)
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.search.moves import BETTER
from bdnn_ros.diagnosis.search.parting import split_recurring
from bdnn_ros.robot import Robot

Score = Callable[[Pool, Sequence[int]], float]


def gathered(pool: Pool, chosen: list[int], robot: Robot, score: Score) -> tuple[Pool, list[int]]:
    """Replace simultaneous pushes by a single one on the link that explains most beside all else.

    Args:
        score: of a set of a pool's terms, see `Moves.score`.
    """
    pool, chosen = split_recurring(pool, chosen, robot, score)
    pool, chosen = _joined(pool, chosen, robot, score)
    for one in [c for c in chosen if pool.terms[c].effect.timed]:
        if one not in chosen:
            continue
        rest = [c for c in chosen if not together(pool.terms[c], pool.terms[one])]
        other = reshaped(pool, rest, robot, [c for c in chosen if c not in rest])
        pushes = pushes_but(other, rest, one)
        scores, without = {c: score(other, [*rest, c]) for c in pushes}, score(other, rest)
        best = nearest(other, scores, without, robot)
        better = scores[best] - score(pool, chosen)
        if distance(other.terms[best], robot) < distance(pool.terms[one], robot):
            better += tie_margin(other.terms[best], scores[best] - without)
        if better > BETTER:
            pool, chosen = pool.replacing({best: other.terms[best]}), [*rest, best]
    return pool, chosen


def _joined(pool: Pool, chosen: list[int], robot: Robot, score: Score) -> tuple[Pool, list[int]]:
    """Replace two pushes that follow each other by either one, over the time of both, where that scores better.

    Until its point is found a push looks shorter than it is, and its remainder like another one.
    """
    for pair in [(a, b) for a in chosen for b in chosen if follows(pool.terms[a], pool.terms[b])]:
        if set(pair) <= set(chosen):
            rest = [c for c in chosen if c not in pair]
            sets = [(lasting(pool, rest, pair, c, robot), [*rest, c]) for c in pair]
            pool, chosen = max([(pool, chosen), *sets], key=lambda one: score(*one))
    return pool, chosen
