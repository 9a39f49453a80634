"""Efforts of two or three joints that are scaled, as of one type of motor.

Links that are off together make up for most of each scale, so that none of them may help alone, and another one, or the
links, may be taken for all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.gathering import Score
from bdnn_ros.effects.actuation import EffortScale


def scaled_together(
    pool: Pool, chosen: Sequence[int], link_errors: Sequence[float], worth: Score
) -> list[tuple[float, list[Term]]]:
    """Sets with two or three scales more, or in place of all chosen ones, and by how much each falls behind the chosen [nats].

    Args:
        link_errors: tried for each; the right ones may need less of them.
        worth: score of a set of a pool's terms, including the prior of the pool's link error.
    """
    scales = [c for c, term in enumerate(pool.terms) if term.effect.name == EffortScale.name]
    bases = {tuple(c for c in chosen if c not in scales), tuple(chosen)}
    pools = [pool.with_link_error(error) for error in link_errors]

    def best(members: Sequence[int]) -> float:
        return max(worth(each, members) for each in pools)

    def sets() -> Iterator[list[int]]:
        for base in sorted(bases):
            for size in (2, 3):
                for several in combinations((c for c in scales if c not in base), size):
                    yield [*base, *several]

    now = best(chosen)
    return [(now - best(members), [pool.terms[c] for c in members]) for members in sets()]
