"""One search in all rows but some, and how well what it found predicts those."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.diagnosis.equations import Equations, Term
from bdnn_ros.diagnosis.evidence import Pool
from bdnn_ros.diagnosis.gains import MINIMUM_SHARE, rms
from bdnn_ros.diagnosis.identifiability import Judgement, judge, likelier, plainer
from bdnn_ros.diagnosis.search import Search, Selection
from bdnn_ros.diagnosis.settling import settled, windows_anew

SURPRISING = 2.0
"""Held-out error per error of the rest that says so."""
SWAPS = 5
"""So many findings may give way to a rival that proves likelier."""


@dataclass(frozen=True)
class Attempt:
    """What a search without the test rows found, and what all rows together make of it.

    Attributes:
        test: the rows that the search did not see, (R,) bool.
        judgements: of each term, by all rows.
        fitted: the terms, fitted to all rows but the test rows.
        extended: what the terms leave that the search found by itself, fitted alike, rows (R, n) [N·m]: those that all
            rows chose would be flattered by the test rows.
    """

    test: np.ndarray
    judgements: list[Judgement]
    fitted: Pool
    extended: np.ndarray


def attempted(search: Search, whole: np.ndarray, test: np.ndarray) -> Attempt:
    """What a search finds without the test rows (R,), and what all `whole` rows (R, n) make of it.

    In all of them the windows of wrenches are found anew, and terms give way to rivals or go; nothing is added.
    """
    equations = search.equations
    equations.count(whole & ~test[:, None])
    search.progress("first look")
    found = search.run()
    search.progress("weighing rivals")
    equations.count(whole)
    noise, link_error = found.pool.noise, found.pool.link_error
    terms = windows_anew(search.candidates, equations, Pool(equations, noise, found.terms, link_error)).terms
    selection, judgements = _reconsidered(search, found, terms)
    equations.count(whole & ~test[:, None])
    alone = settled(search.candidates, equations, Pool(equations, noise, terms, link_error))
    extended, fitted = alone.left(), alone
    if selection.terms != terms:
        fitted = settled(search.candidates, equations, Pool(equations, noise, selection.terms, link_error))
    equations.count(whole)
    return Attempt(test, judgements, fitted, extended)


def _reconsidered(search: Search, found: Selection, terms: list[Term]) -> tuple[Selection, list[Judgement]]:
    """The terms that were found, with the rows that count by now, and how sure each is."""
    places = {term.place for term in terms}
    others = [term for term in found.pool.terms if term.place not in places]
    pool = Pool(search.equations, found.pool.noise, [*terms, *others], found.pool.link_error)
    chosen = tuple(search.reconsidered(pool, list(range(len(terms)))))
    selection = plainer(Selection(pool, chosen, pool.fit(chosen)))
    judgements = judge(search, selection)
    for _ in range(SWAPS):
        better = likelier(selection, judgements)
        if better is None:
            break
        selection, judgements = better, judge(search, better)
    return selection, judgements


def surprise(attempt: Attempt, equations: Equations) -> float:
    """The largest held-out error of a joint per error of the rest, of those large enough to matter.

    Above `SURPRISING` the search cannot have seen its cause.
    """
    test, sure = attempt.test[:, None], attempt.fitted.sure
    held, rest = rms(attempt.extended, sure & test), rms(attempt.extended, sure & ~test)
    large = held > MINIMUM_SHARE * equations.effort_scale
    return float(np.max(np.where(large, held / np.maximum(rest, 1e-12), 0.0)))
