"""The terms of an attempt fitted to all rows, with laws that are not significant replaced by simpler ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bdnn_ros.diagnosis.judging.attempt import Attempt
from bdnn_ros.diagnosis.judging.posterior import CLEAR, Estimate, estimates, excesses
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.odds import contains
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.settling import refined
from bdnn_ros.effects.base import SHOWN


def simplified(
    candidates: Candidates, equations: Equations, attempt: Attempt
) -> tuple[Attempt, Pool, list[Estimate]]:
    """An attempt with insignificant laws simplified, its terms fitted to all rows without dwelling, and their estimates."""
    anywhere = excesses(_in_rows_that_count(equations, attempt.fitted))
    pool = _exact(candidates, equations, attempt.fitted)
    return _plain(candidates, equations, attempt, pool, _surely(anywhere, excesses(pool)))


def _surely(anywhere: Sequence[float], exact: Sequence[float]) -> list[bool]:
    """Whether each law significantly exceeds the one that it settles into.

    Args:
        anywhere: its excess in standard deviations, by all rows.
        exact: the same by rows without dwelling: an excess seen only in dwelling may be how friction reverses.
    """
    return [one > CLEAR and other > SHOWN for one, other in zip(anywhere, exact, strict=True)]


def _in_rows_that_count(equations: Equations, fitted: Pool) -> Pool:
    """The terms of a pool in all rows that are usable now."""
    return Pool(equations, fitted.noise, fitted.terms, fitted.link_error)


def _exact(candidates: Candidates, equations: Equations, fitted: Pool) -> Pool:
    """The terms in rows without dwelling, where dry friction appears smaller than it is.

    Shapes of friction at joints that dwell are refined again in the remaining rows.
    """
    dwelling = equations.usable & equations.rows.dwelling
    equations.use_rows(equations.exact)
    pool = _in_rows_that_count(equations, fitted)
    moved = [
        c for c, term in enumerate(pool.terms) if term.effect.in_drive and dwelling[:, term.target].any()
    ]
    return refined(candidates, equations, pool, range(len(pool.terms)), moved)


def _plain(
    candidates: Candidates, equations: Equations, attempt: Attempt, pool: Pool, surely: Sequence[bool]
) -> tuple[Attempt, Pool, list[Estimate]]:
    """The attempt, its pool and estimates, with insignificant laws replaced by what they settle into.

    They are dropped where another term says that already.

    Args:
        surely: whether each law significantly exceeds what it settles into.
    """
    found = estimates(pool, pool.whole)
    insignificant = (k for k, one in enumerate(found) if not (one.shown and surely[k]))
    settled = ((k, candidates.settled(found[k].term, equations.motion)) for k in insignificant)
    instead = {k: plain for k, plain in settled if plain is not None}
    if not instead:
        return attempt, pool, found
    others = [term for k, term in enumerate(pool.terms) if k not in instead]
    said = {
        k: any(other.place == plain.place or contains(other, plain) for other in others)
        for k, plain in instead.items()
    }
    kept = [k for k in range(len(pool.terms)) if not said.get(k)]

    def refitted(terms: Sequence[Term]) -> Pool:
        told = [instead.get(k) or terms[k] for k in kept]
        moved = [at for at, k in enumerate(kept) if k in instead]
        plain = Pool(equations, pool.noise, told, pool.link_error)
        return refined(candidates, equations, plain, range(len(kept)), moved)

    counted = equations.usable
    equations.use_rows(counted & ~attempt.test[:, None])
    fitted = refitted(attempt.fitted.terms)
    equations.use_rows(counted)
    judgements = [
        attempt.judgements[k].told_as(instead[k]) if k in instead else attempt.judgements[k] for k in kept
    ]
    plain = refitted(pool.terms)
    return replace(attempt, judgements=judgements, fitted=fitted), plain, estimates(plain, plain.whole)
