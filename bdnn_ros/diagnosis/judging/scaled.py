"""A wrong effort scale as a rival that may need a second, still unnamed cause at its joint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.odds import COMMON_COST
from bdnn_ros.diagnosis.regression.term import COMMON
from bdnn_ros.diagnosis.search.moves import UNSURE, Moves
from bdnn_ros.effects.actuation import EffortScale

OF_WEIGHT = ("effort_offset", "position_offset", "joint_spring")
"""Kinds that resemble a share of a weight, constant or changing with position."""


def scaled(moves: Moves, pool: Pool, rest: Sequence[int], one: int) -> dict[int, float]:
    """Scores of a wrong effort scale plus one more common cause at a joint, in the place of one of its terms.

    A scale acts on all of a joint's effort. Where the weight makes it look like an offset it would also change the inertial
    effort, unless a rotor that nothing else has shown makes up for it; that costs as little as what all joints have. The rival
    never scores above the term, and what the pair would explain beside the term does not count for it.

    Args:
        rest: the other terms.
    """
    if pool.terms[one].effect.name not in OF_WEIGHT:
        return {}
    there = [c for c in moves.open_to(pool, rest, pool.terms[one].target) if _beside(pool, c, one)]
    own, fit = moves.score(pool, [*rest, one]), pool.fit([*rest, one])
    result = {}
    for scale in (c for c in there if pool.terms[c].effect.name == EffortScale.name):
        more = [c for c in there if pool.terms[c].effect.name in COMMON]
        if not more:
            continue
        both = [*rest, scale]
        scores = pool.gains(pool.fit(both), more) - moves.costs(pool, both, more)
        best = more[int(np.argmax(scores))]
        usual = float(moves.costs(pool, both, [best])[0]) - COMMON_COST
        if moves.score(pool, both) + float(scores.max()) + usual > own - UNSURE:
            score = moves.score_beside(pool, [*rest, best], scale) + usual
            pair = [scale, best]
            besides = pool.gains(fit, pair) - moves.costs(pool, [*rest, one], pair)
            result[scale] = min(score - float(np.maximum(besides, 0.0).sum()), own)
    return result


def _beside(pool: Pool, candidate: int, one: int) -> bool:
    """Whether a candidate is another effect at a term's joint."""
    term, other = pool.terms[one], pool.terms[candidate]
    return other.link is None and other.target == term.target and other.spot != term.spot
