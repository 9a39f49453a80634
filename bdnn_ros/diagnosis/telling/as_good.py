"""Ties with richer laws that this motion would have shown: another such motion would settle nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bdnn_ros.diagnosis.judging.posterior import CLEAR, estimates
from bdnn_ros.diagnosis.regression.equations import TYPICAL_SHARE, Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.gains import MINIMUM_SHARE
from bdnn_ros.diagnosis.regression.noise import rms
from bdnn_ros.diagnosis.regression.odds import contains
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.sentences import Kind, Note
from bdnn_ros.effects.base import SHOWN


def as_good(plain: Term, richer: Term, place: str, share: float) -> Note:
    """Advice on a richer law that exceeds a simpler one by at most this share of the effort."""
    title = richer.title
    told = {"Richer": title[0].upper() + title[1:], "richer": title, "place": place, "plain": plain.title}
    return Note(
        Kind.AS_GOOD if share < MINIMUM_SHARE else Kind.WOULD_SHOW, {**told, "percent": 100.0 * share}
    )


def at_most(equations: Equations, fitted: Pool, one: int, rival: Term) -> float | None:
    """Upper bound of a richer law's excess over a simpler one, as a share of the joint's effort; None if not shown.

    The motion must determine the coefficients well enough to show an excess of usual size: along motion one way only, nothing
    is known of friction the other way. Laws with a free shape, and an excess that seems to be there, are not excluded.

    Args:
        fitted: the found terms.
        one: the simpler law among them.
    """
    term, weights = fitted.terms[one], rival.effect.excess
    if weights is None or rival.effect.shape_bounds or not contains(rival, term):
        return None
    kept: Sequence[Term] = [t for c, t in enumerate(fitted.terms) if c != one and not contains(rival, t)]
    pool = Pool(equations, fitted.noise, [*kept, rival], fitted.link_error)
    law, known = estimates(pool, pool.whole)[-1], slice(len(weights))
    variances = [float(weights @ by[known, known] @ weights) for by in (law.covariance, law.robust)]
    joint = term.target
    unit = rms(equations.columns.of(term)[equations.usable[:, joint], joint, 0]) / float(
        equations.rows.effort_scale[joint]
    )
    std = unit * math.sqrt(max(variances))
    excess = unit * abs(float(weights @ law.coefficients))
    share = excess + SHOWN * std
    settled = (
        share < MINIMUM_SHARE or excess <= SHOWN * std
    )  # else an excess seems to be there, and another motion may show more of it
    return share if settled and CLEAR * std < TYPICAL_SHARE else None
