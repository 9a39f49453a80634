"""How far the effort leads the motion: what of it is a delay, and what only a sample that is held.

The lead that all joints share is a nuisance of the regression, and so nearly what a delay of all joints says that only
their sum is well known: a delay with a lead against it would pass for a low-pass of the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from bdnn_ros.diagnosis.regression.coloring import white_noise_of
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.candidates import Candidates

DELAY = "effort_delay"
LATEST, LAG_STEP = 0.2, 0.004
"""Delays that are tried: up to the largest, one so far from the next [s]."""


def parted(pool: Pool, fit: Fit) -> tuple[float, dict[int, float]]:
    """The lead that stays one [s], and what each chosen delay takes of it [s].

    A delay of all joints takes all but what a hold is expected to be; delays of single joints only what no sample explains,
    and only where all have one: joints without show the lead by themselves.
    What made one less since an earlier model was identified was no hold.
    """
    lead = float(fit.coefficients[pool.equations.rigid.shape[2]])
    half = pool.equations.hold
    delays = {c: float(pool.coefficients(fit, c)[0]) for c in fit.terms if pool.terms[c].effect.name == DELAY}
    for chosen, delay in delays.items():
        if pool.terms[chosen].target < 0:
            less = pool.terms[chosen].effect.coefficient_bounds[0][0] < 0.0
            kept = max(min(0.5 * half, lead + delay), 0.0 if less else -np.inf)
            return kept, {chosen: lead - kept}
    if len({pool.terms[chosen].target for chosen in delays}) < pool.equations.width:
        return lead, {}
    kept = float(np.clip(lead, -half, half))
    limited = {c: (max if delay >= 0.0 else min)(lead - kept, -delay) for c, delay in delays.items()}
    return kept, limited if lead != kept else {}


def hold_spread(pool: Pool, chosen: int) -> float:
    """Standard deviation of what a hold adds to a delay of all joints [s]: between none and half a sample."""
    if pool.terms[chosen].effect.name != DELAY or pool.terms[chosen].target >= 0:
        return 0.0
    return 0.5 * pool.equations.hold


def moved(candidates: Candidates, pool: Pool, chosen: Sequence[int], delay: int, floor: np.ndarray) -> Pool:
    """Some of a pool's terms with a chosen delay last, where the effort itself, moved by it, fits the others best.

    The load that a delay puts ahead is made of the other terms, and they of what a wrong delay leaves: each can bear the
    other out. What is moved here is the measured effort, which owes them nothing. The equations take the load that it shows,
    the pool the noise that is left then: by what a wrong delay leaves, it would stay wrong.

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
    equations.relieve(*candidates.load(equations, best, best.whole))
    noise = white_noise_of(equations, best.residual(best.whole), floor)
    return Pool(equations, noise, [*rest, term.shaped({"at": lag})], pool.link_error)


def undelayed(pool: Pool) -> Pool:
    """The pool's terms but its delays, on efforts that are moved by those.

    What acts is known from such a fit at once. From one with a delay's column, made of the load that the fit before had, it
    follows by and by, and for a long delay of a fast motion never.
    """
    fit, terms = pool.whole, pool.terms
    late = [
        (terms[c], float(pool.coefficients(fit, c)[0])) for c in fit.terms if terms[c].effect.name == DELAY
    ]
    return _at(pool, [t for t in terms if t.effect.name != DELAY], late) if late else pool


def _at(pool: Pool, terms: Sequence[Term], delays: Sequence[tuple[Term, float]]) -> Pool:
    """A pool of other terms at the same noise, with the measured effort moved by some delays [s]."""
    equations = pool.equations
    for delay, lag in delays:
        equations = _earlier(equations, delay.target, lag)
    return Pool(equations, pool.noise, terms, pool.link_error)


def _earlier(equations: Equations, joint: int, lag: float) -> Equations:
    """The equations with the measured effort of one joint (-1: of all) moved to when it acts."""
    motion, effort = equations.motion, equations.motion.signals.effort
    if effort is None:
        raise ValueError("no effort was measured")
    change = motion.advanced(effort, -lag) - effort
    if joint >= 0:
        change = motion.joint_column(joint, change[:, joint])[..., 0]
    other = copy(equations)
    other.target = equations.target + equations.reduced(change, borne=False)
    return other
