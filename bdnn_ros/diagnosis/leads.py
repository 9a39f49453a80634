"""How far the effort leads the motion: what of it is a delay, and what only a sample that is held.

The lead that all joints share is a nuisance of the regression, and so nearly what a delay of all joints says that only
their sum is well known: a delay with a lead against it would pass for a low-pass of the noise.
"""

from __future__ import annotations

import numpy as np

from bdnn_ros.diagnosis.evidence import Fit, Pool

DELAY = "effort_delay"


def parted(pool: Pool, fit: Fit) -> tuple[float, dict[int, float]]:
    """The lead that stays one [s], and what each chosen delay takes of it [s].

    A delay of all joints takes all but what a hold is expected to be; delays of single joints only what no sample explains.
    """
    lead = float(fit.coefficients[pool.equations.rigid.shape[2]])
    half = pool.equations.hold
    delays = {c: float(pool.coefficients(fit, c)[0]) for c in fit.terms if pool.terms[c].effect.name == DELAY}
    for chosen, delay in delays.items():
        if pool.terms[chosen].target < 0:
            kept = min(0.5 * half, lead + delay)
            return kept, {chosen: lead - kept}
    if not delays:
        return lead, {}
    kept = float(np.clip(lead, -half, half))
    return kept, {c: max(lead - kept, -delay) for c, delay in delays.items() if lead != kept}


def hold_spread(pool: Pool, chosen: int) -> float:
    """Standard deviation of what a hold adds to a delay of all joints [s]: between none and half a sample."""
    if pool.terms[chosen].effect.name != DELAY or pool.terms[chosen].target >= 0:
        return 0.0
    return 0.5 * pool.equations.hold
