"""How far the effort leads the motion: separating a delay from a sample that is held.

The lead that all joints share is a nuisance, and nearly collinear with a delay of all joints, so that only their sum is well
known: a delay with an opposite lead would act as a low-pass of the noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.diagnosis.regression.coloring import white_noise_of
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.candidates import Candidates

DELAY = "effort_delay"
LATEST, LAG_STEP = 0.2, 0.004
"""Largest delay that is tried, and the step between delays [s]."""


def lead_and_delays(pool: Pool, fit: Fit) -> tuple[float, dict[int, float]]:
    """The lead that remains [s], and what each chosen delay takes over of it [s].

    A delay of all joints takes all but the expected hold. Delays of single joints take only what no hold explains, and only if
    all joints have one, since joints without show the lead by themselves. A delay that became shorter since an earlier model
    was no hold.
    """
    lead = float(fit.coefficients[pool.equations.rigid.shape[2]])
    half = pool.equations.nuisances.hold
    delays = {c: float(pool.coefficients(fit, c)[0]) for c in fit.terms if pool.terms[c].effect.name == DELAY}
    for chosen, delay in delays.items():
        if pool.terms[chosen].target < 0:
            less = pool.terms[chosen].effect.coefficient_bounds[0][0] < 0.0
            kept = max(min(0.5 * half, lead + delay), 0.0 if less else -np.inf)
            return kept, {chosen: lead - kept}
    if len({pool.terms[chosen].target for chosen in delays}) < pool.equations.rows.width:
        return lead, {}
    kept = float(np.clip(lead, -half, half))
    limited = {c: (max if delay >= 0.0 else min)(lead - kept, -delay) for c, delay in delays.items()}
    return kept, limited if lead != kept else {}


def hold_spread(pool: Pool, chosen: int) -> float:
    """Standard deviation of a delay of all joints by the hold [s], which may be none to half a sample."""
    if pool.terms[chosen].effect.name != DELAY or pool.terms[chosen].target >= 0:
        return 0.0
    return 0.5 * pool.equations.nuisances.hold


def moved(candidates: Candidates, pool: Pool, chosen: Sequence[int], delay: int, floor: np.ndarray) -> Pool:
    """Some terms of a pool, last a chosen delay, with the delay at which the shifted measured effort is fitted best.

    The load that a delay shifts is computed from the other terms, which were fitted under a possibly wrong delay: each can
    confirm the other. The measured effort is independent of them. Load and noise are then updated, so that those left by a
    wrong delay do not keep it.

    Args:
        floor: smallest noise, (n,) [N·m].
    """
    equations, term = pool.equations, pool.terms[delay]
    rest = [pool.terms[c] for c in chosen if c != delay]
    lag, best = 0.0, _at(pool, rest, [])
    while lag + LAG_STEP <= LATEST:
        later = _at(pool, rest, [(term, lag + LAG_STEP)])
        if later.whole.evidence <= best.whole.evidence:
            break
        lag, best = lag + LAG_STEP, later
    equations.update_load(*candidates.load(equations, best, best.whole))
    noise = white_noise_of(equations, best.residual(best.whole), floor)
    return Pool(equations, noise, [*rest, term.shaped({"at": lag})], pool.link_error)


def undelayed(pool: Pool) -> Pool:
    """The pool's terms without its delays, on measured efforts shifted by them.

    Such a fit gives the acting effort at once. From the delay's column, computed from the load of the fit before, it converges
    slowly, and for a long delay of a fast motion not at all.
    """
    fit, terms = pool.whole, pool.terms
    late = [
        (terms[c], float(pool.coefficients(fit, c)[0])) for c in fit.terms if terms[c].effect.name == DELAY
    ]
    return _at(pool, [t for t in terms if t.effect.name != DELAY], late) if late else pool


def _at(pool: Pool, terms: Sequence[Term], delays: Sequence[tuple[Term, float]]) -> Pool:
    """A pool of some terms at the same noise, with the measured effort shifted by some delays [s]."""
    equations = pool.equations
    for delay, lag in delays:
        equations = _earlier(equations, delay.target, lag)
    return Pool(equations, pool.noise, terms, pool.link_error)


def _earlier(equations: Equations, joint: int, lag: float) -> Equations:
    """The equations with the measured effort of one joint (-1: of all) shifted to when it acts."""
    motion, effort = equations.motion, equations.motion.signals.effort
    if effort is None:
        raise ValueError("no effort was measured")
    change = motion.advanced(effort, -lag) - effort
    if joint >= 0:
        change = motion.joint_column(joint, change[:, joint])[..., 0]
    shift = equations.decimation.as_rows(change, borne=False)
    return equations.with_target(equations.rows.target + shift)
