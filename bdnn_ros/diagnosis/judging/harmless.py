"""What was found is given up where rows that were held out are surely predicted worse with it than without."""

from __future__ import annotations

from dataclasses import replace

from bdnn_ros.diagnosis.judging.attempt import Attempt
from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.pushes.pushes import pushing
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.gains import gain_of


def harmless(
    equations: Equations, attempt: Attempt, pool: Pool, found: list[Estimate]
) -> tuple[Attempt, Pool, list[Estimate]]:
    """An attempt, its terms in all rows and their estimates; none of them where they surely do harm.

    Of such terms none has a name. In the extended model they would make other motions worse than the simulation does: as
    rotors that stand for how joints stick.
    """
    if not pool.terms or not _worse(equations, attempt):
        return attempt, pool, found
    counted = equations.usable
    equations.count(counted & ~attempt.test[:, None])
    fitted = Pool(equations, pool.noise, [], pool.link_error)
    extended = fitted.left()
    equations.count(counted)
    bare = replace(attempt, judgements=[], fitted=fitted, extended=extended)
    return bare, Pool(equations, pool.noise, [], pool.link_error), []


def _worse(equations: Equations, attempt: Attempt) -> bool:
    """Whether the error of held-out rows surely grows."""
    pushed = pushing(attempt.fitted.terms, equations.motion.time[equations.rows])
    _, (_, most) = gain_of(equations, attempt.extended, equations.usable & attempt.test[:, None], pushed)
    return most < 0.0
