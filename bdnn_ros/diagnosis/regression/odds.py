"""Prior odds of causes: how rare each kind is, and which kinds go together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.term import COMMON, Term

COST = 8.0
"""Log prior odds against an effect at one place: there are about 150 candidates, and a false name is worse than none."""
RARE = (
    "drift",
    "external_wrench",
    "hysteresis",
    "asymmetric_friction",
    "stribeck_friction",
    "load_dependent_friction",
    "quadratic_drag",
)
RARE_COST = 2.0
"""Additional cost of the rare kinds, which a simpler kind may stand for."""
TIMES_COST = 9.0
"""Additional cost of an effect with two free times, each one of about a hundred."""
PERIODS_COST = 4.0
"""Additional cost of an effect with a free period in position: a joint's range tells some fifty apart."""
LINK_COST = 3.5
"""Cost of a wrong link: every description has some, and errors of all links compete with it."""
PAYLOAD_COST = 4.8
"""Cost of a payload at the end of an arm, of either size: tools are changed there."""
INNER_COST, FIRST_COST = 2.5, 8.5
"""Additional cost of a payload on an inner link, and on the first, where a rotor or a spring does nearly the same."""
COMMON_COST = 2.0
"""Cost of a common kind of effect that every other joint has, too."""
LINK_ERROR_COST = 150.0
"""Log prior against a relative error s of all links is this times s²: descriptions are off by up to 10 %, 5.8 % root mean
square, and rarely by 20 % everywhere."""
ELSEWHERE = ("effort_scale", "position_offset")
"""Kinds whose rivals may be at other joints: a joint that pulls less looks like all others pulling more."""


def rival_joint(term: Term) -> int:
    """Joint at which rivals of a term act; -1 for any."""
    return -1 if term.effect.name in ELSEWHERE else term.target


def log_odds(term: Term, having: dict[str, set[int]], carried: np.ndarray) -> float:
    """Log prior odds against a term; lower for a common kind that most other joints have.

    Args:
        having: joints that have each kind already.
        carried: number of other joints that each joint carries, (n,).
    """
    width = len(carried)
    cost = {"link_inertia": LINK_COST, "payload": PAYLOAD_COST}.get(term.effect.name, COST)
    alone = term.effect.on == "all" and term.target >= 0  # on one joint, of a kind that mostly acts on all
    cost += RARE_COST if alone or term.effect.name in RARE else 0.0
    cost += TIMES_COST if term.effect.timed else 0.0
    cost += PERIODS_COST if term.effect.winding else 0.0
    if term.effect.name == "payload" and carried[term.target]:
        cost += INNER_COST if carried[term.target] < width - 1 else FIRST_COST
    if term.effect.name not in COMMON or width <= 2:
        return cost
    share = len(having.get(term.effect.name, set()) - {term.target}) / (width - 1)
    return cost + (COMMON_COST - cost) * max(2.0 * share - 1.0, 0.0)


def contains(larger: Term, smaller: Term) -> bool:
    """Whether a term includes all that another can express: a richer law at its place, or the same effect on all joints."""
    if larger.effect is smaller.effect:
        return larger.target == -1 != smaller.target
    return smaller.effect.name in larger.effect.contains and smaller.target == larger.target


def related(one: Term, other: Term) -> bool:
    """Whether either term contains the other, or both are pushes, which have moves of their own."""
    return contains(one, other) or contains(other, one) or (one.effect.timed and other.effect.timed)


def having_each(pool: Pool, company: Sequence[int]) -> dict[str, set[int]]:
    """Joints that have each kind of effect, by itself or contained in another."""
    having: dict[str, set[int]] = {}
    for c in company:
        term = pool.terms[c]
        for name in (term.effect.name, *term.effect.contains):
            having.setdefault(name, set()).add(term.target)
    return having


def link_error_cost(pool: Pool) -> float:
    """Log prior odds against the link error that a pool assumes."""
    return LINK_ERROR_COST * pool.link_error**2


def unbelievable(pool: Pool, fit: Fit) -> int:
    """Number of terms with physically impossible coefficients, even within their uncertainty."""
    count = 0
    for c, at in zip(fit.terms, pool.each(fit), strict=True):
        effect = pool.terms[c].effect
        if not effect.believable(at):
            count += not effect.believable(at, np.sqrt(np.diag(pool.part(fit, c)[1])))
    return count
