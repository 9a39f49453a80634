"""One search in all rows but some, and how well what it found predicts those."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.diagnosis.equations import Equations
from bdnn_ros.diagnosis.evidence import Pool
from bdnn_ros.diagnosis.gains import MINIMUM_SHARE, rms
from bdnn_ros.diagnosis.identifiability import Judgement, judge, likelier
from bdnn_ros.diagnosis.search import Search, Selection
from bdnn_ros.diagnosis.settling import settled, windows_anew

SURPRISING = 2.0
"""Held-out error per error of the rest that says so."""
SWAPS = 5
"""So many findings may give way to a rival that proves likelier."""


@dataclass(frozen=True)
class Attempt:
    """What a search without the test rows found: its selection, and the fit to the rest with its error on all rows."""

    test: np.ndarray
    selection: Selection
    judgements: list[Judgement]
    fitted: Pool
    extended: np.ndarray


def attempted(search: Search, whole: np.ndarray, test: np.ndarray) -> Attempt:
    """What a search finds without the test rows (R,); the windows of wrenches are then found in all `whole` rows (R, n)."""
    equations = search.equations
    equations.count(whole & ~test[:, None])
    search.progress("first look")
    selection = search.run()
    search.progress("weighing rivals")
    judgements = judge(search, selection)
    for _ in range(SWAPS):
        better = likelier(selection, judgements)
        if better is None:
            break
        selection, judgements = better, judge(search, better)
    noise, link_error = selection.pool.noise, selection.pool.link_error
    equations.count(whole)
    terms = windows_anew(
        search.candidates, equations, Pool(equations, noise, selection.terms, link_error)
    ).terms
    equations.count(whole & ~test[:, None])
    fitted = settled(search.candidates, equations, Pool(equations, noise, terms, link_error))
    extended = fitted.residual(fitted.fit(range(len(terms))), blur=False)
    equations.count(whole)
    return Attempt(test, selection, judgements, fitted, extended)


def surprised(attempt: Attempt, equations: Equations) -> bool:
    """Whether a joint's held-out error is so far above that of the rest that the search cannot have seen its cause."""
    held = rms(attempt.extended, equations.usable & attempt.test[:, None])
    rest = rms(attempt.extended, equations.usable & ~attempt.test[:, None])
    return bool(((held > SURPRISING * rest) & (held > MINIMUM_SHARE * equations.effort_scale)).any())
