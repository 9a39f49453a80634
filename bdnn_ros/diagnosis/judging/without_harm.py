"""Findings are dropped where they surely predict held-out rows worse than the reference does."""

from __future__ import annotations

from dataclasses import replace

from bdnn_ros.diagnosis.judging.attempt import Attempt
from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.pushes.pushes import pushing
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.gains import held_out_gain


def without_harm(
    equations: Equations, attempt: Attempt, pool: Pool, found: list[Estimate]
) -> tuple[Attempt, Pool, list[Estimate]]:
    """An attempt, its terms in all rows and their estimates; no terms where they surely increase the held-out error.

    No such term has a name, but in the extended model they would worsen other motions, as rotors do that stand for sticking.
    If link (or identified joint) corrections do harm even without terms, they are dropped as well: the reference stays
    unchanged.
    """
    if not _worse(equations, attempt):
        return attempt, pool, found
    if pool.terms:
        counted = equations.usable
        equations.use_rows(counted & ~attempt.test[:, None])
        fitted = Pool(equations, pool.noise, [], pool.link_error)
        attempt = replace(attempt, judgements=[], fitted=fitted, extended=fitted.residual_of_all())
        equations.use_rows(counted)
        pool = Pool(equations, pool.noise, [], pool.link_error)
    if _worse(equations, attempt):
        pool = pool.still()
        attempt = replace(attempt, fitted=attempt.fitted.still(), extended=equations.rows.target.copy())
    return attempt, pool, []


def _worse(equations: Equations, attempt: Attempt) -> bool:
    """Whether the error of held-out rows surely grows."""
    pushed = pushing(attempt.fitted.terms, equations.rows.time)
    _, (_, most) = held_out_gain(
        equations, attempt.extended, equations.usable & attempt.test[:, None], pushed
    )
    return most < 0.0
