"""One cause more, for which what was identified need not be doubted so much."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.odds import contains
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.moves import Moves

TRIED = 2
"""So many causes are tried, those first that bring the most."""


def surer(moves: Moves, now: Pool, link_errors: Sequence[float]) -> list[Callable[[], Pool]]:
    """The terms of a pool with one more each, beside an identified model that is doubted by a step less.

    What a single cause does, all parameters of a model together may do as well where they are doubted more than they need be,
    and the noise is then what these leave: by that noise neither the cause nor the smaller doubt pays alone.

    Args:
        link_errors: spreads of the errors that are tried.
    """
    smaller = [error for error in link_errors if error < now.link_error]
    if now.equations.jointwise is None or not smaller:
        return []
    chosen, equations, error = range(len(now.terms)), now.equations, max(smaller)
    pool = now.believing(error)
    shaped = moves.candidates.shaped(equations, pool, pool.fit(chosen))
    pool = Pool(equations, now.noise, [*now.terms, *shaped], error)
    open_ = moves.open_to(pool, chosen)
    ahead = pool.gains(pool.fit(chosen), open_) - moves.costs(pool, chosen, open_)
    likely = [pool.terms[open_[k]] for k in np.argsort(-ahead)[:TRIED] if ahead[k] > 0.0]
    return [partial(_with, now, one, error) for one in likely]


def _with(now: Pool, more: Term, link_error: float) -> Pool:
    """The terms of a pool with one more that takes the place of what it contains."""
    kept = [term for term in now.terms if not contains(more, term)]
    return Pool(now.equations, now.noise, [*kept, more], link_error)
