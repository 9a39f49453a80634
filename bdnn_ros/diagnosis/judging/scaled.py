"""A wrong effort scale as a rival: what it does to a joint's effort may be told only with a part that has no name yet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.odds import COMMON_COST
from bdnn_ros.diagnosis.regression.term import COMMON
from bdnn_ros.diagnosis.search.moves import UNSURE, Moves
from bdnn_ros.effects.actuation import EffortScale

OF_WEIGHT = ("effort_offset", "position_offset", "joint_spring")
"""What a share of a weight looks like, of one that is constant or changes with the position."""


def scaled(moves: Moves, pool: Pool, rest: Sequence[int], one: int) -> dict[int, float]:
    """Score of a wrong scale of a joint's effort, and one more common cause there, in the place of one of its terms.

    A scale holds for all that acts on a joint. Where its weight makes it look like an offset it would change what bodies do to
    the joint as well, but for a rotor that nothing else has shown: every drive has one, so that it costs no more here than what
    all joints have. As a rival a scale is never ahead by what only two can do, and what they bring beside the term does not
    speak against that.

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
